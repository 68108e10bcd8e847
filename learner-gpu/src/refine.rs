//! Descent to a valley's floor: from a member's parameters to the best that lies downhill of them.
//!
//! The score is a mean of norms, Σⱼ wⱼ‖eⱼ‖, of which each eⱼ, how far a landmark is in a frame from where it was recorded,
//! is smooth in the parameters. Levenberg and Marquardt's method for a sum of norms: with C = ∂e/∂p (by differences) and
//! u = e/‖e‖,
//!
//! ```text
//! gradient  = Σ w Cᵀu          curvature ≈ Σ w/‖e‖ · Cᵀ(I − u uᵀ)C
//! (curvature + μ·diag(Σ w/‖e‖ · CᵀC)) δ = −gradient
//! ```
//!
//! the exact second derivative of a norm, without that of e (Gauss and Newton's part; Nocedal and Wright 2006,
//! *Numerical Optimization*, section 10.3). Parameters are held within their bounds by projection: one that is pushed
//! against its bound takes no part. A few μ are tried at a time, side by side on the lanes.
//!
//! Members of an annealed population find valleys well and their floors slowly; a descent takes some hundred
//! evaluations where an island takes some ten thousand. The two together are a memetic algorithm (Moscato 1989).

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use fearless_simd::{Level, Simd};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sinew::real::Real;

use crate::adapt::adapt;
use crate::kernel::proposal::{Draws, MOST_GENES, gene, parameter};
use crate::kernel::score::{Ready, mean};
use crate::lanes::{Instructions, Lanes, LanesF64, SideBySide, dispatch};
use crate::problem::{Problem, Settings, with_dofs};
use crate::task::TaskError;

/// Steps of a descent, at most.
const MOST_STEPS: usize = 100;
/// The step of a difference, as a share of a parameter's bounds. Steps go up and down in turns: what one way is wrong by,
/// the other is wrong by the other way.
const DIFFERENCE: f32 = 1.0 / 4096.0;
/// A landmark nearer than this to where it should be counts as being this far, in metres: a norm has no derivative at 0.
const NEAREST: f32 = 1e-5;
/// The values of μ tried at a time, as multiples of the one that was best before, and how much of the step each leads to
/// is taken: in a curved valley less than the step is better, in a flat one more.
const DAMPINGS: [f32; 4] = [0.1, 1.0, 10.0, 100.0];
const SHARES: [f32; 4] = [1.0, 0.4, 2.0, 4.0];
const TRIALS: usize = DAMPINGS.len() * SHARES.len();
/// A pivot of the damped curvature, whose diagonal is about 1, is no less than this.
const LEAST_PIVOT: f64 = 1e-7;
/// A descent has arrived when a step gains less than this share of the score.
const ARRIVED: f32 = 2e-6;
/// And less than this, where what is to be beaten is below it still: most descents end in a valley that is no use.
const HOPELESS: f32 = 3e-4;
/// The most lanes of a vector: AVX-512's.
const MOST_LANES: usize = 16;
/// The most vectors of lanes that the parameters, and one more, fill: SSE2's.
const MOST_VECTORS: usize = MOST_GENES / 4 + 1;
/// As many numbers as there are parameters, and one more, in whole vectors of any width.
const WIDE: usize = (MOST_GENES / MOST_LANES + 1) * MOST_LANES;

/// Where a descent is to begin.
#[derive(Clone, Debug, PartialEq)]
pub struct Start {
    /// The set of motions that is scored.
    pub set: usize,
    /// The genes.
    pub genes: Vec<u32>,
    /// What is to be beaten, metres: above it a descent ends sooner.
    pub beat: f32,
}

/// Where a descent has arrived.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Floor {
    /// The genes.
    pub genes: Vec<u32>,
    /// Their score, metres.
    pub score: f32,
    /// How often a motion was synthesised on the way.
    pub evaluations: u64,
}

