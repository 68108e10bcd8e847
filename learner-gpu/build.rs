//! Composes every kernel for the human arm, validates it and translates it to SPIR-V, MSL and HLSL, so that no user's
//! driver is the first to see one. Nothing of it is kept: arms differ, and the program composes its own.

use std::fmt::Display;
use std::path::Path;

use naga::back::{hlsl, msl, spv};
use naga::valid::{Capabilities, ModuleInfo, ValidationFlags, Validator};
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Transpose,
};
use sinew::synergy::Model;

#[allow(dead_code)]
#[path = "src/kernel/compose.rs"]
mod compose;
#[allow(dead_code)]
#[path = "src/kernel/philox.rs"]
mod philox;
#[allow(dead_code)]
#[path = "src/kernel/proposal.rs"]
mod proposal;

use compose::{Composed, Method, Structure};

fn main() {
    println!("cargo:rerun-if-changed=src/kernel");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=SINEW_KERNELS");
    let steppers = [
        AnyStepper::Transpose(Transpose),
        AnyStepper::NormalisedTranspose(NormalisedTranspose),
        AnyStepper::PseudoInverse(PseudoInverse),
        AnyStepper::Damped(Damped::default()),
        AnyStepper::SelectivelyDamped(SelectivelyDamped::default()),
    ];
    let mut faults = 0;
    for stepper in steppers {
        for model in [Model::A, Model::B, Model::C, Model::D] {
            // Clamping changes two operands in one piece: one model of each stepper tries it.
            let method = Method {
                stepper,
                model,
                clamped: model == Model::B,
            };
            if let Err(fault) = check(&method) {
                faults += 1;
                let (stepper, model) = (method.stepper_name(), method.model_name().to_uppercase());
                for line in format!("kernel of stepper {stepper}, model S_{model}: {fault}").lines()
                {
                    println!("cargo::error={line}");
                }
            }
        }
    }
    if faults > 0 {
        std::process::exit(1);
    }
}

/// One kernel, all the way.
fn check(method: &Method) -> Result<(), String> {
    let arm =
        sinew::chain::human_arm::<f64>(0.29, 0.25, 0.09).map_err(|error| error.to_string())?;
    let structure =
        Structure::new(&[arm.cast::<f32>()], method).map_err(|error| error.to_string())?;
    // The shoulder is compared where it was recorded elsewhere: one model of each stepper tries that.
    let structure = structure.beyond(usize::from(method.model != Model::A));
    // Its data may be of two kinds: one model of each stepper tries the second.
    let window = (method.model == Model::C).then_some(4096);
    let kernel = compose::compose(&structure, window).map_err(|error| error.to_string())?;
    if let Some(folder) = std::env::var_os("SINEW_KERNELS") {
        // For who wants to read them.
        let name = format!("{}-{}.wgsl", method.stepper_name(), method.model_name());
        std::fs::write(Path::new(&folder).join(name), &kernel.source)
            .map_err(|error| error.to_string())?;
    }
    let module = naga::front::wgsl::parse_str(&kernel.source).map_err(|error| {
        let line = error.location(&kernel.source).map(|at| at.line_number);
        located(&kernel, line, error.message())
    })?;
    let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
    let info = validator.validate(&module).map_err(|error| {
        // The narrowest of the places that it names: the others are around it.
        let spans = error
            .spans()
            .filter_map(|(span, _)| Some((span.to_range()?.len(), span)));
        let narrowest = spans.min_by_key(|&(length, _)| length);
        let line = narrowest.map(|(_, span)| span.location(&kernel.source).line_number);
        located(&kernel, line, &causes(&error.into_inner()))
    })?;
    translate(&module, &info)
}

/// What is wrong, and where.
fn located(kernel: &Composed, line: Option<u32>, fault: &str) -> String {
    match line {
        Some(line) => {
            let (piece, text) = kernel.line(line as usize);
            format!("{fault}\n  in src/kernel/{piece}.wgsl, where it unrolls to: {text}")
        }
        None => fault.to_owned(),
    }
}

/// An error with all that led to it.
fn causes(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

/// SPIR-V for Vulkan, MSL for Metal, HLSL for Direct3D 12.
fn translate(module: &naga::Module, info: &ModuleInfo) -> Result<(), String> {
    let failed =
        |language: &str, error: &dyn Display| format!("cannot be written as {language}: {error}");
    spv::write_vec(module, info, &spv::Options::default(), None)
        .map_err(|error| failed("SPIR-V", &error))?;
    let options = msl::Options {
        fake_missing_bindings: true,
        lang_version: (2, 0),
        ..msl::Options::default()
    };
    msl::write_string(module, info, &options, &msl::PipelineOptions::default())
        .map_err(|error| failed("MSL", &error))?;
    let options = hlsl::Options {
        fake_missing_bindings: true,
        ..hlsl::Options::default()
    };
    let mut text = String::new();
    hlsl::Writer::new(&mut text, &options, &hlsl::PipelineOptions::default())
        .write(module, info, None)
        .map_err(|error| failed("HLSL", &error))?;
    Ok(())
}
