//! `sinew learn`: from recordings to synergies.

use std::path::PathBuf;
use std::process::ExitCode;

use sinew_learn::cpu;
use sinew_learn::gpu::{self, Gpu};
use sinew_learn::learn::{Backend, Checkpoint, Ended, Kept, Search};
use sinew_learn::problem::{ModelKind, Problem};
use sinew_learn::synergies::Synergies;

use super::search::{self, Options, Steering, can_be_written, synergies};
use super::{Failure, print, table};

/// Learn synergies from recorded reaches and write them to DIR/synergies.json
///
/// Stopped with Ctrl-C it keeps where it was; the same command goes on from there.
#[derive(clap::Args)]
#[command(args_override_self = true)]
pub struct Arguments {
    /// What each joint's synergy is made of
    #[arg(long, value_enum, default_value = "c")]
    model: ModelKind,
    #[command(flatten)]
    steering: Steering,
    /// Learn one parameter vector for all recordings together instead of one for each
    #[arg(long)]
    joint: bool,
    #[command(flatten)]
    options: Options,
    /// The folder to write to; it is made where it is not there
    #[arg(long, value_name = "DIR", default_value = "synergies")]
    out: PathBuf,
}

/// Where to compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum BackendChoice {
    /// The best there is
    Auto,
    /// A Vulkan, Metal or DirectX 12 adapter
    Gpu,
    /// SIMD lanes and threads
    Cpu,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let options = &arguments.options;
    let Steering { stepper, lambda } = arguments.steering;
    let settings = options.settings(stepper, lambda, arguments.model)?;
    let tasks = options.tasks(&options.recordings()?)?;
    let problem = options.problem(settings, tasks, arguments.joint);
    let fresh = Search::new(&problem);
    let (mut backend, name, device) = backend(options.backend, &problem, &fresh)?;
    super::tell!("backend {name}: {device}");
    can_be_written(&arguments.out, &["synergies.json"])?;
    // Lanes give the same bits at every width and on any number of threads; devices need not.
    let computed_by = if name == "cpu" { "cpu" } else { &device };
    let checkpoint = Checkpoint::new(&arguments.out, &problem, computed_by);
    let mut search = match checkpoint.read() {
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
    };

    let stop = search::stop()?;
    let ended = search::run(
        &mut search,
        &problem,
        &mut backend,
        options.generations,
        &stop,
        Some(&checkpoint),
    )?;
    if ended == Ended::Stopped {
        super::tell!(
            "stopped after generation {}; the same command goes on from there ({})",
            search.generation,
            checkpoint.path().display()
        );
        return Ok(ExitCode::from(130));
    }

    // The CPU may have taken over.
    let (name, device) = match backend {
        Backend::Cpu => ("cpu", cpu::describe()),
        Backend::Gpu { .. } => (name, device),
    };
    let synergies = synergies(&problem, &search, name, device)?;
    let path = arguments.out.join("synergies.json");
    synergies
        .write(&path)
        .map_err(|error| Failure::run(format!("{}: {error}", path.display())))?;
    checkpoint.remove();
    print(&report(&synergies, ended))?;
    print(&format!("written to {}\n", path.display()))?;
    Ok(ExitCode::SUCCESS)
}

/// The backend, its name and its device.
pub fn backend(
    choice: BackendChoice,
    problem: &Problem,
    search: &Search,
) -> Result<(Backend, &'static str, String), Failure> {
    if choice != BackendChoice::Cpu {
        match Gpu::new(problem, &search.islands, gpu::Which::Best) {
            Ok(device) => {
                let name = device.adapter().to_string();
                let or_cpu = choice == BackendChoice::Auto;
                return Ok((
                    Backend::Gpu {
                        device: Box::new(device),
                        or_cpu,
                    },
                    "gpu",
                    name,
                ));
            }
            Err(error) if choice == BackendChoice::Gpu => return Err(Failure::run(error)),
            Err(error) => super::tell!("no GPU path: {error}"),
        }
    }
    Ok((Backend::Cpu, "cpu", cpu::describe()))
}

/// What a person sees in the end.
fn report(synergies: &Synergies, ended: Ended) -> String {
    let mut rows = vec![
        ["recording", "frames", "distance cm"]
            .map(str::to_owned)
            .to_vec(),
    ];
    for motion in &synergies.motions {
        rows.push(vec![
            motion.file.clone(),
            motion.frames.to_string(),
            format!("{:.3}", motion.distance_cm),
        ]);
    }
    let distances = || synergies.motions.iter().map(|motion| motion.distance_cm);
    let mean = distances().sum::<f64>() / synergies.motions.len().max(1) as f64;
    rows.push(vec!["mean".to_owned(), String::new(), format!("{mean:.3}")]);
    let why = match ended {
        Ended::Settled => "the population has settled",
        _ => "all generations ran",
    };
    format!(
        "{}{} generations, {} members to begin with, {} motions synthesised in {:.1} s on {} ({why})\n",
        table(&rows),
        synergies.generations,
        synergies.population,
        synergies.evaluations,
        synergies.seconds,
        synergies.device,
    )
}
