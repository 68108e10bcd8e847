//! `sinew synthesize`: a motion to a new target.

use std::path::PathBuf;
use std::process::ExitCode;

use sinew_learn::output;
use sinew_learn::synergies::Synergies;
use sinew_learn::synthesis::{Synthesis, synthesize};

use super::{Failure, can_be_put, planned, print};

/// Synthesise a reach to a new target with learned synergies, and write it as CSV
///
/// Where the file has a map (`learn --map`), the parameters are learned for the path that the reach is predicted to take, or
/// are those that the map gives for the target, whichever did better on reaches left out. Else they are, and the initial
/// posture and the duration always are, those of the learned motion whose target is nearest, or of the one named. The CSV
/// has the recordings' columns, in the base frame, then one column a joint.
#[derive(clap::Args)]
pub struct Arguments {
    /// The file that `sinew learn` wrote
    #[arg(value_name = "SYNERGIES.json")]
    file: PathBuf,
    /// Where the hand is to go, metres from the shoulder (the base frame)
    #[arg(long, value_name = "X,Y,Z", value_parser = super::point, allow_hyphen_values = true)]
    target: [f64; 3],
    /// Where to write the motion
    #[arg(long, value_name = "FILE")]
    csv: PathBuf,
    /// Use the synergy learned from this recording instead of the one with the nearest target
    #[arg(long, value_name = "RECORDING")]
    motion: Option<String>,
    /// How long the motion is [default: as long as the learned one]
    #[arg(long, value_parser = super::seconds)]
    seconds: Option<f64>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let synergies = Synergies::read(&arguments.file).map_err(Failure::input)?;
    let in_frames = |seconds: f64| (seconds * synergies.rate_hz).round() as usize + 1;
    if let Some(frames) = arguments.seconds.map(in_frames)
        && !(2..=1_000_000).contains(&frames)
    {
        return Err(Failure::Input(format!(
            "--seconds makes {frames} frames, expected 2 to 1000000"
        )));
    }
    can_be_put(&arguments.csv)?;
    let (motion, from) = planned(
        &synergies,
        &arguments.file,
        arguments.motion.as_deref(),
        arguments.target,
        arguments.seconds,
    )?;
    let frames = arguments.seconds.map_or(motion.frames, in_frames);
    let synthesis =
        synthesize(&synergies, &motion, arguments.target, frames).map_err(Failure::input)?;
    let text = synthesis.csv();
    output::replace(&arguments.csv, text.as_bytes())
        .map_err(|error| Failure::run(format!("{}: {error}", arguments.csv.display())))?;
    let Synthesis { left, .. } = synthesis;
    print(&format!(
        "{}: {frames} frames at {} Hz with {from}; the hand ends {:.1} cm from the target\n",
        arguments.csv.display(),
        synergies.rate_hz,
        left * 100.0
    ))?;
    Ok(ExitCode::SUCCESS)
}
