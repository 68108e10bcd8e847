//! Learned from "sample/reach_05.csv"; made by `sinew export`.

use sinew_protocol::{Chain, Joint, Limits, Model, Settings, Stepper, Synergy, Transform, Vec};

/// The chain and its synergy.
#[allow(clippy::approx_constant)]
#[rustfmt::skip]
pub const SETTINGS: Settings = Settings {
    chain: Some(Chain {
        base: Transform { translation: [0.0, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0] },
        joints: [
            Joint { slides: false, translation: [0.0, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0], axis: [1.0, 0.0, 0.0], lower: -1.0471976, upper: 3.1415927 },
            Joint { slides: false, translation: [0.0, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0], axis: [0.0, 1.0, 0.0], lower: -3.1415927, upper: 3.1415927 },
            Joint { slides: false, translation: [0.0, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0], axis: [0.0, 0.0, 1.0], lower: -1.5707964, upper: 1.5707964 },
            Joint { slides: false, translation: [0.0, 0.0, -0.29000643], rotation: [0.0, 0.0, 0.0, 1.0], axis: [1.0, 0.0, 0.0], lower: 0.0, upper: 2.6179938 },
            Joint { slides: false, translation: [0.0, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0], axis: [0.0, 0.0, 1.0], lower: -1.3962634, upper: 1.3962634 },
            Joint { slides: false, translation: [0.0, 0.0, -0.2499976], rotation: [0.0, 0.0, 0.0, 1.0], axis: [1.0, 0.0, 0.0], lower: -1.3962634, upper: 1.3962634 },
            Joint { slides: false, translation: [0.0, 0.0, 0.0], rotation: [0.0, 0.0, 0.0, 1.0], axis: [0.0, 1.0, 0.0], lower: -0.5235988, upper: 0.5235988 },
        ],
        tip: Transform { translation: [0.0, 0.0, -0.09000161], rotation: [0.0, 0.0, 0.0, 1.0] },
        landmarks: Vec::from_array([0, 3, 5]),
    }),
    synergy: Some(Synergy {
        stepper: Stepper::Damped,
        rate: 10.0,
        model: Model::C,
        parameters: Vec::from_array([2.0967398, 0.46380997, 2.3564577, 0.97330475, 5.0, 4.999999, -0.97218895, 4.4005656, 10.0]),
    }),
    limits: Limits { speed: 4.0, acceleration: 40.0, silence_ms: 500 },
};

/// The posture that the motion begins with, radians (or metres).
#[rustfmt::skip]
pub const START: [f32; 7] = [-0.38892102, -0.22818677, 0.15495658, 1.9012849, 7.939127e-5, 0.16260199, 0.119234376];

/// The target that it was learned for, metres in the base frame.
#[rustfmt::skip]
pub const TARGET: [f32; 3] = [0.29996666, 0.3619, -0.22];
