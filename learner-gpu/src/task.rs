//! From a recording to a task: the reference at the controller's rate, the target, the initial posture, and the chain
//! that the recorded arm is (SPEC section 5).

use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};
use sinew::chain::{Chain, Kind, Link};
use sinew::real::Real;
use sinew::target::Position;

use crate::chain::{ChainDescription, ChainError};
use crate::motion::{Motion, MotionError, Point};
use crate::problem::{MOST_DOFS, with_dofs};

/// One motion to learn from.
#[derive(Clone, Debug, PartialEq)]
pub struct Task {
    /// The recording's name.
    pub name: String,
    /// The arm.
    pub chain: ChainDescription,
    /// The posture it begins in: radians or metres.
    pub initial: Vec<f64>,
    /// Where the tip is to go, metres in the base frame.
    pub target: Point,
    /// The recorded motion, frame by frame: the chain's landmarks in order, then the tip; metres in the base frame.
    pub reference: Vec<Vec<Point>>,
    /// How far the initial posture's landmarks are from the recorded ones, metres (SPEC section 4's dist).
    pub misfit: f64,
}

/// Why a recording cannot be learned from.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// The recording has no usable reach.
    #[error(transparent)]
    Motion(#[from] MotionError),
    /// The chain is not valid.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// The chain has more DoFs than are compiled in, or none.
    #[error("the chain has {found} joints, expected 1 to {MOST_DOFS}")]
    Dofs {
        /// How many it has.
        found: usize,
    },
    /// A posture is not of the chain's size.
    #[error("motion {motion:?}: the initial posture has {found} angles, expected {expected}")]
    Posture {
        /// The motion.
        motion: String,
        /// How many there should be.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A landmark of the chain is not in the recording.
    #[error("motion {motion:?} has no landmark {landmark:?}; it has {has}")]
    Landmark {
        /// The motion.
        motion: String,
        /// The chain's landmark.
        landmark: String,
        /// Those that the recording has.
        has: String,
    },
    /// The core refused a number.
    #[error("motion {motion:?}: {error}")]
    Core {
        /// The motion.
        motion: String,
        /// What it said.
        error: sinew::Error,
    },
}

/// Which way the recorded people face: forward is where the hands are from the shoulders, horizontally, over all the
/// recordings, to the nearest of ±x and ±y. The result turns an arm's base frame (y forward) there.
pub fn facing(recordings: &[Motion]) -> UnitQuaternion<f64> {
    let (mut x, mut y) = (0.0, 0.0);
    for recording in recordings {
        for frame in recording.points() {
            if let (Some(base), Some(hand)) = (frame.first(), frame.last()) {
                x += hand[0] - base[0];
                y += hand[1] - base[1];
            }
        }
    }
    let quarters = (f64::atan2(-x, y) / std::f64::consts::FRAC_PI_2).round();
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), quarters * std::f64::consts::FRAC_PI_2)
}

/// Where a task's chain comes from.
#[derive(Clone, Debug)]
pub enum Arm {
    /// The human arm, with segment lengths from each recording and its base turned.
    Human(UnitQuaternion<f64>),
    /// A given chain.
    Given(ChainDescription),
}

impl Task {
    /// The task of a recording's outbound part at `rate_hz`.
    ///
    /// # Errors
    /// A recording without a usable reach, or one that lacks a landmark of the chain.
    pub fn new(recording: &Motion, arm: &Arm, rate_hz: f64) -> Result<Task, TaskError> {
        let chain = match arm {
            Arm::Human(facing) => {
                let lengths = recording.segment_lengths();
                let length = |k: usize| lengths.get(k).copied().unwrap_or(0.0);
                ChainDescription::human_arm(length(0), length(1), length(2), *facing)
            }
            Arm::Given(chain) => chain.clone(),
        };
        let reference = reference(recording, &chain, rate_hz)?;
        let target = reference
            .last()
            .and_then(|frame| frame.last())
            .copied()
            .unwrap_or([0.0; 3]);
        let start = reference.first().cloned().unwrap_or_default();
        let dofs = chain.joints.len();
        let (initial, misfit) = with_dofs!(dofs, N => {
            let (q, misfit) = fit::<N>(&chain.build::<N>()?, &start);
            (q.to_vec(), misfit)
        }, else return Err(TaskError::Dofs { found: dofs }));
        Ok(Task {
            name: recording.name().to_owned(),
            chain,
            initial,
            target,
            reference,
            misfit,
        })
    }

