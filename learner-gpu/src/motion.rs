//! A recorded or made motion: where each landmark of an arm was, frame by frame.
//!
//! This is the one form that every reader of a recording ends in and that everything after starts from. It knows no file
//! format and no robot. Positions are metres in a right-handed frame that does not move, times are seconds. Landmarks come in
//! chain order: the first is the base (the shoulder), the last the hand (section 1 of the specification).
//!
//! A [`Motion`] that exists is valid: [`Motion::new`] refuses everything else, so the code that uses one never checks.
//!
//! From a recording to a learner's reference (section 5):
//!
//! ```
//! # use sinew_learn::motion::{Motion, MotionError};
//! # fn reference(recording: Motion) -> Result<Motion, MotionError> {
//! recording.outbound()?.relative_to_base().resample(60.0)
//! # }
//! ```

use std::fmt;

/// A point in space: x, y, z in metres.
pub type Point = [f64; 3];

/// Numbers larger than this, in size, are neither seconds nor metres. Below it, no difference or sum here overflows.
const LARGEST: f64 = 1e12;

/// [`Motion::resample`] makes at most this many frames: more than four hours at 60 Hz.
const MOST_FRAMES: f64 = 1_000_000.0;

/// What the person was doing in a frame, where a recording says so.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Phase {
    /// Rest before the reach; 0 in files.
    Rest,
    /// On the way out to the target; 1 in files.
    Out,
    /// At the target; 2 in files.
    AtTarget,
    /// On the way back; 3 in files.
    Back,
    /// Rest after the reach; 4 in files.
    RestAgain,
}

impl Phase {
    /// Every phase, in the order of their codes.
    const ALL: [Self; 5] = [
        Self::Rest,
        Self::Out,
        Self::AtTarget,
        Self::Back,
        Self::RestAgain,
    ];

    /// The phase that files write as `code`, if there is one.
    #[must_use]
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The number that files write for this phase, 0 to 4.
    #[must_use]
    pub fn code(self) -> u8 {
        self as u8
    }
}

impl fmt::Display for Phase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.code().fmt(f)
    }
}

/// Why something is no motion, or has no part that was asked for.
///
/// Frames are counted from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MotionError {
    /// There is nothing to move from or to.
    #[error("motion {name:?}: frames found: {frames}, expected at least 2")]
    TooFewFrames {
        /// The motion's name.
        name: String,
        /// How many frames it has.
        frames: usize,
    },
    /// A base and a hand are two landmarks.
    #[error(
        "motion {name:?}: landmarks found: {landmarks}, expected at least 2, a base and a hand"
    )]
    TooFewLandmarks {
        /// The motion's name.
        name: String,
        /// How many landmarks it has.
        landmarks: usize,
    },
    /// Times, points or phases are not one a frame.
    #[error("motion {name:?}: {what} found: {found}, expected one for each of its {frames} frames")]
    Uneven {
        /// The motion's name.
        name: String,
        /// What there are too many or too few of.
        what: &'static str,
        /// How many of them there are.
        found: usize,
        /// How many frames there are, counted by their times.
        frames: usize,
    },
    /// A frame has not one point for each landmark.
    #[error(
        "motion {name:?}, frame {frame}: points found: {found}, expected one for each of {expected} landmarks"
    )]
    PointCount {
        /// The motion's name.
        name: String,
        /// The frame.
        frame: usize,
        /// How many points it has.
        found: usize,
        /// How many landmarks there are.
        expected: usize,
    },
    /// A time or a coordinate is NaN, infinite or absurdly large.
    #[error(
        "motion {name:?}, frame {frame}, {what}: found {found}, expected a finite number under 1e12 in size"
    )]
    NotANumber {
        /// The motion's name.
        name: String,
        /// The frame.
        frame: usize,
        /// `time`, or the landmark.
        what: String,
        /// The number, s or m.
        found: f64,
    },
    /// Time stands still or runs backwards.
    #[error(
        "motion {name:?}, frame {frame}: time {found} s follows {before} s, expected a later one"
    )]
    TimeNotIncreasing {
        /// The motion's name.
        name: String,
        /// The later frame.
        frame: usize,
        /// Its time, s.
        found: f64,
        /// The time of the frame before it, s.
        before: f64,
    },
    /// Phases are marked, but none is the way out.
    #[error("motion {name:?} has its phases marked, and no frame of phase 1, the way out")]
    NoOutbound {
        /// The motion's name.
        name: String,
    },
    /// The way out, marked or found, is a single frame.
    #[error("the way out of motion {name:?} is a single frame, expected at least 2")]
    OutboundTooShort {
        /// The motion's name.
        name: String,
    },
    /// The hand rests all the time.
    #[error(
        "the hand of motion {name:?} is never faster than {fastest:.3} m/s: there is no reach in it (a reach exceeds {SLOWEST_REACH} m/s)"
    )]
    NoMovement {
        /// The motion's name.
        name: String,
        /// The hand's highest speed relative to the base, m/s.
        fastest: f64,
    },
    /// No frame rate.
    #[error("cannot resample to {rate_hz} Hz, expected a positive number")]
    Rate {
        /// What was asked for, Hz.
        rate_hz: f64,
    },
    /// The motion resampled is shorter than two frames or longer than memory.
    #[error(
        "motion {name:?} lasts {duration} s, which at {rate_hz} Hz is {frames} frames, expected 2 to 1000000"
    )]
    FramesAtRate {
        /// The motion's name.
        name: String,
        /// How long the motion lasts, s.
        duration: f64,
        /// What was asked for, Hz.
        rate_hz: f64,
        /// How many frames that makes.
        frames: f64,
    },
}

