//! The hand's speed over time, and how bell-shaped it is (the paper's figure 5).
//!
//! People reach with a single-peaked, nearly symmetric speed. The bell to compare with is that of the smoothest motion
//! from rest to rest, the minimum-jerk motion (Flash and Hogan 1985, *The coordination of arm movements*): with τ from
//! 0 to 1 over the motion's duration, v ∝ 30 τ² (1 − τ)².

use serde::Serialize;

use crate::motion::{Point, SMOOTHING, minus, smoothed, speeds};
use crate::problem::mean;

/// A hill in the speed is a peak if it stands out by this part of the greatest speed.
pub const PROMINENCE: f64 = 0.1;

/// A hand that is never faster rests, m/s: what it has is noise, and no shape.
const AT_REST: f64 = 1e-3;

/// The hand's speed in each frame, m/s, from its positions (metres) at `rate_hz`.
///
/// Positions are smoothed without delay by a Gaussian of 30 ms (−3 dB at 4.4 Hz), the same for recorded and synthesised
/// hands; then differences are taken from the frame before to the frame after. Before its first frame and after its
/// last the path is continued by its own reflection in that point: a hand that starts or ends at full speed is not
/// made to look as if it rested there.
pub fn hand_speed(hand: &[Point], rate_hz: f64) -> Vec<f64> {
    let (Some(&first), Some(&last)) = (hand.first(), hand.last()) else {
        return Vec::new();
    };
    if hand.len() < 2 {
        return vec![0.0];
    }
    let beyond = ((3.0 * SMOOTHING * rate_hz).ceil() as usize + 1).min(hand.len() - 1);
    // The point reflected in an end: as far beyond it as the hand was before it.
    let reflected = |end: Point, point: &Point| minus(end, minus(*point, end));
    let before = hand[1..=beyond].iter().rev();
    let after = hand[hand.len() - 1 - beyond..hand.len() - 1].iter().rev();
    let path: Vec<Point> = before
        .map(|point| reflected(first, point))
        .chain(hand.iter().copied())
        .chain(after.map(|point| reflected(last, point)))
        .collect();
    let times: Vec<f64> = (0..path.len()).map(|k| k as f64 / rate_hz).collect();
    let speed = speeds(&times, &smoothed(&times, &path));
    speed[beyond..beyond + hand.len()].to_vec()
}

/// How bell-shaped a speed is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Shape {
    /// Hills that stand out by [`PROMINENCE`] of the greatest speed.
    pub peaks: usize,
    /// When the speed is greatest, as a share of the motion's duration.
    pub peak_at: f64,
    /// The greatest speed, m/s.
    #[serde(rename = "greatest_m_s")]
    pub greatest: f64,
    /// The correlation (Pearson's) with the speed of the minimum-jerk motion of the same duration.
    #[serde(rename = "minimum_jerk_correlation")]
    pub minimum_jerk: f64,
}

impl Shape {
    /// The shape of a speed, frame by frame.
    pub fn of(speed: &[f64]) -> Self {
        let steps = speed.len().saturating_sub(1).max(1) as f64;
        let bell: Vec<f64> = (0..speed.len()).map(|k| bell(k as f64 / steps)).collect();
        let top = (0..speed.len()).fold(0, |top, k| if speed[k] > speed[top] { k } else { top });
        let greatest = speed.get(top).copied().unwrap_or(0.0);
        if greatest < AT_REST {
            return Shape {
                peaks: 0,
                peak_at: 0.0,
                greatest,
                minimum_jerk: 0.0,
            };
        }
        Shape {
            peaks: peaks(speed),
            peak_at: top as f64 / steps,
            greatest,
            minimum_jerk: correlation(speed, &bell),
        }
    }
}

/// The speed of the minimum-jerk motion of length 1 and duration 1, at the share τ of its duration.
pub fn bell(tau: f64) -> f64 {
    30.0 * (tau * (1.0 - tau)).powi(2)
}

/// Pearson's correlation of two series, pair by pair; 0 where one of them is constant.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().min(b.len());
    let mean = |x: &[f64]| mean(x.iter().take(count).copied());
    let (mean_a, mean_b) = (mean(a), mean(b));
    let (mut product, mut square_a, mut square_b) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        let (x, y) = (x - mean_a, y - mean_b);
        product += x * y;
        square_a += x * x;
        square_b += y * y;
    }
    let size = (square_a * square_b).sqrt();
    if size > 0.0 { product / size } else { 0.0 }
}