/// Where strides begin, and what for.
#[derive(Clone, Debug)]
pub struct Strides<'a> {
    /// The set of motions that is scored.
    pub set: usize,
    /// Points of the bounds, each with draws of its own.
    pub starts: &'a [(Vec<f32>, Draws)],
    /// What scores are in: in `f64` where the distance is so rugged that `f32` is off.
    pub precision: Precision,
    /// The score that is to be beaten; infinity is no goal.
    pub goal: f64,
}

/// The scores that each generation of strides had: with them they are gone over again in no time.
pub type Tape = Vec<Vec<f64>>;

/// The scores of a problem as landscapes over the parameters, one a set, made ready once for all who look at them.
pub struct Landscape<'a>(Box<dyn Sets + Sync + 'a>);

impl<'a> Landscape<'a> {
    /// Of a problem.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn new(problem: &'a Problem) -> Result<Self, TaskError> {
        Landscape::arriving(problem, 0.0)
    }

    /// Of a problem where a hand that does not arrive costs so much a metre, beside the distance ([`Ready::score`]). A
    /// task's target is where its reference's tip ends.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn arriving(problem: &'a Problem, arrival: f32) -> Result<Self, TaskError> {
        let dofs = problem.dofs();
        with_dofs!(dofs, N => {
            dispatch!(Level::new(), S => Ok(Landscape(Box::new(valleys::<S, N>(problem, arrival)?))))
        }, else Err(TaskError::Dofs { found: dofs }))
    }

    /// Descends from a start. Where there is no such set there is no way down.
    pub fn descend(&self, start: &Start) -> Floor {
        self.0.descend(start)
    }

    /// Descends from every start, on all threads. None where `stop` was set meanwhile.
    pub fn refine(&self, starts: &[Start], stop: &AtomicBool) -> Option<Vec<Floor>> {
        let descend = |start: &Start| match stop.load(Ordering::Relaxed) {
            true => None,
            false => Some(self.descend(start)),
        };
        starts.par_iter().map(descend).collect()
    }

    /// Goes on as [`adapt`] does, on all threads; what comes of each start is a point and its score. `evaluations` is told how
    /// often a motion was synthesised. None where `stop` was set meanwhile. Scores that are on a start's tape are not computed
    /// again, and those that are computed come to be on it.
    pub fn adapt(
        &self,
        strides: &Strides<'_>,
        tapes: &mut Vec<Tape>,
        evaluations: &AtomicU64,
        stop: &AtomicBool,
    ) -> Option<Vec<(Vec<f32>, f64)>> {
        let &Strides {
            set,
            starts,
            precision,
            goal,
        } = strides;
        // Threads that have no start of their own help the others with their offspring.
        let few = starts.len() < rayon::current_num_threads();
        let go_on = |((from, draws), tape): (&(Vec<f32>, Draws), &mut Tape)| {
            let mut generation = 0;
            let scores = |offspring: &[Vec<f32>]| {
                if generation == tape.len() {
                    if stop.load(Ordering::Relaxed) {
                        return Err(Stopped);
                    }
                    let points: Vec<&[f32]> = offspring.iter().map(Vec::as_slice).collect();
                    let some = |points: &[&[f32]]| self.0.scores(precision, set, points);
                    tape.push(match few {
                        true => points.par_chunks(MOST_LANES).flat_map(some).collect(),
                        false => some(&points),
                    });
                }
                generation += 1;
                evaluations.fetch_add(offspring.len() as u64 * self.0.size(set), Ordering::Relaxed);
                tape.get(generation - 1).cloned().ok_or(Stopped)
            };
            adapt(from, draws, precision == Precision::F64, goal, scores).ok()
        };
        tapes.resize(starts.len(), Tape::new());
        let starts = starts.par_iter().zip(tapes);
        starts.map(go_on).collect()
    }

    /// The scores of genes, each on a set of motions.
    pub fn scores(&self, asked: &[(usize, &[u32])]) -> Vec<f32> {
        let points: Vec<(usize, Vec<f32>)> = asked
            .iter()
            .map(|&(set, genes)| (set, shares(genes)))
            .collect();
        self.scores_at(&points)
    }

    /// The scores at points of the bounds, each on a set of motions: shares in [0, 1].
    pub fn scores_at(&self, asked: &[(usize, Vec<f32>)]) -> Vec<f32> {
        // Runs of the same set share vectors.
        let runs: Vec<&[(usize, Vec<f32>)]> = asked
            .chunk_by(|a, b| a.0 == b.0)
            .flat_map(|run| run.chunks(MOST_LANES))
            .collect();
        let scores = runs.into_par_iter().map(|run| {
            let points: Vec<&[f32]> = run.iter().map(|(_, point)| &point[..]).collect();
            self.0.scores(Precision::F32, run[0].0, &points)
        });
        let scores: Vec<Vec<f64>> = scores.collect();
        // They were of f32.
        scores
            .concat()
            .into_iter()
            .map(|score| score as f32)
            .collect()
    }

    /// The scores at points of a set in `f64`, the core's own to the bit.
    pub fn exact_scores<'p>(
        &self,
        set: usize,
        points: impl Iterator<Item = &'p [f32]>,
    ) -> Vec<f64> {
        let points: Vec<&[f32]> = points.collect();
        self.0.scores(Precision::F64, set, &points)
    }

    /// The landscape near points of the bounds, each on a set of motions.
    pub fn slopes_at(&self, asked: &[(usize, Vec<f32>)]) -> Vec<Slope> {
        let slope = |(set, point): &(usize, Vec<f32>)| self.0.slope(*set, point);
        asked.par_iter().filter_map(slope).collect()
    }
}