/// What a recording holds, not yet known to be a valid [`Motion`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recorded {
    /// What people call the motion, often its file's name.
    pub name: String,
    /// The landmarks' names in chain order, from the base to the hand.
    pub landmarks: Vec<String>,
    /// The time of each frame, s.
    pub times: Vec<f64>,
    /// For each frame, one point for each landmark, m.
    pub points: Vec<Vec<Point>>,
    /// The phase of each frame, where phases are marked.
    pub phases: Option<Vec<Phase>>,
}

/// Landmarks over time: at least two frames, strictly increasing times, finite numbers, one point a landmark in each frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion(Recorded);

impl Motion {
    /// The motion that was recorded.
    ///
    /// # Errors
    /// Says which frame breaks which rule.
    pub fn new(recorded: Recorded) -> Result<Self, MotionError> {
        check_counts(&recorded)?;
        check_times(&recorded)?;
        check_points(&recorded)?;
        Ok(Self(recorded))
    }

    /// What people call the motion.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.0.name
    }

    /// The landmarks' names in chain order, from the base to the hand.
    #[must_use]
    pub fn landmarks(&self) -> &[String] {
        &self.0.landmarks
    }

    /// The time of each frame, s, strictly increasing.
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.0.times
    }

    /// For each frame, one point for each landmark, m.
    #[must_use]
    pub fn points(&self) -> &[Vec<Point>] {
        &self.0.points
    }

    /// The phase of each frame, where phases are marked.
    #[must_use]
    pub fn phases(&self) -> Option<&[Phase]> {
        self.0.phases.as_deref()
    }

    /// From the first frame to the last, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.end() - self.start()
    }

    /// The way out to the target (section 5): the part of a recording that is a reach. Times are kept as recorded.
    ///
    /// Where phases are marked it is the first unbroken run of [`Phase::Out`]. Where they are not, it is the first main reach
    /// in the speed of the hand relative to the base, which is freed of single wrong frames (a median of five) and smoothed
    /// without delay (a Gaussian of 30 ms). That reach peaks where the speed first passes a fifth of its maximum and
    /// climbs on, and it lasts, on both sides, until the speed
    /// - is down to 5 % of the peak: the hand is at rest, or
    /// - rises again by a tenth of the peak after a valley: the hand is in another movement.
    ///
    /// It ends earlier, at the farthest point from its start, if the hand comes back by a twentieth of that distance. So a
    /// recording that goes out, holds and comes back gives the way out alone; one that reaches for a glass and then lifts it
    /// gives the reach for the glass. The thresholds other than the 5 % are our choice, tuned on recordings of people.
    ///
    /// # Errors
    /// [`MotionError::NoOutbound`] or [`MotionError::NoMovement`] where there is none, [`MotionError::OutboundTooShort`] where
    /// it is a single frame.
    pub fn outbound(&self) -> Result<Self, MotionError> {
        let (first, last) = match self.phases() {
            Some(phases) => marked_outbound(phases).ok_or_else(|| MotionError::NoOutbound {
                name: self.0.name.clone(),
            })?,
            None => self.first_reach()?,
        };
        if first == last {
            return Err(MotionError::OutboundTooShort {
                name: self.0.name.clone(),
            });
        }
        Ok(self.cut(first, last))
    }

    /// The same motion with each position taken relative to the base landmark's in the same frame, for a chain whose base
    /// does not move (section 5). The base is then at the origin throughout.
    #[must_use]
    pub fn relative_to_base(&self) -> Self {
        let mut relative = self.0.clone();
        for points in &mut relative.points {
            let base = points.first().copied().unwrap_or_default();
            for point in points {
                *point = minus(*point, base);
            }
        }
        Self(relative)
    }

    /// The motion at another frame rate, Hz: linear between recorded frames (section 5).
    ///
    /// Frame k shows the motion k/rate after its start and has the time k/rate, for k from 0 to
    /// ⌊duration·rate + 1e-9⌋. Its phase is that of the recorded frame nearest in time.
    ///
    /// # Errors
    /// [`MotionError::Rate`] unless the rate is positive and finite, [`MotionError::FramesAtRate`] where that makes fewer than
    /// two frames or more than a million.
    pub fn resample(&self, rate_hz: f64) -> Result<Self, MotionError> {
        if !(rate_hz.is_finite() && rate_hz > 0.0) {
            return Err(MotionError::Rate { rate_hz });
        }
        let last = (self.duration() * rate_hz + 1e-9).floor();
        if !(1.0..MOST_FRAMES).contains(&last) {
            return Err(MotionError::FramesAtRate {
                name: self.0.name.clone(),
                duration: self.duration(),
                rate_hz,
                frames: last + 1.0,
            });
        }
        // `last` is a whole number under a million.
        let times: Vec<f64> = (0..=last as usize).map(|k| k as f64 / rate_hz).collect();
        let spots: Vec<Spot> = times
            .iter()
            .map(|time| self.spot(self.start() + time))
            .collect();
        Ok(Self(Recorded {
            name: self.0.name.clone(),
            landmarks: self.0.landmarks.clone(),
            times,
            points: spots.iter().map(|spot| spot.points(&self.0)).collect(),
            phases: self
                .phases()
                .map(|phases| spots.iter().map(|spot| phases[spot.nearest()]).collect()),
        }))
    }

    /// The length of each segment, m: for each pair of neighbouring landmarks, in chain order, the median of their distance
    /// over the frames (section 1).
    #[must_use]
    pub fn segment_lengths(&self) -> Vec<f64> {
        (1..self.0.landmarks.len())
            .map(|j| {
                median(
                    self.0
                        .points
                        .iter()
                        .map(|points| distance(points[j - 1], points[j]))
                        .collect(),
                )
            })
            .collect()
    }

    fn start(&self) -> f64 {
        self.0.times[0]
    }

    fn end(&self) -> f64 {
        self.0.times[self.0.times.len() - 1]
    }

    /// The frames from `first` to `last`, both among them.
    fn cut(&self, first: usize, last: usize) -> Self {
        Self(Recorded {
            name: self.0.name.clone(),
            landmarks: self.0.landmarks.clone(),
            times: self.0.times[first..=last].to_vec(),
            points: self.0.points[first..=last].to_vec(),
            phases: self.phases().map(|phases| phases[first..=last].to_vec()),
        })
    }

    /// Where between two recorded frames a time lies; the nearest end where it lies outside.
    fn spot(&self, time: f64) -> Spot {
        let times = &self.0.times;
        let after = times
            .partition_point(|t| *t <= time)
            .clamp(1, times.len() - 1);
        let (before, span) = (times[after - 1], times[after] - times[after - 1]);
        Spot {
            after,
            weight: ((time - before) / span).clamp(0.0, 1.0),
        }
    }

    /// The first and last frame of the first main reach.
    fn first_reach(&self) -> Result<(usize, usize), MotionError> {
        let times = &self.0.times;
        let hand = smoothed(times, &despiked(&self.hand_from_base()));
        let speed = speeds(times, &hand);
        let fastest = speed.iter().copied().fold(0.0, f64::max);
        if fastest <= SLOWEST_REACH {
            return Err(MotionError::NoMovement {
                name: self.0.name.clone(),
                fastest,
            });
        }
        let peak = first_major_peak(&speed, fastest);
        let first = edge(&speed, peak, (0..peak).rev());
        let last = edge(&speed, peak, peak + 1..speed.len());
        Ok((first, turn(&hand, first, peak, last)))
    }

    /// The hand relative to the base in each frame, m.
    fn hand_from_base(&self) -> Vec<Point> {
        self.0
            .points
            .iter()
            .map(|points| minus(points[points.len() - 1], points[0]))
            .collect()
    }
}

