//! Shows the arm reaching: the firmware on QEMU's board, told what to do by frames from within instead of a line.
//!
//! Each line: the time, the tip, how far it is from its target, and the hand's speed as a bar. With the synergy that
//! bar is a bell, as a person's is (the paper's figure 8).
#![no_std]
#![no_main]

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprint, hprintln};
use sinew_firmware::board::Board;
use sinew_firmware::board::qemu::{Qemu, RamFlash};
use sinew_firmware::learned::{SETTINGS, START, TARGET};
use sinew_firmware::node::Node;
use sinew_firmware::run::turn;
use sinew_protocol::{
    Envelope, MOST_FRAME, Mode, Receiver, Reply, Report, Request, Settings, encode,
};

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    hprintln!("{}", info.message());
    debug::exit(debug::EXIT_FAILURE);
    loop {
        cortex_m::asm::wfi();
    }
}

/// The bench's end of the line.
#[derive(Default)]
struct Bench {
    sequence: u32,
}

impl Bench {
    fn ask(&mut self, node: &mut Node<RamFlash>, body: Request) -> Option<Reply> {
        self.sequence += 1;
        let (mut there, mut back) = ([0; MOST_FRAME], [0; MOST_FRAME]);
        let request = Envelope {
            sequence: self.sequence,
            body,
        };
        let frame = encode(&request, &mut there).ok()?;
        let mut receiver = Receiver::new();
        let mut reply = None;
        for &mut byte in frame {
            for &byte in node.receive(byte, &mut back).unwrap_or(&[]) {
                reply = receiver.take(byte).or(reply);
            }
        }
        let reply: Envelope<Reply> = reply?.ok()?;
        Some(reply.body)
    }
}

/// A request that must not be refused.
fn done(bench: &mut Bench, node: &mut Node<RamFlash>, request: Request) -> Option<()> {
    let reply = bench.ask(node, request)?;
    if reply != Reply::Done {
        hprintln!("refused: {:?}", reply);
        return None;
    }
    Some(())
}

fn millimetres(metres: f32) -> i32 {
    (metres * 1000.0) as i32
}

fn show(report: &Report, before: [f32; 3]) {
    let moved = [0, 1, 2].map(|i: usize| report.tip[i] - before[i]);
    let square: f32 = moved.iter().map(|x| x * x).sum();
    // Over 40 ms; a mark for each 4 cm/s.
    let marks = (sinew::real::Real::sqrt(square) / 0.04 / 0.04) as usize;
    let [x, y, z] = report.tip.map(millimetres);
    hprint!(
        "{:5} ms  {:5} {:5} {:5} mm  {:4} mm left  ",
        report.ticks,
        x,
        y,
        z,
        millimetres(report.distance)
    );
    for _ in 0..marks.min(40) {
        hprint!("#");
    }
    hprintln!("");
}

fn reach() -> Option<()> {
    let (mut board, store) = Qemu::start()?;
    let mut node = Node::new(store).ok()?;
    let mut bench = Bench::default();
    let Settings {
        chain: Some(chain),
        synergy: Some(synergy),
        ..
    } = SETTINGS
    else {
        return None;
    };
    for request in [Request::LoadChain(chain), Request::LoadSynergy(synergy)] {
        done(&mut bench, &mut node, request)?;
    }
    node.put(START);
    done(&mut bench, &mut node, Request::GoTo(TARGET))?;
    let [x, y, z] = TARGET.map(millimetres);
    hprintln!("a Cortex-M4F takes the hand to {} {} {} mm", x, y, z);
    let mut ticks = 0u32;
    let mut before = node.arm().tip();
    loop {
        if !turn(&mut board, &mut node) {
            continue;
        }
        ticks += 1;
        if !ticks.is_multiple_of(40) {
            continue;
        }
        let Reply::Report(report) = bench.ask(&mut node, Request::Report)? else {
            return None;
        };
        if report.distance > 1e-3 {
            show(&report, before);
        }
        before = report.tip;
        if report.mode == Mode::Holding {
            let share = 100 * report.worst_cost / board.period();
            hprintln!(
                "there; pulses in µs: {:?}; a tick takes up to {} % of its millisecond",
                board.pulses(),
                share
            );
            return (report.distance < sinew_firmware::arm::NEAR).then_some(());
        }
    }
}

#[entry]
fn main() -> ! {
    let status = match reach() {
        Some(()) => debug::EXIT_SUCCESS,
        None => debug::EXIT_FAILURE,
    };
    debug::exit(status);
    loop {
        cortex_m::asm::wfi();
    }
}
