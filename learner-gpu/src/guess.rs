//! Parameters guessed from the recording, for descents to begin at.
//!
//! The recorded motion as joint vectors θ(t) is known (the posture that lies nearest to the landmarks, frame by frame:
//! [`crate::task::Task::postures`]), and with it the step ΔΘ(t) that the inverse kinematics takes at each. Along it the
//! parameters of one DoF do not meddle with another's: θᵢ(t) − θᵢ(0) ≈ gᵢ·Σ φᵢ(τ) ΔΘᵢ(τ), which for a given sigmoid has
//! its best gain in closed form (least squares), and the sigmoids are tried one by one. It is what learning a recurrence
//! calls teacher forcing (Williams and Zipser 1989, *Neural Computation* 1): the motion that parameters make is left for
//! the one they should make.
//!
//! A motion strays from the recording as soon as it starts, so a guess is only near: a descent from it ends far below
//! where one from anywhere does.

use std::ops::Range;

use rayon::prelude::*;
use sinew::controller::{Controller, Limits};
use sinew::real::Real;
use sinew::synergy::Synergy;

use crate::kernel::proposal::gene;
use crate::problem::{ModelKind, Problem, Settings, with_dofs};
use crate::task::{Task, TaskError};

/// Offsets and slopes of sigmoids that are tried, evenly over their bounds.
const OFFSETS: usize = 24;
const SLOPES: usize = 10;
/// Guesses kept of each block, the best.
const KEPT: usize = 60;

/// What is guessed for a set of motions: genes that belong together, in blocks, and several guesses of each block.
#[derive(Clone, Debug, PartialEq)]
pub struct Guesses(Vec<Block>);

/// Some genes, and guesses of them, the best first.
#[derive(Clone, Debug, PartialEq)]
struct Block {
    genes: Vec<usize>,
    guesses: Vec<Vec<u32>>,
}

impl Guesses {
    /// For each of the problem's sets.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn new(problem: &Problem) -> Result<Vec<Self>, TaskError> {
        let dofs = problem.dofs();
        let sigmoids = sigmoids(&problem.settings, dofs);
        let sums = |task: &Task| {
            let trace = trace(&problem.settings, task)?;
            let sums = |&sigmoid: &Option<Sigmoid>| trace.sums(sigmoid, problem.settings.dt());
            Ok(sigmoids.iter().map(sums).collect())
        };
        let each: Vec<Vec<Vec<Sums>>> = problem
            .tasks
            .par_iter()
            .map(sums)
            .collect::<Result<_, TaskError>>()?;
        let guesses = |set: &Vec<usize>| {
            let mut total = vec![vec![Sums::default(); dofs]; sigmoids.len()];
            for sums in set.iter().filter_map(|&task| each.get(task)) {
                for (total, sums) in total.iter_mut().flatten().zip(sums.iter().flatten()) {
                    total.add(sums);
                }
            }
            Guesses(blocks(&problem.settings, dofs, &sigmoids, &total))
        };
        Ok(problem.sets.iter().map(guesses).collect())
    }

    /// All genes, of each block one of its guesses: those better are likelier. A `draw` for each block.
    pub fn draw(&self, genes: usize, draws: impl Fn(usize) -> u32) -> Vec<u32> {
        let mut out = vec![0; genes];
        for block in 0..self.0.len() {
            self.put(&mut out, block, draws(block));
        }
        out
    }

    /// Puts one of a block's guesses in place. Blocks count on from 0 after the last.
    pub fn put(&self, genes: &mut [u32], block: usize, draw: u32) {
        let Some(block) = self.0.get(block % self.0.len().max(1)) else {
            return;
        };
        // The square of a uniform draw.
        let share = u64::from(draw >> 16).pow(2);
        let guess = (share * block.guesses.len() as u64) >> 32;
        for (&gene, &to) in block.genes.iter().zip(&block.guesses[guess as usize]) {
            genes[gene] = to;
        }
    }
}

/// Offset and slope.
type Sigmoid = (f64, f64);