/// A time between two frames.
struct Spot {
    /// The later of the two frames; never frame 0.
    after: usize,
    /// How far the time is from the earlier frame (0) to the later (1).
    weight: f64,
}

impl Spot {
    fn nearest(&self) -> usize {
        if self.weight > 0.5 {
            self.after
        } else {
            self.after - 1
        }
    }

    fn points(&self, recorded: &Recorded) -> Vec<Point> {
        let (a, b) = (
            &recorded.points[self.after - 1],
            &recorded.points[self.after],
        );
        a.iter()
            .zip(b)
            .map(|(a, b)| std::array::from_fn(|k| a[k] + (b[k] - a[k]) * self.weight))
            .collect()
    }
}

fn check_counts(recorded: &Recorded) -> Result<(), MotionError> {
    let name = || recorded.name.clone();
    let frames = recorded.times.len();
    if frames < 2 {
        return Err(MotionError::TooFewFrames {
            name: name(),
            frames,
        });
    }
    if recorded.landmarks.len() < 2 {
        return Err(MotionError::TooFewLandmarks {
            name: name(),
            landmarks: recorded.landmarks.len(),
        });
    }
    let phases = recorded.phases.as_ref().map_or(frames, Vec::len);
    for (what, found) in [
        ("frames of points", recorded.points.len()),
        ("phases", phases),
    ] {
        if found != frames {
            return Err(MotionError::Uneven {
                name: name(),
                what,
                found,
                frames,
            });
        }
    }
    Ok(())
}

