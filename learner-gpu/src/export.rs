//! A learned synergy, its chain and its map as the arm controller's settings: a Rust constant, a flash page's record, or
//! JSON.

use std::fmt::{self, Write as _};

use sinew::map::INPUTS;
use sinew_protocol as wire;
use sinew_protocol::frame::CHECK;

use crate::chain::{ChainDescription, ChainError, KindDescription, TransformDescription};
use crate::map::LearnedMap;
use crate::problem::{ModelKind, StepperKind};
use crate::synergies::{LearnedMotion, Synergies};

/// What an export is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Format {
    /// A constant to compile into a firmware
    Rust,
    /// The record that the firmware example keeps in a flash page
    Postcard,
    /// The same settings as text
    Json,
}

/// Why a synergy cannot be exported.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The chain is wrong, or the firmware's arm has another number of DoFs.
    #[error(transparent)]
    Chain(#[from] ChainError),
    /// The synergy is wrong.
    #[error("the synergy: {0}")]
    Synergy(#[from] sinew::Error),
    /// The map is wrong.
    #[error("the map: {0}")]
    Map(sinew::Error),
    /// The encoder refused it.
    #[error("{0}")]
    Encoding(String),
}

impl ExportError {
    fn encoding(error: impl fmt::Display) -> Self {
        ExportError::Encoding(error.to_string())
    }
}

/// A motion's chain and synergy and the file's map, with the default limits, as the controller takes them: each number
/// rounded once.
///
/// # Errors
/// A chain that is not of seven DoFs, or parameters or a map that the core refuses.
pub fn settings(
    synergies: &Synergies,
    motion: &LearnedMotion,
) -> Result<wire::Settings, ExportError> {
    Ok(wire::Settings {
        chain: Some(chain(synergies.chain_of(motion))?),
        synergy: Some(synergy(synergies, motion)?),
        map: synergies
            .map
            .as_ref()
            .map(|learned| map(synergies, learned))
            .transpose()?,
        limits: wire::Limits::DEFAULT,
    })
}

/// A motion in a format.
///
/// # Errors
/// As [`settings`]; or the encoder's.
pub fn export(
    synergies: &Synergies,
    motion: &LearnedMotion,
    format: Format,
) -> Result<Vec<u8>, ExportError> {
    let settings = settings(synergies, motion)?;
    match format {
        Format::Rust => rust(&settings, motion)
            .map(String::into_bytes)
            .map_err(ExportError::encoding),
        Format::Postcard => {
            let record = wire::Record {
                format: wire::FORMAT,
                count: 0,
                settings,
            };
            let mut bytes = postcard::to_stdvec(&record).map_err(ExportError::encoding)?;
            bytes.extend(CHECK.checksum(&bytes).to_le_bytes());
            Ok(bytes)
        }
        Format::Json => {
            let mut text = serde_json::to_vec_pretty(&settings).map_err(ExportError::encoding)?;
            text.push(b'\n');
            Ok(text)
        }
    }
}

fn synergy(synergies: &Synergies, motion: &LearnedMotion) -> Result<wire::Synergy, ExportError> {
    let parameters: Vec<f32> = motion.parameters.iter().map(|&x| x as f32).collect();
    sinew::synergy::Synergy::<f32, { wire::DOFS }>::from_parameters(
        motion.model.into(),
        &parameters,
    )?;
    Ok(wire::Synergy {
        stepper: stepper(synergies.stepper),
        rate: synergies.lambda as f32,
        model: model(motion.model),
        parameters: parameters
            .as_slice()
            .try_into()
            .map_err(|_| ExportError::encoding("too many parameters"))?,
    })
}

fn map(synergies: &Synergies, learned: &LearnedMap) -> Result<wire::Map, ExportError> {
    learned
        .build::<f32, { wire::DOFS }>()
        .map_err(ExportError::Map)?;
    let inputs = |values: &[f64]| -> [f32; INPUTS] {
        let mut out = [0.0; INPUTS];
        for (to, &from) in out.iter_mut().zip(values) {
            *to = from as f32;
        }
        out
    };
    // Terms that no parameter has are left out: an affine map is a third of a quadratic one.
    let rows = &learned.coefficients;
    let used = |row: &Vec<f64>| row.iter().rposition(|&x| x as f32 != 0.0);
    let terms = rows
        .iter()
        .filter_map(used)
        .max()
        .map_or(1, |last| last + 1);
    let coefficients = rows.iter().flat_map(|row| row.iter().take(terms));
    Ok(wire::Map {
        stepper: stepper(synergies.stepper),
        rate: synergies.lambda as f32,
        model: model(learned.model),
        centre: inputs(&learned.centre),
        scale: inputs(&learned.scale),
        // No more than there is room for: the map was built.
        coefficients: coefficients.map(|&x| x as f32).collect(),
        targets: learned
            .targets
            .iter()
            .map(|target| target.map(|x| x as f32))
            .collect(),
        radius: learned.radius as f32,
    })
}

fn stepper(stepper: StepperKind) -> wire::Stepper {
    match stepper {
        StepperKind::Transpose => wire::Stepper::Transpose,
        StepperKind::NormalisedTranspose => wire::Stepper::NormalisedTranspose,
        StepperKind::PseudoInverse => wire::Stepper::PseudoInverse,
        StepperKind::Damped => wire::Stepper::Damped,
        StepperKind::SelectivelyDamped => wire::Stepper::SelectivelyDamped,
    }
}

fn model(model: ModelKind) -> wire::Model {
    match model {
        ModelKind::A => wire::Model::A,
        ModelKind::B => wire::Model::B,
        ModelKind::C => wire::Model::C,
        ModelKind::D => wire::Model::D,
    }
}

fn transform(t: &TransformDescription) -> wire::Transform {
    wire::Transform {
        translation: t.translation.map(|x| x as f32),
        rotation: t.rotation.map(|x| x as f32),
    }
}

fn chain(chain: &ChainDescription) -> Result<wire::Chain, ExportError> {
    chain.build::<{ wire::DOFS }>()?;
    let mut joints = [wire::Joint {
        slides: false,
        translation: [0.0; 3],
        rotation: [0.0; 4],
        axis: [0.0; 3],
        lower: 0.0,
        upper: 0.0,
    }; wire::DOFS];
    for (to, joint) in joints.iter_mut().zip(&chain.joints) {
        *to = wire::Joint {
            slides: joint.kind == KindDescription::Prismatic,
            translation: joint.translation.map(|x| x as f32),
            rotation: joint.rotation.map(|x| x as f32),
            axis: axis(joint.axis),
            lower: joint.lower as f32,
            upper: joint.upper as f32,
        };
    }
    let landmarks = chain.landmarks.iter().map(|landmark| landmark.joint as u8);
    Ok(wire::Chain {
        base: wire::Transform {
            translation: [0.0; 3],
            rotation: [0.0, 0.0, 0.0, 1.0],
        },
        joints,
        tip: transform(&chain.tip),
        // No more than there are DoFs: the chain was built.
        landmarks: landmarks.take(wire::DOFS).collect(),
    })
}

/// An axis of any length, as long as an `f32` can hold.
fn axis(axis: [f64; 3]) -> [f32; 3] {
    let longest = axis.iter().fold(0.0f64, |longest, x| longest.max(x.abs()));
    match (1e-3..=1e3).contains(&longest) {
        true => axis.map(|x| x as f32),
        false => axis.map(|x| (x / longest) as f32),
    }
}

/// The constant's source, laid out as rustfmt leaves it alone. A float's `Debug` is the shortest literal that reads
/// back as the same bits.
fn rust(settings: &wire::Settings, motion: &LearnedMotion) -> Result<String, fmt::Error> {
    let mut text = String::new();
    let (Some(chain), Some(synergy)) = (&settings.chain, &settings.synergy) else {
        return Err(fmt::Error);
    };
    let map = settings.map.as_ref();
    let place = |t: &wire::Transform| {
        format!(
            "Transform {{ translation: {:?}, rotation: {:?} }}",
            t.translation, t.rotation
        )
    };
    let wire::Limits {
        speed,
        acceleration,
        silence_ms,
    } = settings.limits;
    writeln!(
        text,
        "//! Learned from {:?}; made by `sinew export`.",
        motion.file
    )?;
    writeln!(text)?;
    // As rustfmt has it: the names of a map's too are more than a line holds.
    text.push_str(match map {
        None => {
            "use sinew_protocol::{Chain, Joint, Limits, Model, Settings, Stepper, Synergy, Transform, Vec};\n\n\
             /// The chain and its synergy.\n"
        }
        Some(_) => {
            "use sinew_protocol::{\n    \
                 Chain, Joint, Limits, Map, Model, Settings, Stepper, Synergy, Transform, Vec,\n\
             };\n\n\
             /// The chain, its synergy and the map.\n"
        }
    });
    writeln!(text, "#[allow(clippy::approx_constant)]")?;
    writeln!(text, "#[rustfmt::skip]")?;
    writeln!(text, "pub const SETTINGS: Settings = Settings {{")?;
    writeln!(text, "    chain: Some(Chain {{")?;
    writeln!(text, "        base: {},", place(&chain.base))?;
    writeln!(text, "        joints: [")?;
    for joint in &chain.joints {
        let wire::Joint {
            slides,
            translation,
            rotation,
            axis,
            lower,
            upper,
        } = joint;
        writeln!(
            text,
            "            Joint {{ slides: {slides}, translation: {translation:?}, rotation: {rotation:?}, axis: {axis:?}, lower: {lower:?}, upper: {upper:?} }},"
        )?;
    }
    writeln!(text, "        ],")?;
    writeln!(text, "        tip: {},", place(&chain.tip))?;
    writeln!(
        text,
        "        landmarks: Vec::from_array({:?}),",
        chain.landmarks
    )?;
    writeln!(text, "    }}),")?;
    writeln!(text, "    synergy: Some(Synergy {{")?;
    writeln!(text, "        stepper: Stepper::{:?},", synergy.stepper)?;
    writeln!(text, "        rate: {:?},", synergy.rate)?;
    writeln!(text, "        model: Model::{:?},", synergy.model)?;
    writeln!(
        text,
        "        parameters: Vec::from_array({:?}),",
        synergy.parameters
    )?;
    writeln!(text, "    }}),")?;
    match map {
        Some(map) => map_constant(&mut text, map)?,
        None => writeln!(text, "    map: None,")?,
    }
    writeln!(
        text,
        "    limits: Limits {{ speed: {speed:?}, acceleration: {acceleration:?}, silence_ms: {silence_ms} }},"
    )?;
    writeln!(text, "}};")?;
    writeln!(text)?;
    let start: Vec<f32> = motion.initial_posture.iter().map(|&x| x as f32).collect();
    let target = motion.target.map(|x| x as f32);
    writeln!(
        text,
        "/// The posture that the motion begins with, radians (or metres)."
    )?;
    writeln!(text, "#[rustfmt::skip]")?;
    writeln!(text, "pub const START: [f32; {}] = {start:?};", start.len())?;
    writeln!(text)?;
    writeln!(
        text,
        "/// The target that it was learned for, metres in the base frame."
    )?;
    writeln!(text, "#[rustfmt::skip]")?;
    writeln!(text, "pub const TARGET: [f32; 3] = {target:?};")?;
    Ok(text)
}

/// The map's part of it.
fn map_constant(text: &mut String, map: &wire::Map) -> fmt::Result {
    let wire::Map {
        stepper,
        rate,
        model,
        centre,
        scale,
        coefficients,
        targets,
        radius,
    } = map;
    writeln!(text, "    map: Some(Map {{")?;
    writeln!(text, "        stepper: Stepper::{stepper:?},")?;
    writeln!(text, "        rate: {rate:?},")?;
    writeln!(text, "        model: Model::{model:?},")?;
    writeln!(text, "        centre: {centre:?},")?;
    writeln!(text, "        scale: {scale:?},")?;
    writeln!(
        text,
        "        coefficients: Vec::from_array({coefficients:?}),"
    )?;
    writeln!(text, "        targets: Vec::from_array({targets:?}),")?;
    writeln!(text, "        radius: {radius:?},")?;
    writeln!(text, "    }}),")
}
