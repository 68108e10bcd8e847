//! What goes wrong in practice, on the firmware in QEMU: each is refused, or ends in a still arm. A line each.
#![no_std]
#![no_main]

use cortex_m::peripheral::SCB;
use sinew_checks::say;
use sinew_firmware::RATE_HZ;
use sinew_firmware::board::Board;
use sinew_firmware::board::qemu::{Qemu, RamFlash};
use sinew_firmware::learned;
use sinew_firmware::node::Node;
use sinew_firmware::run::turn;
use sinew_firmware::servo::{Calibration, Channel};
use sinew_firmware::store::Store;
use sinew_protocol::{
    Chain, Envelope, Faults, Joint, Limits, MOST_FRAME, Map, Mode, Model, Reason, Receiver,
    Refusal, Reply, Report, Request, Settings, Stepper, Synergy, Transform, encode,
};

sinew_checks::entry!(all);

/// A posture with the elbow bent, and a target in front.
const START: [f32; 7] = [0.2, 0.1, 0.0, 1.2, 0.1, 0.0, 0.0];
const FRONT: [f32; 3] = [-0.05, 0.4, -0.1];

const STEPPERS: [(&str, Stepper, f32); 5] = [
    ("Jt", Stepper::Transpose, 100.0),
    ("NJt", Stepper::NormalisedTranspose, 10.0),
    ("J+", Stepper::PseudoInverse, 10.0),
    ("damped", Stepper::Damped, 10.0),
    ("selective", Stepper::SelectivelyDamped, 10.0),
];

/// The controller with a line to it.
struct Bench {
    node: Node<RamFlash>,
    sequence: u32,
}

type Outcome = Result<(), &'static str>;

fn check(holds: bool, what: &'static str) -> Outcome {
    if holds { Ok(()) } else { Err(what) }
}

impl Bench {
    /// With erased flash.
    fn new() -> Result<Self, &'static str> {
        erase()?;
        let mut bench = Bench::boot()?;
        bench.node.put(START);
        Ok(bench)
    }

    /// With the flash as it is.
    fn boot() -> Result<Self, &'static str> {
        let (_, store) = Qemu::start().ok_or("no board")?;
        let node = Node::new(store).map_err(|_| "no controller")?;
        Ok(Bench { node, sequence: 0 })
    }

    fn send(&mut self, bytes: &[u8]) -> Option<Envelope<Reply>> {
        let mut reply = [0; MOST_FRAME];
        let mut receiver = Receiver::new();
        let mut last = None;
        for &byte in bytes {
            for &byte in self.node.receive(byte, &mut reply).unwrap_or(&[]) {
                last = receiver.take(byte).or(last);
            }
        }
        last?.ok()
    }

    fn ask(&mut self, body: Request) -> Result<Reply, &'static str> {
        self.sequence += 1;
        let mut buffer = [0; MOST_FRAME];
        let request = Envelope {
            sequence: self.sequence,
            body,
        };
        let frame = encode(&request, &mut buffer).map_err(|_| "no frame")?;
        let reply = self.send(frame).ok_or("no reply")?;
        check(
            reply.sequence == self.sequence,
            "a reply to another request",
        )?;
        Ok(reply.body)
    }

    fn done(&mut self, body: Request) -> Outcome {
        check(self.ask(body)? == Reply::Done, "refused")
    }

    fn refused(&mut self, body: Request, why: Refusal) -> Outcome {
        let before = *self.node.arm().angles();
        let mode = self.node.arm().mode();
        check(
            self.ask(body)? == Reply::Refused(why),
            "not refused, or not for that",
        )?;
        check(
            *self.node.arm().angles() == before && self.node.arm().mode() == mode,
            "something changed",
        )
    }

    fn report(&mut self) -> Result<Report, &'static str> {
        match self.ask(Request::Report)? {
            Reply::Report(report) => Ok(report),
            _ => Err("no report"),
        }
    }

    /// Ticks, with a report often enough for the watchdog; each tick's steps are checked against the limits.
    fn run(&mut self, seconds: u32) -> Result<Motion, &'static str> {
        let mut motion = Motion::default();
        self.go_on(seconds * RATE_HZ, &mut motion)?;
        Ok(motion)
    }

    fn go_on(&mut self, ticks: u32, motion: &mut Motion) -> Outcome {
        for k in 0..ticks {
            let before = *self.node.arm().angles();
            self.node.tick();
            motion.see(&self.node, &before)?;
            if k % 100 == 0 {
                self.report()?;
            }
        }
        Ok(())
    }

    /// The bare stepper, so that nothing but the pace holds the arm back.
    fn take(&mut self, stepper: Stepper, rate: f32) -> Outcome {
        self.done(Request::LoadSynergy(synergy(stepper, rate)))
    }
}

