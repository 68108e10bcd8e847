//! What the arm controller is given: the firmware's own code reads it, and moves by it as the host does. `sinew play`
//! talks to that code over TCP here; `firmware-example/test` has it on a microcontroller.

use std::convert::Infallible;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use sinew::controller::{Controller, Limits};
use sinew::map::Reach;
use sinew::synergy::Synergy;
use sinew::target::Position;
use sinew_firmware::arm::NEAR;
use sinew_firmware::node::Node;
use sinew_firmware::store::Store;
use sinew_firmware::{convert, learned};
use sinew_learn::export::{Format, export, settings};
use sinew_learn::kernel::score::Ready;
use sinew_learn::play::{PlayError, Port};
use sinew_learn::problem::ModelKind;
use sinew_learn::synergies::Synergies;
use sinew_learn::task::Task;
use sinew_protocol::frame::CHECK;
use sinew_protocol::{
    Envelope, Faults, MOST_FRAME, MOST_REPLY, Receiver, Record, Refusal, Reply, Request, Settings,
    encode,
};

fn firmware() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware-example")
}

/// What the firmware example ships with.
fn shipped() -> Synergies {
    Synergies::read(&firmware().join("learned.json")).unwrap()
}

/// Two pages of flash.
struct Flash([u8; 2 * PAGE]);

const PAGE: usize = Store::<Flash>::PAGE;

impl Flash {
    fn with(record: &[u8]) -> Store<Flash> {
        let mut bytes = [0xff; 2 * PAGE];
        bytes[..record.len()].copy_from_slice(record);
        Store::new(Flash(bytes), [0, PAGE as u32])
    }
}

