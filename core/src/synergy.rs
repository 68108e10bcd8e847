//! Synergies: how much, and when, each DoF takes part (SPEC section 3; the paper's sections 3.2 and 4).
//!
//! ΔΘ′ᵢ = φᵢ(t) · (M·ΔΘ)ᵢ, with M a matrix of gains and φ a function of the time since the motion began.

use crate::Error;
use crate::real::Real;
use crate::vector::dot;

/// The paper's models, by what they share between DoFs. N is the number of DoFs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Model {
    /// One gain for all, constant in time: g.
    A,
    /// A gain for each DoF, constant in time: g₁…g_N.
    B,
    /// A gain for each DoF and one sigmoid: g₁…g_N, o, s.
    C,
    /// A gain and a sigmoid for each DoF: g₁…g_N, o₁…o_N, s₁…s_N.
    D,
}

impl Model {
    /// How many parameters there are for `n` DoFs (m in the SPEC).
    pub const fn parameters(self, n: usize) -> usize {
        match self {
            Model::A => 1,
            Model::B => n,
            Model::C => n + 2,
            Model::D => 3 * n,
        }
    }

    /// The paper's bounds of parameter `k` of `n` DoFs' model: gains in [−5, 5], offsets in [0, 20], slopes in
    /// [1, 10] (1/s).
    pub const fn bounds(self, n: usize, k: usize) -> (f64, f64) {
        const GAIN: (f64, f64) = (-5.0, 5.0);
        const OFFSET: (f64, f64) = (0.0, 20.0);
        const SLOPE: (f64, f64) = (1.0, 10.0);
        match self {
            Model::C if k == n => OFFSET,
            Model::C if k == n + 1 => SLOPE,
            Model::D if k >= 2 * n => SLOPE,
            Model::D if k >= n => OFFSET,
            _ => GAIN,
        }
    }
}

/// The spatial part, M.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Gains<T, const N: usize> {
    Diagonal([T; N]),
    /// Row by row.
    Full([[T; N]; N]),
}

/// The temporal part, φ.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Time<T, const N: usize> {
    Constant,
    Shared { offset: T, slope: T },
    Each { offset: [T; N], slope: [T; N] },
}

/// A synergy of N DoFs with its parameters. Every number in it is finite and below 1e4 in magnitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Synergy<T, const N: usize> {
    gains: Gains<T, N>,
    time: Time<T, N>,
}

impl<T: Real, const N: usize> Synergy<T, N> {
    /// S_A: the same gain for every DoF. With a gain of 1 it is the bare controller.
    ///
    /// # Errors
    /// As every constructor here: a parameter that is not finite, or above 1e4 in magnitude.
    #[inline(always)]
    pub fn a(gain: T) -> Result<Self, Error> {
        Self::b([gain; N])
    }

    /// S_B: a gain for each DoF.
    ///
    /// # Errors
    /// See [`Synergy::a`].
    #[inline(always)]
    pub fn b(gains: [T; N]) -> Result<Self, Error> {
        Synergy {
            gains: Gains::Diagonal(gains),
            time: Time::Constant,
        }
        .checked()
    }

    /// S_C: a gain for each DoF and one sigmoid 1/(1 + e^(−slope·t + offset)), slope in 1/s.
    ///
    /// # Errors
    /// See [`Synergy::a`].
    ///
    /// ```
    /// let s = sinew::synergy::Synergy::c([1.0f64; 7], 4.0, 8.0)?;
    /// let half_way = s.apply(&[0.1; 7], 0.5); // offset / slope: the sigmoid's middle
    /// assert!((half_way[0] - 0.05).abs() < 1e-12);
    /// # Ok::<(), sinew::Error>(())
    /// ```
    #[inline(always)]
    pub fn c(gains: [T; N], offset: T, slope: T) -> Result<Self, Error> {
        Synergy {
            gains: Gains::Diagonal(gains),
            time: Time::Shared { offset, slope },
        }
        .checked()
    }