fn check_times(recorded: &Recorded) -> Result<(), MotionError> {
    let mut before = f64::NEG_INFINITY;
    for (frame, &found) in recorded.times.iter().enumerate() {
        if !sound(found) {
            return Err(MotionError::NotANumber {
                name: recorded.name.clone(),
                frame,
                what: "time".to_owned(),
                found,
            });
        }
        if found <= before {
            return Err(MotionError::TimeNotIncreasing {
                name: recorded.name.clone(),
                frame,
                found,
                before,
            });
        }
        before = found;
    }
    Ok(())
}

fn check_points(recorded: &Recorded) -> Result<(), MotionError> {
    for (frame, points) in recorded.points.iter().enumerate() {
        if points.len() != recorded.landmarks.len() {
            return Err(MotionError::PointCount {
                name: recorded.name.clone(),
                frame,
                found: points.len(),
                expected: recorded.landmarks.len(),
            });
        }
        for (landmark, point) in recorded.landmarks.iter().zip(points) {
            if let Some(&found) = point.iter().find(|x| !sound(**x)) {
                return Err(MotionError::NotANumber {
                    name: recorded.name.clone(),
                    frame,
                    what: landmark.clone(),
                    found,
                });
            }
        }
    }
    Ok(())
}

fn sound(number: f64) -> bool {
    number.abs() < LARGEST
}

/// The first and last frame of the first unbroken run of [`Phase::Out`].
fn marked_outbound(phases: &[Phase]) -> Option<(usize, usize)> {
    let first = phases.iter().position(|phase| *phase == Phase::Out)?;
    let run = phases[first..]
        .iter()
        .take_while(|phase| **phase == Phase::Out)
        .count();
    Some((first, first + run - 1))
}

/// A hand that is never faster rests, m/s. Our choice, well above the noise of a motion capture system, smoothed.
const SLOWEST_REACH: f64 = 0.03;
/// Frames on each side that the median looks at: two in a row may be wrong.
const DESPIKE: usize = 2;
/// The standard deviation of the Gaussian that smooths positions, s.
pub(crate) const SMOOTHING: f64 = 0.03;
/// The first peak that reaches this part of the highest speed is a reach; lower ones before it are fidgeting.
const MAJOR: f64 = 0.2;
/// A hand slower than this part of the peak rests.
const AT_REST: f64 = 0.05;
/// A valley lies below this part of the peak…
const VALLEY: f64 = 0.5;
/// …and the speed rises out of it by this part of the peak.
const RISE: f64 = 0.1;
/// A hand that has come back by this part of its farthest distance has turned.
const TURN: f64 = 0.05;

