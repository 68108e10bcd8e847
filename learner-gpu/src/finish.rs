//! The end of a search: its best members stride on ([`mod@crate::adapt`]), and what is best in `f64` has won.
//!
//! Descents end in ripples where the distance is rugged, so that the best member need not lie in the best valley. A *pool*
//! of each set, islands' bests among it, goes on with strides; then the better half of those that gained, and so on
//! (successive halving: Jamieson and Talwalkar 2016).
//!
//! That is in `f32`, on the lanes, like all before. But NJᵀ swings about its target, and there the last bits of `f32` grow
//! to some per cent of the distance: strides would learn `f32`'s ripples, which `f64` has elsewhere. Where the two differ so
//! much, strides are in `f64`, on the lanes as well.

use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::kernel::anneal::{Island, UNSCORED};
use crate::kernel::proposal::ISLAND;
use crate::learn::{CHECKPOINT_EVERY, Checkpoint, LearnError, Search, draws};
use crate::problem::Problem;
use crate::refine::{Landscape, Precision, shares};
use crate::synergies::score;
use crate::task::TaskError;

/// How many of a set's members stride on.
const POOL: usize = 6;
/// As long as they gain this share, and are in the better half.
const WORTH: f64 = 0.01;
/// `f32` and `f64` differ so much, as a share of the score, where strides are in `f64`.
const RUGGED: f64 = 5e-3;
/// Sets for each thread between two reports: so many that none waits long for the slowest.
const SETS_AT_ONCE: usize = 2;

/// A set's best parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Winner {
    /// In the SPEC's order.
    pub parameters: Vec<f64>,
    /// The distance of each of the set's motions, metres.
    pub distances: Vec<f64>,
    /// The parameters as shares of their bounds.
    pub(crate) point: Vec<f32>,
}

/// A point of the bounds, with its score in metres.
type Scored = (Vec<f32>, f64);

impl Search {
    /// Each set's best parameters, with the distance in metres of each of the set's motions by the core in `f64`. None
    /// where `stop` was set meanwhile: `checkpoint`, where there is one, then keeps those of the sets that are done. `report`
    /// is told how many these are.
    ///
    /// # Errors
    /// A task that the core refuses, or a checkpoint that cannot be written.
    pub fn winners(
        &mut self,
        problem: &Problem,
        stop: &AtomicBool,
        checkpoint: Option<&Checkpoint>,
        mut report: impl FnMut(usize),
    ) -> Result<Option<Vec<Winner>>, LearnError> {
        let landscape = Landscape::new(problem)?;
        let mut saved = Instant::now();
        let at_once = SETS_AT_ONCE * rayon::current_num_threads();
        let a_set = problem.islands.max(1);
        while self.winners.len() < self.islands.len() / a_set {
            let done = self.winners.len();
            report(done);
            let began = Instant::now();
            let count = AtomicU64::new(0);
            let some = self.islands.par_chunks(a_set).enumerate();
            let some = some.skip(done).take(at_once);
            let found: Option<Vec<Vec<f32>>> = some
                .map(|(set, islands)| {
                    let within = self.winner_within(problem, set);
                    let pool = Pool::new(&landscape, set, islands, within);
                    pool.stride(problem, self.generation, &count, stop)
                })
                .collect();
            self.seconds += began.elapsed().as_secs_f64();
            for (set, point) in found.iter().flatten().enumerate() {
                let winner = winner(problem, done + set, point)?;
                self.winners.push(winner);
            }
            // What a stop cut off is done again.
            if found.is_some() {
                self.evaluations += count.into_inner();
            }
            if let Some(checkpoint) = checkpoint
                && (found.is_none() || saved.elapsed().as_secs_f64() > CHECKPOINT_EVERY)
            {
                checkpoint.write(self)?;
                saved = Instant::now();
            }
            if found.is_none() {
                return Ok(None);
            }
        }
        Ok(Some(self.winners.clone()))
    }
}

/// What goes on of a set.
struct Pool<'a> {
    landscape: &'a Landscape<'a>,
    set: usize,
    /// What strides are in.
    precision: Precision,
    members: Vec<Scored>,
}

