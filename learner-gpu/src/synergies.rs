//! `synergies.json`: what was learned, and everything needed to score it again but the recordings themselves.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::chain::{ChainDescription, ChainError};
use crate::kernel::score::Ready;
use crate::map::LearnedMap;
use crate::motion::Point;
use crate::output;
use crate::predict::{MOMENTS, Outset};
use crate::problem::{MOST_DOFS, ModelKind, Settings, StepperKind, with_dofs};
use crate::task::{Task, TaskError, reference};

/// The file format's version.
pub const VERSION: u32 = 1;

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Synergies {
    /// [`VERSION`].
    pub version: u32,
    /// The chain of every motion that has none of its own.
    pub chain: ChainDescription,
    /// The inverse kinematics.
    pub stepper: StepperKind,
    /// λ; its unit is the stepper's.
    pub lambda: f64,
    /// Ticks a second.
    pub rate_hz: f64,
    /// Whether ticks keep within the joint limits.
    pub limits: LimitsKind,
    /// What was learned, a motion each.
    pub motions: Vec<LearnedMotion>,
    /// What was learned of all of them, for other targets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<LearnedMap>,
    /// The seed of the random numbers.
    pub seed: u64,
    /// Members for each parameter vector.
    pub population: usize,
    /// Generations that ran.
    pub generations: u32,
    /// Motions that were synthesised and compared.
    pub evaluations: u64,
    /// `cpu` or `gpu`.
    pub backend: String,
    /// The device that ran it.
    pub device: String,
    /// How long it took.
    pub seconds: f64,
}

/// Whether joints were kept within their limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LimitsKind {
    /// They were.
    Clamped,
    /// They were not.
    Free,
}

/// One motion and its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LearnedMotion {
    /// The recording.
    pub file: String,
    /// The chain, where it is the motion's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub chain: Option<ChainDescription>,
    /// The joint vector it begins with: radians or metres.
    pub initial_posture: Vec<f64>,
    /// Where the tip is to go, metres in the base frame.
    pub target: Point,
    /// The synergy model.
    pub model: ModelKind,
    /// Its parameters, in the SPEC's order.
    pub parameters: Vec<f64>,
    /// The distance between recording and synthesised motion, in centimetres, computed in `f64`.
    pub distance_cm: f64,
    /// How many frames were compared.
    pub frames: usize,
}

/// Why a file of synergies cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SynergiesError {
    /// It cannot be read.
    #[error("{path}: {error}")]
    Unreadable {
        /// The file.
        path: String,
        /// What the system said.
        error: std::io::Error,
    },
    /// It is not JSON of this form. The message has line and column.
    #[error("{path}: {error}")]
    Form {
        /// The file.
        path: String,
        /// What is wrong, with line and column.
        error: serde_json::Error,
    },
    /// It is of another version.
    #[error("{path}: version {found}, expected {VERSION}")]
    Version {
        /// The file.
        path: String,
        /// The version it says.
        found: u32,
    },
    /// There is no motion in it.
    #[error("{path}: no motions, expected at least one")]
    NoMotions {
        /// The file.
        path: String,
    },
    /// Its map is wrong.
    #[error("{path}: map: {what}")]
    Map {
        /// The file.
        path: String,
        /// What is wrong with it.
        what: String,
    },
    /// A motion in it is wrong.
    #[error("{path}: motion {motion} ({file}): {what}")]
    Motion {
        /// The file.
        path: String,
        /// The motion, counted from 0.
        motion: usize,
        /// Its recording.
        file: String,
        /// What is wrong with it.
        what: String,
    },
}

