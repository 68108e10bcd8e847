//! What the commands that learn share: which recordings, how the search is set and shown, and what came of it.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use nalgebra::{Quaternion, UnitQuaternion};
use sinew_learn::chain::ChainDescription;
use sinew_learn::checkpoint::{Checkpoint, Keeper, Kept};
use sinew_learn::finish::Winner;
use sinew_learn::gpu::{self, Gpu, GpuError};
use sinew_learn::kernel::proposal::ISLAND;
use sinew_learn::learn::{Backend, Ended, LearnError, Progress, Search};
use sinew_learn::map::LearnedMap;
use sinew_learn::problem::{ModelKind, Problem, Settings, StepperKind};
use sinew_learn::recordings::{self, Recording};
use sinew_learn::synergies::{LearnedMotion, LimitsKind, Synergies, VERSION};
use sinew_learn::task::{Arm, Task, facing};
use sinew_learn::{choice, cpu, urdf};

use super::{Failure, can_be_put};

/// The options of every command that learns.
#[derive(clap::Args)]
pub struct Options {
    /// Recordings (CSV), or folders of them [default: the sample that ships with the project]
    recordings: Vec<PathBuf>,
    /// Where to compute [auto: on what is measured to be faster]
    #[arg(long, value_enum, default_value = "auto")]
    pub backend: BackendChoice,
    /// Members for each parameter vector, taken up to a multiple of 64
    #[arg(long, default_value_t = 512, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    population: u32,
    /// The most generations; it stops sooner once rounds gain nothing more
    #[arg(long, default_value_t = 1000, value_parser = clap::value_parser!(u32).range(1..=10_000_000))]
    pub generations: u32,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The controller's rate, Hz
    #[arg(long, default_value_t = 60.0)]
    rate: f64,
    /// Keep joints within their limits (the paper does not)
    #[arg(long)]
    clamp: bool,
    /// Learn for the chain of this URDF file instead of a human arm
    #[arg(long, value_name = "FILE", requires = "base", requires = "tip")]
    chain: Option<PathBuf>,
    /// The link that the chain begins at
    #[arg(long, value_name = "LINK", requires = "chain")]
    base: Option<String>,
    /// The link that is to reach
    #[arg(long, value_name = "LINK", requires = "chain")]
    tip: Option<String>,
    /// Compare a recording's landmark with the origin of a joint of --chain, as elbow=joint4; may be repeated
    #[arg(long, value_name = "LANDMARK=JOINT", requires = "chain", value_parser = pair)]
    landmark: Vec<(String, String)>,
}

/// Where to compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BackendChoice {
    /// What is measured to be faster
    Auto,
    /// A Vulkan, Metal or DirectX 12 adapter
    Gpu,
    /// SIMD lanes and threads
    Cpu,
}

/// The inverse kinematics of a command that learns with one.
#[derive(clap::Args)]
pub struct Steering {
    /// The inverse kinematics that the synergy steers
    #[arg(long, value_enum, default_value = "transpose")]
    pub stepper: StepperKind,
    /// The stepper's rate λ [default: the stepper's own, 100 for transpose, 10 for the others]
    #[arg(long)]
    pub lambda: Option<f64>,
}

/// LANDMARK=JOINT.
fn pair(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some(("hand", _)) => Err("the hand is compared with --tip, always".to_owned()),
        Some((landmark, joint)) if !landmark.is_empty() && !joint.is_empty() => {
            Ok((landmark.to_owned(), joint.to_owned()))
        }
        _ => Err("expected LANDMARK=JOINT, such as elbow=joint4".to_owned()),
    }
}

impl Options {
    /// The recordings that are named, or the sample.
    pub fn recordings(&self) -> Result<Vec<Recording>, Failure> {
        match self.recordings.as_slice() {
            [] => {
                super::tell!(
                    "no recordings named: learning from the sample that ships with the project (made, not recorded)"
                );
                recordings::shipped()
            }
            paths => recordings::read(paths),
        }
        .map_err(Failure::input)
    }

    /// How the controller is set.
    pub fn settings(
        &self,
        stepper: StepperKind,
        lambda: Option<f64>,
        model: ModelKind,
    ) -> Result<Settings, Failure> {
        let ranges = [
            ("--rate", Some(self.rate), 1e-3, 1e4),
            ("--lambda", lambda, 1e-6, 1e5),
        ];
        for (option, value, least, most) in ranges {
            if let Some(value) = value
                && !(value >= least && value <= most)
            {
                return Err(Failure::Input(format!(
                    "{option} is {value}, expected {least} to {most}"
                )));
            }
        }
        Ok(Settings {
            stepper,
            model,
            lambda: lambda.unwrap_or(stepper.rate()),
            rate_hz: self.rate,
            clamped: self.clamp,
        })
    }

