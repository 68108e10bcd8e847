//! `sinew export`: a learned synergy for an arm controller.

use std::io::{IsTerminal, Write};
use std::path::PathBuf;
use std::process::ExitCode;

use sinew_learn::export::{Format, export};
use sinew_learn::output;
use sinew_learn::synergies::Synergies;

use super::{Failure, can_be_put, choose};

/// Write a learned synergy, with its chain and the file's map, as an arm controller takes it
///
/// What is written is checked as the controller checks it. Numbers are rounded to f32 once.
#[derive(clap::Args)]
pub struct Arguments {
    /// The file that `sinew learn` wrote
    #[arg(value_name = "SYNERGIES.json")]
    file: PathBuf,
    /// What to write
    #[arg(long, value_enum)]
    format: Format,
    /// The synergy learned from this recording [default: the first]
    #[arg(long, value_name = "RECORDING")]
    motion: Option<String>,
    /// Where to write it [default: standard output]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    if let Some(path) = &arguments.out {
        can_be_put(path)?;
    }
    let synergies = Synergies::read(&arguments.file).map_err(Failure::input)?;
    let motion = choose(
        &synergies,
        &arguments.file,
        arguments.motion.as_deref(),
        None,
    )?;
    let bytes = export(&synergies, motion, arguments.format).map_err(|error| {
        Failure::input(format!(
            "{}: {}: {error}",
            arguments.file.display(),
            motion.file
        ))
    })?;
    match &arguments.out {
        Some(path) => output::replace(path, &bytes)
            .map_err(|error| Failure::run(format!("{}: {error}", path.display())))?,
        None => {
            let mut out = std::io::stdout().lock();
            if arguments.format == Format::Postcard && out.is_terminal() {
                return Err(Failure::input(
                    "postcard is no text for a terminal: name a file with --out, or redirect",
                ));
            }
            match out.write_all(&bytes).and_then(|()| out.flush()) {
                // A reader that goes away (`| head`) is no failure.
                Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                    return Err(Failure::run(format!("standard output: {error}")));
                }
                _ => {}
            }
        }
    }
    super::tell!(
        "exported the synergy of {}{}, {} bytes",
        motion.file,
        synergies.map.as_ref().map_or("", |_| " and the map"),
        bytes.len()
    );
    Ok(ExitCode::SUCCESS)
}
