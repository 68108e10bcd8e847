//! Laws of the model: of kinematics, synergies, the distance between motions, and the control tick.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;
use sinew::chain::{Chain, Kind, MOST_LENGTH, human_arm};
use sinew::controller::{Controller, Limits};
use sinew::math::MOST_ANGLE;
use sinew::metric::{MotionDistance, posture_distance};
use sinew::real::Real;
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Stepper, Transpose,
};
use sinew::synergy::{Model, Synergy};
use sinew::target::{Pose, Position, Target};
use sinew_tests::random::{Arm, arm, rotation, vector};
use sinew_tests::{apart, for_its_size, frames};

// Kinematics

/// Tip and landmarks against a plain product of transforms.
fn check_postures<const N: usize>(arm: &Arm) {
    let (chain, q) = (arm.chain::<N>(), arm.q());
    let at = chain.forward(&q);
    let expected = frames(&arm.base, &arm.joints, &q);
    for (landmark, expected) in at.landmarks().zip(&expected) {
        assert!((Vector3::from(landmark) - expected.translation.vector).norm() < 1e-9);
    }
    let (distance, angle) = apart(&at.tip_pose(), &arm.tip_at(&q));
    assert!(distance < 1e-9 && angle < 1e-9, "{distance:e} {angle:e}");

    let single = chain.cast::<f32>();
    let tip = single.forward(&q.map(|q| q as f32)).tip().map(f64::from);
    assert!((Vector3::from(tip) - Vector3::from(at.tip())).norm() < 1e-4);
}

/// The Jacobian against central differences of a plain product of transforms.
fn check_jacobian<const N: usize>(arm: &Arm) {
    const H: f64 = 1e-5;
    let q = arm.q::<N>();
    let chain = arm.chain::<N>();
    let jacobian = chain.forward(&q).jacobian();
    for i in 0..N {
        let moved = |by: f64| {
            let mut q = q;
            q[i] += by;
            arm.tip_at(&q)
        };
        let (before, after) = (moved(-H), moved(H));
        let linear = (after.translation.vector - before.translation.vector) / (2.0 * H);
        let angular = (after.rotation * before.rotation.inverse()).scaled_axis() / (2.0 * H);
        for r in 0..3 {
            assert!(
                (jacobian[(r, i)] - linear[r]).abs() < 1e-8,
                "{jacobian} {linear}"
            );
            assert!(
                (jacobian[(r + 3, i)] - angular[r]).abs() < 1e-8,
                "{jacobian} {angular}"
            );
        }
    }
}

proptest! {
    #[test]
    fn folding_a_chain_changes_no_posture(arm in arm()) {
        for_its_size!(arm, check_postures(&arm));
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_forward_kinematics(arm in arm()) {
        for_its_size!(arm, check_jacobian(&arm));
    }
}

// What is left to a target

/// One revolute DoF about z.
fn wheel() -> Chain<f64, 1> {
    let joint = sinew::chain::Joint {
        kind: Kind::Revolute,
        translation: Vector3::zeros(),
        rotation: UnitQuaternion::identity(),
        axis: Vector3::z(),
        lower: -PI,
        upper: PI,
    };
    let one = Isometry3::identity();
    Chain::new(&one, &[joint], &one, &[]).unwrap()
}

/// The angular rows of what is left from the wheel at `q` to it turned by `rotation` in the base frame.
fn left_to_turn<T: Real + Into<f64>>(q: f64, rotation: UnitQuaternion<f64>) -> Vector3<f64> {
    let chain = wheel().cast::<T>();
    let wanted = rotation * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), q);
    let [x, y, z, w] = <[f64; 4]>::from(wanted.coords).map(T::of);
    let pose = Pose::new([T::zero(); 3], [x, y, z, w]).unwrap();
    let left = pose.error(&chain.forward(&[T::of(q)])).map(Into::into);
    Vector3::new(left[3], left[4], left[5])
}

