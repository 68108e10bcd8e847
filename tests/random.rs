//! Random arms for property tests: 1 to 8 DoFs, revolute and prismatic, with axes, offsets and rotations as robots have
//! them (along an axis, by quarter turns, or none) and as nobody builds them.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use sinew::chain::{Chain, Joint, Kind};

use crate::frames;

/// A chain's description and a posture.
#[derive(Clone, Debug)]
pub struct Arm {
    /// T₀.
    pub base: Isometry3<f64>,
    /// The DoFs, base first.
    pub joints: Vec<Joint<f64>>,
    /// From the last DoF's frame to the tip.
    pub tip: Isometry3<f64>,
    /// The joint vector, not always within the limits.
    pub q: Vec<f64>,
}

impl Arm {
    /// The chain; all DoFs are landmarks.
    ///
    /// # Panics
    /// If it is not of N DoFs.
    pub fn chain<const N: usize>(&self) -> Chain<f64, N> {
        let landmarks: Vec<usize> = (0..N).collect();
        Chain::new(&self.base, &self.joints, &self.tip, &landmarks).unwrap()
    }

    /// The joint vector.
    ///
    /// # Panics
    /// If it is not of N DoFs.
    pub fn q<const N: usize>(&self) -> [f64; N] {
        self.q.as_slice().try_into().unwrap()
    }

    /// The tip's pose at `q`, as a plain product of transforms.
    pub fn tip_at(&self, q: &[f64]) -> Isometry3<f64> {
        let frames = frames(&self.base, &self.joints, q);
        frames.last().unwrap_or(&self.base) * self.tip
    }
}

/// Calls a function of the number of DoFs, N, for an arm's.
#[macro_export]
macro_rules! for_its_size {
    ($arm:expr, $f:ident($($argument:expr),*)) => {
        match $arm.joints.len() {
            1 => $f::<1>($($argument),*),
            2 => $f::<2>($($argument),*),
            3 => $f::<3>($($argument),*),
            4 => $f::<4>($($argument),*),
            5 => $f::<5>($($argument),*),
            6 => $f::<6>($($argument),*),
            7 => $f::<7>($($argument),*),
            _ => $f::<8>($($argument),*),
        }
    };
}

/// Arms whose parts are at most about a metre long.
pub fn arm() -> impl Strategy<Value = Arm> {
    let joints = prop::collection::vec((joint(), -3.0..3.0), 1..=8);
    (transform(), joints, transform()).prop_map(|(base, joints, tip)| {
        let (joints, q) = joints.into_iter().unzip();
        Arm {
            base,
            joints,
            tip,
            q,
        }
    })
}

fn joint() -> impl Strategy<Value = Joint<f64>> {
    let kind = prop_oneof![3 => Just(Kind::Revolute), 1 => Just(Kind::Prismatic)];
    (kind, transform(), axis(), -3.0..0.0, 0.0..3.0).prop_map(
        |(kind, place, axis, lower, upper)| Joint {
            kind,
            translation: place.translation.vector,
            rotation: place.rotation,
            axis,
            lower,
            upper,
        },
    )
}

fn axis() -> impl Strategy<Value = Vector3<f64>> {
    let along = (0usize..3, prop::bool::ANY).prop_map(|(k, against)| {
        let mut axis = Vector3::zeros();
        axis[k] = if against { -1.0 } else { 1.0 };
        axis
    });
    let general = vector(2.0).prop_filter("an axis has a direction", |v| v.norm() > 1e-3);
    prop_oneof![along, general]
}

/// A vector with elements up to `most` in magnitude.
pub fn vector(most: f64) -> impl Strategy<Value = Vector3<f64>> {
    [-most..most, -most..most, -most..most].prop_map(Vector3::from)
}

fn transform() -> impl Strategy<Value = Isometry3<f64>> {
    let translation = prop_oneof![
        Just(Vector3::zeros()),
        (0usize..3, -0.5..0.5).prop_map(|(k, by)| {
            let mut offset = Vector3::zeros();
            offset[k] = by;
            offset
        }),
        vector(0.5),
    ];
    (translation, rotation()).prop_map(|(t, r)| Isometry3::from_parts(t.into(), r))
}

/// A rotation: none, by quarter turns, or any.
pub fn rotation() -> impl Strategy<Value = UnitQuaternion<f64>> {
    let quarters = (0..4i32, 0..4i32, 0..4i32).prop_map(|(r, p, y)| {
        let quarter = |n: i32| f64::from(n) * FRAC_PI_2;
        UnitQuaternion::from_euler_angles(quarter(r), quarter(p), quarter(y))
    });
    prop_oneof![
        Just(UnitQuaternion::identity()),
        quarters,
        vector(3.0).prop_map(UnitQuaternion::from_scaled_axis),
    ]
}
