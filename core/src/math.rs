//! sin, cos and exp: the hot path of a control tick.
//!
//! The same few operations on a microcontroller, a host, SIMD lanes and a GPU, so that all agree: a range reduction
//! by a constant in two or three parts (Cody and Waite 1980), then a polynomial (the coefficients of S. Moshier's
//! Cephes, `sinf.c` and `expf.c`, for `f64` `sin.c` and `exp.c`). No fused multiply-add, no table, no branch.
//!
//! | function | scalar | range | worst error |
//! |---|---|---|---|
//! | [`sin_cos`] | `f32` | ±10 rad | 8e-8 absolute |
//! | [`sin_cos`] | `f32` | ±[`MOST_ANGLE`] | 8e-8 absolute |
//! | [`exp`] | `f32` | ±87 | 1.2e-7 relative |
//! | [`sin_cos_f64`] | `f64` | ±[`MOST_ANGLE`] | 1.7e-16 absolute |
//! | [`exp_f64`] | `f64` | ±87 | 4.5e-16 relative |
//!
//! Every `f32` of the range was tried, but nearer to 0 than 1e-4 only each thousandth; of `f64` ten million numbers
//! spread over the range, and those about where the reduction goes from one whole number to the next. Their error is
//! the greatest difference from `libm`, 1.2e-16 and 3.4e-16, and what `libm` itself may be wrong by.
//!
//! Outside its range an argument is moved to the range's end, and NaN to its lower end: the result is finite always.
//! With the `micromath` feature the two for `f32` come from that crate: smaller, and wrong by up to 3e-3.

use crate::real::Real;

/// Angles beyond this magnitude, in radians, are taken as this one.
pub const MOST_ANGLE: f64 = 8192.0;
/// Exponents below this are taken as this one.
pub const LEAST_EXPONENT: f64 = -87.0;
/// Exponents above this are taken as this one.
pub const MOST_EXPONENT: f64 = 88.0;

/// What sine, cosine and exponential ask of a number beyond [`Real`]: the whole number that a value lies nearest to, and
/// its bits.
pub trait Whole: Real {
    /// A whole number's bits, of which the last are those of an integer.
    type Bits: Copy;
    /// The nearest whole number, halves to even. |`self`| is below 2²² (`f64`: 2⁵¹).
    fn whole(self) -> (Self, Self::Bits);
    /// Sine and cosine of k·π/2 + r, from those of r.
    fn quarter(k: Self::Bits, sin_cos: (Self, Self)) -> (Self, Self);
    /// 2ᵏ of k in [−126, 127] (`f64`: [−1022, 1023]).
    fn power_of_two(k: Self::Bits) -> Self;
}

/// Adding this to a small `f32` leaves no bits for a fraction: the sum is rounded to a whole number.
const SHIFTER: f32 = 12_582_912.0; // 1.5 · 2²³

impl Whole for f32 {
    type Bits = u32;
    #[inline(always)]
    fn whole(self) -> (f32, u32) {
        let shifted = self + SHIFTER;
        (shifted - SHIFTER, shifted.to_bits())
    }
    #[inline(always)]
    fn quarter(k: u32, (s, c): (f32, f32)) -> (f32, f32) {
        let (odd, half) = (k & 1 != 0, k & 2 != 0);
        // k mod 4:   0       1        2        3
        // sin, cos:  s, c    c, -s    -s, -c   -c, s
        let (sin, cos) = if odd { (c, -s) } else { (s, c) };
        if half { (-sin, -cos) } else { (sin, cos) }
    }
    #[inline(always)]
    fn power_of_two(k: u32) -> f32 {
        f32::from_bits(k.wrapping_add(127) << 23)
    }
}

/// Sine and cosine of `x` radians, both from one range reduction.
///
/// x = k·π/2 + r with k whole and |r| ≤ π/4, and two polynomials in r; k mod 4 says which is which and its sign.
///
/// ```
/// let (s, c) = sinew::math::sin_cos(core::f32::consts::FRAC_PI_6);
/// assert!((s - 0.5).abs() < 1e-6 && (c - 0.75f32.sqrt()).abs() < 1e-6);
/// ```
#[inline(always)]
pub fn sin_cos(x: f32) -> (f32, f32) {
    #[cfg(not(feature = "micromath"))]
    return sin_cos_of(x);
    #[cfg(feature = "micromath")]
    {
        let x = micromath::F32(x.within(-MOST_ANGLE as f32, MOST_ANGLE as f32));
        (x.sin().0, x.cos().0)
    }
}

