//! What the tests that reach across packages share.

pub mod random;
pub mod reaches;

use std::path::PathBuf;

use nalgebra::{Isometry3, Translation3, Unit};
use sinew::chain::{Joint, Kind};

/// A file or folder of `../shared` (recordings, robot models, reference numbers), which lies beside the repository and
/// not in it. Where it is not there, says so: the test that asked has nothing to test.
pub fn shared(path: &str) -> Option<PathBuf> {
    let shared = shared_folder();
    if shared.is_none() {
        println!("skipped: ../shared is not here");
    }
    Some(shared?.join(path))
}

/// `../shared`, where it is there.
pub fn shared_folder() -> Option<PathBuf> {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    shared.is_dir().then_some(shared)
}

/// Tᵢ of SPEC section 1 for every DoF, as a plain product of transforms: base · Π (Rᵢ, tᵢ)·motionᵢ(qᵢ).
pub fn frames(base: &Isometry3<f64>, joints: &[Joint<f64>], q: &[f64]) -> Vec<Isometry3<f64>> {
    let mut frame = *base;
    joints
        .iter()
        .zip(q)
        .map(|(joint, &q)| {
            let axis = Unit::new_normalize(joint.axis);
            let motion = match joint.kind {
                Kind::Revolute => Isometry3::rotation(axis.scale(q)),
                Kind::Prismatic => Translation3::from(axis.scale(q)).into(),
            };
            frame *= Isometry3::from_parts(joint.translation.into(), joint.rotation) * motion;
            frame
        })
        .collect()
}

/// How far two poses are apart, metres and radians.
pub fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    let distance = (a.translation.vector - b.translation.vector).norm();
    (distance, a.rotation.angle_to(&b.rotation))
}
