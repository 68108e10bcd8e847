//! The path of a reach that nobody recorded, predicted from recordings of others, and parameters that follow it.
//!
//! Its shape, how far each landmark is from its start at [`MOMENTS`] equal parts of the tip's way, and its time course, how
//! much of that way is behind at [`MOMENTS`] moments, are predicted apart: people differ most in when they are where, and
//! a mean over times blurs the shape. Each of the two, y, is predicted from what is known before the reach begins, x, by a
//! Gaussian process (Rasmussen and Williams 2006, section 2.2) on the recordings X, Y with their mean m:
//!
//! ```text
//! y(x) = m + k(x, X)·(k(X, X) + σ²I)⁻¹·(Y − m),      k(x, x') = exp(−‖x − x'‖²/2) + c·(1 + x·x')
//! ```
//!
//! x is the way to the target from where the tip begins and how far the landmarks are apart from one to the next, for the
//! shape also the target and how far it is from the first landmark, for the time course the logarithms of the time and of
//! the mean speed: each less its mean over its standard deviation, and weighted. For the time course y is its log odds. c,
//! how much of a shape is affine, is what predicts each recording best from those to other targets (section 5.4.2): the more
//! recordings there are, the more of it they bear.
//!
//! What the shape's end is off the target, which is known, is spread evenly over the way and along the arm.
//!
//! Recordings may be of several people: what differs between these most, how long their arms are, is part of x.
//!
//! Parameters that follow the path are found by descents ([`crate::refine`]) from those of the reaches to the nearest
//! targets and from such as are guessed from the path ([`crate::guess`]); and by others from there, for which it costs more
//! that the hand does not arrive.
//!
//! A map for a microcontroller is fitted to predicted paths, too ([`around`]): to those of the recorded reaches and of others
//! made up around them. They are what recordings have in common, without what was so by chance in each.

use std::sync::atomic::AtomicBool;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use crate::guess::Guesses;
use crate::kernel::philox::philox;
use crate::kernel::proposal::{gene, parameter};
use crate::map::LearnedMap;
use crate::motion::{Point, distance};
use crate::problem::{Problem, with_dofs};
use crate::refine::{Landscape, Start};
use crate::synergies::{LearnedMotion, Synergies};
use crate::task::{Task, TaskError};

/// Moments that a path is kept at, from the first to the last at equal distances: more gain nothing.
pub const MOMENTS: usize = 16;
/// Targets nearer than this count as the same, metres: a reach that is left out takes with it all to the same target.
pub const NEAR: f64 = 0.05;
/// The weights of the inputs: the target and the way to it, the time and the speed, and the distances between landmarks.
const PLACE: f64 = 0.3;
const PACE: f64 = 0.45;
const SIZE: f64 = 0.2;
/// σ², of a variance of about 1.
const NOISE: f64 = 0.15;
/// c of a shape, one of these; where there is nothing to choose by, the first.
const AFFINE: [f64; 4] = [0.3, 0.1, 1.0, 3.0];
/// c of a time course: none is better for all.
const AFFINE_COURSE: [f64; 1] = [0.3];
/// What is added to a time course and to what is left of it, so that its ends have odds.
const ODDS: f64 = 0.03;
/// No reach counts as slower, metres a second.
const SLOWEST: f64 = 1e-3;
/// An input counts as no further from its mean, standard deviations.
const FURTHEST: f64 = 3.0;
/// Reaches to the nearest targets whose parameters are descended from.
const STARTS: usize = 8;
/// Guesses that are.
const GUESSES: u32 = 16;
/// What a metre costs that the hand does not arrive by, in one descent after the other: the first finds the path's valley,
/// the last stays in it and arrives.
const ARRIVALS: [f32; 3] = [0.2, 2.0, 20.0];
/// A reach is predicted to take no longer than so many times the longest that was recorded: its path ends there, and the
/// hand rests.
const LONGEST: f64 = 2.0;

/// Reaches that are made up around each recorded one, in pairs that lie across from each other,
const AROUND: u32 = 4;
/// in a cube so far to each side of its target, along the way there, metres,
const AWAY: f64 = 0.06;
/// whose times are longer or shorter by up to this share.
const PACES: f64 = 0.2;