/// What a landscape is looked at in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// `f32`, as the search does.
    F32,
    /// `f64`, as its end does.
    F64,
}

/// Somebody asked to stop.
struct Stopped;

/// The sets of a problem, whatever the arm's size and the machine's lanes.
trait Sets {
    /// The floor below a start.
    fn descend(&self, start: &Start) -> Floor;
    /// How many motions a set has.
    fn size(&self, set: usize) -> u64;
    /// The scores at points of a set.
    fn scores(&self, precision: Precision, set: usize, points: &[&[f32]]) -> Vec<f64>;
    /// The slope at a point of a set, where there is the set.
    fn slope(&self, set: usize, point: &[f32]) -> Option<Slope>;
}

impl<S: Instructions, const N: usize> Sets for Vec<Valley<'_, S, N>> {
    fn descend(&self, start: &Start) -> Floor {
        match self.get(start.set) {
            Some(valley) => valley.descend(start),
            None => Floor {
                genes: start.genes.clone(),
                score: f32::INFINITY,
                evaluations: 0,
            },
        }
    }

    fn size(&self, set: usize) -> u64 {
        self.get(set)
            .map_or(0, |valley| valley.motions.len() as u64)
    }

    fn scores(&self, precision: Precision, set: usize, points: &[&[f32]]) -> Vec<f64> {
        match (self.get(set), precision) {
            (Some(valley), Precision::F32) => valley.scores(&valley.motions, points),
            (Some(valley), Precision::F64) => valley.scores(&valley.exact, points),
            (None, _) => vec![f64::INFINITY; points.len()],
        }
    }

    fn slope(&self, set: usize, point: &[f32]) -> Option<Slope> {
        let local = self.get(set)?.local(point, DIFFERENCE, &mut Vec::new());
        Some(local.slope())
    }
}

/// Each set of the problem, ready to be descended on.
fn valleys<S: Instructions, const N: usize>(
    problem: &Problem,
    arrival: f32,
) -> Result<Vec<Valley<'_, S, N>>, TaskError> {
    let bounds = problem.settings.bounds(N);
    let valley = |set: &Vec<usize>| {
        Ok(Valley {
            settings: &problem.settings,
            bounds: bounds.clone(),
            motions: ready(problem, set, arrival)?,
            exact: ready(problem, set, arrival)?,
        })
    };
    problem.sets.iter().map(valley).collect()
}