impl<'a> Pool<'a> {
    /// Of a set's islands: the member that is best in `f64`, or the best of the model within if that is better; then each
    /// island's best, for these lie in different valleys, then what other members are best.
    fn new(
        landscape: &'a Landscape<'a>,
        set: usize,
        islands: &[Island],
        within: Option<Vec<f32>>,
    ) -> Self {
        let leaders = islands.iter().map(|island| {
            let point = shares(&island.best);
            (point, f64::from(island.best_score))
        });
        let others = islands.iter().flat_map(|island| {
            let members = island.scores.iter().enumerate();
            members.map(|(member, &score)| (shares(&island.member(member)), f64::from(score)))
        });
        let best = |members: Vec<Scored>, most| {
            let begun = |member: &Scored| member.1 < UNSCORED.into();
            let mut members: Vec<Scored> = members.into_iter().filter(begun).collect();
            members.sort_by(|a, b| a.1.total_cmp(&b.1));
            members.truncate(most);
            members
        };
        let mut members = best(leaders.collect(), POOL / 2);
        members.extend(best(others.collect(), ISLAND));
        members.extend(within.map(|point| {
            let score = landscape.scores_at(&[(set, point.clone())]);
            (point, score.first().copied().unwrap_or(UNSCORED).into())
        }));

        let exact = landscape.exact_scores(set, members.iter().map(|(point, _)| &point[..]));
        let differs = |(exact, (_, score)): (&f64, &Scored)| (exact - score).abs() > RUGGED * score;
        let rugged = exact.iter().zip(&members).any(differs);
        let winner = (0..members.len()).min_by(|&a, &b| exact[a].total_cmp(&exact[b]));
        if rugged {
            for ((_, score), exact) in members.iter_mut().zip(exact) {
                *score = exact;
            }
        }
        if let Some(winner) = winner {
            members[..=winner].rotate_right(1);
        }
        let mut pool: Vec<Scored> = Vec::new();
        for member in members {
            if pool.len() < POOL && pool.iter().all(|other| other.0 != member.0) {
                pool.push(member);
            }
        }
        Pool {
            landscape,
            set,
            precision: if rugged {
                Precision::F64
            } else {
                Precision::F32
            },
            members: pool,
        }
    }

    /// Strides on until nothing gains, and gives the point that is best in `f64` then. The draws are those of a generation
    /// that the search did not get to. None where `stop` was set meanwhile.
    fn stride(
        mut self,
        problem: &Problem,
        generation: u32,
        count: &AtomicU64,
        stop: &AtomicBool,
    ) -> Option<Vec<f32>> {
        let mut chosen: Vec<usize> = (0..self.members.len()).collect();
        let mut run = 0;
        while !chosen.is_empty() {
            let start = |&member: &usize| {
                let draws = draws(problem, self.set, run * POOL + member, generation + 1);
                (self.set, self.members[member].0.clone(), draws)
            };
            let starts: Vec<_> = chosen.iter().map(start).collect();
            let ends = self.landscape.adapt(&starts, self.precision, count, stop)?;
            let mut gains = [false; POOL];
            for (&member, end) in chosen.iter().zip(ends) {
                let gain = self.members[member].1 - end.1;
                gains[member] = gain > WORTH * end.1;
                if gain > 0.0 {
                    self.members[member] = end;
                }
            }
            run += 1;
            let mut order: Vec<usize> = (0..self.members.len()).collect();
            order.sort_by(|&a, &b| self.members[a].1.total_cmp(&self.members[b].1));
            order.truncate(self.members.len() >> run);
            chosen = order.into_iter().filter(|&member| gains[member]).collect();
        }
        let points = self.members.iter().map(|(point, _)| &point[..]);
        let exact = self.landscape.exact_scores(self.set, points);
        let members = self.members.into_iter().zip(exact);
        let best = members.min_by(|a, b| a.1.total_cmp(&b.1));
        Some(best.map(|((point, _), _)| point).unwrap_or_default())
    }
}

