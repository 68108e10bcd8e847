//! The sample that `sinew` ships: fourteen made reaches of a seated right arm, so that everything can be tried with no
//! recording at hand.
//!
//! They are made, not recorded. They show what is known of how people reach, in its simplest form, and no more: use your own
//! recordings for anything that matters.
//!
//! The frame is x to the person's right, y forward, z up, in metres. A reach starts with the hand at rest on a table near the
//! lap and takes it to one of fourteen targets, 100 frames a second, with a quarter second of rest before and after.
//!
//! - **Everything follows one progress in time**, that of least jerk between two rests (Flash and Hogan 1985, *The
//!   coordination of arm movements: an experimentally confirmed mathematical model*, J. Neurosci. 5:1688-1703). With τ the
//!   part of the duration that has passed,
//!
//!   ```text
//!   s(τ) = 10 τ³ − 15 τ⁴ + 6 τ⁵
//!   ```
//!
//!   Its rate is a bell that peaks in the middle at 1.875 times its mean.
//! - **The hand** goes along a straight line from rest to target, raised in the middle by a twentieth of its length (our
//!   choice; paths off a table are slightly curved): p = p₀ + s (p₁ − p₀) + 4 s (1 − s) · rise · ẑ.
//! - **The duration** grows with the distance, 0.45 s + 0.9 s/m (our choice; Fitts' law too has it grow with the distance).
//! - **The shoulder** travels forward by a twentieth of the hand's distance, 1 to 3 cm, as it does in recordings.
//! - **The hand points** at first as it rests, at last along the line from shoulder to target, and with progress s between.
//! - **The elbow** is found from shoulder and wrist by the swivel angle φ about the line between them (the angle of Tolani,
//!   Goswami and Badler 2000, *Real-time inverse kinematics techniques for anthropomorphic limbs*, Graphical Models
//!   62:353-388). Here φ is 0 where the elbow hangs straight below that line, and grows outwards. It goes with s from its rest
//!   value to one that is the larger the farther across the body and the higher the target is (our choice): such reaches
//!   lift the elbow.

use crate::csv::{self, CsvError};
use crate::motion::{Motion, MotionError, Phase, Point, Recorded, minus};

/// Frames a second.
const RATE: f64 = 100.0;
/// Frames of rest before the reach, and again after it.
const REST_FRAMES: usize = 25;
/// Upper arm, forearm and hand, m.
const SEGMENTS: [f64; 3] = [0.29, 0.25, 0.09];
/// The shoulder at rest, m.
const SHOULDER: Point = [0.18, -0.20, 0.32];
/// The hand at rest, from the shoulder, m.
const REST_HAND: Point = [-0.02, 0.22, -0.28];
/// Where the hand points at rest: forward and a little to the middle. Not of unit length.
const REST_POINTING: Point = [-0.35, 0.93, 0.05];
/// The swivel angle at rest, rad.
const REST_SWIVEL: f64 = 0.35;
/// The swivel angle at a target straight ahead of the shoulder, rad.
const AHEAD_SWIVEL: f64 = 0.70;
/// What the swivel angle gains with a target across the body and above the shoulder, rad/m.
const SWIVEL_ACROSS: f64 = 1.0;
const SWIVEL_ABOVE: f64 = 0.9;
/// How far the shoulder travels and how high the hand's path rises in its middle, as parts of the hand's distance.
const SHOULDER_TRAVEL: f64 = 0.05;
const PATH_RISE: f64 = 0.05;
/// A reach's duration, s, and what a metre adds to it, s/m.
const SHORTEST: f64 = 0.45;
const PER_METRE: f64 = 0.9;

/// The targets, from the shoulder at rest, m: on the table, then at the chest, the shoulder and the eyes.
const TARGETS: [Point; 14] = [
    [0.00, 0.54, -0.25],
    [-0.22, 0.48, -0.25],
    [0.18, 0.50, -0.24],
    [-0.36, 0.36, -0.24],
    [0.30, 0.38, -0.22],
    [-0.06, 0.57, -0.12],
    [-0.28, 0.46, -0.10],
    [0.20, 0.52, -0.08],
    [0.00, 0.60, 0.02],
    [-0.20, 0.42, 0.04],
    [0.26, 0.50, 0.06],
    [-0.10, 0.54, 0.18],
    [0.12, 0.46, 0.24],
    [-0.32, 0.42, 0.14],
];

