//! The distance between two motions (SPEC section 4; the paper's section 3.4), streaming: nothing is stored.

use crate::real::Real;
use crate::vector::{Vec3, distance};

/// The distance between two postures of the same landmarks, metres: the mean of ‖Aⱼ − Bⱼ‖. Over the shorter of the
/// two where they differ in number; 0 where there are none.
///
/// ```
/// let d = sinew::metric::posture_distance(&[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], &[[0.0, 0.0, 0.0], [0.0, 2.0, 1.0]]);
/// assert_eq!(d, 1.0);
/// ```
#[inline(always)]
pub fn posture_distance<T: Real>(a: &[Vec3<T>], b: &[Vec3<T>]) -> T {
    let mut sum = T::zero();
    for (&a, &b) in a.iter().zip(b) {
        sum = sum + distance(a, b);
    }
    let count = a.len().min(b.len()).max(1);
    sum * T::of(1.0 / count as f64)
}

/// The distance between two motions, taken in frame by frame: the mean of the posture distance over the frames that
/// both have.
///
/// ```
/// use sinew::metric::MotionDistance;
/// let arm = sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09)?;
/// let recorded = [[0.0, 0.0, 0.0], [0.0, 0.0, -0.29], [0.0, 0.0, -0.54], [0.0, 0.04, -0.63]];
/// let mut distance = MotionDistance::new();
/// for _frame in 0..10 {
///     distance.add(arm.forward(&[0.0; 7]).distance(recorded));
/// }
/// assert!((distance.mean() - 0.01).abs() < 1e-12); // 4 cm at one of four landmarks
/// # Ok::<(), sinew::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionDistance<T> {
    sum: T,
    frames: u32,
}

impl<T: Real> MotionDistance<T> {
    /// No frame yet.
    #[inline(always)]
    pub fn new() -> Self {
        MotionDistance {
            sum: T::zero(),
            frames: 0,
        }
    }

    /// One more frame, with its posture distance in metres.
    #[inline(always)]
    pub fn add(&mut self, posture: T) {
        self.sum = self.sum + posture;
        self.frames = self.frames.saturating_add(1);
    }

    /// The mean over the frames so far, metres; 0 before the first.
    #[inline(always)]
    pub fn mean(&self) -> T {
        self.sum / T::count(self.frames.max(1))
    }
}

impl<T: Real> Default for MotionDistance<T> {
    fn default() -> Self {
        Self::new()
    }
}