    /// The posture it begins in, for N DoFs and a scalar.
    ///
    /// # Errors
    /// It is of another size.
    pub fn posture<T: Real, const N: usize>(&self) -> Result<[T; N], TaskError> {
        let posture = <[f64; N]>::try_from(self.initial.as_slice());
        let posture = posture.map_err(|_| TaskError::Posture {
            motion: self.name.clone(),
            expected: N,
            found: self.initial.len(),
        })?;
        Ok(posture.map(T::of))
    }

    /// How many landmarks, from the first on, no joint moves and are recorded where they are: 1 where the first is a shoulder,
    /// which is at the origin by definition. What is known to be 0 apart need not be compared. `chain` is the task's, built.
    pub fn still<const N: usize>(&self, chain: &Chain<f64, N>) -> usize {
        let turns = |link: &Link<f64>| link.kind == Kind::Revolute;
        let stays = chain.landmarks().next() == Some(0) && chain.links().first().is_some_and(turns);
        // In single precision as well.
        let coarse: Chain<f32, N> = chain.cast();
        let at = chain.forward(&[0.0; N]).landmarks().next();
        let there = coarse.forward(&[0.0; N]).landmarks().next();
        let same = |frame: &Vec<Point>| {
            let recorded = frame.first().copied();
            recorded == at && recorded.map(|point| point.map(|x| x as f32)) == there
        };
        usize::from(stays && self.reference.iter().all(same))
    }

    /// The recorded motion as joint vectors: for each frame that within limits whose landmarks are nearest, found from
    /// that of the frame before.
    ///
    /// # Errors
    /// A chain or a posture of another size.
    pub fn postures<const N: usize>(&self) -> Result<Vec<[f64; N]>, TaskError> {
        let chain = self.chain.build::<N>()?;
        let mut q = self.posture::<f64, N>()?;
        let rest = self.reference.iter().skip(1);
        let mut out = vec![q];
        out.extend(rest.map(|frame| {
            q = descend(&chain, frame, &q, q).0;
            q
        }));
        Ok(out)
    }

    /// Its target, for a scalar.
    ///
    /// # Errors
    /// A coordinate that is no number.
    pub fn goal<T: Real>(&self) -> Result<Position<T>, TaskError> {
        Position::new(self.target.map(T::of)).map_err(|error| TaskError::Core {
            motion: self.name.clone(),
            error,
        })
    }
}

/// The outbound part of a recording at `rate_hz`, relative to the base landmark, as the chain's landmarks in order and
/// then the tip (SPEC section 5).
///
/// # Errors
/// A recording without a usable reach, or one that lacks a landmark of the chain.
pub fn reference(
    recording: &Motion,
    chain: &ChainDescription,
    rate_hz: f64,
) -> Result<Vec<Vec<Point>>, TaskError> {
    let reach = recording.outbound()?.relative_to_base().resample(rate_hz)?;
    let columns = columns(&reach, chain)?;
    let pick = |frame: &Vec<Point>| {
        columns
            .iter()
            .filter_map(|&c| frame.get(c).copied())
            .collect()
    };
    Ok(reach.points().iter().map(pick).collect())
}

/// The recording's landmark for each of the chain's, then its last for the tip.
fn columns(recording: &Motion, chain: &ChainDescription) -> Result<Vec<usize>, TaskError> {
    let mut columns = Vec::new();
    for landmark in &chain.landmarks {
        let column = recording
            .landmarks()
            .iter()
            .position(|name| *name == landmark.name);
        columns.push(column.ok_or_else(|| TaskError::Landmark {
            motion: recording.name().to_owned(),
            landmark: landmark.name.clone(),
            has: recording.landmarks().join(", "),
        })?);
    }
    columns.push(recording.landmarks().len().saturating_sub(1));
    Ok(columns)
}

/// How strongly the fit is drawn to the middle posture, metres a radian: enough to decide where the landmarks do not
/// (a forearm's pronation against the wrist), too little to move what they do decide.
const REGULARISATION: f64 = 1e-4;

