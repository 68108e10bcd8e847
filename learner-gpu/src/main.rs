//! The program `sinew`.

mod command;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Learns how a person's joints work together from recorded reaches, and synthesises reaches from what was learned.
///
/// `sinew learn` alone learns from the sample that ships with the project. Lengths are metres, angles radians, times
/// seconds; distances are printed in centimetres.
#[derive(Parser)]
#[command(version, propagate_version = true, max_term_width = 100)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Learn(command::learn::Arguments),
    Evaluate(command::evaluate::Arguments),
    Synthesize(command::synthesize::Arguments),
    Experiment(command::experiment::Arguments),
    Export(command::export::Arguments),
    Play(command::play::Arguments),
    Devices(command::devices::Arguments),
    Bench(command::bench::Arguments),
}

fn main() -> ExitCode {
    // Mesa's device selection prints an error where there is no desktop session. Without one it selects nothing anyway.
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: no other thread runs yet.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
    let outcome = match Arguments::parse().command {
        Command::Learn(arguments) => command::learn::run(&arguments),
        Command::Evaluate(arguments) => command::evaluate::run(&arguments),
        Command::Synthesize(arguments) => command::synthesize::run(&arguments),
        Command::Experiment(arguments) => command::experiment::run(&arguments),
        Command::Export(arguments) => command::export::run(&arguments),
        Command::Play(arguments) => command::play::run(&arguments),
        Command::Devices(arguments) => command::devices::run(&arguments),
        Command::Bench(arguments) => command::bench::run(&arguments),
    };
    match outcome {
        Ok(code) => code,
        Err(failure) => {
            command::tell!("{failure}");
            failure.code()
        }
    }
}
