//! The problem's motions as the kernel reads them: the arms' common structure, and numbers and frames of each.

use sinew::chain::Chain;
use sinew::synergy::Model;

use super::error::GpuError;
use crate::kernel::compose::{Method, Structure};
use crate::motion::Point;
use crate::problem::{Problem, StepperKind, with_dofs};
use crate::task::{Task, TaskError};

/// Turns that a thread's loops make in a dispatch, at most: lavapipe leaves them, without a word, after 65,535 turns of
/// all of them together.
pub(super) const TURNS: usize = 60_000;
/// Turns that a frame takes whose tick needs singular values: 10 of them sweeps.
pub(super) const TURNS_A_HARD_FRAME: usize = 13;

/// Frames that a thread runs in a dispatch, at most.
pub(super) fn most_frames(stepper: StepperKind) -> usize {
    let turns_a_frame = match stepper {
        StepperKind::PseudoInverse | StepperKind::SelectivelyDamped => TURNS_A_HARD_FRAME,
        _ => 1,
    };
    TURNS / turns_a_frame
}

/// All motions, ready to be uploaded.
pub(super) struct Motions {
    /// What the kernel is composed for.
    pub structure: Structure,
    /// One for each task.
    pub each: Vec<Motion>,
}

/// One motion.
pub(super) struct Motion {
    /// Its own numbers and its recorded frames, as the kernel has them.
    pub data: Vec<u32>,
    /// How many frames that are.
    pub frames: u32,
}

impl Motions {
    /// The motions of a problem.
    ///
    /// # Errors
    /// A task that the core refuses, arms that share no structure, or a frame with the wrong number of points.
    pub fn new(problem: &Problem) -> Result<Self, GpuError> {
        let dofs = problem.dofs();
        with_dofs!(dofs, N => Self::sized::<N>(problem), else Err(TaskError::Dofs { found: dofs }.into()))
    }

    /// Bytes that the motions of a set take, at most.
    pub fn most_data(&self, problem: &Problem) -> u64 {
        let bytes = |set: &Vec<usize>| {
            let motions = set.iter().filter_map(|&task| self.each.get(task));
            motions.map(|motion| motion.data.len() as u64 * 4).sum()
        };
        problem.sets.iter().map(bytes).max().unwrap_or(0)
    }

    fn sized<const N: usize>(problem: &Problem) -> Result<Self, GpuError> {
        let settings = &problem.settings;
        let method = Method {
            stepper: settings.stepper.stepper(),
            model: Model::from(settings.model),
            clamped: settings.clamped,
        };
        let chains = problem
            .tasks
            .iter()
            .map(|task| task.chain.build::<N>().map_err(TaskError::from))
            .collect::<Result<Vec<Chain<f64, N>>, TaskError>>()?;
        let still = problem.tasks.iter().zip(&chains);
        let still = still.map(|(task, chain)| task.still(chain)).min();
        let still = still.unwrap_or(0);
        let chains: Vec<Chain<f32, N>> = chains.iter().map(Chain::cast).collect();
        let structure = Structure::new(&chains, &method)?.beyond(still);
        let most = most_frames(settings.stepper);
        let long = |task: &&Task| task.reference.len() > most;
        if let Some(task) = problem.tasks.iter().find(long) {
            return Err(GpuError::Frames {
                motion: task.name.clone(),
                found: task.reference.len(),
                most,
            });
        }
        let each = problem
            .tasks
            .iter()
            .zip(&chains)
            .map(|(task, chain)| Motion::new(task, chain, &structure))
            .collect::<Result<_, _>>()?;
        Ok(Motions { structure, each })
    }
}

impl Motion {
    fn new<const N: usize>(
        task: &Task,
        chain: &Chain<f32, N>,
        structure: &Structure,
    ) -> Result<Self, GpuError> {
        let initial = task.posture::<f32, N>()?;
        let target = task.goal::<f32>()?;
        let points = structure.points();
        if let Some((frame, wrong)) = task
            .reference
            .iter()
            .enumerate()
            .find(|(_, frame)| frame.len() != points)
        {
            let motion = task.name.clone();
            return Err(GpuError::Points {
                motion,
                frame,
                expected: points,
                found: wrong.len(),
            });
        }
        let numbers = structure.numbers(chain, &initial, target.coordinates());
        let frame = |points: &Vec<Point>| {
            let points: Vec<_> = points.iter().map(|point| point.map(|x| x as f32)).collect();
            structure.frame(&points)
        };
        Ok(Motion {
            data: numbers
                .into_iter()
                .chain(task.reference.iter().flat_map(frame))
                .map(f32::to_bits)
                .collect(),
            frames: task.reference.len() as u32,
        })
    }
}