/// A path: at each of the [`MOMENTS`] the landmarks, the tip last; metres in the base frame.
pub type Path = Vec<Vec<Point>>;

/// What is known of a reach before it begins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outset {
    /// Where the landmarks begin, the tip last; metres in the base frame.
    pub start: Vec<Point>,
    /// Where the tip is to go.
    pub target: Point,
    /// How long it is to take, seconds.
    pub seconds: f64,
}

/// A recorded reach, as far as others are predicted from it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reach {
    /// How it began.
    #[serde(flatten)]
    pub outset: Outset,
    /// The path that it took.
    pub path: Path,
    /// Its best parameters.
    pub parameters: Vec<f64>,
}

impl Reach {
    /// The same reach elsewhere: each of its points is put where `to` puts it.
    pub fn turned(&self, to: impl Fn(Point) -> Point) -> Reach {
        let all = |points: &Vec<Point>| points.iter().map(|&point| to(point)).collect();
        Reach {
            outset: Outset {
                start: all(&self.outset.start),
                target: to(self.outset.target),
                seconds: self.outset.seconds,
            },
            path: self.path.iter().map(all).collect(),
            parameters: self.parameters.clone(),
        }
    }
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

    /// x for the shape: each input with its weight.
    fn of_shape(&self) -> Vec<(f64, f64)> {
        let first = self.start.first().copied().unwrap_or_default();
        let places = self.target.into_iter().chain(self.way());
        let places = places.chain([distance(self.target, first)]);
        places.map(|x| (x, PLACE)).chain(self.sizes()).collect()
    }

    /// x for the time course.
    fn of_course(&self) -> Vec<(f64, f64)> {
        let way = self.way();
        let speed = distance(way, [0.0; 3]) / self.seconds;
        let paces = [self.seconds.ln(), speed.max(SLOWEST).ln()];
        let places = way.into_iter().map(|x| (x, PLACE));
        let all = places.chain(paces.map(|x| (x, PACE)));
        all.chain(self.sizes()).collect()
    }

    /// How far the landmarks are apart.
    fn sizes(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        let sizes = self.start.windows(2);
        sizes.map(|two| (distance(two[0], two[1]), SIZE))
    }
}

