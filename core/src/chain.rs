//! A serial chain of degrees of freedom (SPEC section 1).
//!
//! T₀ = base, Tᵢ = Tᵢ₋₁ · (Rᵢ, tᵢ) · motionᵢ(qᵢ), tip = T_N · (R_tip, t_tip).
//!
//! A [`Chain`] is made once from [`Joint`]s, checked, and *folded*: the frames it computes with are turned so that
//! every DoF moves about or along its own x, y or z axis, and so that the rotation between neighbouring frames is
//! the identity wherever the next axis lies along one of the frame's own. For a human arm, and for most robots, no
//! rotation is left, and a fixed transform costs nothing but its non-zero offsets. Axes and offsets nearer to a
//! frame's axis than 1e-10 (1e-6 in `f32`) are taken to lie on it: URDF files write π/2 with few digits.

use heapless::Vec;
use nalgebra::{Isometry3, Quaternion, Scalar, Translation3, Unit, UnitQuaternion, Vector3};

use crate::Error;
use crate::real::Real;
use crate::vector::{Vec3, add, cross, dot, scale};

/// No length of a chain, and no target, may be larger than this, in metres; no angle limit larger than
/// [`MOST_ANGLE`](crate::math::MOST_ANGLE) radians. It keeps every product on the way finite in `f32`.
pub const MOST_LENGTH: f64 = 1e4;

/// How a DoF moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// It turns about its axis; q in radians.
    Revolute,
    /// It slides along its axis; q in metres.
    Prismatic,
}

/// One degree of freedom as a person or a URDF file describes it.
#[derive(Clone, Copy, Debug)]
pub struct Joint<T: Scalar> {
    /// How it moves.
    pub kind: Kind,
    /// Where its frame lies in the frame before it, metres (tᵢ).
    pub translation: Vector3<T>,
    /// How its frame is turned against the frame before it (Rᵢ).
    pub rotation: UnitQuaternion<T>,
    /// Its axis in its own frame; any length but 0.
    pub axis: Vector3<T>,
    /// The least q, radians or metres.
    pub lower: T,
    /// The greatest q, radians or metres.
    pub upper: T,
}

/// A frame's three axes (the columns of its rotation matrix).
pub type Axes<T> = [Vec3<T>; 3];

/// An offset in the frame before, by how much of it there is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shift<T> {
    /// None at all.
    None,
    /// Along one axis (0 x, 1 y, 2 z), metres.
    Along(usize, T),
    /// Any other, metres.
    General(Vec3<T>),
}

/// A fixed rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Turn<T> {
    /// None at all.
    None,
    /// By the matrix with these columns.
    General(Axes<T>),
}

/// A DoF after folding: what is left to compute. For who writes the chain out as straight-line code.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link<T> {
    /// The offset of its origin in the folded frame before.
    pub shift: Shift<T>,
    /// The rotation of its folded frame against the one before.
    pub turn: Turn<T>,
    /// The axis it moves about or along: 0 x, 1 y, 2 z of the folded frame.
    pub axis: usize,
    /// Whether that axis points the other way.
    pub flip: bool,
    /// How it moves.
    pub kind: Kind,
}

/// A valid serial chain of N DoFs, ready to compute with. Configuration only: it never changes while a motion runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Chain<T, const N: usize> {
    pub(crate) base: (Axes<T>, Vec3<T>),
    pub(crate) links: [Link<T>; N],
    pub(crate) tip: (Turn<T>, Shift<T>),
    pub(crate) lower: [T; N],
    pub(crate) upper: [T; N],
    pub(crate) landmarks: Vec<u8, N>,
}