fn erase() -> Outcome {
    use embedded_storage::nor_flash::{NorFlash, ReadNorFlash};
    let mut flash = RamFlash;
    let end = flash.capacity() as u32;
    flash.erase(0, end).map_err(|_| "no flash")
}

fn synergy(stepper: Stepper, rate: f32) -> Synergy {
    Synergy {
        stepper,
        rate,
        model: Model::A,
        parameters: [1.0].into_iter().collect(),
    }
}

/// A servo's finest step, radians: 1 µs of a pulse. To swing by less is not to shake.
const SWING: f32 = 1.6e-3;

/// What a motion did.
#[derive(Default)]
struct Motion {
    step: [f32; 7],
    /// The greatest change of a step, and the greatest step.
    change: f32,
    greatest: f32,
    /// How often a joint turned round and went back by more than [`SWING`]; where each was farthest, and which way it
    /// went.
    turns: u32,
    farthest: Option<[f32; 7]>,
    way: [f32; 7],
    /// Ticks since anything moved.
    still: u32,
}

impl Motion {
    fn see(&mut self, node: &Node<RamFlash>, before: &[f32; 7]) -> Outcome {
        let mut moved = false;
        for (i, &q) in node.arm().angles().iter().enumerate() {
            let step = q - before[i];
            self.change = self.change.max((step - self.step[i]).abs());
            self.greatest = self.greatest.max(step.abs());
            let farthest = self.farthest.get_or_insert(*before);
            if (q - farthest[i]) * self.way[i] > 0.0 || self.way[i] == 0.0 {
                farthest[i] = q;
                self.way[i] = step;
            } else if (q - farthest[i]).abs() > SWING {
                farthest[i] = q;
                self.way[i] = -self.way[i];
                self.turns += 1;
            }
            moved |= step != 0.0;
            self.step[i] = step;
            let (lower, upper) = (node.arm().chain().lower()[i], node.arm().chain().upper()[i]);
            check(lower <= q && q <= upper, "a joint left its limits")?;
        }
        self.still = if moved { 0 } else { self.still + 1 };
        Ok(())
    }

    /// Speed and acceleration, with two roundings of an angle up to π.
    fn within(&self, limits: &Limits) -> Outcome {
        const ROUNDING: f32 = 5e-7;
        let (speed, acceleration) = (self.greatest * 1e6, self.change * 1e9);
        say!(
            "  up to {} mrad/s, {} mrad/s2",
            speed as i32,
            acceleration as i32
        );
        check(self.greatest <= limits.speed * 1e-3 + ROUNDING, "too fast")?;
        check(
            self.change <= limits.acceleration * 1e-6 + ROUNDING,
            "too sudden",
        )
    }
}

fn a_reach_ends_at_its_target() -> Outcome {
    for (name, stepper, rate) in STEPPERS {
        let mut bench = Bench::new()?;
        bench.take(stepper, rate)?;
        bench.done(Request::GoTo(FRONT))?;
        let motion = bench.run(5)?;
        motion.within(&Limits::DEFAULT)?;
        let report = bench.report()?;
        say!(
            "  {}: {} um left after {} ms",
            name,
            (report.distance * 1e6) as i32,
            report.ticks
        );
        check(
            report.mode == Mode::Holding && report.distance < 2e-3,
            "not there",
        )?;
        check(motion.still > 500, "not still")?;
    }
    Ok(())
}

fn an_unreachable_target_ends_at_the_nearest_reach_without_shaking() -> Outcome {
    for (name, stepper, rate) in STEPPERS {
        let mut bench = Bench::new()?;
        bench.take(stepper, rate)?;
        // 10 km away, in front and above.
        bench.done(Request::GoTo([-2e3, 8e3, 6e3]))?;
        let motion = bench.run(8)?;
        motion.within(&Limits::DEFAULT)?;
        let report = bench.report()?;
        let [x, y, z] = report.tip;
        let reach = sinew::real::Real::sqrt(x * x + y * y + z * z);
        say!(
            "  {}: {} mm of 660, {} mm off, {} turns",
            name,
            (reach * 1e3) as i32,
            (report.distance * 1e3) as i32,
            motion.turns
        );
        check(
            report.mode == Mode::Holding && motion.still > 500,
            "not still",
        )?;
        check(report.distance < 0.02, "not at the nearest reach")?;
        check(
            report.faults.has(Faults::SHORT),
            "it does not say that it fell short",
        )?;
        check(motion.turns < 20, "it shook")?;
    }
    Ok(())
}

