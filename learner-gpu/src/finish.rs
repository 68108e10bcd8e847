//! The end of a search: its best members stride on ([`mod@crate::adapt`]), and what is best in `f64` has won.
//!
//! Descents end in ripples where the distance is rugged, so that the best member need not lie in the best valley. In the
//! first turn a *pool* of each set, islands' bests among it, goes on with strides; then the better half of those that gained,
//! and so on (successive halving: Jamieson and Talwalkar 2016). In each turn that follows what has won for other sets strides
//! on for this one, as long as that is promising: a valley that one person's reaches have in common was found by some of
//! them alone.
//!
//! That is in `f32`, on the lanes, like all before. But NJᵀ swings about its target, and there the last bits of `f32` grow
//! to some per cent of the distance: strides would learn `f32`'s ripples, which `f64` has elsewhere. Where the two differ so
//! much, strides are in `f64`, on the lanes as well, and have more offspring; and what has won strides on with the others'.

use std::sync::atomic::{AtomicBool, AtomicU64};
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::checkpoint::Keeper;
use crate::kernel::anneal::{Island, UNSCORED};
use crate::kernel::proposal::{Draws, ISLAND};
use crate::learn::{LearnError, Search, bests, draws};
use crate::problem::{Problem, mean};
use crate::refine::{Landscape, Precision, Strides, Tape, shares};
use crate::synergies::score;
use crate::task::TaskError;

/// How many of a set's members stride on,
const POOL: usize = 4;
/// as long as they gain this share, and are in the better half.
const WORTH: f64 = 0.01;
/// How many of other sets' winners stride on in a turn after the first,
const GUESTS: usize = 6;
/// and how many such turns there are, at most.
const EXCHANGES: usize = 3;
/// Where strides gained less than this share it is smooth: descents from others' bests have found most of what there is,
const SMOOTH: f64 = 1e-3;
/// and fewer guests do.
const GUESTS_WHERE_SMOOTH: usize = 2;
/// `f32` and `f64` differ so much, as a share of the score, where strides are in `f64`.
const RUGGED: f64 = 5e-3;

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

/// What strides of a set that was cut off had come to: the tapes of every run.
type Tapes = Vec<Vec<Tape>>;

/// A point of the bounds, with its score in metres.
type Scored = (Vec<f32>, f64);

