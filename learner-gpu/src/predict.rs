//! The path of a reach that nobody recorded, predicted from recordings of others, and parameters that follow it.
//!
//! How far each landmark is from its start at [`MOMENTS`] moments of a reach, y, is predicted from what is known before it
//! begins, x, by a Gaussian process (Rasmussen and Williams 2006, section 2.2) on the recordings X, Y with their mean m:
//!
//! ```text
//! y(x) = m + k(x, X)·(k(X, X) + σ²I)⁻¹·(Y − m),      k(x, x') = exp(−‖x − x'‖²/2) + c·(1 + x·x')
//! ```
//!
//! x is the target, the way to it from where the tip begins, the logarithm of the time, the mean speed, and how far the
//! landmarks are apart from one to the next: each less its mean over its standard deviation, and weighted. What the
//! prediction's end is off the target, which is known, is spread evenly over the way.
//!
//! Parameters that follow the path are found by descents ([`crate::refine`]) from those of the reaches to the nearest
//! targets; and by others from there, for which it costs more that the hand does not arrive.

use std::sync::atomic::{AtomicBool, AtomicU64};

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use crate::kernel::proposal::{gene, parameter};
use crate::map::LearnedMap;
use crate::motion::{Point, distance};
use crate::problem::{Problem, with_dofs};
use crate::refine::{Landscape, Start};
use crate::synergies::{LearnedMotion, Synergies};
use crate::task::{Task, TaskError};

/// Moments that a path is kept at, from the first to the last at equal distances: more gain nothing.
pub const MOMENTS: usize = 16;
/// The weights of the inputs: the target and the way to it (both say much the same), the time and the speed, and the
/// distances between landmarks.
const PLACE: f64 = 0.28;
const PACE: f64 = 0.4;
const SIZE: f64 = 0.16;
/// σ², of a variance of about 1.
const NOISE: f64 = 0.15;
/// c: how much of it is affine.
const AFFINE: f64 = 0.2;
/// An input counts as no further from its mean, standard deviations.
const FURTHEST: f64 = 3.0;
/// Reaches to the nearest targets whose parameters are descended from.
const STARTS: usize = 8;
/// What a metre costs that the hand does not arrive by, in one descent after the other: the first finds the path's valley,
/// the last stays in it and arrives.
const ARRIVALS: [f32; 2] = [0.2, 2.0];
/// A reach is predicted to take no longer than so many times the longest that was recorded: its path ends there, and the
/// hand rests.
const LONGEST: f64 = 2.0;

/// A path: at each of the [`MOMENTS`] the landmarks, the tip last; metres in the base frame.
pub type Path = Vec<Vec<Point>>;

/// What is known of a reach before it begins.
struct Outset {
    /// Where the landmarks begin, the tip last; metres in the base frame.
    start: Vec<Point>,
    /// Where the tip is to go.
    target: Point,
    /// How long it is to take, seconds.
    seconds: f64,
}

impl Outset {
    /// Of a task, whatever its reference, that is to take so long.
    fn new(task: &Task, seconds: f64) -> Result<Self, TaskError> {
        let dofs = task.chain.joints.len();
        let start = with_dofs!(dofs, N => {
            task.chain.build::<N>()?.forward(&task.posture()?).landmarks().collect()
        }, else return Err(TaskError::Dofs { found: dofs }));
        Ok(Outset {
            start,
            target: task.target,
            seconds,
        })
    }

    /// The way that the tip is to go.
    fn way(&self) -> Point {
        let from = self.start.last().copied().unwrap_or_default();
        std::array::from_fn(|r| self.target[r] - from[r])
    }

    /// x, and the weights.
    fn inputs(&self) -> (DVector<f64>, DVector<f64>) {
        let way = self.way();
        let speed = distance(way, [0.0; 3]) / self.seconds;
        let sizes = self.start.windows(2).map(|two| distance(two[0], two[1]));
        let places = self.target.into_iter().chain(way).map(|x| (x, PLACE));
        let all: Vec<(f64, f64)> = places
            .chain([(self.seconds.ln(), PACE), (speed, PACE)])
            .chain(sizes.map(|size| (size, SIZE)))
            .collect();
        let numbers =
            |of: fn(&(f64, f64)) -> f64| DVector::from_iterator(all.len(), all.iter().map(of));
        (numbers(|x| x.0), numbers(|x| x.1))
    }

