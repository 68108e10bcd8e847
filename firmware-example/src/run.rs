//! The main loop: sleep, tick, servos, line.

use embedded_storage::nor_flash::NorFlash;
use sinew_protocol::{MOST_REPLY, Mode};

use crate::board::Board;
use crate::node::Node;
use crate::servo::Calibration;

/// Bytes of the line that are looked at before the next tick is: some twenty times what comes at 115,200 baud.
const AT_ONCE: usize = 256;

/// Forever.
pub fn run<B: Board, F: NorFlash>(mut board: B, mut node: Node<F>) -> ! {
    loop {
        turn(&mut board, &mut node);
    }
}

/// Until the next time the chip would sleep. True: it was a tick.
pub fn turn<B: Board, F: NorFlash>(board: &mut B, node: &mut Node<F>) -> bool {
    let due = board.wait();
    if due {
        let before = board.now();
        node.tick();
        pulses(board, node);
        let period = board.period();
        node.spent(board.now().wrapping_sub(before), period);
    }
    let mut reply = [0; MOST_REPLY];
    for _ in 0..AT_ONCE {
        let Some(byte) = board.read() else {
            break;
        };
        if let Some(frame) = node.receive(byte, &mut reply) {
            board.write(frame);
        }
    }
    due
}

/// The posture to the servos.
fn pulses<B: Board, F: NorFlash>(board: &mut B, node: &Node<F>) {
    let arm = node.arm();
    let free = arm.mode() == Mode::Stopped && arm.is_at_rest();
    for ((channel, servo), &q) in board.servos().into_iter().zip(B::SERVOS).zip(arm.angles()) {
        if free {
            Calibration::release(channel);
        } else {
            servo.send(q, B::FRAME, channel);
        }
    }
}