    /// S_D: a gain and a sigmoid for each DoF.
    ///
    /// # Errors
    /// See [`Synergy::a`].
    #[inline(always)]
    pub fn d(gains: [T; N], offset: [T; N], slope: [T; N]) -> Result<Self, Error> {
        Synergy {
            gains: Gains::Diagonal(gains),
            time: Time::Each { offset, slope },
        }
        .checked()
    }

    /// The same spatial part with a full matrix instead of a diagonal: ΔΘᵢ mixes into every other DoF. Beyond the
    /// paper. `gains` row by row; the temporal part stays.
    ///
    /// # Errors
    /// See [`Synergy::a`].
    ///
    /// ```
    /// let s = sinew::synergy::Synergy::b([1.0f64; 2])?.with_matrix([[1.0, 0.5], [0.0, 1.0]])?;
    /// assert_eq!(s.apply(&[1.0, 2.0], 0.0), [2.0, 2.0]);
    /// # Ok::<(), sinew::Error>(())
    /// ```
    #[inline(always)]
    pub fn with_matrix(self, gains: [[T; N]; N]) -> Result<Self, Error> {
        Synergy {
            gains: Gains::Full(gains),
            time: self.time,
        }
        .checked()
    }

    /// A model's synergy from its parameters in the SPEC's order (see [`Model`]).
    ///
    /// # Errors
    /// The wrong number of parameters; or see [`Synergy::a`].
    ///
    /// ```
    /// use sinew::synergy::{Model, Synergy};
    /// let s = Synergy::<f64, 7>::from_parameters(Model::A, &[0.7])?;
    /// assert_eq!(s, Synergy::a(0.7)?);
    /// assert!(Synergy::<f64, 7>::from_parameters(Model::C, &[0.7]).is_err());
    /// # Ok::<(), sinew::Error>(())
    /// ```
    #[inline(always)]
    pub fn from_parameters(model: Model, parameters: &[T]) -> Result<Self, Error> {
        let expected = model.parameters(N);
        if parameters.len() != expected {
            return Err(Error::WrongCount {
                what: "parameters",
                expected,
                found: parameters.len(),
            });
        }
        let mut part = [[T::zero(); N]; 3];
        for (row, values) in part.iter_mut().zip(parameters.chunks(N.max(1))) {
            for (slot, &value) in row.iter_mut().zip(values) {
                *slot = value;
            }
        }
        let [gains, second, third] = part;
        let at = |k: usize| parameters.get(k).copied().unwrap_or(T::zero());
        match model {
            Model::A => Self::a(at(0)),
            Model::B => Self::b(gains),
            Model::C => Self::c(gains, at(N), at(N + 1)),
            Model::D => Self::d(gains, second, third),
        }
    }

    #[inline(always)]
    fn checked(self) -> Result<Self, Error> {
        let acceptable = |x: &T| T::all(x.abs().lt(T::of(1e4)));
        let gains = match &self.gains {
            Gains::Diagonal(gains) => gains.iter().all(acceptable),
            Gains::Full(rows) => rows.iter().flatten().all(acceptable),
        };
        let time = match &self.time {
            Time::Constant => true,
            Time::Shared { offset, slope } => acceptable(offset) && acceptable(slope),
            Time::Each { offset, slope } => offset.iter().chain(slope).all(acceptable),
        };
        if gains && time {
            Ok(self)
        } else {
            Err(Error::OutOfRange {
                what: "a synergy's parameters must be finite numbers below 10,000 in magnitude",
                joint: None,
            })
        }
    }

    /// ΔΘ′ = φ(t) ∘ (M·ΔΘ), `t` in seconds since the motion began.
    #[inline(always)]
    pub fn apply(&self, step: &[T; N], t: T) -> [T; N] {
        self.weigh(step, &self.rests(t))
    }