fn a_target_behind_a_joint_limit_ends_still_and_the_joint_stays_there() -> Outcome {
    for (name, stepper, rate) in STEPPERS {
        let mut bench = Bench::new()?;
        bench.take(stepper, rate)?;
        // At the shoulder itself: the elbow would have to bend beyond its limit.
        bench.done(Request::GoTo([0.0, 0.02, 0.0]))?;
        let motion = bench.run(8)?;
        motion.within(&Limits::DEFAULT)?;
        let report = bench.report()?;
        let elbow = (report.angles[3] - bench.node.arm().chain().upper()[3]).abs();
        say!(
            "  {}: elbow {} mrad off its limit, {} turns",
            name,
            (elbow * 1e3) as i32,
            motion.turns
        );
        check(
            report.mode == Mode::Holding && motion.still > 500,
            "not still",
        )?;
        check(
            report.faults.has(Faults::SHORT),
            "it does not say that it fell short",
        )?;
        check(motion.turns < 20, "it shook")?;
    }
    Ok(())
}

fn a_target_that_changes_in_mid_motion_makes_no_jump() -> Outcome {
    for (_, stepper, rate) in STEPPERS {
        let mut bench = Bench::new()?;
        bench.take(stepper, rate)?;
        let mut motion = Motion::default();
        let mut random = 1u32;
        for _ in 0..60 {
            let mut coordinate = || {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (random >> 16) as f32 / 65_536.0 - 0.5
            };
            let target = [coordinate(), coordinate(), coordinate()];
            bench.done(Request::GoTo(target))?;
            bench.go_on(50, &mut motion)?;
        }
        motion.within(&Limits::DEFAULT)?;
        check(motion.greatest > 1e-3, "it hardly moved")?;
    }
    Ok(())
}

fn a_silent_line_holds_the_arm() -> Outcome {
    let mut bench = Bench::new()?;
    bench.done(Request::GoTo(FRONT))?;
    let mut motion = Motion::default();
    for _ in 0..Limits::DEFAULT.silence_ms + 200 {
        let before = *bench.node.arm().angles();
        bench.node.tick();
        motion.see(&bench.node, &before)?;
    }
    motion.within(&Limits::DEFAULT)?;
    check(
        bench.node.arm().mode() == Mode::Holding && motion.still > 0,
        "it goes on",
    )?;
    check(
        bench.report()?.faults.has(Faults::SILENT),
        "it does not say so",
    )?;
    // The report may be lost.
    check(
        bench.report()?.faults == Faults::SILENT,
        "it says so only once",
    )?;
    bench.done(Request::GoTo(FRONT))?;
    check(
        bench.report()?.faults == Faults::default(),
        "the fault is told of the next motion",
    )
}

/// The board on a line that never ends to bring frames that are none.
struct Flooded(Qemu, bool);

impl Board for Flooded {
    const SERVOS: [Calibration; 7] = Qemu::SERVOS;
    const FRAME: f32 = Qemu::FRAME;

    fn wait(&mut self) -> bool {
        true
    }

    fn now(&self) -> u32 {
        self.0.now()
    }

    fn period(&self) -> u32 {
        self.0.period()
    }

    fn read(&mut self) -> Option<u8> {
        self.1 = !self.1;
        Some(u8::from(self.1))
    }

    fn write(&mut self, _: &[u8]) {}

    fn servos(&mut self) -> [Channel<'_>; 7] {
        self.0.servos()
    }
}

fn a_line_full_of_noise_does_not_keep_the_arm_from_its_ticks() -> Outcome {
    let mut bench = Bench::new()?;
    bench.done(Request::GoTo(FRONT))?;
    let mut board = Flooded(Qemu::start().ok_or("no board")?.0, false);
    for _ in 0..Limits::DEFAULT.silence_ms + 200 {
        turn(&mut board, &mut bench.node);
    }
    check(
        bench.node.arm().mode() == Mode::Holding,
        "noise keeps it going",
    )
}