/// Each coordinate replaced by the median of the five frames around it, near the ends of the first or last five.
fn despiked(path: &[Point]) -> Vec<Point> {
    let width = (2 * DESPIKE + 1).min(path.len());
    (0..path.len())
        .map(|i| {
            let from = i.saturating_sub(DESPIKE).min(path.len() - width);
            std::array::from_fn(|k| median(path[from..from + width].iter().map(|p| p[k]).collect()))
        })
        .collect()
}

/// Each point replaced by the mean of its neighbours in time under a Gaussian, which looks as far ahead as back and so delays
/// nothing.
pub(crate) fn smoothed(times: &[f64], path: &[Point]) -> Vec<Point> {
    let reach = 3.0 * SMOOTHING;
    times
        .iter()
        .map(|&time| {
            let from = times.partition_point(|t| *t < time - reach);
            let (mut sum, mut weights) = ([0.0; 3], 0.0);
            for (&t, point) in times.iter().zip(path).skip(from) {
                if t > time + reach {
                    break;
                }
                let weight = (-0.5 * ((t - time) / SMOOTHING).powi(2)).exp();
                weights += weight;
                for (sum, x) in sum.iter_mut().zip(point) {
                    *sum += weight * x;
                }
            }
            sum.map(|x| x / weights)
        })
        .collect()
}

/// The speed in each frame, m/s: from the frame before to the frame after, where there are both.
pub(crate) fn speeds(times: &[f64], path: &[Point]) -> Vec<f64> {
    let last = path.len() - 1;
    (0..=last)
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            distance(path[a], path[b]) / (times[b] - times[a])
        })
        .collect()
}

/// The top of the first hill in the speed that is high enough to be a reach.
fn first_major_peak(speed: &[f64], fastest: f64) -> usize {
    let foot = speed
        .iter()
        .position(|v| *v >= MAJOR * fastest)
        .unwrap_or_default();
    let mut peak = foot;
    for i in foot..speed.len() {
        if speed[i] > speed[peak] {
            peak = i;
        } else if speed[i] < VALLEY * speed[peak] {
            break;
        }
    }
    peak
}

/// Walking away from the peak over `frames`: the frame in which the hand is at rest, or the valley before another movement,
/// or the recording's end.
fn edge(speed: &[f64], peak: usize, frames: impl Iterator<Item = usize>) -> usize {
    let top = speed[peak];
    let (mut lowest, mut here) = (peak, peak);
    for i in frames {
        here = i;
        if speed[i] < speed[lowest] {
            lowest = i;
        }
        if speed[i] <= AT_REST * top {
            return i;
        }
        if speed[lowest] < VALLEY * top && speed[i] - speed[lowest] > RISE * top {
            return lowest;
        }
    }
    here
}

/// The frame, up to `last`, that is farthest from the start before the hand turns back; `last` if it does not.
fn turn(hand: &[Point], first: usize, peak: usize, last: usize) -> usize {
    let away = |i: usize| distance(hand[first], hand[i]);
    let mut farthest = first;
    for i in first..=last {
        if away(i) > away(farthest) {
            farthest = i;
        } else if i > peak && away(i) < (1.0 - TURN) * away(farthest) {
            return farthest;
        }
    }
    last
}

/// The middle one of the values, of an even number the mean of the middle two; 0 of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => 0.0,
        n if n % 2 == 1 => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}

/// a − b.
pub(crate) fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|k| a[k] - b[k])
}

