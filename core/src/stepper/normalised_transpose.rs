//! NJᵀ: ΔΘ = λ·dt · JᵀΔX/‖JᵀΔX‖, and 0 where the norm is 0 (SPEC section 2).
//!
//! The step never passes the point along this direction that minimises ‖ΔX − J·δ‖: with d = JᵀΔX that is α·d,
//! α = ⟨ΔX, J·d⟩/‖J·d‖² (Buss 2004, *Introduction to inverse kinematics*, section 3), and ⟨ΔX, J·d⟩ = ‖d‖². This holds
//! before the synergy: a gain above 1 carries the tick further.

use super::{Stepper, transposed_times};
use crate::real::Real;
use crate::vector::dot;

/// The Jacobian's transpose at constant joint speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct NormalisedTranspose;

/// Directions shorter than this (squared) are no direction.
pub(super) const LEAST_SQUARE: f64 = 1e-30;

impl<T: Real> Stepper<T> for NormalisedTranspose {
    const RATE: f64 = 10.0;

    #[inline(always)]
    fn step<const M: usize, const N: usize>(
        &self,
        j: &[[T; M]; N],
        error: &[T; M],
        gain: T,
    ) -> [T; N] {
        let mut d = transposed_times(j, error);
        let square = dot(&d, &d);
        let mut moved = [T::zero(); M];
        for r in 0..M {
            for i in 0..N {
                let part = j[i][r] * d[i];
                moved[r] = if i == 0 { part } else { moved[r] + part };
            }
        }
        let alpha = square / dot(&moved, &moved);
        let scale = (gain / square.sqrt()).least(alpha);
        let scale = T::select(T::of(LEAST_SQUARE).lt(square), scale, T::zero());
        for i in 0..N {
            d[i] = scale * d[i];
        }
        d
    }
}