fn no_number_is_the_last() -> Outcome {
    let mut bench = Bench::new()?;
    for number in [0x7fff_ffff, 0xffff_fffe] {
        bench.sequence = number - 1;
        bench.done(Request::GoTo(FRONT))?;
    }
    // Beyond the greatest there are more.
    let mut ask = |sequence, body| {
        let mut buffer = [0; MOST_FRAME];
        let frame = encode(&Envelope { sequence, body }, &mut buffer).map_err(|_| "no frame")?;
        Ok(bench.send(frame).map(|reply| reply.body))
    };
    for number in [0xffff_ffff, 0, 1] {
        check(
            ask(number, Request::Stop)? == Some(Reply::Done),
            "the line is locked",
        )?;
    }
    check(
        ask(0xffff_ffff, Request::Hold)? == Some(Reply::Refused(Refusal::Replayed(1))),
        "an old number was taken",
    )
}

fn a_slow_arm_arrives() -> Outcome {
    for speed in [0.01, 0.2] {
        let mut bench = Bench::new()?;
        let limits = Limits {
            speed,
            ..Limits::DEFAULT
        };
        bench.done(Request::SetLimits(limits))?;
        let [x, y, z] = bench.node.arm().tip();
        bench.done(Request::GoTo([x + 0.03, y, z]))?;
        let motion = bench.run(30)?;
        motion.within(&limits)?;
        let report = bench.report()?;
        check(
            report.mode == Mode::Holding && report.distance < 2e-3,
            "it gave up",
        )?;
    }
    Ok(())
}

fn a_sigmoid_that_never_comes_is_not_waited_for() -> Outcome {
    let mut bench = Bench::new()?;
    let mut late = synergy(Stepper::Transpose, 10.0);
    (late.model, late.parameters) = (Model::C, [1.0; 9].into_iter().collect());
    // Half way after a million seconds.
    if let Some(slope) = late.parameters.last_mut() {
        *slope = 1e-6;
    }
    bench.done(Request::LoadSynergy(late))?;
    bench.done(Request::GoTo(FRONT))?;
    bench.run(30)?;
    check(bench.node.arm().is_at_rest(), "it waits")
}

fn numbers_that_are_none_are_refused() -> Outcome {
    let mut bench = Bench::new()?;
    bench.done(Request::GoTo(FRONT))?;
    let mut motion = Motion::default();
    bench.go_on(200, &mut motion)?;
    let not_finite = Refusal::Invalid {
        reason: Reason::NotFinite,
        joint: None,
    };
    for wrong in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        bench.refused(Request::GoTo([0.1, wrong, 0.2]), not_finite)?;
    }
    bench.done(Request::Hold)?;
    bench.go_on(1000, &mut motion)?;
    let out_of_range = Refusal::Invalid {
        reason: Reason::OutOfRange,
        joint: None,
    };
    let mut wrong = synergy(Stepper::Damped, f32::NAN);
    bench.refused(Request::LoadSynergy(wrong.clone()), out_of_range)?;
    wrong.rate = 10.0;
    wrong.parameters = [f32::NAN].into_iter().collect();
    bench.refused(Request::LoadSynergy(wrong.clone()), out_of_range)?;
    wrong.model = Model::C;
    let wrong_count = Refusal::Invalid {
        reason: Reason::WrongCount,
        joint: None,
    };
    bench.refused(Request::LoadSynergy(wrong), wrong_count)?;
    let limits = Limits {
        speed: f32::NAN,
        ..Limits::DEFAULT
    };
    bench.refused(Request::SetLimits(limits), out_of_range)?;
    let limits = Limits {
        acceleration: -1.0,
        ..Limits::DEFAULT
    };
    bench.refused(Request::SetLimits(limits), out_of_range)
}

/// A straight arm of seven hinges.
fn chain() -> Chain {
    let here = Transform {
        translation: [0.0; 3],
        rotation: [0.0, 0.0, 0.0, 1.0],
    };
    let hinge = |i: u8| Joint {
        slides: false,
        translation: [0.0, 0.0, -0.1],
        rotation: here.rotation,
        axis: if i % 2 == 0 {
            [1.0, 0.0, 0.0]
        } else {
            [0.0, 1.0, 0.0]
        },
        lower: -2.0,
        upper: 2.0,
    };
    Chain {
        base: here,
        joints: [0, 1, 2, 3, 4, 5, 6].map(hinge),
        tip: Transform {
            translation: [0.0, 0.0, -0.1],
            ..here
        },
        landmarks: [0, 3, 5].into_iter().collect(),
    }
}

