//! The search: rounds, progress, stopping and going on. What comes after the last round is in [`crate::finish`].
//!
//! A round is
//! 1. **anneal**: every island runs [`GENERATIONS_A_ROUND`] generations on the backend ([`crate::kernel::anneal`]);
//! 2. **descend**: from the best members, from guesses ([`crate::guess`]) and from where the best is left by a part, to the
//!    floors of their valleys ([`crate::refine`]); a floor takes the place of the member it was found from;
//! 3. **exchange**: what is best for other sets of motions is tried on this one, descends too, and takes the place of an
//!    island's worst member (migration between islands: Cohoon et al. 1987). Motions of one person have valleys in common,
//!    and one that is rarely found needs to be found only once;
//! 4. **restart**: the worse half of each set's islands begins anew.
//!
//! The best is never lost: its island is never in the worse half. The search has settled when rounds gain little more on
//! the whole. Then the sets alone that still gain go on with descents, until they do not.

use std::path::PathBuf;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::checkpoint::{Journal, Keeper};
use crate::cpu;
use crate::finish::Winner;
use crate::gpu::{Gpu, GpuError};
use crate::guess::Guesses;
use crate::kernel::anneal::{Island, UNSCORED};
use crate::kernel::philox::key;
use crate::kernel::proposal::{Draws, ISLAND, MOST_GENES, first, gene, parameter};
use crate::problem::{Problem, Settings, mean};
use crate::refine::{Floor, Landscape, Start};
use crate::task::TaskError;

/// Generations between two descents.
pub const GENERATIONS_A_ROUND: u32 = 16;

/// Descents from each set's own members in a round.
const DESCENTS: usize = 32;

/// And when it goes on alone.
const DESCENTS_ALONE: usize = 16;

/// Sets whose best is tried on each set in a round.
const DONORS: usize = 8;

/// The search has settled when the mean of the sets' best scores fell by less than this share since half as many rounds
/// ago.
const SETTLED: f64 = 0.05;

/// Fewer rounds than this are never called settled.
const LEAST_ROUNDS: usize = 4;
/// Generations of those. Most searches have settled then.
pub(crate) const LEAST_GENERATIONS: u32 = LEAST_ROUNDS as u32 * GENERATIONS_A_ROUND;

/// Then sets that still gain go on alone, without generations, until so many times in a row have gained less than this
/// share; at most so often.
const PATIENCE: u32 = 3;
const WORTH: f32 = 1e-3;
const MOST_ENCORES: usize = 64;

/// Generations of the search of the model within, at most.
const MOST_WITHIN: u32 = 16 * GENERATIONS_A_ROUND;
/// And its islands for each set.
const MOST_ISLANDS_WITHIN: usize = 8;

/// What goes wrong while learning.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LearnError {
    /// A task is wrong.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// The device failed and may not be replaced.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The checkpoint cannot be written.
    #[error("{path}: {error}")]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// Work that is kept in pieces cannot be written or read.
    #[error("what is kept of the work: {0}")]
    Journal(#[from] postcard::Error),
}

/// Where generations run.
pub enum Backend {
    /// SIMD lanes and threads.
    Cpu,
    /// The device, with the population on it.
    Gpu {
        /// The device.
        device: Box<Gpu>,
        /// Whether the CPU may take over when the device fails.
        or_cpu: bool,
    },
}

/// How far a search is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Search {
    /// Generations that ran.
    pub generation: u32,
    /// The population: the islands of set 0, then those of set 1, and so on, as many of each.
    pub islands: Vec<Island>,
    /// Motions that were synthesised and compared.
    pub evaluations: u64,
    /// Seconds it took so far.
    pub seconds: f64,
    /// After every round: the mean over the sets of the best score, metres.
    bests: Vec<f64>,
    /// The best score of each set when it was last offered to others.
    offered: Vec<f32>,
    settled: bool,
    /// What has won for each set after each turn of the search's end ([`winners`](Self::winners)), as far as that has come.
    pub(crate) turns: Vec<Vec<Winner>>,
    /// The search of the model within (S_A in S_B, S_C in S_D), as far as it has come.
    within: Option<Box<Search>>,
    /// That for one vector for all sets together, as far as it has come: a map begins with it.
    jointly: Option<Box<Search>>,
    /// What the state above says nothing of yet: the end of a round, or a map.
    pub(crate) journal: Journal,
}

/// Which of the searches that a search has within it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Inner {
    /// That of the model within.
    Within,
    /// That for one vector for all sets together.
    Jointly,
}

/// What [`Search::run`] tells while it runs.
pub struct Progress {
    /// Generations that ran.
    pub generation: u32,
    /// The mean over the sets of the best distance so far, metres.
    pub best: f64,
    /// The population's mean distance, metres.
    pub mean: f64,
}

