//! Requests and replies. Angles are radians, lengths metres, times seconds unless a name says otherwise.

/// The vector that messages hold, for who writes one out.
pub use heapless::Vec;
use serde::{Deserialize, Serialize};
use sinew::map::{INPUTS, MOST_TARGETS, TERMS};

/// Degrees of freedom (DoFs) of the arm: fixed, so that every buffer is.
pub const DOFS: usize = 7;

/// A message with its number. A reply bears its request's number, or 0 where that could not be read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Envelope<T> {
    /// Ahead of that of every request before it, by less than 2³¹: it wraps. The first is 1.
    pub sequence: u32,
    /// The message.
    pub body: T,
}

/// What a host asks for.
#[expect(
    clippy::large_enum_variant,
    reason = "there is no heap to box a chain or a map on"
)]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Request {
    /// How the arm is.
    Report,
    /// Take the tip to this point, metres in the base frame, with the synergy that is loaded. A motion that runs is
    /// changed without a jump.
    GoTo([f32; 3]),
    /// Brake and keep the posture. Also ends a stop.
    Hold,
    /// Brake, then leave the servos without pulses. Nothing moves again before [`Request::Hold`].
    Stop,
    /// Use this synergy from now on, and after a reset. Only at rest.
    LoadSynergy(Synergy),
    /// Use this chain from now on, and after a reset. Only at rest.
    LoadChain(Chain),
    /// Keep these limits from now on, and after a reset. Only at rest.
    SetLimits(Limits),
    /// Use this map from now on, and after a reset. Only at rest.
    LoadMap(Map),
    /// As [`Request::GoTo`], with the synergy that the map gives for this reach. The reply is [`Reply::Reaching`].
    Reach {
        /// The target, metres in the base frame.
        target: [f32; 3],
        /// How long a person would take.
        seconds: f32,
    },
}

/// What the controller answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Reply {
    /// It is done, or under way.
    Done,
    /// How the arm is.
    Report(Report),
    /// It was refused, and nothing changed.
    Refused(Refusal),
    /// It is under way, with a synergy of the map. How far to trust that: 1 at a target that the map was learned from,
    /// 0 at its radius from the nearest and beyond.
    Reaching(f32),
}

/// Why a request was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// No frame of this protocol: noise, or a truncated frame. Another version's is found out by what it holds, not always.
    Garbled,
    /// Longer than any frame of this protocol.
    TooLong,
    /// Its sequence number is not ahead of the last accepted one, which this is.
    Replayed(u32),
    /// What it carries is not valid.
    Invalid {
        /// What is wrong with it.
        reason: Reason,
        /// With which DoF, counted from 0 at the base.
        joint: Option<u8>,
    },
    /// Only possible at rest.
    Moving,
    /// Only possible after [`Request::Hold`].
    Stopped,
    /// The flash page did not take it.
    Storage,
    /// Only possible after [`Request::LoadMap`].
    NoMap,
}

/// What is wrong with a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reason {
    /// NaN or infinite.
    NotFinite,
    /// Outside what is accepted.
    OutOfRange,
    /// A DoF's axis has no direction.
    ZeroAxis,
    /// A lower limit above its upper one.
    LimitsReversed,
    /// A landmark on a DoF that is not there, or out of order.
    NoSuchLandmark,
    /// Too few or too many of something.
    WrongCount,
}

/// What the arm does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Mode {
    /// It keeps its posture.
    Holding,
    /// It goes to a target.
    Moving,
    /// It was stopped; at rest its servos get no pulses.
    Stopped,
}

/// What went wrong; a set of bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Faults(pub u8);

impl Faults {
    /// The line was silent for too long, and the arm was held; told until the next motion begins.
    pub const SILENT: Faults = Faults(1);
    /// The arm came to rest short of its target: this is the nearest it gets.
    pub const SHORT: Faults = Faults(1 << 1);
    /// A tick took longer than its period; told once.
    pub const OVERRUN: Faults = Faults(1 << 2);
    /// What the flash page held was not valid, and defaults are in use; told until something valid is saved.
    pub const STORAGE: Faults = Faults(1 << 3);

    /// Whether all of `other` are among these.
    pub const fn has(self, other: Faults) -> bool {
        self.0 & other.0 == other.0
    }

    /// Adds `other`.
    pub fn add(&mut self, other: Faults) {
        self.0 |= other.0;
    }

    /// Takes `other` away.
    pub fn remove(&mut self, other: Faults) {
        self.0 &= !other.0;
    }
}

/// How the arm is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What it does.
    pub mode: Mode,
    /// What went wrong.
    pub faults: Faults,
    /// Ticks since the present motion began.
    pub ticks: u32,
    /// The joint vector, as commanded to the servos; radians, of slides metres.
    pub angles: [f32; DOFS],
    /// Where the tip is, metres in the base frame.
    pub tip: [f32; 3],
    /// How far the tip is from its target, metres; 0 where there is none.
    pub distance: f32,
    /// What the last tick took, in the board's clock (instructions in QEMU, cycles on a chip).
    pub cost: u32,
    /// The most that a tick has taken since the last report.
    pub worst_cost: u32,
}

