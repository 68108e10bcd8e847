//! The control path alone, in a program that links only if nothing in it can panic: its panic handler calls a function
//! that does not exist. What of the handler is left after dead code is gone, the linker refuses.
//!
//! It is also what the flash and the static memory of the control path are read off.
#![no_std]
#![no_main]
#![allow(unsafe_code)]

use core::hint::black_box;

use cortex_m_rt::entry;
use sinew::chain::human_arm;
use sinew::controller::{Controller, Limits};
use sinew::target::Position;
#[cfg(not(feature = "all-steppers"))]
use sinew::{
    controller::State,
    stepper::{Stepper, Transpose},
    synergy::Synergy,
};
#[cfg(feature = "all-steppers")]
use sinew::{
    map::{INPUTS, Reach, SynergyMap, TERMS},
    synergy::Model,
};

unsafe extern "C" {
    fn the_control_path_can_panic() -> !;
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: it is never called: it is not there.
    unsafe { the_control_path_can_panic() }
}

/// The tick alone: its size is the flash that control takes, however the chain came to be.
#[cfg(not(feature = "all-steppers"))]
#[unsafe(no_mangle)]
#[inline(never)]
fn sinew_tick(
    controller: &Controller<'_, f32, Transpose, 7>,
    state: &mut State<f32, 7>,
    target: &Position<f32>,
) {
    controller.tick(state, target);
}

/// From sensors and targets to angles, as a product would call it.
#[inline(never)]
fn control() -> Option<[f32; 7]> {
    let [upper_arm, forearm, hand] = black_box([0.29, 0.25, 0.09]);
    let arm = human_arm::<f32>(upper_arm, forearm, hand).ok()?;
    #[cfg(not(feature = "all-steppers"))]
    let synergy = Synergy::c(black_box([1.0; 7]), black_box(4.0), black_box(8.0)).ok()?;
    let target = Position::new(black_box([0.1, 0.3, -0.2])).ok()?;
    #[cfg(not(feature = "all-steppers"))]
    return {
        let rate = <Transpose as Stepper<f32>>::RATE as f32;
        let controller =
            Controller::new(&arm, Transpose, synergy, rate, 1e-3, Limits::Clamped).ok()?;
        let mut state = controller.start(black_box([0.1; 7]));
        for _ in 0..black_box(1000) {
            sinew_tick(&controller, &mut state, &target);
        }
        Some(*state.angles())
    };
    #[cfg(feature = "all-steppers")]
    {
        let pose =
            sinew::target::Pose::new(black_box([0.1, 0.3, -0.2]), black_box([0.0, 0.0, 0.0, 1.0]))
                .ok()?;
        let mut q = black_box([0.1; 7]);
        let row = black_box([0.1; TERMS]);
        let known = black_box([[0.3, 0.2, 0.1]]);
        let inputs = black_box([1.0; INPUTS]);
        let map = SynergyMap::new(Model::C, inputs, inputs, &[row; 9], &known, black_box(0.1));
        let reach = Reach {
            target: target.coordinates(),
            seconds: black_box(1.0),
        };
        let synergy = map.ok()?.plan(&reach).ok()?.synergy;
        for (_, stepper) in sinew_checks::motions::steppers() {
            let rate = stepper.rate() as f32;
            let controller =
                Controller::new(&arm, stepper, synergy, rate, 1e-3, Limits::Clamped).ok()?;
            let mut state = controller.start(q);
            for _ in 0..black_box(1000) {
                controller.tick(&mut state, &target);
                controller.tick(&mut state, &pose);
            }
            q = *state.angles();
        }
        Some(q)
    }
}

#[entry]
fn main() -> ! {
    loop {
        let angles = black_box(control());
        #[cfg(feature = "can-panic")]
        black_box(angles.unwrap_or_default()[black_box(3)]);
        #[cfg(not(feature = "can-panic"))]
        let _ = angles;
    }
}