/// How a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// Rounds gain nothing more.
    Settled,
    /// All generations ran.
    Budget,
    /// It was told to stop.
    Stopped,
}

impl Search {
    /// For tests: the same, however long it took.
    #[cfg(test)]
    pub(crate) fn timeless(&self) -> Search {
        let inner = |search: &Option<Box<Search>>| search.as_ref().map(|s| Box::new(s.timeless()));
        Search {
            seconds: 0.0,
            within: inner(&self.within),
            jointly: inner(&self.jointly),
            ..self.clone()
        }
    }

    /// Before the first generation.
    pub fn new(problem: &Problem) -> Self {
        let count = problem.sets.len() * problem.islands;
        Search {
            generation: 0,
            islands: vec![Island::new(problem.genes()); count],
            evaluations: 0,
            seconds: 0.0,
            bests: Vec::new(),
            offered: vec![f32::INFINITY; problem.sets.len()],
            settled: false,
            turns: Vec::new(),
            within: None,
            jointly: None,
            journal: Journal::default(),
        }
    }

    /// Takes another search, which has ended, for that of the model within if that is what it is: it need not be repeated,
    /// and nothing else changes. `searched` is what the other was for.
    pub fn build_on(&mut self, problem: &Problem, searched: &Problem, other: &Search) {
        let same = within(problem).is_some_and(|within| within == *searched);
        let ended = other.settled && other.won().is_some();
        if same && ended && other.generation <= MOST_WITHIN {
            self.within = Some(Box::new(other.clone()));
        }
    }

    /// Runs until the search has settled, `generations` have run, or the `keeper` stops it. `report` is told how it goes,
    /// and in words what is out of the ordinary.
    ///
    /// # Errors
    /// A task that the core refuses, or a device that fails where the CPU may not take over.
    pub fn run(
        &mut self,
        problem: &Problem,
        backend: &mut Backend,
        generations: u32,
        keeper: &Keeper<'_>,
        mut report: impl FnMut(Result<Progress, String>),
    ) -> Result<Ended, LearnError> {
        let before = self.seconds;
        let began = Instant::now();
        let ground = Ground::new(problem)?;
        if self.generation > 0
            && let Err(error) = put_on(backend, problem, &self.islands)
        {
            report(Err(self.fall_back(backend, error)?));
        }
        while self.goes_on(generations) {
            self.turns.clear();
            let end = self.end_of_round(generations);
            if self.generation < end
                && let Err(error) = self.advance(problem, backend, end, keeper)
            {
                // What is here is the last read-back, whole: nothing but the time since is lost.
                report(Err(self.fall_back(backend, error)?));
                continue;
            }
            // A stop can come at any time: a round that has not ended is taken up where it was.
            if self.generation == end
                && self.end_round(&ground, keeper)?
                && let Err(error) = put_on(backend, problem, &self.islands)
            {
                report(Err(self.fall_back(backend, error)?));
            }
            self.seconds = before + began.elapsed().as_secs_f64();
            report(Ok(self.progress(problem)));

            // The end is kept, too: what then goes on in f64 may take its time.
            let (ended, stopped) = (!self.goes_on(generations), keeper.stopped());
            if ended || stopped || keeper.is_due()() {
                keeper.keep(self);
            }
            if !ended && stopped {
                return Ok(Ended::Stopped);
            }
        }
        Ok(if self.settled {
            Ended::Settled
        } else {
            Ended::Budget
        })
    }

    /// The generation that the round which is on ends with: the budget ends the last, though it may be less than what ran.
    fn end_of_round(&self, generations: u32) -> u32 {
        (self.bests.len() as u32 + 1)
            .saturating_mul(GENERATIONS_A_ROUND)
            .min(generations)
            .max(self.generation)
    }

    /// Forgets that rounds gain nothing more: [`run`](Self::run) runs another.
    pub fn unsettle(&mut self) {
        self.settled = false;
    }

    /// Whether there are generations to run, or a last round to end.
    fn goes_on(&self, generations: u32) -> bool {
        let rounds = self.generation.div_ceil(GENERATIONS_A_ROUND) as usize;
        let round_is_due = self.generation >= generations && self.bests.len() < rounds;
        !self.settled && (self.generation < generations || round_is_due)
    }

    /// Goes on with the CPU where that is allowed, and says so.
    fn fall_back(&self, backend: &mut Backend, error: LearnError) -> Result<String, LearnError> {
        match (&*backend, error) {
            (Backend::Gpu { or_cpu: true, .. }, LearnError::Gpu(error)) => {
                *backend = Backend::Cpu;
                let generation = self.generation;
                Ok(format!(
                    "{error}; going on with the CPU from generation {generation}"
                ))
            }
            (_, error) => Err(error),
        }
    }

