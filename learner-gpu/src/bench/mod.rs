//! How fast each place is that a search can run on, and how far from what its device could do at most.
//!
//! The unit is a million candidate·motion·frames a second: one tick of one member on one motion, with its share of
//! proposing and accepting. A round measures every path in turn, so that what else the machine does hits all alike.

mod count;
mod peak;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;
use sinew::real::Real;
use sinew::synergy::Model;

pub use count::Operations;

use crate::cpu::{self, SimdLevel};
use crate::gpu::{self, Adapter, Gpu, GpuError, Which};
use crate::kernel::anneal::Island;
use crate::kernel::philox::key;
use crate::kernel::proposal::{Draws, ISLAND, first, parameter};
use crate::kernel::score::Ready;
use crate::learn::Search;
use crate::problem::{ModelKind, Problem, Settings, StepperKind};
use crate::task::{Task, TaskError};
use count::Counted;

/// DoFs of the human arm, which is what is measured.
const DOFS: usize = 7;
/// Members whose operations are counted, on so many motions.
const COUNTED: (usize, usize) = (64, 4);

/// What is measured: one of each axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Case {
    /// The inverse kinematics.
    pub stepper: StepperKind,
    /// The synergy.
    pub model: ModelKind,
    /// Motions, each with a population of its own.
    pub motions: usize,
    /// Members of each population, a multiple of [`ISLAND`].
    pub population: usize,
}

/// A way to compute.
#[derive(Clone, Debug)]
pub enum Path {
    /// The core in `f64`, one thread.
    Double,
    /// The core in `f32`, one thread.
    Single,
    /// SIMD lanes on so many threads.
    Lanes {
        /// The instructions.
        level: SimdLevel,
        /// The threads.
        threads: usize,
    },
    /// A device.
    Device(Adapter),
}

impl Path {
    /// All that this machine has.
    pub fn all() -> Vec<Path> {
        let mut paths = vec![Path::Double, Path::Single];
        let every = rayon::current_num_threads();
        let counts: &[usize] = if every > 1 { &[1, every] } else { &[1] };
        for &threads in counts {
            let levels = SimdLevel::all().into_iter();
            paths.extend(levels.map(|level| Path::Lanes { level, threads }));
        }
        paths.extend(gpu::adapters().into_iter().map(Path::Device));
        paths
    }

    /// What it is called.
    pub fn name(&self) -> String {
        match self {
            Path::Double => "scalar f64, 1 thread".to_owned(),
            Path::Single => "scalar f32, 1 thread".to_owned(),
            Path::Lanes { level, threads: 1 } => format!("{} lanes, 1 thread", level.name()),
            Path::Lanes { level, threads } => format!("{} lanes, {threads} threads", level.name()),
            Path::Device(adapter) => format!("gpu: {}", adapter.name),
        }
    }

    /// Floating-point operations a second that its device does at most, measured over `seconds`. For a scalar that is
    /// what the thread's widest lanes do.
    ///
    /// # Errors
    /// The device fails.
    pub fn peak(&self, seconds: f64) -> Result<f64, BenchError> {
        match self {
            Path::Double | Path::Single => {
                Ok(peak::operations_a_second(SimdLevel::widest(), seconds))
            }
            Path::Lanes { level, threads } => {
                let each =
                    pool(*threads)?.broadcast(|_| peak::operations_a_second(*level, seconds));
                Ok(each.iter().sum())
            }
            Path::Device(adapter) => Ok(gpu::peak::operations_a_second(&named(adapter), seconds)?),
        }
    }
}

/// The adapter again.
fn named(adapter: &Adapter) -> Which {
    Which::Named(adapter.name.clone())
}

fn pool(threads: usize) -> Result<ThreadPool, BenchError> {
    let made = ThreadPoolBuilder::new().num_threads(threads).build();
    made.map_err(|error| BenchError::Threads(error.to_string()))
}

/// Why something was not measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BenchError {
    /// A task is wrong.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The device fails.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// No threads.
    #[error("no threads: {0}")]
    Threads(String),
}

/// How long it takes until a device has done its first dispatch, seconds.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct StartUp {
    /// To find the adapter and open it.
    pub device: f64,
    /// To compile the kernel, upload the problem and run a first dispatch.
    pub kernel: f64,
}