/// A set's motions, ready.
fn ready<T: Real, const N: usize>(
    problem: &Problem,
    set: &[usize],
    arrival: f32,
) -> Result<Vec<Ready<T, N>>, TaskError> {
    let tasks = set.iter().filter_map(|&task| problem.tasks.get(task));
    tasks
        .map(|task| Ok(Ready::new(task)?.arriving(arrival)))
        .collect()
}

/// The genes as shares of their bounds.
pub(crate) fn shares(genes: &[u32]) -> Vec<f32> {
    genes
        .iter()
        .map(|&gene| parameter(gene, (0.0, 1.0)))
        .collect()
}

/// The genes at a point, which may be a little coarser than it.
pub(crate) fn genes_of(point: &[f32]) -> Vec<u32> {
    let genes = point.iter().map(|&share| gene(share.into(), (0.0, 1.0)));
    genes.collect()
}

/// A set's score as a landscape over the parameters, each a share of its bounds in [0, 1].
struct Valley<'a, S: Simd, const N: usize> {
    settings: &'a Settings,
    bounds: Vec<(f32, f32)>,
    motions: Vec<Ready<Lanes<S>, N>>,
    /// The same for lanes of `f64`.
    exact: Vec<Ready<LanesF64<S>, N>>,
}

/// The landscape near a point: what a step is found from. Metres a whole bound, and that squared.
pub struct Slope {
    /// The score's first derivative.
    pub gradient: DVector<f64>,
    /// Its second, near enough.
    pub curvature: DMatrix<f64>,
    /// What damps: diag(Σ w/‖e‖ · CᵀC).
    pub scale: DVector<f64>,
}

/// The same as a descent has it.
struct Local {
    /// How many parameters move.
    free: usize,
    gradient: [f32; WIDE],
    scale: [f32; WIDE],
    /// The lower half, the diagonal with it; above it is nothing of use.
    curvature: [[f32; WIDE]; MOST_GENES],
}

impl Local {
    fn slope(&self) -> Slope {
        let curvature = |a: usize, b: usize| f64::from(self.curvature[a.max(b)][a.min(b)]);
        Slope {
            gradient: DVector::from_fn(self.free, |a, _| f64::from(self.gradient[a])),
            curvature: DMatrix::from_fn(self.free, self.free, curvature),
            scale: DVector::from_fn(self.free, |a, _| f64::from(self.scale[a])),
        }
    }
}

/// Points that are tried, and their scores.
struct Trials {
    values: [[f32; TRIALS]; MOST_GENES],
    scores: [f32; TRIALS],
}