fn check_turn<T: Real + Into<f64>>(q: f64, axis: Unit<Vector3<f64>>, angle: f64, tolerance: f64) {
    let rotation = UnitQuaternion::from_axis_angle(&axis, angle);
    let found = left_to_turn::<T>(q, rotation);
    let expected = axis.scale(angle);
    // A rotation by π about an axis is one about the opposite axis too.
    let off = (found - expected).norm();
    let off = match angle > PI - tolerance {
        true => off.min((found + expected).norm()),
        false => off,
    };
    assert!(off < tolerance, "{off:e}: {found} {expected}");
}

proptest! {
    #[test]
    fn an_orientation_error_is_a_rotation_vector(
        q in -3.0..3.0,
        axis in vector(1.0).prop_filter("a direction", |v| v.norm() > 1e-2).prop_map(Unit::new_normalize),
        angle in prop_oneof![
            Just(0.0), Just(PI), 0.0..PI,
            (-12.0..-1.0).prop_map(|e| 10f64.powf(e)),
            (-12.0..-1.0).prop_map(|e| PI - 10f64.powf(e)),
        ],
    ) {
        check_turn::<f64>(q, axis, angle, 1e-13);
        check_turn::<f32>(q, axis, angle, 4e-6);
    }
}

#[test]
fn tiny_rotations_are_told_from_none() {
    let tiny = UnitQuaternion::from_scaled_axis(Vector3::new(1e-9, -2e-9, 3e-9));
    let left = left_to_turn::<f64>(0.0, tiny);
    assert!(
        (left - Vector3::new(1e-9, -2e-9, 3e-9)).norm() < 1e-15,
        "{left}"
    );
    assert_eq!(
        left_to_turn::<f64>(0.0, UnitQuaternion::identity()),
        Vector3::zeros()
    );
}

// Synergies

fn gains() -> impl Strategy<Value = [f64; 7]> {
    prop::array::uniform7(-5.0..5.0)
}

proptest! {
    #[test]
    fn s_c_with_a_steep_slope_and_no_offset_is_s_b(gains in gains(), step in gains(), t in 0.01..10.0) {
        let b = Synergy::b(gains).unwrap();
        let c = Synergy::c(gains, 0.0, 9999.0).unwrap();
        prop_assert_eq!(c.apply(&step, t), b.apply(&step, t));
    }

    #[test]
    fn the_models_nest(gains in gains(), step in gains(), o in 0.0..20.0, s in 1.0..10.0, t in 0.0..5.0) {
        let of = |model, parameters: &[f64]| {
            Synergy::<f64, 7>::from_parameters(model, parameters).unwrap().apply(&step, t)
        };
        prop_assert_eq!(of(Model::A, &gains[..1]), of(Model::B, &[gains[0]; 7]));
        let c = of(Model::C, &[&gains[..], &[o, s]].concat());
        prop_assert_eq!(c, of(Model::D, &[gains, [o; 7], [s; 7]].concat()));
        let mut diagonal = [[0.0; 7]; 7];
        for i in 0..7 {
            diagonal[i][i] = gains[i];
        }
        let full = Synergy::c(gains, o, s).unwrap().with_matrix(diagonal).unwrap();
        prop_assert_eq!(full.apply(&step, t), c);
    }

    #[test]
    fn a_sigmoid_rises_from_nothing_to_the_whole(o in 0.0..20.0, s in 1.0..10.0, t in 0.0..5.0) {
        let synergy = Synergy::c([1.0f64], o, s).unwrap();
        let phi = |t| synergy.apply(&[1.0], t)[0];
        prop_assert!(0.0 < phi(t) && phi(t) <= phi(t + 0.1) && phi(t + 0.1) <= 1.0);
        prop_assert!((phi(o / s) - 0.5f64).abs() < 1e-12);
    }
}

// The distance between motions