/// How much to measure.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Times that each path is measured, after one that does not count.
    pub rounds: usize,
    /// What one of them takes, seconds: more where one generation does.
    pub seconds: f64,
    /// Where a generation has more ticks than this, only as many motions run as stay below, but at least one: each has
    /// a population of its own, so a rate is the same.
    pub most_ticks: u64,
}

/// The rates of one path: million candidate·motion·frames a second, round by round.
#[derive(Clone, Debug, Serialize)]
pub struct Rates(Vec<f64>);

impl Rates {
    /// The middle one.
    pub fn median(&self) -> f64 {
        median(self.0.clone())
    }

    /// The least and the greatest.
    pub fn range(&self) -> (f64, f64) {
        let of = |pick: fn(f64, f64) -> f64| self.0.iter().copied().reduce(pick);
        let (least, greatest) = (of(f64::min), of(f64::max));
        (least.unwrap_or(f64::NAN), greatest.unwrap_or(f64::NAN))
    }

    /// How many times another path's: the median over the rounds, in each of which both were measured one after the other.
    pub fn to(&self, other: &Rates) -> f64 {
        median(self.0.iter().zip(&other.0).map(|(a, b)| a / b).collect())
    }
}

/// The middle one, NaN of nothing.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let (below, above) = (values.len().saturating_sub(1) / 2, values.len() / 2);
    let at = |k: usize| values.get(k).copied().unwrap_or(f64::NAN);
    (at(below) + at(above)) / 2.0
}

/// What is measured on: the motions, cycled to as many as a case asks for.
pub struct Bench {
    tasks: Vec<Task>,
}

impl Bench {
    /// On these motions of a human arm.
    ///
    /// # Errors
    /// No motion, or one of an arm with another number of DoFs.
    pub fn new(tasks: Vec<Task>) -> Result<Self, BenchError> {
        let found = tasks.first().map_or(0, |task| task.chain.joints.len());
        match tasks.iter().all(|task| task.chain.joints.len() == DOFS) && found == DOFS {
            true => Ok(Bench { tasks }),
            false => Err(TaskError::Dofs { found }.into()),
        }
    }

    /// A case as a problem.
    fn problem(&self, case: &Case, most_ticks: u64) -> Problem {
        let islands = case.population.div_ceil(ISLAND).max(1);
        let mut ticks = 0;
        let tasks = self.tasks.iter().cycle().take(case.motions);
        let fit = tasks.take_while(|task| {
            ticks += (task.reference.len() * islands * ISLAND) as u64;
            ticks <= most_ticks || ticks == (task.reference.len() * islands * ISLAND) as u64
        });
        let tasks: Vec<Task> = fit.cloned().collect();
        Problem {
            settings: Settings {
                stepper: case.stepper,
                model: case.model,
                lambda: case.stepper.rate(),
                rate_hz: 60.0,
                clamped: false,
            },
            sets: (0..tasks.len()).map(|task| vec![task]).collect(),
            tasks,
            islands,
            seed: 1,
        }
    }

    /// The operations of a frame: of random members on a few of the motions, the mean.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn operations(
        &self,
        stepper: StepperKind,
        model: ModelKind,
    ) -> Result<Operations, BenchError> {
        let (members, motions) = COUNTED;
        let case = Case {
            stepper,
            model,
            motions,
            population: members,
        };
        let problem = self.problem(&case, u64::MAX);
        let runs = Scalar::<Counted>::new(&problem)?;
        Ok(count::counted(|| {
            (0..members * motions).map(|k| runs.score(k)).sum()
        }))
    }

    /// How long a device takes to start: it, and a kernel for a case.
    ///
    /// # Errors
    /// The device fails.
    pub fn start_up(&self, case: &Case, adapter: &Adapter) -> Result<StartUp, BenchError> {
        let problem = self.problem(case, u64::MAX);
        let islands = Search::new(&problem).islands;
        let began = Instant::now();
        let gpu = Gpu::new(&problem, &islands, named(adapter))?;
        let all = began.elapsed().as_secs_f64();
        let kernel = gpu.preparation().as_secs_f64();
        Ok(StartUp {
            device: all - kernel,
            kernel,
        })
    }

    /// The rates of each path, or why there are none. Where `stop` was set there is nothing.
    pub fn measure(
        &self,
        case: &Case,
        paths: &[Path],
        effort: &Effort,
        stop: &AtomicBool,
    ) -> Option<Vec<Result<Rates, BenchError>>> {
        let problem = self.problem(case, effort.most_ticks);
        let mut runners: Vec<Result<Runner, BenchError>> = paths
            .iter()
            .map(|path| Runner::new(path, &problem, effort))
            .collect();
        let mut rates = vec![Vec::new(); paths.len()];
        for _round in 0..effort.rounds {
            for (runner, rates) in runners.iter_mut().zip(&mut rates) {
                if stop.load(Ordering::Relaxed) {
                    return None;
                }
                if let Ok(running) = runner {
                    match running.run(&problem, effort) {
                        Ok(rate) => rates.push(rate),
                        Err(error) => *runner = Err(error),
                    }
                }
            }
        }
        let rates = rates.into_iter().zip(runners);
        Some(
            rates
                .map(|(rates, runner)| runner.map(|_| Rates(rates)))
                .collect(),
        )
    }
}