/// The sigmoids that a model is tried with: none where it has none.
fn sigmoids(settings: &Settings, dofs: usize) -> Vec<Option<Sigmoid>> {
    let bounds = settings.bounds(dofs);
    let (offset, slope) = match settings.model {
        ModelKind::A | ModelKind::B => return vec![None],
        ModelKind::C => (bounds[dofs], bounds[dofs + 1]),
        ModelKind::D => (bounds[dofs], bounds[2 * dofs]),
    };
    let at = |(lower, upper): (f32, f32), k: usize, of: usize| {
        f64::from(lower) + f64::from(upper - lower) * k as f64 / (of - 1) as f64
    };
    let every = |k: usize| {
        Some((
            at(offset, k % OFFSETS, OFFSETS),
            at(slope, k / OFFSETS, SLOPES),
        ))
    };
    (0..OFFSETS * SLOPES).map(every).collect()
}

/// A recorded motion as the inverse kinematics sees it.
struct Trace {
    /// For each frame and DoF: how far it has come since the first frame, and the step that a gain of 1 would take.
    frames: Vec<Vec<(f64, f64)>>,
}

/// The trace of a task.
fn trace(settings: &Settings, task: &Task) -> Result<Trace, TaskError> {
    let dofs = task.chain.joints.len();
    with_dofs!(dofs, N => {
        let core = |error| TaskError::Core { motion: task.name.clone(), error };
        let chain = task.chain.build::<N>()?;
        let synergy = Synergy::<f64, N>::a(1.0).map_err(core)?;
        let stepper = settings.stepper.stepper::<f64>();
        let controller =
            Controller::new(&chain, stepper, synergy, settings.lambda, settings.dt(), Limits::Free)
                .map_err(core)?;
        let goal = task.goal::<f64>()?;
        let first = task.posture::<f64, N>()?;
        let frame = |q: [f64; N]| {
            let mut state = controller.start(q);
            controller.tick(&mut state, &goal);
            let step = state.angles();
            (0..N).map(|i| (q[i] - first[i], step[i] - q[i])).collect()
        };
        Ok(Trace { frames: task.postures::<N>()?.into_iter().map(frame).collect() })
    }, else Err(TaskError::Dofs { found: dofs }))
}

impl Trace {
    /// For each DoF what its best gain follows from, with one sigmoid.
    fn sums(&self, sigmoid: Option<Sigmoid>, dt: f64) -> Vec<Sums> {
        let dofs = self.frames.first().map_or(0, Vec::len);
        let mut sums = vec![Sums::default(); dofs];
        let mut reached = vec![0.0; dofs];
        for (k, frame) in self.frames.iter().enumerate() {
            let share = sigmoid.map_or(1.0, |(offset, slope)| {
                1.0 / (1.0 + Real::exp(offset - slope * k as f64 * dt))
            });
            for ((sums, reached), &(way, step)) in sums.iter_mut().zip(&mut reached).zip(frame) {
                sums.add(&Sums {
                    square: *reached * *reached,
                    product: *reached * way,
                });
                *reached += share * step;
            }
        }
        sums
    }
}

/// Over frames: of what a gain of 1 reaches, its square, and its product with what is to be reached.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    square: f64,
    product: f64,
}

impl Sums {
    fn add(&mut self, other: &Sums) {
        self.square += other.square;
        self.product += other.product;
    }

    /// The best gain, and how much of the squared way is left with it: less is better, 0 is none.
    fn best(&self, (lower, upper): (f32, f32)) -> (f64, f64) {
        let gain = (self.product / self.square.max(1e-12)).clamp(lower.into(), upper.into());
        (gain, gain * (gain * self.square - 2.0 * self.product))
    }
}

