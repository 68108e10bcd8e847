//! One step of inverse kinematics: ΔΘ = λ·dt · O(Θ, ΔX) (SPEC section 2), by five methods.

mod damped;
mod ldl;
mod normalised_transpose;
mod orthogonal;
mod pseudo_inverse;
mod selectively_damped;
mod transpose;

pub use damped::Damped;
pub use normalised_transpose::NormalisedTranspose;
pub use pseudo_inverse::PseudoInverse;
pub use selectively_damped::SelectivelyDamped;
pub use transpose::Transpose;

use crate::real::Real;
use crate::vector::dot;

/// A method of inverse kinematics.
pub trait Stepper<T: Real> {
    /// The SPEC's default rate λ: 1/(m²·s) for Jᵀ, rad/s for NJᵀ, 1/s for the rest.
    const RATE: f64;

    /// ΔΘ, radians or metres, from the Jacobian's columns (M rows), the error ΔX, and `gain` = λ·dt.
    fn step<const M: usize, const N: usize>(
        &self,
        jacobian: &[[T; M]; N],
        error: &[T; M],
        gain: T,
    ) -> [T; N];
}

/// Jᵀ·v.
#[inline(always)]
fn transposed_times<T: Real, const M: usize, const N: usize>(
    j: &[[T; M]; N],
    v: &[T; M],
) -> [T; N] {
    let mut out = [T::zero(); N];
    for i in 0..N {
        out[i] = dot(&j[i], v);
    }
    out
}

/// The five methods behind one type, for who chooses when the program runs. In firmware name the one you use, and
/// the others take no flash.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AnyStepper<T> {
    /// Jᵀ.
    Transpose(Transpose),
    /// NJᵀ.
    NormalisedTranspose(NormalisedTranspose),
    /// J⁺.
    PseudoInverse(PseudoInverse),
    /// Damped least squares.
    Damped(Damped<T>),
    /// Selectively damped least squares.
    SelectivelyDamped(SelectivelyDamped<T>),
}

impl<T: Real> Stepper<T> for AnyStepper<T> {
    /// That of the pseudo-inverse; [`AnyStepper::rate`] is the one of the method chosen.
    const RATE: f64 = 10.0;

    #[inline(always)]
    fn step<const M: usize, const N: usize>(
        &self,
        j: &[[T; M]; N],
        error: &[T; M],
        gain: T,
    ) -> [T; N] {
        match self {
            AnyStepper::Transpose(s) => s.step(j, error, gain),
            AnyStepper::NormalisedTranspose(s) => s.step(j, error, gain),
            AnyStepper::PseudoInverse(s) => s.step(j, error, gain),
            AnyStepper::Damped(s) => s.step(j, error, gain),
            AnyStepper::SelectivelyDamped(s) => s.step(j, error, gain),
        }
    }
}

impl<T: Real> AnyStepper<T> {
    /// The SPEC's default rate λ of the method chosen.
    pub fn rate(&self) -> f64 {
        match self {
            AnyStepper::Transpose(_) => <Transpose as Stepper<T>>::RATE,
            AnyStepper::NormalisedTranspose(_) => <NormalisedTranspose as Stepper<T>>::RATE,
            AnyStepper::PseudoInverse(_) => <PseudoInverse as Stepper<T>>::RATE,
            AnyStepper::Damped(_) => <Damped<T> as Stepper<T>>::RATE,
            AnyStepper::SelectivelyDamped(_) => <SelectivelyDamped<T> as Stepper<T>>::RATE,
        }
    }
}
