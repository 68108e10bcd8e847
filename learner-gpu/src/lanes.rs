//! SIMD lanes of `f32` as a [`Real`]: the core's own source, run for several members of a population at once.
//!
//! `fearless_simd` has the registers and chooses the widest the machine has when the program runs. Every lane does
//! what the scalar `f32` does, bit for bit: nothing here is approximate and nothing is fused.

use std::ops::{Add, Div, Mul, Neg, Sub};

use fearless_simd::{Bytes, Level, Select, Simd, SimdBase, SimdFloat, SimdMask};
use sinew::math::{Whole, exp_of, sin_cos_of, sin_cos_within_of};
use sinew::real::Real;

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

/// As many `f32` side by side as the machine's registers hold.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd>(S::f32s);

impl<S: Instructions> Lanes<S> {
    /// How many there are.
    pub const COUNT: usize = <S::f32s as SimdBase<S>>::LEN;

    /// The first [`COUNT`](Self::COUNT) numbers of a slice, which has as many.
    #[inline(always)]
    pub fn load(values: &[f32]) -> Self {
        Lanes(S::f32s::from_slice(S::proof(), values))
    }

    /// The same number in each.
    #[inline(always)]
    pub fn splat(value: f32) -> Self {
        Lanes(S::f32s::splat(S::proof(), value))
    }

    /// `self`·`by` + `plus`, rounded once where the machine has that: not the bits of [`Real`]'s operators.
    #[inline(always)]
    pub fn times_plus(self, by: Self, plus: Self) -> Self {
        Lanes(self.0.mul_add(by.0, plus.0))
    }

    /// The numbers, into a slice of as many.
    #[inline(always)]
    pub fn store(self, values: &mut [f32]) {
        self.0.store_slice(values);
    }
}

macro_rules! operator {
    ($($trait:ident $method:ident),*) => {$(
        impl<S: Simd> $trait for Lanes<S> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Lanes($trait::$method(self.0, other.0))
            }
        }
    )*};
}
operator!(Add add, Sub sub, Mul mul, Div div);

impl<S: Simd> Neg for Lanes<S> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Lanes(-self.0)
    }
}

impl<S: Instructions> Real for Lanes<S> {
    type Mask = S::mask32s;
    const EPSILON: f64 = f32::EPSILON as f64;

    #[inline(always)]
    fn of(x: f64) -> Self {
        Lanes(S::f32s::splat(S::proof(), x as f32))
    }
    #[inline(always)]
    fn count(n: u32) -> Self {
        Lanes(S::f32s::splat(S::proof(), n as f32))
    }
    #[inline(always)]
    fn lt(self, other: Self) -> Self::Mask {
        self.0.simd_lt(other.0)
    }
    #[inline(always)]
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self {
        Lanes(mask.select(yes.0, no.0))
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        mask.any_true()
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Lanes(self.0.abs())
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Lanes(self.0.sqrt())
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos_of(self)
    }
    #[inline(always)]
    fn sin_cos_within(self) -> (Self, Self) {
        sin_cos_within_of(self)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        exp_of(self)
    }
    fn atan2(self, x: Self) -> Self {
        Lanes(S::f32s::from_fn(S::proof(), |lane| {
            Real::atan2(self.0[lane], x.0[lane])
        }))
    }
}

/// Adding this to a small `f32` leaves no bits for a fraction (as in [`sinew::math`]).
const SHIFTER: f32 = 12_582_912.0; // 1.5 · 2²³

impl<S: Instructions> Whole for Lanes<S> {
    #[inline(always)]
    fn whole(self) -> Self {
        Lanes((self.0 + SHIFTER) - SHIFTER)
    }
    #[inline(always)]
    fn quarter(self) -> (Self::Mask, Self::Mask) {
        let k: S::u32s = (self.0 + SHIFTER).bitcast();
        ((k & 1).simd_ne(0), (k & 2).simd_ne(0))
    }
    #[inline(always)]
    fn power_of_two(self) -> Self {
        let k: S::u32s = (self.0 + SHIFTER).bitcast();
        Lanes(((k + 127) << 23).bitcast())
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
