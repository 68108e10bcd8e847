//! Where the tip is to go, and how far it has left: ΔX = X_d − H(Θ) (SPEC section 2).

use crate::Error;
use crate::chain::{MOST_LENGTH, axes_of_quaternion, times, transposed};
use crate::kinematics::Kinematics;
use crate::real::Real;
use crate::vector::{Vec3, dot, sub};

/// A task of M rows: what is left from a posture to the target.
pub trait Target<T: Real, const M: usize> {
    /// ΔX in the base frame.
    fn error<const N: usize>(&self, at: &Kinematics<'_, T, N>) -> [T; M];
}

/// A position for the tip: 3 rows, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Position<T>(Vec3<T>);

impl<T: Real> Position<T> {
    /// A position in the base frame. A coordinate beyond ±[`MOST_LENGTH`] is moved there: no arm reaches either.
    ///
    /// # Errors
    /// A coordinate that is NaN or infinite.
    ///
    /// ```
    /// use sinew::target::Position;
    /// assert!(Position::new([0.3f32, 0.2, -0.1]).is_ok());
    /// assert!(Position::new([0.3f32, f32::NAN, -0.1]).is_err());
    /// ```
    #[inline(always)]
    pub fn new(at: Vec3<T>) -> Result<Self, Error> {
        for x in at {
            if !T::all(x.is_finite()) {
                return Err(Error::NotFinite {
                    what: "a target's coordinate",
                    joint: None,
                });
            }
        }
        Ok(Position(at.map(|x| {
            x.within(T::of(-MOST_LENGTH), T::of(MOST_LENGTH))
        })))
    }

    /// The coordinates, metres.
    pub fn coordinates(&self) -> Vec3<T> {
        self.0
    }
}

impl<T: Real> Target<T, 3> for Position<T> {
    #[inline(always)]
    fn error<const N: usize>(&self, at: &Kinematics<'_, T, N>) -> [T; 3] {
        sub(self.0, at.tip())
    }
}

/// A position and an orientation for the tip: 6 rows, metres and radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose<T> {
    position: Position<T>,
    /// The wanted axes.
    axes: [Vec3<T>; 3],
}

impl<T: Real> Pose<T> {
    /// A position and a unit quaternion x, y, z, w in the base frame.
    ///
    /// # Errors
    /// A number that is not finite, or a quaternion whose length is not within 1 % of 1.
    ///
    /// ```
    /// use sinew::target::Pose;
    /// assert!(Pose::new([0.3f64, 0.2, -0.1], [0.0, 0.0, 0.0, 1.0]).is_ok());
    /// assert!(Pose::new([0.3f64, 0.2, -0.1], [0.0, 0.0, 0.0, 0.0]).is_err());
    /// ```
    pub fn new(at: Vec3<T>, quaternion: [T; 4]) -> Result<Self, Error> {
        let position = Position::new(at)?;
        let norm = dot(&quaternion, &quaternion).sqrt();
        if !T::all((norm - T::one()).abs().lt(T::of(1e-2))) {
            return Err(Error::OutOfRange {
                what: "a target's orientation must be a quaternion of length 1",
                joint: None,
            });
        }
        Ok(Pose {
            position,
            axes: axes_of_quaternion(quaternion.map(|x| x / norm)),
        })
    }
}

impl<T: Real> Target<T, 6> for Pose<T> {
    #[inline(always)]
    fn error<const N: usize>(&self, at: &Kinematics<'_, T, N>) -> [T; 6] {
        let linear = sub(self.position.0, at.tip());
        // R_error · R = R_wanted, in the base frame.
        let angular = rotation_vector(&times(&self.axes, &transposed(&at.tip_axes())));
        [
            linear[0], linear[1], linear[2], angular[0], angular[1], angular[2],
        ]
    }
}

/// The rotation vector of a rotation matrix: its axis times its angle in [0, π].
///
/// Through the quaternion whose largest component is found first (Shepperd 1978), so that no angle, neither 0 nor π,
/// loses digits.
fn rotation_vector<T: Real>(m: &[Vec3<T>; 3]) -> Vec3<T> {
    let (one, half) = (T::one(), T::of(0.5));
    let [[m00, m10, m20], [m01, m11, m21], [m02, m12, m22]] = *m;
    // 4w², 4x², 4y², 4z².
    let squares = [
        one + m00 + m11 + m22,
        one + m00 - m11 - m22,
        one - m00 + m11 - m22,
        one - m00 - m11 + m22,
    ];
    let (wx, wy, wz) = (m21 - m12, m02 - m20, m10 - m01);
    let (xy, xz, yz) = (m10 + m01, m02 + m20, m21 + m12);
    // Each row is 4·(the row's own component)·(x, y, z, w).
    let rows = [
        [wx, wy, wz, squares[0]],
        [squares[1], xy, xz, wx],
        [xy, squares[2], yz, wy],
        [xz, yz, squares[3], wz],
    ];
    let mut q = rows[0];
    let mut largest = squares[0];
    for k in 1..4 {
        let larger = largest.lt(squares[k]);
        for r in 0..4 {
            q[r] = T::select(larger, rows[k][r], q[r]);
        }
        largest = largest.most(squares[k]);
    }
    let scale = half / largest.sqrt();
    let q = q.map(|x| x * scale);
    // The shorter way round: w ≥ 0.
    let away = q[3].lt(T::zero());
    let [x, y, z, w] = q.map(|x| T::select(away, -x, x));
    let sine = (x * x + y * y + z * z).sqrt();
    let angle = T::of(2.0) * sine.atan2(w);
    // Near 0 the angle is twice the sine.
    let small = sine.lt(T::of(1e-6));
    let k = T::select(small, T::of(2.0), angle / T::select(small, one, sine));
    [x * k, y * k, z * k]
}

#[cfg(all(test, feature = "libm"))]
mod tests {
    use super::*;

    #[test]
    fn a_target_that_is_no_number_is_refused_and_a_far_one_is_brought_near() {
        let error = Error::NotFinite {
            what: "a target's coordinate",
            joint: None,
        };
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(Position::new([0.0, x, 0.0]), Err(error));
            assert_eq!(Pose::new([0.0, x, 0.0], [0.0, 0.0, 0.0, 1.0]), Err(error));
        }
        let far = Position::new([1e30f32, -1e30, 1.0]).map(|target| target.coordinates());
        assert_eq!(far, Ok([1e4, -1e4, 1.0]));
    }

    #[test]
    fn an_orientation_is_a_quaternion_of_length_1() {
        let error = Error::OutOfRange {
            what: "a target's orientation must be a quaternion of length 1",
            joint: None,
        };
        for wrong in [0.0, 0.98, 1.02, 1e30, f32::NAN, f32::INFINITY] {
            assert_eq!(Pose::new([0.0; 3], [wrong, 0.0, 0.0, 0.0]), Err(error));
        }
        // A little rounding is mended.
        let mended = Pose::new([0.0; 3], [0.0, 0.0, 0.0, 1.001f32]);
        assert_eq!(mended, Pose::new([0.0; 3], [0.0, 0.0, 0.0, 1.0]));
    }
}
