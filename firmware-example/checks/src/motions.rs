//! Motions over every stepper, every model, both tasks and every reach, and what a map plans, each as a hash of all its
//! bits.

use sinew::Error;
use sinew::chain::{Chain, human_arm};
use sinew::controller::{Controller, Limits};
use sinew::map::{INPUTS, MOST_PARAMETERS, Reach as Asked, SynergyMap, TERMS};
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Transpose,
};
use sinew::synergy::{Model, Paced, Synergy};
use sinew::target::{Pose, Position, Target};
use sinew_firmware::planner::Planner;
use sinew_firmware::{convert, learned};
use sinew_protocol::Settings;

/// A reach of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Reach {
    /// The recording.
    pub name: &'static str,
    /// Upper arm, forearm, hand; metres.
    pub lengths: [f64; 3],
    /// The first posture, radians.
    pub start: [f32; 7],
    /// The hand's last position from the shoulder, metres.
    pub target: [f32; 3],
    /// The hand's last orientation: a quaternion x, y, z, w.
    pub turned: [f32; 4],
}

include!(concat!(env!("OUT_DIR"), "/reaches.rs"));

/// Ticks of a motion: 16.7 s at 60 Hz, long past the arrival.
pub const TICKS: u32 = 1000;

/// The period, seconds.
pub const PERIOD: f32 = 1.0 / 60.0;

