//! Forward kinematics and Jacobians of robots read from URDF, against the numbers of Pinocchio and against a plain
//! product of transforms.

use std::fs;

use nalgebra::{Isometry3, Quaternion, RealField, Translation3, Unit, Vector3};
use serde::Deserialize;
use sinew::chain::{Chain, Joint};
use sinew::real::Real;
use sinew_learn::chain::{ChainDescription, JointDescription};
use sinew_learn::urdf;
use sinew_tests::{apart, frames, shared};

/// What Pinocchio computed of one arm.
#[derive(Deserialize)]
struct Reference {
    urdf: String,
    base: String,
    tip: String,
    joints: Vec<String>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    cases: Vec<Case>,
}

/// One configuration of it.
#[derive(Deserialize)]
struct Case {
    q: Vec<f64>,
    position: [f64; 3],
    quaternion_xyzw: [f64; 4],
    /// Row by row.
    jacobian: Vec<Vec<f64>>,
}

impl Case {
    fn q<const N: usize>(&self) -> [f64; N] {
        self.q.as_slice().try_into().unwrap()
    }

    fn pose(&self) -> Isometry3<f64> {
        let [x, y, z, w] = self.quaternion_xyzw;
        let rotation = Unit::new_normalize(Quaternion::new(w, x, y, z));
        Isometry3::from_parts(Translation3::from(Vector3::from(self.position)), rotation)
    }
}

/// An arm by name; none where `../shared` is not.
fn arm(name: &str) -> Option<(Reference, ChainDescription)> {
    let text = fs::read_to_string(shared(&format!("models/reference/{name}.json"))?).unwrap();
    let reference: Reference = serde_json::from_str(&text).unwrap();
    let model = shared(&format!("models/urdf/{}", reference.urdf))?;
    let chain = urdf::read(&model, &reference.base, &reference.tip).unwrap();
    Some((reference, chain))
}

/// The worst errors over an arm's configurations.
#[derive(Debug, Default)]
struct Worst {
    /// Of the tip, metres.
    position: f64,
    /// Of the tip, radians.
    orientation: f64,
    /// Of any of the Jacobian's elements.
    jacobian: f64,
}

fn worst<T: Real + RealField + Into<f64>, const N: usize>(
    chain: &Chain<T, N>,
    cases: &[Case],
) -> Worst {
    let mut worst = Worst::default();
    for case in cases {
        let at = chain.forward(&case.q().map(T::of));
        let pose = at.tip_pose();
        let pose = Isometry3::from_parts(
            Translation3::from(pose.translation.vector.map(Into::into)),
            Unit::new_normalize(Quaternion::from(pose.rotation.coords.map(Into::into))),
        );
        let (distance, angle) = apart(&pose, &case.pose());
        worst.position = worst.position.max(distance);
        worst.orientation = worst.orientation.max(angle);
        let jacobian = at.jacobian();
        for r in 0..6 {
            for i in 0..N {
                let error = (jacobian[(r, i)].into() - case.jacobian[r][i]).abs();
                worst.jacobian = worst.jacobian.max(error);
            }
        }
    }
    worst
}

/// Everything Pinocchio says of an arm of N DoFs, in both scalars.
fn agrees_with_pinocchio<const N: usize>(name: &str) {
    let Some((reference, arm)) = arm(name) else {
        return;
    };
    assert_eq!(reference.cases.len(), 100);
    let names: Vec<_> = arm.joints.iter().map(|joint| &joint.name).collect();
    assert_eq!(names, reference.joints.iter().collect::<Vec<_>>());
    let chain = arm.build::<N>().unwrap();
    assert_eq!(chain.lower().as_slice(), reference.lower);
    assert_eq!(chain.upper().as_slice(), reference.upper);

    let double = worst(&chain, &reference.cases);
    println!("{name}, f64: {double:?}");
    assert!(double.position < 1e-9 && double.orientation < 1e-9 && double.jacobian < 1e-9);
    let single = worst(&chain.cast::<f32>(), &reference.cases);
    println!("{name}, f32: {single:?}");
    assert!(single.position < 1e-5 && single.orientation < 1e-4 && single.jacobian < 1e-4);
    frames_are_a_product_of_transforms(&reference, &arm, &chain);
}

/// Every frame, its origin among the landmarks, and the tip, against the plain product.
fn frames_are_a_product_of_transforms<const N: usize>(
    reference: &Reference,
    arm: &ChainDescription,
    chain: &Chain<f64, N>,
) {
    let joints: Vec<Joint<f64>> = arm.joints.iter().map(JointDescription::joint).collect();
    let joints: &[Joint<f64>; N] = joints.as_slice().try_into().unwrap();
    for case in &reference.cases {
        let q = case.q();
        let found = sinew::kinematics::frames(&Isometry3::identity(), joints, &q);
        let expected = frames(&Isometry3::identity(), joints, &q);
        for (found, expected) in found.iter().zip(&expected) {
            let (distance, angle) = apart(found, expected);
            assert!(distance < 1e-12 && angle < 1e-12, "{distance} {angle}");
        }
        let tip = found[N - 1] * arm.tip.isometry();
        let (distance, angle) = apart(&tip, &chain.forward(&q).tip_pose());
        assert!(distance < 1e-9 && angle < 1e-9, "{distance} {angle}");
    }
}

#[test]
fn panda_moves_as_pinocchio_says() {
    agrees_with_pinocchio::<7>("panda");
}

#[test]
fn ur5_moves_as_pinocchio_says() {
    agrees_with_pinocchio::<6>("ur5");
}

#[test]
fn so101_moves_as_pinocchio_says() {
    agrees_with_pinocchio::<5>("so101");
}

#[test]
fn iiwa7_moves_as_pinocchio_says() {
    agrees_with_pinocchio::<7>("iiwa7");
}
