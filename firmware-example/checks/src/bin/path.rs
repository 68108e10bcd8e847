//! Whether an arm on a line moved as this host computes it, bit for bit:
//!
//!     path RECORD TELEMETRY X,Y,Z SECONDS
//!
//! with what `sinew export --format postcard` and `sinew play --csv` wrote, of an arm that began where it begins when it is
//! switched on, and planned for this target and time with its map.

use std::{env, fs, process::ExitCode};

use sinew_checks::say;
use sinew_firmware::arm::Arm;
use sinew_firmware::convert;
use sinew_firmware::pace::Pace;
use sinew_protocol::{DOFS, Limits, Record};

type Failure = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            say!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Failure> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [record, telemetry, target, seconds] = arguments.as_slice() else {
        return Err("path RECORD TELEMETRY X,Y,Z SECONDS".into());
    };
    let (record, _): (Record, _) = postcard::take_from_bytes(&fs::read(record)?)?;
    let chain = record.settings.chain.ok_or("no chain")?;
    let map = record.settings.map.ok_or("no map")?;
    let numbers: Result<Vec<f32>, _> = target.split(',').map(str::parse).collect();
    let target = <[f32; 3]>::try_from(numbers?.as_slice())?;

    let limits = Limits::DEFAULT;
    let mut arm = Arm::new(Pace::new(limits.speed, limits.acceleration))?;
    arm.set_chain(convert::chain(&chain)?);
    arm.set_planner(convert::planner(&map)?);
    let confidence = arm.reach(target, seconds.parse()?)?.ok_or("no map")?;

    let text = fs::read_to_string(telemetry)?;
    let mut compared = 0;
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let [ticks, mode, numbers @ ..] = cells.as_slice() else {
            return Err("a short line".into());
        };
        let ticks: u32 = ticks.parse()?;
        let angles: Result<Vec<f32>, _> = numbers.iter().take(DOFS).map(|x| x.parse()).collect();
        let there = <[f32; DOFS]>::try_from(angles?.as_slice())?.map(f32::to_bits);
        let same = |arm: &Arm| arm.angles().map(f32::to_bits) == there;
        while arm.ticks() < ticks && !arm.is_at_rest() {
            arm.tick();
        }
        // A motion that is over is not counted on while the arm still brakes.
        while *mode != "moving" && !same(&arm) && !arm.is_at_rest() {
            arm.tick();
        }
        if arm.ticks() != ticks || !same(&arm) {
            return Err(format!("another posture at tick {ticks}").into());
        }
        compared += 1;
    }
    say!(
        "confidence {confidence}: {compared} postures of {} ticks are the same",
        arm.ticks()
    );
    Ok(())
}