impl<T: Real + Scalar, const N: usize> Chain<T, N> {
    /// A chain from its description. `landmarks` are the DoFs whose origins are compared in a posture (SPEC section
    /// 4), in chain order; the tip is one more, always.
    ///
    /// # Errors
    /// Any number that is not finite, a length or a slide's limit above [`MOST_LENGTH`], an angle limit above 8192 rad, a
    /// zero axis, a rotation that is no quaternion of length 1 (by more than 1 %), reversed limits, a landmark on a DoF that
    /// is not there or before the one before, or not N joints.
    ///
    /// ```
    /// use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    /// use sinew::chain::{Chain, Joint, Kind};
    /// let elbow = Joint {
    ///     kind: Kind::Revolute,
    ///     translation: Vector3::new(0.0, 0.0, -0.3),
    ///     rotation: UnitQuaternion::identity(),
    ///     axis: Vector3::x(),
    ///     lower: 0.0,
    ///     upper: 2.6,
    /// };
    /// let shoulder = Joint { translation: Vector3::zeros(), ..elbow };
    /// let hand = Isometry3::translation(0.0, 0.0, -0.35);
    /// let arm = Chain::<f64, 2>::new(&Isometry3::identity(), &[shoulder, elbow], &hand, &[0, 1])?;
    /// assert!((arm.forward(&[0.0, 0.0]).tip()[2] + 0.65).abs() < 1e-12);
    ///
    /// let wrong = Joint { lower: 3.0, ..elbow };
    /// assert!(Chain::<f64, 2>::new(&Isometry3::identity(), &[shoulder, wrong], &hand, &[0, 1]).is_err());
    /// # Ok::<(), sinew::Error>(())
    /// ```
    pub fn new(
        base: &Isometry3<T>,
        joints: &[Joint<T>],
        tip: &Isometry3<T>,
        landmarks: &[usize],
    ) -> Result<Self, Error> {
        let joints: &[Joint<T>; N] = joints.try_into().map_err(|_| Error::WrongCount {
            what: "joints",
            expected: N,
            found: joints.len(),
        })?;
        let (base_axes, base_position) = transform(base, "the base transform")?;
        let (tip_axes, tip_position) = transform(tip, "the tip transform")?;

        // `fold` is C of the frame before: its columns are the folded frame's axes in the frame's own.
        let mut fold = identity();
        let mut links = [Link {
            shift: Shift::None,
            turn: Turn::None,
            axis: 2,
            flip: false,
            kind: Kind::Revolute,
        }; N];
        let mut lower = [T::zero(); N];
        let mut upper = [T::zero(); N];
        for (i, (joint, link)) in joints.iter().zip(&mut links).enumerate() {
            let rotation = axes_of(&joint.rotation, "the rotation", Some(i))?;
            let offset = vector_of(&joint.translation, "the translation", Some(i))?;
            let axis = unit(finite_vector(&joint.axis, "the axis", Some(i))?)
                .ok_or(Error::ZeroAxis { joint: i })?;
            let most = match joint.kind {
                Kind::Revolute => crate::math::MOST_ANGLE,
                Kind::Prismatic => MOST_LENGTH,
            };
            for limit in [joint.lower, joint.upper] {
                finite(limit, "a limit", Some(i))?;
                if T::any(T::of(most).lt(limit.abs())) {
                    return Err(Error::OutOfRange {
                        what: "a limit must lie within ±8192 rad or ±10 km",
                        joint: Some(i),
                    });
                }
            }
            if T::any(joint.upper.lt(joint.lower)) {
                return Err(Error::LimitsReversed { joint: i });
            }
            lower[i] = joint.lower;
            upper[i] = joint.upper;

            link.kind = joint.kind;
            link.shift = Shift::of(turn_back(&fold, offset));
            let straight = times(&transposed(&rotation), &fold);
            match lies_along(turn_back(&straight, axis)) {
                Some((k, flip)) => {
                    (link.axis, link.flip) = (k, flip);
                    fold = straight;
                }
                None => {
                    let turned = axes_with_z(axis);
                    link.turn =
                        Turn::General(times(&transposed(&fold), &times(&rotation, &turned)));
                    fold = turned;
                }
            }
        }

        let mut kept = Vec::new();
        for (k, &joint) in landmarks.iter().enumerate() {
            let wrong = Error::NoSuchLandmark {
                landmark: k,
                joint,
                joints: N,
            };
            if joint >= N || kept.last().is_some_and(|&last| usize::from(last) >= joint) {
                return Err(wrong);
            }
            kept.push(u8::try_from(joint).map_err(|_| wrong)?)
                .map_err(|_| wrong)?;
        }
        Ok(Chain {
            base: (base_axes, base_position),
            links,
            tip: (
                Turn::of(times(&transposed(&fold), &tip_axes)),
                Shift::of(turn_back(&fold, tip_position)),
            ),
            lower,
            upper,
            landmarks: kept,
        })
    }
}