/// A path that is ready to run a case.
enum Runner {
    Double(Scalar<f64>),
    Single(Scalar<f32>),
    Lanes {
        level: SimdLevel,
        pool: ThreadPool,
        islands: Vec<Island>,
        generations: Generations,
    },
    Device {
        gpu: Box<Gpu>,
        generations: Generations,
    },
}

impl Runner {
    fn new(path: &Path, problem: &Problem, effort: &Effort) -> Result<Self, BenchError> {
        let mut runner = match path {
            Path::Double => Runner::Double(Scalar::new(problem)?),
            Path::Single => Runner::Single(Scalar::new(problem)?),
            Path::Lanes { level, threads } => Runner::Lanes {
                level: *level,
                pool: pool(*threads)?,
                islands: Search::new(problem).islands,
                generations: Generations { at: 0, a_round: 1 },
            },
            Path::Device(adapter) => Runner::Device {
                gpu: Box::new(Gpu::new(
                    problem,
                    &Search::new(problem).islands,
                    named(adapter),
                )?),
                generations: Generations { at: 0, a_round: 1 },
            },
        };
        // How many generations a round has, from one that does not count.
        let began = Instant::now();
        runner.run(problem, effort)?;
        let took = began.elapsed().as_secs_f64().max(1e-6);
        if let Runner::Lanes { generations, .. } | Runner::Device { generations, .. } = &mut runner
        {
            generations.a_round = (effort.seconds / took).clamp(1.0, 1e4) as u32;
        }
        Ok(runner)
    }

    /// One round: its rate.
    fn run(&mut self, problem: &Problem, effort: &Effort) -> Result<f64, BenchError> {
        let began = Instant::now();
        let ticks = match self {
            Runner::Double(scalar) => scalar.run(effort.seconds),
            Runner::Single(scalar) => scalar.run(effort.seconds),
            Runner::Lanes {
                level,
                pool,
                islands,
                generations,
            } => {
                let (from, to) = generations.next();
                pool.install(|| cpu::advance_on(*level, problem, islands, from, to, || false))?;
                problem.frames_a_generation() * u64::from(to - from)
            }
            Runner::Device { gpu, generations } => {
                let (from, to) = generations.next();
                gpu.advance(from, to, || false)?;
                problem.frames_a_generation() * u64::from(to - from)
            }
        };
        Ok(ticks as f64 / began.elapsed().as_secs_f64() / 1e6)
    }
}

/// Which generations run next.
struct Generations {
    at: u32,
    a_round: u32,
}

impl Generations {
    fn next(&mut self) -> (u32, u32) {
        let from = self.at;
        self.at += self.a_round;
        (from, self.at)
    }
}

/// The motions made ready for a scalar, and random members to score on them.
struct Scalar<T> {
    settings: Settings,
    motions: Vec<Ready<T, DOFS>>,
    frames: Vec<u64>,
    members: Vec<Vec<T>>,
    next: usize,
}