    /// What the recordings ask of the arm.
    pub fn tasks(&self, recordings: &[Recording]) -> Result<Vec<Task>, Failure> {
        let arm = match (&self.chain, &self.base, &self.tip) {
            (Some(file), Some(base), Some(tip)) => {
                let chain = urdf::read(file, base, tip).map_err(Failure::input)?;
                Arm::Given(
                    chain
                        .with_landmarks(&self.landmark)
                        .map_err(Failure::input)?,
                )
            }
            _ => {
                let motions: Vec<_> = recordings
                    .iter()
                    .map(|recording| recording.motion.clone())
                    .collect();
                Arm::Human(facing(&motions))
            }
        };
        let task = |recording: &Recording| {
            let task = Task::new(&recording.motion, &arm, self.rate)
                .map_err(|error| Failure::Input(format!("{}: {error}", recording.file)))?;
            Ok(Task {
                name: recording.file.clone(),
                ..task
            })
        };
        recordings.iter().map(task).collect()
    }

    /// What is to be learned: one parameter vector for each motion, or one for all of them jointly.
    pub fn problem(&self, settings: Settings, tasks: Vec<Task>, jointly: bool) -> Problem {
        let sets = match jointly {
            true => vec![(0..tasks.len()).collect()],
            false => (0..tasks.len()).map(|task| vec![task]).collect(),
        };
        Problem {
            settings,
            tasks,
            sets,
            islands: (self.population as usize).div_ceil(ISLAND),
            seed: self.seed,
        }
    }
}

/// The map of a file of synergies, made for the same settings and DoFs as a problem, and turned to where its people face.
pub fn known_map(file: &Path, problem: &Problem) -> Result<LearnedMap, Failure> {
    let wrong = |words: String| Failure::Input(format!("{}: {words}", file.display()));
    let known = Synergies::read(file).map_err(Failure::input)?;
    let model = problem.settings.model;
    let task = problem.tasks.first();
    let way = |chain: &ChainDescription| {
        let [x, y, z, w] = chain
            .joints
            .first()
            .map_or([0.0, 0.0, 0.0, 1.0], |joint| joint.rotation);
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    };
    let turn = known
        .motions
        .first()
        .zip(task)
        .map(|(motion, task)| way(&task.chain) * way(known.chain_of(motion)).inverse());
    let same = |motion: &LearnedMotion| {
        known.settings(motion)
            == Settings {
                model: motion.model,
                ..problem.settings
            }
    };
    let kind = |settings: &Settings| {
        format!(
            "{:?}, λ {}, {} Hz, {}",
            settings.stepper,
            settings.lambda,
            settings.rate_hz,
            if settings.clamped { "clamped" } else { "free" },
        )
    };
    if let Some(other) = known.motions.iter().find(|motion| !same(motion)) {
        return Err(wrong(format!(
            "it is not of the same kind: found {}, expected {}",
            kind(&known.settings(other)),
            kind(&problem.settings),
        )));
    }
    let map = known
        .map
        .ok_or_else(|| wrong("no map in it: `sinew learn --map` makes one".to_owned()))?;
    if map.model != model {
        let found = map.model;
        return Err(wrong(format!(
            "its map is for S_{found:?}, expected S_{model:?}"
        )));
    }
    let dofs = problem.dofs();
    map.plan(dofs, [0.0; 3], 1.0)
        .map_err(|error| wrong(format!("its map is not one for {dofs} DoFs: {error}")))?;
    let expected = task.map_or(0, |task| task.chain.landmarks.len() + 1);
    match map.reaches.first().map(|reach| reach.outset.start.len()) {
        Some(found) if found != expected => Err(wrong(format!(
            "its reaches have {found} landmarks, expected {expected}"
        ))),
        _ => map.turned(&turn.unwrap_or_default()).ok_or_else(|| {
            wrong("its arm is turned against this one, and not by quarter turns".to_owned())
        }),
    }
}

/// Whether results of these names can be put in a folder, asked before a search and not after it. The folder is made
/// where need be.
pub fn can_be_written(folder: &Path, files: &[&str]) -> Result<(), Failure> {
    let wrong = |error| Failure::input(format!("{}: {error}", folder.display()));
    std::fs::create_dir_all(folder).map_err(wrong)?;
    for file in files {
        can_be_put(&folder.join(file))?;
    }
    Ok(())
}