impl<T: Real, const N: usize> Chain<T, N> {
    /// The least q of each DoF, radians or metres.
    pub fn lower(&self) -> &[T; N] {
        &self.lower
    }

    /// The greatest q of each DoF, radians or metres.
    pub fn upper(&self) -> &[T; N] {
        &self.upper
    }

    /// The DoFs whose origins are landmarks, in chain order; the tip is one more.
    pub fn landmarks(&self) -> impl ExactSizeIterator<Item = usize> + '_ {
        self.landmarks.iter().map(|&j| usize::from(j))
    }

    /// The DoFs as they are computed.
    pub fn links(&self) -> &[Link<T>; N] {
        &self.links
    }

    /// The base frame: its axes and its position.
    pub fn base(&self) -> (Axes<T>, Vec3<T>) {
        self.base
    }

    /// From the last folded frame to the tip.
    pub fn tip_transform(&self) -> (Turn<T>, Shift<T>) {
        self.tip
    }

    /// Whether a DoF turns or slides.
    pub fn kinds(&self) -> impl ExactSizeIterator<Item = Kind> + '_ {
        self.links.iter().map(|link| link.kind)
    }
}

impl<const N: usize> Chain<f64, N> {
    /// The same chain for another scalar: `f32` for a microcontroller, lanes for a learner. Each number is rounded
    /// once.
    ///
    /// ```
    /// let arm = sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09)?;
    /// let on_chip: sinew::chain::Chain<f32, 7> = arm.cast();
    /// # Ok::<(), sinew::Error>(())
    /// ```
    pub fn cast<U: Real>(&self) -> Chain<U, N> {
        let vector = |v: Vec3<f64>| v.map(U::of);
        let axes = |a: Axes<f64>| a.map(vector);
        let shift = |s| match s {
            Shift::None => Shift::None,
            Shift::Along(k, by) => Shift::Along(k, U::of(by)),
            Shift::General(by) => Shift::General(vector(by)),
        };
        let turn = |t| match t {
            Turn::None => Turn::None,
            Turn::General(a) => Turn::General(axes(a)),
        };
        Chain {
            base: (axes(self.base.0), vector(self.base.1)),
            links: self.links.map(|link| Link {
                shift: shift(link.shift),
                turn: turn(link.turn),
                axis: link.axis,
                flip: link.flip,
                kind: link.kind,
            }),
            tip: (turn(self.tip.0), shift(self.tip.1)),
            lower: self.lower.map(U::of),
            upper: self.upper.map(U::of),
            landmarks: self.landmarks.clone(),
        }
    }
}

impl<T: Real> Shift<T> {
    fn of(v: Vec3<T>) -> Self {
        let near = T::of(nearness::<T>());
        let v = v.map(|x| {
            if T::any(x.abs().lt(near)) {
                T::zero()
            } else {
                x
            }
        });
        let present = v.map(|x| T::any(T::zero().lt(x.abs())));
        match present {
            [false, false, false] => Shift::None,
            [true, false, false] => Shift::Along(0, v[0]),
            [false, true, false] => Shift::Along(1, v[1]),
            [false, false, true] => Shift::Along(2, v[2]),
            _ => Shift::General(v),
        }
    }
}

impl<T: Real> Turn<T> {
    fn of(axes: Axes<T>) -> Self {
        let near = T::of(nearness::<T>());
        let same = |a: &Vec3<T>, b: &Vec3<T>| {
            a.iter()
                .zip(b)
                .all(|(&a, &b)| T::any((a - b).abs().lt(near)))
        };
        let identity = identity();
        if axes.iter().zip(&identity).all(|(a, b)| same(a, b)) {
            Turn::None
        } else {
            Turn::General(axes)
        }
    }
}