/// The shipped files, each its name and its text. They are compiled in, so there is always something to learn from.
pub const FILES: [(&str, &str); 14] = [
    ("reach_01.csv", include_str!("../sample/reach_01.csv")),
    ("reach_02.csv", include_str!("../sample/reach_02.csv")),
    ("reach_03.csv", include_str!("../sample/reach_03.csv")),
    ("reach_04.csv", include_str!("../sample/reach_04.csv")),
    ("reach_05.csv", include_str!("../sample/reach_05.csv")),
    ("reach_06.csv", include_str!("../sample/reach_06.csv")),
    ("reach_07.csv", include_str!("../sample/reach_07.csv")),
    ("reach_08.csv", include_str!("../sample/reach_08.csv")),
    ("reach_09.csv", include_str!("../sample/reach_09.csv")),
    ("reach_10.csv", include_str!("../sample/reach_10.csv")),
    ("reach_11.csv", include_str!("../sample/reach_11.csv")),
    ("reach_12.csv", include_str!("../sample/reach_12.csv")),
    ("reach_13.csv", include_str!("../sample/reach_13.csv")),
    ("reach_14.csv", include_str!("../sample/reach_14.csv")),
];

/// The shipped sample, each motion named as its file without the ending.
///
/// # Errors
/// None, unless the shipped files were changed: they are read as any recording is.
pub fn shipped() -> Result<Vec<Motion>, CsvError> {
    FILES
        .iter()
        .map(|(name, text)| csv::parse(text.as_bytes(), name.strip_suffix(".csv").unwrap_or(name)))
        .collect()
}

/// The sample made anew, to the last digit. What is shipped is this, rounded to a tenth of a millimetre.
///
/// # Errors
/// None, unless the constants of this file were changed.
pub fn reaches() -> Result<Vec<Motion>, MotionError> {
    TARGETS
        .iter()
        .enumerate()
        .map(|(i, target)| Reach::to(*target).motion(format!("reach_{:02}", i + 1)))
        .collect()
}

/// One reach: what changes from its start to its end.
struct Reach {
    /// The hand's target, m.
    target: Point,
    /// The hand's distance to it at rest, m.
    distance: f64,
    /// Where the hand points at the target, a unit vector.
    pointing: Point,
    /// The swivel angle at the target, rad.
    swivel: f64,
    /// Frames from the first that moves off to the one that arrives.
    frames: usize,
}

impl Reach {
    fn to(from_shoulder: Point) -> Self {
        let [x, _, z] = from_shoulder;
        let target = plus(SHOULDER, from_shoulder);
        let distance = norm(minus(from_shoulder, REST_HAND));
        let shoulder = plus(SHOULDER, forward(SHOULDER_TRAVEL * distance));
        Self {
            target,
            distance,
            pointing: unit(minus(target, shoulder)),
            swivel: AHEAD_SWIVEL - SWIVEL_ACROSS * x + SWIVEL_ABOVE * z,
            frames: (RATE * (SHORTEST + PER_METRE * distance)).round() as usize,
        }
    }

    fn motion(&self, name: String) -> Result<Motion, MotionError> {
        let frames = 0..=(self.frames + 2 * REST_FRAMES);
        let phase = |frame| match frame {
            _ if frame < REST_FRAMES => Phase::Rest,
            _ if frame <= REST_FRAMES + self.frames => Phase::Out,
            _ => Phase::AtTarget,
        };
        let posture = |frame: usize| {
            let passed = frame.saturating_sub(REST_FRAMES) as f64 / self.frames as f64;
            self.posture(least_jerk(passed.min(1.0)))
        };
        Motion::new(Recorded {
            name,
            landmarks: ["shoulder", "elbow", "wrist", "hand"]
                .map(str::to_owned)
                .into(),
            times: frames.clone().map(|frame| frame as f64 / RATE).collect(),
            points: frames
                .clone()
                .map(|frame| posture(frame).to_vec())
                .collect(),
            phases: Some(frames.map(phase).collect()),
        })
    }