fn posture() -> impl Strategy<Value = [[f64; 3]; 4]> {
    [vector(1.0), vector(1.0), vector(1.0), vector(1.0)].prop_map(|points| points.map(Into::into))
}

fn motion() -> impl Strategy<Value = Vec<[[f64; 3]; 4]>> {
    prop::collection::vec(posture(), 10)
}

/// The mean over the frames that both have.
fn distance(a: &[[[f64; 3]; 4]], b: &[[[f64; 3]; 4]]) -> f64 {
    let mut mean = MotionDistance::new();
    for (a, b) in a.iter().zip(b) {
        mean.add(posture_distance(a, b));
    }
    mean.mean()
}

proptest! {
    #[test]
    fn the_distance_between_motions_is_a_metric(a in motion(), b in motion(), c in motion()) {
        prop_assert_eq!(distance(&a, &b), distance(&b, &a));
        prop_assert_eq!(distance(&a, &a), 0.0);
        prop_assert!(distance(&a, &b) > 0.0);
        prop_assert!(distance(&a, &c) <= distance(&a, &b) + distance(&b, &c) + 1e-12);
    }

    #[test]
    fn the_distance_is_the_mean_over_landmarks_and_frames(a in motion(), b in motion()) {
        let mut sum = 0.0;
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            sum += (Vector3::from(*a) - Vector3::from(*b)).norm();
        }
        prop_assert!((distance(&a, &b) - sum / 40.0).abs() < 1e-12);
    }

    #[test]
    fn an_arm_moved_as_a_whole_is_as_far_off_as_it_was_moved(q in prop::array::uniform7(-2.0..2.0), by in vector(1.0)) {
        let arm = human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
        let at = arm.forward(&q);
        let moved: Vec<[f64; 3]> = at.landmarks().map(|p| (Vector3::from(p) + by).into()).collect();
        prop_assert_eq!(moved.len(), 4);
        prop_assert!((at.distance(moved.iter().copied()) - by.norm()).abs() < 1e-12);
        let landmarks: Vec<[f64; 3]> = at.landmarks().collect();
        prop_assert!((posture_distance(&landmarks, &moved) - at.distance(moved.iter().copied())).abs() < 1e-15);
    }
}

// The tick

/// Numbers as sensors and lines that fail deliver them.
fn anything() -> impl Strategy<Value = f64> {
    prop_oneof![
        -3.0..3.0,
        prop::num::f64::ANY,
        prop::sample::select(vec![
            0.0,
            -0.0,
            f64::NAN,
            f64::INFINITY,
            f64::NEG_INFINITY,
            1e30,
            -1e30,
            f64::MAX,
            f64::MIN_POSITIVE,
            1e-40,
            1e4,
        ]),
    ]
}

/// A controller's settings at and beyond the edge of sense, and what is asked of it.
#[derive(Clone, Debug)]
struct Demand {
    /// λ, 1/s.
    lambda: f64,
    /// Seconds.
    dt: f64,
    gains: [f64; 8],
    offset: f64,
    slope: f64,
    start: [f64; 8],
    position: [f64; 3],
    orientation: UnitQuaternion<f64>,
    /// Stretches the arm.
    scale: f64,
}

fn demand() -> impl Strategy<Value = Demand> {
    let up_to = |most: f64| prop_oneof![-5.0..5.0, -most..most];
    let rate = || prop_oneof![Just(10.0), Just(1.0 / 60.0), 1e-6..1e6];
    let settings = (
        rate(),
        rate(),
        prop::array::uniform8(up_to(9999.0)),
        up_to(79.9),
        up_to(9999.0),
    );
    let asked = (
        prop::array::uniform8(anything()),
        prop::array::uniform3(anything()),
        rotation(),
    );
    let scale = prop_oneof![3 => Just(1.0), 1 => Just(1e4), 1 => Just(1e-6), 1 => Just(0.0)];
    (settings, asked, scale).prop_map(
        |((lambda, dt, gains, offset, slope), (start, position, orientation), scale)| Demand {
            lambda,
            dt,
            gains,
            offset,
            slope,
            start,
            position,
            orientation,
            scale,
        },
    )
}