/// The exponential of `x`.
///
/// x = k·ln 2 + r with k whole and |r| ≤ ln 2 / 2; eˣ = 2ᵏ·eʳ, the latter a polynomial.
///
/// ```
/// assert!((sinew::math::exp(1.0) - core::f32::consts::E).abs() < 1e-6);
/// assert!(sinew::math::exp(f32::INFINITY).is_finite());
/// ```
#[inline(always)]
pub fn exp(x: f32) -> f32 {
    #[cfg(not(feature = "micromath"))]
    return exp_of(x);
    #[cfg(feature = "micromath")]
    return micromath::F32(x.within(LEAST_EXPONENT as f32, MOST_EXPONENT as f32))
        .exp()
        .0;
}

/// [`sin_cos`] for anything that behaves as `f32`: lanes too.
#[inline(always)]
pub fn sin_cos_of<T: Whole>(x: T) -> (T, T) {
    sin_cos_within_of(x.within(T::of(-MOST_ANGLE), T::of(MOST_ANGLE)))
}

/// [`sin_cos_of`] for what is known to lie within ±[`MOST_ANGLE`]: a seventh of it is saved.
#[inline(always)]
pub fn sin_cos_within_of<T: Whole>(x: T) -> (T, T) {
    let (k, bits) = (x * T::of(core::f64::consts::FRAC_2_PI)).whole();
    let r = x - k * T::of(1.5703125);
    let r = r - k * T::of(4.837_512_969_970_703e-4);
    let r = r - k * T::of(7.549_789_948_768_648e-8);
    let rr = r * r;
    let s = ((T::of(-1.951_529_589_1e-4) * rr + T::of(8.332_160_873_6e-3)) * rr
        + T::of(-1.666_665_461_1e-1))
        * rr
        * r
        + r;
    let c = ((T::of(2.443_315_711_809_948e-5) * rr + T::of(-1.388_731_625_493_765e-3)) * rr
        + T::of(4.166_664_568_298_827e-2))
        * rr
        * rr
        - T::of(0.5) * rr
        + T::one();
    T::quarter(bits, (s, c))
}

/// [`exp`] for anything that behaves as `f32`: lanes too.
#[inline(always)]
pub fn exp_of<T: Whole>(x: T) -> T {
    let x = x.within(T::of(LEAST_EXPONENT), T::of(MOST_EXPONENT));
    let (k, bits) = (x * T::of(core::f64::consts::LOG2_E)).whole();
    let r = x - k * T::of(0.693_359_375);
    let r = r - k * T::of(-2.121_944_4e-4);
    let p = T::of(1.987_569_15e-4) * r + T::of(1.398_199_950_7e-3);
    let p = p * r + T::of(8.333_451_907_3e-3);
    let p = p * r + T::of(4.166_579_589_4e-2);
    let p = p * r + T::of(1.666_666_545_9e-1);
    let p = p * r + T::of(5.000_000_120_1e-1);
    (p * (r * r) + r + T::one()) * T::power_of_two(bits)
}

/// As [`SHIFTER`], for `f64`.
#[cfg(feature = "libm")]
const SHIFTER_F64: f64 = 6_755_399_441_055_744.0; // 1.5 · 2⁵²

#[cfg(feature = "libm")]
impl Whole for f64 {
    type Bits = u64;
    #[inline(always)]
    fn whole(self) -> (f64, u64) {
        let shifted = self + SHIFTER_F64;
        (shifted - SHIFTER_F64, shifted.to_bits())
    }
    /// On the bits: a choice between two numbers would be a branch, and a loop over joints would not become one over
    /// lanes.
    #[inline(always)]
    fn quarter(k: u64, (s, c): (f64, f64)) -> (f64, f64) {
        let (s, c) = (s.to_bits(), c.to_bits());
        let exchanged = (s ^ c) & 0u64.wrapping_sub(k & 1);
        let sin = (s ^ exchanged) ^ ((k & 2) << 62);
        let cos = (c ^ exchanged) ^ ((k.wrapping_add(1) & 2) << 62);
        (f64::from_bits(sin), f64::from_bits(cos))
    }
    #[inline(always)]
    fn power_of_two(k: u64) -> f64 {
        f64::from_bits(k.wrapping_add(1023) << 52)
    }
}

