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
use sinew::real::Real;

use crate::kernel::proposal::{GENE, MOST_GENES, parameter};
use crate::kernel::score::{Ready, mean};
use crate::lanes::{Instructions, Lanes, dispatch};
use crate::problem::{Problem, Settings, with_dofs};
use crate::task::TaskError;

/// Steps of a descent, at most.
const MOST_STEPS: usize = 100;
/// The step of a central difference, as a share of a parameter's bounds: its own error and that of an `f32` are alike.
const DIFFERENCE: f32 = 1.0 / 2048.0;
/// A landmark nearer than this to where it should be counts as being this far, in metres: a norm has no derivative at 0.
const NEAREST: f32 = 1e-5;
/// The values of μ tried at a time, each this many times the one before.
const TRIALS: usize = 8;
const APART: f64 = 10.0;
/// A descent has arrived when a step gains less than this share of the score.
const ARRIVED: f32 = 2e-6;
/// The most vectors of lanes that the parameters, and one more, fill: SSE2's.
const MOST_VECTORS: usize = MOST_GENES.div_ceil(4) + 1;
/// The most lanes of a vector: AVX-512's.
const MOST_LANES: usize = 16;

/// Where a descent is to begin.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Start {
    /// The set of motions that is scored.
    pub set: usize,
    /// The genes.
    pub genes: Vec<u32>,
    /// Whether to descend first in the model that lies within the problem's (S_A in S_B, S_C in S_D), from the mean of
    /// the genes that are one there.
    pub nested: bool,
}

/// Where a descent has arrived.
#[derive(Clone, Debug, PartialEq)]
pub struct Floor {
    /// The genes.
    pub genes: Vec<u32>,
    /// Their score, metres.
    pub score: f32,
}

/// The scores of a problem as landscapes over the parameters, one a set, made ready once for all who look at them.
pub struct Landscape<'a>(Box<dyn Sets + Sync + 'a>);

impl<'a> Landscape<'a> {
    /// Of a problem.
    ///
    /// # Errors
    /// A task that the core refuses.
    pub fn new(problem: &'a Problem) -> Result<Self, TaskError> {
        let dofs = problem.dofs();
        with_dofs!(dofs, N => {
            dispatch!(Level::new(), S => Ok(Landscape(Box::new(valleys::<S, N>(problem)?))))
        }, else Err(TaskError::Dofs { found: dofs }))
    }

    /// Descends from every start, on all threads. `evaluations` is told how often a motion was synthesised. None where
    /// `stop` was set meanwhile.
    pub fn refine(
        &self,
        starts: &[Start],
        evaluations: &AtomicU64,
        stop: &AtomicBool,
    ) -> Option<Vec<Floor>> {
        let descend = |start: &Start| match stop.load(Ordering::Relaxed) {
            true => None,
            false => self.0.descend(start, evaluations),
        };
        starts.par_iter().map(descend).collect()
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
        let scores: Vec<Vec<f32>> = runs.into_par_iter().map(|run| self.0.scores(run)).collect();
        scores.concat()
    }

    /// The landscape near points of the bounds, each on a set of motions.
    pub fn slopes_at(&self, asked: &[(usize, Vec<f32>)]) -> Vec<Slope> {
        let slope = |(set, point): &(usize, Vec<f32>)| self.0.slope(*set, point);
        asked.par_iter().filter_map(slope).collect()
    }
}

/// The sets of a problem, whatever the arm's size and the machine's lanes.
trait Sets {
    /// The floor below a start, where there is its set.
    fn descend(&self, start: &Start, evaluations: &AtomicU64) -> Option<Floor>;
    /// The scores at points of one set.
    fn scores(&self, run: &[(usize, Vec<f32>)]) -> Vec<f32>;
    /// The slope at a point of a set, where there is the set.
    fn slope(&self, set: usize, point: &[f32]) -> Option<Slope>;
}

