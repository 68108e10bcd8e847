//! Damped least squares: ΔΘ = λ·dt · Jᵀ(JJᵀ + μ²I)⁻¹ΔX (SPEC section 2; Wampler 1986, Nakamura and Hanafusa 1986).

use super::ldl::Ldl;
use super::{Stepper, transposed_times};
use crate::Error;
use crate::real::Real;

/// Damped least squares with its damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damped<T> {
    /// μ².
    square: T,
}

impl<T: Real> Damped<T> {
    /// With damping μ (metres), from 1e-3 to 1e3: large against the singular values it is Jᵀ, small it is J⁺.
    ///
    /// The squares of the singular values are rounded to the greatest of them: near a singularity, in `f32`, steps are wrong
    /// by per cents where μ is below a hundredth of the arm's length, and below a thousandth by as much as they are long.
    /// Such a μ (the default is, for an arm of 5 m) is for `f64`; J⁺ has no such bound.
    ///
    /// # Errors
    /// μ outside that range.
    pub fn new(mu: T) -> Result<Self, Error> {
        if T::all(mu.lt(T::of(1.001e3))) && T::all(T::of(0.999e-3).lt(mu)) {
            Ok(Damped { square: mu * mu })
        } else {
            Err(Error::OutOfRange {
                what: "the damping must be from 0.001 to 1000",
                joint: None,
            })
        }
    }
}

impl<T: Real> Default for Damped<T> {
    /// μ = 0.05 m: a tenth of a human arm's singular values away from its singularities.
    fn default() -> Self {
        Damped {
            square: T::of(0.05 * 0.05),
        }
    }
}

impl<T: Real> Stepper<T> for Damped<T> {
    const RATE: f64 = 10.0;

    #[inline(always)]
    fn step<const M: usize, const N: usize>(
        &self,
        j: &[[T; M]; N],
        error: &[T; M],
        gain: T,
    ) -> [T; N] {
        let y = Ldl::new(j, self.square).solve(error);
        let mut step = transposed_times(j, &y);
        for i in 0..N {
            step[i] = gain * step[i];
        }
        step
    }
}