impl Search {
    /// Each set's best parameters, with the distance in metres of each of the set's motions by the core in `f64`. None
    /// where it was told to stop meanwhile: what is done is kept, and it goes on from there.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn winners(
        &mut self,
        problem: &Problem,
        keeper: &Keeper<'_>,
    ) -> Result<Option<Vec<Winner>>, LearnError> {
        let landscape = Landscape::new(problem)?;
        let stop = keeper.stop;
        let sets = problem.sets.len();
        while let Some(turn) = self.due() {
            self.work(format!("turn {turn} after {}", self.generation));
            let began = Instant::now();
            // A generation that the search did not get to: its draws are free.
            let generation = self.generation + 1 + turn as u32;
            let pool = |set| match turn {
                0 => self.pool(problem, &landscape, set),
                _ => self.guests(problem, &landscape, set),
            };
            let pools: Vec<Pool> = (0..sets).into_par_iter().map(pool).collect();
            let stride = |set: usize, tapes: &mut Tapes| {
                let draws = |member| draws(problem, set, member, generation);
                let (pool, count) = (pools[set].clone(), AtomicU64::new(0));
                let point = match turn {
                    0 => pool.stride(draws, tapes, &count, stop),
                    _ => pool.visit(draws, tapes, &count, stop),
                };
                let won = point
                    .map(|point| winner(problem, set, &point))
                    .transpose()?;
                Ok(won.map(|won| (won, count.into_inner())))
            };
            let part = format!("strides, turn {}", turn + 1);
            let found = self.long_pieces(keeper, &part, sets, stride)?;
            self.seconds += began.elapsed().as_secs_f64();
            let Some(found) = found else {
                keeper.keep(self);
                return Ok(None);
            };
            let (won, counts): (Vec<Winner>, Vec<u64>) = found.into_iter().unzip();
            self.turns.push(won);
            self.evaluations += counts.iter().sum::<u64>();
        }
        Ok(self.won().map(<[Winner]>::to_vec))
    }

    /// What has won for each set, where that is known.
    pub(crate) fn won(&self) -> Option<&[Winner]> {
        let last = self.turns.last()?;
        self.due().is_none().then_some(last)
    }

    /// The turn that is due. None where nothing new has won, or enough turns have been.
    fn due(&self) -> Option<usize> {
        match &self.turns[..] {
            [.., before, last] if before == last => None,
            turns if turns.len() > EXCHANGES => None,
            turns => Some(turns.len()),
        }
    }

    /// Of a set's islands: each one's best, for these lie in different valleys, then what other members are best; and the
    /// best of the model within, which this one is to end no worse than.
    fn pool<'a>(&self, problem: &Problem, landscape: &'a Landscape<'a>, set: usize) -> Pool<'a> {
        let islands = islands(&self.islands, problem, set);
        let leaders = islands.iter().map(|island| {
            let point = shares(&island.best);
            (point, f64::from(island.best_score))
        });
        let others = islands.iter().flat_map(|island| {
            let members = island.scores.iter().enumerate();
            members.map(|(member, &score)| (shares(&island.member(member)), f64::from(score)))
        });
        let mut members = best(leaders.collect(), POOL / 2);
        members.extend(best(others.collect(), ISLAND));
        let within = self.winner_within(problem, set);
        members.extend(scored(landscape, set, within.into_iter().collect()));
        Pool::new(landscape, set, members, POOL)
    }

    /// What has won for a set, and what is new of other sets' winners, those that are best here.
    fn guests<'a>(&self, problem: &Problem, landscape: &'a Landscape<'a>, set: usize) -> Pool<'a> {
        let mut earlier = self.turns.iter().rev().map(Vec::as_slice);
        let now = earlier.next().unwrap_or_default();
        let before = earlier.next().unwrap_or_default();
        let guests = now.iter().enumerate();
        let guests =
            guests.filter(|&(other, winner)| other != set && before.get(other) != Some(winner));
        let guests = guests.map(|(_, winner)| winner.point.clone());
        let most = match self.is_smooth(problem, set) {
            true => GUESTS_WHERE_SMOOTH,
            false => GUESTS,
        };
        let guests = best(scored(landscape, set, guests.collect()), most);
        let own = now.get(set).map(|winner| winner.point.clone());
        let mut members = scored(landscape, set, own.into_iter().collect());
        members.extend(guests);
        Pool::new(landscape, set, members, 1 + GUESTS)
    }

    /// Whether strides have gained next to nothing over a set's islands.
    fn is_smooth(&self, problem: &Problem, set: usize) -> bool {
        let islands = islands(&self.islands, problem, set);
        let before = bests(islands, problem.islands);
        let first = self.turns.first().and_then(|winners| winners.get(set));
        before.first().zip(first).is_some_and(|(before, winner)| {
            let after = mean(winner.distances.iter().copied());
            (f64::from(before.1) - after).abs() <= SMOOTH * after
        })
    }
}

/// A set's islands, of all.
fn islands<'a>(all: &'a [Island], problem: &Problem, set: usize) -> &'a [Island] {
    let mut sets = all.chunks(problem.islands.max(1));
    sets.nth(set).unwrap_or_default()
}

/// Points with their scores on a set.
fn scored(landscape: &Landscape<'_>, set: usize, points: Vec<Vec<f32>>) -> Vec<Scored> {
    let asked: Vec<(usize, Vec<f32>)> = points.into_iter().map(|point| (set, point)).collect();
    let scores = landscape.scores_at(&asked);
    let points = asked.into_iter().map(|(_, point)| point);
    points.zip(scores.into_iter().map(f64::from)).collect()
}

/// The best of those that have a score.
fn best(mut members: Vec<Scored>, most: usize) -> Vec<Scored> {
    members.retain(|member| member.1 < UNSCORED.into());
    members.sort_by(|a, b| a.1.total_cmp(&b.1));
    members.truncate(most);
    members
}

/// What goes on of a set.
#[derive(Clone)]
struct Pool<'a> {
    landscape: &'a Landscape<'a>,
    set: usize,
    /// What strides are in.
    precision: Precision,
    /// The first is the best in `f64` of all that might have gone on.
    members: Vec<Scored>,
}

