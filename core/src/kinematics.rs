//! Forward kinematics and the Jacobian.
//!
//! One pass from base to tip carries a position and three axes. At each DoF: move by the fixed offset, turn by the
//! fixed rotation (most chains have none left, see [`crate::chain`]), note the DoF's axis and origin, then turn the
//! two other axes by q (or slide along the axis).
//!
//! Column i of the Jacobian at the tip: for a revolute DoF [aᵢ × (tip − oᵢ); aᵢ], for a prismatic one [aᵢ; 0], with
//! aᵢ the axis and oᵢ the origin in the base frame: linear rows, then angular rows (Siciliano et al. 2009, *Robotics*,
//! section 3.1.3).

use nalgebra::{Isometry3, RealField, SMatrix, Translation3, Unit};

use crate::chain::{Axes, Chain, Joint, Kind, Link, Shift, Turn, times, turned};
use crate::real::{Real, Turns};
use crate::vector::{Vec3, add, cross, distance, negate, scale, sub};

/// Where everything is at one posture: what [`Chain::forward`] computes once and everything else reads.
#[derive(Clone, Copy, Debug)]
pub struct Kinematics<'a, T, const N: usize> {
    chain: &'a Chain<T, N>,
    /// The axis of each DoF, a unit vector.
    pub(crate) axis: [Vec3<T>; N],
    /// The origin of each DoF's frame.
    pub(crate) origin: [Vec3<T>; N],
    /// The tip's position.
    pub(crate) tip: Vec3<T>,
    /// The folded axes of the last DoF's frame.
    last: Axes<T>,
}

impl<T: Real, const N: usize> Chain<T, N> {
    /// Forward kinematics at the joint vector `q` (radians or metres): axes, origins and tip in the base frame.
    /// Finite for every finite angle and every slide up to 1e30 m; limits are not looked at.
    ///
    /// ```
    /// let arm = sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09)?;
    /// let hanging = arm.forward(&[0.0; 7]);
    /// assert!((hanging.tip()[2] + 0.63).abs() < 1e-12);
    /// assert_eq!(hanging.landmarks().count(), 4); // shoulder, elbow, wrist, hand
    /// # Ok::<(), sinew::Error>(())
    /// ```
    #[inline(always)]
    pub fn forward(&self, q: &[T; N]) -> Kinematics<'_, T, N> {
        self.pass::<false>(q)
    }

    /// [`forward`](Self::forward), the same bits, for angles that are known to lie within
    /// ±[`MOST_ANGLE`](crate::math::MOST_ANGLE), as those of a controller's state do.
    #[inline(always)]
    pub fn forward_within(&self, q: &[T; N]) -> Kinematics<'_, T, N> {
        self.pass::<true>(q)
    }

    #[inline(always)]
    fn pass<const WITHIN: bool>(&self, q: &[T; N]) -> Kinematics<'_, T, N> {
        let (axes, at) = self.base;
        // Filled with what is at hand: a fill with zeros is a call to memset, slower than the stores. Arrays of
        // their own: inside of the struct a Cortex-M4F's were copied, 200 instructions a tick.
        let mut axis = [axes[2]; N];
        let mut origin = [at; N];
        let (tip, last) = self.walk::<WITHIN>(q, &mut axis, &mut origin);
        Kinematics {
            chain: self,
            axis,
            origin,
            tip,
            last,
        }
    }

    /// From base to tip: writes the axes and origins of the DoFs, and gives the tip and the last axes.
    #[inline(always)]
    fn walk<const WITHIN: bool>(
        &self,
        q: &[T; N],
        axis: &mut [Vec3<T>; N],
        origin: &mut [Vec3<T>; N],
    ) -> (Vec3<T>, Axes<T>) {
        let (mut axes, mut at) = self.base;
        let at_once = match T::TURNS {
            Turns::WhereUsed => [(T::zero(), T::zero()); N],
            Turns::AtOnce => all::<T, N, WITHIN>(q),
            Turns::InBlocks => in_blocks::<T, N, WITHIN>(q),
        };
        // No closure in here: one that is not inlined is compiled without the lanes' instructions, ten times slower.
        for i in 0..N {
            let link = &self.links[i];
            at = moved(at, &axes, &link.shift);
            axes = turned_by(axes, &link.turn);
            match link.kind {
                Kind::Revolute => {
                    let (s, c) = match T::TURNS {
                        Turns::WhereUsed => sine_and_cosine::<T, WITHIN>(q[i]),
                        Turns::AtOnce | Turns::InBlocks => at_once[i],
                    };
                    (axes, axis[i]) = turned_about(axes, link, s, c);
                }
                Kind::Prismatic => {
                    axis[i] = own_axis(&axes, link);
                    at = add(at, scale(axis[i], q[i]));
                }
            }
            origin[i] = at;
        }
        (moved(at, &axes, &self.tip.1), axes)
    }
}

/// The position after a fixed offset.
#[inline(always)]
fn moved<T: Real>(at: Vec3<T>, axes: &Axes<T>, shift: &Shift<T>) -> Vec3<T> {
    match *shift {
        Shift::None => at,
        Shift::Along(0, by) => add(at, scale(axes[0], by)),
        Shift::Along(1, by) => add(at, scale(axes[1], by)),
        Shift::Along(_, by) => add(at, scale(axes[2], by)),
        Shift::General(by) => add(at, turned(axes, by)),
    }
}