/// [`sin_cos`] for `f64`.
///
/// ```
/// let (s, c) = sinew::math::sin_cos_f64(core::f64::consts::FRAC_PI_6);
/// assert!((s - 0.5).abs() < 1e-15 && (c - 0.75f64.sqrt()).abs() < 1e-15);
/// ```
#[cfg(feature = "libm")]
#[inline(always)]
pub fn sin_cos_f64(x: f64) -> (f64, f64) {
    sin_cos_f64_of(x)
}

/// The exponential of `x` for `f64`.
///
/// ```
/// assert!((sinew::math::exp_f64(1.0) - core::f64::consts::E).abs() < 1e-15);
/// assert!(sinew::math::exp_f64(f64::INFINITY).is_finite());
/// ```
#[cfg(feature = "libm")]
#[inline(always)]
pub fn exp_f64(x: f64) -> f64 {
    exp_f64_of(x)
}

/// [`sin_cos_f64`] for anything that behaves as `f64`: lanes too.
#[cfg(feature = "libm")]
#[inline(always)]
pub fn sin_cos_f64_of<T: Whole>(x: T) -> (T, T) {
    sin_cos_within_f64_of(x.within(T::of(-MOST_ANGLE), T::of(MOST_ANGLE)))
}

/// [`sin_cos_f64_of`] for what is known to lie within ±[`MOST_ANGLE`].
///
/// π/2 is split once: k has 13 bits at most, so that its product with a part of 40 bits is exact, and so is the
/// difference.
#[cfg(feature = "libm")]
#[inline(always)]
pub fn sin_cos_within_f64_of<T: Whole>(x: T) -> (T, T) {
    let (k, bits) = (x * T::of(core::f64::consts::FRAC_2_PI)).whole();
    let r = x - k * T::of(1.570_796_326_794_152_3); // π/2 to 40 bits
    let r = r - k * T::of(7.443_547_480_486_623e-13); // the rest of it
    let rr = r * r;
    let p = T::of(1.589_623_015_765_465_6e-10) * rr - T::of(2.505_074_776_285_780_7e-8);
    let p = p * rr + T::of(2.755_731_362_138_572_2e-6);
    let p = p * rr - T::of(1.984_126_982_958_954e-4);
    let p = p * rr + T::of(8.333_333_333_322_118e-3);
    let p = p * rr - T::of(1.666_666_666_666_663e-1);
    let s = p * rr * r + r;
    let p = T::of(-1.135_853_652_138_768_2e-11) * rr + T::of(2.087_570_084_197_473e-9);
    let p = p * rr - T::of(2.755_731_417_929_674e-7);
    let p = p * rr + T::of(2.480_158_728_885_170_4e-5);
    let p = p * rr - T::of(1.388_888_888_887_305_6e-3);
    let p = p * rr + T::of(4.166_666_666_666_659_5e-2);
    let c = p * rr * rr - T::of(0.5) * rr + T::one();
    T::quarter(bits, (s, c))
}

/// [`exp_f64`] for anything that behaves as `f64`: 2ᵏ·eʳ, with eʳ = 1 + 2u/(v − u), u and v polynomials.
#[cfg(feature = "libm")]
#[inline(always)]
pub fn exp_f64_of<T: Whole>(x: T) -> T {
    let x = x.within(T::of(LEAST_EXPONENT), T::of(MOST_EXPONENT));
    let (k, bits) = (x * T::of(core::f64::consts::LOG2_E)).whole();
    let r = x - k * T::of(0.693_145_751_953_125);
    let r = r - k * T::of(1.428_606_820_309_417_3e-6);
    let rr = r * r;
    let u = (T::of(1.261_771_930_748_105_8e-4) * rr + T::of(3.029_944_077_074_419_5e-2)) * rr;
    let u = (u + T::one()) * r;
    let v = (T::of(3.001_985_051_386_644_6e-6) * rr + T::of(2.524_483_403_496_841e-3)) * rr;
    let v = (v + T::of(2.272_655_482_081_550_3e-1)) * rr + T::of(2.0);
    (T::one() + T::of(2.0) * (u / (v - u))) * T::power_of_two(bits)
}

#[cfg(all(test, feature = "libm"))]
mod tests {
    use super::*;
    use std::println;

    /// Every `f32` with a magnitude from 1e-4 to `most`, both signs, and every thousandth nearer to 0 (where sin x is x
    /// and the other two are 1 to the last bits). A debug build takes one in 257.
    fn each(most: f32, mut check: impl FnMut(f32)) {
        let stride = if cfg!(debug_assertions) { 257 } else { 1 };
        let first = 1e-4f32.to_bits();
        for bits in (first..=most.to_bits())
            .step_by(stride)
            .chain((0..first).step_by(1009))
        {
            check(f32::from_bits(bits));
            check(-f32::from_bits(bits));
        }
    }