impl<S: Instructions, const N: usize> Valley<'_, S, N> {
    /// Where it leads.
    fn descend(&self, start: &Start) -> Floor {
        let mut count = 0;
        let at = self.arrive(&shares(&start.genes), start.beat, &mut count);
        let genes = genes_of(&at);
        Floor {
            score: self.score(&shares(&genes)),
            genes,
            evaluations: (count + 1) * self.motions.len() as u64,
        }
    }

    /// The floor from `at`.
    fn arrive(&self, at: &[f32], beat: f32, count: &mut u64) -> Vec<f32> {
        let mut at = at.to_vec();
        let mut least = self.score(&at);
        let mut damping = 1e-2;
        let mut apart = Vec::new();
        for step in 0..MOST_STEPS {
            let difference = if step % 2 == 0 {
                DIFFERENCE
            } else {
                -DIFFERENCE
            };
            let local = self.local(&at, difference, &mut apart);
            let trials = self.trials(&at, &local, damping);
            *count += (local.free + 1 + TRIALS) as u64;
            let mut best = (0, f32::INFINITY);
            for (trial, &score) in trials.scores.iter().enumerate() {
                if score < best.1 {
                    best = (trial, score);
                }
            }
            if best.1 >= least {
                break;
            }
            let gained = least - best.1;
            damping = (damping * DAMPINGS[best.0 % DAMPINGS.len()]).clamp(1e-6, 1e6);
            for (to, values) in at.iter_mut().zip(&trials.values) {
                *to = values[best.0];
            }
            least = best.1;
            let arrived = if least > beat { HOPELESS } else { ARRIVED };
            if gained < arrived * least {
                break;
            }
        }
        at
    }

    /// The score of a point, by lanes of `f32`.
    fn score(&self, point: &[f32]) -> f32 {
        let scores = self.scores(&self.motions, &[point]);
        // It was one.
        scores.first().map_or(f32::INFINITY, |&score| score as f32)
    }

    /// The scores of some points, by the lanes that the motions are ready for.
    fn scores<L: SideBySide>(&self, motions: &[Ready<L, N>], points: &[&[f32]]) -> Vec<f64> {
        // Here and in `slope`, not further out: what is inside is compiled wherever it is called.
        S::proof().vectorize(
            #[inline(always)]
            || self.scores_in_lanes(motions, points),
        )
    }

    #[inline(always)]
    fn scores_in_lanes<L: SideBySide>(
        &self,
        motions: &[Ready<L, N>],
        points: &[&[f32]],
    ) -> Vec<f64> {
        let mut out = Vec::with_capacity(points.len());
        for some in points.chunks(L::COUNT) {
            // Lanes without a point of their own take the last.
            let candidates = self.candidates::<L>(|lane, k| some[lane.min(some.len() - 1)][k]);
            let candidates = &candidates[..self.bounds.len()];
            let mut scores = [L::Number::default(); MOST_LANES];
            let scores = &mut scores[..L::COUNT];
            mean::<S, L, N>(motions, self.settings, candidates).store(scores);
            out.extend(scores.iter().take(some.len()).map(|&score| score.into()));
        }
        out
    }

    /// The parameters at a point for each lane.
    #[inline(always)]
    fn candidates<L: SideBySide>(&self, share: impl Fn(usize, usize) -> f32) -> [L; MOST_GENES] {
        let mut out = [L::zero(); MOST_GENES];
        for (k, (parameter, &(lower, upper))) in out.iter_mut().zip(&self.bounds).enumerate() {
            let mut values = [L::Number::default(); MOST_LANES];
            for (lane, value) in values.iter_mut().enumerate().take(L::COUNT) {
                *value = (lower + (upper - lower) * share(lane, k)).into();
            }
            *parameter = L::load(&values[..L::COUNT]);
        }
        out
    }

    /// The landscape near a point. Lane a of all vectors together is a step along parameter a; the lane after the last is at
    /// the point itself. `apart` is room to work in.
    fn local(&self, at: &[f32], step: f32, apart: &mut Vec<f32>) -> Local {
        S::proof().vectorize(
            #[inline(always)]
            || self.local_in_lanes(at, step, apart),
        )
    }

    #[inline(always)]
    fn local_in_lanes(&self, at: &[f32], step: f32, apart: &mut Vec<f32>) -> Local {
        let lanes = Lanes::<S>::COUNT;
        let free = self.bounds.len();
        let vectors = free / lanes + 1;
        let rate = Lanes::<S>::splat(1.0 / step);
        let mut gradient = [Lanes::<S>::zero(); MOST_VECTORS];
        let mut scale = [Lanes::<S>::zero(); MOST_VECTORS];
        // Of each vector of columns, the rows.
        let mut curvature = [[Lanes::<S>::zero(); MOST_GENES]; MOST_VECTORS];
        // Each row writes what it reads of these, so they need not be cleared for each.
        let mut across = [[Lanes::<S>::zero(); 3]; MOST_VECTORS];
        let mut flat = [[0.0; WIDE]; 3];
        for motion in &self.motions {
            let rows = motion.landmarks();
            let a_vector = rows * 3 * lanes;
            apart.resize(vectors * a_vector, 0.0);
            for (v, apart) in apart.chunks_exact_mut(a_vector).enumerate() {
                let candidates =
                    self.candidates::<Lanes<S>>(|lane, k| match k == v * lanes + lane {
                        true => at[k] + step,
                        false => at[k],
                    });
                let mut rest = apart.chunks_exact_mut(lanes);
                motion.apart(
                    self.settings,
                    &candidates[..self.bounds.len()],
                    #[inline(always)]
                    |coordinate| {
                        if let Some(place) = rest.next() {
                            coordinate.store(place);
                        }
                    },
                );
            }
            let weight = 1.0 / (rows * self.motions.len()) as f32;
            for row in 0..rows {
                let place = |v: usize, c: usize| v * a_vector + (3 * row + c) * lanes;
                let own: [f32; 3] =
                    std::array::from_fn(|c| apart[place(free / lanes, c) + free % lanes]);
                let norm = (own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
                    .sqrt()
                    .max(NEAREST);
                let weight = match row + 1 == rows {
                    true => weight + motion.arrival(norm) / self.motions.len() as f32,
                    false => weight,
                };
                let point = own.map(Lanes::<S>::splat);
                let u = own.map(|x| Lanes::<S>::splat(x / norm));
                let (weight, bend) = (Lanes::splat(weight), Lanes::splat(weight / norm));
                let mut moves = false;
                for v in 0..vectors {
                    let slope: [Lanes<S>; 3] = std::array::from_fn(|c| {
                        let begin = place(v, c);
                        (Lanes::load(&apart[begin..begin + lanes]) - point[c]) * rate
                    });
                    let along = slope[0] * u[0] + slope[1] * u[1] + slope[2] * u[2];
                    gradient[v] = gradient[v] + weight * along;
                    let square = slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2];
                    moves |= Lanes::<S>::any(Lanes::zero().lt(square));
                    scale[v] = scale[v] + bend * square;
                    for c in 0..3 {
                        across[v][c] = slope[c] - along * u[c];
                        across[v][c].store(&mut flat[c][v * lanes..(v + 1) * lanes]);
                        across[v][c] = across[v][c] * bend;
                    }
                }
                // The base, and everything in the first frame, moves with no parameter.
                if !moves {
                    continue;
                }
                for (v, across) in across[..vectors].iter().enumerate() {
                    // It is symmetric: columns right of the diagonal are not needed.
                    let below = v * lanes..free;
                    let rows = curvature[v][below.clone()].iter_mut();
                    let own = flat[0][below.clone()]
                        .iter()
                        .zip(&flat[1][below.clone()])
                        .zip(&flat[2][below.clone()]);
                    for (sum, ((&x, &y), &z)) in rows.zip(own) {
                        *sum = *sum
                            + (Lanes::splat(x) * across[0]
                                + Lanes::splat(y) * across[1]
                                + Lanes::splat(z) * across[2]);
                    }
                }
            }
        }
        let flat = |vectors: &[Lanes<S>]| {
            let mut out = [0.0; WIDE];
            for (vector, place) in vectors.iter().zip(out.chunks_exact_mut(lanes)) {
                vector.store(place);
            }
            out
        };
        Local {
            free,
            gradient: flat(&gradient),
            scale: flat(&scale),
            // By reference: the whole of it is 10 kB.
            curvature: std::array::from_fn(|a| flat(&curvature.each_ref().map(|rows| rows[a]))),
        }
    }

    /// Steps from `at`, each lane with a damping and a share of its own, and where they lead to.
    fn trials(&self, at: &[f32], local: &Local, damping: f32) -> Trials {
        S::proof().vectorize(
            #[inline(always)]
            || self.trials_in_lanes(at, local, damping),
        )
    }

    #[inline(always)]
    fn trials_in_lanes(&self, at: &[f32], local: &Local, damping: f32) -> Trials {
        let lanes = Lanes::<S>::COUNT;
        let dampings: [f32; TRIALS] =
            std::array::from_fn(|trial| damping * DAMPINGS[trial % DAMPINGS.len()]);
        let shares: [f32; TRIALS] = std::array::from_fn(|trial| SHARES[trial / DAMPINGS.len()]);
        let mut out = Trials {
            values: [[0.0; TRIALS]; MOST_GENES],
            scores: [0.0; TRIALS],
        };
        for begin in (0..TRIALS).step_by(lanes) {
            let some = begin..begin + lanes;
            let step = descent(local, at, Lanes::<S>::load(&dampings[some.clone()]));
            let share = Lanes::<S>::load(&shares[some.clone()]);
            let mut candidates = [Lanes::<S>::zero(); MOST_GENES];
            for (k, &(lower, upper)) in self.bounds.iter().enumerate() {
                let moved =
                    (Lanes::splat(at[k]) + share * step[k]).within(Lanes::zero(), Lanes::one());
                moved.store(&mut out.values[k][some.clone()]);
                candidates[k] = Lanes::splat(lower) + Lanes::splat(upper - lower) * moved;
            }
            let candidates = &candidates[..self.bounds.len()];
            mean::<S, _, N>(&self.motions, self.settings, candidates).store(&mut out.scores[some]);
        }
        out
    }
}

