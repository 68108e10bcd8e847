//! `sinew evaluate`: scores a file of synergies again.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use serde_json::json;
use sinew_learn::problem::mean;
use sinew_learn::recordings;
use sinew_learn::synergies::{LearnedMotion, Synergies, score};

use super::{Failure, print, table};

/// Score a file of synergies again, in f64, against its recordings: per motion and mean, in cm
#[derive(clap::Args)]
pub struct Arguments {
    /// The file that `sinew learn` wrote
    #[arg(value_name = "SYNERGIES.json")]
    file: PathBuf,
    /// Print JSON instead of a table
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let synergies = Synergies::read(&arguments.file).map_err(Failure::input)?;
    let beside = arguments.file.parent().unwrap_or(Path::new("."));
    let mut distances = Vec::new();
    for motion in &synergies.motions {
        let recording = recordings::find(&motion.file, beside).map_err(Failure::input)?;
        let wrong = |error| Failure::input(format!("{}: {error}", arguments.file.display()));
        let task = synergies.task(motion, &recording.motion).map_err(wrong)?;
        let settings = synergies.settings(motion);
        let distance = score(&settings, &task, &motion.parameters).map_err(wrong)?;
        distances.push((motion, distance * 100.0, task.reference.len()));
    }
    let mean = mean(distances.iter().map(|&(_, cm, _)| cm));
    if arguments.json {
        let motion = |(motion, cm, frames): &(&LearnedMotion, f64, usize)| {
            json!({ "file": motion.file, "model": motion.model, "distance_cm": cm, "frames": frames,
                    "written_cm": motion.distance_cm })
        };
        let report = json!({
            "stepper": synergies.stepper,
            "motions": distances.iter().map(motion).collect::<Vec<_>>(),
            "mean_cm": mean,
        });
        print(&format!("{report:#}\n"))?;
    } else {
        let mut rows = vec![
            ["recording", "cm", "as written"]
                .map(str::to_owned)
                .to_vec(),
        ];
        for (motion, cm, _) in &distances {
            rows.push(vec![
                motion.file.clone(),
                format!("{cm:.4}"),
                format!("{:.4}", motion.distance_cm),
            ]);
        }
        rows.push(vec!["mean".to_owned(), format!("{mean:.4}"), String::new()]);
        print(&table(&rows))?;
    }
    Ok(ExitCode::SUCCESS)
}
