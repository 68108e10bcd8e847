//! `sinew learn`: from recordings to synergies.

use std::path::PathBuf;
use std::process::ExitCode;

use sinew_learn::checkpoint::{Checkpoint, Keeper};
use sinew_learn::learn::{Ended, Search};
use sinew_learn::map;
use sinew_learn::predict;
use sinew_learn::problem::{ModelKind, mean};
use sinew_learn::synergies::Synergies;

use super::search::{
    self, Options, Steering, backend, can_be_written, computed_by, named, steps, stopped,
    synergies, taken_up,
};
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
    /// Learn also a map from targets to parameters, for targets that no recording has, and try it on reaches left out
    #[arg(long, conflicts_with = "joint")]
    map: bool,
    /// Another person's synergies with a map: paths are predicted from the other's reaches, too, and the map is adapted
    /// to these recordings, of which fewer will do
    #[arg(long, value_name = "SYNERGIES.json", requires = "map")]
    known: Option<PathBuf>,
    #[command(flatten)]
    options: Options,
    /// The folder to write to; it is made where it is not there
    #[arg(long, value_name = "DIR", default_value = "synergies")]
    out: PathBuf,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let options = &arguments.options;
    let Steering { stepper, lambda } = arguments.steering;
    let settings = options.settings(stepper, lambda, arguments.model)?;
    let tasks = options.tasks(&options.recordings()?)?;
    let problem = options.problem(settings, tasks, arguments.joint);
    let known = match &arguments.known {
        Some(file) => Some(search::known_map(file, &problem)?),
        None => None,
    };
    let fresh = Search::new(&problem);
    can_be_written(&arguments.out, &["synergies.json", "learning.checkpoint"])?;
    let kept = arguments.out.join("learning.checkpoint");
    let (mut backend, why) = backend(options, &problem, &fresh, Some(&kept))?;
    let (name, device) = named(&backend);
    super::tell!("backend {name}: {device}{why}");
    let checkpoint = Checkpoint::new(kept, &problem, &computed_by(&backend));
    let mut search = taken_up(Some(&checkpoint), fresh);

    let stop = search::stop()?;
    let keeper = Keeper::new(&stop, Some(&checkpoint));
    let most = options.generations;
    let found = search::run(&mut search, &problem, &mut backend, most, &keeper)?;
    let Some((ended, winners)) = found else {
        return Err(stopped(&search, &keeper, Some(&checkpoint)));
    };

    // The CPU may have taken over.
    let (name, device) = named(&backend);
    let mut synergies = synergies(&problem, &search, &winners, name, device)?;
    if arguments.map {
        let motions = synergies.motions.iter();
        let own: Vec<Vec<f64>> = motions.map(|motion| motion.parameters.clone()).collect();
        let tell = steps("map");
        let telling = keeper.telling(&tell);
        let map = map::learn(&mut search, &problem, &own, known.as_ref(), &telling);
        synergies.map = map.map_err(Failure::run)?;
        if synergies.map.is_none() {
            return Err(stopped(&search, &keeper, Some(&checkpoint)));
        }
    }
    // What there is no room for now may have some later.
    keeper.keep(&search);
    print(&report(&synergies, ended))?;
    if let Some(map) = &synergies.map {
        print(&trials(map))?;
    }
    let path = arguments.out.join("synergies.json");
    synergies
        .write(&path)
        .map_err(|error| Failure::run(format!("{}: {error}", path.display())))?;
    checkpoint.remove();
    print(&format!("written to {}\n", path.display()))?;
    Ok(ExitCode::SUCCESS)
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
    let mean = mean(synergies.motions.iter().map(|motion| motion.distance_cm));
    rows.push(vec!["mean".to_owned(), String::new(), format!("{mean:.3}")]);
    let why = match ended {
        Ended::Settled => "rounds gain nothing more",
        _ => "all generations ran",
    };
    format!(
        "{}{} generations, {} members a vector, {} motions synthesised in {:.1} s on {} ({why})\n",
        table(&rows),
        synergies.generations,
        synergies.population,
        synergies.evaluations,
        synergies.seconds,
        synergies.device,
    )
}

/// How well parameters for new targets are found, in several ways.
fn trials(learned: &map::LearnedMap) -> String {
    let heading = ["new targets by", "fitted cm", "left out cm", "within 1 cm"];
    let mut rows = vec![heading.map(str::to_owned).to_vec()];
    for trial in &learned.trials {
        rows.push(vec![
            trial.name.clone(),
            format!("{:.3}", trial.fitted_cm),
            trial
                .left_out_cm
                .map_or("-".to_owned(), |cm| format!("{cm:.3}")),
            trial
                .arrived
                .map_or("-".to_owned(), |share| format!("{:.0} %", share * 100.0)),
        ]);
    }
    format!(
        "{}left out: learned without the reach and all within {:.0} cm of its target; kept: {}, trusted up to {:.0} cm \
         from a learned target{}\n",
        table(&rows),
        predict::NEAR * 100.0,
        learned.kept,
        learned.radius * 100.0,
        match learned.reaches.is_empty() {
            true => "",
            false => "; the host learns for a predicted path, which does better",
        },
    )
}