/// The axes after a fixed rotation.
#[inline(always)]
fn turned_by<T: Real>(axes: Axes<T>, turn: &Turn<T>) -> Axes<T> {
    match turn {
        Turn::None => axes,
        Turn::General(by) => times(&axes, by),
    }
}

/// Sine and cosine; `WITHIN`: the angle is known to lie within ±`MOST_ANGLE`.
#[inline(always)]
fn sine_and_cosine<T: Real, const WITHIN: bool>(q: T) -> (T, T) {
    if WITHIN {
        q.sin_cos_within()
    } else {
        Real::sin_cos(q)
    }
}

/// Sines and cosines of all angles.
#[inline(always)]
fn all<T: Real, const N: usize, const WITHIN: bool>(q: &[T; N]) -> [(T, T); N] {
    let mut turns = [(T::zero(), T::zero()); N];
    for i in 0..N {
        turns[i] = sine_and_cosine::<T, WITHIN>(q[i]);
    }
    turns
}

/// Angles in a block: a loop over so many is longer than compilers unroll, and they make lanes of it if none is left over.
const BLOCK: usize = 8;

/// The same, block by block.
#[inline(always)]
fn in_blocks<T: Real, const N: usize, const WITHIN: bool>(q: &[T; N]) -> [(T, T); N] {
    if 2 * N <= BLOCK {
        return all::<T, N, WITHIN>(q);
    }
    let mut turns = [(T::zero(), T::zero()); N];
    for (turns, q) in turns.chunks_mut(BLOCK).zip(q.chunks(BLOCK)) {
        let mut angles = [T::zero(); BLOCK];
        for (angle, &q) in angles.iter_mut().zip(q) {
            *angle = q;
        }
        let (mut sines, mut cosines) = ([T::zero(); BLOCK], [T::zero(); BLOCK]);
        for i in 0..BLOCK {
            (sines[i], cosines[i]) = sine_and_cosine::<T, WITHIN>(angles[i]);
        }
        for ((turn, &s), &c) in turns.iter_mut().zip(&sines).zip(&cosines) {
            *turn = (s, c);
        }
    }
    turns
}

/// The axis of a DoF.
#[inline(always)]
fn own_axis<T: Real>(axes: &Axes<T>, link: &Link<T>) -> Vec3<T> {
    let axis = match link.axis {
        0 => axes[0],
        1 => axes[1],
        _ => axes[2],
    };
    if link.flip { negate(axis) } else { axis }
}

/// The axes after a DoF turned by the angle of this sine and cosine, and its axis.
#[inline(always)]
fn turned_about<T: Real>(axes: Axes<T>, link: &Link<T>, s: T, c: T) -> (Axes<T>, Vec3<T>) {
    // Six arms rather than three and a choice of sign in each: 11 of 90 Cortex-M4F instructions a DoF.
    match (link.axis, link.flip) {
        (0, false) => (about::<T, 1, 2>(axes, s, c), axes[0]),
        (1, false) => (about::<T, 2, 0>(axes, s, c), axes[1]),
        (_, false) => (about::<T, 0, 1>(axes, s, c), axes[2]),
        (0, true) => (about::<T, 2, 1>(axes, s, c), negate(axes[0])),
        (1, true) => (about::<T, 0, 2>(axes, s, c), negate(axes[1])),
        (_, true) => (about::<T, 1, 0>(axes, s, c), negate(axes[2])),
    }
}

/// The axes after a turn, by its sine and cosine, that moves axis A towards B.
#[inline(always)]
fn about<T: Real, const A: usize, const B: usize>(mut axes: Axes<T>, s: T, c: T) -> Axes<T> {
    let (a, b) = (axes[A], axes[B]);
    axes[A] = add(scale(a, c), scale(b, s));
    axes[B] = sub(scale(b, c), scale(a, s));
    axes
}