    /// x as the kernel takes it, with its mean and what deviations are multiplied by.
    fn place(&self, centre: &DVector<f64>, scale: &DVector<f64>) -> DVector<f64> {
        let (inputs, weights) = self.inputs();
        let standard = (inputs - centre).component_mul(scale);
        let standard = standard.map(|x| x.clamp(-FURTHEST, FURTHEST));
        standard.component_mul(&weights)
    }
}

/// The path of a recording, to a tenth of a millimetre.
pub fn path(reference: &[Vec<Point>]) -> Path {
    let rounded = |point: Point| point.map(|x| (x * 1e4).round() / 1e4);
    let moment = |moment: usize| {
        let at = share(moment, MOMENTS) * reference.len().saturating_sub(1) as f64;
        between(reference, at).map(rounded).collect()
    };
    (0..MOMENTS).map(moment).collect()
}

/// How much of the way from the first to the last of so many is behind.
fn share(number: usize, count: usize) -> f64 {
    number as f64 / count.saturating_sub(1).max(1) as f64
}

/// The landmarks between two frames, linearly.
fn between(frames: &[Vec<Point>], at: f64) -> impl Iterator<Item = Point> + '_ {
    let last = frames.len().saturating_sub(1);
    let [before, after] = [at.floor(), at.ceil()].map(|at| frames.get(last.min(at as usize)));
    let [before, after] = [before, after].map(|frame| frame.into_iter().flatten());
    let part = at.fract();
    let point =
        move |(a, b): (&Point, &Point)| std::array::from_fn(|r| a[r] + (b[r] - a[r]) * part);
    before.zip(after).map(point)
}

/// The Gaussian process.
struct Predictor {
    /// The inputs' means.
    centre: DVector<f64>,
    /// The inverse of their standard deviations.
    scale: DVector<f64>,
    /// X, as the kernel takes it.
    known: Vec<DVector<f64>>,
    /// m: moment by moment, landmark by landmark, x, y and z.
    mean: DVector<f64>,
    /// (k(X, X) + σ²I)⁻¹·(Y − m), a column for each recording.
    weights: DMatrix<f64>,
}

impl Predictor {
    /// From recordings of the same landmarks, at least one.
    fn new(recordings: &[(&Outset, &Path)]) -> Self {
        let count = recordings.len().max(1) as f64;
        let mean = |rows: &[DVector<f64>]| {
            let zero = DVector::zeros(rows.first().map_or(0, DVector::len));
            rows.iter().fold(zero, |sum, row| sum + row) / count
        };
        let inputs = |(outset, _): &(&Outset, &Path)| outset.inputs().0;
        let inputs: Vec<DVector<f64>> = recordings.iter().map(inputs).collect();
        let centre = mean(&inputs);
        let squares = inputs.iter().map(|x| (x - &centre).map(|x| x * x));
        let deviation = mean(&squares.collect::<Vec<_>>()).map(f64::sqrt);
        // What never changes says nothing.
        let scale = deviation.map(|x| if x > 1e-6 { x.recip() } else { 0.0 });
        let known = recordings
            .iter()
            .map(|(outset, _)| outset.place(&centre, &scale));
        let known: Vec<DVector<f64>> = known.collect();
        let moved = |(_, path): &(&Outset, &Path)| {
            let start = path.first().into_iter().flatten().flatten();
            let points = path
                .iter()
                .flat_map(|points| points.iter().flatten().zip(start.clone()));
            DVector::from_vec(points.map(|(at, start)| at - start).collect())
        };
        let paths: Vec<DVector<f64>> = recordings.iter().map(moved).collect();
        let mean = mean(&paths);
        let count = known.len();
        let covariance = DMatrix::from_fn(count, count, |a, b| {
            let noise = if a == b { NOISE } else { 0.0 };
            kernel(&known[a], &known[b]) + noise
        });
        let apart = DMatrix::from_fn(count, mean.len(), |a, c| paths[a][c] - mean[c]);
        // With the noise it is positive definite.
        let weights = match covariance.cholesky() {
            Some(factors) => factors.solve(&apart).transpose(),
            None => DMatrix::zeros(mean.len(), count),
        };
        Predictor {
            centre,
            scale,
            known,
            mean,
            weights,
        }
    }