/// How near to an axis counts as on it: 1e-10, or what the scalar can tell apart.
fn nearness<T: Real>() -> f64 {
    (8.0 * T::EPSILON).max(1e-10)
}

fn identity<T: Real>() -> Axes<T> {
    let (i, o) = (T::one(), T::zero());
    [[i, o, o], [o, i, o], [o, o, i]]
}

pub(crate) fn transposed<T: Real>(a: &Axes<T>) -> Axes<T> {
    [
        [a[0][0], a[1][0], a[2][0]],
        [a[0][1], a[1][1], a[2][1]],
        [a[0][2], a[1][2], a[2][2]],
    ]
}

/// A·v.
#[inline(always)]
pub(crate) fn turned<T: Real>(a: &Axes<T>, v: Vec3<T>) -> Vec3<T> {
    add(add(scale(a[0], v[0]), scale(a[1], v[1])), scale(a[2], v[2]))
}

/// Aᵀ·v.
fn turn_back<T: Real>(a: &Axes<T>, v: Vec3<T>) -> Vec3<T> {
    a.map(|column| dot(&column, &v))
}

/// A·B.
#[inline(always)]
pub(crate) fn times<T: Real>(a: &Axes<T>, b: &Axes<T>) -> Axes<T> {
    [turned(a, b[0]), turned(a, b[1]), turned(a, b[2])]
}

/// The axis that a unit vector lies along, and whether it points against it.
fn lies_along<T: Real>(v: Vec3<T>) -> Option<(usize, bool)> {
    let near = T::of(nearness::<T>());
    (0..3).find_map(|k| {
        let others = v.iter().enumerate().filter(|&(i, _)| i != k);
        let along = others.fold(true, |along, (_, x)| along && T::any(x.abs().lt(near)));
        along.then(|| (k, T::any(v[k].lt(T::zero()))))
    })
}

/// Some right-handed axes of which the third is `z`.
fn axes_with_z<T: Real>(z: Vec3<T>) -> Axes<T> {
    let aside = if T::any(z[0].abs().lt(T::of(0.6))) {
        [T::one(), T::zero(), T::zero()]
    } else {
        [T::zero(), T::one(), T::zero()]
    };
    let x = unit(cross(aside, z)).unwrap_or(aside);
    [x, cross(z, x), z]
}

/// The direction of a vector; none of a vector that is zero.
fn unit<T: Real>(v: Vec3<T>) -> Option<Vec3<T>> {
    // Scaled first, so that neither a tiny nor a large axis is lost in its square.
    let largest = v[0].abs().most(v[1].abs()).most(v[2].abs());
    if !T::any(T::zero().lt(largest)) {
        return None;
    }
    let v = v.map(|x| x / largest);
    let norm = dot(&v, &v).sqrt();
    Some(v.map(|x| x / norm))
}

fn finite<T: Real>(x: T, what: &'static str, joint: Option<usize>) -> Result<T, Error> {
    if T::all(x.is_finite()) {
        Ok(x)
    } else {
        Err(Error::NotFinite { what, joint })
    }
}

fn finite_vector<T: Real + Scalar>(
    v: &Vector3<T>,
    what: &'static str,
    joint: Option<usize>,
) -> Result<Vec3<T>, Error> {
    Ok([
        finite(v.x, what, joint)?,
        finite(v.y, what, joint)?,
        finite(v.z, what, joint)?,
    ])
}

/// An offset: finite, and not too long.
fn vector_of<T: Real + Scalar>(
    v: &Vector3<T>,
    what: &'static str,
    joint: Option<usize>,
) -> Result<Vec3<T>, Error> {
    let v = finite_vector(v, what, joint)?;
    if v.iter().any(|x| T::any(T::of(MOST_LENGTH).lt(x.abs()))) {
        return Err(Error::OutOfRange {
            what: "no length may be above 10 km",
            joint,
        });
    }
    Ok(v)
}