impl<T: Real> Scalar<T> {
    fn new(problem: &Problem) -> Result<Self, BenchError> {
        let bounds = problem.settings.bounds(DOFS);
        let count = Model::from(problem.settings.model).parameters(DOFS);
        let member = |member| {
            let draws = Draws {
                seed: key(problem.seed),
                set: 0,
                member,
                generation: 0,
            };
            let genes = first(&draws, count);
            let genes = genes.iter().zip(&bounds);
            genes
                .map(|(&gene, &bounds)| T::of(f64::from(parameter(gene, bounds))))
                .collect()
        };
        let motions = problem.tasks.iter().map(Ready::new);
        Ok(Scalar {
            settings: problem.settings,
            motions: motions.collect::<Result<_, _>>()?,
            frames: problem
                .tasks
                .iter()
                .map(|task| task.reference.len() as u64)
                .collect(),
            members: (0..ISLAND as u32).map(member).collect(),
            next: 0,
        })
    }

    /// Scores a member on a motion, the `k`th of all pairs: how many frames that took.
    #[inline(never)]
    fn score(&self, k: usize) -> u64 {
        let (motion, member) = (k % self.motions.len(), k / self.motions.len());
        let member = &self.members[member % self.members.len()];
        std::hint::black_box(self.motions[motion].score(&self.settings, member));
        self.frames[motion]
    }

    /// Scores for so long: how many frames that took.
    fn run(&mut self, seconds: f64) -> u64 {
        let began = Instant::now();
        let mut ticks = 0;
        while began.elapsed().as_secs_f64() < seconds {
            ticks += self.score(self.next);
            self.next += 1;
        }
        ticks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample;
    use crate::task::{Arm, facing};

    fn bench() -> Bench {
        let reaches = sample::shipped().unwrap();
        let arm = Arm::Human(facing(&reaches));
        let tasks = reaches.iter().take(2);
        Bench::new(
            tasks
                .map(|reach| Task::new(reach, &arm, 60.0).unwrap())
                .collect(),
        )
        .unwrap()
    }

    const CASE: Case = Case {
        stepper: StepperKind::Transpose,
        model: ModelKind::C,
        motions: 3,
        population: 100,
    };

    #[test]
    fn rates_are_compared_round_by_round() {
        // The machine was busy in the first round while the first was measured, and fast in the last for both.
        let (a, b) = (Rates(vec![1.0, 4.0, 8.0]), Rates(vec![1.0, 1.0, 2.0]));
        assert_eq!((a.median(), b.median(), a.to(&b)), (4.0, 1.0, 4.0));
        assert_eq!(b.range(), (1.0, 2.0));
        assert!(Rates(Vec::new()).to(&b).is_nan());
    }

    #[test]
    fn every_path_of_this_machine_is_measured() {
        let effort = Effort {
            rounds: 3,
            seconds: 0.002,
            most_ticks: u64::MAX,
        };
        let paths = Path::all();
        let rates = bench()
            .measure(&CASE, &paths, &effort, &AtomicBool::new(false))
            .unwrap();
        for (path, rates) in paths.iter().zip(rates) {
            let rates = rates.unwrap();
            let (least, greatest) = rates.range();
            assert!(0.0 < least && least <= rates.median() && rates.median() <= greatest);
            assert!(path.peak(0.01).unwrap() > 1e8, "{}", path.name());
        }
        let stopped = AtomicBool::new(true);
        assert!(
            bench()
                .measure(&CASE, &paths[..1], &effort, &stopped)
                .is_none()
        );
    }

    #[test]
    fn a_case_takes_its_motions_in_turn_and_leaves_out_what_takes_too_long() {
        let bench = bench();
        let problem = bench.problem(&CASE, u64::MAX);
        assert_eq!((problem.tasks.len(), problem.population()), (3, 128));
        assert_eq!(problem.tasks[0], problem.tasks[2]);
        assert_eq!(bench.problem(&CASE, 1).sets.len(), 1);
    }

    #[test]
    fn a_richer_model_and_a_decomposition_take_more_operations() {
        let bench = bench();
        let total = |stepper, model| bench.operations(stepper, model).unwrap().total();
        let plain = total(StepperKind::Transpose, ModelKind::A);
        assert!((300.0..800.0).contains(&plain), "{plain}");
        assert!(total(StepperKind::Transpose, ModelKind::D) > plain);
        assert!(total(StepperKind::PseudoInverse, ModelKind::A) > plain);
        let damped = bench.operations(StepperKind::Damped, ModelKind::A).unwrap();
        // One for each of the three rows of the task, in every tick.
        assert!(damped.divisions > 2.5);
    }
}