fn chains_that_are_none_are_refused() -> Outcome {
    let mut bench = Bench::new()?;
    let mut wrong = chain();
    wrong.joints[2].axis = [0.0; 3];
    let zero = Refusal::Invalid {
        reason: Reason::ZeroAxis,
        joint: Some(2),
    };
    bench.refused(Request::LoadChain(wrong), zero)?;
    let mut wrong = chain();
    wrong.joints[4].lower = 3.0;
    let reversed = Refusal::Invalid {
        reason: Reason::LimitsReversed,
        joint: Some(4),
    };
    bench.refused(Request::LoadChain(wrong), reversed)?;
    let mut wrong = chain();
    wrong.joints[0].rotation = [0.0; 4];
    let unturned = Refusal::Invalid {
        reason: Reason::OutOfRange,
        joint: Some(0),
    };
    bench.refused(Request::LoadChain(wrong), unturned)?;
    let mut wrong = chain();
    wrong.landmarks = [5, 3].into_iter().collect();
    let unordered = Refusal::Invalid {
        reason: Reason::NoSuchLandmark,
        joint: Some(3),
    };
    bench.refused(Request::LoadChain(wrong), unordered)?;
    bench.done(Request::LoadChain(chain()))?;
    bench.done(Request::GoTo([0.3, 0.3, -0.3]))?;
    bench.run(4)?;
    check(
        bench.report()?.distance < 2e-3,
        "the new chain does not get there",
    )
}

fn nothing_is_loaded_in_motion_and_nothing_moves_after_a_stop() -> Outcome {
    let mut bench = Bench::new()?;
    bench.done(Request::GoTo(FRONT))?;
    let mut motion = Motion::default();
    bench.go_on(200, &mut motion)?;
    bench.refused(Request::LoadChain(chain()), Refusal::Moving)?;
    bench.refused(Request::SetLimits(Limits::DEFAULT), Refusal::Moving)?;
    bench.done(Request::Stop)?;
    bench.go_on(1000, &mut motion)?;
    motion.within(&Limits::DEFAULT)?;
    check(motion.still > 500, "not still")?;
    bench.refused(Request::GoTo(FRONT), Refusal::Stopped)?;
    bench.done(Request::Hold)?;
    bench.done(Request::GoTo(FRONT))
}

/// The sample's map.
fn map() -> Result<Map, &'static str> {
    learned::SETTINGS.map.ok_or("no map")
}

/// With the arm and the map that were learned, in the posture to begin with.
fn mapped() -> Result<Bench, &'static str> {
    let mut bench = Bench::new()?;
    bench.done(Request::LoadChain(
        learned::SETTINGS.chain.ok_or("no chain")?,
    ))?;
    bench.done(Request::LoadMap(map()?))?;
    bench.node.put(learned::START);
    Ok(bench)
}

fn reach(target: [f32; 3]) -> Request {
    Request::Reach {
        target,
        seconds: 0.8,
    }
}

fn confidence(bench: &mut Bench, target: [f32; 3]) -> Result<f32, &'static str> {
    match bench.ask(reach(target))? {
        Reply::Reaching(confidence) => Ok(confidence),
        _ => Err("refused"),
    }
}

fn a_map_takes_the_hand_to_targets_not_learned_from() -> Outcome {
    // Between learned targets; then far from all of them, but within the arm's reach.
    for (target, near) in [
        ([0.2, 0.42, -0.1], true),
        ([-0.1, 0.5, -0.12], true),
        ([0.1, 0.45, 0.1], true),
        ([-0.05, 0.25, -0.5], false),
    ] {
        let mut bench = mapped()?;
        let told = confidence(&mut bench, target)?;
        let motion = bench.run(4)?;
        motion.within(&Limits::DEFAULT)?;
        let report = bench.report()?;
        say!(
            "  confidence {} %, {} um left after {} ms",
            (told * 100.0) as i32,
            (report.distance * 1e6) as i32,
            report.ticks
        );
        check((told > 0.0) == near && told < 1.0, "another confidence")?;
        check(
            report.mode == Mode::Holding && report.distance < 1e-2,
            "not there",
        )?;
    }
    let learned = map()?.targets;
    let mut bench = mapped()?;
    let told = confidence(&mut bench, *learned.first().ok_or("no target")?)?;
    check(told == 1.0, "a learned target is not trusted")
}