/// The posture within limits whose landmarks are nearest to the given ones (least squares), and its distance.
///
/// Levenberg and Marquardt's method, projected on the limits, from several postures; the best of them.
fn fit<const N: usize>(chain: &Chain<f64, N>, landmarks: &[Point]) -> ([f64; N], f64) {
    let middle = std::array::from_fn(|i| 0.0f64.clamp(chain.lower()[i], chain.upper()[i]));
    let mut best = (middle, f64::INFINITY);
    for start in 0..16u32 {
        // The middle first, then postures spread over the limits by a low-discrepancy sequence (Kronecker's, by
        // square roots of primes).
        let primes = [2.0f64, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];
        let from = std::array::from_fn(|i| {
            let share = (f64::from(start) * primes[i % primes.len()].sqrt()).fract();
            let (lower, upper) = (chain.lower()[i].max(-3.2), chain.upper()[i].min(3.2));
            if start == 0 {
                middle[i]
            } else {
                (lower + share * (upper - lower)).clamp(chain.lower()[i], chain.upper()[i])
            }
        });
        let (q, cost) = descend(chain, landmarks, &middle, from);
        if cost < best.1 - 1e-12 {
            best = (q, cost);
        }
    }
    let misfit = chain.forward(&best.0).distance(landmarks.iter().copied());
    (best.0, misfit)
}

/// The squared distances of the landmarks, and of the posture from the middle one.
fn cost<const N: usize>(
    chain: &Chain<f64, N>,
    landmarks: &[Point],
    middle: &[f64; N],
    q: &[f64; N],
) -> f64 {
    let at = chain.forward(q);
    let gap = |(a, b): (Point, &Point)| (0..3).map(|r| (a[r] - b[r]).powi(2)).sum::<f64>();
    let apart: f64 = at.landmarks().zip(landmarks).map(gap).sum();
    apart
        + (0..N)
            .map(|i| (REGULARISATION * (q[i] - middle[i])).powi(2))
            .sum::<f64>()
}

fn descend<const N: usize>(
    chain: &Chain<f64, N>,
    landmarks: &[Point],
    middle: &[f64; N],
    from: [f64; N],
) -> ([f64; N], f64) {
    let mut q = from;
    let mut least = cost(chain, landmarks, middle, &q);
    let mut damping = 1e-3;
    for _iteration in 0..200 {
        // The normal equations, summed landmark by landmark; derivatives by central differences.
        let mut normal = SMatrix::<f64, N, N>::zeros();
        let mut gradient = SVector::<f64, N>::zeros();
        let here: Vec<Point> = chain.forward(&q).landmarks().collect();
        let moved = |i: usize, by: f64| {
            let mut q = q;
            q[i] += by;
            chain.forward(&q).landmarks().collect::<Vec<Point>>()
        };
        const H: f64 = 1e-6;
        let slopes: [(Vec<Point>, Vec<Point>); N] =
            std::array::from_fn(|i| (moved(i, H), moved(i, -H)));
        for (k, (point, wanted)) in here.iter().zip(landmarks).enumerate() {
            for r in 0..3 {
                let row = SVector::<f64, N>::from_fn(|i, _| {
                    (slopes[i].0[k][r] - slopes[i].1[k][r]) / (2.0 * H)
                });
                normal += row * row.transpose();
                gradient += row * (wanted[r] - point[r]);
            }
        }
        for i in 0..N {
            normal[(i, i)] += REGULARISATION * REGULARISATION;
            gradient[i] -= REGULARISATION * REGULARISATION * (q[i] - middle[i]);
            // A DoF that is pushed against its limit stays there.
            let pushed = (q[i] <= chain.lower()[i] && gradient[i] < 0.0)
                || (q[i] >= chain.upper()[i] && gradient[i] > 0.0);
            if pushed {
                for c in 0..N {
                    normal[(i, c)] = 0.0;
                    normal[(c, i)] = 0.0;
                }
                normal[(i, i)] = 1.0;
                gradient[i] = 0.0;
            }
        }
        let damped = normal + SMatrix::<f64, N, N>::from_diagonal(&(normal.diagonal() * damping));
        let Some(step) = damped.cholesky().map(|factors| factors.solve(&gradient)) else {
            damping *= 10.0;
            continue;
        };
        let next =
            std::array::from_fn(|i| (q[i] + step[i]).clamp(chain.lower()[i], chain.upper()[i]));
        let lower = cost(chain, landmarks, middle, &next);
        if lower < least {
            let gained = least - lower;
            (q, least) = (next, lower);
            damping = (damping * 0.3).max(1e-12);
            if gained < 1e-16 {
                break;
            }
        } else {
            damping *= 4.0;
            if damping > 1e9 {
                break;
            }
        }
    }
    (q, least)
}
