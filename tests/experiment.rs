//! The paper's experiment: what a synergy gains on reaches, one parameter vector a motion (the paper's section 4).

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use sinew_learn::checkpoint::Keeper;
use sinew_learn::gpu::{Gpu, Which};
use sinew_learn::learn::{Backend, Search};
use sinew_learn::motion::Motion;
use sinew_learn::problem::{ModelKind, Problem, StepperKind};
use sinew_learn::sample;
use sinew_tests::reaches::{problem, recorded, recorded_of_another, there_is_an_adapter};

/// Searches are timed and take every core: one after the other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// The program's own population, 512, in islands of 64.
const ISLANDS: usize = 8;
/// More than the program runs before it has settled; but with NJᵀ it goes on to its 1000.
const GENERATIONS: u32 = 128;

/// The distance of each motion in cm that a search ends with.
fn distances(problem: &Problem, backend: &mut Backend, generations: u32) -> Vec<f64> {
    for task in &problem.tasks {
        assert!(
            task.misfit < 0.01,
            "{}: the arm's first posture is {} m off",
            task.name,
            task.misfit
        );
    }
    let mut search = Search::new(problem);
    let keeper = Keeper::default();
    let began = Instant::now();
    let ended = search
        .run(problem, backend, generations, &keeper, |_| {})
        .unwrap();
    let seconds = began.elapsed().as_secs_f64();
    let winners = search.winners(problem, &keeper);
    let winners = winners.unwrap().unwrap();
    let distances: Vec<f64> = winners
        .iter()
        .map(|winner| winner.distances[0] * 100.0)
        .collect();
    let lanes: Vec<f64> = search
        .islands
        .chunks(problem.islands)
        .map(|set| {
            set.iter()
                .map(|island| f64::from(island.best_score))
                .fold(f64::INFINITY, f64::min)
                * 100.0
        })
        .collect();
    println!(
        "{:?} {:?}: {:.4} cm ({:.4} by the lanes) after {} generations in {seconds:.1} s, {ended:?}",
        problem.settings.stepper,
        problem.settings.model,
        mean(&distances),
        mean(&lanes),
        search.generation
    );
    assert!(seconds < 60.0, "a learning run took {seconds:.1} s");
    distances
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// By how much the mean distance falls from S_A to S_C.
fn fall(reaches: &[Motion], stepper: StepperKind, on: &impl Fn(&Problem) -> Backend) -> f64 {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let [bare, synergy] = [ModelKind::A, ModelKind::C].map(|model| {
        let problem = problem(reaches, stepper, model, ISLANDS).unwrap();
        mean(&distances(&problem, &mut on(&problem), GENERATIONS))
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

/// For each stepper, generations that are enough for the laws of models. Where NJᵀ comes near the target it swings about
/// it: its score is rugged and takes longer.
const LAWS: [(StepperKind, u32); 5] = [
    (StepperKind::Transpose, 32),
    (StepperKind::NormalisedTranspose, 128),
    (StepperKind::PseudoInverse, 16),
    (StepperKind::Damped, 16),
    (StepperKind::SelectivelyDamped, 16),
];

/// By how much a richer model may end above a poorer one, cm.
const BY_AT_MOST: f64 = 1e-4;

/// S_B has S_A within it and S_D has S_C: with another seed for each, on no motion may the richer end worse.
fn richer_models_end_no_worse(reaches: &[Motion]) {
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    let models = [ModelKind::A, ModelKind::B, ModelKind::C, ModelKind::D];
    let mut worse = Vec::new();
    for (stepper, generations) in LAWS {
        let [a, b, c, d] = models.map(|model| {
            let problem = Problem {
                seed: 10 + model as u64,
                ..problem(reaches, stepper, model, ISLANDS).unwrap()
            };
            distances(&problem, &mut Backend::Cpu, generations)
        });
        for (richer, poorer, names) in [(&b, &a, "S_B > S_A"), (&d, &c, "S_D > S_C")] {
            for ((reach, richer), poorer) in reaches.iter().zip(richer).zip(poorer) {
                let by = richer - poorer;
                if by > BY_AT_MOST {
                    worse.push(format!(
                        "{stepper:?} {}: {names} by {by:.5} cm",
                        reach.name()
                    ));
                }
            }
        }
        let against: Vec<String> = reaches
            .iter()
            .zip(c.iter().zip(&b))
            .filter(|(_, (c, b))| c >= b)
            .map(|(reach, (c, b))| format!("{} {c:.3} cm, {b:.3} cm", reach.name()))
            .collect();
        println!("{stepper:?}: S_C is not below S_B on {against:?}");
    }
    assert!(worse.is_empty(), "{worse:#?}");
}

#[test]
fn on_every_motion_of_the_sample_a_richer_model_ends_no_worse() {
    richer_models_end_no_worse(&sample::shipped().unwrap());
}

#[test]
fn on_every_recorded_motion_a_richer_model_ends_no_worse() {
    if let Some(reaches) = recorded() {
        richer_models_end_no_worse(&reaches);
    }
}

#[test]
fn on_every_recorded_motion_of_another_person_a_richer_model_ends_no_worse() {
    if let Some(reaches) = recorded_of_another() {
        richer_models_end_no_worse(&reaches);
    }
}

#[test]
fn other_seeds_end_alike() {
    let Some(reaches) = recorded() else {
        return;
    };
    let _turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
    for (stepper, _) in EXPECTED {
        let seeds = (1..=10).map(|seed| {
            let problem = Problem {
                seed,
                ..problem(&reaches, stepper, ModelKind::C, ISLANDS).unwrap()
            };
            distances(&problem, &mut Backend::Cpu, GENERATIONS)
        });
        let seeds: Vec<Vec<f64>> = seeds.collect();
        let means: Vec<f64> = seeds.iter().map(|distances| mean(distances)).collect();
        let least = means.iter().copied().fold(f64::INFINITY, f64::min);
        let most = means.iter().copied().fold(0.0, f64::max);
        // What ten times the generations can gain: the best of ten searches on each motion.
        let best = |motion: usize| {
            let each = seeds.iter().map(|distances| distances[motion]);
            each.fold(f64::INFINITY, f64::min)
        };
        let bests: Vec<f64> = (0..reaches.len()).map(best).collect();
        let gain = 1.0 - mean(&bests) / mean(&means);
        println!(
            "{stepper:?}: {least:.4} to {most:.4} cm, the best of all {:.4} cm, {:.2} % less than their mean",
            mean(&bests),
            100.0 * gain
        );
        assert!(most < 1.02 * least, "{stepper:?}: {means:?}");
        let settles = stepper != StepperKind::NormalisedTranspose;
        assert!(!settles || gain < 0.01, "{stepper:?}: {gain}");
    }
}