    /// The same with the sigmoids' rests at hand.
    #[inline(always)]
    fn weigh(&self, step: &[T; N], rests: &[T; N]) -> [T; N] {
        let mut out = *step;
        match &self.gains {
            Gains::Diagonal(gains) => {
                for i in 0..N {
                    out[i] = gains[i] * step[i];
                }
            }
            Gains::Full(rows) => {
                for i in 0..N {
                    out[i] = dot(&rows[i], step);
                }
            }
        }
        match &self.time {
            Time::Constant => {}
            Time::Shared { .. } => {
                let phi = sigmoid(rests.first().copied().unwrap_or(T::zero()));
                for i in 0..N {
                    out[i] = phi * out[i];
                }
            }
            Time::Each { .. } => {
                for i in 0..N {
                    out[i] = sigmoid(rests[i]) * out[i];
                }
            }
        }
        out
    }

    /// e^(offset − slope·t) of each sigmoid; of a shared one, in the first place.
    #[inline(always)]
    fn rests(&self, t: T) -> [T; N] {
        self.each(
            #[inline(always)]
            |offset, slope| (offset - slope * t).exp(),
        )
    }

    /// Something of each sigmoid; of a shared one, in the first place. Zero where there is none.
    #[inline(always)]
    fn each(&self, f: impl Fn(T, T) -> T) -> [T; N] {
        let mut out = [T::zero(); N];
        match &self.time {
            Time::Constant => {}
            Time::Shared { offset, slope } => {
                if let Some(first) = out.first_mut() {
                    *first = f(*offset, *slope);
                }
            }
            Time::Each { offset, slope } => {
                for i in 0..N {
                    out[i] = f(offset[i], slope[i]);
                }
            }
        }
        out
    }
}

/// 1/(1 + e^(offset − slope·t)), of its rest.
#[inline(always)]
fn sigmoid<T: Real>(rest: T) -> T {
    T::one() / (T::one() + rest)
}

/// After so many ticks the rests are computed anew.
const FRESH: u32 = 64;

/// A synergy's sigmoids as a motion runs, period by period: of each, the rest e^(offset − slope·t), which falls by the
/// same factor in every period.
///
/// So a tick pays for a product instead of an exponential. What products lose is made good by an exponential every 64
/// ticks: sigmoids are within 1e-6 of what they should be in `f32`. Far outside of the model's bounds an exponent
/// saturates; then a sigmoid may be up to 64 ticks early, but lies between 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Timing<T, const N: usize> {
    rests: [T; N],
    falls: [T; N],
}

impl<T: Real, const N: usize> Timing<T, N> {
    /// At a motion's beginning. `dt` is the period in seconds.
    #[inline(always)]
    pub(crate) fn new(synergy: &Synergy<T, N>, dt: T) -> Self {
        Timing {
            rests: synergy.rests(T::zero()),
            falls: synergy.each(
                #[inline(always)]
                |_, slope| (-(slope * dt)).exp(),
            ),
        }
    }

    /// ΔΘ′ of tick `tick`, counted from 0, and on to the next: to be asked for every tick in turn.
    #[inline(always)]
    pub(crate) fn apply(
        &mut self,
        synergy: &Synergy<T, N>,
        step: &[T; N],
        tick: u32,
        dt: T,
    ) -> [T; N] {
        if tick.is_multiple_of(FRESH) {
            self.rests = synergy.rests(T::count(tick) * dt);
        }
        let out = synergy.weigh(step, &self.rests);
        let sigmoids = match synergy.time {
            Time::Constant => 0,
            Time::Shared { .. } => 1,
            Time::Each { .. } => N,
        };
        for (rest, fall) in self.rests.iter_mut().zip(&self.falls).take(sigmoids) {
            *rest = *rest * *fall;
        }
        out
    }
}

#[cfg(all(test, feature = "libm"))]
mod tests {
    use super::*;
    use std::{string::ToString, vec};

