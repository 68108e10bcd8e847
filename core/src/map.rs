//! Which synergy serves a new target: a map from a reach to parameters, learned from reaches to other targets.
//!
//! The paper learns parameters motion by motion and leaves open which targets they are valid for. Here each parameter is
//! a polynomial of second degree in what is known of a reach before it begins,
//!
//! ```text
//! pₖ = clamp( c₀ + Σᵢ cᵢ·xᵢ + Σᵢ≤ⱼ cᵢⱼ·xᵢ·xⱼ ),      x = (reach − centre)/scale
//! ```
//!
//! clamped to the parameter's bounds (SPEC section 3), with x the target (three coordinates) and the time that the reach
//! is to take.
//!
//! A map is trusted near the reaches that it was learned from. [`Planned::confidence`] is 1 at one of them and falls to 0
//! at [`SynergyMap::radius`] from the nearest. A target further away than that is served with the parameters of the
//! point at that distance on the way to the nearest: nothing is extrapolated further, and the parameters stay
//! continuous. The inverse kinematics goes to the target itself all the same.

use heapless::Vec;

use crate::Error;
use crate::chain::MOST_LENGTH;
use crate::real::Real;
use crate::synergy::{Model, Synergy};
use crate::vector::{Vec3, distance};

/// What a map looks at: the target's three coordinates and the time.
pub const INPUTS: usize = 4;
/// The terms of a polynomial of second degree in them.
pub const TERMS: usize = 1 + INPUTS + INPUTS * (INPUTS + 1) / 2;
/// The most parameters that a map can give.
pub const MOST_PARAMETERS: usize = 24;
/// The most targets that a map knows it was learned from.
pub const MOST_TARGETS: usize = 64;

/// What is known of a reach before it begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reach<T> {
    /// The target, metres in the base frame.
    pub target: Vec3<T>,
    /// How long it is to take, seconds.
    pub seconds: T,
}

/// A synergy for a reach, and how far to trust it.
#[derive(Clone, Debug)]
pub struct Planned<T, const N: usize> {
    /// The synergy.
    pub synergy: Synergy<T, N>,
    /// Its parameters, in the SPEC's order.
    pub parameters: Vec<T, MOST_PARAMETERS>,
    /// 1 at a target learned from, 0 at the map's radius from the nearest and beyond.
    pub confidence: T,
}

/// A map from reaches to synergies of N DoFs.
///
/// ```
/// use sinew::map::{INPUTS, Reach, SynergyMap, TERMS};
/// use sinew::synergy::Model;
///
/// // One gain, the same everywhere but for its growing with the height of the target.
/// let mut gain = [0.0; TERMS];
/// (gain[0], gain[3]) = (1.0, 0.5);
/// let map = SynergyMap::<f64, 7>::new(
///     Model::A, [0.0; INPUTS], [1.0; INPUTS], &[gain], &[[0.3, 0.2, 0.0]], 0.1,
/// )?;
/// let near = map.plan(&Reach { target: [0.3, 0.2, 0.05], seconds: 1.0 })?;
/// assert!((near.confidence - 0.5).abs() < 1e-12);
/// let far = map.plan(&Reach { target: [0.3, 0.2, 9.0], seconds: 1.0 })?;
/// assert_eq!(far.confidence, 0.0);
/// # Ok::<(), sinew::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SynergyMap<T, const N: usize> {
    model: Model,
    centre: [T; INPUTS],
    scale: [T; INPUTS],
    coefficients: Vec<[T; TERMS], MOST_PARAMETERS>,
    targets: Vec<Vec3<T>, MOST_TARGETS>,
    radius: T,
}