impl<S: Instructions, const N: usize> Sets for Vec<Valley<'_, S, N>> {
    fn descend(&self, start: &Start, evaluations: &AtomicU64) -> Option<Floor> {
        let valley = self.get(start.set)?;
        let (floor, count) = valley.descend(start);
        evaluations.fetch_add(count * valley.motions.len() as u64, Ordering::Relaxed);
        Some(floor)
    }

    fn scores(&self, run: &[(usize, Vec<f32>)]) -> Vec<f32> {
        let Some(valley) = run.first().and_then(|&(set, _)| self.get(set)) else {
            return vec![f32::INFINITY; run.len()];
        };
        let points: Vec<Vec<f32>> = run.iter().map(|(_, point)| point.clone()).collect();
        valley.scores(&points)
    }

    fn slope(&self, set: usize, point: &[f32]) -> Option<Slope> {
        let each: Vec<usize> = (0..point.len()).collect();
        Some(self.get(set)?.slope(point, &each, each.len()))
    }
}

/// Each set of the problem, ready to be descended on.
fn valleys<S: Instructions, const N: usize>(
    problem: &Problem,
) -> Result<Vec<Valley<'_, S, N>>, TaskError> {
    let bounds = problem.settings.bounds(N);
    let valley = |set: &Vec<usize>| {
        let motions = set.iter().filter_map(|&task| problem.tasks.get(task));
        Ok(Valley {
            settings: &problem.settings,
            bounds: bounds.clone(),
            motions: motions.map(Ready::new).collect::<Result<_, _>>()?,
        })
    };
    problem.sets.iter().map(valley).collect()
}

/// The genes as shares of their bounds.
fn shares(genes: &[u32]) -> Vec<f32> {
    genes
        .iter()
        .map(|&gene| parameter(gene, (0.0, 1.0)))
        .collect()
}

/// A set's score as a landscape over the parameters, each a share of its bounds in [0, 1].
struct Valley<'a, S: Simd, const N: usize> {
    settings: &'a Settings,
    bounds: Vec<(f32, f32)>,
    motions: Vec<Ready<Lanes<S>, N>>,
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