/// A model's blocks, from the sums with each sigmoid.
fn blocks(
    settings: &Settings,
    dofs: usize,
    sigmoids: &[Option<Sigmoid>],
    sums: &[Vec<Sums>],
) -> Vec<Block> {
    let bounds = settings.bounds(dofs);
    // The gains of some of the sums, then the sigmoid.
    let block = |genes: Vec<usize>, of: Range<usize>, sums: &[Vec<Sums>]| {
        let guess = |(sigmoid, sums): (&Option<Sigmoid>, &Vec<Sums>)| {
            let best = sums[of.clone()].iter().map(|sums| sums.best(bounds[0]));
            let (mut values, left): (Vec<f64>, Vec<f64>) = best.unzip();
            values.extend(sigmoid.iter().flat_map(|&(offset, slope)| [offset, slope]));
            (values, left.iter().sum())
        };
        let mut guesses: Vec<(Vec<f64>, f64)> = sigmoids.iter().zip(sums).map(guess).collect();
        guesses.sort_by(|a, b| a.1.total_cmp(&b.1));
        let values = |(values, _): &(Vec<f64>, f64)| {
            let each = genes.iter().zip(values);
            each.map(|(&k, &value)| gene(value, bounds[k])).collect()
        };
        let guesses = guesses.iter().take(KEPT).map(values).collect();
        Block { genes, guesses }
    };
    match settings.model {
        // One gain: as if all DoFs were one.
        ModelKind::A => {
            let one = |sums: &Vec<Sums>| {
                let mut all = Sums::default();
                sums.iter().for_each(|sums| all.add(sums));
                vec![all]
            };
            let sums: Vec<Vec<Sums>> = sums.iter().map(one).collect();
            vec![block(vec![0], 0..1, &sums)]
        }
        ModelKind::C => vec![block((0..dofs + 2).collect(), 0..dofs, sums)],
        ModelKind::B | ModelKind::D => {
            let of = |i: usize| block((i..bounds.len()).step_by(dofs).collect(), i..i + 1, sums);
            (0..dofs).map(of).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernel::proposal::GENE;
    use crate::kernel::score::Ready;
    use crate::problem::StepperKind;
    use crate::refine::Landscape;

    /// A reach of the sample, made anew with known parameters.
    fn made(model: ModelKind, parameters: &[f64]) -> Problem {
        let mut problem = Problem::of_sample(&[4], StepperKind::PseudoInverse, model);
        let task = &mut problem.tasks[0];
        let frames = task.reference.len();
        let mut reference = Vec::new();
        let ready = Ready::<f64, 7>::new(task).unwrap();
        let visit = |_, at: &sinew::kinematics::Kinematics<'_, f64, 7>, _: &[f64; 7]| {
            reference.push(at.landmarks().collect());
        };
        ready
            .synthesise(&problem.settings, parameters, frames, visit)
            .unwrap();
        task.reference = reference;
        Problem {
            islands: 1,
            seed: 1,
            ..problem
        }
    }

    #[test]
    fn the_first_guess_is_near_the_parameters_that_made_a_motion() {
        let gains = [0.8, 1.2, 0.5, 1.0, 0.7, 1.1, 0.9];
        let (offsets, slopes) = ([2.0, 3.0, 1.0, 4.0, 2.0, 3.0, 2.0], [6.0; 7]);
        for (model, parameters) in [
            (ModelKind::A, vec![0.6]),
            (ModelKind::B, gains.to_vec()),
            (ModelKind::C, [&gains[..], &[3.0, 7.0]].concat()),
            (ModelKind::D, [gains, offsets, slopes].concat()),
        ] {
            let problem = made(model, &parameters);
            let guesses = Guesses::new(&problem).unwrap();
            let guess = guesses[0].draw(problem.genes(), |_| 0);
            let middle = vec![GENE / 2; problem.genes()];
            let landscape = Landscape::new(&problem).unwrap();
            let scores = landscape.scores(&[(0, &guess), (0, &middle)]);
            // Metres; from the middle of the bounds, where gains are 0, the arm does not move at all.
            assert!(scores[0] < 0.004, "{model:?}: {scores:?}");
            assert!(scores[1] > 0.03, "{model:?}: {scores:?}");
        }
    }

    #[test]
    fn every_draw_is_within_bounds_and_changes_only_its_block() {
        let problem = made(ModelKind::D, &[1.0; 21]);
        let guesses = &Guesses::new(&problem).unwrap()[0];
        for draw in [0, 1 << 20, u32::MAX / 2, u32::MAX] {
            let genes = guesses.draw(21, |block| draw.rotate_left(block as u32));
            assert!(genes.iter().all(|&gene| gene <= GENE));
            let mut changed = vec![7; 21];
            guesses.put(&mut changed, 2 + 7, draw);
            for (k, &gene) in changed.iter().enumerate() {
                assert!(gene == 7 || k % 7 == 2);
            }
        }
    }
}