impl Synergies {
    /// Reads and checks a file: every chain builds, every posture and parameter vector is of the right size and
    /// finite.
    ///
    /// # Errors
    /// What is wrong and where.
    pub fn read(path: &Path) -> Result<Self, SynergiesError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|error| SynergiesError::Unreadable {
            path: name.clone(),
            error,
        })?;
        // A file of another version may have other keys, so the version is looked at first.
        #[derive(Deserialize)]
        struct Versioned {
            version: u32,
        }
        let form = |error| SynergiesError::Form {
            path: name.clone(),
            error,
        };
        let found = serde_json::from_str::<Versioned>(&text)
            .map_err(form)?
            .version;
        if found != VERSION {
            return Err(SynergiesError::Version { path: name, found });
        }
        let synergies: Synergies = serde_json::from_str(&text).map_err(form)?;
        if synergies.motions.is_empty() {
            return Err(SynergiesError::NoMotions { path: name });
        }
        for (index, motion) in synergies.motions.iter().enumerate() {
            synergies
                .check(motion)
                .map_err(|what| SynergiesError::Motion {
                    path: name.clone(),
                    motion: index,
                    file: motion.file.clone(),
                    what,
                })?;
        }
        if let Some(map) = &synergies.map {
            let wrong = |what| SynergiesError::Map { path: name, what };
            synergies.check_map(map).map_err(wrong)?;
        }
        Ok(synergies)
    }

    fn check(&self, motion: &LearnedMotion) -> Result<(), String> {
        let chain = self.chain_of(motion);
        chain
            .check()
            .map_err(|error: ChainError| error.to_string())?;
        let dofs = chain.joints.len();
        if !(1..=MOST_DOFS).contains(&dofs) {
            return Err(TaskError::Dofs { found: dofs }.to_string());
        }
        let sizes = [
            ("initial_posture", motion.initial_posture.len(), dofs),
            (
                "parameters",
                motion.parameters.len(),
                sinew::synergy::Model::from(motion.model).parameters(dofs),
            ),
        ];
        for (key, found, expected) in sizes {
            if found != expected {
                return Err(format!("{key} has {found} numbers, expected {expected}"));
            }
        }
        if !(2..=1_000_000).contains(&motion.frames) {
            return Err(format!(
                "frames is {}, expected 2 to 1000000",
                motion.frames
            ));
        }
        let near = |x: &f64| x.abs() <= sinew::chain::MOST_LENGTH;
        if let Some(x) = motion.target.iter().find(|x| !near(x)) {
            return Err(format!("target has {x}, expected metres within 10 km"));
        }
        if let Some(x) = motion.initial_posture.iter().find(|x| !near(x)) {
            return Err(format!(
                "initial_posture has {x:e}, expected radians or metres within 10,000"
            ));
        }
        // As the options of what learns have them: within these an `f32` holds both.
        let ranges = [
            ("lambda", self.lambda, 1e-6..=1e5),
            ("rate_hz", self.rate_hz, 1e-3..=1e4),
        ];
        match ranges
            .iter()
            .find(|(_, value, range)| !range.contains(value))
        {
            Some((key, value, range)) => Err(format!(
                "{key} is {value:e}, expected {} to {}",
                range.start(),
                range.end()
            )),
            None => Ok(()),
        }
    }

    /// A map that plans, and with reaches such as these chains make.
    fn check_map(&self, map: &LearnedMap) -> Result<(), String> {
        let dofs = self.chain.joints.len();
        let plan = map.plan(dofs, [0.0; 3], 1.0);
        plan.map_err(|error| error.to_string())?;
        let points = self.chain.landmarks.len() + 1;
        let other = |motion: &LearnedMotion| {
            let chain = self.chain_of(motion);
            (chain.joints.len(), chain.landmarks.len() + 1) != (dofs, points)
        };
        if !map.reaches.is_empty() && self.motions.iter().any(other) {
            return Err("with reaches, expected chains of one size".to_owned());
        }
        let parameters = sinew::synergy::Model::from(map.model).parameters(dofs);
        for (index, reach) in map.reaches.iter().enumerate() {
            let Outset {
                start,
                target,
                seconds,
            } = &reach.outset;
            let moments = || reach.path.iter().chain([start]);
            if reach.path.len() != MOMENTS || moments().any(|moment| moment.len() != points) {
                return Err(format!(
                    "reach {index}: expected a start and {MOMENTS} moments of {points} points"
                ));
            }
            if reach.parameters.len() != parameters {
                let found = reach.parameters.len();
                return Err(format!(
                    "reach {index} has {found} parameters, expected {parameters}"
                ));
            }
            if !(*seconds > 0.0 && *seconds < 1e6) {
                return Err(format!(
                    "reach {index} takes {seconds} s, expected above 0 and below 1e6"
                ));
            }
            let far = |x: &&f64| x.abs() > sinew::chain::MOST_LENGTH;
            let points = moments().flatten().chain([target]);
            if let Some(x) = points.flatten().find(far) {
                return Err(format!(
                    "reach {index} has {x}, expected metres within 10 km"
                ));
            }
        }
        Ok(())
    }

    /// The chain of a motion.
    pub fn chain_of<'a>(&'a self, motion: &'a LearnedMotion) -> &'a ChainDescription {
        motion.chain.as_ref().unwrap_or(&self.chain)
    }

    /// How the controller was set for a motion.
    pub fn settings(&self, motion: &LearnedMotion) -> Settings {
        Settings {
            stepper: self.stepper,
            model: motion.model,
            lambda: self.lambda,
            rate_hz: self.rate_hz,
            clamped: self.limits == LimitsKind::Clamped,
        }
    }

    /// Puts the file at `path`, whole or not at all.
    ///
    /// # Errors
    /// What the system says.
    pub fn write(&self, path: &Path) -> std::io::Result<()> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        output::replace(path, text.as_bytes())
    }

    /// The task of a motion with its recording, as the file says it: nothing is fitted anew.
    ///
    /// # Errors
    /// A recording without a usable reach, or one that lacks a landmark of the chain.
    pub fn task(
        &self,
        motion: &LearnedMotion,
        recording: &crate::motion::Motion,
    ) -> Result<Task, TaskError> {
        let chain = self.chain_of(motion).clone();
        let reference = reference(recording, &chain, self.rate_hz)?;
        Ok(Task {
            name: motion.file.clone(),
            chain,
            initial: motion.initial_posture.clone(),
            target: motion.target,
            reference,
            misfit: 0.0,
        })
    }
}

/// The distance in metres between a task's recording and the motion that these parameters synthesise, by the core in
/// `f64`.
///
/// # Errors
/// A chain or parameters that the core refuses.
pub fn score(settings: &Settings, task: &Task, parameters: &[f64]) -> Result<f64, TaskError> {
    let dofs = task.chain.joints.len();
    with_dofs!(dofs, N => {
        let ready = Ready::<f64, N>::new(task)?;
        // A score alone does not tell parameters that are refused.
        ready
            .synthesise(settings, parameters, 0, |_, _, _| {})
            .map_err(|error| TaskError::Core { motion: task.name.clone(), error })?;
        Ok(ready.score(settings, parameters))
    }, else Err(TaskError::Dofs { found: dofs }))
}