    fn worst_of_sin_cos(most: f64) -> f64 {
        let mut worst = 0.0f64;
        each(most as f32, |x| {
            let (s, c) = sin_cos(x);
            let (exact_s, exact_c) = libm::sincos(f64::from(x));
            worst = worst
                .max((f64::from(s) - exact_s).abs())
                .max((f64::from(c) - exact_c).abs());
        });
        println!("sin_cos, worst error up to {most}: {worst:e}");
        worst
    }

    #[test]
    #[cfg(feature = "micromath")]
    fn micromath_is_as_wrong_as_documented() {
        let worst = worst_of_sin_cos(10.0);
        assert!(worst < 2e-3 && worst > 1e-4);
        assert!(worst_of_exp(20.0) < 3e-3);
    }

    #[test]
    #[cfg(not(feature = "micromath"))]
    fn the_worst_error_of_sin_and_cos_is_as_documented() {
        assert!(worst_of_sin_cos(10.0) < 8e-8);
        assert!(worst_of_sin_cos(MOST_ANGLE) < 8e-8);
    }

    /// Ten million `f64` spread evenly over ±`most`, and those about the odd multiples of `seam`/2, where the reduction
    /// goes from one whole number to the next. A debug build takes one in 257.
    fn each_f64(most: f64, seam: f64, mut check: impl FnMut(f64)) {
        let count = if cfg!(debug_assertions) {
            38_911
        } else {
            10_000_000
        };
        for i in 0..=count {
            check(most * (2.0 * (f64::from(i) / f64::from(count)) - 1.0));
        }
        let mut at = seam / 2.0;
        while at < most {
            for step in -20i32..=20 {
                let x = at * (1.0 + f64::from(step) * f64::EPSILON);
                check(x);
                check(-x);
            }
            at += seam;
        }
    }

    #[test]
    fn the_worst_errors_of_the_f64_pair_are_as_documented() {
        for most in [0.8, 10.0, MOST_ANGLE] {
            let mut worst = 0.0f64;
            each_f64(most, core::f64::consts::FRAC_PI_2, |x| {
                let (s, c) = sin_cos_f64(x);
                let (exact_s, exact_c) = libm::sincos(x);
                worst = worst.max((s - exact_s).abs()).max((c - exact_c).abs());
            });
            println!("sin_cos_f64, worst difference from libm up to {most}: {worst:e}");
            assert!(worst < 1.2e-16);
        }
        let mut worst = 0.0f64;
        each_f64(-LEAST_EXPONENT, core::f64::consts::LN_2, |x| {
            let exact = libm::exp(x);
            worst = worst.max(((exp_f64(x) - exact) / exact).abs());
        });
        println!("exp_f64, worst relative difference from libm: {worst:e}");
        assert!(worst < 3.4e-16);
    }

    fn worst_of_exp(most: f64) -> f64 {
        let mut worst = 0.0f64;
        each(most as f32, |x| {
            let exact = libm::exp(f64::from(x));
            worst = worst.max(((f64::from(exp(x)) - exact) / exact).abs());
        });
        println!("exp, worst relative error up to {most}: {worst:e}");
        worst
    }

    #[test]
    #[cfg(not(feature = "micromath"))]
    fn the_worst_error_of_exp_is_as_documented() {
        assert!(worst_of_exp(-LEAST_EXPONENT) < 1.2e-7);
    }

    #[test]
    fn what_lies_outside_the_range_stays_finite() {
        for x in [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            1e30,
            -1e30,
            f32::MAX,
            8193.0,
            1e-45,
        ] {
            let (s, c) = sin_cos(x);
            let most = if cfg!(feature = "micromath") {
                1.01
            } else {
                1.0
            };
            assert!(s.abs() <= most && c.abs() <= most, "{x}: {s} {c}");
            assert!(exp(x).is_finite() && exp(x) > 0.0, "{x}");
            let x = f64::from(x);
            let (s, c) = sin_cos_f64(x);
            assert!(s.abs() <= 1.0 && c.abs() <= 1.0, "{x}: {s} {c}");
            assert!(exp_f64(x).is_finite() && exp_f64(x) > 0.0, "{x}");
        }
    }
}