/// The stepper that a synergy was learned with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stepper {
    /// Jᵀ.
    Transpose,
    /// NJᵀ.
    NormalisedTranspose,
    /// J⁺.
    PseudoInverse,
    /// Damped least squares, with the core's default damping.
    Damped,
    /// Selectively damped least squares, with the core's default greatest angle.
    SelectivelyDamped,
}

/// The paper's models of a synergy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Model {
    /// One gain.
    A,
    /// A gain for each DoF.
    B,
    /// A gain for each DoF, one offset, one slope.
    C,
    /// A gain, an offset and a slope for each DoF.
    D,
}

/// A learned synergy and the stepper it belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Synergy {
    /// The stepper.
    pub stepper: Stepper,
    /// Its rate λ: 1/(m²·s) for Jᵀ, rad/s for NJᵀ, 1/s for the rest.
    pub rate: f32,
    /// The model.
    pub model: Model,
    /// Its parameters in the paper's order: gains, offsets, slopes (1/s).
    pub parameters: Vec<f32, { 3 * DOFS }>,
}

/// A learned map from reaches to synergies, as the core's `SynergyMap`, and the stepper it belongs to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Map {
    /// The stepper.
    pub stepper: Stepper,
    /// Its rate λ, as a synergy's.
    pub rate: f32,
    /// The model.
    pub model: Model,
    /// The middle of each input: the target's x, y and z, and the time.
    pub centre: [f32; INPUTS],
    /// What each input is divided by.
    pub scale: [f32; INPUTS],
    /// The coefficients, parameter by parameter, as many for each: of the core's terms the first. Those left out are 0,
    /// so that an affine map is a third as long as a quadratic one.
    pub coefficients: Vec<f32, { 3 * DOFS * TERMS }>,
    /// Targets it was learned from.
    pub targets: Vec<[f32; 3], MOST_TARGETS>,
    /// How far from these it is trusted.
    pub radius: f32,
}

/// No map is longer, in bytes: two enumerations, the numbers, and the lengths of two vectors.
pub const MOST_MAP: usize =
    2 + 4 * (1 + 2 * INPUTS + 3 * DOFS * TERMS + 3 * MOST_TARGETS + 1) + 2 * 3;

/// One DoF of a chain, as the core's `Joint`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Whether it slides (metres) instead of turning (radians).
    pub slides: bool,
    /// Where its frame lies in the frame before it, metres.
    pub translation: [f32; 3],
    /// How its frame is turned against the frame before it: a unit quaternion x, y, z, w.
    pub rotation: [f32; 4],
    /// Its axis in its own frame.
    pub axis: [f32; 3],
    /// The least q.
    pub lower: f32,
    /// The greatest q.
    pub upper: f32,
}

/// A fixed transform.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// Metres.
    pub translation: [f32; 3],
    /// A unit quaternion x, y, z, w.
    pub rotation: [f32; 4],
}

/// A chain's description.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Chain {
    /// From the base frame, in which targets are given, to the frame that the first DoF moves in.
    pub base: Transform,
    /// From base to tip.
    pub joints: [Joint; DOFS],
    /// From the last DoF's frame to the tip.
    pub tip: Transform,
    /// The DoFs whose origins are compared in a posture.
    pub landmarks: Vec<u8, DOFS>,
}

/// What the arm never exceeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Limits {
    /// Of every DoF: rad/s (or m/s), from 0.001 to 100.
    pub speed: f32,
    /// Of every DoF: rad/s² (or m/s²), from 0.01 to 10,000.
    pub acceleration: f32,
    /// After so long without an accepted frame a motion is held, milliseconds, at least 10.
    pub silence_ms: u32,
}

impl Limits {
    /// A brisk reach of a person stays below these.
    pub const DEFAULT: Limits = Limits {
        speed: 4.0,
        acceleration: 40.0,
        silence_ms: 500,
    };
}

/// What survives a reset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// The chain; none: the default arm.
    pub chain: Option<Chain>,
    /// The synergy; none: the bare controller.
    pub synergy: Option<Synergy>,
    /// The map; none: nothing to plan with.
    pub map: Option<Map>,
    /// The limits.
    pub limits: Limits,
}

impl Default for Settings {
    fn default() -> Self {
        Settings {
            chain: None,
            synergy: None,
            map: None,
            limits: Limits::DEFAULT,
        }
    }
}

/// Changes with a record's layout: a firmware refuses another's.
pub const FORMAT: u16 = 2;

/// No record is longer, its CRC-32C included, in bytes: a map, and a chain, a synergy and limits in the rest.
pub const MOST_RECORD: usize = MOST_MAP + 640;

/// Settings as a flash page holds them, followed by their CRC-32C (see [`crate::frame::CHECK`]).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// [`FORMAT`].
    pub format: u16,
    /// Counts the records written: the newest is the one that holds.
    pub count: u32,
    /// What survives a reset.
    pub settings: Settings,
}