/// How many hills stand out by [`PROMINENCE`] of the greatest speed. A hill's prominence is its height above the
/// higher of the two lowest points between it and, on either side, a higher hill or the end. Outside the motion the
/// hand rests: a speed that only falls has one peak, at its beginning.
fn peaks(speed: &[f64]) -> usize {
    let greatest = speed.iter().copied().fold(0.0, f64::max);
    let rest = std::iter::once(0.0);
    let speed: Vec<f64> = rest
        .clone()
        .chain(speed.iter().copied())
        .chain(rest)
        .collect();
    // The lowest point on the way from a hill to a higher one.
    let lowest = |top: f64, way: &mut dyn Iterator<Item = &f64>| {
        way.take_while(|v| **v <= top)
            .fold(top, |low, v| low.min(*v))
    };
    let stands_out = |k: &usize| {
        let k = *k;
        let top = speed[k];
        // Of a level top, its first frame stands for it.
        let is_top = speed[k - 1] < top
            && speed[k..]
                .iter()
                .find(|v| **v != top)
                .is_some_and(|v| *v < top);
        let left = lowest(top, &mut speed[..k].iter().rev());
        let right = lowest(top, &mut speed[k + 1..].iter());
        is_top && top - left.max(right) >= PROMINENCE * greatest
    };
    (1..speed.len() - 1).filter(stands_out).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A hand along x at 60 Hz for a second, where `x` says at each share of it.
    fn speed_of(x: impl Fn(f64) -> f64) -> Vec<f64> {
        let hand: Vec<Point> = (0..=60)
            .map(|k| [x(f64::from(k) / 60.0), 0.2, -0.1])
            .collect();
        hand_speed(&hand, 60.0)
    }

    fn minimum_jerk(t: f64) -> f64 {
        t * t * t * (10.0 - 15.0 * t + 6.0 * t * t)
    }

    #[test]
    fn a_minimum_jerk_motion_is_a_bell() {
        let speed = speed_of(|t| 0.4 * minimum_jerk(t));
        let shape = Shape::of(&speed);
        assert_eq!(shape.peaks, 1);
        assert!((shape.peak_at - 0.5).abs() < 1e-12);
        assert!(shape.minimum_jerk > 0.999, "{}", shape.minimum_jerk);
        // Smoothing takes a little off the top of 15/8 of the mean speed.
        assert!((shape.greatest / (0.4 * 1.875) - 1.0).abs() < 0.03);
    }

    #[test]
    fn the_bell_itself_correlates_perfectly_and_covers_the_whole_way() {
        let bells: Vec<f64> = (0..=1000).map(|k| bell(f64::from(k) / 1000.0)).collect();
        assert!((Shape::of(&bells).minimum_jerk - 1.0).abs() < 1e-12);
        assert!((bells.iter().sum::<f64>() / 1000.0 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_hand_that_starts_at_full_speed_peaks_at_once_and_is_no_bell() {
        let speed = speed_of(|t| 0.4 * (1.0 - (-8.0 * t).exp()));
        let shape = Shape::of(&speed);
        assert_eq!((shape.peaks, shape.peak_at), (1, 0.0));
        assert!(shape.minimum_jerk < 0.2, "{}", shape.minimum_jerk);
    }

    #[test]
    fn a_steady_hand_is_as_fast_at_both_ends() {
        for v in speed_of(|t| 0.4 * t) {
            assert!((v - 0.4).abs() < 1e-9);
        }
    }

    #[test]
    fn two_reaches_are_two_peaks_and_a_ripple_is_none() {
        let two = speed_of(|t| {
            0.2 * (minimum_jerk((2.0 * t).min(1.0)) + minimum_jerk((2.0 * t - 1.0).max(0.0)))
        });
        assert_eq!(Shape::of(&two).peaks, 2);
        let ripple: Vec<f64> = (0..=60)
            .map(|k| bell(f64::from(k) / 60.0) + 0.05 * f64::from(k % 2))
            .collect();
        assert_eq!(Shape::of(&ripple).peaks, 1);
    }

    #[test]
    fn a_level_top_is_one_peak_and_a_step_on_the_way_up_none() {
        assert_eq!(peaks(&[0.0, 1.0, 1.0, 1.0, 0.0]), 1);
        assert_eq!(peaks(&[0.0, 0.5, 0.5, 1.0, 0.0]), 1);
        assert_eq!(peaks(&[0.0, 1.0, 0.95, 0.99, 0.0]), 1);
        assert_eq!(peaks(&[0.0, 1.0, 0.85, 0.96, 0.0]), 2);
    }

    #[test]
    fn a_hand_at_rest_has_no_peak_and_no_shape() {
        let shape = Shape::of(&hand_speed(&[[0.1; 3]; 20], 60.0));
        assert_eq!((shape.peaks, shape.minimum_jerk), (0, 0.0));
        assert!(Shape::of(&[]).peak_at == 0.0 && hand_speed(&[], 60.0).is_empty());
    }

    proptest! {
        #[test]
        fn every_speed_has_a_shape(
            hand in prop::collection::vec(prop::array::uniform3(-1.0..1.0), 1..40), rate in 1.0..2000.0
        ) {
            let speed = hand_speed(&hand, rate);
            prop_assert_eq!(speed.len(), hand.len());
            let shape = Shape::of(&speed);
            prop_assert!(shape.peaks >= usize::from(shape.greatest >= AT_REST));
            prop_assert!((0.0..=1.0).contains(&shape.peak_at));
            prop_assert!(shape.minimum_jerk.abs() <= 1.0 + 1e-9);
        }
    }
}
