//! The search from beginning to end: generations on a backend, progress, stopping, going on, and the winners scored
//! again.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::gpu::{Gpu, GpuError};
use crate::kernel::anneal::Island;
use crate::kernel::proposal::{ISLAND, parameter};
use crate::problem::Problem;
use crate::synergies::score;
use crate::task::TaskError;
use crate::{cpu, output};

/// The stop rule is looked at every so many generations, so that it does not depend on how fast the machine is.
const GENERATIONS_A_LOOK: u32 = 32;

/// The search has settled when the population's mean score fell by less than this share since half as many
/// generations ago.
const SETTLED: f64 = 0.005;

/// Fewer generations than this are never called settled: twice the last of [`ROUNDS`], so that the means compared are
/// those of the islands that are left.
const LEAST_GENERATIONS: u32 = 1024;

/// The generations after which of each set's islands the best quarter goes on alone.
///
/// A motion has many valleys, and an island settles in one. Many islands look for valleys, few go to their ends:
/// successive halving (Karnin, Koren and Somekh 2013; Jamieson and Talwalkar 2016).
const ROUNDS: [u32; 2] = [128, 512];

/// A checkpoint is written at least this often, seconds.
const CHECKPOINT_EVERY: f64 = 20.0;

/// The islands are brought to the host at least this often, seconds: no more is lost when a device is.
const READ_EVERY: f64 = 2.0;

/// What goes wrong while learning.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// A task is wrong.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The device failed and may not be replaced.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The checkpoint cannot be written.
    #[error("{path}: {error}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
}

/// Where generations run.
pub enum Backend {
    /// SIMD lanes and threads.
    Cpu,
    /// The device, with the population on it.
    Gpu {
        /// The device.
        device: Box<Gpu>,
        /// Whether the CPU may take over when the device fails.
        or_cpu: bool,
    },
}

/// How far a search is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Search {
    /// Generations that ran.
    pub generation: u32,
    /// The population: the islands of set 0 that are left, then those of set 1, and so on, as many of each.
    pub islands: Vec<Island>,
    /// Motions that were synthesised and compared.
    pub evaluations: u64,
    /// Seconds it took so far.
    pub seconds: f64,
    /// The population's mean score (metres) at every look.
    means: Vec<f64>,
    settled: bool,
}

/// What [`Search::run`] tells while it runs.
pub struct Progress {
    /// Generations that ran.
    pub generation: u32,
    /// The mean over the sets of the best distance so far, metres.
    pub best: f64,
    /// The population's mean distance, metres.
    pub mean: f64,
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// The population's mean has settled.
    Settled,
    /// All generations ran.
    Budget,
    /// It was told to stop.
    Stopped,
}

impl Search {
    /// Before the first generation.
    pub fn new(problem: &Problem) -> Self {
        let count = problem.sets.len() * problem.islands;
        Search {
            generation: 0,
            islands: vec![Island::new(problem.genes()); count],
            evaluations: 0,
            seconds: 0.0,
            means: Vec::new(),
            settled: false,
        }
    }