    /// Descends, exchanges, restarts, and notes whether the search has settled. False where it was told to stop meanwhile:
    /// what was done of it is kept.
    fn end_round(&mut self, ground: &Ground<'_>, keeper: &Keeper<'_>) -> Result<bool, LearnError> {
        let Ground {
            problem, landscape, ..
        } = ground;
        let round = Round {
            number: self.bests.len(),
            generation: self.generation,
            encore: 0,
        };
        self.work(format!("round {} at {}", round.number, round.generation));
        let mut own = round.starts(ground, &self.islands, |_| true);
        if self.bests.is_empty() {
            if !self.search_within(problem, keeper)? {
                return Ok(false);
            }
            own.extend(self.starts_within(problem));
        }
        let mut islands = self.islands.clone();
        let Some(mut count) = self.descend(ground, "descents", &own, &mut islands, keeper)? else {
            return Ok(false);
        };

        // Others' bests are tried after the descents, with what these have found.
        let offers = offers(&islands, problem.islands, &self.offered);
        let guests = guests(landscape, self.offered.len(), &offers);
        let Some(floors) = self.floors(ground, "descents from others' bests", &guests, keeper)?
        else {
            return Ok(false);
        };
        for (number, (guest, floor)) in guests.iter().zip(&floors).enumerate() {
            let first = guest.set * problem.islands;
            let island = first + number % problem.islands.div_ceil(2);
            let worst = islands[island].worst();
            islands[island].settle(worst, floor);
            count += floor.evaluations;
        }
        let offered = bests(&islands, problem.islands);
        let offered = offered.iter().map(|(_, score)| *score).collect();

        let now = mean_best(&bests(&islands, problem.islands));
        let rounds = self.bests.len() + 1;
        let earlier = self.bests.get((rounds / 2).wrapping_sub(1)).copied();
        let settled =
            rounds >= LEAST_ROUNDS && earlier.is_some_and(|earlier| earlier - now < SETTLED * now);
        if settled {
            match self.encores(ground, round, &mut islands, keeper)? {
                Some(encores) => count += encores,
                None => return Ok(false),
            }
        }

        // All at once: what is stopped before this goes on from the same beginning.
        self.restart(problem, &mut islands);
        self.islands = islands;
        self.offered = offered;
        self.evaluations += count;
        self.bests.push(self.progress(problem).best);
        self.settled = settled;
        self.journal = Journal::default();
        Ok(true)
    }

    /// The floors below some starts, a part of the round's end. None where it was told to stop meanwhile.
    fn floors(
        &mut self,
        ground: &Ground<'_>,
        part: &str,
        starts: &[Start],
        keeper: &Keeper<'_>,
    ) -> Result<Option<Vec<Floor>>, LearnError> {
        let floor = |number: usize| Ok(Some(ground.landscape.descend(&starts[number])));
        self.pieces(keeper, part, starts.len(), floor)
    }

    /// Descends, and puts the floors in their places: how many evaluations it took. None, and no island is changed, where it
    /// was told to stop meanwhile.
    fn descend(
        &mut self,
        ground: &Ground<'_>,
        part: &str,
        own: &[(Place, Start)],
        islands: &mut [Island],
        keeper: &Keeper<'_>,
    ) -> Result<Option<u64>, LearnError> {
        let starts: Vec<Start> = own.iter().map(|(_, start)| start.clone()).collect();
        let Some(floors) = self.floors(ground, part, &starts, keeper)? else {
            return Ok(None);
        };
        for ((place, _), floor) in own.iter().zip(&floors) {
            islands[place.island].settle(place.member, floor);
        }
        Ok(Some(floors.iter().map(|floor| floor.evaluations).sum()))
    }

    /// Once the search has settled as a whole: descents for the sets alone that still gain, until they do not; how many
    /// evaluations they took. None where it was told to stop meanwhile.
    fn encores(
        &mut self,
        ground: &Ground<'_>,
        mut round: Round,
        islands: &mut [Island],
        keeper: &Keeper<'_>,
    ) -> Result<Option<u64>, LearnError> {
        let a_set = ground.problem.islands;
        let scores = |islands: &[Island]| -> Vec<f32> {
            let bests = bests(islands, a_set).into_iter();
            bests.map(|(_, score)| score).collect()
        };
        let mut idle = vec![0; ground.problem.sets.len()];
        let mut before = scores(islands);
        let mut count = 0;
        while idle.iter().any(|&idle| idle < PATIENCE) && round.encore < MOST_ENCORES {
            round.encore += 1;
            let own = round.starts(ground, islands, |set| idle[set] < PATIENCE);
            let part = format!("descents alone, turn {}", round.encore);
            match self.descend(ground, &part, &own, islands, keeper)? {
                Some(descents) => count += descents,
                None => return Ok(None),
            }
            let after = scores(islands);
            for ((idle, before), after) in idle.iter_mut().zip(&before).zip(&after) {
                match before - after > WORTH * after {
                    true => *idle = 0,
                    false => *idle += 1,
                }
            }
            before = after;
        }
        Ok(Some(count))
    }

