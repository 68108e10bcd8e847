//! `sinew play`: a reach on an arm controller.

use std::path::PathBuf;
use std::process::ExitCode;

use sinew_learn::export::settings;
use sinew_learn::motion::Point;
use sinew_learn::output;
use sinew_learn::play::{PlayError, Port, csv, faults};
use sinew_learn::synergies::Synergies;
use sinew_protocol::{Faults, Mode, Report, Request};

use super::{Failure, can_be_put, choose, print, trust, usual};

/// Play a reach on an arm controller and show its telemetry
///
/// Loads the chain and the file's map (`learn --map`), with which the controller itself plans for the target; from a
/// file without one, or by name, a synergy: by itself the one whose learned target is nearest. Without a file the
/// controller keeps what it has, and plans where it is told a time. It holds the arm when this program ends on the way.
/// A hand that comes to rest short of its target is a failure.
#[derive(clap::Args)]
pub struct Arguments {
    /// The file that `sinew learn` wrote
    #[arg(value_name = "SYNERGIES.json")]
    file: Option<PathBuf>,
    /// The controller's line: a serial device, run at 115,200 baud, or a TCP port
    #[arg(long, value_name = "PATH|HOST:PORT")]
    port: String,
    /// Where the hand is to go, metres in the base frame
    #[arg(long, value_name = "X,Y,Z", value_parser = super::point, allow_hyphen_values = true)]
    target: Point,
    /// Use the synergy learned from this recording instead of the one with the nearest target
    #[arg(long, value_name = "RECORDING", requires = "file")]
    motion: Option<String>,
    /// How long the reach is to take, which is what the map is asked for [default: as long as the learned one with the
    /// nearest target]
    #[arg(long, value_parser = super::seconds, conflicts_with = "motion")]
    seconds: Option<f64>,
    /// Where to record the telemetry: a line each 20 ms or so
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
}

/// From one printed line to the next, ticks.
const LINE: u32 = 100;

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let target = arguments.target.map(|x| x as f32);
    if !target.iter().all(|x| x.is_finite()) {
        return Err(Failure::input(
            "--target: expected metres that an f32 can hold",
        ));
    }
    let Reach { load, seconds } = reach(arguments)?;
    let refused = |error| match error {
        PlayError::Refused(_) if !load.is_empty() => {
            Failure::run(format!("{error}, of what was loaded or asked for"))
        }
        error => Failure::run(error),
    };
    if let Some(path) = &arguments.csv {
        can_be_put(path)?;
    }
    let stop = super::search::stop()?;
    let mut port = Port::open(&arguments.port)
        .map_err(|error| Failure::input(format!("--port {}: {error}", arguments.port)))?;
    let mut reports: Vec<Report> = Vec::new();
    let mut printed = Ok(());
    let mut next = 0;
    let begun = port.begin(&load, target, seconds);
    if let Some(confidence) = begun.map_err(refused)? {
        super::tell!("{}", trust("a synergy of the map", f64::from(confidence)));
    }
    let played = port.watch(&stop, |report| {
        if report.ticks >= next && printed.is_ok() {
            printed = print(&line(report));
            next = report.ticks.saturating_add(LINE);
        }
        reports.push(report.clone());
    });
    // What was recorded is kept, whatever the end.
    if let Some(path) = &arguments.csv {
        output::replace(path, csv(&reports).as_bytes())
            .map_err(|error| Failure::run(format!("{}: {error}", path.display())))?;
    }
    printed?;
    if let Err(error @ PlayError::Stopped) = played {
        return Err(Failure::Stopped(error.to_string()));
    }
    let last = played.map_err(Failure::run)?;
    if last.mode == Mode::Stopped {
        return Err(Failure::run("somebody stopped the arm on its way"));
    }
    print(&line(&last))?;
    let worst = reports.iter().map(|report| report.worst_cost).max();
    print(&format!(
        "at rest after {} ticks, {:.1} mm from the target; the dearest tick took {} of the controller's clock\n",
        last.ticks,
        last.distance * 1000.0,
        worst.unwrap_or(0)
    ))?;
    let mut all = Faults::default();
    for report in &reports {
        all.add(report.faults);
    }
    let names = faults(all);
    match all.has(Faults::SHORT) || all.has(Faults::SILENT) {
        true => Err(Failure::run(names)),
        false if names.is_empty() => Ok(ExitCode::SUCCESS),
        false => {
            super::tell!("the hand is there, but {names}");
            Ok(ExitCode::SUCCESS)
        }
    }
}

/// What to load, and for how many seconds to plan; none: with a synergy.
struct Reach {
    load: Vec<Request>,
    seconds: Option<f32>,
}

fn reach(arguments: &Arguments) -> Result<Reach, Failure> {
    let seconds = arguments.seconds.map(|seconds| seconds as f32);
    let Some(file) = &arguments.file else {
        let load = Vec::new();
        return Ok(Reach { load, seconds });
    };
    let synergies = Synergies::read(file).map_err(Failure::input)?;
    let name = arguments.motion.as_deref();
    let motion = choose(&synergies, file, name, Some(arguments.target))?;
    let settings = settings(&synergies, motion)
        .map_err(|error| Failure::input(format!("{}: {}: {error}", file.display(), motion.file)))?;
    let mut load: Vec<Request> = settings.chain.map(Request::LoadChain).into_iter().collect();
    // Not both: each takes the controller a second or two to write.
    let seconds = match settings.map {
        Some(map) if name.is_none() => {
            load.push(Request::LoadMap(map));
            seconds.or(Some(usual(&synergies, motion) as f32))
        }
        _ if seconds.is_some() => {
            return Err(Failure::input(format!(
                "--seconds: {} has no map that could plan for a time",
                file.display()
            )));
        }
        _ => {
            load.extend(settings.synergy.map(Request::LoadSynergy));
            super::tell!("the synergy of {}", motion.file);
            None
        }
    };
    Ok(Reach { load, seconds })
}

/// A report for people.
fn line(report: &Report) -> String {
    let [x, y, z] = report.tip;
    let angles: Vec<String> = report.angles.iter().map(|q| format!("{q:6.3}")).collect();
    format!(
        "{:6} ticks  tip {x:6.3} {y:6.3} {z:6.3} m  {:5.3} m left  angles {} rad  cost {}  {}\n",
        report.ticks,
        report.distance,
        angles.join(" "),
        report.cost,
        faults(report.faults),
    )
    .replace("  \n", "\n")
}