fn maps_that_are_none_are_refused() -> Outcome {
    let mut bench = Bench::new()?;
    bench.refused(reach(FRONT), Refusal::NoMap)?;
    let not = |reason| Refusal::Invalid {
        reason,
        joint: None,
    };
    let wrong = |edit: fn(&mut Map)| -> Result<Request, &'static str> {
        let mut wrong = map()?;
        edit(&mut wrong);
        Ok(Request::LoadMap(wrong))
    };
    for edit in [
        |map: &mut Map| map.coefficients.iter_mut().for_each(|x| *x = f32::NAN),
        |map: &mut Map| map.centre[0] = f32::INFINITY,
        |map: &mut Map| map.targets.iter_mut().for_each(|x| x[2] = f32::NAN),
        |map: &mut Map| map.radius = f32::NAN,
    ] {
        bench.refused(wrong(edit)?, not(Reason::NotFinite))?;
    }
    for edit in [
        |map: &mut Map| map.coefficients.clear(),
        |map: &mut Map| map.coefficients.truncate(20),
        |map: &mut Map| map.model = Model::C,
        |map: &mut Map| map.model = Model::A,
        |map: &mut Map| map.targets.clear(),
    ] {
        bench.refused(wrong(edit)?, not(Reason::WrongCount))?;
    }
    for edit in [
        |map: &mut Map| map.scale[1] = 0.0,
        |map: &mut Map| map.radius = -1.0,
        |map: &mut Map| map.rate = f32::NAN,
    ] {
        bench.refused(wrong(edit)?, not(Reason::OutOfRange))?;
    }
    bench.refused(reach(FRONT), Refusal::NoMap)?;
    // A map that is refused leaves the one before.
    bench.done(Request::LoadMap(map()?))?;
    bench.refused(wrong(|map| map.scale[0] = -1.0)?, not(Reason::OutOfRange))?;
    for seconds in [0.0, -1.0] {
        let target = FRONT;
        bench.refused(Request::Reach { target, seconds }, not(Reason::OutOfRange))?;
    }
    bench.refused(reach([0.1, f32::NAN, 0.2]), not(Reason::NotFinite))?;
    bench.refused(reach([0.1, f32::INFINITY, 0.2]), not(Reason::NotFinite))?;
    confidence(&mut bench, FRONT)?;
    bench.go_on(100, &mut Motion::default())?;
    bench.refused(Request::LoadMap(map()?), Refusal::Moving)?;
    bench.done(Request::Stop)?;
    bench.refused(reach(FRONT), Refusal::Stopped)
}

fn a_map_leaves_the_synergy_as_it_is() -> Outcome {
    // With a map and without, and with a reach of the map's before: the same bits.
    let mut ends = [[0; 7]; 2];
    for (with_map, end) in [false, true].into_iter().zip(&mut ends) {
        let mut bench = Bench::new()?;
        bench.take(Stepper::PseudoInverse, 10.0)?;
        if with_map {
            bench.done(Request::LoadMap(map()?))?;
            confidence(&mut bench, FRONT)?;
            bench.done(Request::Hold)?;
            bench.run(1)?;
        }
        bench.node.put(START);
        bench.done(Request::GoTo(FRONT))?;
        bench.go_on(300, &mut Motion::default())?;
        *end = bench.node.arm().angles().map(f32::to_bits);
    }
    check(ends[0] == ends[1], "another motion")
}