impl<S: Instructions, const N: usize> Valley<'_, S, N> {
    /// Where it leads, and how many candidates were scored on the way.
    fn descend(&self, start: &Start) -> (Floor, u64) {
        let mut count = 0;
        let mut at = shares(&start.genes);
        let inner = self.settings.nested(N);
        if start.nested
            && let Some(inner) = &inner
        {
            at = self.arrive(&means(&at, inner), inner, &mut count);
        }
        let each: Vec<usize> = (0..at.len()).collect();
        let at = self.arrive(&at, &each, &mut count);
        // Genes are a little coarser than what was stepped in.
        let genes: Vec<u32> = at
            .iter()
            .map(|&share| ((share * GENE as f32) as u32).min(GENE))
            .collect();
        let score = self.scores(&[shares(&genes)])[0];
        (Floor { genes, score }, count + 1)
    }

    /// The floor from `at` in the space where parameters with the same number in `groups` are one.
    fn arrive(&self, at: &[f32], groups: &[usize], count: &mut u64) -> Vec<f32> {
        let free = groups.iter().max().map_or(0, |most| most + 1);
        let mut at = at.to_vec();
        let mut least = self.scores(std::slice::from_ref(&at))[0];
        let mut damping = 1e-2;
        for _ in 0..MOST_STEPS {
            let slope = self.slope(&at, groups, free);
            *count += 2 * free as u64 + 1;
            let dampings: [f64; TRIALS] =
                std::array::from_fn(|trial| damping * APART.powi(trial as i32 - 2));
            let trials: Vec<Vec<f32>> = dampings
                .iter()
                .map(|&damping| stepped(&at, groups, &slope, damping))
                .collect();
            let scores = self.scores(&trials);
            *count += TRIALS as u64;
            let mut best = (0, f32::INFINITY);
            for (trial, &score) in scores.iter().enumerate() {
                if score < best.1 {
                    best = (trial, score);
                }
            }
            if best.1 >= least {
                break;
            }
            let gained = least - best.1;
            damping = dampings[best.0].clamp(1e-9, 1e6);
            at = trials[best.0].clone();
            least = best.1;
            if gained < ARRIVED * least {
                break;
            }
        }
        at
    }

    /// The scores of some points.
    fn scores(&self, points: &[Vec<f32>]) -> Vec<f32> {
        // Here and in `slope`, not further out: what is inside is compiled wherever it is called.
        S::proof().vectorize(
            #[inline(always)]
            || self.scores_in_lanes(points),
        )
    }

    #[inline(always)]
    fn scores_in_lanes(&self, points: &[Vec<f32>]) -> Vec<f32> {
        let mut out = Vec::with_capacity(points.len());
        for some in points.chunks(Lanes::<S>::COUNT) {
            // Lanes without a point of their own take the last.
            let candidates = self.candidates(|lane| &some[lane.min(some.len() - 1)]);
            let candidates = &candidates[..self.bounds.len()];
            let mut scores = [0.0; 16];
            mean(&self.motions, self.settings, candidates).store(&mut scores[..Lanes::<S>::COUNT]);
            out.extend(&scores[..some.len()]);
        }
        out
    }

    /// The parameters at a point for each lane.
    #[inline(always)]
    fn candidates<'p>(&self, point: impl Fn(usize) -> &'p Vec<f32>) -> [Lanes<S>; MOST_GENES] {
        let mut out = [Lanes::zero(); MOST_GENES];
        for (k, (parameter, &(lower, upper))) in out.iter_mut().zip(&self.bounds).enumerate() {
            let mut values = [0.0; 16];
            for (lane, value) in values.iter_mut().enumerate().take(Lanes::<S>::COUNT) {
                *value = lower + (upper - lower) * point(lane)[k];
            }
            *parameter = Lanes::load(&values[..Lanes::<S>::COUNT]);
        }
        out
    }

    /// Gradient, curvature and scale at a point. Lane a of all vectors together is a step up along parameter a, and as many
    /// vectors after these are the steps down; the lane after the last step up is at the point itself.
    fn slope(&self, at: &[f32], groups: &[usize], free: usize) -> Slope {
        S::proof().vectorize(
            #[inline(always)]
            || self.slope_in_lanes(at, groups, free),
        )
    }

    #[inline(always)]
    fn slope_in_lanes(&self, at: &[f32], groups: &[usize], free: usize) -> Slope {
        let lanes = Lanes::<S>::COUNT;
        let vectors = (free + 1).div_ceil(lanes);
        let mut points = vec![at.to_vec(); 2 * vectors * lanes];
        for (k, &group) in groups.iter().enumerate() {
            points[group][k] = at[k] + DIFFERENCE;
            points[vectors * lanes + group][k] = at[k] - DIFFERENCE;
        }
        let rate = Lanes::<S>::splat(0.5 / DIFFERENCE);

        let mut gradient = [Lanes::<S>::zero(); MOST_VECTORS];
        let mut scale = [Lanes::<S>::zero(); MOST_VECTORS];
        let mut curvature = [[Lanes::<S>::zero(); MOST_VECTORS]; MOST_GENES];
        let mut apart: Vec<Vec<f32>> = vec![Vec::new(); 2 * vectors];
        for motion in &self.motions {
            for (v, apart) in apart.iter_mut().enumerate() {
                apart.clear();
                let candidates = self.candidates(|lane| &points[v * lanes + lane]);
                motion.apart(
                    self.settings,
                    &candidates[..self.bounds.len()],
                    #[inline(always)]
                    |coordinate| {
                        let end = apart.len();
                        apart.resize(end + lanes, 0.0);
                        coordinate.store(&mut apart[end..]);
                    },
                );
            }
            let rows = apart[0].len() / (3 * lanes);
            let weight = 1.0 / (rows * self.motions.len()) as f32;
            for row in 0..rows {
                let coordinate = |c: usize| (3 * row + c) * lanes;
                let own: [f32; 3] =
                    std::array::from_fn(|c| apart[free / lanes][coordinate(c) + free % lanes]);
                let norm = (own[0] * own[0] + own[1] * own[1] + own[2] * own[2])
                    .sqrt()
                    .max(NEAREST);
                let u = own.map(|x| Lanes::<S>::splat(x / norm));
                let (weight, bend) = (Lanes::splat(weight), Lanes::splat(weight / norm));
                let mut across = [[Lanes::<S>::zero(); MOST_VECTORS]; 3];
                let mut flat = [[0.0; MOST_VECTORS * 16]; 3];
                for v in 0..vectors {
                    let slope: [Lanes<S>; 3] = std::array::from_fn(|c| {
                        let begin = coordinate(c);
                        let (up, down) = (&apart[v], &apart[vectors + v]);
                        (Lanes::load(&up[begin..begin + lanes])
                            - Lanes::load(&down[begin..begin + lanes]))
                            * rate
                    });
                    let along = slope[0] * u[0] + slope[1] * u[1] + slope[2] * u[2];
                    gradient[v] = gradient[v] + weight * along;
                    let square = slope[0] * slope[0] + slope[1] * slope[1] + slope[2] * slope[2];
                    scale[v] = scale[v] + bend * square;
                    for c in 0..3 {
                        across[c][v] = slope[c] - along * u[c];
                        across[c][v].store(&mut flat[c][v * lanes..(v + 1) * lanes]);
                        across[c][v] = across[c][v] * bend;
                    }
                }
                for a in 0..free {
                    let own: [Lanes<S>; 3] = std::array::from_fn(|c| Lanes::splat(flat[c][a]));
                    // It is symmetric: what is right of the diagonal is not needed.
                    for v in 0..=a / lanes {
                        curvature[a][v] = curvature[a][v]
                            + (own[0] * across[0][v]
                                + own[1] * across[1][v]
                                + own[2] * across[2][v]);
                    }
                }
            }
        }
        let flat = |vectors: &[Lanes<S>]| {
            let mut out = [0.0; MOST_VECTORS * 16];
            for (v, vector) in vectors.iter().enumerate() {
                vector.store(&mut out[v * lanes..(v + 1) * lanes]);
            }
            out
        };
        let (gradient, scale) = (flat(&gradient), flat(&scale));
        let curvature: Vec<_> = curvature[..free].iter().map(|row| flat(row)).collect();
        Slope {
            gradient: DVector::from_fn(free, |a, _| f64::from(gradient[a])),
            curvature: DMatrix::from_fn(free, free, |a, b| {
                f64::from(if a >= b {
                    curvature[a][b]
                } else {
                    curvature[b][a]
                })
            }),
            scale: DVector::from_fn(free, |a, _| f64::from(scale[a])),
        }
    }
}