/// A step down from `at`, each lane with its own damping: by Cholesky's factors of the damped
/// curvature, each parameter in units that make its scale 1. What a step would push out of [0, 1] stays, and the others'
/// steps are found anew.
#[inline(always)]
fn descent<S: Instructions>(
    local: &Local,
    at: &[f32],
    damping: Lanes<S>,
) -> [Lanes<S>; MOST_GENES] {
    let free = local.free;
    let (zero, one) = (Lanes::<S>::zero(), Lanes::<S>::one());
    let mut unit = [0.0; MOST_GENES];
    for (unit, scale) in unit.iter_mut().zip(&local.scale) {
        *unit = 1.0 / scale.max(1e-9).sqrt();
    }
    // 1 where a parameter moves, 0 where it is held.
    let mut moves = [one; MOST_GENES];
    for a in 0..free {
        if pushed(at[a], -local.gradient[a]) {
            moves[a] = zero;
        }
    }
    let mut step = [zero; MOST_GENES];
    // Row by row, up to the diagonal. The loop writes what it reads of it, so it need not be cleared in each turn.
    let mut lower = [zero; MOST_GENES * (MOST_GENES + 1) / 2];
    let row = |a: usize| a * (a + 1) / 2;
    for _ in 0..3 {
        let mut inverse = [zero; MOST_GENES];
        for a in 0..free {
            for b in 0..=a {
                let own = Lanes::splat(local.curvature[a][b] * (unit[a] * unit[b]));
                let mut left = if a == b {
                    (own + damping) * moves[a] + (one - moves[a])
                } else {
                    own * (moves[a] * moves[b])
                };
                for k in 0..b {
                    left = left - lower[row(a) + k] * lower[row(b) + k];
                }
                if a == b {
                    let pivot = Lanes::select(
                        left.lt(Lanes::of(LEAST_PIVOT)),
                        Lanes::of(LEAST_PIVOT),
                        left,
                    );
                    inverse[a] = one / pivot.sqrt();
                } else {
                    lower[row(a) + b] = left * inverse[b];
                }
            }
        }
        let mut side = [zero; MOST_GENES];
        for a in 0..free {
            let mut left = Lanes::splat(-local.gradient[a] * unit[a]) * moves[a];
            for k in 0..a {
                left = left - lower[row(a) + k] * side[k];
            }
            side[a] = left * inverse[a];
        }
        for a in (0..free).rev() {
            let mut left = side[a];
            for k in a + 1..free {
                left = left - lower[row(k) + a] * side[k];
            }
            side[a] = left * inverse[a];
        }
        let mut more = false;
        for a in 0..free {
            step[a] = side[a] * Lanes::splat(unit[a]) * moves[a];
            let out = if at[a] <= 0.0 {
                step[a].lt(zero)
            } else if at[a] >= 1.0 {
                zero.lt(step[a])
            } else {
                continue;
            };
            if Lanes::<S>::any(out) {
                more = true;
                moves[a] = Lanes::select(out, zero, moves[a]);
                step[a] = Lanes::select(out, zero, step[a]);
            }
        }
        if !more {
            break;
        }
    }
    step
}

/// Whether a value at a bound of [0, 1] is moved out of it.
fn pushed(value: f32, by: f32) -> bool {
    (value <= 0.0 && by < 0.0) || (value >= 1.0 && by > 0.0)
}