impl ErrorType for Flash {
    type Error = Infallible;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Infallible> {
        bytes.copy_from_slice(&self.0[offset as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.len()
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = 1024;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Infallible> {
        self.0[from as usize..to as usize].fill(0xff);
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Infallible> {
        self.0[offset as usize..][..bytes.len()].copy_from_slice(bytes);
        Ok(())
    }
}

/// Every bit of the numbers, which `==` does not tell (0 and −0).
fn bits(settings: &Settings) -> Vec<u8> {
    postcard::to_stdvec(settings).unwrap()
}

#[test]
fn the_firmwares_constant_is_what_export_writes_and_holds_the_same_bits() {
    let synergies = shipped();
    let text = export(&synergies, &synergies.motions[0], Format::Rust).unwrap();
    let committed = std::fs::read_to_string(firmware().join("src/learned.rs")).unwrap();
    assert_eq!(String::from_utf8(text).unwrap(), committed);
    let wanted = settings(&synergies, &synergies.motions[0]).unwrap();
    assert_eq!(bits(&learned::SETTINGS), bits(&wanted));
}

#[test]
fn the_firmware_reads_the_record_from_its_flash() {
    let synergies = shipped();
    let motion = &synergies.motions[0];
    let record = export(&synergies, motion, Format::Postcard).unwrap();
    let wanted = settings(&synergies, motion).unwrap();
    let found = Flash::with(&record).load().unwrap();
    assert_eq!(bits(&found), bits(&wanted));
    let node = Node::new(Flash::with(&record)).unwrap();
    let host = synergies.chain_of(motion).build::<7>().unwrap();
    assert_eq!(*node.arm().chain(), host.cast());
    for bit in 0..8 * record.len() {
        let mut damaged = record.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(Flash::with(&damaged).load().is_none(), "bit {bit}");
    }
}

#[test]
fn a_record_of_another_layout_is_refused() {
    let settings = settings(&shipped(), &shipped().motions[0]).unwrap();
    let checked = |mut bytes: Vec<u8>| {
        bytes.extend(CHECK.checksum(&bytes).to_le_bytes());
        bytes
    };
    // The layout before there were maps; and its number on this one's.
    let Settings {
        chain,
        synergy,
        limits,
        ..
    } = &settings;
    let before = postcard::to_stdvec(&(1u16, 0u32, chain, synergy, limits)).unwrap();
    let record = |format| Record {
        format,
        count: 0,
        settings: settings.clone(),
    };
    let number = postcard::to_stdvec(&record(1)).unwrap();
    for bytes in [before, number].map(checked) {
        assert!(Flash::with(&bytes).load().is_none());
        let mut node = Node::new(Flash::with(&bytes)).unwrap();
        assert!(report(&mut node).faults.has(Faults::STORAGE));
    }
    let present = postcard::to_stdvec(&record(sinew_protocol::FORMAT)).unwrap();
    assert!(Flash::with(&checked(present)).load().is_some());
}

fn report(node: &mut Node<Flash>) -> sinew_protocol::Report {
    let request = Envelope {
        sequence: 1,
        body: Request::Report,
    };
    let (mut there, mut back) = ([0; 64], [0; MOST_REPLY]);
    let frame = encode(&request, &mut there).unwrap();
    let mut receiver = Receiver::new();
    for &byte in frame.iter() {
        for &byte in node.receive(byte, &mut back).unwrap_or(&[]) {
            if let Some(Ok(Envelope {
                body: Reply::Report(report),
                ..
            })) = receiver.take(byte)
            {
                return report;
            }
        }
    }
    panic!("no report")
}

#[test]
fn the_firmware_plans_what_the_map_gives_on_the_host() {
    let synergies = shipped();
    let learned = synergies.map.as_ref().unwrap();
    let host = learned.build::<f32, 7>().unwrap();
    let settings = settings(&synergies, &synergies.motions[0]).unwrap();
    let there = convert::planner(&settings.map.unwrap()).unwrap();
    let apart = |a: f64, b: f64| (a - b).abs();
    for step in 0..100 {
        // A line through the region, and out of it on both sides.
        let part = f64::from(step) / 99.0;
        let (target, seconds) = ([0.8 * part - 0.4, 0.5 - 0.2 * part, 0.0], 0.5 + part);
        let (parameters, confidence) = learned.plan(7, target, seconds).unwrap();
        let reach = Reach {
            target: target.map(|x| x as f32),
            seconds: seconds as f32,
        };
        let [host, there] = [&host, &there.map].map(|map| map.plan(&reach).unwrap());
        let bits = |planned: &[f32]| planned.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&host.parameters), bits(&there.parameters));
        assert_eq!(host.confidence.to_bits(), there.confidence.to_bits());
        assert!(apart(confidence, f64::from(there.confidence)) < 1e-5);
        for (&wanted, &found) in parameters.iter().zip(&there.parameters) {
            assert!(apart(wanted, f64::from(found)) < 1e-4, "{wanted}, {found}");
        }
    }
}

#[test]
fn json_holds_the_same_bits() {
    let synergies = shipped();
    let text = export(&synergies, &synergies.motions[0], Format::Json).unwrap();
    let found: Settings = serde_json::from_slice(&text).unwrap();
    let wanted = settings(&synergies, &synergies.motions[0]).unwrap();
    assert_eq!(bits(&found), bits(&wanted));
}

#[test]
fn the_firmwares_constant_moves_bit_for_bit_as_the_host_does_in_f32() {
    const FRAMES: usize = 1001;
    let synergies = shipped();
    let motion = &synergies.motions[0];
    let task = Task {
        name: motion.file.clone(),
        chain: synergies.chain_of(motion).clone(),
        initial: motion.initial_posture.clone(),
        target: motion.target,
        reference: Vec::new(),
        misfit: 0.0,
    };
    let parameters: Vec<f32> = motion.parameters.iter().map(|&x| x as f32).collect();
    let mut host = Vec::new();
    Ready::<f32, 7>::new(&task)
        .unwrap()
        .synthesise(
            &synergies.settings(motion),
            &parameters,
            FRAMES,
            |_, _, q| host.push(q.map(f32::to_bits)),
        )
        .unwrap();

    let chain = convert::chain(&learned::SETTINGS.chain.unwrap()).unwrap();
    let exported = learned::SETTINGS.synergy.unwrap();
    let style = convert::style(&exported).unwrap();
    let model = synergies.settings(motion).model.into();
    let synergy = Synergy::from_parameters(model, &exported.parameters).unwrap();
    let period = (1.0 / synergies.rate_hz) as f32;
    let controller = Controller::new(
        &chain,
        style.stepper,
        synergy,
        style.rate,
        period,
        Limits::Clamped,
    )
    .unwrap();
    let target = Position::new(learned::TARGET).unwrap();
    let mut state = controller.start(learned::START);
    for (tick, there) in host.iter().enumerate() {
        assert_eq!(state.angles().map(f32::to_bits), *there, "tick {tick}");
        controller.tick(&mut state, &target);
    }
    let tip = chain.forward(state.angles()).tip();
    assert!((0..3).all(|r| (tip[r] - learned::TARGET[r]).abs() < NEAR));
}

fn sinew(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sinew"));
    command.args(arguments).output().unwrap()
}

/// Exit code and words of the message.
fn ends(output: &Output, code: i32, words: &[&str]) {
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{message}");
    for word in words {
        assert!(message.contains(word), "{word:?} is not in: {message}");
    }
    assert!(!message.contains("panicked"), "{message}");
}

#[test]
fn the_program_writes_what_the_library_exports() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("record");
    let (file, synergies) = (firmware().join("learned.json"), shipped());
    let file = file.to_str().unwrap();
    for (name, format) in [
        ("rust", Format::Rust),
        ("postcard", Format::Postcard),
        ("json", Format::Json),
    ] {
        let wanted = export(&synergies, &synergies.motions[0], format).unwrap();
        let output = sinew(&["export", file, "--format", name, "--motion", "reach_05"]);
        ends(&output, 0, &["reach_05.csv"]);
        assert_eq!(output.stdout, wanted);
        let there = out.to_str().unwrap();
        ends(
            &sinew(&["export", file, "--format", name, "--out", there]),
            0,
            &[],
        );
        assert_eq!(std::fs::read(&out).unwrap(), wanted);
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn what_cannot_be_exported_or_played_is_refused_and_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let changed = |name: &str, change: &dyn Fn(&mut Synergies)| {
        let mut synergies = shipped();
        change(&mut synergies);
        let path = folder.path().join(name);
        synergies.write(&path).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let rust = |file: &str| sinew(&["export", file, "--format", "rust"]);
    let short = changed("short.json", &|synergies| {
        synergies.map = None;
        synergies.chain.joints.pop();
        let motion = &mut synergies.motions[0];
        motion.initial_posture.pop();
        (motion.model, motion.parameters) = (ModelKind::A, vec![1.0]);
    });
    ends(&rust(&short), 2, &["short.json", "6 joints", "7"]);
    let large = changed("large.json", &|synergies| {
        synergies.motions[0].parameters[2] = 1e300;
    });
    ends(&rust(&large), 2, &["large.json", "synergy"]);
    let thrown = changed("thrown.json", &|synergies| {
        synergies.motions[0].initial_posture[0] = 1e300;
    });
    ends(&rust(&thrown), 2, &["thrown.json", "initial_posture"]);
    let slow = changed("slow.json", &|synergies| synergies.lambda = 1e-300);
    ends(&rust(&slow), 2, &["slow.json", "lambda"]);
    let flat = changed("flat.json", &|synergies| {
        synergies.map.as_mut().unwrap().scale[0] = 1e-60;
    });
    ends(&rust(&flat), 2, &["flat.json", "the map"]);
    let empty = changed("empty.json", &|synergies| synergies.motions.clear());
    ends(&rust(&empty), 2, &["no motions"]);
    ends(&rust("nowhere.json"), 2, &["nowhere.json"]);

    let file = changed("synergies.json", &|_| ());
    let unknown = sinew(&["export", &file, "--format", "rust", "--motion", "reach_99"]);
    ends(&unknown, 2, &["reach_99"]);
    ends(
        &sinew(&["export", &file, "--format", "elf"]),
        2,
        &["postcard"],
    );
    let unwritable = folder.path().join("nowhere/blob");
    let unwritable = unwritable.to_str().unwrap();
    ends(
        &sinew(&["export", &file, "--format", "json", "--out", unwritable]),
        2,
        &["nowhere"],
    );

    let play =
        |port: &str, target: &str| sinew(&["play", &file, "--port", port, "--target", target]);
    ends(&play("/nowhere", "0,0,0"), 2, &["/nowhere"]);
    ends(&play(&file, "0,0,0"), 2, &["synergies.json"]);
    ends(&play("localhost:port", "0,0,0"), 2, &["localhost:port"]);
    ends(&play("127.0.0.1:1", "0,0,0"), 2, &["127.0.0.1:1"]);
    ends(&play("127.0.0.1:1", "0,0"), 2, &["three numbers"]);
    ends(&play("127.0.0.1:1", "0,0,NaN"), 2, &["NaN"]);
    ends(&play("127.0.0.1:1", "0,0,1e300"), 2, &["metres"]);
    ends(&play("127.0.0.1:1", "-1e9,0,1e39"), 2, &["metres"]);
    let nowhere = ["play", "--port", "127.0.0.1:1", "--target", "0,0,0"];
    let nowhere = [&nowhere[..], &["--csv", "/nowhere/telemetry.csv"]].concat();
    ends(&sinew(&nowhere), 2, &["/nowhere/telemetry.csv"]);
    let bare = changed("bare.json", &|synergies| synergies.map = None);
    let timed = |more: &[&str]| {
        let timed = [
            "play",
            "--port",
            "127.0.0.1:1",
            "--target",
            "0,0,0",
            "--seconds",
        ];
        sinew(&[&timed, more].concat())
    };
    ends(&timed(&["1", &bare]), 2, &["--seconds", "no map"]);
    ends(&timed(&["0", &file]), 2, &["seconds"]);
    ends(
        &timed(&["1", &file, "--motion", "reach_05"]),
        2,
        &["--motion"],
    );
    let alone = [
        "play", "--motion", "reach_05", "--port", "x:1", "--target", "0,0,0",
    ];
    ends(&sinew(&alone), 2, &["SYNERGIES.json"]);
}

/// The firmware's controller behind a TCP port, in about real time, until dropped.
struct Controlled {
    port: String,
    over: Arc<AtomicBool>,
    tip: Arc<Mutex<[f32; 3]>>,
}

impl Controlled {
    fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().to_string();
        let over = Arc::new(AtomicBool::new(false));
        let tip: Arc<Mutex<[f32; 3]>> = Arc::default();
        let (ended, at) = (Arc::clone(&over), Arc::clone(&tip));
        thread::spawn(move || {
            let mut node = Node::new(Flash::with(&[])).unwrap();
            for line in listener.incoming() {
                serve(&mut node, &mut line.unwrap(), &ended);
                *at.lock().unwrap() = node.arm().tip();
                if ended.load(Ordering::Relaxed) {
                    break;
                }
            }
        });
        Controlled { port, over, tip }
    }
}

impl Drop for Controlled {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        // Wakes the one that waits for a line.
        let _ = TcpStream::connect(&self.port);
    }
}

/// A host's line until it goes.
fn serve(node: &mut Node<Flash>, line: &mut TcpStream, over: &AtomicBool) {
    line.set_read_timeout(Some(Duration::from_millis(1)))
        .unwrap();
    let (mut bytes, mut reply) = ([0; 64], [0; MOST_REPLY]);
    while !over.load(Ordering::Relaxed) {
        // A slow machine may be late: the motion is the same, in fewer reports.
        for _ in 0..4 {
            node.tick();
            node.spent(123, 1000);
        }
        match line.read(&mut bytes) {
            Ok(0) => return,
            Ok(count) => {
                for &byte in &bytes[..count] {
                    if let Some(frame) = node.receive(byte, &mut reply) {
                        line.write_all(frame).unwrap();
                    }
                }
            }
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return,
        }
    }
}

/// The columns of telemetry, by name.
fn column(path: &Path, name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let at = lines
        .next()
        .and_then(|names| names.iter().position(|found| *found == name))
        .unwrap();
    lines.map(|cells| cells[at].parse().unwrap()).collect()
}

#[test]
fn play_loads_starts_and_records_and_the_hand_ends_at_the_target() {
    let chip = Controlled::start();
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("telemetry.csv");
    let file = firmware().join("learned.json");
    let [x, y, z] = learned::TARGET;
    let target = format!("{x},{y},{z}");
    let options = ["--port", &chip.port, "--csv", csv.to_str().unwrap()];
    let mut arguments = vec!["play", file.to_str().unwrap(), "--target", &target];
    arguments.extend(["--motion", "reach_05"]);
    arguments.extend(options);
    let output = sinew(&arguments);
    ends(&output, 0, &["the synergy of", "reach_05.csv"]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("at rest"));
    let distance = column(&csv, "distance");
    assert!(distance.len() > 10 && distance[0] > 0.1);
    assert!(*distance.last().unwrap() < f64::from(NEAR));
    for (r, name) in ["x", "y", "z"].iter().enumerate() {
        let last = *column(&csv, name).last().unwrap();
        assert!((last - f64::from(learned::TARGET[r])).abs() < f64::from(NEAR));
    }
    assert!(column(&csv, "cost").iter().all(|&cost| cost == 123.0));
    assert!(column(&csv, "q4").iter().any(|&q| q > 0.5));

    // Another host, whose numbers begin at 1 again, and a target that is out of reach: it says so, and keeps the record.
    let mut arguments = vec!["play", "--target", "3,4,0"];
    arguments.extend(options);
    let output = sinew(&arguments);
    ends(&output, 1, &["short of its target"]);
    let bits = column(&csv, "faults");
    assert_eq!(*bits.last().unwrap(), 2.0);
    thread::sleep(Duration::from_millis(200));
    let tip = *chip.tip.lock().unwrap();
    assert!(tip.iter().map(|x| x * x).sum::<f32>().sqrt() > 0.6);
}

#[test]
fn play_loads_a_map_once_and_then_the_controller_plans_by_itself() {
    let chip = Controlled::start();
    let folder = tempfile::tempdir().unwrap();
    let csv = folder.path().join("telemetry.csv");
    let file = firmware().join("learned.json");
    let play = |target: &str, more: &[&str]| {
        let csv = csv.to_str().unwrap();
        let target = [
            "play", "--port", &chip.port, "--csv", csv, "--target", target,
        ];
        sinew(&[&target, more].concat())
    };
    // Nothing to plan with yet.
    ends(&play("0.2,0.42,-0.1", &["--seconds", "0.8"]), 1, &["NoMap"]);
    let [x, y, z] = learned::TARGET;
    let known = play(&format!("{x},{y},{z}"), &[file.to_str().unwrap()]);
    ends(&known, 0, &["the map, confidence 1.00"]);
    // From now on target and time are enough.
    for (target, words) in [
        ([0.2, 0.42, -0.1], "confidence 0.6"),
        ([-0.1, 0.5, -0.12], "confidence 0.7"),
        ([-0.05, 0.25, -0.5], "not to be trusted"),
    ] {
        let [x, y, z] = target;
        let reached = play(&format!("{x},{y},{z}"), &["--seconds", "0.8"]);
        ends(&reached, 0, &[words]);
        for (wanted, name) in target.iter().zip(["x", "y", "z"]) {
            let last = *column(&csv, name).last().unwrap();
            assert!((last - wanted).abs() < f64::from(NEAR), "{name} {last}");
        }
    }
    // A synergy is a synergy still.
    let own = play(
        "0.2,0.42,-0.1",
        &[file.to_str().unwrap(), "--motion", "reach_05"],
    );
    ends(&own, 0, &["the synergy of"]);
}

/// A line to the controller that loses the first byte of some of the frames, counted from 1.
struct Spoiling {
    line: TcpStream,
    spoilt: fn(usize) -> bool,
    frames: usize,
}

impl Spoiling {
    fn new(line: TcpStream, spoilt: fn(usize) -> bool) -> Self {
        Spoiling {
            line,
            spoilt,
            frames: 0,
        }
    }

