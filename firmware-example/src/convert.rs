//! From what the line carries to what the core takes. The core checks every number; here is only the translation.

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3, Vector4};
use sinew::Error;
use sinew::chain::{Chain, Joint, Kind};
use sinew::real::Real;
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Transpose,
};
use sinew::synergy;
use sinew_protocol::{self as wire, DOFS, Reason, Refusal};

use crate::arm::Style;

fn rotation([x, y, z, w]: [f32; 4]) -> UnitQuaternion<f32> {
    // The core refuses one that is not of unit length.
    Unit::new_unchecked(Quaternion::from_vector(Vector4::new(x, y, z, w)))
}

fn transform(t: &wire::Transform) -> Isometry3<f32> {
    Isometry3 {
        rotation: rotation(t.rotation),
        translation: Translation3 {
            vector: Vector3::from(t.translation),
        },
    }
}

/// A chain.
///
/// # Errors
/// What the core refuses.
pub fn chain(chain: &wire::Chain) -> Result<Chain<f32, DOFS>, Error> {
    let joints = chain.joints.map(|joint| Joint {
        kind: if joint.slides {
            Kind::Prismatic
        } else {
            Kind::Revolute
        },
        translation: Vector3::from(joint.translation),
        rotation: rotation(joint.rotation),
        axis: Vector3::from(joint.axis),
        lower: joint.lower,
        upper: joint.upper,
    });
    let mut landmarks = [0; DOFS];
    for (to, &from) in landmarks.iter_mut().zip(&chain.landmarks) {
        *to = usize::from(from);
    }
    let landmarks = landmarks.get(..chain.landmarks.len()).unwrap_or(&[]);
    Chain::new(
        &transform(&chain.base),
        &joints,
        &transform(&chain.tip),
        landmarks,
    )
}

/// A synergy with its stepper.
///
/// # Errors
/// What the core refuses.
pub fn style(synergy: &wire::Synergy) -> Result<Style, Error> {
    let model = match synergy.model {
        wire::Model::A => synergy::Model::A,
        wire::Model::B => synergy::Model::B,
        wire::Model::C => synergy::Model::C,
        wire::Model::D => synergy::Model::D,
    };
    let p = &synergy.parameters;
    let at = |k: usize| p.get(k).copied().unwrap_or(0.0);
    let middle = |offset: f32, slope: f32| if slope > 0.0 { offset / slope } else { 0.0 };
    let delay = match model {
        synergy::Model::A | synergy::Model::B => 0.0,
        synergy::Model::C => middle(at(DOFS), at(DOFS + 1)),
        synergy::Model::D => (0..DOFS).fold(0.0, |latest: f32, i| {
            latest.most(middle(at(DOFS + i), at(2 * DOFS + i)))
        }),
    };
    Ok(Style {
        stepper: stepper(synergy.stepper),
        rate: synergy.rate,
        synergy: synergy::Synergy::from_parameters(model, p)?,
        delay,
    })
}

/// A stepper with the core's default settings.
pub fn stepper(stepper: wire::Stepper) -> AnyStepper<f32> {
    match stepper {
        wire::Stepper::Transpose => AnyStepper::Transpose(Transpose),
        wire::Stepper::NormalisedTranspose => AnyStepper::NormalisedTranspose(NormalisedTranspose),
        wire::Stepper::PseudoInverse => AnyStepper::PseudoInverse(PseudoInverse),
        wire::Stepper::Damped => AnyStepper::Damped(Damped::default()),
        wire::Stepper::SelectivelyDamped => {
            AnyStepper::SelectivelyDamped(SelectivelyDamped::default())
        }
    }
}

/// What the line is told of an error.
pub fn refusal(error: Error) -> Refusal {
    let at = |joint: usize| u8::try_from(joint).ok();
    let (reason, joint) = match error {
        Error::NotFinite { joint, .. } => (Reason::NotFinite, joint.and_then(at)),
        Error::ZeroAxis { joint } => (Reason::ZeroAxis, at(joint)),
        Error::LimitsReversed { joint } => (Reason::LimitsReversed, at(joint)),
        Error::NoSuchLandmark { joint, .. } => (Reason::NoSuchLandmark, at(joint)),
        Error::WrongCount { .. } => (Reason::WrongCount, None),
        Error::OutOfRange { joint, .. } => (Reason::OutOfRange, joint.and_then(at)),
        _ => (Reason::OutOfRange, None),
    };
    Refusal::Invalid { reason, joint }
}
