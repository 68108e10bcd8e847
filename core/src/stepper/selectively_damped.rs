//! Selectively damped least squares (Buss and Kim 2005, *Selectively damped least squares for inverse kinematics*,
//! section 3; the paper's reference 20), for one end effector.
//!
//! Each singular direction's part φₖ = (uₖᵀΔX)/σₖ · vₖ is held below an angle of its own, γₖ = min(1, Nₖ/Mₖ)·γ_max.
//! Nₖ = ‖uₖ‖ = 1 is how far the tip has to go along uₖ for a unit of it, Mₖ = Σᵢ |vₖᵢ|·ρᵢ/σₖ how far the joints
//! would carry it, with ρᵢ the length of the Jacobian's column i. The sum is held below γ_max again.
//! Singular values below 1e-4·σ_max are dropped, as for J⁺. The source's other measure, to clamp ‖ΔX‖, is the caller's.

use super::Stepper;
use super::orthogonal::Orthogonal;
use crate::Error;
use crate::real::Real;
use crate::vector::dot;

/// Selectively damped least squares with its greatest angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelectivelyDamped<T> {
    /// γ_max, radians.
    most: T,
}

impl<T: Real> SelectivelyDamped<T> {
    /// With the greatest angle γ_max of O(Θ, ΔX), radians, above 0 and up to 2π.
    ///
    /// # Errors
    /// γ_max outside that range.
    pub fn new(most: T) -> Result<Self, Error> {
        if T::all(T::zero().lt(most)) && T::all(most.lt(T::of(6.3))) {
            Ok(SelectivelyDamped { most })
        } else {
            Err(Error::OutOfRange {
                what: "the greatest angle must be above 0 and up to 2π",
                joint: None,
            })
        }
    }
}

impl<T: Real> Default for SelectivelyDamped<T> {
    /// γ_max = π/4, as in the source.
    fn default() -> Self {
        SelectivelyDamped {
            most: T::of(core::f64::consts::FRAC_PI_4),
        }
    }
}

impl<T: Real> Stepper<T> for SelectivelyDamped<T> {
    const RATE: f64 = 10.0;

    #[inline(always)]
    fn step<const M: usize, const N: usize>(
        &self,
        j: &[[T; M]; N],
        error: &[T; M],
        gain: T,
    ) -> [T; N] {
        let svd = Orthogonal::new(j, error);
        let mut reach = [T::zero(); N];
        for i in 0..N {
            reach[i] = dot(&j[i], &j[i]).sqrt();
        }
        let mut step = [T::zero(); N];
        for k in 0..M {
            let counts = svd.counts(k);
            let square = T::select(counts, svd.squares[k], T::one());
            let along = T::select(counts, svd.error[k] / square, T::zero());
            // rows = σ·v, so Σ|v|·ρ/σ = Σ|rows|·ρ/σ².
            let mut carried = T::zero();
            for i in 0..N {
                let part = svd.rows[i][k].abs() * reach[i];
                carried = if i == 0 { part } else { carried + part };
            }
            let carried = T::select(counts, carried / square, T::one());
            let most = (T::one() / carried).least(T::one()) * self.most;
            let mut part = [T::zero(); N];
            for i in 0..N {
                part[i] = along * svd.rows[i][k];
            }
            let part = held_below(part, most);
            for i in 0..N {
                step[i] = step[i] + part[i];
            }
        }
        let mut step = held_below(step, self.most);
        for i in 0..N {
            step[i] = gain * step[i];
        }
        step
    }
}

/// A vector made shorter, where need be, so that its largest element is `most`.
#[inline(always)]
fn held_below<T: Real, const N: usize>(mut v: [T; N], most: T) -> [T; N] {
    let mut largest = T::zero();
    for i in 0..N {
        largest = v[i].abs().most(largest);
    }
    let over = most.lt(largest);
    let scale = T::select(over, most / T::select(over, largest, T::one()), T::one());
    for i in 0..N {
        v[i] = scale * v[i];
    }
    v
}