/// The rotation matrix of a quaternion, made unit length first.
fn axes_of<T: Real + Scalar>(
    q: &UnitQuaternion<T>,
    what: &'static str,
    joint: Option<usize>,
) -> Result<Axes<T>, Error> {
    let q = q.as_ref().coords;
    let q = [
        finite(q.x, what, joint)?,
        finite(q.y, what, joint)?,
        finite(q.z, what, joint)?,
        finite(q.w, what, joint)?,
    ];
    let norm = dot(&q, &q).sqrt();
    // "Unit" is a promise that a caller can break; a little is mended, more is refused, as in `Pose::new`.
    if T::all((norm - T::one()).abs().lt(T::of(1e-2))) {
        Ok(axes_of_quaternion(q.map(|x| x / norm)))
    } else {
        Err(Error::OutOfRange {
            what: "a rotation must be a quaternion of length 1",
            joint,
        })
    }
}

/// The rotation matrix of a unit quaternion x, y, z, w.
pub(crate) fn axes_of_quaternion<T: Real>([x, y, z, w]: [T; 4]) -> Axes<T> {
    let (one, two) = (T::one(), T::of(2.0));
    [
        [
            one - two * (y * y + z * z),
            two * (x * y + w * z),
            two * (x * z - w * y),
        ],
        [
            two * (x * y - w * z),
            one - two * (x * x + z * z),
            two * (y * z + w * x),
        ],
        [
            two * (x * z + w * y),
            two * (y * z - w * x),
            one - two * (x * x + y * y),
        ],
    ]
}

fn transform<T: Real + Scalar>(
    t: &Isometry3<T>,
    what: &'static str,
) -> Result<(Axes<T>, Vec3<T>), Error> {
    Ok((
        axes_of(&t.rotation, what, None)?,
        vector_of(&t.translation.vector, what, None)?,
    ))
}

/// The human arm of the SPEC: 7 DoFs, segment lengths in metres.
///
/// The base frame is at the shoulder, x to the person's right, y forward, z up. At zero the arm hangs straight down.
/// The DoFs: shoulder flexion (about x), abduction (y) and axial rotation (z); elbow flexion (x); forearm pronation
/// (z); wrist flexion (x) and deviation (y). The axis of pronation passes through elbow and wrist; it is placed at
/// the elbow. Landmarks are shoulder, elbow and wrist (DoFs 0, 3, 5), then the hand, which is the tip: four
/// points, one fewer than the SPEC's joints and tip, because nothing that is recorded lies at the axis of pronation.
///
/// Limits are the ranges of motion of the American Academy of Orthopaedic Surgeons (*Joint motion: method of
/// measuring and recording*, 1965), with the greater of both directions where left and right arm are mirror images
/// (abduction, rotations, deviation), so that one model serves either arm; the wrist extends as far as it flexes.
///
/// # Errors
/// A length that is negative, not finite or above [`MOST_LENGTH`].
///
/// ```
/// let arm = sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09)?;
/// let elbow_bent = [0.0, 0.0, 0.0, core::f64::consts::FRAC_PI_2, 0.0, 0.0, 0.0];
/// let [x, y, z] = arm.forward(&elbow_bent).tip(); // the hand is in front, at elbow height
/// assert!(x.abs() < 1e-12 && (y - 0.34).abs() < 1e-12 && (z + 0.29).abs() < 1e-12);
/// # Ok::<(), sinew::Error>(())
/// ```
pub fn human_arm<T: Real + Scalar>(
    upper_arm: f64,
    forearm: f64,
    hand: f64,
) -> Result<Chain<T, 7>, Error> {
    let (joints, tip) = human_arm_joints(upper_arm, forearm, hand);
    for length in [upper_arm, forearm, hand] {
        if length < 0.0 {
            return Err(Error::OutOfRange {
                what: "a segment length must not be negative",
                joint: None,
            });
        }
    }
    Chain::new(&isometry([0.0; 3]), &joints, &tip, &HUMAN_ARM_LANDMARKS)
}

