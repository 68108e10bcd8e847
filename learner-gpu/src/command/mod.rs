//! The commands, a file each, and how they end; what those that learn share is in [`search`].

pub mod bench;
pub mod devices;
pub mod evaluate;
pub mod experiment;
pub mod export;
pub mod learn;
pub mod play;
mod search;
pub mod synthesize;

use std::fmt;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use sinew_learn::motion::Point;
use sinew_learn::synergies::{LearnedMotion, Synergies};
use sinew_learn::{output, predict};

/// Why a command did not do what it was asked.
pub enum Failure {
    /// What the person gave is wrong: exit code 2.
    Input(String),
    /// Something failed: exit code 1.
    Run(String),
    /// Somebody stopped it: exit code 130, as a shell has it for Ctrl-C.
    Stopped(String),
}

impl Failure {
    /// What was given is wrong.
    pub fn input(error: impl fmt::Display) -> Self {
        Failure::Input(error.to_string())
    }

    /// Something failed.
    pub fn run(error: impl fmt::Display) -> Self {
        Failure::Run(error.to_string())
    }

    /// The program's exit code.
    pub fn code(&self) -> ExitCode {
        ExitCode::from(match self {
            Failure::Input(_) => 2,
            Failure::Run(_) => 1,
            Failure::Stopped(_) => 130,
        })
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Failure::Input(text) | Failure::Run(text) => write!(f, "sinew: {text}"),
            Failure::Stopped(text) => f.write_str(text),
        }
    }
}

/// A line on standard error. Nobody reading it is no failure, and no reason to lose a search.
macro_rules! tell {
    ($($words:tt)*) => {{
        use std::io::Write;
        let _ = writeln!(std::io::stderr(), $($words)*);
    }};
}
pub(crate) use tell;

/// Prints to standard output. A reader that goes away (`| head`) is no failure.
pub fn print(text: &str) -> Result<(), Failure> {
    match std::io::stdout().lock().write_all(text.as_bytes()) {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::run(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

/// Whether a result can be put in a file, asked before the work that it is to hold.
pub fn can_be_put(path: &Path) -> Result<(), Failure> {
    output::can_replace(path)
        .map_err(|error| Failure::Input(format!("{}: {error}", path.display())))
}

/// A table: a left-aligned first column, the others aligned right.
pub fn table(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let mut text = String::new();
    for row in rows {
        for (column, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            match column {
                0 => text.push_str(&format!("{cell:<width$}")),
                _ => text.push_str(&format!("  {cell:>width$}")),
            }
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

/// Three finite numbers with commas between.
pub fn point(text: &str) -> Result<Point, String> {
    let parts: Vec<&str> = text.split(',').collect();
    let [x, y, z] = parts.as_slice() else {
        return Err(format!(
            "expected three numbers X,Y,Z, found {}",
            parts.len()
        ));
    };
    let number = |part: &str| match part.trim().parse::<f64>() {
        Ok(number) if number.abs() <= sinew::chain::MOST_LENGTH => Ok(number),
        _ => Err(format!("expected metres within 10 km, found {part:?}")),
    };
    Ok([number(x)?, number(y)?, number(z)?])
}

/// Seconds that a reach may take.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && seconds <= 3600.0 => Ok(seconds),
        _ => Err("expected seconds, above 0 and up to 3600".to_owned()),
    }
}

/// The learned motion to take the synergy from, of those in `file`: the one of that name, else the one whose target is
/// nearest, else the first.
pub fn choose<'a>(
    synergies: &'a Synergies,
    file: &Path,
    name: Option<&str>,
    target: Option<Point>,
) -> Result<&'a LearnedMotion, Failure> {
    let motions = &synergies.motions;
    let apart = |motion: &LearnedMotion, target: Point| {
        (0..3)
            .map(|r| (motion.target[r] - target[r]).powi(2))
            .sum::<f64>()
    };
    let chosen = match (name, target) {
        (Some(name), _) => motions.iter().find(|motion| {
            let stem = Path::new(&motion.file).file_stem();
            motion.file == name || stem.is_some_and(|stem| stem.to_str() == Some(name))
        }),
        (None, Some(target)) => motions
            .iter()
            .min_by(|a, b| apart(a, target).total_cmp(&apart(b, target))),
        (None, None) => motions.first(),
    };
    chosen.ok_or_else(|| {
        Failure::Input(match name {
            Some(name) => format!("{}: no motion {name:?} in it", file.display()),
            None => format!("{}: no motion in it", file.display()),
        })
    })
}

/// The learned motion with the parameters for a target, learned for a predicted path or given by the map, as the file
/// has it, and in words where the parameters are from. A motion that is named keeps its own.
pub fn planned(
    synergies: &Synergies,
    file: &Path,
    name: Option<&str>,
    target: Point,
    seconds: Option<f64>,
) -> Result<(LearnedMotion, String), Failure> {
    let motion = choose(synergies, file, name, Some(target))?;
    let own = || format!("the synergy of {}", motion.file);
    let (Some(map), None) = (&synergies.map, name) else {
        return Ok((motion.clone(), own()));
    };
    let seconds = seconds.unwrap_or(usual(synergies, motion));
    let wrong =
        |error: &dyn fmt::Display| Failure::input(format!("{}: map: {error}", file.display()));
    let ((parameters, confidence), what) = match map.reaches.is_empty() {
        true => {
            let dofs = motion.initial_posture.len();
            let planned = map.plan(dofs, target, seconds).map_err(|e| wrong(&e))?;
            (planned, "a synergy of the map")
        }
        false => {
            let planned = predict::plan(synergies, map, motion, target, seconds);
            (
                planned.map_err(|e| wrong(&e))?,
                "a synergy learned for a predicted path",
            )
        }
    };
    let planned = LearnedMotion {
        model: map.model,
        parameters,
        ..motion.clone()
    };
    Ok((planned, trust(what, confidence)))
}

/// How long a learned motion takes, seconds.
pub fn usual(synergies: &Synergies, motion: &LearnedMotion) -> f64 {
    motion.frames.saturating_sub(1) as f64 / synergies.rate_hz
}

/// In words, what was planned with and how far it is to be trusted.
pub fn trust(what: &str, confidence: f64) -> String {
    if confidence > 0.0 {
        format!("{what}, confidence {confidence:.2}")
    } else {
        format!("{what} from where the map ends (no learned target is near: not to be trusted)")
    }
}