/// The path of a recording, to a tenth of a millimetre.
fn path(reference: &[Vec<Point>]) -> Path {
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

/// How much of the tip's way is behind at each of the [`MOMENTS`], from 0 to 1.
fn course(path: &Path) -> Vec<f64> {
    behind(path.iter().filter_map(|at| at.last().copied()))
}

/// How much of the way through all points is behind at each, from 0 to 1; of no way, evenly.
fn behind(points: impl Iterator<Item = Point>) -> Vec<f64> {
    let points: Vec<Point> = points.collect();
    let steps = points.windows(2).map(|two| distance(two[0], two[1]));
    let behind = std::iter::once(0.0).chain(steps.scan(0.0, |sum, step| {
        *sum += step;
        Some(*sum)
    }));
    let behind: Vec<f64> = behind.take(points.len()).collect();
    let way = behind.last().copied().unwrap_or_default();
    let part = |(point, &behind): (usize, &f64)| match way > 0.0 {
        true => behind / way,
        false => share(point, points.len()),
    };
    behind.iter().enumerate().map(part).collect()
}

/// The landmarks less their start at [`MOMENTS`] equal parts of the tip's way: x, y and z of the first landmark at the
/// first of them, and so on; metres.
fn shape(path: &Path, course: &[f64]) -> Vec<f64> {
    let start = path.first().into_iter().flatten().flatten();
    let part = |part: usize| {
        let points = between(path, when(course, share(part, MOMENTS))).flatten();
        points.zip(start.clone()).map(|(at, start)| at - start)
    };
    (0..MOMENTS).flat_map(part).collect()
}

/// The moment, from 0 to the last, at which so much of the way is behind.
fn when(course: &[f64], behind: f64) -> f64 {
    let after = course.partition_point(|&at| at < behind).max(1);
    match (course.get(after - 1), course.get(after)) {
        (Some(&a), Some(&b)) if b > a => (after - 1) as f64 + ((behind - a) / (b - a)).max(0.0),
        _ => (after.min(course.len().max(1)) - 1) as f64,
    }
}

/// The Gaussian process.
struct Process {
    /// The inputs' means.
    centre: DVector<f64>,
    /// What deviations are multiplied by: the weights over the standard deviations.
    scale: DVector<f64>,
    /// How far an input counts from its mean, weighted.
    furthest: DVector<f64>,
    /// X, as the kernel takes it.
    known: Vec<DVector<f64>>,
    /// m.
    mean: DVector<f64>,
    /// c.
    affine: f64,
    /// (k(X, X) + σ²I)⁻¹·(Y − m), a column for each recording.
    weights: DMatrix<f64>,
}

impl Process {
    /// From the x of each recording, with the weights, its y, and the numbers of the recordings to about the same target,
    /// its own first: at least one. `affine` are the c that there are to choose from.
    fn new(
        x: &[Vec<(f64, f64)>],
        y: &[DVector<f64>],
        alike: &[Vec<usize>],
        affine: &[f64],
    ) -> Self {
        let count = x.len();
        let mean = |rows: &[DVector<f64>]| {
            let zero = DVector::zeros(rows.first().map_or(0, DVector::len));
            rows.iter().fold(zero, |sum, row| sum + row) / count.max(1) as f64
        };
        let inputs: Vec<DVector<f64>> = x.iter().map(|x| numbers(x, |x| x.0)).collect();
        let centre = mean(&inputs);
        let squares = inputs.iter().map(|x| (x - &centre).map(|x| x * x));
        let deviation = mean(&squares.collect::<Vec<_>>()).map(f64::sqrt);
        let shares = x.first().map(|x| numbers(x, |x| x.1));
        let shares = shares.unwrap_or_else(|| DVector::zeros(centre.len()));
        // What never changes says nothing.
        let inverse = deviation.map(|x| if x > 1e-6 { x.recip() } else { 0.0 });
        let mut process = Process {
            scale: inverse.component_mul(&shares),
            furthest: shares * FURTHEST,
            centre,
            known: Vec::new(),
            mean: mean(y),
            affine: affine.first().copied().unwrap_or_default(),
            weights: DMatrix::zeros(y.first().map_or(0, DVector::len), count),
        };
        let known = inputs.iter().map(|inputs| process.place(inputs));
        process.known = known.collect();
        let apart = DMatrix::from_fn(count, process.mean.len(), |a, c| y[a][c] - process.mean[c]);
        let pairs = |of: Kernel| {
            DMatrix::from_fn(count, count, |a, b| {
                of(&process.known[a], &process.known[b])
            })
        };
        let (mut near, straight) = (pairs(near), pairs(straight));
        near.set_diagonal(&near.diagonal().add_scalar(NOISE));
        let mut least = f64::INFINITY;
        for &c in affine {
            // With the noise it is positive definite.
            let Some(factors) = (&near + &straight * c).cholesky() else {
                continue;
            };
            let inverse = factors.inverse();
            let weights = &inverse * &apart;
            let missed = match affine.len() {
                1 => 0.0,
                _ => missed(&inverse, &weights, alike),
            };
            if missed < least {
                least = missed;
                process.affine = c;
                process.weights = weights.transpose();
            }
        }
        process
    }

    /// x as the kernel takes it.
    fn place(&self, inputs: &DVector<f64>) -> DVector<f64> {
        let standard = (inputs - &self.centre).component_mul(&self.scale);
        standard.zip_map(&self.furthest, |x, most| x.clamp(-most, most))
    }

    /// y.
    fn predict(&self, x: &[(f64, f64)]) -> DVector<f64> {
        let place = self.place(&numbers(x, |x| x.0));
        let k = |known| near(known, &place) + self.affine * straight(known, &place);
        let all = self.known.iter().map(k);
        &self.mean + &self.weights * DVector::from_iterator(self.known.len(), all)
    }
}

/// By how much each recording is missed when it is predicted without those like it, all in all: with K⁻¹ and K⁻¹·(Y − m),
/// whose rows for some recordings say what their prediction from all others is off.
fn missed(inverse: &DMatrix<f64>, weights: &DMatrix<f64>, alike: &[Vec<usize>]) -> f64 {
    let off = |alike: &Vec<usize>| {
        let rows = weights.select_rows(alike);
        let factors = inverse.select_rows(alike).select_columns(alike).cholesky();
        factors.map_or(0.0, |factors| factors.solve(&rows).row(0).norm())
    };
    // Where there is nothing else to predict from, nothing is said.
    let told = alike.iter().filter(|alike| alike.len() < weights.nrows());
    told.map(off).sum()
}

/// The inputs, or their weights.
fn numbers(x: &[(f64, f64)], of: fn(&(f64, f64)) -> f64) -> DVector<f64> {
    DVector::from_iterator(x.len(), x.iter().map(of))
}

/// Predicts paths.
struct Predictor {
    shape: Process,
    course: Process,
}

impl Predictor {
    /// From recordings of the same landmarks, at least one.
    fn new(recordings: &[&Reach]) -> Self {
        let inputs = |of: fn(&Outset) -> Vec<(f64, f64)>| -> Vec<_> {
            recordings.iter().map(|reach| of(&reach.outset)).collect()
        };
        let paths = || recordings.iter().map(|reach| &reach.path);
        let courses: Vec<Vec<f64>> = paths().map(course).collect();
        let shapes = paths().zip(&courses);
        let shapes = shapes.map(|(path, course)| DVector::from_vec(shape(path, course)));
        let shapes: Vec<DVector<f64>> = shapes.collect();
        let odds = |course: Vec<f64>| DVector::from_vec(course).map(log_odds);
        let courses: Vec<DVector<f64>> = courses.into_iter().map(odds).collect();
        let alike = |reach: usize| {
            let target = |reach: usize| recordings[reach].outset.target;
            let other = |&other: &usize| other != reach && same(target(other), target(reach));
            let others = (0..recordings.len()).filter(other);
            std::iter::once(reach).chain(others).collect()
        };
        let alike: Vec<Vec<usize>> = (0..recordings.len()).map(alike).collect();
        Predictor {
            shape: Process::new(&inputs(Outset::of_shape), &shapes, &alike, &AFFINE),
            course: Process::new(&inputs(Outset::of_course), &courses, &alike, &AFFINE_COURSE),
        }
    }

    /// The path in so many frames, as a task's reference: it ends at the target.
    fn predict(&self, outset: &Outset, frames: usize) -> Vec<Vec<Point>> {
        let moved = self.shape.predict(&outset.of_shape());
        let landmarks = outset.start.len();
        let coordinate = |part: usize, landmark: usize, r: usize| {
            let moved = moved.get((part * landmarks + landmark) * 3 + r);
            outset.start[landmark][r] + moved.copied().unwrap_or_default()
        };
        let mut shape: Path = (0..MOMENTS)
            .map(|part| {
                let point = |landmark| std::array::from_fn(|r| coordinate(part, landmark, r));
                (0..landmarks).map(point).collect()
            })
            .collect();
        let end = shape.last().and_then(|points| points.last()).copied();
        let left: Point = std::array::from_fn(|r| outset.target[r] - end.unwrap_or_default()[r]);
        let along = behind(outset.start.iter().copied());
        for (part, points) in shape.iter_mut().enumerate() {
            for (point, along) in points.iter_mut().zip(&along) {
                for r in 0..3 {
                    point[r] += share(part, MOMENTS) * along * left[r];
                }
            }
        }
        // From the start to the end, and never back.
        let course = self.course.predict(&outset.of_course());
        let mut course: Vec<f64> = course.iter().map(|&odds| from_log_odds(odds)).collect();
        if let [first, .., last] = &mut course[..] {
            (*first, *last) = (0.0, 1.0);
        }
        let mut least = 0.0;
        for behind in &mut course {
            least = behind.max(least);
            *behind = least;
        }
        let path: Path = course
            .iter()
            .map(|behind| between(&shape, behind * (MOMENTS - 1) as f64).collect())
            .collect();
        let frame = |frame| between(&path, share(frame, frames) * (MOMENTS - 1) as f64).collect();
        (0..frames).map(frame).collect()
    }
}

/// A part of k, of two inputs.
type Kernel = fn(&DVector<f64>, &DVector<f64>) -> f64;

/// The part of k for what is so nearby.
fn near(a: &DVector<f64>, b: &DVector<f64>) -> f64 {
    (-(a - b).norm_squared() / 2.0).exp()
}

/// The part of k for what is affine, for c = 1.
fn straight(a: &DVector<f64>, b: &DVector<f64>) -> f64 {
    1.0 + a.dot(b)
}

/// Of how much of the way is behind.
fn log_odds(behind: f64) -> f64 {
    ((ODDS + behind) / (ODDS + 1.0 - behind)).ln()
}

/// How much of the way is behind, from its log odds.
fn from_log_odds(odds: f64) -> f64 {
    let share = 1.0 / (1.0 + (-odds).exp());
    (share * (1.0 + 2.0 * ODDS) - ODDS).clamp(0.0, 1.0)
}

/// For each task the parameters that follow its reference and arrive: the best of what is found from its starts, and from
/// guesses that are drawn for its number. None where `stop` was set meanwhile.
fn follow(
    problem: &Problem,
    numbers: &[usize],
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
    let guesses = Guesses::new(problem)?;
    for ((set, guesses), &of) in guesses.iter().enumerate().zip(numbers) {
        starts.extend((0..GUESSES).map(|number| Start {
            set,
            genes: guesses.draw(bounds.len(), |block| {
                philox([of as u32, number, block as u32, 2], [0, 0])[0]
            }),
            beat: 0.0,
        }));
    }
    let mut best: Vec<(f32, Vec<u32>)> = Vec::new();
    for arrival in ARRIVALS {
        let landscape = Landscape::arriving(problem, arrival)?;
        let Some(floors) = landscape.refine(&starts, stop) else {
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

/// Whether two targets count as the same.
pub fn same(a: Point, b: Point) -> bool {
    distance(a, b) < NEAR
}

/// The nearest of some targets to another, as numbers into them, and how far each is, metres.
fn nearest(targets: impl Iterator<Item = Point>, to: Point) -> Vec<(usize, f64)> {
    let away = targets.map(|target| distance(target, to));
    let mut all: Vec<(usize, f64)> = away.enumerate().collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    all
}

/// A problem's reaches, with the best parameters of each.
///
/// # Errors
/// A task that the core refuses.
pub fn reaches(problem: &Problem, own: &[Vec<f64>]) -> Result<Vec<Reach>, TaskError> {
    let reach = |(task, parameters): (&Task, &Vec<f64>)| {
        Ok(Reach {
            outset: Outset::new(task, problem.seconds(task))?,
            path: path(&task.reference),
            parameters: parameters.clone(),
        })
    };
    problem.tasks.iter().zip(own).map(reach).collect()
}

/// How many frames a predicted path has.
fn frames(seconds: f64, rate_hz: f64) -> usize {
    ((seconds * rate_hz).round() as usize + 1).max(2)
}

/// What paths are predicted from: a problem's reaches, and those of other people.
#[derive(Clone, Copy)]
pub struct Known<'a> {
    /// The problem's own, in its order.
    pub own: &'a [Reach],
    /// The others'.
    pub others: &'a [Reach],
}

impl<'a> Known<'a> {
    /// The others', and those of its own that are kept.
    fn kept(self, kept: &[usize]) -> Vec<&'a Reach> {
        let own = kept.iter().map(|&reach| &self.own[reach]);
        own.chain(self.others).collect()
    }
}

/// Some of a problem's reaches, and more made up around each, with the paths that are predicted from these alone and from
/// other people's.
pub fn around(problem: &Problem, known: Known<'_>, kept: &[usize]) -> Problem {
    let predictor = Predictor::new(&known.kept(kept));
    let mut tasks = Vec::new();
    for &reach in kept {
        let task = &problem.tasks[reach];
        let outset = &known.own[reach].outset;
        let reference = predictor.predict(outset, task.reference.len());
        tasks.push(Task {
            reference,
            ..task.clone()
        });
        // Which way it goes, horizontally: people who face another way have the same made up.
        let [x, y, _] = outset.way();
        let (sin, cos) = y.atan2(x).sin_cos();
        for number in 0..AROUND {
            let draws = philox([reach as u32, number / 2, 0, 1], [0, 0]);
            let side = if number.is_multiple_of(2) { 2.0 } else { -2.0 };
            let [x, y, up, time] =
                draws.map(|draw| side * (f64::from(draw) / f64::from(u32::MAX) - 0.5));
            let across = [x * cos - y * sin, x * sin + y * cos, up];
            let target: Point = std::array::from_fn(|r| task.target[r] + AWAY * across[r]);
            // No further from the base than where the arm was seen to reach.
            let [most, far] = [task.target, target].map(|to| distance(to, [0.0; 3]));
            let within = if far > most { most / far } else { 1.0 };
            let target = target.map(|x| x * within);
            let seconds = outset.seconds * (PACES * time).exp();
            let outset = Outset {
                target,
                seconds,
                ..outset.clone()
            };
            let frames = frames(seconds, problem.settings.rate_hz);
            tasks.push(Task {
                target,
                reference: predictor.predict(&outset, frames),
                ..task.clone()
            });
        }
    }
    problem.each_of(tasks)
}

/// The parameters of those of some reaches whose targets are nearest to another: where descents begin.
fn starts<'a>(reaches: &[&'a Reach], to: Point) -> Vec<&'a [f64]> {
    let targets = reaches.iter().map(|reach| reach.outset.target);
    let near = nearest(targets, to).into_iter().take(STARTS);
    near.map(|(reach, _)| reaches[reach].parameters.as_slice())
        .collect()
}