    /// Runs until the search has settled, `generations` have run, or `stop` is set. `checkpoint`, where there is one,
    /// is where the state is kept meanwhile; `report` is told how it goes, and in words what is out of the ordinary.
    ///
    /// # Errors
    /// A task that the core refuses, a device that fails where the CPU may not take over, or a checkpoint that cannot
    /// be written.
    pub fn run(
        &mut self,
        problem: &Problem,
        backend: &mut Backend,
        generations: u32,
        stop: &AtomicBool,
        checkpoint: Option<&Checkpoint>,
        mut report: impl FnMut(Result<Progress, String>),
    ) -> Result<Ended, LearnError> {
        let before = self.seconds;
        let began = Instant::now();
        let (mut saved, mut read) = (0.0, 0.0);
        let mut held = self.held();
        let mut left = self.left(problem);
        if self.generation > 0
            && let Err(error) = put_on(backend, &left, &self.islands)
        {
            report(Err(self.fall_back(backend, &held, error)?));
        }
        while !self.settled && self.generation < generations {
            let look = (self.generation / GENERATIONS_A_LOOK + 1) * GENERATIONS_A_LOOK;
            let advanced = self.advance(&left, backend, look.min(generations), stop);
            let mut summaries = match advanced {
                Ok(summaries) => summaries,
                Err(error) => {
                    // What is here is the last read-back, whole: nothing but the time since is lost.
                    report(Err(self.fall_back(backend, &held, error)?));
                    continue;
                }
            };
            let elapsed = began.elapsed().as_secs_f64();
            self.seconds = before + elapsed;
            // A stop can end an advance where it began: a round that has ended does not end again.
            if self.generation == look && self.ends_a_round(&left) {
                if let Err(error) = self.read_back(backend) {
                    report(Err(self.fall_back(backend, &held, error)?));
                    continue;
                }
                self.cull(&left);
                left = self.left(problem);
                (read, held) = (elapsed, self.held());
                if let Err(error) = put_on(backend, &left, &self.islands) {
                    report(Err(self.fall_back(backend, &held, error)?));
                }
                summaries = self.islands.iter().map(summary).collect();
            }
            let progress = progress(self.generation, &left, &summaries);
            if self.generation == look {
                self.look(progress.mean);
            }
            let stopped = stop.load(Ordering::Relaxed) && self.generation < generations;
            let save = checkpoint.filter(|_| stopped || elapsed - saved > CHECKPOINT_EVERY);
            let over = stopped || self.settled || self.generation == generations;
            if save.is_some() || over || elapsed - read > READ_EVERY {
                if let Err(error) = self.read_back(backend) {
                    report(Err(self.fall_back(backend, &held, error)?));
                    continue;
                }
                (read, held) = (elapsed, self.held());
            }
            report(Ok(progress));

            if let Some(checkpoint) = save {
                checkpoint.write(self)?;
                saved = elapsed;
            }
            if stopped {
                return Ok(Ended::Stopped);
            }
        }
        Ok(if self.settled {
            Ended::Settled
        } else {
            Ended::Budget
        })
    }

    /// Goes on with the CPU where that is allowed, from where the islands were read back last, and says so.
    fn fall_back(
        &mut self,
        backend: &mut Backend,
        held: &Held,
        error: LearnError,
    ) -> Result<String, LearnError> {
        match (&*backend, error) {
            (Backend::Gpu { or_cpu: true, .. }, LearnError::Gpu(error)) => {
                *backend = Backend::Cpu;
                self.generation = held.generation;
                self.evaluations = held.evaluations;
                self.means.truncate(held.looks);
                self.settled = false;
                let generation = self.generation;
                Ok(format!(
                    "{error}; going on with the CPU from generation {generation}"
                ))
            }
            (_, error) => Err(error),
        }
    }

    /// How far the islands that are here now are.
    fn held(&self) -> Held {
        Held {
            generation: self.generation,
            evaluations: self.evaluations,
            looks: self.means.len(),
        }
    }

    /// Brings the islands here from where they run.
    fn read_back(&mut self, backend: &mut Backend) -> Result<(), LearnError> {
        if let Backend::Gpu { device, .. } = backend {
            self.islands = device.islands()?;
        }
        Ok(())
    }

    /// The problem as it is for the islands that are left.
    pub fn left(&self, problem: &Problem) -> Problem {
        let islands = self.islands.len() / problem.sets.len().max(1);
        Problem {
            islands,
            ..problem.clone()
        }
    }

    /// Whether a round ends here that leaves fewer islands.
    fn ends_a_round(&self, problem: &Problem) -> bool {
        ROUNDS.contains(&self.generation) && problem.islands > 1
    }

    /// Ends a round: the best islands of each set go on.
    fn cull(&mut self, problem: &Problem) {
        let kept = problem.islands.div_ceil(4);
        let mut left = Vec::with_capacity(kept * problem.sets.len());
        for set in self.islands.chunks_mut(problem.islands) {
            set.sort_by(|a, b| a.best_score.total_cmp(&b.best_score));
            left.extend(set.iter().take(kept).cloned());
        }
        self.islands = left;
    }