    /// The path in so many frames, as a task's reference: it ends at the target.
    fn predict(&self, outset: &Outset, frames: usize) -> Vec<Vec<Point>> {
        let place = outset.place(&self.centre, &self.scale);
        let near = self.known.iter().map(|known| kernel(known, &place));
        let near = DVector::from_iterator(self.known.len(), near);
        let moved = &self.mean + &self.weights * near;
        let landmarks = outset.start.len();
        let coordinate = |moment: usize, landmark: usize, r: usize| {
            let moved = moved.get((moment * landmarks + landmark) * 3 + r);
            outset.start[landmark][r] + moved.copied().unwrap_or_default()
        };
        let mut path: Path = (0..MOMENTS)
            .map(|moment| {
                let point = |landmark| std::array::from_fn(|r| coordinate(moment, landmark, r));
                (0..landmarks).map(point).collect()
            })
            .collect();
        let end = path.last().and_then(|points| points.last()).copied();
        let left: Point = std::array::from_fn(|r| outset.target[r] - end.unwrap_or_default()[r]);
        for (moment, points) in path.iter_mut().enumerate() {
            if let Some(tip) = points.last_mut() {
                for r in 0..3 {
                    tip[r] += share(moment, MOMENTS) * left[r];
                }
            }
        }
        let frame = |frame| between(&path, share(frame, frames) * (MOMENTS - 1) as f64).collect();
        (0..frames).map(frame).collect()
    }
}

/// k.
fn kernel(a: &DVector<f64>, b: &DVector<f64>) -> f64 {
    (-(a - b).norm_squared() / 2.0).exp() + AFFINE * (1.0 + a.dot(b))
}

/// For each task the parameters that follow its reference and arrive: the best of what is found from its starts. None
/// where `stop` was set meanwhile.
fn follow(
    problem: &Problem,
    starts: &[Vec<&[f64]>],
    stop: &AtomicBool,
) -> Result<Option<Vec<Vec<f64>>>, TaskError> {
    let bounds = problem.settings.bounds(problem.dofs());
    let begin = |set: usize, parameters: &[f64]| Start {
        set,
        genes: parameters
            .iter()
            .zip(&bounds)
            .map(|(&p, &bounds)| gene(p, bounds))
            .collect(),
        beat: 0.0,
    };
    let each = starts.iter().enumerate();
    let mut starts: Vec<Start> = each
        .flat_map(|(set, starts)| starts.iter().map(move |&parameters| (set, parameters)))
        .map(|(set, parameters)| begin(set, parameters))
        .collect();
    let mut best: Vec<(f32, Vec<u32>)> = Vec::new();
    for arrival in ARRIVALS {
        let landscape = Landscape::arriving(problem, arrival)?;
        let Some(floors) = landscape.refine(&starts, &AtomicU64::new(0), stop) else {
            return Ok(None);
        };
        best = vec![(f32::INFINITY, Vec::new()); problem.sets.len()];
        for (start, floor) in starts.iter_mut().zip(floors) {
            let best = &mut best[start.set];
            start.genes = floor.genes;
            if best.1.is_empty() || floor.score < best.0 {
                *best = (floor.score, start.genes.clone());
            }
        }
    }
    let parameters = |(_, genes): (f32, Vec<u32>)| {
        let each = genes.iter().zip(&bounds);
        each.map(|(&gene, &bounds)| parameter(gene, bounds).into())
            .collect()
    };
    Ok(Some(best.into_iter().map(parameters).collect()))
}

/// The nearest of some targets to another, as numbers into them, and how far each is, metres.
fn nearest(targets: impl Iterator<Item = Point>, to: Point) -> Vec<(usize, f64)> {
    let away = targets.map(|target| distance(target, to));
    let mut all: Vec<(usize, f64)> = away.enumerate().collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all
}

/// The parameters of a problem's reaches, group by group, found from what is known of others: with each group that is left
/// out go the reaches that are kept, of which the best parameters (`own`) are known too. None where `stop` was set
/// meanwhile.
///
/// # Errors
/// A task that the core refuses.
pub fn left_out(
    problem: &Problem,
    own: &[Vec<f64>],
    folds: &[(Vec<usize>, Vec<usize>)],
    stop: &AtomicBool,
) -> Result<Option<Vec<Vec<f64>>>, TaskError> {
    let known = |task: &Task| {
        let seconds = task.reference.len().saturating_sub(1) as f64 * problem.settings.dt();
        let outset = Outset::new(task, seconds)?;
        Ok((outset, path(&task.reference)))
    };
    let known = problem.tasks.iter().map(known);
    let known: Vec<(Outset, Path)> = known.collect::<Result<_, TaskError>>()?;
    let found = folds.par_iter().map(|(left_out, kept)| {
        let from = kept.iter().map(|&reach| (&known[reach].0, &known[reach].1));
        let predictor = Predictor::new(&from.collect::<Vec<_>>());
        let predicted = |&reach: &usize| {
            let task = &problem.tasks[reach];
            let targets = kept.iter().map(|&other| problem.tasks[other].target);
            let near = nearest(targets, task.target).into_iter().take(STARTS);
            let task = Task {
                reference: predictor.predict(&known[reach].0, task.reference.len()),
                ..task.clone()
            };
            let starts = near.map(|(other, _)| own[kept[other]].as_slice());
            (task, starts.collect())
        };
        left_out.iter().map(predicted).collect::<Vec<_>>()
    });
    let found: Vec<(Task, Vec<&[f64]>)> = found.flatten_iter().collect();
    let (tasks, starts): (Vec<Task>, Vec<_>) = found.into_iter().unzip();
    if tasks.is_empty() {
        return Ok(Some(Vec::new()));
    }
    let asked = Problem {
        sets: (0..tasks.len()).map(|set| vec![set]).collect(),
        tasks,
        ..problem.clone()
    };
    follow(&asked, &starts, stop)
}