impl<T: Real, const N: usize> SynergyMap<T, N> {
    /// A map for a model: the inputs' `centre` and `scale`, for each of the model's parameters the coefficients (in the
    /// order 1, x₁…x₄, x₁x₁, x₂x₁, x₂x₂, x₃x₁…), the targets it was learned from (metres), and the
    /// `radius` around them within which it is trusted.
    ///
    /// # Errors
    /// Another number of parameters than the model's, no target or more than [`MOST_TARGETS`], a number that is not
    /// below 1e30, a target beyond [`MOST_LENGTH`], a scale or radius that is not above 0.
    pub fn new(
        model: Model,
        centre: [T; INPUTS],
        scale: [T; INPUTS],
        coefficients: &[[T; TERMS]],
        targets: &[Vec3<T>],
        radius: T,
    ) -> Result<Self, Error> {
        let expected = model.parameters(N);
        let wrong = |what, expected, found| Error::WrongCount {
            what,
            expected,
            found,
        };
        if coefficients.len() != expected {
            return Err(wrong("rows of coefficients", expected, coefficients.len()));
        }
        let count = targets.len();
        if count == 0 {
            return Err(wrong("targets learned from", 1, 0));
        }
        let all = |numbers: &[T]| numbers.iter().all(|x| T::all(x.is_sane()));
        if !(all(&centre)
            && all(&scale)
            && all(&[radius])
            && coefficients.iter().all(|row| all(row))
            && targets.iter().all(|target| all(target)))
        {
            return Err(Error::NotFinite {
                what: "synergy map",
                joint: None,
            });
        }
        let most = T::of(MOST_LENGTH);
        let reachable = |target: &Vec3<T>| target.iter().all(|x| T::all(!most.lt(x.abs())));
        if !targets.iter().all(reachable) {
            return Err(Error::OutOfRange {
                what: "a synergy map's targets must be within 10 km",
                joint: None,
            });
        }
        if !scale
            .iter()
            .chain(&[radius])
            .all(|x| T::all(T::zero().lt(*x)))
        {
            return Err(Error::OutOfRange {
                what: "a synergy map's scales and radius must be above 0",
                joint: None,
            });
        }
        Ok(SynergyMap {
            model,
            centre,
            scale,
            coefficients: Vec::from_slice(coefficients)
                .map_err(|_| wrong("rows of coefficients", MOST_PARAMETERS, expected))?,
            targets: Vec::from_slice(targets)
                .map_err(|_| wrong("targets learned from, at most", MOST_TARGETS, count))?,
            radius,
        })
    }

    /// The distance from a target learned from at which the map is no longer trusted, metres.
    pub fn radius(&self) -> T {
        self.radius
    }

    /// The synergy for a reach, and how far to trust it.
    ///
    /// # Errors
    /// A target or a time that is not finite, or a time that is not above 0.
    pub fn plan(&self, reach: &Reach<T>) -> Result<Planned<T, N>, Error> {
        let finite =
            reach.target.iter().all(|x| T::all(x.is_sane())) && T::all(reach.seconds.is_sane());
        if !finite {
            return Err(Error::NotFinite {
                what: "reach",
                joint: None,
            });
        }
        if !T::all(T::zero().lt(reach.seconds)) {
            return Err(Error::OutOfRange {
                what: "a reach's time must be above 0",
                joint: None,
            });
        }
        // No arm reaches further, and no distance overflows.
        let most = T::of(MOST_LENGTH);
        let target = reach.target.map(|x| x.within(-most, most));
        let (near, away) = self.nearest(target);
        // No further than the radius from what was learned from.
        let share = T::select(self.radius.lt(away), self.radius / away, T::one());
        let mut inputs = [T::zero(); INPUTS];
        for r in 0..3 {
            inputs[r] = near[r] + (target[r] - near[r]) * share;
        }
        inputs[3] = reach.seconds;
        let mut parameters = Vec::new();
        let terms = terms(&standardised(&inputs, &self.centre, &self.scale));
        for (k, row) in self.coefficients.iter().enumerate() {
            let mut sum = T::zero();
            for (coefficient, term) in row.iter().zip(&terms) {
                sum = sum + *coefficient * *term;
            }
            let (lower, upper) = self.model.bounds(N, k);
            // There are as many as there are rows: none is left over.
            let _ = parameters.push(sum.within(T::of(lower), T::of(upper)));
        }
        let synergy = Synergy::from_parameters(self.model, &parameters)?;
        let confidence = T::one() - T::select(self.radius.lt(away), T::one(), away / self.radius);
        Ok(Planned {
            synergy,
            parameters,
            confidence,
        })
    }

    /// The nearest target that the map was learned from, and how far it is.
    fn nearest(&self, target: Vec3<T>) -> (Vec3<T>, T) {
        let mut best = (target, T::of(1e9));
        for known in &self.targets {
            let away = distance(*known, target);
            let nearer = away.lt(best.1);
            for r in 0..3 {
                best.0[r] = T::select(nearer, known[r], best.0[r]);
            }
            best.1 = T::select(nearer, away, best.1);
        }
        best
    }
}

/// The inputs, less their centre and over their scale; within ±3 of it, so that no time, however odd, is extrapolated
/// to.
pub fn standardised<T: Real>(
    inputs: &[T; INPUTS],
    centre: &[T; INPUTS],
    scale: &[T; INPUTS],
) -> [T; INPUTS] {
    let mut out = *inputs;
    for i in 0..INPUTS {
        out[i] = ((inputs[i] - centre[i]) / scale[i]).within(T::of(-3.0), T::of(3.0));
    }
    out
}