    /// Shoulder, elbow, wrist and hand where the progress is s, m.
    fn posture(&self, s: f64) -> [Point; 4] {
        let shoulder = plus(SHOULDER, forward(s * SHOULDER_TRAVEL * self.distance));
        let rise = 4.0 * s * (1.0 - s) * PATH_RISE * self.distance;
        let hand = plus(
            between(plus(SHOULDER, REST_HAND), self.target, s),
            [0.0, 0.0, rise],
        );
        let pointing = unit(between(unit(REST_POINTING), self.pointing, s));
        let wrist = minus(hand, times(SEGMENTS[2], pointing));
        let swivel = REST_SWIVEL + s * (self.swivel - REST_SWIVEL);
        [shoulder, elbow(shoulder, wrist, swivel), wrist, hand]
    }
}

/// The elbow of a right arm, m: on the circle that the lengths of upper arm and forearm leave it, turned by the swivel angle
/// (rad) outwards from straight below.
fn elbow(shoulder: Point, wrist: Point, swivel: f64) -> Point {
    let [upper, fore, _] = SEGMENTS;
    let line = minus(wrist, shoulder);
    let length = norm(line);
    let axis = unit(line);
    let along = (upper * upper - fore * fore + length * length) / (2.0 * length);
    let radius = (upper * upper - along * along).max(0.0).sqrt();
    let down = [0.0, 0.0, -1.0];
    let below = unit(minus(down, times(dot(down, axis), axis)));
    let outwards = cross(below, axis);
    let around = plus(times(swivel.cos(), below), times(swivel.sin(), outwards));
    plus(shoulder, plus(times(along, axis), times(radius, around)))
}

/// The progress of least jerk from rest to rest, from 0 to 1 as τ is (Flash and Hogan 1985).
fn least_jerk(tau: f64) -> f64 {
    tau * tau * tau * (10.0 + tau * (-15.0 + tau * 6.0))
}

fn forward(metres: f64) -> Point {
    [0.0, metres, 0.0]
}

fn plus(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] + b[k])
}

fn times(factor: f64, a: Point) -> Point {
    a.map(|x| factor * x)
}

/// From a (s = 0) to b (s = 1).
fn between(a: Point, b: Point, s: f64) -> Point {
    plus(a, times(s, minus(b, a)))
}

fn dot(a: Point, b: Point) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn norm(a: Point) -> f64 {
    dot(a, a).sqrt()
}

