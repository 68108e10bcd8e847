//! From what the line carries to what the core takes. The core checks every number; here is only the translation.

use nalgebra::{Isometry3, Quaternion, Translation3, Unit, UnitQuaternion, Vector3, Vector4};
use sinew::Error;
use sinew::chain::{Chain, Joint, Kind};
use sinew::map::{MOST_PARAMETERS, SynergyMap, TERMS};
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Transpose,
};
use sinew::synergy::{Model, Synergy};
use sinew_protocol::{self as wire, DOFS, Reason, Refusal};

use crate::arm::Style;
use crate::planner::Planner;

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
    let (model, parameters) = (model(synergy.model), &synergy.parameters);
    Style::new(
        stepper(synergy.stepper),
        synergy.rate,
        &Synergy::from_parameters(model, parameters)?,
        model,
        parameters,
    )
}

/// A map with its stepper.
///
/// # Errors
/// What the core refuses; coefficients that are not as many for each parameter, or more than there are terms.
pub fn planner(map: &wire::Map) -> Result<Planner, Error> {
    let model = model(map.model);
    let count = model.parameters(DOFS);
    let found = map.coefficients.len();
    let each = found / count;
    let mut rows = [[0.0; TERMS]; MOST_PARAMETERS];
    let rows = rows.get_mut(..count).unwrap_or(&mut []);
    if found != count * each || !(1..=TERMS).contains(&each) {
        return Err(Error::WrongCount {
            what: "coefficients",
            expected: count * each.clamp(1, TERMS),
            found,
        });
    }
    for (row, coefficients) in rows.iter_mut().zip(map.coefficients.chunks_exact(each)) {
        for (to, from) in row.iter_mut().zip(coefficients) {
            *to = *from;
        }
    }
    Ok(Planner {
        stepper: stepper(map.stepper),
        rate: map.rate,
        model,
        map: SynergyMap::new(model, map.centre, map.scale, rows, &map.targets, map.radius)?,
    })
}

fn model(model: wire::Model) -> Model {
    match model {
        wire::Model::A => Model::A,
        wire::Model::B => Model::B,
        wire::Model::C => Model::C,
        wire::Model::D => Model::D,
    }
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
