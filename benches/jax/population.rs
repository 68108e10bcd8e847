//! The learner's side of the comparison with JAX: the workload, its scores, and how fast the SIMD lanes and the adapters
//! are.
//!
//! ```text
//! population FILE     # writes the tasks, the candidates' parameters and their scores, as JSON
//! population          # prints each place's million candidate·motion·frames a second, over generations of the search
//! ```
//!
//! 512 candidates, 32 motions (the reaches that `sinew` ships, in turn) of 100 frames: each reach holds its end.

use std::env;
use std::error::Error;
use std::fs;
use std::time::Instant;

use serde_json::json;
use sinew_benches::shipped;
use sinew_learn::cpu;
use sinew_learn::gpu::{self, Gpu, Which};
use sinew_learn::kernel::anneal::Island;
use sinew_learn::kernel::proposal::ISLAND;
use sinew_learn::kernel::score::Ready;
use sinew_learn::problem::Problem;

/// 512 candidates.
const ISLANDS: usize = 8;
const MOTIONS: usize = 32;
const FRAMES: usize = 100;
/// The range of a candidate's gains, and of its o and s: tame enough for all motions to be stable. Of candidates with
/// gains of 5 some swing so wildly that a rounding error decides their score.
const RANGES: [[f64; 2]; 3] = [[0.0, 1.5], [2.0, 8.0], [4.0, 10.0]];
/// Generations that are timed.
const TIMED: u32 = 30;

fn main() -> Result<(), Box<dyn Error>> {
    let mut problem = shipped(MOTIONS, ISLANDS);
    for task in &mut problem.tasks {
        let end = task.reference.last().ok_or("a reach has frames")?.clone();
        task.reference.resize(FRAMES, end);
    }
    let mut islands = vec![Island::new(problem.genes()); ISLANDS];
    match env::args().nth(1) {
        Some(file) => {
            fs::write(file, described(&problem)?.to_string())?;
        }
        None => {
            for adapter in gpu::adapters() {
                let mut on = Gpu::new(&problem, &islands, Which::Named(adapter.name.clone()))?;
                timed(&adapter.name, |from, to| on.advance(from, to, || false))?;
            }
            timed(&cpu::describe(), |from, to| {
                cpu::advance(&problem, &mut islands, from, to, || false)
            })?;
        }
    }
    Ok(())
}

/// Prints how fast generations go, which `run` does from one to another, after two that do not count.
fn timed<E: Error + 'static>(
    place: &str,
    mut run: impl FnMut(u32, u32) -> Result<u32, E>,
) -> Result<(), Box<dyn Error>> {
    run(0, 2)?;
    let began = Instant::now();
    run(2, 2 + TIMED)?;
    let frames = f64::from(TIMED) * (ISLANDS * ISLAND * MOTIONS * FRAMES) as f64;
    println!(
        "{:.2} {place}",
        frames / began.elapsed().as_secs_f64() / 1e6
    );
    Ok(())
}

/// The settings, the tasks, and each candidate with its score in metres: by the scalar `f32`, whose bits the lanes'
/// are.
fn described(problem: &Problem) -> Result<serde_json::Value, Box<dyn Error>> {
    let ready = problem.tasks.iter().map(Ready::<f32, 7>::new);
    let ready: Vec<_> = ready.collect::<Result<_, _>>()?;
    let candidates = (1..=ISLANDS * ISLAND).map(|n| {
        let primes = [2.0f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0];
        let parameters: [f32; 9] = std::array::from_fn(|k| {
            let [lower, upper] = RANGES[k.saturating_sub(6)];
            (lower + (n as f64 * primes[k].sqrt()).fract() * (upper - lower)) as f32
        });
        let scores = ready
            .iter()
            .map(|motion| motion.score(&problem.settings, &parameters));
        json!({ "parameters": parameters, "score": scores.sum::<f32>() / MOTIONS as f32 })
    });
    let tasks = problem.tasks.iter().map(|task| {
        json!({
            "chain": task.chain, "initial": task.initial, "target": task.target, "reference": task.reference,
        })
    });
    Ok(json!({
        "settings": problem.settings,
        "tasks": tasks.collect::<Vec<_>>(),
        "candidates": candidates.collect::<Vec<_>>(),
    }))
}