/// The landmarks of [`human_arm`]: shoulder, elbow, wrist.
pub const HUMAN_ARM_LANDMARKS: [usize; 3] = [0, 3, 5];

/// The names of the DoFs of [`human_arm`].
pub const HUMAN_ARM_NAMES: [&str; 7] = [
    "shoulder flexion",
    "shoulder abduction",
    "shoulder rotation",
    "elbow flexion",
    "forearm pronation",
    "wrist flexion",
    "wrist deviation",
];

/// The DoFs of [`human_arm`] and its tip transform, unchecked.
pub fn human_arm_joints<T: Real + Scalar>(
    upper_arm: f64,
    forearm: f64,
    hand: f64,
) -> ([Joint<T>; 7], Isometry3<T>) {
    let joint = |axis: usize, down: f64, lower: f64, upper: f64| {
        let mut direction = [T::zero(); 3];
        direction[axis] = T::one();
        Joint {
            kind: Kind::Revolute,
            translation: isometry([0.0, 0.0, -down]).translation.vector,
            rotation: isometry([0.0; 3]).rotation,
            axis: Vector3::from(direction),
            lower: T::of(lower.to_radians()),
            upper: T::of(upper.to_radians()),
        }
    };
    let joints = [
        joint(0, 0.0, -60.0, 180.0),
        joint(1, 0.0, -180.0, 180.0),
        joint(2, 0.0, -90.0, 90.0),
        joint(0, upper_arm, 0.0, 150.0),
        joint(2, 0.0, -80.0, 80.0),
        joint(0, forearm, -80.0, 80.0),
        joint(1, 0.0, -30.0, 30.0),
    ];
    (joints, isometry([0.0, 0.0, -hand]))
}

/// A translation, without asking nalgebra's arithmetic of the scalar.
fn isometry<T: Real + Scalar>(at: [f64; 3]) -> Isometry3<T> {
    let (o, i) = (T::zero(), T::one());
    Isometry3 {
        rotation: Unit::new_unchecked(Quaternion::from_vector(nalgebra::Vector4::new(o, o, o, i))),
        translation: Translation3 {
            vector: Vector3::from(at.map(T::of)),
        },
    }
}

#[cfg(all(test, feature = "libm"))]
mod tests {
    use super::*;
    use std::string::ToString;

    /// The arm's own description, with one thing about a joint changed.
    fn with(change: impl Fn(&mut [Joint<f64>; 7])) -> Result<Chain<f64, 7>, Error> {
        let (mut joints, tip) = human_arm_joints(0.29, 0.25, 0.09);
        change(&mut joints);
        Chain::new(&isometry([0.0; 3]), &joints, &tip, &HUMAN_ARM_LANDMARKS)
    }

    /// It is refused with this error, whose message names what it is about.
    fn refused<T>(made: Result<T, Error>, error: Error, names: &str) {
        let found = made.map(|_| ()).unwrap_err();
        assert_eq!(found, error);
        assert!(found.to_string().contains(names), "{found}");
    }

    fn not_finite(what: &'static str, joint: usize) -> Error {
        Error::NotFinite {
            what,
            joint: Some(joint),
        }
    }

