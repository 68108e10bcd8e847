//! How many floating-point operations a frame takes: the core's own source, run on a number that counts.

use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};

use serde::Serialize;
use sinew::math::{Whole, exp_of, sin_cos_of, sin_cos_within_of};
use sinew::real::Real;

/// Floating-point operations, by kind. Comparisons, choices and changes of sign are none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Operations {
    /// Additions and subtractions.
    pub additions: f64,
    /// Multiplications.
    pub multiplications: f64,
    /// Divisions.
    pub divisions: f64,
    /// Square roots.
    pub roots: f64,
}

impl Operations {
    /// All of them.
    pub fn total(&self) -> f64 {
        self.additions + self.multiplications + self.divisions + self.roots
    }
}

thread_local! {
    /// What [`Counted`] did on this thread: additions, multiplications, divisions, roots.
    static DONE: [Cell<u64>; 4] = const { [const { Cell::new(0) }; 4] };
}

fn note(kind: usize, times: u64) {
    DONE.with(|done| done[kind].set(done[kind].get() + times));
}

/// What `work` does with [`Counted`], over `frames` frames: the mean of one.
pub(super) fn counted(work: impl FnOnce() -> u64) -> Operations {
    DONE.with(|done| done.iter().for_each(|count| count.set(0)));
    let frames = work().max(1) as f64;
    let [additions, multiplications, divisions, roots] =
        DONE.with(|done| std::array::from_fn(|kind| done[kind].get() as f64 / frames));
    Operations {
        additions,
        multiplications,
        divisions,
        roots,
    }
}

/// An `f32` that counts what is done with it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Counted(f32);

macro_rules! operator {
    ($($trait:ident $method:ident $kind:expr),*) => {$(
        impl $trait for Counted {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                note($kind, 1);
                Counted($trait::$method(self.0, other.0))
            }
        }
    )*};
}
operator!(Add add 0, Sub sub 0, Mul mul 1, Div div 2);

impl Neg for Counted {
    type Output = Self;
    fn neg(self) -> Self {
        Counted(-self.0)
    }
}

impl Real for Counted {
    type Mask = bool;
    const EPSILON: f64 = <f32 as Real>::EPSILON;

    fn of(x: f64) -> Self {
        Counted(x as f32)
    }
    fn count(n: u32) -> Self {
        Counted(n as f32)
    }
    fn lt(self, other: Self) -> bool {
        self.0 < other.0
    }
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
    fn any(mask: bool) -> bool {
        mask
    }
    fn abs(self) -> Self {
        Counted(self.0.abs())
    }
    fn sqrt(self) -> Self {
        note(3, 1);
        Counted(self.0.sqrt())
    }
    fn sin_cos(self) -> (Self, Self) {
        sin_cos_of(self)
    }
    fn sin_cos_within(self) -> (Self, Self) {
        sin_cos_within_of(self)
    }
    fn exp(self) -> Self {
        exp_of(self)
    }
    fn atan2(self, x: Self) -> Self {
        Counted(Real::atan2(self.0, x.0))
    }
}

impl Whole for Counted {
    type Bits = u32;
    fn whole(self) -> (Self, u32) {
        note(0, 2);
        let (whole, bits) = self.0.whole();
        (Counted(whole), bits)
    }
    fn quarter(k: u32, (s, c): (Self, Self)) -> (Self, Self) {
        let (sin, cos) = <f32 as Whole>::quarter(k, (s.0, c.0));
        (Counted(sin), Counted(cos))
    }
    fn power_of_two(k: u32) -> Self {
        Counted(Whole::power_of_two(k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_operation_is_counted_once() {
        let done = counted(|| {
            let (a, b) = (Counted(3.0), Counted(4.0));
            let _ = (a * a + b * b).sqrt() / (a - b);
            2
        });
        let half = |count: f64| count / 2.0;
        assert_eq!(
            done,
            Operations {
                additions: half(2.0),
                multiplications: half(2.0),
                divisions: half(1.0),
                roots: half(1.0),
            }
        );
    }
}