fn frames_that_are_none_change_nothing() -> Outcome {
    let mut bench = Bench::new()?;
    let before = *bench.node.arm().angles();
    let mut buffer = [0; MOST_FRAME];
    let request = Envelope {
        sequence: 1,
        body: Request::GoTo(FRONT),
    };
    let length = encode(&request, &mut buffer).map_err(|_| "no frame")?.len();
    let frame = buffer.get(..length).ok_or("no frame")?;
    let refused = |reply: Option<Envelope<Reply>>, why: Refusal| {
        check(
            reply.is_some_and(|r| r.body == Reply::Refused(why)),
            "not refused, or not for that",
        )
    };
    // Truncated at every byte.
    for end in 1..length - 1 {
        bench.send(frame.get(..end).unwrap_or(&[]));
        refused(bench.send(&[0]), Refusal::Garbled)?;
    }
    // Each byte wrong.
    for k in 0..length - 1 {
        let mut wrong = buffer;
        if let Some(byte) = wrong.get_mut(k) {
            *byte ^= 0x55;
        }
        if let Some(reply) = bench.send(wrong.get(..length).unwrap_or(&[])) {
            check(matches!(reply.body, Reply::Refused(_)), "noise was taken")?;
        }
    }
    // Too long, then noise.
    for _ in 0..4 * MOST_FRAME {
        bench.send(&[7]);
    }
    refused(bench.send(&[0]), Refusal::TooLong)?;
    let mut random = 12_345u32;
    for _ in 0..20_000 {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        if let Some(reply) = bench.send(&[(random >> 24) as u8]) {
            check(matches!(reply.body, Reply::Refused(_)), "noise was taken")?;
        }
    }
    bench.send(&[0]);
    check(
        *bench.node.arm().angles() == before && bench.node.arm().mode() == Mode::Holding,
        "it moved",
    )?;
    // Taken once, and no more.
    check(
        bench.send(frame).is_some_and(|r| r.body == Reply::Done),
        "refused",
    )?;
    refused(bench.send(frame), Refusal::Replayed(1))?;
    bench.sequence = 1;
    bench.done(Request::Hold)?;
    refused(bench.send(frame), Refusal::Replayed(2))?;
    check(
        bench.node.arm().mode() == Mode::Holding,
        "an old frame moved it",
    )
}

fn a_damaged_record_leaves_the_one_before() -> Outcome {
    use embedded_storage::nor_flash::NorFlash;
    let mut bench = Bench::new()?;
    let (slow, slower) = (
        Limits {
            speed: 1.0,
            ..Limits::DEFAULT
        },
        Limits {
            speed: 0.5,
            ..Limits::DEFAULT
        },
    );
    bench.done(Request::SetLimits(slow))?;
    bench.done(Request::SetLimits(slower))?;
    // The same again costs no erasure: the first record is still there.
    bench.done(Request::SetLimits(slower))?;
    // The second record is in the second page: clear bits in it, as a failing flash would.
    let page = Store::<RamFlash>::PAGE as u32;
    RamFlash.write(page + 8, &[0; 4]).map_err(|_| "no flash")?;
    let mut store = Store::new(RamFlash, [0, page]);
    check(
        store.load().is_some_and(|settings| settings.limits == slow),
        "not the one before",
    )?;
    RamFlash.write(8, &[0; 4]).map_err(|_| "no flash")?;
    let mut bench = Bench::boot()?;
    for _ in 0..2 {
        check(
            bench.report()?.faults.has(Faults::STORAGE),
            "it does not say that it lost its settings",
        )?;
    }
    bench.done(Request::SetLimits(slow))?;
    check(
        bench.report()?.faults == Faults::default(),
        "it says so though they are there again",
    )
}

fn stored_settings_that_are_not_valid_can_be_replaced() -> Outcome {
    erase()?;
    let (_, mut store) = Qemu::start().ok_or("no board")?;
    let settings = Settings {
        synergy: Some(synergy(Stepper::Transpose, 2e6)),
        ..Settings::default()
    };
    store.save(&settings).map_err(|_| "not saved")?;
    let mut bench = Bench::boot()?;
    check(
        bench.report()?.faults.has(Faults::STORAGE),
        "it does not say that they are not valid",
    )?;
    bench.done(Request::SetLimits(Limits::DEFAULT))?;
    let mut bench = Bench::boot()?;
    check(bench.report()?.faults == Faults::default(), "a fault")
}

fn an_arm_begins_within_the_limits_of_its_own_chain() -> Outcome {
    let mut bench = Bench::new()?;
    let mut bent = chain();
    bent.joints[3].lower = 0.5;
    bench.done(Request::LoadChain(bent))?;
    let bench = Bench::boot()?;
    check(
        bench.node.arm().angles()[3] == 0.5,
        "it is straight, which it cannot be",
    )
}

fn pulses_stay_within_the_servos_limits() -> Outcome {
    let servo = Calibration::COMMON.with_zero(1400.0).reversed();
    check(servo.pulse(0.0) == 1400.0, "not at zero")?;
    check(
        servo.pulse(0.5) < 1400.0 && servo.pulse(-0.5) > 1400.0,
        "not reversed",
    )?;
    check(
        servo.pulse(100.0) == 500.0 && servo.pulse(-100.0) == 2500.0,
        "beyond the limits",
    )?;
    check((500.0..=2500.0).contains(&servo.pulse(f32::NAN)), "NaN")
}

