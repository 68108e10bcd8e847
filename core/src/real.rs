//! The scalar that everything here is written for.
//!
//! [`Real`] is implemented for `f32` (microcontroller and host) and `f64` (host), and can be implemented for SIMD
//! lanes of `f32` outside this crate. It asks for little: the four operations, a square root, comparisons that give
//! a mask, and a select. Code written with it has no branch on a value, so that lanes, GPU threads and scalars run
//! the same operations in the same order and give the same bits.

use core::fmt::Debug;
use core::ops::{Add, BitAnd, BitOr, Div, Mul, Neg, Not, Sub};

/// When a chain's sines and cosines are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turns {
    /// Each where it is used: a microcontroller has them in registers then.
    WhereUsed,
    /// All at once: a large processor runs through all of them before it has the first.
    AtOnce,
    /// All at once, in blocks that a compiler makes lanes of.
    InBlocks,
}

/// A real number, or several side by side.
///
/// ```
/// use sinew::real::Real;
/// fn hypotenuse<T: Real>(a: T, b: T) -> T {
///     (a * a + b * b).sqrt()
/// }
/// assert_eq!(hypotenuse(3.0f32, 4.0), 5.0);
/// assert_eq!(hypotenuse(3.0f64, 4.0), 5.0);
/// ```
pub trait Real:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + 'static
{
    /// The answer of a comparison: `bool`, or one bit a lane.
    type Mask: Copy
        + BitAnd<Output = Self::Mask>
        + BitOr<Output = Self::Mask>
        + Not<Output = Self::Mask>;

    /// The distance from 1 to the next number.
    const EPSILON: f64;

    /// How a chain's sines and cosines are had fastest. It changes no bit.
    const TURNS: Turns = Turns::WhereUsed;

    /// The nearest number to `x` (in every lane).
    fn of(x: f64) -> Self;

    /// A count as a number (in every lane); exact up to 2²⁴.
    fn count(n: u32) -> Self;

    /// `self < other`; false where either is NaN.
    fn lt(self, other: Self) -> Self::Mask;

    /// `yes` where the mask is set, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// Whether the mask is set anywhere.
    fn any(mask: Self::Mask) -> bool;

    /// Whether the mask is set everywhere.
    #[inline(always)]
    fn all(mask: Self::Mask) -> bool {
        !Self::any(!mask)
    }

    /// The magnitude.
    fn abs(self) -> Self;

    /// The square root, correctly rounded (with `micromath` alone to the last bits); NaN below 0.
    fn sqrt(self) -> Self;

    /// Sine and cosine of an angle in radians. Finite whatever the argument: see [`crate::math`].
    fn sin_cos(self) -> (Self, Self);

    /// [`sin_cos`](Self::sin_cos), the same bits, of an angle that is known to lie within
    /// ±[`MOST_ANGLE`](crate::math::MOST_ANGLE).
    #[inline(always)]
    fn sin_cos_within(self) -> (Self, Self) {
        self.sin_cos()
    }

    /// The exponential, saturated so that it is positive, normal and finite: see [`crate::math`].
    fn exp(self) -> Self;

    /// The angle of the point (x, y) = (`x`, `self`), in radians. Not on the hot path.
    fn atan2(self, x: Self) -> Self;

    /// Zero.
    #[inline(always)]
    fn zero() -> Self {
        Self::of(0.0)
    }

    /// One.
    #[inline(always)]
    fn one() -> Self {
        Self::of(1.0)
    }

    /// The smaller; `other` where `self` is NaN.
    #[inline(always)]
    fn least(self, other: Self) -> Self {
        Self::select(self.lt(other), self, other)
    }

    /// The greater; `other` where `self` is NaN.
    #[inline(always)]
    fn most(self, other: Self) -> Self {
        Self::select(other.lt(self), self, other)
    }

    /// `self` moved into [`lo`, `hi`]; `lo` where it is NaN.
    #[inline(always)]
    fn within(self, lo: Self, hi: Self) -> Self {
        self.most(lo).least(hi)
    }

    /// Whether it is a number: not NaN, not infinite.
    #[inline(always)]
    fn is_finite(self) -> Self::Mask {
        (self * Self::zero()).abs().lt(Self::one())
    }

    /// Whether the magnitude is below 1e30 (false for NaN): far beyond every quantity of an arm, and small enough for
    /// a sum of a few to be finite.
    #[inline(always)]
    fn is_sane(self) -> Self::Mask {
        self.abs().lt(Self::of(1e30))
    }
}

impl Real for f32 {
    type Mask = bool;
    const EPSILON: f64 = f32::EPSILON as f64;

    #[inline(always)]
    fn of(x: f64) -> Self {
        x as f32
    }
    #[inline(always)]
    fn count(n: u32) -> Self {
        n as f32
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn any(mask: bool) -> bool {
        mask
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f32::from_bits(self.to_bits() & 0x7fff_ffff)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        #[cfg(feature = "libm")]
        return libm::sqrtf(self);
        #[cfg(not(feature = "libm"))]
        {
            if self == 0.0 || self == f32::INFINITY {
                return self;
            }
            // A first guess, wrong by 6 %; each of Newton's steps squares that.
            let guess = micromath::F32(self).sqrt().0;
            (0..3).fold(guess, |root, _| 0.5 * (root + self / root))
        }
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        crate::math::sin_cos(self)
    }
    #[cfg(not(feature = "micromath"))]
    #[inline(always)]
    fn sin_cos_within(self) -> (Self, Self) {
        crate::math::sin_cos_within_of(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        crate::math::exp(self)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        #[cfg(feature = "libm")]
        return libm::atan2f(self, x);
        #[cfg(not(feature = "libm"))]
        return micromath::F32(self).atan2(micromath::F32(x)).0;
    }
}

#[cfg(feature = "libm")]
impl Real for f64 {
    type Mask = bool;
    const EPSILON: f64 = f64::EPSILON;
    const TURNS: Turns = Turns::InBlocks;

    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn count(n: u32) -> Self {
        f64::from(n)
    }
    #[inline(always)]
    fn lt(self, other: Self) -> bool {
        self < other
    }
    #[inline(always)]
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    #[inline(always)]
    fn any(mask: bool) -> bool {
        mask
    }
    #[inline(always)]
    fn abs(self) -> Self {
        libm::fabs(self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        libm::sqrt(self)
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        crate::math::sin_cos_f64(self)
    }
    #[inline(always)]
    fn sin_cos_within(self) -> (Self, Self) {
        crate::math::sin_cos_within_f64_of(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        crate::math::exp_f64(self)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        libm::atan2(self, x)
    }
}

#[cfg(all(test, not(feature = "libm")))]
mod tests {
    use super::*;

    #[test]
    fn a_root_without_libm_is_one_to_the_last_bits() {
        let mut x = 1e-30f32;
        while x < 1e30 {
            let root = Real::sqrt(x);
            assert!(
                (root * root - x).abs() <= 4.0 * f32::EPSILON * x,
                "{x}: {root}"
            );
            x *= 1.37;
        }
        assert_eq!(Real::sqrt(0.0f32), 0.0);
    }
}
