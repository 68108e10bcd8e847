//! The GPU path against the CPU's lanes: the same proposals, bit for bit, and the same scores to rounding.

use sinew_learn::checkpoint::Keeper;
use sinew_learn::cpu;
use sinew_learn::gpu::{Gpu, Which};
use sinew_learn::kernel::anneal::{Island, UNSCORED};
use sinew_learn::learn::{Backend, Search};
use sinew_learn::problem::{ModelKind, Problem, StepperKind};
use sinew_learn::sample;
use sinew_tests::reaches::{problem, recorded, there_is_an_adapter};

const MODELS: [ModelKind; 4] = [ModelKind::A, ModelKind::B, ModelKind::C, ModelKind::D];

fn advanced(problem: &Problem, from: u32, to: u32, islands: &[Island]) -> Vec<Island> {
    let mut islands = islands.to_vec();
    cpu::advance(problem, &mut islands, from, to, || false).unwrap();
    islands
}

/// The members' scores by lanes, and by the device.
fn both(problem: &Problem, islands: &[Island]) -> Vec<(f32, f32)> {
    // The device is not told what the lanes made of them.
    let mut unscored = islands.to_vec();
    for island in &mut unscored {
        island.scores.fill(UNSCORED);
    }
    let mut gpu = Gpu::new(problem, &unscored, Which::Best).unwrap();
    let device = gpu.scores().unwrap();
    let lanes = islands.iter().flat_map(|island| island.scores.clone());
    let pairs = lanes.zip(device.into_iter().flatten());
    // Islands that have just begun anew have no score by lanes.
    pairs.filter(|(lanes, _)| *lanes < UNSCORED).collect()
}

/// Relative differences, the least first.
fn differences(scores: &[(f32, f32)]) -> Vec<f64> {
    let relative = |&(a, b): &(f32, f32)| (f64::from(a) - f64::from(b)).abs() / f64::from(a);
    let mut differences: Vec<f64> = scores.iter().map(relative).collect();
    assert!(differences.iter().all(|difference| !difference.is_nan()));
    differences.sort_by(f64::total_cmp);
    differences
}

#[test]
fn a_settled_population_scores_the_same_on_both() {
    if !there_is_an_adapter() {
        return;
    }
    // Real ones where they are here.
    let reaches = recorded().unwrap_or_else(|| sample::shipped().unwrap());
    for stepper in StepperKind::ALL {
        let problem = problem(&reaches, stepper, ModelKind::C, 4).unwrap();
        let mut search = Search::new(&problem);
        search
            .run(&problem, &mut Backend::Cpu, 128, &Keeper::default(), |_| {})
            .unwrap();
        let differences = differences(&both(&problem, &search.islands));
        let most = differences[(differences.len() as f64 * 0.999) as usize - 1];
        let worst = differences.last().unwrap();
        println!(
            "{stepper:?}: {} settled members, 99.9 % within {most:e}, worst {worst:e}",
            differences.len()
        );
        let exact = [StepperKind::Transpose, StepperKind::NormalisedTranspose].contains(&stepper);
        assert!(most < if exact { 1e-5 } else { 1e-3 });
    }
}

#[test]
fn random_members_score_the_same_on_both_but_for_those_that_shake() {
    if !there_is_an_adapter() {
        return;
    }
    let reaches = &sample::shipped().unwrap()[4..5];
    for stepper in StepperKind::ALL {
        // 157 islands of 64: 10,048 members.
        let problem = problem(reaches, stepper, ModelKind::C, 157).unwrap();
        let islands = advanced(&problem, 0, 1, &Search::new(&problem).islands);
        let differences = differences(&both(&problem, &islands));
        let (median, worst) = (
            differences[differences.len() / 2],
            differences.last().unwrap(),
        );
        println!(
            "{stepper:?}: {} random members, median {median:e}, worst {worst:e}",
            differences.len()
        );
        assert!(median < 1e-6);
    }
}

#[test]
fn the_same_seed_proposes_the_same_bits_on_both() {
    if !there_is_an_adapter() {
        return;
    }
    let reaches = &sample::shipped().unwrap()[..2];
    for model in MODELS {
        let problem = problem(reaches, StepperKind::Transpose, model, 2).unwrap();
        // Members without a score accept whatever is proposed: their genes are the proposals.
        let mut islands = Search::new(&problem).islands;
        for generation in [0, 1, 2, 77] {
            let lanes = advanced(&problem, generation, generation + 1, &islands);
            let mut gpu = Gpu::new(&problem, &islands, Which::Best).unwrap();
            gpu.advance(generation, generation + 1, || false).unwrap();
            for (a, b) in lanes.iter().zip(gpu.islands().unwrap()) {
                assert_eq!(a.genes, b.genes, "{model:?}, generation {generation}");
            }
            islands = lanes;
            for island in &mut islands {
                island.scores.fill(UNSCORED);
            }
        }
    }
}

#[test]
fn however_its_generations_are_split_the_device_ends_with_the_same_bits() {
    if !there_is_an_adapter() {
        return;
    }
    let reaches = &sample::shipped().unwrap()[..3];
    let problem = problem(reaches, StepperKind::NormalisedTranspose, ModelKind::D, 2).unwrap();
    let fresh = Search::new(&problem).islands;
    let run = |cuts: &[u32]| {
        let mut gpu = Gpu::new(&problem, &fresh, Which::Best).unwrap();
        let mut at = 0;
        for &to in cuts {
            at = gpu.advance(at, to, || false).unwrap();
            // Read back and put on again, as a search that is stopped and goes on.
            let islands = gpu.islands().unwrap();
            gpu.replace(&problem, &islands).unwrap();
        }
        gpu.islands().unwrap()
    };
    assert_eq!(run(&[40]), run(&[1, 2, 17, 40]));
}

#[test]
fn one_vector_for_a_set_of_motions_scores_the_same_on_both() {
    if !there_is_an_adapter() {
        return;
    }
    let problem = problem(
        &sample::shipped().unwrap(),
        StepperKind::Transpose,
        ModelKind::C,
        2,
    )
    .unwrap();
    let problem = Problem {
        sets: vec![(0..14).collect()],
        ..problem
    };
    let islands = advanced(&problem, 0, 60, &Search::new(&problem).islands);
    let differences = differences(&both(&problem, &islands));
    println!(
        "a set of 14: median {:e}, worst {:e}",
        differences[64],
        differences.last().unwrap()
    );
    assert!(differences[64] < 1e-6);
}