/// The mean of each group's values, in its members' places.
fn means(at: &[f32], groups: &[usize]) -> Vec<f32> {
    let mean = |group: usize| {
        let members = || at.iter().zip(groups).filter(move |&(_, &g)| g == group);
        members().map(|(x, _)| x).sum::<f32>() / members().count() as f32
    };
    groups.iter().map(|&group| mean(group)).collect()
}

/// A step from `at` down a slope, within [0, 1].
fn stepped(at: &[f32], groups: &[usize], slope: &Slope, damping: f64) -> Vec<f32> {
    let free = slope.gradient.len();
    let mut value = vec![0.0; free];
    for (&group, &share) in groups.iter().zip(at) {
        value[group] = f64::from(share);
    }
    let mut step = DVector::zeros(free);
    let mut held: Vec<bool> = value
        .iter()
        .zip(&slope.gradient)
        .map(|(&value, &slope)| pushed(value, -slope))
        .collect();
    // What a step would push against its bound is held too, and the others' steps are found anew.
    for _ in 0..3 {
        let mut matrix = slope.curvature.clone();
        let mut side = -&slope.gradient;
        for a in 0..free {
            matrix[(a, a)] += damping * slope.scale[a].max(1e-9);
        }
        for a in (0..free).filter(|&a| held[a]) {
            matrix.row_mut(a).fill(0.0);
            matrix.column_mut(a).fill(0.0);
            matrix[(a, a)] = 1.0;
            side[a] = 0.0;
        }
        let Some(factors) = matrix.cholesky() else {
            return at.to_vec();
        };
        step = factors.solve(&side);
        let more: Vec<usize> = (0..free)
            .filter(|&a| !held[a] && pushed(value[a], step[a]))
            .collect();
        if more.is_empty() {
            break;
        }
        more.into_iter().for_each(|a| held[a] = true);
    }
    let moved = |(&share, &group): (&f32, &usize)| (share + step[group] as f32).clamp(0.0, 1.0);
    at.iter().zip(groups).map(moved).collect()
}

/// Whether a value at a bound of [0, 1] is moved out of it.
fn pushed(value: f64, by: f64) -> bool {
    (value <= 0.0 && by < 0.0) || (value >= 1.0 && by > 0.0)
}