    /// Runs to a generation: what there is to say of each island then.
    fn advance(
        &mut self,
        problem: &Problem,
        backend: &mut Backend,
        to: u32,
        stop: &AtomicBool,
    ) -> Result<Vec<(f32, f32)>, LearnError> {
        let from = self.generation;
        let (reached, summaries) = match backend {
            Backend::Cpu => {
                let reached = cpu::advance(problem, &mut self.islands, from, to, stop)?;
                (reached, self.islands.iter().map(summary).collect())
            }
            // The islands stay there: of a large population only the summaries are moved at every look.
            Backend::Gpu { device, .. } => (device.advance(from, to, stop)?, device.summary()?),
        };
        self.generation = reached;
        let motions: usize = problem.sets.iter().map(Vec::len).sum();
        self.evaluations +=
            u64::from(self.generation - from) * (problem.population() * motions) as u64;
        Ok(summaries)
    }

    /// Whether every island has as many members and genes as it should.
    fn is_whole(&self, genes: usize) -> bool {
        self.islands.iter().all(|island| {
            island.genes.len() == genes
                && island.genes.iter().all(|row| row.len() == ISLAND)
                && island.scores.len() == ISLAND
                && island.best.len() == genes
        })
    }

    /// Notes the population's mean at a look, and whether it has settled.
    fn look(&mut self, mean: f64) {
        self.means.push(mean);
        let half = self.means.len() / 2;
        let earlier = half.checked_sub(1).and_then(|k| self.means.get(k));
        self.settled = self.generation >= LEAST_GENERATIONS
            && earlier.is_some_and(|&earlier| earlier - mean < SETTLED * mean);
    }

    /// Each set's best parameters, chosen among its islands' bests by the core in `f64`, with the distance in metres
    /// of each of the set's motions.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn winners(&self, problem: &Problem) -> Result<Vec<Winner>, TaskError> {
        let bounds = problem.settings.bounds(problem.dofs());
        let islands = self.islands.chunks(self.left(problem).islands.max(1));
        let winner = |(set, islands): (&Vec<usize>, &[Island])| {
            let mut winner = Winner {
                parameters: Vec::new(),
                distances: Vec::new(),
            };
            let mut least = f64::INFINITY;
            for island in islands {
                let genes = island.best.iter().zip(&bounds);
                let parameters: Vec<f64> = genes
                    .map(|(&gene, &bounds)| f64::from(parameter(gene, bounds)))
                    .collect();
                let tasks = set.iter().filter_map(|&task| problem.tasks.get(task));
                let distances = tasks
                    .map(|task| score(&problem.settings, task, &parameters))
                    .collect::<Result<Vec<f64>, _>>()?;
                let sum: f64 = distances.iter().sum();
                if sum < least || winner.parameters.is_empty() {
                    least = sum;
                    winner = Winner {
                        parameters,
                        distances,
                    };
                }
            }
            Ok(winner)
        };
        problem.sets.iter().zip(islands).map(winner).collect()
    }
}

/// How far the islands are that are on the host, and what goes with them.
struct Held {
    generation: u32,
    evaluations: u64,
    looks: usize,
}

/// An island's best score ever, and its members' mean score, metres: summed as `anneal.wgsl` does.
fn summary(island: &Island) -> (f32, f32) {
    let sum = island.scores.iter().fold(0.0, |sum, score| sum + score);
    (island.best_score, sum / ISLAND as f32)
}

/// How it goes, from each island's summary.
fn progress(generation: u32, problem: &Problem, summaries: &[(f32, f32)]) -> Progress {
    let best = |set: &[(f32, f32)]| {
        let bests = set.iter().map(|&(best, _)| best);
        f64::from(bests.fold(f32::INFINITY, f32::min))
    };
    let sets = summaries.chunks(problem.islands.max(1));
    let means = summaries.iter().map(|&(_, mean)| f64::from(mean));
    Progress {
        generation,
        best: sets.map(best).sum::<f64>() / problem.sets.len().max(1) as f64,
        mean: means.sum::<f64>() / summaries.len().max(1) as f64,
    }
}

