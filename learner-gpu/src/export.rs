//! A learned synergy for firmware: Rust constants, a flash page's record, or JSON.

use std::fmt::Write as _;

use sinew_protocol as wire;
use sinew_protocol::frame::CHECK;

use crate::chain::{ChainDescription, KindDescription, TransformDescription};
use crate::problem::{ModelKind, StepperKind};
use crate::synergies::{LearnedMotion, Synergies};

/// What an export is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// Constants to compile into a firmware
    Rust,
    /// The record that the firmware example keeps in a flash page
    Postcard,
    /// The same as text
    Json,
}

/// Why a synergy cannot be exported.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// There is no such motion.
    #[error("there is no motion {0}, counted from 0")]
    NoMotion(usize),
    /// The firmware's arm has another number of DoFs.
    #[error("the chain has {0} joints; the firmware example's arm has {dofs}", dofs = wire::DOFS)]
    Dofs(usize),
    /// The encoder refused it.
    #[error("{0}")]
    Encoding(String),
}

/// A motion's chain and synergy as the firmware's settings.
///
/// # Errors
/// No such motion, or a chain that is not of seven DoFs.
pub fn settings(synergies: &Synergies, motion: usize) -> Result<wire::Settings, ExportError> {
    let learned = synergies
        .motions
        .get(motion)
        .ok_or(ExportError::NoMotion(motion))?;
    Ok(wire::Settings {
        chain: Some(chain(synergies.chain_of(learned))?),
        synergy: Some(synergy(synergies, learned)?),
        limits: wire::Limits::DEFAULT,
    })
}

/// A motion in a format.
///
/// # Errors
/// As [`settings`]; or the encoder's.
pub fn export(
    synergies: &Synergies,
    motion: usize,
    format: Format,
) -> Result<Vec<u8>, ExportError> {
    let settings = settings(synergies, motion)?;
    let encoding = |error: &dyn std::fmt::Display| ExportError::Encoding(error.to_string());
    match format {
        Format::Json => serde_json::to_vec_pretty(&settings).map_err(|e| encoding(&e)),
        Format::Postcard => {
            let record = wire::Record {
                format: wire::FORMAT,
                count: 0,
                settings,
            };
            let mut bytes = postcard::to_stdvec(&record).map_err(|e| encoding(&e))?;
            bytes.extend(CHECK.checksum(&bytes).to_le_bytes());
            Ok(bytes)
        }
        Format::Rust => {
            let learned = synergies
                .motions
                .get(motion)
                .ok_or(ExportError::NoMotion(motion))?;
            rust(&settings, learned)
                .map_err(|e| encoding(&e))
                .map(String::into_bytes)
        }
    }
}

fn synergy(synergies: &Synergies, learned: &LearnedMotion) -> Result<wire::Synergy, ExportError> {
    let numbers: Vec<f32> = learned.parameters.iter().map(|&x| x as f32).collect();
    Ok(wire::Synergy {
        stepper: match synergies.stepper {
            StepperKind::Transpose => wire::Stepper::Transpose,
            StepperKind::NormalisedTranspose => wire::Stepper::NormalisedTranspose,
            StepperKind::PseudoInverse => wire::Stepper::PseudoInverse,
            StepperKind::Damped => wire::Stepper::Damped,
            StepperKind::SelectivelyDamped => wire::Stepper::SelectivelyDamped,
        },
        rate: synergies.lambda as f32,
        model: match learned.model {
            ModelKind::A => wire::Model::A,
            ModelKind::B => wire::Model::B,
            ModelKind::C => wire::Model::C,
            ModelKind::D => wire::Model::D,
        },
        parameters: numbers
            .as_slice()
            .try_into()
            .map_err(|_| ExportError::Dofs(numbers.len()))?,
    })
}

fn transform(t: &TransformDescription) -> wire::Transform {
    wire::Transform {
        translation: t.translation.map(|x| x as f32),
        rotation: t.rotation.map(|x| x as f32),
    }
}

fn chain(chain: &ChainDescription) -> Result<wire::Chain, ExportError> {
    let dofs = ExportError::Dofs(chain.joints.len());
    let joints: Vec<wire::Joint> = chain
        .joints
        .iter()
        .map(|joint| wire::Joint {
            slides: joint.kind == KindDescription::Prismatic,
            translation: joint.translation.map(|x| x as f32),
            rotation: joint.rotation.map(|x| x as f32),
            axis: joint.axis.map(|x| x as f32),
            lower: joint.lower as f32,
            upper: joint.upper as f32,
        })
        .collect();
    let landmarks = chain.landmarks.iter().map(|l| u8::try_from(l.joint));
    let landmarks: Vec<u8> = landmarks
        .collect::<Result<_, _>>()
        .map_err(|_| dofs.clone())?;
    Ok(wire::Chain {
        base: wire::Transform {
            translation: [0.0; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
        },
        joints: joints.try_into().map_err(|_| dofs.clone())?,
        tip: transform(&chain.tip),
        landmarks: landmarks.as_slice().try_into().map_err(|_| dofs)?,
    })
}

fn rust(settings: &wire::Settings, learned: &LearnedMotion) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    writeln!(
        text,
        "//! Learned from {}. For `sinew::synergy::Synergy::from_parameters`.\n",
        learned.file
    )?;
    if let Some(synergy) = &settings.synergy {
        writeln!(
            text,
            "/// The stepper it was learned with: `sinew::stepper::{:?}`, at this rate λ.",
            synergy.stepper
        )?;
        writeln!(text, "pub const RATE: f32 = {:?};\n", synergy.rate)?;
        writeln!(text, "/// The synergy model.")?;
        writeln!(
            text,
            "pub const MODEL: sinew::synergy::Model = sinew::synergy::Model::{:?};\n",
            synergy.model
        )?;
        writeln!(text, "/// Its parameters: gains, offsets, slopes (1/s).")?;
        let numbers = &synergy.parameters;
        writeln!(
            text,
            "pub const PARAMETERS: [f32; {}] = {:?};\n",
            numbers.len(),
            numbers.as_slice()
        )?;
    }
    let start: Vec<f32> = learned.initial_posture.iter().map(|&x| x as f32).collect();
    writeln!(text, "/// The posture it began with, radians.")?;
    writeln!(text, "pub const START: [f32; {}] = {start:?};", start.len())?;
    writeln!(
        text,
        "/// The target it was learned for, metres in the base frame."
    )?;
    writeln!(
        text,
        "pub const TARGET: [f32; 3] = {:?};",
        learned.target.map(|x| x as f32)
    )?;
    Ok(text)
}
