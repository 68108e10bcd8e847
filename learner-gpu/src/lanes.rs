//! SIMD lanes as a [`Real`], of `f32` and of `f64`: the core's own source, run for several members of a population at once.
//!
//! `fearless_simd` has the registers and chooses the widest the machine has when the program runs. Every lane does
//! what the scalar does, bit for bit: nothing here is approximate and nothing is fused.
//!
//! One register is one scalar. Two of them as one, to hide an operation's latency behind the other's, gain nothing (AVX-512:
//! 3 % less): the processor finds enough to do in one.

use std::ops::{Add, Div, Mul, Neg, Sub};

use fearless_simd::{Bytes, Level, Select, Simd, SimdBase, SimdFloat, SimdMask};
use sinew::math::{
    Whole, exp_f64_of, exp_of, sin_cos_f64_of, sin_cos_of, sin_cos_within_f64_of, sin_cos_within_of,
};
use sinew::real::{Real, Turns};

/// A level of SIMD instructions whose proof of presence can be had again where it was given once.
pub trait Instructions: Simd {
    /// The proof.
    ///
    /// [`Lanes`] needs one to make a constant, where it has no other value at hand to take it from. Only code inside
    /// `dispatch!` names a type with a level, and that has checked the machine.
    fn proof() -> Self;
}

macro_rules! instructions {
    ($($level:ident),*) => {$(
        impl Instructions for fearless_simd::$level {
            #[inline(always)]
            fn proof() -> Self {
                // SAFETY: as the trait says, no code names this type before the machine was found to have the level.
                unsafe { Self::assume_supported() }
            }
        }
    )*};
}

#[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
instructions!(Avx512, Avx2, Sse2);
#[cfg(target_arch = "aarch64")]
instructions!(Neon);

/// Lanes of either precision.
pub trait SideBySide: Real {
    /// What is in one.
    type Number: Copy + Default + From<f32> + Into<f64>;
    /// How many there are.
    const COUNT: usize;
    /// The first [`COUNT`](Self::COUNT) numbers of a slice, which has as many.
    fn load(values: &[Self::Number]) -> Self;
    /// The numbers, into a slice of as many.
    fn store(self, values: &mut [Self::Number]);
}

macro_rules! lanes {
    (
        $(#[$doc:meta])* $name:ident: $vector:ident of $scalar:ident, masks $mask:ident,
        $sin_cos:ident, $sin_cos_within:ident, $exp:ident
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $name<S: Simd>(S::$vector);

        impl<S: Instructions> $name<S> {
            /// The same number in each.
            #[inline(always)]
            pub fn splat(value: $scalar) -> Self {
                $name(S::$vector::splat(S::proof(), value))
            }
        }

        impl<S: Instructions> SideBySide for $name<S> {
            type Number = $scalar;
            const COUNT: usize = <S::$vector as SimdBase<S>>::LEN;
            #[inline(always)]
            fn load(values: &[$scalar]) -> Self {
                $name(S::$vector::from_slice(S::proof(), values))
            }
            #[inline(always)]
            fn store(self, values: &mut [$scalar]) {
                self.0.store_slice(values);
            }
        }

        lanes!(operators $name Add add, Sub sub, Mul mul, Div div);

        impl<S: Simd> Neg for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                $name(-self.0)
            }
        }

        impl<S: Instructions> Real for $name<S> {
            type Mask = S::$mask;
            const EPSILON: f64 = $scalar::EPSILON as f64;
            const TURNS: Turns = Turns::AtOnce;

            #[inline(always)]
            fn of(x: f64) -> Self {
                Self::splat(x as $scalar)
            }
            #[inline(always)]
            fn count(n: u32) -> Self {
                Self::splat(n as $scalar)
            }
            #[inline(always)]
            fn lt(self, other: Self) -> Self::Mask {
                self.0.simd_lt(other.0)
            }
            #[inline(always)]
            fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
                $name(mask.select(yes.0, no.0))
            }
            #[inline(always)]
            fn any(mask: Self::Mask) -> bool {
                mask.any_true()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $name(self.0.abs())
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                $name(self.0.sqrt())
            }
            #[inline(always)]
            fn sin_cos(self) -> (Self, Self) {
                $sin_cos(self)
            }
            #[inline(always)]
            fn sin_cos_within(self) -> (Self, Self) {
                $sin_cos_within(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                $exp(self)
            }
            fn atan2(self, x: Self) -> Self {
                $name(S::$vector::from_fn(S::proof(), |lane| {
                    Real::atan2(self.0[lane], x.0[lane])
                }))
            }
        }
    };
    (operators $name:ident $($trait:ident $method:ident),*) => {$(
        impl<S: Simd> $trait for $name<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                $name($trait::$method(self.0, other.0))
            }
        }
    )*};
}

lanes!(
    /// As many `f32` side by side as the machine's registers hold.
    Lanes: f32s of f32, masks mask32s, sin_cos_of, sin_cos_within_of, exp_of
);
lanes!(
    /// As many `f64` side by side as the machine's registers hold.
    LanesF64: f64s of f64, masks mask64s, sin_cos_f64_of, sin_cos_within_f64_of, exp_f64_of
);