impl<T: Real, const N: usize> Kinematics<'_, T, N> {
    /// Moves to another joint vector of the chain: what [`Chain::forward_within`] computes, the same bits, without an
    /// array to fill first.
    #[inline(always)]
    pub fn move_within(&mut self, q: &[T; N]) {
        (self.tip, self.last) = self.chain.walk::<true>(q, &mut self.axis, &mut self.origin);
    }

    /// The tip's position.
    #[inline(always)]
    pub fn tip(&self) -> Vec3<T> {
        self.tip
    }

    /// The tip's axes: the columns of its rotation matrix.
    #[inline(always)]
    pub fn tip_axes(&self) -> [Vec3<T>; 3] {
        turned_by(self.last, &self.chain.tip.0)
    }

    /// The landmarks: the origins of the chain's landmark DoFs in order, then the tip.
    #[inline(always)]
    pub fn landmarks(&self) -> impl Iterator<Item = Vec3<T>> + '_ {
        let origins = self
            .chain
            .landmarks
            .iter()
            .filter_map(|&j| self.origin.get(usize::from(j)));
        origins.copied().chain([self.tip])
    }

    /// The distance to another posture's landmarks, metres: dist of SPEC section 4, over the landmarks that both
    /// have.
    #[inline(always)]
    pub fn distance(&self, landmarks: impl IntoIterator<Item = Vec3<T>>) -> T {
        self.distance_beyond(0, landmarks)
    }

    /// [`distance`](Self::distance) where the first `still` landmarks are known to be where the other posture has them:
    /// `landmarks` are those after them. A shoulder, which no joint moves, is one that need not be compared.
    #[inline(always)]
    pub fn distance_beyond(&self, still: usize, landmarks: impl IntoIterator<Item = Vec3<T>>) -> T {
        let mut others = landmarks.into_iter();
        let mut sum = T::zero();
        let still = still.min(self.chain.landmarks.len());
        let mut count = still as u32;
        for &joint in self.chain.landmarks.get(still..).unwrap_or(&[]) {
            if let (Some(&point), Some(other)) =
                (self.origin.get(usize::from(joint)), others.next())
            {
                sum = sum + distance(point, other);
                count += 1;
            }
        }
        if let Some(other) = others.next() {
            sum = sum + distance(self.tip, other);
            count += 1;
        }
        sum * T::of(1.0 / f64::from(count.max(1)))
    }

    /// The Jacobian's columns at the tip: M = 3 linear rows, or M = 6 with the angular ones below.
    #[inline(always)]
    pub fn columns<const M: usize>(&self) -> [[T; M]; N] {
        let mut columns = [[T::zero(); M]; N];
        for i in 0..N {
            let axis = self.axis[i];
            let (linear, angular) = match self.chain.links[i].kind {
                Kind::Revolute => (cross(axis, sub(self.tip, self.origin[i])), axis),
                Kind::Prismatic => (axis, [T::zero(); 3]),
            };
            for r in 0..M {
                columns[i][r] = if r < 3 {
                    linear[r]
                } else {
                    angular[(r - 3) % 3]
                };
            }
        }
        columns
    }
}

/// The pose of every DoF's own frame in the base frame, after its motion: Tᵢ of SPEC section 1, from a chain's
/// description. A [`Chain`] has folded these frames away: it keeps what a control tick needs, and no more. The joints
/// are not checked here: a zero axis gives no number.
///
/// ```
/// use nalgebra::Isometry3;
/// use sinew::{chain::human_arm_joints, kinematics::frames};
/// let (joints, _) = human_arm_joints::<f64>(0.29, 0.25, 0.09);
/// let elbow = frames(&Isometry3::identity(), &joints, &[0.0; 7])[3];
/// assert!((elbow.translation.z + 0.29).abs() < 1e-12);
/// ```
pub fn frames<T: Real + RealField, const N: usize>(
    base: &Isometry3<T>,
    joints: &[Joint<T>; N],
    q: &[T; N],
) -> [Isometry3<T>; N] {
    let mut frames = [*base; N];
    let mut frame = *base;
    for ((joint, &q), slot) in joints.iter().zip(q).zip(&mut frames) {
        let axis = Unit::new_normalize(joint.axis);
        let motion = match joint.kind {
            Kind::Revolute => Isometry3::rotation(axis.scale(q)),
            Kind::Prismatic => Translation3::from(axis.scale(q)).into(),
        };
        frame = frame * Isometry3::from_parts(joint.translation.into(), joint.rotation) * motion;
        *slot = frame;
    }
    frames
}

impl<T: Real + RealField, const N: usize> Kinematics<'_, T, N> {
    /// The tip's pose in the base frame.
    ///
    /// ```
    /// let arm = sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09)?;
    /// let pose = arm.forward(&[0.0; 7]).tip_pose();
    /// assert!(pose.rotation.angle() < 1e-12);
    /// # Ok::<(), sinew::Error>(())
    /// ```
    pub fn tip_pose(&self) -> Isometry3<T> {
        pose(self.tip, self.tip_axes())
    }

    /// The Jacobian at the tip as a matrix: 6×N, three linear rows (m/rad), then three angular (rad/rad), in the base
    /// frame. `fixed_rows::<3>(0)` of it is the position task's.
    ///
    /// ```
    /// let arm = sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09)?;
    /// let jacobian = arm.forward(&[0.0; 7]).jacobian();
    /// assert!((jacobian[(1, 0)] - 0.63).abs() < 1e-12); // flexion swings the hanging hand forward
    /// let svd = jacobian.svd(true, true); // nalgebra's, for whatever else it is good for
    /// # Ok::<(), sinew::Error>(())
    /// ```
    pub fn jacobian(&self) -> SMatrix<T, 6, N> {
        SMatrix::from(self.columns::<6>())
    }
}

fn pose<T: Real + RealField>(at: Vec3<T>, axes: Axes<T>) -> Isometry3<T> {
    let matrix = nalgebra::Matrix3::from(axes);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(matrix);
    Isometry3::from_parts(
        nalgebra::Translation3::from(nalgebra::Vector3::from(at)),
        nalgebra::UnitQuaternion::from_rotation_matrix(&rotation),
    )
}