    /// After some noise.
    fn port(chip: &Controlled, noise: &[u8], spoilt: fn(usize) -> bool) -> Port {
        let mut line = TcpStream::connect(&chip.port).unwrap();
        line.write_all(noise).unwrap();
        Port::new(line.try_clone().unwrap(), Spoiling::new(line, spoilt))
    }
}

impl Write for Spoiling {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut from = 0;
        if bytes != [0] {
            self.frames += 1;
            from = usize::from((self.spoilt)(self.frames));
        }
        self.line.write_all(&bytes[from..])?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.line.flush()
    }
}

impl Drop for Spoiling {
    // The other end has a handle of its own.
    fn drop(&mut self) {
        let _ = self.line.shutdown(Shutdown::Both);
    }
}

/// The number of the last request that was carried out, for which it takes another host: 0 is always one from before.
fn carried_out(chip: &Controlled) -> u32 {
    let mut line = TcpStream::connect(&chip.port).unwrap();
    let mut buffer = [0; MOST_FRAME];
    let old = Envelope {
        sequence: 0,
        body: Request::Report,
    };
    line.write_all(&[0]).unwrap();
    line.write_all(encode(&old, &mut buffer).unwrap()).unwrap();
    let mut receiver = Receiver::new();
    for byte in io::BufReader::new(line).bytes() {
        if let Some(reply) = receiver.take(byte.unwrap()) {
            match reply.unwrap().body {
                Reply::Refused(Refusal::Replayed(last)) => return last,
                other => panic!("{other:?}"),
            }
        }
    }
    panic!("no reply")
}

