//! The most that a processor's lanes compute: chains of multiplications and additions that do not wait for each other.

use std::hint::black_box;
use std::time::Instant;

use sinew::real::Real;

use crate::lanes::{Instructions, Lanes, SideBySide, SimdLevel, dispatch};

/// Chains side by side: enough to fill the units' depth, few enough for 16 registers.
const CHAINS: usize = 12;
/// Links of each chain between two looks at the clock.
const LINKS: usize = 100_000;

/// Floating-point operations a second of one thread on this level: the greater of multiplications with additions, and
/// of fused ones, over `seconds`.
pub(super) fn operations_a_second(level: SimdLevel, seconds: f64) -> f64 {
    dispatch!(level.0, S => most::<S>(seconds))
}

fn most<S: Instructions>(seconds: f64) -> f64 {
    let once = (CHAINS * LINKS * Lanes::<S>::COUNT * 2) as f64;
    let began = Instant::now();
    let mut most = 0.0f64;
    while began.elapsed().as_secs_f64() < seconds {
        for run in [run::<S, false>, run::<S, true>] {
            let began = Instant::now();
            run();
            most = most.max(once / began.elapsed().as_secs_f64());
        }
    }
    most
}

#[inline(never)]
fn run<S: Instructions, const FUSED: bool>() {
    S::proof().vectorize(
        #[inline(always)]
        || {
            let by = Lanes::<S>::of(black_box(0.999));
            let plus = Lanes::<S>::of(black_box(0.001));
            let mut chains = [Lanes::<S>::of(black_box(1.0)); CHAINS];
            for _ in 0..LINKS {
                for x in &mut chains {
                    *x = if FUSED {
                        x.times_plus(by, plus)
                    } else {
                        *x * by + plus
                    };
                }
            }
            black_box(chains);
        },
    );
}