fn unit(a: Point) -> Point {
    times(1.0 / norm(a), a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::distance;

    fn made() -> Vec<Motion> {
        reaches().unwrap()
    }

    /// The angle between two directions, degrees.
    fn angle(a: Point, b: Point) -> f64 {
        (dot(a, b) / (norm(a) * norm(b)))
            .clamp(-1.0, 1.0)
            .acos()
            .to_degrees()
    }

    /// For each frame, the bend of the joint at a landmark, degrees: 0 where the arm is straight there.
    fn bends(motion: &Motion, joint: usize) -> Vec<f64> {
        motion
            .points()
            .iter()
            .map(|p| angle(minus(p[joint], p[joint - 1]), minus(p[joint + 1], p[joint])))
            .collect()
    }

    fn lowest_and_highest(values: &[f64]) -> (f64, f64) {
        values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| {
                (lo.min(*v), hi.max(*v))
            })
    }

    #[test]
    fn what_is_shipped_is_what_the_generator_writes() {
        for (motion, (name, text)) in made().iter().zip(FILES) {
            let mut written = Vec::new();
            csv::write(motion, &mut written).unwrap();
            assert_eq!(format!("{}.csv", motion.name()), name);
            assert!(written == text.as_bytes(), "{name} is not what is made");
        }
    }

    #[test]
    fn what_is_shipped_is_read() {
        let names: Vec<String> = made().iter().map(|m| m.name().to_owned()).collect();
        let shipped = shipped().unwrap();
        assert!(shipped.iter().map(Motion::name).eq(names.iter()));
    }

    #[test]
    fn bones_keep_their_length() {
        for motion in shipped().unwrap() {
            for points in motion.points() {
                for (pair, length) in points.windows(2).zip(SEGMENTS) {
                    assert!((distance(pair[0], pair[1]) - length).abs() < 1e-3);
                }
            }
        }
    }

    #[test]
    fn joints_bend_as_far_as_human_ones() {
        for motion in made() {
            let (low, high) = lowest_and_highest(&bends(&motion, 1));
            let (_, wrist) = lowest_and_highest(&bends(&motion, 2));
            println!(
                "{}: elbow {low:.0} to {high:.0} deg, wrist to {wrist:.0} deg, {:.2} s out",
                motion.name(),
                motion.outbound().unwrap().duration()
            );
            assert!(
                (5.0..150.0).contains(&low) && high < 150.0,
                "{}",
                motion.name()
            );
            assert!(wrist < 60.0, "{}", motion.name());
        }
    }

    #[test]
    fn every_target_is_within_reach() {
        for (motion, target) in made().iter().zip(TARGETS) {
            let end = motion.points().last().unwrap();
            assert!(distance(end[3], plus(SHOULDER, target)) < 1e-12);
            assert!(distance(end[0], end[3]) < 0.95 * SEGMENTS.iter().sum::<f64>());
            assert!(distance(end[0], end[2]) < SEGMENTS[0] + SEGMENTS[1]);
        }
    }

    #[test]
    fn the_hand_s_speed_is_a_bell() {
        for motion in made() {
            let out = motion.outbound().unwrap();
            let speed: Vec<f64> = out
                .points()
                .windows(2)
                .map(|pair| RATE * distance(pair[0][3], pair[1][3]))
                .collect();
            let peaks: Vec<usize> = (1..speed.len() - 1)
                .filter(|&i| speed[i] > speed[i - 1] && speed[i] >= speed[i + 1])
                .collect();
            assert_eq!(peaks.len(), 1, "{}", motion.name());
            let middle = (peaks[0] as f64 + 0.5) / speed.len() as f64;
            assert!((middle - 0.5).abs() < 0.05, "{}: {middle}", motion.name());
        }
    }

    #[test]
    fn the_shoulder_travels_one_to_three_centimetres_forward() {
        for motion in made() {
            let (first, last) = (&motion.points()[0], motion.points().last().unwrap());
            let travel = minus(last[0], first[0]);
            assert!((0.01..0.03).contains(&travel[1]) && travel[0] == 0.0 && travel[2] == 0.0);
        }
    }

    #[test]
    fn the_arm_leaves_its_plane() {
        for motion in made() {
            let normals: Vec<Point> = motion
                .points()
                .iter()
                .map(|p| cross(minus(p[1], p[0]), minus(p[2], p[1])))
                .collect();
            let (_, turned) = lowest_and_highest(
                &normals
                    .iter()
                    .map(|n| angle(normals[0], *n))
                    .collect::<Vec<_>>(),
            );
            let (_, hand_off) = lowest_and_highest(
                &motion
                    .points()
                    .iter()
                    .zip(&normals)
                    .map(|(p, n)| (90.0 - angle(*n, minus(p[3], p[2]))).abs())
                    .collect::<Vec<_>>(),
            );
            println!(
                "{}: plane turns {turned:.0} deg, hand {hand_off:.0} deg off it",
                motion.name()
            );
            assert!(turned > 5.0, "{}: {turned}", motion.name());
            assert!(hand_off > 5.0, "{}: {hand_off}", motion.name());
        }
    }

    #[test]
    fn the_elbow_hangs_below_the_line_to_the_wrist_and_outside_it() {
        for motion in made() {
            for points in motion.points() {
                let [shoulder, elbow, wrist] = [points[0], points[1], points[2]];
                let line = minus(wrist, shoulder);
                let on_line = plus(
                    shoulder,
                    times(dot(minus(elbow, shoulder), line) / dot(line, line), line),
                );
                let off = minus(elbow, on_line);
                let outwards = cross([0.0, 0.0, -1.0], line);
                assert!(off[2] < 0.0, "{}", motion.name());
                assert!(dot(off, outwards) > 0.0, "{}", motion.name());
            }
        }
    }

    #[test]
    fn the_way_out_is_found_without_its_marks() {
        for motion in made() {
            let marked = motion.outbound().unwrap();
            let found = Motion::new(Recorded {
                name: motion.name().into(),
                landmarks: motion.landmarks().to_vec(),
                times: motion.times().to_vec(),
                points: motion.points().to_vec(),
                phases: None,
            })
            .unwrap()
            .outbound()
            .unwrap();
            assert!((found.times()[0] - marked.times()[0]).abs() < 0.1);
            assert!((found.duration() - marked.duration()).abs() < 0.2);
        }
    }
}