/// Ten ticks each of all steppers, clamped and free, for a position and a pose.
fn check_ticks<const N: usize>(arm: &Arm, demand: &Demand) {
    fn each<T: Real + Into<f64>, const N: usize>(arm: &Arm, demand: &Demand) {
        let chain = arm.chain::<N>().cast::<T>();
        let position = demand.position.map(T::of);
        let finite = position.iter().all(|&x| x.into().is_finite());
        let target = Position::new(position);
        assert_eq!(
            target.is_ok(),
            finite,
            "a target is refused exactly where it is no number"
        );
        let position = target.map_or([T::of(1e30); 3], |target| target.coordinates());
        let quaternion = <[f64; 4]>::from(demand.orientation.coords).map(T::of);
        let damped = Damped::new(T::of(1e-3)).unwrap();
        let selective = SelectivelyDamped::new(T::of(TAU)).unwrap();
        for stepper in [
            AnyStepper::Transpose(Transpose),
            AnyStepper::NormalisedTranspose(NormalisedTranspose),
            AnyStepper::PseudoInverse(PseudoInverse),
            AnyStepper::Damped(damped),
            AnyStepper::SelectivelyDamped(selective),
        ] {
            for limits in [Limits::Clamped, Limits::Free] {
                let check = Check {
                    chain: &chain,
                    stepper,
                    limits,
                    demand,
                };
                check.ticks::<3>(&Position::new(position).unwrap());
                check.ticks::<6>(&Pose::new(position, quaternion).unwrap());
            }
        }
    }
    each::<f64, N>(arm, demand);
    each::<f32, N>(arm, demand);
}

struct Check<'a, T, const N: usize> {
    chain: &'a Chain<T, N>,
    stepper: AnyStepper<T>,
    limits: Limits,
    demand: &'a Demand,
}

impl<T: Real + Into<f64>, const N: usize> Check<'_, T, N> {
    fn ticks<const M: usize>(&self, target: &impl Target<T, M>) {
        let Check {
            chain,
            stepper,
            limits,
            demand,
        } = *self;
        let first = |values: &[f64; 8]| std::array::from_fn(|i| T::of(values[i]));
        let (offset, slope) = (T::of(demand.offset), T::of(demand.slope));
        let synergy = Synergy::c(first(&demand.gains), offset, slope).unwrap();
        let (lambda, dt) = (T::of(demand.lambda), T::of(demand.dt));
        let controller = Controller::new(chain, stepper, synergy, lambda, dt, limits).unwrap();
        let mut state = controller.start(first(&demand.start));
        let kinds: Vec<Kind> = chain.kinds().collect();
        for _ in 0..10 {
            for i in 0..N {
                let q = state.angles()[i].into();
                let (lower, upper) = match (limits, kinds[i]) {
                    (Limits::Clamped, _) => (chain.lower()[i].into(), chain.upper()[i].into()),
                    (Limits::Free, Kind::Revolute) => (-MOST_ANGLE, MOST_ANGLE),
                    (Limits::Free, Kind::Prismatic) => (-MOST_LENGTH, MOST_LENGTH),
                };
                assert!(
                    lower <= q && q <= upper,
                    "{stepper:?}, {limits:?}, {M} rows: {q}"
                );
            }
            let tip = chain.forward(state.angles()).tip();
            assert!(
                tip.iter().all(|&x| x.into().is_finite()),
                "{stepper:?}: {tip:?}"
            );
            controller.tick(&mut state, target);
        }
    }
}

/// The arm with all its lengths scaled.
fn stretched(mut arm: Arm, scale: f64) -> Arm {
    arm.base.translation.vector *= scale;
    arm.tip.translation.vector *= scale;
    for joint in &mut arm.joints {
        joint.translation *= scale;
    }
    arm
}

