//! The firmware: waits on its serial line for what to do.
#![no_std]
#![no_main]

use cortex_m_rt::entry;
#[cfg(feature = "qemu")]
use sinew_firmware::board::qemu::Qemu as Here;
#[cfg(feature = "stm32f411")]
use sinew_firmware::board::stm32f411::Stm32f411 as Here;
use sinew_firmware::node::Node;
use sinew_firmware::run::run;

/// Should there be a panic after all: sleep. The timers go on with the pulses they have, and the arm keeps its posture.
#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    loop {
        cortex_m::asm::wfi();
    }
}

#[entry]
fn main() -> ! {
    if let Some((board, store)) = Here::start()
        && let Ok(node) = Node::new(store)
    {
        run(board, node)
    }
    // Not reached: the defaults are valid, and a board starts once.
    loop {
        cortex_m::asm::wfi();
    }
}