/// Parameters for a reach that begins as one of the file's motions does, and how far to trust them, from 0 to 1, by a map
/// with paths. A target beyond the map's radius is served as [`sinew::map`] says.
///
/// # Errors
/// What the core refuses.
pub fn plan(
    synergies: &Synergies,
    map: &LearnedMap,
    motion: &LearnedMotion,
    target: Point,
    seconds: f64,
) -> Result<(Vec<f64>, f64), TaskError> {
    let refused = |error| TaskError::Core {
        motion: motion.file.clone(),
        error,
    };
    let dofs = motion.initial_posture.len();
    let (polynomial, confidence) = map.plan(dofs, target, seconds).map_err(refused)?;
    let target = match nearest(map.targets.iter().copied(), target).first() {
        Some(&(known, away)) if away > map.radius => {
            let known = map.targets[known];
            std::array::from_fn(|r| known[r] + (target[r] - known[r]) * map.radius / away)
        }
        _ => target,
    };

    let task = |motion: &LearnedMotion, target| Task {
        name: motion.file.clone(),
        chain: synergies.chain_of(motion).clone(),
        initial: motion.initial_posture.clone(),
        target,
        reference: Vec::new(),
        misfit: 0.0,
    };
    let known = synergies.motions.iter().map(|motion| {
        let ticks = motion.frames.saturating_sub(1) as f64;
        Outset::new(&task(motion, motion.target), ticks / synergies.rate_hz)
    });
    let known: Vec<Outset> = known.collect::<Result<_, _>>()?;
    let longest = known.iter().map(|outset| outset.seconds);
    let seconds = seconds.min(LONGEST * longest.fold(0.0, f64::max));
    let frames = (seconds * synergies.rate_hz).round() as usize + 1;
    let predictor = Predictor::new(&known.iter().zip(&map.paths).collect::<Vec<_>>());
    let mut task = task(motion, target);
    task.reference = predictor.predict(&Outset::new(&task, seconds)?, frames.max(2));
    let mut settings = synergies.settings(motion);
    settings.model = map.model;
    let problem = Problem {
        settings,
        tasks: vec![task],
        sets: vec![vec![0]],
        islands: 1,
        seed: synergies.seed,
    };
    let near = nearest(known.iter().map(|outset| outset.target), target);
    let near = near.iter().map(|&(other, _)| &synergies.motions[other]);
    let near = near.filter(|other| other.model == map.model).take(STARTS);
    let mut starts: Vec<&[f64]> = near.map(|other| other.parameters.as_slice()).collect();
    starts.push(&polynomial);
    let found = follow(&problem, &[starts], &AtomicBool::new(false))?;
    let found = found.and_then(|found| found.into_iter().next());
    Ok((found.unwrap_or(polynomial), confidence))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{ModelKind, Settings, StepperKind};
    use crate::task::{Arm, facing};

    /// Reaches whose paths are the same share of the way at the same share of the time, the elbow half of it.
    fn outset(target: Point, seconds: f64) -> Outset {
        Outset {
            start: vec![[0.0; 3], [0.1, 0.0, -0.3], [0.1, 0.2, -0.3]],
            target,
            seconds,
        }
    }

    fn recorded(outset: &Outset, frames: usize) -> Vec<Vec<Point>> {
        let way = outset.way();
        let frame = |frame| {
            let s: f64 = share(frame, frames);
            let gone = s * s * (3.0 - 2.0 * s);
            let part = |landmark: usize| [0.0, 0.5, 1.0][landmark] * gone;
            let point = |l: usize| std::array::from_fn(|r| outset.start[l][r] + part(l) * way[r]);
            (0..3).map(point).collect()
        };
        (0..frames).map(frame).collect()
    }

    fn family() -> Vec<(Outset, Path)> {
        let targets = (0..27).map(|k| [k % 3, k / 3 % 3, k / 9].map(|x| 0.1 * f64::from(x) + 0.2));
        let outsets = targets
            .enumerate()
            .map(|(k, at)| outset(at, 0.8 + 0.01 * (k % 5) as f64));
        let with_path = |outset: Outset| {
            let path = path(&recorded(&outset, 61));
            (outset, path)
        };
        outsets.map(with_path).collect()
    }

    fn predictor(family: &[(Outset, Path)]) -> Predictor {
        Predictor::new(
            &family
                .iter()
                .map(|(outset, path)| (outset, path))
                .collect::<Vec<_>>(),
        )
    }

    #[test]
    fn a_reach_among_recordings_takes_the_path_that_they_have_in_common() {
        let new = outset([0.26, 0.34, 0.31], 0.83);
        let (expected, found) = (recorded(&new, 50), predictor(&family()).predict(&new, 50));
        for (expected, found) in expected.iter().zip(&found) {
            for (expected, found) in expected.iter().zip(found) {
                assert!(distance(*expected, *found) < 0.01, "{expected:?} {found:?}");
            }
        }
        assert!(distance(found[49][2], new.target) < 1e-12);
        assert_eq!(found[0], new.start);
    }

    #[test]
    fn of_one_recording_the_path_is_its_own_that_leads_to_the_target() {
        let (known, path) = family().remove(5);
        let predictor = Predictor::new(&[(&known, &path)]);
        let again = predictor.predict(&known, MOMENTS);
        for (point, again) in path.iter().flatten().zip(again.iter().flatten()) {
            assert!(distance(*point, *again) < 1e-3);
        }
        let other = outset([0.3, -0.2, 0.1], 2.0);
        let end = predictor.predict(&other, 7)[6][2];
        assert!(distance(end, other.target) < 1e-12);
    }

    #[test]
    fn whatever_is_asked_and_known_what_is_predicted_is_finite() {
        let family = family();
        let twice = [(&family[0].0, &family[0].1), (&family[0].0, &family[0].1)];
        let all: Vec<(&Outset, &Path)> = family.iter().map(|(o, p)| (o, p)).collect();
        for known in [&all[..], &twice, &all[..2]] {
            let predictor = Predictor::new(known);
            for seconds in [1e-9, 0.8, 1e9] {
                for target in [[0.3; 3], [1e4, -1e4, 0.0], outset([0.0; 3], 1.0).start[2]] {
                    let path = predictor.predict(&outset(target, seconds), 3);
                    assert!(path.iter().flatten().flatten().all(|x| x.is_finite()));
                }
            }
        }
    }

    #[test]
    fn a_hand_that_does_not_arrive_costs_more_and_slopes_say_so() {
        let reaches = crate::sample::shipped().unwrap();
        let arm = Arm::Human(facing(&reaches));
        let stepper = StepperKind::PseudoInverse;
        let settings = Settings {
            stepper,
            model: ModelKind::B,
            lambda: stepper.rate(),
            rate_hz: 60.0,
            clamped: false,
        };
        let problem = Problem {
            settings,
            tasks: vec![Task::new(&reaches[4], &arm, 60.0).unwrap()],
            sets: vec![vec![0]],
            islands: 1,
            seed: 1,
        };
        let plain = Landscape::new(&problem).unwrap();
        let arriving = Landscape::arriving(&problem, 2.0).unwrap();
        let cost = |gain: f32| {
            let at = [(0, vec![gain; 7])];
            arriving.scores_at(&at)[0] - plain.scores_at(&at)[0]
        };
        // Gains of 1 arrive; of 0.1, hardly more than half of the way.
        assert_eq!(cost(0.6), 0.0);
        assert!(cost(0.51) > 0.1, "{}", cost(0.51));
        let score = |gain: f32| f64::from(arriving.scores_at(&[(0, vec![gain; 7])])[0]);
        let step = 1.0 / 2048.0;
        let rise = (score(0.52 + step) - score(0.52 - step)) / f64::from(2.0 * step);
        let slope = arriving
            .slopes_at(&[(0, vec![0.52; 7])])
            .remove(0)
            .gradient
            .sum();
        assert!((rise - slope).abs() < 0.05 * rise.abs(), "{rise} {slope}");
    }
}