    /// Ends the search of the model within, if there is one and it has not ended. False where it was told to stop meanwhile.
    fn search_within(
        &mut self,
        problem: &Problem,
        keeper: &Keeper<'_>,
    ) -> Result<bool, LearnError> {
        let Some(poorer) = within(problem) else {
            return Ok(true);
        };
        let within = self.within.as_ref();
        if within.is_some_and(|within| within.won().is_some()) {
            return Ok(true);
        }
        let told = keeper.after("the model within");
        let end = |search: &mut Search, keeper: &Keeper<'_>| {
            search.end(&poorer, MOST_WITHIN, &keeper.telling(&told))
        };
        let ended = self.inside(Inner::Within, &poorer, keeper, end)?;
        if ended.is_some() {
            self.evaluations += self.within.as_ref().map_or(0, |within| within.evaluations);
        }
        Ok(ended.is_some())
    }

    /// Runs on the CPU, and gives what has won. None where it was told to stop meanwhile.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn end(
        &mut self,
        problem: &Problem,
        generations: u32,
        keeper: &Keeper<'_>,
    ) -> Result<Option<Vec<Winner>>, LearnError> {
        match self.run(problem, &mut Backend::Cpu, generations, keeper, |_| {})? {
            Ended::Stopped => Ok(None),
            _ => self.winners(problem, keeper),
        }
    }

    /// Begins a search within this one, or goes on with it, as far as `work` does; what comes of that.
    ///
    /// # Errors
    /// Those of the work.
    pub(crate) fn inside<R>(
        &mut self,
        inner: Inner,
        problem: &Problem,
        keeper: &Keeper<'_>,
        work: impl FnOnce(&mut Search, &Keeper<'_>) -> Result<R, LearnError>,
    ) -> Result<R, LearnError> {
        let begun = self.inner(inner).take();
        let mut search = begun.map_or_else(|| Search::new(problem), |begun| *begun);
        let keep_both = |search: &Search| {
            let mut whole = self.clone();
            *whole.inner(inner) = Some(Box::new(search.clone()));
            keeper.keep(&whole);
        };
        let keeper = keeper.within(keep_both);
        let done = work(&mut search, &keeper);
        drop(keeper);
        *self.inner(inner) = Some(Box::new(search));
        done
    }

    fn inner(&mut self, inner: Inner) -> &mut Option<Box<Search>> {
        match inner {
            Inner::Within => &mut self.within,
            Inner::Jointly => &mut self.jointly,
        }
    }

    /// A set's best of the model within, as a point of this model, which has to end no worse; none where there is no such
    /// model.
    pub(crate) fn winner_within(&self, problem: &Problem, set: usize) -> Option<Vec<f32>> {
        let (_, places) = problem.settings.nested(problem.dofs())?;
        let won = self.within.as_ref()?.won()?;
        let point = &won.get(set)?.point;
        places.iter().map(|&k| point.get(k).copied()).collect()
    }

    /// Where the rounds of the search of the model within have ended, each of its islands' bests, as starts of this one.
    fn starts_within(&self, problem: &Problem) -> Vec<(Place, Start)> {
        let Some((_, places)) = problem.settings.nested(problem.dofs()) else {
            return Vec::new();
        };
        let islands = self.within.iter().flat_map(|within| &within.islands);
        let a_set = problem.islands.clamp(1, MOST_ISLANDS_WITHIN);
        let start = |(number, found): (usize, &Island)| {
            let set = number / a_set;
            let place = Place {
                island: set * problem.islands + number % a_set,
                member: 0,
            };
            let start = Start {
                set,
                genes: places.iter().map(|&k| found.best[k]).collect(),
                beat: f32::INFINITY,
            };
            (place, start)
        };
        let begun = islands.enumerate();
        let begun = begun.filter(|(_, found)| found.best_score < UNSCORED);
        begun.map(start).collect()
    }

    /// Sorts each set's islands, the best first, and begins the worse half of them anew.
    fn restart(&self, problem: &Problem, islands: &mut [Island]) {
        for (set, islands) in islands.chunks_mut(problem.islands.max(1)).enumerate() {
            islands.sort_by(|a, b| a.best_score.total_cmp(&b.best_score));
            let kept = islands.len().div_ceil(2);
            for (number, island) in islands.iter_mut().enumerate().skip(kept) {
                *island = fresh(problem, set, number, self.generation);
            }
        }
    }

    fn advance(
        &mut self,
        problem: &Problem,
        backend: &mut Backend,
        to: u32,
        keeper: &Keeper<'_>,
    ) -> Result<(), LearnError> {
        let from = self.generation;
        let is_due = keeper.is_due();
        match backend {
            Backend::Cpu => {
                self.generation = cpu::advance(problem, &mut self.islands, from, to, is_due)?;
            }
            Backend::Gpu { device, .. } => {
                let reached = device.advance(from, to, is_due)?;
                self.islands = device.islands()?;
                self.generation = reached;
            }
        }
        let motions: usize = problem.sets.iter().map(Vec::len).sum();
        self.evaluations +=
            u64::from(self.generation - from) * (problem.population() * motions) as u64;
        Ok(())
    }

    fn progress(&self, problem: &Problem) -> Progress {
        let bests = bests(&self.islands, problem.islands);
        let members = self
            .islands
            .iter()
            .flat_map(|island| &island.scores)
            // Those of islands that have just begun have no score yet.
            .filter(|&&score| score < UNSCORED)
            .map(|&score| f64::from(score));
        Progress {
            generation: self.generation,
            best: mean_best(&bests),
            mean: mean(members),
        }
    }
}

