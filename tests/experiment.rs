//! The paper's experiment: what a synergy gains on reaches, one parameter vector a motion (the paper's section 4).

use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use sinew_learn::gpu::{Gpu, Which};
use sinew_learn::learn::{Backend, Search};
use sinew_learn::motion::Motion;
use sinew_learn::problem::{ModelKind, Problem, StepperKind};
use sinew_learn::sample;
use sinew_tests::reaches::{problem, recorded, there_is_an_adapter};

/// Searches are timed and take every core: one after the other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// The mean distance in cm that a search ends with.
fn learned(problem: &Problem, backend: &mut Backend) -> f64 {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    for task in &problem.tasks {
        assert!(
            task.misfit < 0.01,
            "{}: the arm's first posture is {} m off",
            task.name,
            task.misfit
        );
    }
    let mut search = Search::new(problem);
    let stop = AtomicBool::new(false);
    let began = Instant::now();
    search
        .run(problem, backend, 1100, &stop, None, |_| {})
        .unwrap();
    let seconds = began.elapsed().as_secs_f64();
    let winners = search.winners(problem).unwrap();
    let mean = winners
        .iter()
        .map(|winner| winner.distances[0])
        .sum::<f64>()
        / winners.len() as f64
        * 100.0;
    println!(
        "{:?} {:?}: {mean:.3} cm after {} generations in {seconds:.1} s",
        problem.settings.stepper, problem.settings.model, search.generation
    );
    assert!(seconds < 60.0, "a learning run took {seconds:.1} s");
    mean
}

/// By how much the mean distance falls from S_A to S_C.
fn fall(reaches: &[Motion], stepper: StepperKind, on: &impl Fn(&Problem) -> Backend) -> f64 {
    let [bare, synergy] = [ModelKind::A, ModelKind::C].map(|model| {
        let problem = problem(reaches, stepper, model, 32).unwrap();
        learned(&problem, &mut on(&problem))
    });
    1.0 - synergy / bare
}

/// What a crude search reached on the recordings, by independent code: ours may not be worse.
const EXPECTED: [(StepperKind, f64); 3] = [
    (StepperKind::Transpose, 0.57),
    (StepperKind::NormalisedTranspose, 0.65),
    (StepperKind::PseudoInverse, 0.72),
];

fn cpu(_: &Problem) -> Backend {
    Backend::Cpu
}

fn gpu(problem: &Problem) -> Backend {
    let device = Gpu::new(problem, &Search::new(problem).islands, Which::Best).unwrap();
    Backend::Gpu {
        device: Box::new(device),
        or_cpu: false,
    }
}

fn a_synergy_brings_reaches_nearer(reaches: &[Motion], on: &impl Fn(&Problem) -> Backend) {
    for (stepper, expected) in EXPECTED {
        let fall = fall(reaches, stepper, on);
        println!("{stepper:?}: S_A to S_C {:.1} %", -100.0 * fall);
        assert!(
            fall >= expected,
            "{stepper:?}: {fall} instead of {expected}"
        );
    }
}

#[test]
fn a_synergy_brings_recorded_reaches_nearer_on_the_cpu() {
    if let Some(reaches) = recorded() {
        a_synergy_brings_reaches_nearer(&reaches, &cpu);
    }
}

#[test]
fn a_synergy_brings_recorded_reaches_nearer_on_the_gpu_path() {
    if let Some(reaches) = recorded()
        && there_is_an_adapter()
    {
        a_synergy_brings_reaches_nearer(&reaches, &gpu);
    }
}

#[test]
fn a_synergy_brings_the_shipped_sample_nearer_on_the_cpu() {
    a_synergy_brings_reaches_nearer(&sample::shipped().unwrap(), &cpu);
}

#[test]
fn a_synergy_brings_the_shipped_sample_nearer_on_the_gpu_path() {
    if there_is_an_adapter() {
        a_synergy_brings_reaches_nearer(&sample::shipped().unwrap(), &gpu);
    }
}
