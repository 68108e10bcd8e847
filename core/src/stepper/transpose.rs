//! Jᵀ: ΔΘ = λ·dt · Jᵀ ΔX (Wolovich and Elliott 1984): steepest descent of the distance.

use super::{Stepper, transposed_times};
use crate::real::Real;

/// The Jacobian's transpose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Transpose;

impl<T: Real> Stepper<T> for Transpose {
    const RATE: f64 = 100.0;

    #[inline(always)]
    fn step<const M: usize, const N: usize>(
        &self,
        j: &[[T; M]; N],
        error: &[T; M],
        gain: T,
    ) -> [T; N] {
        let mut step = transposed_times(j, error);
        for i in 0..N {
            step[i] = gain * step[i];
        }
        step
    }
}