proptest! {
    #[test]
    fn a_tick_is_finite_and_within_limits_whatever_it_is_asked(arm in arm(), demand in demand()) {
        let arm = stretched(arm, demand.scale);
        for_its_size!(arm, check_ticks(&arm, &demand));
    }
}

/// A stepper that is of no use.
struct Broken(f64);

impl Stepper<f64> for Broken {
    const RATE: f64 = 1.0;

    fn step<const M: usize, const N: usize>(
        &self,
        _: &[[f64; M]; N],
        _: &[f64; M],
        _: f64,
    ) -> [f64; N] {
        [self.0; N]
    }
}

#[test]
fn a_step_that_is_no_number_moves_nothing() {
    let arm = human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
    let target = Position::new([0.3, 0.2, 0.1]).unwrap();
    for step in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e31] {
        let synergy = Synergy::a(1.0).unwrap();
        let controller = Controller::new(&arm, Broken(step), synergy, 1.0, 0.1, Limits::Clamped);
        let controller = controller.unwrap();
        let mut state = controller.start([0.1; 7]);
        controller.tick(&mut state, &target);
        assert_eq!(*state.angles(), [0.1; 7], "{step}");
        assert_eq!(state.ticks(), 1);
    }
}

// λ is a rate

/// The hand's path of a reach, every twentieth of a second for 1.5 s, computed at `rate` Hz (a multiple of 20).
fn reach(stepper: AnyStepper<f64>, target: [f64; 3], rate: u32) -> Vec<[f64; 3]> {
    let arm = human_arm::<f64>(0.29, 0.25, 0.09).unwrap();
    let synergy = Synergy::c([1.0, 0.5, 0.3, 1.5, 0.1, 0.4, 0.2], 4.0, 8.0).unwrap();
    let dt = 1.0 / f64::from(rate);
    let controller =
        Controller::new(&arm, stepper, synergy, stepper.rate(), dt, Limits::Clamped).unwrap();
    let target = Position::new(target).unwrap();
    let mut state = controller.start([0.1, 0.2, 0.1, 1.2, 0.0, 0.1, 0.0]);
    let mut path = Vec::new();
    for tick in 0..=rate * 3 / 2 {
        if tick % (rate / 20) == 0 {
            path.push(arm.forward(state.angles()).tip());
        }
        controller.tick(&mut state, &target);
    }
    path
}

/// The greatest distance between two paths.
fn furthest(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let distances = a
        .iter()
        .zip(b)
        .map(|(&a, &b)| (Vector3::from(a) - Vector3::from(b)).norm());
    distances.fold(0.0, f64::max)
}

#[test]
fn a_motion_is_nearly_the_same_at_60_hz_240_hz_and_1_khz() {
    for stepper in [
        AnyStepper::Transpose(Transpose),
        AnyStepper::NormalisedTranspose(NormalisedTranspose),
        AnyStepper::PseudoInverse(PseudoInverse),
        AnyStepper::Damped(Damped::default()),
        AnyStepper::SelectivelyDamped(SelectivelyDamped::default()),
    ] {
        for target in [[0.2, 0.4, -0.1], [-0.1, 0.35, 0.2], [0.4, 0.1, -0.3]] {
            let exact = reach(stepper, target, 4000);
            let off = [60, 240, 1000].map(|rate| furthest(&reach(stepper, target, rate), &exact));
            println!("{stepper:?} to {target:?}: {off:.4?} m at 60, 240 and 1000 Hz");
            // 60 Hz is a step of λ·dt = 1/6 of what is left, so a few per cent of a reach of half a metre; the error
            // falls with the period.
            assert!(
                off[0] < 0.04 && off[1] < 0.006 && off[2] < 0.0015,
                "{stepper:?}: {off:?}"
            );
            assert!(
                off[1] < off[0] / 3.0 && off[2] < off[1] / 3.0,
                "{stepper:?}: {off:?}"
            );
        }
    }
}