/// The backend, and why it is this one, where that is not plain.
///
/// `kept` is the file that a checkpoint may be in: a search goes on where it began.
pub fn backend(
    options: &Options,
    problem: &Problem,
    search: &Search,
    kept: Option<&Path>,
) -> Result<(Backend, String), Failure> {
    let device = |or_cpu| {
        let device = Gpu::new(problem, &search.islands, gpu::Which::Best)?;
        Ok::<_, GpuError>(Backend::Gpu {
            device: Box::new(device),
            or_cpu,
        })
    };
    match options.backend {
        BackendChoice::Cpu => return Ok((Backend::Cpu, String::new())),
        BackendChoice::Gpu => return Ok((device(false).map_err(Failure::run)?, String::new())),
        BackendChoice::Auto => {}
    }
    // A search goes on where it began, whatever is faster today.
    let began_on = |computed_by: &str| {
        kept.is_some_and(|file| {
            let checkpoint = Checkpoint::new(file.to_owned(), problem, computed_by);
            matches!(checkpoint.read(), Kept::Search(_))
        })
    };
    if began_on(CPU) {
        return Ok((Backend::Cpu, " (it began there)".to_owned()));
    }
    if gpu::adapters()
        .iter()
        .any(|adapter| began_on(&adapter.to_string()))
    {
        match device(true) {
            Ok(backend) => return Ok((backend, " (it began there)".to_owned())),
            Err(error) => super::tell!("no GPU path: {error}"),
        }
    }
    let (backend, reason) =
        choice::faster(problem, &search.islands, options.generations).map_err(Failure::input)?;
    Ok((backend, format!(" ({reason})")))
}

/// What a checkpoint of the CPU says of where it began.
const CPU: &str = "cpu";

/// The search that a checkpoint holds, or a fresh one where there is none, and in words which of them.
pub fn taken_up(checkpoint: Option<&Checkpoint>, fresh: Search) -> Search {
    let Some(checkpoint) = checkpoint else {
        return fresh;
    };
    match checkpoint.read() {
        Kept::Search(search) => {
            super::tell!(
                "going on from generation {} ({})",
                search.generation,
                checkpoint.path().display()
            );
            *search
        }
        Kept::Other => {
            super::tell!(
                "{} is of another search or damaged: beginning anew, it will be replaced",
                checkpoint.path().display()
            );
            fresh
        }
        Kept::Nothing => fresh,
    }
}

/// What a command that was stopped ends with: what it has done is kept in the checkpoint, where it has one.
pub fn stopped(search: &Search, keeper: &Keeper<'_>, checkpoint: Option<&Checkpoint>) -> Failure {
    match (keeper.unkept(), checkpoint) {
        (Some(error), _) => Failure::run(format!("stopped, and not kept: {error}")),
        (None, Some(checkpoint)) => Failure::Stopped(format!(
            "stopped after generation {}, no result is written; the same command goes on from there ({})",
            search.generation,
            checkpoint.path().display()
        )),
        (None, None) => Failure::Stopped("stopped, no result is written".to_owned()),
    }
}

/// Shows how a map is made: every step, and every few seconds how far it is.
pub fn steps(of: &str) -> impl Fn(&str, usize, usize) + Sync {
    let last = Mutex::new((String::new(), Instant::now()));
    move |words, done, count| {
        let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
        let is_new = last.0 != words || count == 0;
        if is_new || last.1.elapsed() > EVERY {
            *last = (words.to_owned(), Instant::now());
            match is_new {
                true => super::tell!("{of}: {words}"),
                false => super::tell!("{of}: {words}: {done}/{count}"),
            }
        }
    }
}

/// What a checkpoint says of where it began: lanes give the same bits at every width and on any number of threads;
/// devices need not.
pub fn computed_by(backend: &Backend) -> String {
    match backend {
        Backend::Cpu => CPU.to_owned(),
        Backend::Gpu { device, .. } => device.adapter().to_string(),
    }
}

/// A backend's name and its device.
pub fn named(backend: &Backend) -> (&'static str, String) {
    match backend {
        Backend::Cpu => ("cpu", cpu::describe()),
        Backend::Gpu { device, .. } => ("gpu", device.adapter().to_string()),
    }
}

/// A flag that Ctrl-C sets. A program can ask for it once.
pub fn stop() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed)).map_err(Failure::run)?;
    Ok(stop)
}