/// What a set's best point is worth.
fn winner(problem: &Problem, set: usize, point: &[f32]) -> Result<Winner, TaskError> {
    let bounds = problem.settings.bounds(problem.dofs());
    // As the lanes have them: f32 holds them.
    let parameters = point.iter().zip(&bounds);
    let parameters: Vec<f64> = parameters
        .map(|(&share, &(lower, upper))| (lower + (upper - lower) * share).into())
        .collect();
    let motions = problem.sets.get(set).into_iter().flatten();
    let tasks = motions.filter_map(|&task| problem.tasks.get(task));
    let distances = tasks.map(|task| score(&problem.settings, task, &parameters));
    Ok(Winner {
        distances: distances.collect::<Result<_, _>>()?,
        parameters,
        point: point.to_vec(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learn::{Backend, GENERATIONS_A_ROUND, Kept};
    use crate::problem::{ModelKind, Settings, StepperKind};
    use crate::task::{Arm, Task, facing};
    use std::cell::Cell;
    use std::sync::atomic::Ordering;

    /// The shipped sample's first two reaches, each `times` over.
    fn problem(stepper: StepperKind, model: ModelKind, times: usize) -> Problem {
        let reaches = crate::sample::shipped().unwrap();
        let arm = Arm::Human(facing(&reaches));
        let tasks: Vec<Task> = reaches[..2]
            .iter()
            .map(|reach| Task::new(reach, &arm, 60.0).unwrap())
            .collect();
        let lambda = stepper.rate();
        Problem {
            settings: Settings {
                stepper,
                model,
                lambda,
                rate_hz: 60.0,
                clamped: false,
            },
            tasks,
            sets: (0..2 * times).map(|set| vec![set % 2]).collect(),
            islands: 2,
            seed: 5,
        }
    }

    /// After one round.
    fn search(problem: &Problem) -> Search {
        let mut search = Search::new(problem);
        let stop = AtomicBool::new(false);
        let most = GENERATIONS_A_ROUND;
        search
            .run(problem, &mut Backend::Cpu, most, &stop, None, |_| {})
            .unwrap();
        search
    }

    #[test]
    fn lanes_of_f64_score_what_the_core_does_to_the_bit() {
        for stepper in StepperKind::ALL {
            for model in [ModelKind::A, ModelKind::B, ModelKind::C, ModelKind::D] {
                let problem = problem(stepper, model, 1);
                let points: Vec<Vec<f32>> = (0..11)
                    .map(|n| {
                        let gene = |k| ((7 + 13 * n + 29 * k) % 32) as f32 / 32.0;
                        (0..problem.genes()).map(gene).collect()
                    })
                    .collect();
                let landscape = Landscape::new(&problem).unwrap();
                let by_lanes = landscape.exact_scores(1, points.iter().map(Vec::as_slice));
                for (point, by_lanes) in points.iter().zip(by_lanes) {
                    let by_core = winner(&problem, 1, point).unwrap().distances[0];
                    assert_eq!(by_lanes, by_core, "{stepper:?} {model:?}");
                }
            }
        }
    }

    #[test]
    fn strides_end_no_worse_than_they_begin_in_the_precision_that_it_takes() {
        for (stepper, expected) in [
            (StepperKind::PseudoInverse, Precision::F32),
            (StepperKind::NormalisedTranspose, Precision::F64),
        ] {
            let problem = problem(stepper, ModelKind::C, 1);
            let search = search(&problem);
            let landscape = Landscape::new(&problem).unwrap();
            let pool = Pool::new(&landscape, 0, &search.islands[..2], None);
            assert_eq!(pool.precision, expected);
            assert_eq!(pool.members.len(), POOL);
            let points = pool.members.iter().map(|(point, _)| &point[..]);
            let before = landscape.exact_scores(0, points);
            let least = before.iter().fold(f64::INFINITY, |a, &b| a.min(b));
            assert_eq!(least, before[0]);
            let (count, stop) = (AtomicU64::new(0), AtomicBool::new(false));
            let point = pool.stride(&problem, 16, &count, &stop).unwrap();
            let after = winner(&problem, 0, &point).unwrap().distances[0];
            assert!(after <= least * (1.0 + 1e-5), "{after} after {least}");
            assert!(count.into_inner() > 0);
        }
    }

    #[test]
    fn what_is_stopped_goes_on_with_the_next_set_and_ends_with_the_same_bits() {
        let at_once = SETS_AT_ONCE * rayon::current_num_threads();
        let problem = problem(StepperKind::PseudoInverse, ModelKind::A, at_once);
        let folder = tempfile::tempdir().unwrap();
        let checkpoint = Checkpoint::new(folder.path(), &problem, "cpu");
        let mut first = search(&problem);
        let mut whole = first.clone();
        let never = AtomicBool::new(false);
        let winners = whole.winners(&problem, &never, None, |_| {}).unwrap();
        let winners = winners.unwrap();
        assert_eq!(winners.len(), 2 * at_once);

        let stop = AtomicBool::new(false);
        let after_some = |done| stop.store(done > 0, Ordering::Relaxed);
        let stopped = first.winners(&problem, &stop, Some(&checkpoint), after_some);
        assert_eq!(stopped.unwrap(), None);
        let Kept::Search(mut second) = checkpoint.read() else {
            panic!("nothing kept");
        };
        let begins = Cell::new(None);
        let again = second.winners(&problem, &never, None, |done| {
            begins.set(begins.get().or(Some(done)));
        });
        assert_eq!(begins.get(), Some(at_once));
        assert_eq!(again.unwrap().unwrap(), winners);
        assert_eq!(second.evaluations, whole.evaluations);
    }
}