impl<'a> Pool<'a> {
    /// The member that is best in `f64`, then the first of the others.
    fn new(
        landscape: &'a Landscape<'a>,
        set: usize,
        mut members: Vec<Scored>,
        most: usize,
    ) -> Self {
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
            if pool.len() < most && pool.iter().all(|other| other.0 != member.0) {
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

    /// Strides on until nothing gains, and gives the point that is best in `f64` then. None where `stop` was set meanwhile.
    fn stride(
        mut self,
        draws: impl Fn(usize) -> Draws,
        tapes: &mut Tapes,
        count: &AtomicU64,
        stop: &AtomicBool,
    ) -> Option<Vec<f32>> {
        let mut chosen: Vec<usize> = (0..self.members.len()).collect();
        let mut run = 0;
        while !chosen.is_empty() {
            let draws = |member| draws(run * POOL + member);
            tapes.resize(tapes.len().max(run + 1), Vec::new());
            let tapes = &mut tapes[run];
            let gained = self.go_on(&chosen, f64::INFINITY, draws, tapes, count, stop)?;
            run += 1;
            let mut order: Vec<usize> = (0..self.members.len()).collect();
            order.sort_by(|&a, &b| self.members[a].1.total_cmp(&self.members[b].1));
            order.truncate(self.members.len() >> run);
            order.retain(|member| gained.contains(member));
            chosen = order;
        }
        Some(self.best())
    }

    /// All but the first stride on as long as they may become better than it, and where it is the most rugged the first
    /// does, too: other draws may lead it on. The point that is best in `f64` then; none where `stop` was set meanwhile.
    fn visit(
        mut self,
        draws: impl Fn(usize) -> Draws,
        tapes: &mut Tapes,
        count: &AtomicU64,
        stop: &AtomicBool,
    ) -> Option<Vec<f32>> {
        let first = match self.precision {
            Precision::F32 => 1,
            Precision::F64 => 0,
        };
        let guests: Vec<usize> = (first..self.members.len()).collect();
        let goal = self.members.first().map_or(f64::INFINITY, |own| own.1);
        tapes.resize(1, Vec::new());
        self.go_on(&guests, goal, draws, &mut tapes[0], count, stop)?;
        Some(self.best())
    }

    /// Lets some members stride on for a goal, and tells which of them have gained enough to go on further.
    fn go_on(
        &mut self,
        chosen: &[usize],
        goal: f64,
        draws: impl Fn(usize) -> Draws,
        tapes: &mut Vec<Tape>,
        count: &AtomicU64,
        stop: &AtomicBool,
    ) -> Option<Vec<usize>> {
        let start = |&member: &usize| (self.members[member].0.clone(), draws(member));
        let starts: Vec<_> = chosen.iter().map(start).collect();
        let strides = Strides {
            set: self.set,
            starts: &starts,
            precision: self.precision,
            goal,
        };
        let ends = self.landscape.adapt(&strides, tapes, count, stop)?;
        let mut gained = Vec::new();
        for (&member, end) in chosen.iter().zip(ends) {
            let gain = self.members[member].1 - end.1;
            if gain > WORTH * end.1 {
                gained.push(member);
            }
            if gain > 0.0 {
                self.members[member] = end;
            }
        }
        Some(gained)
    }

    /// The point that is best in `f64`.
    fn best(self) -> Vec<f32> {
        let points = self.members.iter().map(|(point, _)| &point[..]);
        let exact = self.landscape.exact_scores(self.set, points);
        let members = self.members.into_iter().zip(exact);
        let best = members.min_by(|a, b| a.1.total_cmp(&b.1));
        best.map(|((point, _), _)| point).unwrap_or_default()
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
    use crate::checkpoint::{Checkpoint, Kept, stopped_often};
    use crate::learn::{Backend, GENERATIONS_A_ROUND};
    use crate::problem::{ModelKind, StepperKind};
    use std::sync::atomic::Ordering;

    /// The shipped sample's first two reaches, each `times` over.
    fn problem(stepper: StepperKind, model: ModelKind, times: usize) -> Problem {
        Problem {
            sets: (0..2 * times).map(|set| vec![set % 2]).collect(),
            ..Problem::of_sample(&[0, 1], stepper, model)
        }
    }

    /// After one round.
    fn search(problem: &Problem) -> Search {
        let mut search = Search::new(problem);
        let (most, keeper) = (GENERATIONS_A_ROUND, Keeper::default());
        search
            .run(problem, &mut Backend::Cpu, most, &keeper, |_| {})
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
            let pool = search.pool(&problem, &landscape, 0);
            assert_eq!(pool.precision, expected);
            assert_eq!(pool.members.len(), POOL);
            let points = pool.members.iter().map(|(point, _)| &point[..]);
            let before = landscape.exact_scores(0, points);
            let least = before.iter().fold(f64::INFINITY, |a, &b| a.min(b));
            assert_eq!(least, before[0]);
            let (count, stop) = (AtomicU64::new(0), AtomicBool::new(false));
            let draws = |member| draws(&problem, 0, member, 17);
            let point = pool
                .stride(draws, &mut Tapes::new(), &count, &stop)
                .unwrap();
            let after = winner(&problem, 0, &point).unwrap().distances[0];
            assert!(after <= least * (1.0 + 1e-5), "{after} after {least}");
            assert!(count.into_inner() > 0);
        }
    }

    #[test]
    fn what_is_stopped_goes_on_with_the_other_sets_and_ends_with_the_same_bits() {
        let problem = problem(StepperKind::PseudoInverse, ModelKind::A, 8);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("learning.checkpoint");
        let checkpoint = Checkpoint::new(file, &problem, "cpu");
        let mut first = search(&problem);
        let mut whole = first.clone();
        let never = Keeper::default();
        let winners = whole.winners(&problem, &never).unwrap();
        let winners = winners.unwrap();
        assert_eq!(winners.len(), 16);

        // In the first turn, and in the second.
        for turn in [0, 1] {
            let stop = AtomicBool::new(false);
            let part = format!("strides, turn {}", turn + 1);
            let when_due = |at: &str, done, _| {
                if at == part && done >= 4 {
                    stop.store(true, Ordering::Relaxed);
                }
            };
            let keeper = Keeper::new(&stop, Some(&checkpoint));
            let stopped = first.winners(&problem, &keeper.telling(&when_due));
            assert_eq!(stopped.unwrap(), None);
            let Kept::Search(kept) = checkpoint.read() else {
                panic!("nothing kept");
            };
            first = *kept;
            assert_eq!(first.due(), Some(turn));
            assert_eq!(first.won(), None);
            // What is done of the turn is told at once.
            let told = AtomicU64::new(0);
            let keeper = Keeper::new(&stop, None);
            let hears = |_: &str, done: usize, _| {
                told.fetch_max(done as u64, Ordering::Relaxed);
            };
            let keeper = keeper.telling(&hears);
            assert_eq!(first.winners(&problem, &keeper).unwrap(), None);
            assert!(told.load(Ordering::Relaxed) >= 4);
        }
        let again = first.winners(&problem, &never);
        assert_eq!(again.unwrap().unwrap(), winners);
        assert_eq!(first.evaluations, whole.evaluations);
    }

    #[test]
    fn however_often_strides_are_stopped_they_end_as_if_they_never_were() {
        let problem = problem(StepperKind::NormalisedTranspose, ModelKind::C, 1);
        let mut first = search(&problem);
        let mut whole = first.clone();
        let began = Instant::now();
        let winners = whole.winners(&problem, &Keeper::default());
        let (winners, took) = (winners.unwrap().unwrap(), began.elapsed());
        let (again, stops) = stopped_often(&mut first, took, |search, stop| {
            let keeper = Keeper::new(stop, None);
            search.winners(&problem, &keeper).unwrap()
        });
        assert!(stops > 5, "{stops}");
        assert_eq!(again, winners);
        assert_eq!(first.evaluations, whole.evaluations);
    }

    #[test]
    fn a_set_takes_over_what_is_better_of_another_and_visits_what_is_new_once() {
        // The same motion twice: what is best for the one is best for the other.
        let mut problem = problem(StepperKind::PseudoInverse, ModelKind::C, 1);
        problem.sets = vec![vec![0], vec![0]];
        let mut search = search(&problem);
        let never = Keeper::default();
        let won = search.winners(&problem, &never);
        let best = won.unwrap().unwrap().remove(0);
        let poor = winner(&problem, 1, &vec![0.5; problem.genes()]).unwrap();
        assert!(best.distances < poor.distances);

        let landscape = Landscape::new(&problem).unwrap();
        search.turns = vec![vec![best.clone(), poor.clone()]];
        assert_eq!(search.due(), Some(1));
        assert_eq!(search.guests(&problem, &landscape, 1).members.len(), 2);
        let won = search.winners(&problem, &never);
        let won = won.unwrap().unwrap();
        assert!(won.iter().all(|winner| winner.distances <= best.distances));
        assert_eq!(search.turns[0], [best.clone(), poor.clone()]);

        // The second has changed, the first has not.
        search.turns = vec![vec![best.clone(), poor], vec![best.clone(), best.clone()]];
        assert_eq!(search.due(), Some(2));
        assert_eq!(search.guests(&problem, &landscape, 1).members.len(), 1);
        search.turns = vec![vec![best.clone()], vec![best]];
        assert_eq!(search.due(), None);
    }
}