/// A round, as far as its descents go.
struct Round {
    /// Rounds that ended before.
    number: usize,
    generation: u32,
    /// How often it was repeated without generations ([`Search::encores`]).
    encore: usize,
}

impl Round {
    /// Where this round's descents begin, and which member of which island gives way to what they find.
    ///
    /// First the best of each island (of the best islands, where there are many: half of the descents are for the [`Way`]s
    /// that follow, in turn).
    fn starts(
        &self,
        ground: &Ground<'_>,
        islands: &[Island],
        takes_part: impl Fn(usize) -> bool,
    ) -> Vec<(Place, Start)> {
        let Ground {
            problem, guesses, ..
        } = ground;
        let dofs = problem.dofs();
        let (part, parts) = problem.settings.parts(dofs);
        let bests = bests(islands, problem.islands);
        let ways = match (self.number, self.encore) {
            (_, 1..) => &[
                Way::GuessAgain,
                Way::Along,
                Way::Redraw,
                Way::Graft,
                Way::Along,
            ][..],
            (0, _) => &[Way::Guess, Way::Member][..],
            _ => &[Way::GuessAgain, Way::Graft, Way::Redraw, Way::Graft][..],
        };
        // Leaders are on their valleys' floors when nothing was annealed since.
        let (count, leading) = match self.encore {
            0 => (DESCENTS, DESCENTS / 2),
            _ => (DESCENTS_ALONE, 0),
        };
        let mut starts = Vec::new();
        let sets = islands.chunks(problem.islands.max(1)).enumerate();
        let sets = sets.zip(guesses).zip(&bests);
        for (((set, islands), guesses), &(best, beat)) in
            sets.filter(|(((set, _), _), _)| takes_part(*set))
        {
            let mut order: Vec<usize> = (0..islands.len()).collect();
            order.sort_by(|&a, &b| islands[a].best_score.total_cmp(&islands[b].best_score));
            let leaders = order
                .iter()
                .map(|&island| (island, islands[island].leader(), Way::Member))
                .take(leading);
            // Strides without a factor in common with an island's size meet every member in time.
            let turn = self.number * 7;
            let others = (0..ISLAND).flat_map(|k| {
                let member = move |island| (island, (turn + 5 * k + island) % ISLAND);
                order.iter().map(move |&island| member(island))
            });
            let others = others.zip(ways.iter().cycle());
            let others = others.map(|((island, member), &way)| (island, member, way));
            for (number, (island, member, way)) in leaders.chain(others).take(count).enumerate() {
                let number = self.encore * DESCENTS + number;
                let draws = draws(problem, set, number, self.generation);
                let [first, second, kind, other] = draws.block(MOST_BLOCKS);
                let noise = |k: usize| draws.block(MOST_BLOCKS + 1 + k as u32 / 4)[k % 4];
                // The parts that are changed: one or two.
                let first = first as usize % parts;
                let second = match kind & 1 {
                    0 => first,
                    _ => second as usize % parts,
                };
                let mut genes = best.to_vec();
                let changed = (0..genes.len()).filter(|&k| part[k] == first || part[k] == second);
                match way {
                    Way::Member => genes = islands[island].member(member),
                    Way::Guess => genes = guesses.draw(problem.genes(), noise),
                    Way::GuessAgain => {
                        guesses.put(&mut genes, first, noise(0));
                        guesses.put(&mut genes, second, noise(1));
                    }
                    Way::Redraw => changed.for_each(|k| genes[k] = noise(k) >> 8),
                    Way::Graft => {
                        let donor = other as usize % bests.len();
                        let from = match donor == set {
                            true => &islands[island].best[..],
                            false => bests[donor].0,
                        };
                        changed.for_each(|k| genes[k] = from[k]);
                    }
                    Way::Along => {
                        let other = &islands[island];
                        let other = match other.best == best {
                            true => other.member(member),
                            false => other.best.clone(),
                        };
                        let by = 2.0 * parameter(noise(0) >> 8, (0.0, 1.0)) - 0.5;
                        for (to, from) in genes.iter_mut().zip(other) {
                            let [at, from] = [*to, from].map(|gene| parameter(gene, (0.0, 1.0)));
                            *to = gene((at + by * (at - from)).into(), (0.0, 1.0));
                        }
                    }
                }
                let place = Place {
                    island: set * problem.islands + island,
                    member,
                };
                starts.push((place, Start { set, genes, beat }));
            }
        }
        starts
    }
}