#[test]
fn a_request_that_the_line_spoils_is_sent_again_and_carried_out_once() {
    let chip = Controlled::start();
    let mut port = Spoiling::port(&chip, b"", |frame| [2, 4, 5].contains(&frame));
    for _ in 0..3 {
        assert!(matches!(port.ask(&Request::Hold), Ok(Reply::Done)));
    }
    drop(port);
    assert_eq!(carried_out(&chip), 3);
}

#[test]
fn noise_before_a_request_does_not_carry_it_out_twice() {
    let chip = Controlled::start();
    let mut port = Spoiling::port(&chip, b"noise", |_| false);
    for _ in 0..2 {
        assert!(matches!(port.ask(&Request::Hold), Ok(Reply::Done)));
    }
    drop(port);
    assert_eq!(carried_out(&chip), 2);
}

#[test]
fn a_line_that_spoils_everything_is_silent() {
    let chip = Controlled::start();
    let mut port = Spoiling::port(&chip, b"", |_| true);
    assert!(matches!(port.ask(&Request::Hold), Err(PlayError::Silent)));
    drop(port);
    assert_eq!(carried_out(&chip), 0);
}

#[test]
fn a_request_whose_reply_is_lost_is_answered_when_it_is_asked_again() {
    /// Loses all up to the first frame's end.
    struct Losing(TcpStream, bool);

    impl Read for Losing {
        fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
            let mut byte = [1];
            while self.1 && byte != [0] {
                self.0.read_exact(&mut byte)?;
            }
            self.1 = false;
            self.0.read(bytes)
        }
    }

    let chip = Controlled::start();
    let line = TcpStream::connect(&chip.port).unwrap();
    let back = Losing(line.try_clone().unwrap(), true);
    let mut port = Port::new(back, Spoiling::new(line, |_| false));
    assert!(matches!(port.ask(&Request::Hold), Ok(Reply::Done)));
    drop(port);
    // That it was carried out before, nothing told the host.
    assert_eq!(carried_out(&chip), 2);
}

#[test]
fn a_line_that_answers_nothing_is_a_failure() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().to_string();
    thread::spawn(move || {
        let mut lines = Vec::new();
        for line in listener.incoming() {
            lines.push(line);
        }
    });
    let output = sinew(&["play", "--port", &port, "--target", "0.1,0.2,0.3"]);
    ends(&output, 1, &["does not answer"]);
}
