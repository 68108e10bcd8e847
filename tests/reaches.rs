//! The paper's experiment: what a synergy gains on reaches, one parameter vector a motion (the paper's section 4).

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use sinew_learn::gpu::{Gpu, Which};
use sinew_learn::learn::{Backend, Search};
use sinew_learn::motion::Motion;
use sinew_learn::problem::{ModelKind, Problem, Settings, StepperKind};
use sinew_learn::task::{Arm, Task, facing};
use sinew_learn::{csv, sample};
use sinew_tests::shared;

/// The 14 reaches of one seated person: forward with either arm, and across.
fn recorded() -> Option<Vec<Motion>> {
    let folder = shared("data/ue_adl/ADL004")?;
    let forward = ["FL", "FR"]
        .iter()
        .flat_map(|side| (1..=5).map(move |trial| format!("{side}{trial}")));
    let across = ["AL1", "AL2", "AR1", "AR2"].map(str::to_owned);
    let file = |name: String| -> PathBuf { folder.join(format!("ADL004_{name}.csv")) };
    Some(
        forward
            .chain(across)
            .map(|name| csv::read(file(name)).unwrap())
            .collect(),
    )
}

fn problem(reaches: &[Motion], stepper: StepperKind, model: ModelKind) -> Problem {
    let arm = Arm::Human(facing(reaches));
    let tasks: Vec<Task> = reaches
        .iter()
        .map(|reach| Task::new(reach, &arm, 60.0).unwrap())
        .collect();
    for task in &tasks {
        assert!(
            task.misfit < 0.01,
            "{}: the arm's first posture is {} m off",
            task.name,
            task.misfit
        );
    }
    Problem {
        sets: (0..tasks.len()).map(|task| vec![task]).collect(),
        tasks,
        settings: Settings {
            stepper,
            model,
            lambda: stepper.rate(),
            rate_hz: 60.0,
            clamped: false,
        },
        islands: 4,
        seed: 1,
    }
}

/// The mean distance in cm that a search ends with.
fn learned(problem: &Problem, backend: &mut Backend) -> f64 {
    let mut search = Search::new(problem);
    let stop = AtomicBool::new(false);
    let began = Instant::now();
    search
        .run(problem, backend, 1000, &stop, None, |_| {})
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
        let problem = problem(reaches, stepper, model);
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

fn there_is_an_adapter() -> bool {
    let there = !sinew_learn::gpu::adapters().is_empty();
    if !there {
        println!("skipped: no adapter for the GPU path");
    }
    there
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