/// What descents go down on, made ready once.
struct Ground<'a> {
    problem: &'a Problem,
    landscape: Landscape<'a>,
    /// Of each set.
    guesses: Vec<Guesses>,
}

impl<'a> Ground<'a> {
    fn new(problem: &'a Problem) -> Result<Self, TaskError> {
        Ok(Ground {
            problem,
            landscape: Landscape::new(problem)?,
            guesses: Guesses::new(problem)?,
        })
    }
}

/// How a descent's start is found. From [`GuessAgain`](Self::GuessAgain) on they leave the set's best and go down again:
/// iterated local search (Lourenço, Martin and Stützle 2003). All but the last leave it by one or two of its parts (a DoF's
/// genes, or the sigmoid that all share): in a valley other than the best one it is often one DoF only that does something
/// else.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Way {
    /// A member as it is.
    Member,
    /// A guess from the recording.
    Guess,
    /// Parts guessed anew; S_A's and S_C's guesses are of all parts at once.
    GuessAgain,
    /// Parts of another set's best, or of another island's where there is but one set.
    Graft,
    /// Parts drawn anew.
    Redraw,
    /// All of it, along the line through another island's best: that leads out of ripples.
    Along,
}

/// The search of the model within a problem's (S_A in S_B, S_C in S_D), if there is one.
fn within(problem: &Problem) -> Option<Problem> {
    let (model, _) = problem.settings.nested(problem.dofs())?;
    Some(Problem {
        settings: Settings {
            model,
            ..problem.settings
        },
        islands: problem.islands.min(MOST_ISLANDS_WITHIN),
        ..problem.clone()
    })
}

/// A member of the population: its island, counted over all sets, and its number there.
struct Place {
    island: usize,
    member: usize,
}

/// Blocks that the first genes of a member are drawn from, at most; what is drawn otherwise takes blocks beyond.
const MOST_BLOCKS: u32 = 1 + MOST_GENES as u32 / 4;

/// The draws of a member (or a descent) of a set after `generation` generations.
pub(crate) fn draws(problem: &Problem, set: usize, member: usize, generation: u32) -> Draws {
    Draws {
        seed: key(problem.seed),
        set: set as u32,
        member: member as u32,
        // Proposals count up from 0: these draws are no proposal's.
        generation: !generation,
    }
}

/// An island whose members are drawn anew, after `generation` generations.
fn fresh(problem: &Problem, set: usize, number: usize, generation: u32) -> Island {
    let mut island = Island::new(problem.genes());
    for member in 0..ISLAND {
        let draws = draws(problem, set, number * ISLAND + member, generation);
        let genes = first(&draws, problem.genes());
        for (row, gene) in island.genes.iter_mut().zip(genes) {
            row[member] = gene;
        }
    }
    island
}

/// The best genes and score of each set.
pub(crate) fn bests(islands: &[Island], a_set: usize) -> Vec<(&[u32], f32)> {
    islands
        .chunks(a_set.max(1))
        .filter_map(|islands| {
            islands
                .iter()
                .min_by(|a, b| a.best_score.total_cmp(&b.best_score))
        })
        .map(|island| (island.best.as_slice(), island.best_score))
        .collect()
}

/// The mean of the sets' best scores, metres.
fn mean_best(bests: &[(&[u32], f32)]) -> f64 {
    mean(bests.iter().map(|&(_, score)| f64::from(score)))
}

/// The sets whose best has become better since it was last offered, and its genes.
fn offers<'a>(islands: &'a [Island], a_set: usize, offered: &[f32]) -> Vec<(usize, &'a [u32])> {
    bests(islands, a_set)
        .into_iter()
        .zip(offered)
        .enumerate()
        .filter(|(_, ((_, score), before))| score < before)
        .map(|(set, ((genes, _), _))| (set, genes))
        .collect()
}