impl<S: Instructions> Lanes<S> {
    /// `self`·`by` + `plus`, rounded once where the machine has that: not the bits of [`Real`]'s operators.
    #[inline(always)]
    pub fn times_plus(self, by: Self, plus: Self) -> Self {
        Lanes(self.0.mul_add(by.0, plus.0))
    }
}

/// Adding this to a small `f32` leaves no bits for a fraction (as in [`sinew::math`]).
const SHIFTER: f32 = 12_582_912.0; // 1.5 · 2²³

impl<S: Instructions> Whole for Lanes<S> {
    type Bits = S::u32s;
    #[inline(always)]
    fn whole(self) -> (Self, S::u32s) {
        let shifted = self.0 + SHIFTER;
        (Lanes(shifted - SHIFTER), shifted.bitcast())
    }
    #[inline(always)]
    fn quarter(k: S::u32s, (s, c): (Self, Self)) -> (Self, Self) {
        let odd = (k & 1).simd_ne(0);
        let (sin, cos): (S::u32s, S::u32s) = (
            Self::select(odd, c, s).0.bitcast(),
            Self::select(odd, s, c).0.bitcast(),
        );
        let sin = sin ^ ((k & 2) << 30);
        let cos = cos ^ (((k + 1) & 2) << 30);
        (Lanes(sin.bitcast()), Lanes(cos.bitcast()))
    }
    #[inline(always)]
    fn power_of_two(k: S::u32s) -> Self {
        Lanes(((k + 127) << 23).bitcast())
    }
}

/// The same for `f64`.
const SHIFTER_F64: f64 = 6_755_399_441_055_744.0; // 1.5 · 2⁵²

impl<S: Instructions> Whole for LanesF64<S> {
    type Bits = S::u64s;
    #[inline(always)]
    fn whole(self) -> (Self, S::u64s) {
        let shifted = self.0 + SHIFTER_F64;
        (LanesF64(shifted - SHIFTER_F64), shifted.bitcast())
    }
    #[inline(always)]
    fn quarter(k: S::u64s, (s, c): (Self, Self)) -> (Self, Self) {
        let (s, c): (S::u64s, S::u64s) = (s.0.bitcast(), c.0.bitcast());
        let exchanged = (s ^ c) & (S::u64s::splat(S::proof(), 0) - (k & 1));
        let sin = (s ^ exchanged) ^ ((k & 2) << 62);
        let cos = (c ^ exchanged) ^ (((k + 1) & 2) << 62);
        (LanesF64(sin.bitcast()), LanesF64(cos.bitcast()))
    }
    #[inline(always)]
    fn power_of_two(k: S::u64s) -> Self {
        LanesF64(((k + 1023) << 52).bitcast())
    }
}

/// Runs `$body` with the type `$s` standing for the widest level of SIMD that the machine has.
///
/// What computes with lanes in it must be `#[inline(always)]` down to the last call, inside [`Simd::vectorize`], so that
/// all of it is compiled for that level.
macro_rules! dispatch {
    ($level:expr, $s:ident => $body:expr) => {
        match $level {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            fearless_simd::Level::Avx512(_) => {
                type $s = fearless_simd::Avx512;
                $body
            }
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            fearless_simd::Level::Avx2(_) => {
                type $s = fearless_simd::Avx2;
                $body
            }
            // SSE4.2 adds nothing here over SSE2, which every x86-64 has.
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            _ => {
                type $s = fearless_simd::Sse2;
                $body
            }
            #[cfg(target_arch = "aarch64")]
            _ => {
                type $s = fearless_simd::Neon;
                $body
            }
        }
    };
}
pub(crate) use dispatch;

/// A level of SIMD instructions that this machine has.
#[derive(Clone, Copy, Debug)]
pub struct SimdLevel(pub(crate) Level);

impl SimdLevel {
    /// The widest.
    pub fn widest() -> Self {
        SimdLevel(Level::new())
    }

    /// All that lanes are compiled for, the narrowest first.
    pub fn all() -> Vec<Self> {
        let widest = Level::new();
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        let levels = [
            widest.as_sse2().map(Level::Sse2),
            widest.as_avx2().map(Level::Avx2),
            widest.as_avx512().map(Level::Avx512),
        ];
        #[cfg(target_arch = "aarch64")]
        let levels = [Some(widest)];
        levels.into_iter().flatten().map(SimdLevel).collect()
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self.0 {
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::Avx512(_) => "AVX-512",
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Level::Avx2(_) => "AVX2",
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            _ => "SSE2",
            #[cfg(target_arch = "aarch64")]
            _ => "NEON",
        }
    }

    /// How many `f32` its registers hold.
    pub fn lanes(self) -> usize {
        dispatch!(self.0, S => Lanes::<S>::COUNT)
    }
}

/// What the CPU path runs on: the widest SIMD this machine has, and the threads.
pub fn describe() -> String {
    let level = SimdLevel::widest();
    format!(
        "{}, {} lanes, {} threads",
        level.name(),
        level.lanes(),
        rayon::current_num_threads()
    )
}

/// What the processor calls itself, where the system says.
pub fn processor() -> String {
    let about = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = about
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    name.map_or(std::env::consts::ARCH, |(_, name)| name)
        .to_owned()
}
