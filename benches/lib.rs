//! What the benchmarks share: the arms, the postures, and the same controller for every stepper.

pub mod k;

use nalgebra::SMatrix;
use sinew::chain::{Chain, human_arm};
use sinew::controller::{Controller, Limits};
use sinew::real::Real;
use sinew::stepper::Stepper;
use sinew::synergy::Synergy;
use sinew_learn::chain::ChainDescription;
use sinew_learn::problem::{ModelKind, Problem, Settings, StepperKind};
use sinew_learn::task::{Arm, Task, facing};
use sinew_learn::{sample, urdf};

/// The Franka Emika Panda, as URDF text.
pub const PANDA: &str = include_str!("panda.urdf");

/// The Panda from its base to its flange, as it is described.
///
/// # Panics
/// If the file beside this one is not what it was.
pub fn panda_description() -> ChainDescription {
    urdf::parse(PANDA.to_owned(), "link0", "flange").expect("it is a robot")
}

/// The Panda, ready to compute with.
///
/// # Panics
/// If the file beside this one is not what it was.
pub fn panda() -> Chain<f64, 7> {
    panda_description().build().expect("it has 7 joints")
}

/// The SPEC's human arm, with an adult's lengths.
///
/// # Panics
/// If the core refuses it.
pub fn arm() -> Chain<f64, 7> {
    human_arm(0.29, 0.25, 0.09).expect("these lengths are good")
}

/// Postures spread over a chain's limits by a low-discrepancy sequence (Kronecker's, by square roots of primes).
pub fn postures<const N: usize>(chain: &Chain<f64, N>, count: u32) -> Vec<[f64; N]> {
    let primes = [2.0f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];
    let share = |n: u32, i: usize| (f64::from(n + 1) * primes[i % primes.len()].sqrt()).fract();
    let (lower, upper) = (chain.lower(), chain.upper());
    let angle = |n, i: usize| lower[i] + share(n, i) * (upper[i] - lower[i]);
    (0..count)
        .map(|n| std::array::from_fn(|i| angle(n, i)))
        .collect()
}

/// A point or a direction.
pub type Vec3 = [f64; 3];

/// What kinematics gives: the tip, its axes and the Jacobian.
pub type Everything = (Vec3, [Vec3; 3], SMatrix<f64, 6, 7>);

/// Forward kinematics and the Jacobian of one posture, as one call.
#[inline(never)]
pub fn forward_and_jacobian(chain: &Chain<f64, 7>, q: &[f64; 7]) -> Everything {
    let at = chain.forward(q);
    (at.tip(), at.tip_axes(), at.jacobian())
}

/// Forward kinematics of one posture, as one call.
#[inline(never)]
pub fn forward(chain: &Chain<f64, 7>, q: &[f64; 7]) -> (Vec3, [Vec3; 3]) {
    let at = chain.forward(q);
    (at.tip(), at.tip_axes())
}

/// A controller with synergy S_C at 60 Hz, everything as the SPEC has it.
///
/// # Panics
/// If the core refuses it.
pub fn controller<T: Real, S: Stepper<T>>(
    chain: &Chain<T, 7>,
    stepper: S,
) -> Controller<'_, T, S, 7> {
    let gains = [1.0, 0.4, 0.2, 1.5, 0.1, 0.3, 0.1].map(T::of);
    let synergy = Synergy::c(gains, T::of(4.0), T::of(8.0)).expect("these parameters are good");
    let (rate, dt) = (T::of(S::RATE), T::of(1.0 / 60.0));
    Controller::new(chain, stepper, synergy, rate, dt, Limits::Clamped)
        .expect("these settings are good")
}

/// Where a reach of the human arm begins, radians.
pub const START: [f64; 7] = [0.0, 0.2, 0.0, 1.2, 0.0, 0.0, 0.0];
/// Where it goes, metres.
pub const TARGET: Vec3 = [0.3, 0.1, -0.2];

/// A search for one parameter vector, S_C and Jᵀ, on human arms and the first `motions` of the reaches that `sinew`
/// ships, at 60 Hz without limits: the paper's experiment. Where there are fewer reaches, they come again.
///
/// # Panics
/// If the sample is not what it was.
pub fn shipped(motions: usize, islands: usize) -> Problem {
    let reaches = sample::shipped().expect("the sample can be read");
    let arm = Arm::Human(facing(&reaches));
    let reaches = reaches.iter().cycle().take(motions);
    let task = |reach| Task::new(reach, &arm, 60.0).expect("the sample has reaches");
    let tasks: Vec<Task> = reaches.map(task).collect();
    let stepper = StepperKind::Transpose;
    Problem {
        settings: Settings {
            stepper,
            model: ModelKind::C,
            lambda: stepper.rate(),
            rate_hz: 60.0,
            clamped: false,
        },
        sets: vec![(0..tasks.len()).collect()],
        tasks,
        islands,
        seed: 1,
    }
}
