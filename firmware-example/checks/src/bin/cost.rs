//! Counts what a tick costs on a Cortex-M4F, and a plan by a map: instructions, and stack at worst inputs. A line each:
//! name, number.
//!
//! Under QEMU's `-icount shift=7` an instruction takes 128 ns, and SysTick counts 40 ns: exact and repeatable.
#![no_std]
#![no_main]

use core::hint::black_box;

use cortex_m::peripheral::{Peripherals, SYST, syst::SystClkSource};
use nalgebra::{SVector, Vector3};
use sinew::Error;
use sinew::chain::{Chain, human_arm};
use sinew::controller::{Controller, Limits, State};
use sinew::map::{MOST_TARGETS, Reach as Asked};
use sinew::stepper::{
    Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Stepper, Transpose,
};
use sinew::synergy::{Model, Synergy};
use sinew::target::Position;
use sinew_checks::motions::{REACHES, Reach, full, sample};
use sinew_checks::plain::{Method, PlainArm};
use sinew_checks::say;
use sinew_firmware::planner::Planner;

sinew_checks::entry!(all);

/// 1 kHz, as the firmware.
const PERIOD: f32 = 1e-3;
/// Of a reach.
const TICKS: u32 = 1000;

const GAINS: [f32; 7] = [1.0, 0.6, 0.3, 1.4, 0.2, 0.5, 0.1];

fn all() -> bool {
    let Some(mut peripherals) = Peripherals::take() else {
        return false;
    };
    peripherals.SYST.set_clock_source(SystClkSource::Core);
    peripherals.SYST.set_reload(0x00ff_ffff);
    peripherals.SYST.clear_current();
    peripherals.SYST.enable_counter();
    let done = core("Jt", Transpose)
        .and_then(|()| core("NJt", NormalisedTranspose))
        .and_then(|()| core("J+", PseudoInverse))
        .and_then(|()| core("damped", Damped::default()))
        .and_then(|()| core("selective", SelectivelyDamped::default()))
        .and_then(|()| plans());
    for (name, method) in [
        ("plain.Jt", Method::Transpose),
        ("plain.NJt", Method::NormalisedTranspose),
        ("plain.J+", Method::PseudoInverse),
        ("plain.damped", Method::Damped),
    ] {
        plain(name, method);
    }
    let size = size_of::<Chain<f32, 7>>()
        + size_of::<Controller<'_, f32, Damped<f32>, 7>>()
        + size_of::<State<f32, 7>>();
    say!("static.control {}", size);
    done.is_ok()
}

/// Instructions that `f` takes.
fn instructions(f: impl FnOnce()) -> u32 {
    let first = SYST::get_current();
    let before = SYST::get_current();
    f();
    let after = SYST::get_current();
    // Reading the timer takes some itself.
    let reading = first.wrapping_sub(before) & 0x00ff_ffff;
    let ticks = (before.wrapping_sub(after) & 0x00ff_ffff).saturating_sub(reading);
    (ticks * 40 + 64) / 128
}

/// The least, the mean and the greatest.
struct Counts {
    least: u32,
    sum: u32,
    greatest: u32,
    number: u32,
}

impl Counts {
    fn new() -> Self {
        Counts {
            least: u32::MAX,
            sum: 0,
            greatest: 0,
            number: 0,
        }
    }

    fn add(&mut self, count: u32) {
        self.least = self.least.min(count);
        self.greatest = self.greatest.max(count);
        self.sum += count;
        self.number += 1;
    }

    fn say(&self, name: &str) {
        say!(
            "instructions.{}.mean {}",
            name,
            self.sum / self.number.max(1)
        );
        say!("instructions.{}.worst {}", name, self.greatest);
    }
}

#[inline(never)]
fn tick<S: Stepper<f32>>(
    controller: &Controller<'_, f32, S, 7>,
    state: &mut State<f32, 7>,
    target: &Position<f32>,
) {
    controller.tick(state, target);
}