/// Round after round of a search: how many islands of each set run, and for how many of its generations.
pub(crate) fn rounds(islands: usize, generations: u32) -> Vec<(usize, u32)> {
    let (mut at, mut left, mut rounds) = (0, islands, Vec::new());
    for end in ROUNDS.into_iter().chain([generations]) {
        let end = end.clamp(at, generations.max(at));
        if at < end {
            rounds.push((left, end - at));
        }
        (at, left) = (end, left.div_ceil(4));
    }
    rounds
}

/// Gives a device the islands that there are now.
fn put_on(backend: &mut Backend, problem: &Problem, islands: &[Island]) -> Result<(), LearnError> {
    match backend {
        Backend::Gpu { device, .. } => Ok(device.replace(problem, islands)?),
        Backend::Cpu => Ok(()),
    }
}

/// A set's best parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Winner {
    /// In the SPEC's order.
    pub parameters: Vec<f64>,
    /// The distance of each of the set's motions, metres.
    pub distances: Vec<f64>,
}

/// Where a search's state is kept while it runs, and which search it is of.
#[derive(Clone, Debug)]
pub struct Checkpoint {
    path: PathBuf,
    /// All that the search's outcome depends on but the number of generations.
    identity: String,
    genes: usize,
}

/// What a checkpoint's file is found to hold.
#[derive(Clone, Debug, PartialEq)]
pub enum Kept {
    /// The search.
    Search(Box<Search>),
    /// Another search, or nothing that can be read.
    Other,
    /// There is no file.
    Nothing,
}

/// What the file holds.
#[derive(Serialize, Deserialize)]
struct File<S> {
    identity: String,
    search: S,
}

