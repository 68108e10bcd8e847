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

/// Two numbers of each sigmoid in the temporal part, φ.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Sigmoids<T, const N: usize> {
    /// There is none.
    Constant,
    /// One for all DoFs.
    Shared(T, T),
    Each([T; N], [T; N]),
}

impl<T: Real, const N: usize> Sigmoids<T, N> {
    #[inline(always)]
    fn map(&self, f: impl Fn(T, T) -> (T, T)) -> Self {
        // One loop for both: on a microcontroller its exponentials are in the flash once.
        let (mut a, mut b, count) = match *self {
            Sigmoids::Constant => return Sigmoids::Constant,
            Sigmoids::Shared(a, b) => ([a; N], [b; N], 1),
            Sigmoids::Each(a, b) => (a, b, N),
        };
        for (a, b) in a.iter_mut().zip(&mut b).take(count) {
            (*a, *b) = f(*a, *b);
        }
        match (self, a.first(), b.first()) {
            (Sigmoids::Shared(..), Some(&a), Some(&b)) => Sigmoids::Shared(a, b),
            _ => Sigmoids::Each(a, b),
        }
    }
}

/// A synergy of N DoFs with its parameters. Every number in it is finite and below 1e4 in magnitude, an offset below 80.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Synergy<T, const N: usize> {
    gains: Gains<T, N>,
    /// Offsets, and slopes in 1/s.
    sigmoids: Sigmoids<T, N>,
}

impl<T: Real, const N: usize> Synergy<T, N> {
    /// S_A: the same gain for every DoF. With a gain of 1 it is the bare controller.
    ///
    /// # Errors
    /// As every constructor here: a parameter that is not finite, or above 1e4 in magnitude, or an offset above 80.
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
            sigmoids: Sigmoids::Constant,
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
            sigmoids: Sigmoids::Shared(offset, slope),
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
            sigmoids: Sigmoids::Each(offset, slope),
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
            sigmoids: self.sigmoids,
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
        let below = |x: &T, most: f64| T::all(x.abs().lt(T::of(most)));
        let gains = match &self.gains {
            Gains::Diagonal(gains) => gains.iter().all(|x| below(x, 1e4)),
            Gains::Full(rows) => rows.iter().flatten().all(|x| below(x, 1e4)),
        };
        // e^80 is a number in `f32` too.
        let sigmoids = match &self.sigmoids {
            Sigmoids::Constant => true,
            Sigmoids::Shared(offset, slope) => below(offset, 80.0) && below(slope, 1e4),
            Sigmoids::Each(offsets, slopes) => {
                offsets.iter().all(|x| below(x, 80.0)) && slopes.iter().all(|x| below(x, 1e4))
            }
        };
        if gains && sigmoids {
            Ok(self)
        } else {
            Err(Error::OutOfRange {
                what: "a synergy's numbers must be below 10,000 in magnitude, its offsets below 80",
                joint: None,
            })
        }
    }

    /// ΔΘ′ = φ(t) ∘ (M·ΔΘ), `t` in seconds since the motion began.
    #[inline(always)]
    pub fn apply(&self, step: &[T; N], t: T) -> [T; N] {
        let at_t = Paced {
            gains: self.gains,
            sigmoids: self.sigmoids.map(
                #[inline(always)]
                |offset, slope| ((offset - slope * t).exp(), T::zero()),
            ),
            dt: T::zero(),
        };
        at_t.apply(step, &mut at_t.rests())
    }

    /// This synergy in steps of `dt` seconds, for who makes controllers while a motion runs
    /// ([`Controller::paced`](crate::controller::Controller::paced)).
    ///
    /// # Errors
    /// A period that is not finite, not positive, or above 1e6.
    #[inline(always)]
    pub fn paced(&self, dt: T) -> Result<Paced<T, N>, Error> {
        check_rate(dt)?;
        Ok(Paced {
            gains: self.gains,
            sigmoids: self.sigmoids.map(
                #[inline(always)]
                |offset, slope| {
                    let fall = -(slope * dt);
                    // A loop for the flash's sake, too.
                    let mut powers = [offset, fall];
                    for power in &mut powers {
                        *power = power.exp();
                    }
                    (powers[0], less_1(fall, powers[1]))
                },
            ),
            dt,
        })
    }
}

/// A synergy in steps of a period: of each sigmoid the *rest* e^(offset − slope·t) at t = 0, and by what share of itself
/// it changes in a period, e^(−slope·dt) − 1.
///
/// So a tick pays for a product and a sum instead of an exponential. Their rounding goes one way as often as the other:
/// in motions of 10,000 ticks sigmoids are within 1e-6 of what they should be in `f32`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paced<T, const N: usize> {
    gains: Gains<T, N>,
    sigmoids: Sigmoids<T, N>,
    /// The period, seconds.
    pub(crate) dt: T,
}

impl<T: Real, const N: usize> Paced<T, N> {
    /// The rests at a motion's beginning; of a shared sigmoid, in the first place.
    #[inline(always)]
    pub(crate) fn rests(&self) -> [T; N] {
        match self.sigmoids {
            Sigmoids::Constant => [T::zero(); N],
            Sigmoids::Shared(rest, _) => [rest; N],
            Sigmoids::Each(rests, _) => rests,
        }
    }