/// ‖a − b‖, m.
pub(crate) fn distance(a: Point, b: Point) -> f64 {
    minus(a, b).iter().map(|x| x * x).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::path::{Path, PathBuf};

    /// A hand that moves along x at 100 Hz as `x` says, and a base at the origin.
    fn along_x(x: &[f64]) -> Recorded {
        Recorded {
            name: "made".into(),
            landmarks: vec!["base".into(), "hand".into()],
            times: (0..x.len()).map(|k| k as f64 / 100.0).collect(),
            points: x.iter().map(|x| vec![[0.0; 3], [*x, 0.0, 0.0]]).collect(),
            phases: None,
        }
    }

    fn minimum_jerk(tau: f64) -> f64 {
        let t = tau.clamp(0.0, 1.0);
        t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
    }

    /// Half a second of rest, a second out, half a second at the target, a second back, and rest.
    fn out_and_back() -> Vec<f64> {
        (0..350)
            .map(|k| f64::from(k) / 100.0)
            .map(|t| 0.3 * (minimum_jerk(t - 0.5) - minimum_jerk(t - 2.0)))
            .collect()
    }

    fn made(x: &[f64]) -> Motion {
        Motion::new(along_x(x)).unwrap()
    }

    #[test]
    fn a_motion_needs_two_frames() {
        let error = Motion::new(along_x(&[0.0])).unwrap_err();
        assert_eq!(
            error.to_string(),
            "motion \"made\": frames found: 1, expected at least 2"
        );
    }

    #[test]
    fn a_motion_needs_a_base_and_a_hand() {
        let mut recorded = along_x(&[0.0, 1.0]);
        recorded.landmarks.truncate(1);
        assert!(matches!(
            Motion::new(recorded),
            Err(MotionError::TooFewLandmarks { landmarks: 1, .. })
        ));
    }

    #[test]
    fn every_frame_has_its_points_and_its_phase() {
        let mut recorded = along_x(&[0.0, 1.0]);
        recorded.points[1].pop();
        assert!(matches!(
            Motion::new(recorded),
            Err(MotionError::PointCount {
                frame: 1,
                found: 1,
                expected: 2,
                ..
            })
        ));
        let mut recorded = along_x(&[0.0, 1.0]);
        recorded.phases = Some(vec![Phase::Rest]);
        assert_eq!(
            Motion::new(recorded).unwrap_err().to_string(),
            "motion \"made\": phases found: 1, expected one for each of its 2 frames"
        );
    }

    #[test]
    fn time_runs_forward() {
        let mut recorded = along_x(&[0.0, 1.0, 2.0]);
        recorded.times[2] = recorded.times[1];
        assert_eq!(
            Motion::new(recorded).unwrap_err().to_string(),
            "motion \"made\", frame 2: time 0.01 s follows 0.01 s, expected a later one"
        );
    }

    #[test]
    fn a_coordinate_is_a_finite_number() {
        for x in [f64::NAN, f64::INFINITY, -1e300] {
            assert!(matches!(
                Motion::new(along_x(&[0.0, x])),
                Err(MotionError::NotANumber { frame: 1, what, .. }) if what == "hand"
            ));
        }
    }

    #[test]
    fn a_phase_is_the_number_that_files_write() {
        for code in 0..5 {
            assert_eq!(Phase::from_code(code).map(Phase::code), Some(code));
        }
        assert_eq!(Phase::from_code(5), None);
    }

    #[test]
    fn the_marked_way_out_is_the_first_run_of_phase_1() {
        use Phase::{AtTarget, Out, Rest};
        let mut recorded = along_x(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        recorded.phases = Some(vec![Rest, Out, Out, AtTarget, Out, Out]);
        let out = Motion::new(recorded).unwrap().outbound().unwrap();
        assert_eq!(out.times(), [0.01, 0.02]);
        assert_eq!(out.phases(), Some(&[Out, Out][..]));
    }

    #[test]
    fn marks_without_a_way_out_are_an_error() {
        let mut recorded = along_x(&[0.0, 1.0]);
        recorded.phases = Some(vec![Phase::Rest; 2]);
        assert_eq!(
            Motion::new(recorded)
                .unwrap()
                .outbound()
                .unwrap_err()
                .to_string(),
            "motion \"made\" has its phases marked, and no frame of phase 1, the way out"
        );
        let mut recorded = along_x(&[0.0, 1.0]);
        recorded.phases = Some(vec![Phase::Rest, Phase::Out]);
        assert!(matches!(
            Motion::new(recorded).unwrap().outbound(),
            Err(MotionError::OutboundTooShort { .. })
        ));
    }

    #[test]
    fn of_a_reach_out_and_back_only_the_way_out_is_taken() {
        let out = made(&out_and_back()).outbound().unwrap();
        assert!((out.start() - 0.5).abs() < 0.1, "starts at {}", out.start());
        assert!((out.end() - 1.5).abs() < 0.1, "ends at {}", out.end());
    }

    #[test]
    fn a_hand_that_turns_without_a_rest_is_taken_to_the_turn() {
        // Half an ellipse out and half back: the speed never falls at the far end.
        let recorded = Recorded {
            points: (0..200)
                .map(|k| std::f64::consts::TAU * minimum_jerk(f64::from(k) / 199.0))
                .map(|angle| vec![[0.0; 3], [0.2 - 0.2 * angle.cos(), 0.15 * angle.sin(), 0.0]])
                .collect(),
            ..along_x(&[0.0; 200])
        };
        let out = Motion::new(recorded).unwrap().outbound().unwrap();
        assert!((out.end() - 1.0).abs() < 0.05, "ends at {}", out.end());
    }

    #[test]
    fn a_wrong_frame_is_no_reach() {
        let mut x = out_and_back();
        x[20] += 2.0;
        x[21] += 2.0;
        let out = made(&x).outbound().unwrap();
        assert!((out.start() - 0.5).abs() < 0.1, "starts at {}", out.start());
        assert!((out.end() - 1.5).abs() < 0.1, "ends at {}", out.end());
    }

    #[test]
    fn a_hand_at_rest_has_no_way_out() {
        assert!(matches!(
            made(&[0.1; 50]).outbound(),
            Err(MotionError::NoMovement { .. })
        ));
    }

    #[test]
    fn the_way_out_does_not_see_the_trunk() {
        let still = made(&out_and_back());
        let mut leaning = along_x(&out_and_back());
        for (k, points) in leaning.points.iter_mut().enumerate() {
            for point in points {
                point[1] += 0.002 * k as f64;
            }
        }
        let leaning = Motion::new(leaning).unwrap();
        assert_eq!(
            leaning.outbound().unwrap().times(),
            still.outbound().unwrap().times()
        );
    }

    #[test]
    fn relative_to_its_base_the_base_is_at_the_origin() {
        let mut recorded = along_x(&[1.0, 2.0]);
        recorded.points[1] = vec![[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]];
        let relative = Motion::new(recorded).unwrap().relative_to_base();
        assert_eq!(relative.points()[1], [[0.0; 3], [1.0, 2.0, 3.0]]);
    }

    #[test]
    fn resampled_times_start_at_zero_and_points_lie_between_frames() {
        let mut recorded = along_x(&[0.0, 1.0, 3.0]);
        recorded.times = vec![5.0, 5.1, 5.2];
        recorded.phases = Some(vec![Phase::Rest, Phase::Out, Phase::Out]);
        let resampled = Motion::new(recorded).unwrap().resample(20.0).unwrap();
        assert_eq!(resampled.times(), [0.0, 0.05, 0.1, 0.15, 0.2]);
        for (points, x) in resampled.points().iter().zip([0.0, 0.5, 1.0, 2.0, 3.0]) {
            assert!((points[1][0] - x).abs() < 1e-12);
        }
        assert_eq!(resampled.phases().unwrap()[4], Phase::Out);
    }

    #[test]
    fn a_rate_is_positive_and_gives_two_frames_at_least() {
        let motion = made(&[0.0, 1.0]);
        for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(matches!(
                motion.resample(rate),
                Err(MotionError::Rate { .. })
            ));
        }
        for rate in [1.0, 1e300] {
            assert!(matches!(
                motion.resample(rate),
                Err(MotionError::FramesAtRate { .. })
            ));
        }
    }

    #[test]
    fn a_segment_is_as_long_as_the_median_distance() {
        assert_eq!(made(&[1.0, 2.0, 9.0]).segment_lengths(), [2.0]);
        assert_eq!(made(&[1.0, 2.0, 4.0, 9.0]).segment_lengths(), [3.0]);
    }

    proptest! {
        #[test]
        fn resampling_at_the_recorded_rate_changes_nothing(x in prop::collection::vec(-1.0..1.0, 2..50)) {
            let motion = made(&x);
            let again = motion.resample(100.0).unwrap();
            prop_assert_eq!(again.times(), motion.times());
            for (a, b) in again.points().iter().zip(motion.points()) {
                prop_assert!(distance(a[1], b[1]) < 1e-9);
            }
        }

        #[test]
        fn every_valid_motion_has_a_way_out_or_says_why_not(
            frames in prop::collection::vec((1e-300..10.0, prop::array::uniform3(-1e11..1e11)), 2..40)
        ) {
            let mut recorded = along_x(&vec![0.0; frames.len()]);
            let mut time = 0.0;
            for (k, (step, point)) in frames.into_iter().enumerate() {
                time += step;
                recorded.times[k] = time;
                recorded.points[k][1] = point;
            }
            if let Ok(motion) = Motion::new(recorded) {
                if let Ok(out) = motion.outbound() {
                    prop_assert!(Motion::new(out.0).is_ok());
                }
                if let Ok(resampled) = motion.resample(30.0) {
                    prop_assert!(Motion::new(resampled.0).is_ok());
                }
                prop_assert!(Motion::new(motion.relative_to_base().0).is_ok());
            }
        }
    }

    /// Real recordings, where the folder of shared data is at hand.
    fn recordings(folder: &str) -> Vec<Motion> {
        fn files(folder: &Path, found: &mut Vec<PathBuf>) {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                let path = entry.path();
                if path.is_dir() {
                    files(&path, found);
                } else if path.extension().is_some_and(|e| e == "csv") {
                    found.push(path);
                }
            }
        }
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../../shared/data")
            .join(folder);
        let mut found = Vec::new();
        files(&folder, &mut found);
        found.sort();
        if found.is_empty() {
            println!("skipped: no recordings in {}", folder.display());
        }
        found
            .iter()
            .map(|path| crate::csv::read(path).unwrap())
            .collect()
    }

    /// How far the way out that is found lies from the marked one, s.
    struct Error {
        start: f64,
        end: f64,
        /// From the end that is found to the marked start of the way back; where no way back is marked, infinite.
        before_back: f64,
    }

    fn error(marked: &Motion) -> Error {
        let found = Motion(Recorded {
            phases: None,
            ..marked.0.clone()
        })
        .outbound()
        .unwrap();
        let back = marked
            .phases()
            .unwrap()
            .iter()
            .position(|p| *p == Phase::Back)
            .map_or(f64::INFINITY, |i| marked.times()[i]);
        let marked = marked.outbound().unwrap();
        Error {
            start: found.start() - marked.start(),
            end: found.end() - marked.end(),
            before_back: back - found.end(),
        }
    }

    /// Medians of the sizes of both errors, s; printed with the 90 % quantile and the worst.
    fn summary(what: &str, errors: &[Error]) -> (f64, f64) {
        let sizes = |pick: fn(&Error) -> f64| {
            let mut sizes: Vec<f64> = errors.iter().map(|e| pick(e).abs()).collect();
            sizes.sort_by(f64::total_cmp);
            sizes
        };
        let line = |sizes: &[f64]| {
            let at = |q: f64| sizes[((sizes.len() - 1) as f64 * q).round() as usize];
            format!(
                "median {:.3}, 90 % {:.3}, worst {:.3} s",
                at(0.5),
                at(0.9),
                at(1.0)
            )
        };
        let (start, end) = (sizes(|e| e.start), sizes(|e| e.end));
        println!(
            "{what}, {} recordings: start {}; end {}",
            errors.len(),
            line(&start),
            line(&end)
        );
        (median(start), median(end))
    }

    #[test]
    fn the_way_out_of_standing_reaches_is_found_where_it_is_marked() {
        let errors: Vec<Error> = recordings("mobmonrob").iter().map(error).collect();
        if errors.is_empty() {
            return;
        }
        let (start, end) = summary("standing reaches to grasp", &errors);
        assert!(start < 0.06 && end < 0.06);
        let far = |e: &&Error| e.start.abs() > 0.3 || e.end.abs() > 0.3;
        assert!(errors.iter().filter(far).count() * 10 <= errors.len());
    }

    #[test]
    fn the_way_out_of_seated_reaches_is_found_where_it_is_marked() {
        let recordings = recordings("ue_adl");
        if recordings.is_empty() {
            return;
        }
        let of = |kind: &str| -> Vec<Error> {
            let kind = format!("_{kind}");
            recordings
                .iter()
                .filter(|m| m.name().contains(&kind))
                .map(error)
                .collect()
        };
        for (what, kind) in [("seated reaches forward", "F"), ("and across", "A")] {
            let errors = of(kind);
            let (start, end) = summary(what, &errors);
            assert!(start < 0.06 && end < 0.06);
            assert!(
                errors
                    .iter()
                    .all(|e| e.start.abs() < 0.2 && e.end.abs() < 0.2)
            );
        }
        // Combing goes on at a third of the reach's speed: the end is not sharp, but it is before the way back.
        let combing = of("C");
        let (start, end) = summary("combing", &combing);
        assert!(start < 0.06 && end < 0.4);
        assert!(combing.iter().all(|e| e.before_back > 0.0));
        // The marked way out of drinking is two reaches, to the glass and with it to the mouth: the first is found.
        let drinking = of("D");
        let (start, _) = summary("drinking", &drinking);
        assert!(start < 0.15);
        assert!(
            drinking
                .iter()
                .all(|e| e.start.abs() < 0.3 && e.before_back > 0.0)
        );
    }
}
