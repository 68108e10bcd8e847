//! Motions over every stepper, every model, both tasks and every reach, each as a hash of all its bits.

use sinew::Error;
use sinew::chain::{Chain, human_arm};
use sinew::controller::{Controller, Limits};
use sinew::stepper::{
    AnyStepper, Damped, NormalisedTranspose, PseudoInverse, SelectivelyDamped, Transpose,
};
use sinew::synergy::Synergy;
use sinew::target::{Pose, Position, Target};

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
            each(
                stepper_name,
                model_name,
                "position",
                motion(&arm, stepper, synergy, &position, reach)?,
            );
            each(
                stepper_name,
                model_name,
                "pose",
                motion(&arm, stepper, synergy, &pose, reach)?,
            );
        }
    }
    Ok(())
}

/// FNV-1a over the bits of every joint after every tick (Fowler, Noll and Vo; RFC 9923).
#[inline(never)]
fn motion<const M: usize>(
    arm: &Chain<f32, 7>,
    stepper: AnyStepper<f32>,
    synergy: Synergy<f32, 7>,
    target: &impl Target<f32, M>,
    reach: &Reach,
) -> Result<u64, Error> {
    let rate = stepper.rate() as f32;
    let controller = Controller::new(arm, stepper, synergy, rate, PERIOD, Limits::Clamped)?;
    let mut state = controller.start(reach.start);
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    for _ in 0..TICKS {
        controller.tick(&mut state, target);
        for q in state.angles() {
            for byte in q.to_bits().to_le_bytes() {
                hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
    }
    Ok(hash)
}