/// What each set tries of the others' offers: those that score best on it as they are.
fn guests(landscape: &Landscape<'_>, sets: usize, offers: &[(usize, &[u32])]) -> Vec<Start> {
    let asked: Vec<(usize, &[u32])> = (0..sets)
        .flat_map(|set| {
            let others = offers.iter().filter(move |(from, _)| *from != set);
            others.map(move |&(_, genes)| (set, genes))
        })
        .collect();
    let scores = landscape.scores(&asked);
    let mut scored: Vec<_> = asked.into_iter().zip(scores).collect();
    // Stable: sets stay in order.
    scored.sort_by(|a, b| a.0.0.cmp(&b.0.0).then(a.1.total_cmp(&b.1)));
    let chosen = scored
        .chunk_by(|a, b| a.0.0 == b.0.0)
        .flat_map(|set| set.iter().take(DONORS));
    chosen
        .map(|&((set, genes), _)| Start {
            set,
            genes: genes.to_vec(),
            beat: f32::INFINITY,
        })
        .collect()
}

/// Gives a device the islands that there are now.
fn put_on(backend: &mut Backend, problem: &Problem, islands: &[Island]) -> Result<(), LearnError> {
    match backend {
        Backend::Gpu { device, .. } => Ok(device.replace(problem, islands)?),
        Backend::Cpu => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::checkpoint::{Checkpoint, Kept, stopped_often};
    use crate::problem::{ModelKind, StepperKind};

    fn problem() -> Problem {
        Problem::of_sample(&[0, 1], StepperKind::Transpose, ModelKind::C)
    }

    fn run(search: &mut Search, problem: &Problem, generations: u32) -> Ended {
        run_with(search, problem, generations, &Keeper::default())
    }

    fn run_with(
        search: &mut Search,
        problem: &Problem,
        generations: u32,
        keeper: &Keeper<'_>,
    ) -> Ended {
        search
            .run(problem, &mut Backend::Cpu, generations, keeper, |_| {})
            .unwrap()
    }

    fn winners(search: &mut Search, problem: &Problem) -> Vec<Winner> {
        let winners = search.winners(problem, &Keeper::default());
        winners.unwrap().unwrap()
    }

    #[test]
    fn a_search_that_goes_on_is_the_one_that_never_stopped() {
        let problem = problem();
        let mut whole = Search::new(&problem);
        run(&mut whole, &problem, 70);

        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("learning.checkpoint");
        let checkpoint = Checkpoint::new(file, &problem, "cpu");
        let stop = AtomicBool::new(false);
        let keeper = Keeper::new(&stop, Some(&checkpoint));
        let mut first = Search::new(&problem);
        run(&mut first, &problem, 2 * GENERATIONS_A_ROUND);
        // As a stop leaves it within a round.
        first
            .advance(&problem, &mut Backend::Cpu, 37, &keeper)
            .unwrap();
        keeper.keep(&first);
        let Kept::Search(mut second) = checkpoint.read() else {
            panic!("nothing kept");
        };
        run(&mut second, &problem, 70);

        assert_eq!(whole.islands, second.islands);
        assert_eq!(whole.bests, second.bests);
    }

    #[test]
    fn what_is_reported_is_the_f64_score_and_near_the_lanes_own() {
        let problem = problem();
        let mut search = Search::new(&problem);
        run(&mut search, &problem, 64);
        for (winner, islands) in winners(&mut search, &problem)
            .iter()
            .zip(search.islands.chunks(2))
        {
            let best = islands
                .iter()
                .map(|island| island.best_score)
                .fold(f32::INFINITY, f32::min);
            assert!((winner.distances[0] / f64::from(best) - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn two_runs_with_the_same_seed_are_the_same_and_with_another_are_not() {
        let mut problem = problem();
        let [mut a, mut b, mut c] = [(); 3].map(|()| Search::new(&problem));
        run(&mut a, &problem, 8);
        run(&mut b, &problem, 8);
        assert_eq!(a.islands, b.islands);
        problem.seed = 6;
        run(&mut c, &problem, 8);
        assert_ne!(a.islands, c.islands);
    }

    #[test]
    fn rounds_never_lose_the_best_and_begin_the_worse_half_anew() {
        let problem = Problem {
            islands: 5,
            ..problem()
        };
        let mut search = Search::new(&problem);
        let mut before = vec![f32::INFINITY; 2];
        for round in 1..=4 {
            run(&mut search, &problem, round * GENERATIONS_A_ROUND);
            assert_eq!(search.islands.len(), 2 * 5);
            let now = bests(&search.islands, 5);
            for ((_, now), before) in now.iter().zip(&mut before) {
                assert!(*now <= *before && *now < 1.0);
                *before = *now;
            }
            for set in search.islands.chunks(5) {
                let begun: Vec<bool> = set.iter().map(|one| one.scores[0] == UNSCORED).collect();
                assert_eq!(begun, [false, false, false, true, true]);
            }
        }
    }

    #[test]
    fn a_round_that_is_stopped_is_taken_up_again() {
        let problem = problem();
        let mut whole = Search::new(&problem);
        run(&mut whole, &problem, 2 * GENERATIONS_A_ROUND);
        let mut cut = Search::new(&problem);
        let stop = AtomicBool::new(false);
        let keeper = Keeper::new(&stop, None);
        let ended = cut.run(
            &problem,
            &mut Backend::Cpu,
            2 * GENERATIONS_A_ROUND,
            &keeper,
            |_| stop.store(true, Ordering::Relaxed),
        );
        assert_eq!(ended.unwrap(), Ended::Stopped);
        // As if the stop had come between the generations and the descents.
        let mut ready = cut.clone();
        let ground = Ground::new(&problem).unwrap();
        assert!(!ready.end_round(&ground, &keeper).unwrap());
        assert_eq!(ready.islands, cut.islands);
        run(&mut ready, &problem, 2 * GENERATIONS_A_ROUND);
        assert_eq!(ready.islands, whole.islands);
    }

    #[test]
    fn however_often_it_is_stopped_a_search_ends_as_if_it_never_was() {
        // With another search within it.
        let mut problem = problem();
        problem.settings.model = ModelKind::B;
        let mut whole = Search::new(&problem);
        let began = Instant::now();
        assert_eq!(run(&mut whole, &problem, 1000), Ended::Settled);
        let won = winners(&mut whole, &problem);
        let took = began.elapsed();

        // So often that no round, and no search within, could end between two stops.
        let mut search = Search::new(&problem);
        let (found, stops) = stopped_often(&mut search, took, |search, stop| {
            let keeper = Keeper::new(stop, None);
            match run_with(search, &problem, 1000, &keeper) {
                Ended::Stopped => None,
                _ => search.winners(&problem, &keeper).unwrap(),
            }
        });
        assert!(stops > 10, "{stops}");
        assert_eq!(found, won);
        assert_eq!(search.timeless(), whole.timeless());
    }

    #[test]
    fn a_richer_model_ends_no_worse_from_another_seed() {
        for (poorer, richer) in [(ModelKind::A, ModelKind::B), (ModelKind::C, ModelKind::D)] {
            let learned = |model, seed| {
                let mut problem = problem();
                (problem.settings.model, problem.seed) = (model, seed);
                let mut search = Search::new(&problem);
                run(&mut search, &problem, 4 * GENERATIONS_A_ROUND);
                winners(&mut search, &problem)
            };
            for (poor, rich) in learned(poorer, 1).iter().zip(&learned(richer, 2)) {
                assert!(rich.distances[0] <= poor.distances[0] + 1e-6);
            }
        }
    }

    #[test]
    fn a_search_that_builds_on_that_of_the_model_within_ends_with_the_same_bits_and_no_worse() {
        let end = |search: &mut Search, problem: &Problem| {
            run(search, problem, 100_000);
            winners(search, problem)
        };
        let poorer = problem();
        let mut richer = problem();
        richer.settings.model = ModelKind::D;
        let mut first = Search::new(&poorer);
        let poor = end(&mut first, &poorer);

        let [mut alone, mut built, mut other] = [(); 3].map(|()| Search::new(&richer));
        built.build_on(&richer, &poorer, &first);
        assert!(built.within.is_some());
        let rich = end(&mut built, &richer);
        assert_eq!(end(&mut alone, &richer), rich);
        assert_eq!(alone.islands, built.islands);
        assert_eq!(alone.evaluations, built.evaluations + first.evaluations);
        for (poor, rich) in poor.iter().zip(&rich) {
            assert!(rich.distances[0] <= poor.distances[0]);
        }

        // Of another seed, and one that has not ended, it is not.
        richer.seed += 1;
        other.build_on(&richer, &poorer, &first);
        richer.seed -= 1;
        first.turns.clear();
        other.build_on(&richer, &poorer, &first);
        assert_eq!(other.within, None);
    }

    #[test]
    fn a_budget_ends_a_search_and_so_do_rounds_that_gain_nothing() {
        let problem = problem();
        let mut search = Search::new(&problem);
        assert_eq!(run(&mut search, &problem, 40), Ended::Budget);
        assert_eq!(run(&mut search, &problem, 100_000), Ended::Settled);
        assert!(search.generation < 100_000);
    }
}