/// The steppers and their names.
pub fn steppers() -> [(&'static str, AnyStepper<f32>); 5] {
    [
        ("Jt", AnyStepper::Transpose(Transpose)),
        ("NJt", AnyStepper::NormalisedTranspose(NormalisedTranspose)),
        ("J+", AnyStepper::PseudoInverse(PseudoInverse)),
        ("damped", AnyStepper::Damped(Damped::default())),
        (
            "selective",
            AnyStepper::SelectivelyDamped(SelectivelyDamped::default()),
        ),
    ]
}

const GAINS: [f32; 7] = [1.0, 0.6, -0.3, 1.4, 0.2, 0.5, 0.1];

/// The models and their names.
///
/// # Errors
/// None: the parameters are valid.
pub fn synergies() -> Result<[(&'static str, Synergy<f32, 7>); 4], Error> {
    let offsets = [3.0, 4.0, 3.5, 5.0, 2.0, 6.0, 4.5];
    let slopes = [8.0, 9.0, 7.0, 10.0, 6.0, 5.0, 8.5];
    Ok([
        ("S_A", Synergy::a(0.8)?),
        ("S_B", Synergy::b(GAINS)?),
        ("S_C", Synergy::c(GAINS, 4.0, 8.0)?),
        ("S_D", Synergy::d(GAINS, offsets, slopes)?),
    ])
}

/// Runs every motion of a reach and tells `each` its name and hash.
///
/// # Errors
/// What the core refuses: nothing of a recording.
pub fn run(
    reach: &Reach,
    mut each: impl FnMut(&'static str, &'static str, &'static str, u64),
) -> Result<(), Error> {
    let [upper_arm, forearm, hand] = reach.lengths;
    let arm = human_arm::<f32>(upper_arm, forearm, hand)?;
    let position = Position::new(reach.target)?;
    let pose = Pose::new(reach.target, reach.turned)?;
    for (stepper_name, stepper) in steppers() {
        for (model_name, synergy) in synergies()? {
            let paced = synergy.paced(PERIOD)?;
            each(
                stepper_name,
                model_name,
                "position",
                motion(&arm, stepper, paced, &position, reach.start, EMPTY)?,
            );
            each(
                stepper_name,
                model_name,
                "pose",
                motion(&arm, stepper, paced, &pose, reach.start, EMPTY)?,
            );
        }
    }
    Ok(())
}

/// What was learned from the sample, as `sinew export` wrote it; where it is, a copy being a third of a small board's
/// memory.
static LEARNED: Settings = learned::SETTINGS;

/// The sample's map.
///
/// # Errors
/// None: there is one, and it is valid.
#[inline(never)]
pub fn sample() -> Result<Planner, Error> {
    let missing = Error::WrongCount {
        what: "maps",
        expected: 1,
        found: 0,
    };
    convert::planner(LEARNED.map.as_ref().ok_or(missing)?)
}

/// A map in which every term of every parameter of a model counts.
///
/// # Errors
/// None: its numbers are valid.
#[inline(never)]
pub fn full(model: Model, targets: &[[f32; 3]]) -> Result<Planner, Error> {
    let mut rows = [[0.0; TERMS]; MOST_PARAMETERS];
    for (k, row) in rows.iter_mut().enumerate() {
        for (j, coefficient) in row.iter_mut().enumerate() {
            *coefficient = 0.1 + 0.03 * ((7 * k + 3 * j) % 11) as f32;
        }
    }
    let rows = rows.get(..model.parameters(7)).unwrap_or(&[]);
    Ok(Planner {
        map: SynergyMap::new(model, [0.1; INPUTS], [0.3; INPUTS], rows, targets, 0.2)?,
        model,
        stepper: AnyStepper::Damped(Damped::default()),
        rate: 10.0,
    })
}

/// Plans for targets in the sample's region and out of it, with its map and with one in which every term counts, moves
/// by each, and tells `each` the map's name and a hash of parameters, confidence and motion.
///
/// # Errors
/// What the core refuses: nothing of this.
pub fn plans(mut each: impl FnMut(&'static str, u64)) -> Result<(), Error> {
    planned(&sample()?, |hash| each("sample", hash))?;
    planned(&full(Model::C, &KNOWN)?, |hash| each("full", hash))
}

/// Two targets learned from.
const KNOWN: [[f32; 3]; 2] = [[0.3, 0.3619, -0.22], [-0.22, 0.4635, -0.25]];

#[inline(never)]
fn planned(planner: &Planner, mut each: impl FnMut(u64)) -> Result<(), Error> {
    let Some(chain) = &LEARNED.chain else {
        return Ok(());
    };
    let arm = convert::chain(chain)?;
    let [known, other] = KNOWN;
    for k in 0..8u8 {
        // On the line through the two, and beyond either of them.
        let part = 0.25 * f32::from(k) - 0.5;
        let mut target = known;
        for (x, end) in target.iter_mut().zip(other) {
            *x += part * (end - *x);
        }
        let seconds = 0.6 + 0.1 * f32::from(k);
        let planned = planner.map.plan(&Asked { target, seconds })?;
        let numbers = planned.parameters.iter().chain([&planned.confidence]);
        let hash = numbers.fold(EMPTY, |hash, x| with(hash, *x));
        let (style, _) = planner.plan(target, seconds)?;
        let target = Position::new(target)?;
        let start = learned::START;
        each(motion(
            &arm,
            style.stepper,
            style.synergy,
            &target,
            start,
            hash,
        )?);
    }
    Ok(())
}

/// FNV-1a (Fowler, Noll and Vo; RFC 9923) of nothing.
const EMPTY: u64 = 0xcbf2_9ce4_8422_2325;

/// A number's bits, too.
fn with(hash: u64, x: f32) -> u64 {
    let bytes = x.to_bits().to_le_bytes();
    bytes.iter().fold(hash, |hash, &byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// A hash with the bits of every joint after every tick.
#[inline(never)]
fn motion<const M: usize>(
    arm: &Chain<f32, 7>,
    stepper: AnyStepper<f32>,
    synergy: Paced<f32, 7>,
    target: &impl Target<f32, M>,
    start: [f32; 7],
    mut hash: u64,
) -> Result<u64, Error> {
    let rate = stepper.rate() as f32;
    let controller = Controller::paced(arm, stepper, synergy, rate, Limits::Clamped)?;
    let mut state = controller.start(start);
    for _ in 0..TICKS {
        controller.tick(&mut state, target);
        hash = state.angles().iter().fold(hash, |hash, q| with(hash, *q));
    }
    Ok(hash)
}