    /// ΔΘ′ of a tick with these rests, which go on to the next.
    #[inline(always)]
    pub(crate) fn apply(&self, step: &[T; N], rests: &mut [T; N]) -> [T; N] {
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
        match &self.sigmoids {
            Sigmoids::Constant => {}
            Sigmoids::Shared(_, change) => {
                if let Some(rest) = rests.first_mut() {
                    let phi = sigmoid(*rest);
                    for i in 0..N {
                        out[i] = phi * out[i];
                    }
                    *rest = *rest + *rest * *change;
                }
            }
            Sigmoids::Each(_, changes) => {
                for i in 0..N {
                    out[i] = sigmoid(rests[i]) * out[i];
                    rests[i] = rests[i] + rests[i] * changes[i];
                }
            }
        }
        out
    }
}

/// Whether a rate λ or a period can be one.
///
/// # Errors
/// One that is not finite, not positive, or above 1e6.
#[inline(always)]
pub(crate) fn check_rate<T: Real>(x: T) -> Result<(), Error> {
    if T::all(T::zero().lt(x)) && T::all(x.lt(T::of(1e6))) {
        Ok(())
    } else {
        Err(Error::OutOfRange {
            what: "λ and the period must be positive and below 1e6",
            joint: None,
        })
    }
}

/// 1/(1 + e^(offset − slope·t)), of its rest.
#[inline(always)]
fn sigmoid<T: Real>(rest: T) -> T {
    T::one() / (T::one() + rest)
}

/// eˣ − 1, of x and eˣ. Near 0, where the difference would lose what counts, x / (1 − x/2 + Σ B₂ₖ·x²ᵏ/(2k)!) with
/// Bernoulli's numbers (Abramowitz and Stegun 1964, 23.1.1), exact to 2e-14 of itself.
#[inline(always)]
fn less_1<T: Real>(x: T, power: T) -> T {
    let xx = x * x;
    let sum = T::of(-1.0 / 1_209_600.0) * xx + T::of(1.0 / 30_240.0);
    let sum = sum * xx + T::of(-1.0 / 720.0);
    let sum = sum * xx + T::of(1.0 / 12.0);
    let near = x / (sum * xx - T::of(0.5) * x + T::one());
    T::select(x.abs().lt(T::of(0.25)), near, power - T::one())
}

#[cfg(all(test, feature = "libm"))]
mod tests {
    use super::*;
    use std::{println, string::ToString, vec};

    #[test]
    fn parameters_that_are_no_numbers_or_too_large_are_refused() {
        let error = Error::OutOfRange {
            what: "a synergy's numbers must be below 10,000 in magnitude, its offsets below 80",
            joint: None,
        };
        for offset in [80.0, -80.0] {
            assert_eq!(Synergy::<f64, 2>::c([1.0; 2], offset, 1.0), Err(error));
            assert_eq!(Synergy::d([1.0; 2], [0.0, offset], [1.0; 2]), Err(error));
        }
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

    /// How far a tick's sigmoids are from the exact ones, over long motions and at the bounds.
    fn furthest<T: Real + Into<f64>>(rate: f64) -> f64 {
        let mut furthest: f64 = 0.0;
        for offset in [0.0, 0.1, 5.0, 20.0] {
            for slope in [1.0, 3.7, 10.0] {
                let synergy =
                    Synergy::<T, 1>::d([T::one()], [T::of(offset)], [T::of(slope)]).unwrap();
                let dt = T::of(1.0 / rate);
                let paced = synergy.paced(dt).unwrap();
                let mut rests = paced.rests();
                for tick in 0..10_000 {
                    let [found] = paced.apply(&[T::one()], &mut rests);
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
            let (single, double) = (furthest::<f32>(rate), furthest::<f64>(rate));
            println!("sigmoids at {rate} Hz are within {single:e} in f32, {double:e} in f64");
            // An exponential of `micromath` is 3e-3 off at worst.
            let most = if cfg!(feature = "micromath") {
                2e-3
            } else {
                1e-6
            };
            assert!(single < most && double < 1e-14);
        }
    }

    #[test]
    fn a_sigmoid_too_steep_for_its_period_is_between_0_and_1() {
        for (offset, slope) in [(79.0, 9e3), (-79.0, -9e3), (79.0, -9e3), (-79.0, 9e3)] {
            for dt in [1e-3, 1.0, 1e5] {
                let synergy = Synergy::<f32, 2>::c([1.0, -1.0], offset, slope).unwrap();
                let paced = synergy.paced(dt).unwrap();
                let mut rests = paced.rests();
                for _tick in 0..200 {
                    let [up, down] = paced.apply(&[1.0; 2], &mut rests);
                    assert!(
                        (0.0..=1.0).contains(&up) && down == -up,
                        "{offset} {slope} {up}"
                    );
                }
            }
        }
    }

    #[test]
    fn e_to_the_x_less_1_is_exact_near_0_too() {
        for step in -2000..=2000 {
            let x = f64::from(step) * 1e-3;
            let exact = libm::expm1(x);
            assert!(
                (less_1(x, x.exp()) - exact).abs() <= 3e-14 * exact.abs(),
                "{x}"
            );
            let exact = libm::expm1(f64::from(x as f32));
            let found = f64::from(less_1(x as f32, (x as f32).exp()));
            assert!((found - exact).abs() <= 6e-7 * exact.abs(), "{x}");
        }
    }
}