impl Checkpoint {
    /// The checkpoint of a problem in a folder. `backend` is part of it: backends agree in their draws, but not in the
    /// last bits of every score.
    pub fn new(folder: &Path, problem: &Problem, backend: &str) -> Self {
        // Debug prints every number with all its digits.
        let identity = format!("1 {backend} {problem:?}");
        Checkpoint {
            path: folder.join("learning.checkpoint"),
            identity,
            genes: problem.genes(),
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The state kept, where there is one of the same search.
    pub fn read(&self) -> Kept {
        let Ok(bytes) = std::fs::read(&self.path) else {
            return Kept::Nothing;
        };
        match postcard::from_bytes::<File<Search>>(&bytes) {
            Ok(file) if file.identity == self.identity && file.search.is_whole(self.genes) => {
                Kept::Search(Box::new(file.search))
            }
            _ => Kept::Other,
        }
    }

    fn write(&self, search: &Search) -> Result<(), LearnError> {
        let wrong = |error| LearnError::Checkpoint {
            path: self.path.clone(),
            error,
        };
        let file = File {
            identity: self.identity.clone(),
            search,
        };
        let bytes =
            postcard::to_stdvec(&file).map_err(|error| wrong(std::io::Error::other(error)))?;
        output::replace(&self.path, &bytes).map_err(wrong)
    }

    /// Removes it: the search is done.
    pub fn remove(&self) {
        // Where it was never written there is nothing to remove.
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{ModelKind, Settings, StepperKind};
    use crate::task::{Arm, Task, facing};

    fn problem() -> Problem {
        let reaches = crate::sample::shipped().unwrap();
        let arm = Arm::Human(facing(&reaches));
        let tasks: Vec<Task> = reaches[..2]
            .iter()
            .map(|reach| Task::new(reach, &arm, 60.0).unwrap())
            .collect();
        let settings = Settings {
            stepper: StepperKind::Transpose,
            model: ModelKind::C,
            lambda: 100.0,
            rate_hz: 60.0,
            clamped: false,
        };
        Problem {
            settings,
            tasks,
            sets: vec![vec![0], vec![1]],
            islands: 2,
            seed: 5,
        }
    }

    fn run(search: &mut Search, problem: &Problem, generations: u32) -> Ended {
        let stop = AtomicBool::new(false);
        search
            .run(problem, &mut Backend::Cpu, generations, &stop, None, |_| {})
            .unwrap()
    }

    #[test]
    fn a_search_that_goes_on_is_the_one_that_never_stopped() {
        let problem = problem();
        let mut whole = Search::new(&problem);
        run(&mut whole, &problem, 70);

        let folder = tempfile::tempdir().unwrap();
        let checkpoint = Checkpoint::new(folder.path(), &problem, "cpu");
        let mut first = Search::new(&problem);
        run(&mut first, &problem, 33);
        checkpoint.write(&first).unwrap();
        let Kept::Search(mut second) = checkpoint.read() else {
            panic!("nothing kept");
        };
        run(&mut second, &problem, 70);

        assert_eq!(whole.islands, second.islands);
        assert_eq!(whole.means, second.means);
    }

    #[test]
    fn a_checkpoint_of_another_search_is_not_taken() {
        let folder = tempfile::tempdir().unwrap();
        let mut problem = problem();
        Checkpoint::new(folder.path(), &problem, "cpu")
            .write(&Search::new(&problem))
            .unwrap();
        problem.seed += 1;
        let checkpoint = Checkpoint::new(folder.path(), &problem, "cpu");
        assert_eq!(checkpoint.read(), Kept::Other);
        std::fs::write(checkpoint.path(), b"damaged").unwrap();
        assert_eq!(checkpoint.read(), Kept::Other);
        checkpoint.remove();
        assert_eq!(checkpoint.read(), Kept::Nothing);
    }

    #[test]
    fn what_is_reported_is_the_f64_score_and_near_the_lanes_own() {
        let problem = problem();
        let mut search = Search::new(&problem);
        run(&mut search, &problem, 64);
        for (winner, islands) in search
            .winners(&problem)
            .unwrap()
            .iter()
            .zip(search.islands.chunks(2))
        {
            let best = islands
                .iter()
                .map(|island| island.best_score)
                .fold(f32::INFINITY, f32::min);
            assert!((winner.distances[0] / f64::from(best) - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn two_runs_with_the_same_seed_are_the_same_and_with_another_are_not() {
        let mut problem = problem();
        let [mut a, mut b, mut c] = [(); 3].map(|()| Search::new(&problem));
        run(&mut a, &problem, 8);
        run(&mut b, &problem, 8);
        assert_eq!(a.islands, b.islands);
        problem.seed = 6;
        run(&mut c, &problem, 8);
        assert_ne!(a.islands, c.islands);
    }

    #[test]
    fn rounds_leave_the_best_islands_and_never_lose_the_best() {
        let problem = Problem {
            islands: 5,
            ..problem()
        };
        let mut search = Search::new(&problem);
        run(&mut search, &problem, 127);
        let least = |islands: &[Island]| {
            islands
                .iter()
                .map(|island| island.best_score)
                .fold(f32::INFINITY, f32::min)
        };
        let before: Vec<f32> = search.islands.chunks(5).map(least).collect();
        run(&mut search, &problem, 160);
        assert_eq!(search.islands.len(), 2 * 2);
        for (set, before) in search.islands.chunks(2).zip(before) {
            assert!(least(set) <= before);
        }
        run(&mut search, &problem, 520);
        assert_eq!(search.islands.len(), 2);
        assert_eq!(search.evaluations, 64 * 2 * (128 * 5 + 384 * 2 + 8));
    }

    #[test]
    fn rounds_have_all_the_generations_and_a_quarter_of_the_islands_each() {
        assert_eq!(rounds(32, 2000), [(32, 128), (8, 384), (2, 1488)]);
        assert_eq!(rounds(1, 200), [(1, 128), (1, 72)]);
        assert_eq!(rounds(5, 100), [(5, 100)]);
    }

    #[test]
    fn a_budget_ends_a_search_and_so_does_a_population_that_has_settled() {
        let problem = problem();
        let mut search = Search::new(&problem);
        assert_eq!(run(&mut search, &problem, 40), Ended::Budget);
        assert_eq!(run(&mut search, &problem, 100_000), Ended::Settled);
        assert!(search.generation < 100_000);
    }
}
