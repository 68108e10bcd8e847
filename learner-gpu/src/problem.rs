//! What is to be learned: the motions as tasks for a chain, and how the controller and the search are set.

use serde::{Deserialize, Serialize};
use sinew::controller::Limits;
use sinew::real::Real;
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Transpose,
};
use sinew::synergy::Model;

use crate::kernel::proposal::ISLAND;
use crate::task::Task;

/// The most DoFs a chain to learn for can have: each size is compiled on its own.
pub const MOST_DOFS: usize = 8;

/// Which inverse kinematics a tick uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum StepperKind {
    /// Jᵀ
    Transpose,
    /// NJᵀ
    NormalisedTranspose,
    /// J⁺ by singular values
    PseudoInverse,
    /// Damped least squares, μ = 0.05 m
    Damped,
    /// Selectively damped least squares
    SelectivelyDamped,
}

impl StepperKind {
    /// All of them.
    pub const ALL: [StepperKind; 5] = [
        StepperKind::Transpose,
        StepperKind::NormalisedTranspose,
        StepperKind::PseudoInverse,
        StepperKind::Damped,
        StepperKind::SelectivelyDamped,
    ];

    /// The core's stepper, with its default settings.
    #[inline(always)]
    pub fn stepper<T: Real>(self) -> AnyStepper<T> {
        match self {
            StepperKind::Transpose => AnyStepper::Transpose(Transpose),
            StepperKind::NormalisedTranspose => {
                AnyStepper::NormalisedTranspose(NormalisedTranspose)
            }
            StepperKind::PseudoInverse => AnyStepper::PseudoInverse(PseudoInverse),
            StepperKind::Damped => AnyStepper::Damped(Damped::default()),
            StepperKind::SelectivelyDamped => {
                AnyStepper::SelectivelyDamped(SelectivelyDamped::default())
            }
        }
    }

    /// The SPEC's default λ.
    pub fn rate(self) -> f64 {
        self.stepper::<f64>().rate()
    }
}

/// The synergy models, as files and the command line name them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum ModelKind {
    /// One gain for all DoFs
    A,
    /// A gain for each DoF
    B,
    /// A gain for each DoF and one sigmoid in time
    C,
    /// A gain and a sigmoid for each DoF
    D,
}

impl From<ModelKind> for Model {
    fn from(kind: ModelKind) -> Model {
        match kind {
            ModelKind::A => Model::A,
            ModelKind::B => Model::B,
            ModelKind::C => Model::C,
            ModelKind::D => Model::D,
        }
    }
}

/// How the controller is set: the same for every motion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The inverse kinematics.
    pub stepper: StepperKind,
    /// The synergy.
    pub model: ModelKind,
    /// λ; its unit is the stepper's.
    pub lambda: f64,
    /// Ticks a second.
    pub rate_hz: f64,
    /// Whether ticks keep within the joint limits.
    pub clamped: bool,
}

impl Settings {
    /// The period, seconds.
    pub fn dt(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// The core's word for [`clamped`](Self::clamped).
    pub fn limits(&self) -> Limits {
        if self.clamped {
            Limits::Clamped
        } else {
            Limits::Free
        }
    }

    /// The model that lies within this one, if one does (S_A in S_B, S_C in S_D), and for each parameter the number of
    /// that of the smaller model which stands in its place.
    pub fn nested(&self, dofs: usize) -> Option<(ModelKind, Vec<usize>)> {
        match self.model {
            ModelKind::A | ModelKind::C => None,
            ModelKind::B => Some((ModelKind::A, vec![0; dofs])),
            ModelKind::D => {
                let gains = 0..dofs;
                let others = [dofs, dofs + 1].into_iter().flat_map(|k| vec![k; dofs]);
                Some((ModelKind::C, gains.chain(others).collect()))
            }
        }
    }

    /// Which part of the synergy each parameter belongs to, a DoF or the sigmoid that all share, and how many there are.
    pub fn parts(&self, dofs: usize) -> (Vec<usize>, usize) {
        match self.model {
            ModelKind::A => (vec![0], 1),
            ModelKind::B => ((0..dofs).collect(), dofs),
            ModelKind::C => ((0..dofs).chain([dofs, dofs]).collect(), dofs + 1),
            ModelKind::D => ((0..3 * dofs).map(|k| k % dofs).collect(), dofs),
        }
    }

    /// The bounds of each parameter for `dofs` DoFs.
    pub fn bounds(&self, dofs: usize) -> Vec<(f32, f32)> {
        let model = Model::from(self.model);
        let bounds = |k| {
            let (lower, upper) = model.bounds(dofs, k);
            (lower as f32, upper as f32)
        };
        (0..model.parameters(dofs)).map(bounds).collect()
    }
}

/// A whole search: which motions share a parameter vector, and how large the population for each vector is.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// How the controller is set.
    pub settings: Settings,
    /// The motions. All of their chains have the same number of DoFs.
    pub tasks: Vec<Task>,
    /// For each parameter vector, the motions (indices) that it is learned from; its score is their mean.
    pub sets: Vec<Vec<usize>>,
    /// Islands of [`ISLAND`] members for each set, as the search begins.
    pub islands: usize,
    /// Of the random numbers.
    pub seed: u64,
}