/// Runs a search and shows how it goes: how it ended, and what it found, scored again in `f64`. None where it was stopped.
pub fn run(
    search: &mut Search,
    problem: &Problem,
    backend: &mut Backend,
    generations: u32,
    keeper: &Keeper<'_>,
) -> Result<Option<(Ended, Vec<Winner>)>, Failure> {
    let bar = Bar::new(generations);
    let told = |words: &str, done, count| bar.part(words, done, count);
    let keeper = &keeper.telling(&told);
    let ended = search.run(problem, backend, generations, keeper, |told| match told {
        Ok(progress) => bar.show(&progress),
        Err(words) => bar.say(&words),
    });
    let found = ended.and_then(|ended| {
        if ended == Ended::Stopped {
            return Ok(None);
        }
        let winners = search.winners(problem, keeper)?;
        Ok(winners.map(|winners| (ended, winners)))
    });
    bar.bar.finish_and_clear();
    found.map_err(|error| match error {
        LearnError::Task(error) => Failure::input(error),
        error => Failure::run(error),
    })
}

/// What was learned, as a file has it.
pub fn synergies(
    problem: &Problem,
    search: &Search,
    winners: &[Winner],
    backend: &str,
    device: String,
) -> Result<Synergies, Failure> {
    let Some(first) = problem.tasks.first() else {
        return Err(Failure::Input("no recordings to learn from".to_owned()));
    };
    let mut motions: Vec<Option<LearnedMotion>> = vec![None; problem.tasks.len()];
    for (set, winner) in problem.sets.iter().zip(winners) {
        for (&index, &distance) in set.iter().zip(&winner.distances) {
            let (Some(task), Some(slot)) = (problem.tasks.get(index), motions.get_mut(index))
            else {
                continue;
            };
            *slot = Some(LearnedMotion {
                file: task.name.clone(),
                chain: (task.chain != first.chain).then(|| task.chain.clone()),
                initial_posture: task.initial.clone(),
                target: task.target,
                model: problem.settings.model,
                parameters: winner.parameters.clone(),
                distance_cm: distance * 100.0,
                frames: task.reference.len(),
            });
        }
    }
    Ok(Synergies {
        version: VERSION,
        chain: first.chain.clone(),
        stepper: problem.settings.stepper,
        lambda: problem.settings.lambda,
        rate_hz: problem.settings.rate_hz,
        limits: if problem.settings.clamped {
            LimitsKind::Clamped
        } else {
            LimitsKind::Free
        },
        motions: motions.into_iter().flatten().collect(),
        map: None,
        seed: problem.seed,
        population: problem.population(),
        generations: search.generation,
        evaluations: search.evaluations,
        backend: backend.to_owned(),
        device,
        seconds: search.seconds,
    })
}

/// Between two lines of how it goes.
const EVERY: Duration = Duration::from_secs(5);

/// A progress bar on a terminal; a line every few seconds elsewhere.
struct Bar {
    bar: ProgressBar,
    generations: u32,
    last: Mutex<Instant>,
}

impl Bar {
    fn new(generations: u32) -> Self {
        let bar = ProgressBar::new(generations.into());
        if let Ok(style) = ProgressStyle::with_template(
            "{bar:30} {pos}/{len} generations  {msg}  {eta} left at most",
        ) {
            bar.set_style(style);
        }
        Bar {
            bar,
            generations,
            last: Mutex::new(Instant::now()),
        }
    }

    fn show(&self, progress: &Progress) {
        let Progress {
            generation,
            best,
            mean,
        } = progress;
        self.bar.set_position((*generation).into());
        let distances = format!("best {:.3} cm, mean {:.3} cm", best * 100.0, mean * 100.0);
        self.tell(&distances, || {
            format!("generation {generation}/{}: {distances}", self.generations)
        });
    }

    /// Of a part of the work so much is done.
    fn part(&self, words: &str, done: usize, count: usize) {
        match count {
            0 => self.say(words),
            _ => {
                let words = format!("{words}: {done}/{count}");
                self.tell(&words, || words.clone());
            }
        }
    }

    fn tell(&self, message: &str, line: impl Fn() -> String) {
        if std::io::stderr().is_terminal() {
            self.bar.set_message(message.to_owned());
            return;
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() > EVERY {
            *last = Instant::now();
            super::tell!("{}", line());
        }
    }

    fn say(&self, words: &str) {
        self.bar.suspend(|| super::tell!("{words}"));
    }
}