/// 1, x₁…, and the products of any two, in the order of [`SynergyMap::new`].
pub fn terms<T: Real>(x: &[T; INPUTS]) -> [T; TERMS] {
    let products = x
        .iter()
        .enumerate()
        .flat_map(|(i, &a)| x.iter().take(i + 1).map(move |&b| a * b));
    let each = x.iter().copied().chain(products);
    let mut out = [T::one(); TERMS];
    for (term, value) in out.iter_mut().skip(1).zip(each) {
        *term = value;
    }
    out
}

#[cfg(all(test, feature = "libm"))]
mod tests {
    use super::*;

    fn map(row: [f64; TERMS]) -> SynergyMap<f64, 7> {
        let targets = [[0.3, 0.0, 0.0], [0.3, 0.2, 0.0]];
        SynergyMap::new(
            Model::A,
            [0.0; INPUTS],
            [1.0; INPUTS],
            &[row],
            &targets,
            0.1,
        )
        .unwrap()
    }

    fn gain(map: &SynergyMap<f64, 7>, target: Vec3<f64>, seconds: f64) -> f64 {
        let planned = map.plan(&Reach { target, seconds }).unwrap();
        planned.synergy.apply(&[1.0; 7], 0.0)[0]
    }

    #[test]
    fn a_parameter_is_the_polynomial_of_the_reach() {
        let mut row = [0.0; TERMS];
        // 1 + 2·x − 3·t + 4·y·x: 1, x, y, z, t, xx, yx…
        (row[0], row[1], row[4], row[6]) = (1.0, 2.0, -3.0, 4.0);
        let map = map(row);
        let expected = 1.0 + 2.0 * 0.31 - 3.0 * 0.5 + 4.0 * 0.22 * 0.31;
        assert!((gain(&map, [0.31, 0.22, 0.01], 0.5) - expected).abs() < 1e-12);
        // And never leaves the bounds of a gain.
        assert_eq!(gain(&map, [0.31, 0.22, 0.01], 3.0), -5.0);
    }

    #[test]
    fn beyond_the_radius_nothing_is_extrapolated_and_nothing_jumps() {
        let mut row = [0.0; TERMS];
        row[3] = 10.0;
        let map = map(row);
        let at = |z: f64| gain(&map, [0.3, 0.0, z], 1.0);
        assert!((at(0.0999999) - at(0.1000001)).abs() < 1e-5);
        assert_eq!(at(0.2), at(50.0));
        assert_eq!(at(0.2), at(9e8));
        assert_eq!(at(0.2), at(1e29));
        assert!((at(50.0) - 1.0).abs() < 1e-12);
        let confidence = |z| {
            let reach = Reach {
                target: [0.3, 0.0, z],
                seconds: 1.0,
            };
            map.plan(&reach).unwrap().confidence
        };
        assert_eq!(confidence(0.0), 1.0);
        assert!((confidence(0.025) - 0.75).abs() < 1e-12);
        assert_eq!(confidence(7.0), 0.0);
    }

    #[test]
    fn what_is_no_map_and_no_reach_is_refused() {
        let new = |rows: &[[f64; TERMS]], targets: &[[f64; 3]], scale: f64, radius: f64| {
            SynergyMap::<f64, 7>::new(
                Model::A,
                [0.0; INPUTS],
                [scale; INPUTS],
                rows,
                targets,
                radius,
            )
        };
        let (row, target) = ([0.0; TERMS], [0.0; 3]);
        assert!(new(&[row], &[target], 1.0, 0.1).is_ok());
        assert!(new(&[], &[target], 1.0, 0.1).is_err());
        assert!(new(&[row], &[], 1.0, 0.1).is_err());
        assert!(new(&[row], &[target; MOST_TARGETS + 1], 1.0, 0.1).is_err());
        assert!(new(&[row], &[[0.0, 2e4, 0.0]], 1.0, 0.1).is_err());
        assert!(new(&[row], &[target], 0.0, 0.1).is_err());
        assert!(new(&[row], &[target], 1.0, -1.0).is_err());
        assert!(new(&[[f64::NAN; TERMS]], &[target], 1.0, 0.1).is_err());
        let map = map(row);
        for (target, seconds) in [
            ([f64::NAN, 0.0, 0.0], 1.0),
            ([0.0; 3], f64::INFINITY),
            ([0.0; 3], 0.0),
        ] {
            assert!(map.plan(&Reach { target, seconds }).is_err());
        }
    }
}