impl Problem {
    /// For tests: of some of the shipped sample's reaches, each with a parameter vector of its own, two islands of each.
    #[cfg(test)]
    pub(crate) fn of_sample(reaches: &[usize], stepper: StepperKind, model: ModelKind) -> Problem {
        let sample = crate::sample::shipped().unwrap();
        let arm = crate::task::Arm::Human(crate::task::facing(&sample));
        let task = |&reach: &usize| Task::new(&sample[reach], &arm, 60.0).unwrap();
        Problem {
            settings: Settings {
                stepper,
                model,
                lambda: stepper.rate(),
                rate_hz: 60.0,
                clamped: false,
            },
            tasks: reaches.iter().map(task).collect(),
            sets: (0..reaches.len()).map(|set| vec![set]).collect(),
            islands: 2,
            seed: 5,
        }
    }

    /// How many DoFs the chains have.
    pub fn dofs(&self) -> usize {
        self.tasks.first().map_or(0, |task| task.chain.joints.len())
    }

    /// How many parameters a member has.
    pub fn genes(&self) -> usize {
        Model::from(self.settings.model).parameters(self.dofs())
    }

    /// How many members each set has.
    pub fn population(&self) -> usize {
        self.islands * ISLAND
    }

    /// How long a motion's recording takes, seconds.
    pub fn seconds(&self, task: &Task) -> f64 {
        task.reference.len().saturating_sub(1) as f64 * self.settings.dt()
    }

    /// The same for other motions, with a parameter vector for each.
    pub fn each_of(&self, tasks: Vec<Task>) -> Problem {
        Problem {
            settings: self.settings,
            sets: (0..tasks.len()).map(|task| vec![task]).collect(),
            tasks,
            islands: self.islands,
            seed: self.seed,
        }
    }

    /// How often a tick of one motion is computed in one generation.
    pub fn frames_a_generation(&self) -> u64 {
        let frames = |&task: &usize| {
            self.tasks
                .get(task)
                .map_or(0, |task| task.reference.len() as u64)
        };
        self.sets.iter().flatten().map(frames).sum::<u64>() * self.population() as u64
    }
}

/// Calls a function that is generic over the number of DoFs, for a number known when the program runs.
macro_rules! with_dofs {
    ($dofs:expr, $n:ident => $body:expr, else $other:expr) => {
        match $dofs {
            1 => {
                const $n: usize = 1;
                $body
            }
            2 => {
                const $n: usize = 2;
                $body
            }
            3 => {
                const $n: usize = 3;
                $body
            }
            4 => {
                const $n: usize = 4;
                $body
            }
            5 => {
                const $n: usize = 5;
                $body
            }
            6 => {
                const $n: usize = 6;
                $body
            }
            7 => {
                const $n: usize = 7;
                $body
            }
            8 => {
                const $n: usize = 8;
                $body
            }
            _ => $other,
        }
    };
}
pub(crate) use with_dofs;

/// The mean, of distances mostly; 0 of nothing.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values
        .into_iter()
        .fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
    sum / f64::from(count.max(1))
}