/// Saves everything, then resets the chip: [`after_a_reset`] goes on.
fn before_a_reset() -> Outcome {
    let mut bench = Bench::new()?;
    bench.done(Request::LoadChain(chain()))?;
    bench.done(Request::LoadSynergy(synergy(Stepper::Damped, 9.0)))?;
    bench.done(Request::LoadMap(map()?))?;
    bench.done(Request::SetLimits(Limits {
        speed: 1.0,
        acceleration: 10.0,
        silence_ms: 123,
    }))
}

fn after_a_reset() -> Outcome {
    let (_, mut store) = Qemu::start().ok_or("no board")?;
    let settings = store.load().ok_or("nothing was kept")?;
    check(settings.chain == Some(chain()), "another chain")?;
    check(
        settings.synergy == Some(synergy(Stepper::Damped, 9.0)),
        "another synergy",
    )?;
    check(settings.map == Some(map()?), "another map")?;
    check(settings.limits.silence_ms == 123, "other limits")?;
    let mut bench = Bench::boot()?;
    check(bench.report()?.faults == Faults::default(), "a fault")?;
    confidence(&mut bench, FRONT)?;
    check(
        bench.node.arm().chain().upper()[6] == 2.0,
        "the arm has another chain",
    )
}

fn all() -> bool {
    let Some((_, mut store)) = Qemu::start() else {
        return false;
    };
    if !store.is_blank() {
        return tell(
            "chain, synergy, map and limits survive a reset",
            after_a_reset,
        );
    }
    let tests: [(&str, fn() -> Outcome); 20] = [
        ("a reach ends at its target", a_reach_ends_at_its_target),
        (
            "an unreachable target ends at the nearest reach, without shaking",
            an_unreachable_target_ends_at_the_nearest_reach_without_shaking,
        ),
        (
            "a target behind a joint limit ends still, and no joint passes its limit",
            a_target_behind_a_joint_limit_ends_still_and_the_joint_stays_there,
        ),
        (
            "a target that changes in mid-motion makes no jump",
            a_target_that_changes_in_mid_motion_makes_no_jump,
        ),
        ("a slow arm arrives", a_slow_arm_arrives),
        (
            "a sigmoid that never comes is not waited for",
            a_sigmoid_that_never_comes_is_not_waited_for,
        ),
        ("a silent line holds the arm", a_silent_line_holds_the_arm),
        (
            "a line full of noise does not keep the arm from its ticks",
            a_line_full_of_noise_does_not_keep_the_arm_from_its_ticks,
        ),
        ("no number is the last", no_number_is_the_last),
        (
            "NaN and infinity are refused",
            numbers_that_are_none_are_refused,
        ),
        (
            "chains that are none are refused",
            chains_that_are_none_are_refused,
        ),
        (
            "a map takes the hand to targets not learned from, and says how far to trust it",
            a_map_takes_the_hand_to_targets_not_learned_from,
        ),
        (
            "maps that are none are refused",
            maps_that_are_none_are_refused,
        ),
        (
            "a map leaves the synergy as it is",
            a_map_leaves_the_synergy_as_it_is,
        ),
        (
            "nothing is loaded in motion, nothing moves after a stop",
            nothing_is_loaded_in_motion_and_nothing_moves_after_a_stop,
        ),
        (
            "garbage, truncated, oversized and replayed frames change nothing",
            frames_that_are_none_change_nothing,
        ),
        (
            "a damaged record leaves the one before",
            a_damaged_record_leaves_the_one_before,
        ),
        (
            "stored settings that are not valid can be replaced",
            stored_settings_that_are_not_valid_can_be_replaced,
        ),
        (
            "an arm begins within the limits of its own chain",
            an_arm_begins_within_the_limits_of_its_own_chain,
        ),
        (
            "pulses stay within the servos' limits",
            pulses_stay_within_the_servos_limits,
        ),
    ];
    let mut failed = 0;
    for (name, test) in tests {
        failed += u32::from(!tell(name, test));
    }
    if failed > 0 || before_a_reset().is_err() {
        return false;
    }
    SCB::sys_reset()
}

fn tell(name: &str, test: fn() -> Outcome) -> bool {
    match test() {
        Ok(()) => {
            say!("ok: {}", name);
            true
        }
        Err(why) => {
            say!("FAILED: {}: {}", name, why);
            false
        }
    }
}