/// A reach of each person's arm there is, and ticks whose every input is the worst.
fn core<S: Stepper<f32> + Copy>(name: &str, stepper: S) -> Result<(), Error> {
    let rate = S::RATE as f32;
    let synergy = Synergy::c(GAINS, 4.0, 8.0)?;
    let mut counts = Counts::new();
    for Reach {
        lengths: [upper_arm, forearm, hand],
        start,
        target,
        ..
    } in REACHES.iter().step_by(9)
    {
        let arm = black_box(human_arm::<f32>(*upper_arm, *forearm, *hand)?);
        let controller = Controller::new(&arm, stepper, synergy, rate, PERIOD, Limits::Clamped)?;
        let controller = black_box(controller);
        let target = black_box(Position::new(*target)?);
        let mut state = controller.start(*start);
        for _ in 0..TICKS {
            counts.add(instructions(|| tick(&controller, &mut state, &target)));
        }
    }
    counts.say(name);

    // Stretched out (singular), at the far ends of the ranges, with a sigmoid for each DoF and a full matrix.
    let arm = human_arm::<f32>(0.29, 0.25, 0.09)?;
    let worst = Synergy::d([5.0; 7], [20.0; 7], [10.0; 7])?.with_matrix([[1.0; 7]; 7])?;
    let controller = black_box(Controller::new(
        &arm,
        stepper,
        worst,
        rate,
        PERIOD,
        Limits::Free,
    )?);
    let mut stack = 0;
    let mut singular = 0;
    for angle in [0.0, 1e-3, core::f32::consts::FRAC_PI_2, 3.2, 8191.0] {
        for reach in [0.3, 1e4] {
            let target = black_box(Position::new([reach, -reach, 0.5])?);
            let mut state = controller.start([angle, 0.0, angle, 0.0, -angle, 0.0, 0.0]);
            stack = stack.max(painted(|| tick(&controller, &mut state, &target)));
            let mut state = controller.start([angle, 0.0, angle, 0.0, -angle, 0.0, 0.0]);
            singular = singular.max(instructions(|| tick(&controller, &mut state, &target)));
        }
    }
    say!("instructions.{}.worst-inputs {}", name, singular);
    say!("stack.{} {}", name, stack);
    Ok(())
}

/// A plan by the sample's map, and by the largest one there can be.
fn plans() -> Result<(), Error> {
    plan("plan", &sample()?);
    let most = &full(Model::D, &[[0.3, 0.2, 0.1]; MOST_TARGETS])?;
    say!("stack.plan {}", plan("plan.worst-inputs", most));
    say!("static.plan {}", size_of_val(&most.map));
    Ok(())
}

/// The stack that it takes.
#[inline(never)]
fn plan(name: &str, planner: &Planner) -> usize {
    let planner = black_box(planner);
    let asked = black_box(Asked {
        target: [0.2, 0.42, -0.1],
        seconds: 0.8,
    });
    let mut plan = || drop(black_box(planner.map.plan(&asked)));
    let stack = painted(&mut plan);
    say!("instructions.{} {}", name, instructions(&mut plan));
    stack
}

fn plain(name: &str, method: Method) {
    let gains = SVector::from(GAINS);
    let mut counts = Counts::new();
    if let Some(Reach {
        lengths,
        start,
        target,
        ..
    }) = REACHES.first()
    {
        let arm = black_box(PlainArm::new(lengths.map(|x| x as f32)));
        let target = black_box(Vector3::from(*target));
        let mut q = SVector::from(*start);
        let gain = PERIOD
            * if method == Method::Transpose {
                100.0
            } else {
                10.0
            };
        for k in 0..TICKS / 4 {
            let time = k as f32 * PERIOD;
            let mut one = || arm.tick(method, &mut q, &target, &gains, [gain, time]);
            counts.add(instructions(&mut one));
        }
    }
    counts.say(name);
}

/// Bytes of stack that `f` writes to: the stack below is painted, then looked at.
#[allow(unsafe_code)]
#[inline(never)]
fn painted(f: impl FnOnce()) -> usize {
    const DEEP: usize = 1024;
    const PAINT: u32 = 0x5eed_5eed;
    let here = cortex_m::register::msp::read() as usize;
    // Some words are left for this function's own use.
    let top = here - 32;
    // SAFETY: below the stack pointer lies memory of the stack that nothing uses; interrupts are off.
    unsafe {
        for k in 1..=DEEP {
            ((top - 4 * k) as *mut u32).write_volatile(PAINT);
        }
    }
    f();
    // SAFETY: as above.
    let untouched = |k: &usize| unsafe { ((top - 4 * k) as *const u32).read_volatile() == PAINT };
    let deepest = (1..=DEEP).rev().find(|k| !untouched(k)).unwrap_or(0);
    4 * deepest + 32
}