    #[test]
    fn numbers_that_are_not_finite_are_refused() {
        for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let (place, limit) = (not_finite("the translation", 2), not_finite("a limit", 4));
            refused(with(|j| j[2].translation.y = x), place, "(joint 2)");
            refused(with(|j| j[4].lower = x), limit, "(joint 4)");
            refused(with(|j| j[4].upper = x), limit, "(joint 4)");
            let axis = not_finite("the axis", 6);
            refused(with(|j| j[6].axis.z = x), axis, "(joint 6)");
            let turn = Unit::new_unchecked(Quaternion::new(1.0, x, 0.0, 0.0));
            let rotation = not_finite("the rotation", 1);
            refused(with(|j| j[1].rotation = turn), rotation, "(joint 1)");
            let tip = Error::NotFinite {
                what: "the tip transform",
                joint: None,
            };
            let (joints, _) = human_arm_joints(0.29, 0.25, 0.09);
            let chain =
                Chain::<f64, 7>::new(&isometry([0.0; 3]), &joints, &isometry([0.0, x, 0.0]), &[]);
            refused(chain, tip, "tip transform");
        }
    }

    #[test]
    fn an_axis_without_direction_is_refused_and_any_length_will_do() {
        let zero = with(|j| j[3].axis = Vector3::zeros());
        refused(zero, Error::ZeroAxis { joint: 3 }, "(joint 3)");
        for length in [1e-300, 1e-30, 1.0, 1e30, 1e300] {
            let same = with(|j| j[3].axis *= length);
            assert_eq!(same, with(|_| ()), "{length}");
        }
    }

    #[test]
    fn limits_that_are_reversed_or_too_wide_are_refused() {
        let reversed = with(|j| (j[5].lower, j[5].upper) = (0.1, -0.1));
        refused(reversed, Error::LimitsReversed { joint: 5 }, "(joint 5)");
        assert!(with(|j| (j[5].lower, j[5].upper) = (0.1, 0.1)).is_ok());
        let wide = Error::OutOfRange {
            what: "a limit must lie within ±8192 rad or ±10 km",
            joint: Some(5),
        };
        refused(with(|j| j[5].upper = 8193.0), wide, "(joint 5)");
        let slide = |upper| {
            with(|j| {
                j[5].kind = Kind::Prismatic;
                j[5].upper = upper;
            })
        };
        assert!(slide(8193.0).is_ok());
        refused(slide(10_001.0), wide, "(joint 5)");
    }

    #[test]
    fn lengths_that_no_arm_has_are_refused() {
        let long = Error::OutOfRange {
            what: "no length may be above 10 km",
            joint: Some(3),
        };
        let far = with(|j| j[3].translation.z = -1.1e4);
        refused(far, long, "(joint 3)");
        let negative = Error::OutOfRange {
            what: "a segment length must not be negative",
            joint: None,
        };
        refused(
            human_arm::<f64>(0.29, -0.25, 0.09),
            negative,
            "segment length",
        );
    }

    #[test]
    fn a_rotation_that_is_none_is_refused_and_a_rounded_one_is_mended() {
        let wrong = Error::OutOfRange {
            what: "a rotation must be a quaternion of length 1",
            joint: Some(0),
        };
        let scaled = |by: f64| {
            let turn = Unit::new_unchecked(Quaternion::new(by, 0.0, 0.0, 0.0));
            with(|j| j[0].rotation = turn)
        };
        refused(scaled(0.0), wrong, "(joint 0)");
        refused(scaled(1.1), wrong, "(joint 0)");
        assert_eq!(scaled(1.001), with(|_| ()));
    }

    #[test]
    fn landmarks_must_be_there_and_in_chain_order() {
        let (joints, tip) = human_arm_joints(0.29, 0.25, 0.09);
        let on = |landmarks: &[usize]| {
            Chain::<f64, 7>::new(&isometry([0.0; 3]), &joints, &tip, landmarks)
        };
        for (landmarks, landmark, joint) in [
            (&[0, 3, 7][..], 2, 7),
            (&[0, 5, 3][..], 2, 3),
            (&[0, 3, 3][..], 2, 3),
            (&[usize::MAX][..], 0, usize::MAX),
        ] {
            let error = Error::NoSuchLandmark {
                landmark,
                joint,
                joints: 7,
            };
            refused(on(landmarks), error, "on joints 0 to 6");
        }
        assert!(on(&[0, 1, 2, 3, 4, 5, 6]).is_ok());
        assert!(on(&[]).is_ok());
    }

    #[test]
    fn a_chain_has_as_many_joints_as_its_type_says() {
        let (joints, tip) = human_arm_joints(0.29, 0.25, 0.09);
        let error = Error::WrongCount {
            what: "joints",
            expected: 6,
            found: 7,
        };
        let chain = Chain::<f64, 6>::new(&isometry([0.0; 3]), &joints, &tip, &[]);
        refused(chain, error, "expected 6 joints, found 7");
    }
}
