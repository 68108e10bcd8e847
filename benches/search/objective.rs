//! The learner's side of the comparison with other optimisers: its own results, and the score they are to lower. And what
//! the search finds where it is not let stop.
//!
//! ```text
//! search ours STEPPER MODEL [SEED [GENERATIONS]]   # JSON: each motion's name, distance and share of evaluations
//! search objective STEPPER MODEL MOTION            # scores candidates for who asks through its input
//! search longer STEPPER MODEL SEED…                # for each seed what TIMES as many generations gain
//! ```
//!
//! A question is two `u32` (how many candidates; 0 for the lanes' score, 1 for the `f64` one) and the candidates'
//! parameters as shares of their bounds, `f64`. The answer is a score in metres for each, `f64`. All are little-endian.
//!
//! The motions are the 14 recorded reaches, or the sample where the recordings are not here.

use std::env;
use std::error::Error;
use std::io::{self, Read, Write};

use serde::de::DeserializeOwned;
use serde_json::json;
use sinew_learn::checkpoint::Keeper;
use sinew_learn::finish::Winner;
use sinew_learn::kernel::proposal::{GENE, parameter};
use sinew_learn::learn::{Backend, GENERATIONS_A_ROUND, Search};
use sinew_learn::problem::{Problem, mean};
use sinew_learn::refine::Landscape;
use sinew_learn::sample;
use sinew_learn::synergies::score;
use sinew_tests::reaches::{problem, recorded};

type Failure = Box<dyn Error>;

/// The default population of `sinew learn`.
const ISLANDS: usize = 8;
/// And the most generations.
const GENERATIONS: u32 = 1000;
/// So many times as many generations `longer` runs.
const TIMES: u32 = 10;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["ours", stepper, model, ref more @ ..] => {
            let mut problem = reaches(stepper, model)?;
            if let Some(seed) = more.first() {
                problem.seed = seed.parse()?;
            }
            let most = more.get(1).map_or(Ok(GENERATIONS), |most| most.parse())?;
            println!("{}", ours(&problem, most)?);
            Ok(())
        }
        ["objective", stepper, model, motion] => {
            let mut problem = reaches(stepper, model)?;
            problem.tasks = vec![problem.tasks.swap_remove(motion.parse()?)];
            problem.sets = vec![vec![0]];
            answer(&problem)
        }
        ["longer", stepper, model, ref seeds @ ..] => {
            let mut problem = reaches(stepper, model)?;
            println!("seed generations  mean cm generations  mean cm  gain");
            for seed in seeds {
                problem.seed = seed.parse()?;
                longer(&problem)?;
            }
            Ok(())
        }
        _ => Err("search ours|objective|longer STEPPER MODEL …".into()),
    }
}

/// A word of the command line, as files name it.
fn named<T: DeserializeOwned>(word: &str) -> Result<T, Failure> {
    Ok(serde_json::from_value(json!(word))?)
}

fn reaches(stepper: &str, model: &str) -> Result<Problem, Failure> {
    // `recorded` says on standard output if it finds nothing; that is for answers here.
    let reaches = match sinew_tests::shared_folder() {
        Some(_) => recorded().ok_or("no recordings")?,
        None => sample::shipped()?,
    };
    Ok(problem(&reaches, named(stepper)?, named(model)?, ISLANDS)?)
}

/// What the learner's search ends with.
fn ours(problem: &Problem, most: u32) -> Result<serde_json::Value, Failure> {
    let mut search = Search::new(problem);
    rounds(&mut search, problem, most)?;
    let winners = winners(&mut search, problem)?;
    let motions = problem.tasks.iter().zip(&winners).map(|(task, winner)| {
        json!({"name": task.name, "distance": winner.distances[0], "parameters": winner.parameters})
    });
    Ok(json!({
        "genes": problem.genes(),
        "motions": motions.collect::<Vec<_>>(),
        "generations": search.generation,
        "evaluations": search.evaluations / problem.sets.len() as u64,
        "seconds": search.seconds,
    }))
}

/// Runs rounds.
fn rounds(search: &mut Search, problem: &Problem, most: u32) -> Result<(), Failure> {
    search.run(problem, &mut Backend::Cpu, most, &Keeper::default(), |_| {})?;
    Ok(())
}

/// What has won after rounds that have run.
fn winners(search: &mut Search, problem: &Problem) -> Result<Vec<Winner>, Failure> {
    let winners = search.winners(problem, &Keeper::default())?;
    winners.ok_or("stopped".into())
}

/// Where the search ends, and where it does when it goes on though it has settled.
fn longer(problem: &Problem) -> Result<(), Failure> {
    let end = |search: &mut Search| {
        let winners = winners(search, problem)?;
        let distances = winners.iter().map(|winner| winner.distances[0]);
        Ok::<_, Failure>(100.0 * mean(distances))
    };
    let mut search = Search::new(problem);
    rounds(&mut search, problem, GENERATIONS)?;
    let (generations, first) = (search.generation, end(&mut search)?);
    while search.generation < TIMES * generations {
        search.unsettle();
        let most = search.generation + GENERATIONS_A_ROUND;
        rounds(&mut search, problem, most)?;
    }
    let last = end(&mut search)?;
    let gain = 100.0 * (1.0 - last / first);
    let seed = problem.seed;
    println!(
        "{seed:4} {generations:11} {first:8.4} {:11} {last:8.4} {gain:4.2} %",
        search.generation
    );
    Ok(())
}

/// Scores candidates until there are no more questions.
fn answer(problem: &Problem) -> Result<(), Failure> {
    let (mut input, mut output) = (io::stdin().lock(), io::stdout().lock());
    let bounds = problem.settings.bounds(problem.dofs());
    let landscape = Landscape::new(problem)?;
    let mut head = [0; 8];
    while input.read_exact(&mut head).is_ok() {
        let word =
            |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let mut bytes = vec![0; word(0) as usize * bounds.len() * 8];
        input.read_exact(&mut bytes)?;
        let shares = bytes.chunks_exact(8).map(|eight| {
            let share = f64::from_le_bytes(eight.try_into().unwrap_or_default());
            ((share * f64::from(GENE)).round() as u32).min(GENE)
        });
        let genes: Vec<u32> = shares.collect();
        let candidates = genes.chunks_exact(bounds.len());
        let scores: Vec<f64> = if word(4) == 0 {
            let asked: Vec<(usize, &[u32])> = candidates.map(|genes| (0, genes)).collect();
            landscape
                .scores(&asked)
                .into_iter()
                .map(f64::from)
                .collect()
        } else {
            let exactly = |genes: &[u32]| {
                let genes = genes.iter().zip(&bounds);
                let parameters: Vec<f64> = genes
                    .map(|(&gene, &bounds)| f64::from(parameter(gene, bounds)))
                    .collect();
                score(&problem.settings, &problem.tasks[0], &parameters)
            };
            candidates.map(exactly).collect::<Result<_, _>>()?
        };
        let answer: Vec<u8> = scores
            .iter()
            .flat_map(|score| score.to_le_bytes())
            .collect();
        output.write_all(&answer)?;
        output.flush()?;
    }
    Ok(())
}