/// The parameters of those of a problem's reaches that are left out, found from those that are kept and from other people's.
/// None where `stop` was set meanwhile.
///
/// # Errors
/// A task that the core refuses.
pub fn left_out(
    problem: &Problem,
    known: Known<'_>,
    left_out: &[usize],
    kept: &[usize],
    stop: &AtomicBool,
) -> Result<Option<Vec<Vec<f64>>>, TaskError> {
    let kept = known.kept(kept);
    let predictor = Predictor::new(&kept);
    let asked = left_out.iter().map(|&reach| {
        let task = &problem.tasks[reach];
        Task {
            reference: predictor.predict(&known.own[reach].outset, task.reference.len()),
            ..task.clone()
        }
    });
    let asked: Vec<Task> = asked.collect();
    let starts: Vec<_> = asked
        .iter()
        .map(|task| starts(&kept, task.target))
        .collect();
    follow(&problem.each_of(asked), left_out, &starts, stop)
}

/// Parameters for a reach that begins as one of the file's motions does, and how far to trust them, from 0 to 1, by a map
/// that has reaches to predict from. A target beyond the map's radius is served as [`sinew::map`] says.
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
    let (polynomial, _) = map.plan(dofs, target, seconds).map_err(refused)?;
    let reaches: Vec<&Reach> = map.reaches.iter().collect();
    let targets = reaches.iter().map(|reach| reach.outset.target);
    let (target, away) = match nearest(targets, target).first() {
        Some(&(reach, away)) if away > map.radius => {
            let known = reaches[reach].outset.target;
            let within = map.radius / away;
            let target = std::array::from_fn(|r| known[r] + (target[r] - known[r]) * within);
            (target, away)
        }
        near => (target, near.map_or(0.0, |&(_, away)| away)),
    };

    let longest = reaches.iter().map(|reach| reach.outset.seconds);
    let seconds = seconds.min(LONGEST * longest.fold(0.0, f64::max));
    let mut task = Task {
        name: motion.file.clone(),
        chain: synergies.chain_of(motion).clone(),
        initial: motion.initial_posture.clone(),
        target,
        reference: Vec::new(),
        misfit: 0.0,
    };
    let frames = frames(seconds, synergies.rate_hz);
    task.reference = Predictor::new(&reaches).predict(&Outset::new(&task, seconds)?, frames);
    let mut settings = synergies.settings(motion);
    settings.model = map.model;
    let problem = Problem {
        settings,
        tasks: vec![task],
        sets: vec![vec![0]],
        islands: 1,
        seed: synergies.seed,
    };
    let mut starts = starts(&reaches, target);
    starts.push(&polynomial);
    let found = follow(&problem, &[0], &[starts], &AtomicBool::new(false))?;
    let found = found.and_then(|found| found.into_iter().next());
    let confidence = (1.0 - away / map.radius).max(0.0);
    Ok((found.unwrap_or(polynomial), confidence))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::problem::{ModelKind, StepperKind};

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

    /// With no parameters.
    fn reach(outset: Outset, reference: &[Vec<Point>]) -> Reach {
        Reach {
            outset,
            path: path(reference),
            parameters: Vec::new(),
        }
    }

    fn family() -> Vec<Reach> {
        let targets = (0..27).map(|k| [k % 3, k / 3 % 3, k / 9].map(|x| 0.1 * f64::from(x) + 0.2));
        let outsets = targets
            .enumerate()
            .map(|(k, at)| outset(at, 0.8 + 0.01 * (k % 5) as f64));
        let with_path = |outset: Outset| {
            let reference = recorded(&outset, 61);
            reach(outset, &reference)
        };
        outsets.map(with_path).collect()
    }

    fn predictor(family: &[Reach]) -> Predictor {
        Predictor::new(&family.iter().collect::<Vec<_>>())
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
    fn shapes_are_as_affine_as_recordings_bear_out() {
        let straight = family();
        assert_eq!(predictor(&straight).shape.affine, 3.0);
        let chance = |reach: usize, axis: u32| {
            f64::from(philox([reach as u32, axis, 0, 0], [0, 0])[0]) / f64::from(u32::MAX)
        };
        let astray = straight.into_iter().enumerate().map(|(k, mut reach)| {
            let bows = [0, 1, 2].map(|r| chance(k, r) - 0.5);
            for (moment, points) in reach.path.iter_mut().enumerate() {
                let part = share(moment, MOMENTS);
                for r in 0..3 {
                    points[1][r] += 10.0 * part * (1.0 - part) * bows[r];
                }
            }
            reach
        });
        assert_eq!(predictor(&astray.collect::<Vec<_>>()).shape.affine, 0.1);
    }

    #[test]
    fn a_path_is_its_shape_by_its_course() {
        let path = path(&recorded(&outset([0.2, 0.4, 0.1], 1.0), 61));
        let course = course(&path);
        let shape = shape(&path, &course);
        for (moment, points) in path.iter().enumerate() {
            let behind = course[moment];
            assert!((when(&course, behind) - moment as f64).abs() < 1e-9);
            // On a straight way the tip has gone as much of it as is behind.
            let gone = distance(points[2], path[0][2]) / distance(path[MOMENTS - 1][2], path[0][2]);
            assert!((gone - behind).abs() < 1e-3, "{gone} {behind}");
            let part = share(moment, MOMENTS);
            let moved = [0, 1, 2].map(|r| shape[(moment * 3 + 2) * 3 + r]);
            let way = distance(path[MOMENTS - 1][2], path[0][2]);
            assert!((distance(moved, [0.0; 3]) - part * way).abs() < 1e-3);
        }
        // A tip that rests has a course, too.
        let rests = vec![path[0].clone(); MOMENTS];
        assert_eq!(super::course(&rests)[MOMENTS - 1], 1.0);
        assert!(
            super::shape(&rests, &super::course(&rests))
                .iter()
                .all(|&x| x == 0.0)
        );
    }

    #[test]
    fn different_paces_do_not_blur_the_shape() {
        // The same arc, begun the later the longer the reach takes.
        let arc = |outset: &Outset, frames: usize| -> Vec<Vec<Point>> {
            let way = outset.way();
            let frame = |frame| {
                let s = share(frame, frames).powf(4.0 * outset.seconds);
                let up = 0.2 * (s - s * s);
                let tip = std::array::from_fn(|r| {
                    outset.start[2][r] + s * way[r] + if r == 2 { up } else { 0.0 }
                });
                vec![outset.start[0], outset.start[1], tip]
            };
            (0..frames).map(frame).collect()
        };
        let known = (0..12).map(|k| outset([0.5, 0.2, -0.3], 0.4 + 0.05 * f64::from(k)));
        let known = known.map(|outset| {
            let reference = arc(&outset, 61);
            reach(outset, &reference)
        });
        let known: Vec<Reach> = known.collect();
        let found = predictor(&known).predict(&outset([0.5, 0.2, -0.3], 0.7), 121);
        let highest = found.iter().map(|points| points[2][2]);
        let highest = highest.fold(f64::NEG_INFINITY, f64::max);
        assert!((highest - -0.25).abs() < 2e-3, "{highest}");
    }

    #[test]
    fn of_one_recording_the_path_is_its_own_that_leads_to_the_target() {
        let known = family().remove(5);
        let predictor = Predictor::new(&[&known]);
        let again = predictor.predict(&known.outset, MOMENTS);
        for (point, again) in known.path.iter().flatten().zip(again.iter().flatten()) {
            assert!(distance(*point, *again) < 1e-3);
        }
        let other = outset([0.3, -0.2, 0.1], 2.0);
        let end = predictor.predict(&other, 7)[6][2];
        assert!(distance(end, other.target) < 1e-12);
    }

    #[test]
    fn whatever_is_asked_and_known_what_is_predicted_is_finite() {
        let family = family();
        let twice = [&family[0], &family[0]];
        let all: Vec<&Reach> = family.iter().collect();
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

    /// Some of the shipped reaches, a set each.
    fn shipped(numbers: std::ops::Range<usize>) -> Problem {
        let numbers: Vec<usize> = numbers.collect();
        Problem {
            islands: 1,
            seed: 1,
            ..Problem::of_sample(&numbers, StepperKind::PseudoInverse, ModelKind::B)
        }
    }

    #[test]
    fn reaches_made_up_around_recorded_ones_know_of_these_alone() {
        let (kept, left_out) = ([0, 1, 3, 4], 2);
        let problem = shipped(0..5);
        let own = vec![Vec::new(); 5];
        let around = |problem: &Problem, others: &[Reach]| {
            let own = &reaches(problem, &own).unwrap()[..];
            super::around(problem, Known { own, others }, &kept)
        };
        let made = around(&problem, &[]);
        let each = 1 + AROUND as usize;
        assert_eq!(made.tasks.len(), kept.len() * each);
        assert_eq!(made.sets.len(), made.tasks.len());
        for (number, task) in made.tasks.iter().enumerate() {
            let recorded = &problem.tasks[kept[number / each]];
            let apart: Vec<f64> = (0..3)
                .map(|r| (task.target[r] - recorded.target[r]).abs())
                .collect();
            assert_eq!(task.target == recorded.target, number % each == 0);
            assert!(apart.iter().all(|&apart| apart < 2.0 * AWAY), "{apart:?}");
            let far = |at: Point| distance(at, [0.0; 3]);
            assert!(far(task.target) <= far(recorded.target) + 1e-12);
            let path = &task.reference;
            assert!(path.iter().flatten().flatten().all(|x| x.is_finite()));
            // From where the arm is to the target, in about the time that it took.
            assert_eq!(task.initial, recorded.initial);
            let end = *path.last().unwrap().last().unwrap();
            assert!(distance(end, task.target) < 1e-9);
            let times = path.len() as f64 / recorded.reference.len() as f64;
            assert!((0.75..1.3).contains(&times), "{times}");
        }

        let mut other = problem.clone();
        other.tasks[left_out].reference.reverse();
        assert_eq!(around(&other, &[]).tasks, made.tasks);
        other.tasks[kept[1]].reference.truncate(20);
        assert_ne!(around(&other, &[]).tasks, made.tasks);
        // Other people's are known in any case.
        let others = reaches(&shipped(5..7), &vec![Vec::new(); 2]).unwrap();
        assert_ne!(around(&problem, &others).tasks, made.tasks);
    }

    #[test]
    fn a_hand_that_does_not_arrive_costs_more_and_slopes_say_so() {
        let problem = shipped(4..5);
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