    #[test]
    fn parameters_that_are_no_numbers_or_too_large_are_refused() {
        let error = Error::OutOfRange {
            what: "a synergy's parameters must be finite numbers below 10,000 in magnitude",
            joint: None,
        };
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e4, -1e4] {
            let (good, bad) = ([1.0, 2.0], [1.0, x]);
            for made in [
                Synergy::<f64, 2>::a(x),
                Synergy::b(bad),
                Synergy::c(bad, 0.0, 1.0),
                Synergy::c(good, x, 1.0),
                Synergy::c(good, 0.0, x),
                Synergy::d(bad, good, good),
                Synergy::d(good, bad, good),
                Synergy::d(good, good, bad),
                Synergy::b(good).and_then(|s| s.with_matrix([good, bad])),
            ] {
                assert_eq!(made, Err(error), "{x}");
            }
        }
    }

    #[test]
    fn a_model_has_as_many_parameters_as_the_spec_says() {
        for (model, expected) in [(Model::A, 1), (Model::B, 7), (Model::C, 9), (Model::D, 21)] {
            assert_eq!(model.parameters(7), expected);
            assert!(Synergy::<f64, 7>::from_parameters(model, &vec![1.0; expected]).is_ok());
            for found in [0, expected - 1, expected + 1] {
                let made = Synergy::<f64, 7>::from_parameters(model, &vec![1.0; found]);
                let error = Error::WrongCount {
                    what: "parameters",
                    expected,
                    found,
                };
                assert_eq!(made, Err(error));
                assert!(error.to_string().contains("parameters, found"), "{error}");
            }
        }
    }

    #[test]
    fn each_parameter_has_the_papers_bounds() {
        let bounds = |model: Model, k| model.bounds(2, k);
        for k in 0..2 {
            for model in [Model::A, Model::B, Model::C, Model::D] {
                assert_eq!(bounds(model, k), (-5.0, 5.0));
            }
        }
        assert_eq!(
            [2, 3].map(|k| bounds(Model::C, k)),
            [(0.0, 20.0), (1.0, 10.0)]
        );
        assert_eq!([2, 3].map(|k| bounds(Model::D, k)), [(0.0, 20.0); 2]);
        assert_eq!([4, 5].map(|k| bounds(Model::D, k)), [(1.0, 10.0); 2]);
    }

    /// Products instead of exponentials, over long motions and at the bounds.
    fn furthest<T: Real + Into<f64>>(rate: f64) -> f64 {
        let mut furthest: f64 = 0.0;
        for offset in [0.0, 0.1, 5.0, 20.0] {
            for slope in [1.0, 3.7, 10.0] {
                let synergy =
                    Synergy::<T, 1>::d([T::one()], [T::of(offset)], [T::of(slope)]).unwrap();
                let dt = T::of(1.0 / rate);
                let mut timing = Timing::new(&synergy, dt);
                for tick in 0..3000 {
                    let [found] = timing.apply(&synergy, &[T::one()], tick, dt);
                    let t = f64::from(tick) * dt.into();
                    let (offset, slope): (f64, f64) = (T::of(offset).into(), T::of(slope).into());
                    let exact = 1.0 / (1.0 + libm::exp(offset - slope * t));
                    furthest = furthest.max((found.into() - exact).abs());
                }
            }
        }
        furthest
    }

    #[test]
    fn sigmoids_stay_exact_however_long_the_motion() {
        for rate in [60.0, 1000.0] {
            assert!(furthest::<f32>(rate) < 1e-6);
            assert!(furthest::<f64>(rate) < 3e-15);
        }
    }

    #[test]
    fn a_sigmoid_too_steep_for_its_period_is_between_0_and_1() {
        for (offset, slope) in [
            (9e3, 9e3),
            (-9e3, -9e3),
            (9e3, -9e3),
            (-9e3, 9e3),
            (80.0, 9e3),
        ] {
            let synergy = Synergy::<f32, 2>::c([1.0, -1.0], offset, slope).unwrap();
            let mut timing = Timing::new(&synergy, 1.0);
            for tick in 0..200 {
                let [up, down] = timing.apply(&synergy, &[1.0; 2], tick, 1.0);
                assert!(
                    (0.0..=1.0).contains(&up) && down == -up,
                    "{offset} {slope} {up}"
                );
            }
        }
    }
}
