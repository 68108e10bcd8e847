//! J⁺: ΔΘ = λ·dt · J⁺ΔX, singular values below 1e-4·σ_max dropped (SPEC section 2).
//!
//! Where J is well conditioned, J⁺ΔX = Jᵀ(JJᵀ)⁻¹ΔX is exact enough and cheap; elsewhere the singular values decide.

use super::ldl::Ldl;
use super::orthogonal::Orthogonal;
use super::{Stepper, transposed_times};
use crate::real::Real;

/// The pseudo-inverse by singular values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PseudoInverse;

impl<T: Real> Stepper<T> for PseudoInverse {
    const RATE: f64 = 10.0;

    #[inline(always)]
    fn step<const M: usize, const N: usize>(
        &self,
        j: &[[T; M]; N],
        error: &[T; M],
        gain: T,
    ) -> [T; N] {
        let normal = Ldl::new(j, T::zero());
        let mut step = transposed_times(j, &normal.solve(error));
        let good = normal.is_well_conditioned();
        if !T::all(good) {
            let exact = by_singular_values(j, error);
            for i in 0..N {
                step[i] = T::select(good, step[i], exact[i]);
            }
        }
        for i in 0..N {
            step[i] = gain * step[i];
        }
        step
    }
}

/// Σₖ vₖ·(uₖᵀΔX)/σₖ over the singular values that count.
#[inline(always)]
fn by_singular_values<T: Real, const M: usize, const N: usize>(
    j: &[[T; M]; N],
    error: &[T; M],
) -> [T; N] {
    let svd = Orthogonal::new(j, error);
    let mut weights = [T::zero(); M];
    for k in 0..M {
        let counts = svd.counts(k);
        let square = T::select(counts, svd.squares[k], T::one());
        weights[k] = T::select(counts, svd.error[k] / square, T::zero());
    }
    transposed_times(&svd.rows, &weights)
}
