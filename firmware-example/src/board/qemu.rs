//! QEMU's `mps2-an386`: Arm's MPS2 board with a Cortex-M4F at 25 MHz (Arm DAI 0386, *Application note AN386*; the
//! peripherals are in Arm DDI 0479, *Cortex-M System Design Kit*).
//!
//! It has no PWM and no flash that can be written: servos keep their duty in memory, and a page of RAM that a reset
//! leaves alone stands in for flash. Run with `-icount shift=7`, its timers count instructions.
#![allow(unsafe_code)]

use core::cell::UnsafeCell;
use core::convert::Infallible;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m_rt::exception;
use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use embedded_storage::nor_flash::{self, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};
use sinew_protocol::DOFS;

use super::{Board, Queue};
use crate::RATE_HZ;
use crate::servo::{Calibration, Channel};
use crate::store::Store;

/// Clock of the processor and of the timers, Hz.
const CLOCK_HZ: u32 = 25_000_000;

const TIMER0: usize = 0x4000_0000;
const TIMER1: usize = 0x4000_1000;
const UART0: usize = 0x4000_4000;

/// Interrupt numbers.
const UART0_RECEIVE: i16 = 0;
const UART0_SEND: i16 = 1;
const TIMER0_OVER: i16 = 8;

static PERIOD_OVER: AtomicBool = AtomicBool::new(false);
static INBOX: Queue = Queue::new();
static OUTBOX: Queue = Queue::new();

fn read(peripheral: usize, offset: usize) -> u32 {
    // SAFETY: only called with registers of the board's peripherals, aligned, which are always there.
    unsafe { ((peripheral + offset) as *const u32).read_volatile() }
}

fn write(peripheral: usize, offset: usize, value: u32) {
    // SAFETY: as for `read`; none of the registers written here moves memory.
    unsafe { ((peripheral + offset) as *mut u32).write_volatile(value) }
}

/// Every interrupt without a handler of its own comes here.
#[exception]
unsafe fn DefaultHandler(number: i16) {
    match number {
        TIMER0_OVER => {
            write(TIMER0, 0xc, 1);
            PERIOD_OVER.store(true, Ordering::Release);
        }
        UART0_RECEIVE => {
            write(UART0, 0xc, 1 << 1);
            receive();
        }
        UART0_SEND => {
            write(UART0, 0xc, 1);
            send();
        }
        _ => {}
    }
}

/// What the line has brought, as far as there is room. QEMU sends as fast as its host lets it, not at 115,200 baud, and
/// keeps what is not read.
fn receive() {
    while INBOX.has_room() && read(UART0, 4) & 1 << 1 != 0 {
        INBOX.put(read(UART0, 0) as u8);
    }
}

/// What is to go, as far as the line takes it: an interrupt tells when it takes more.
fn send() {
    while read(UART0, 4) & 1 == 0
        && let Some(byte) = OUTBOX.take()
    {
        write(UART0, 0, u32::from(byte));
    }
}

/// The board.
pub struct Qemu {
    duty: [Duty; DOFS],
}

impl Qemu {
    /// Starts timers and line, and finds the pages. It always can: an option for boards that cannot.
    pub fn start() -> Option<(Self, Store<RamFlash>)> {
        // TIMER0: an interrupt each period. TIMER1: the clock.
        write(TIMER0, 8, CLOCK_HZ / RATE_HZ - 1);
        write(TIMER0, 4, CLOCK_HZ / RATE_HZ - 1);
        write(TIMER0, 0, 1 | 1 << 3);
        write(TIMER1, 8, u32::MAX);
        write(TIMER1, 4, u32::MAX);
        write(TIMER1, 0, 1);
        // 115,200 baud; send, receive, an interrupt on each.
        write(UART0, 0x10, CLOCK_HZ / 115_200);
        write(UART0, 8, 1 | 1 << 1 | 1 << 2 | 1 << 3);
        // SAFETY: the handler for these is in place, and no critical section relies on them being masked.
        unsafe {
            cortex_m::peripheral::NVIC::unmask(Line(UART0_RECEIVE as u16));
            cortex_m::peripheral::NVIC::unmask(Line(UART0_SEND as u16));
            cortex_m::peripheral::NVIC::unmask(Line(TIMER0_OVER as u16));
            cortex_m::interrupt::enable();
        }
        let board = Qemu {
            duty: [const { Duty(0) }; DOFS],
        };
        Some((board, Store::new(RamFlash, [0, PAGE as u32])))
    }

    /// The pulses' lengths, microseconds; 0 where there are none.
    pub fn pulses(&self) -> [u16; DOFS] {
        [0, 1, 2, 3, 4, 5, 6].map(|i: usize| self.duty.get(i).map_or(0, |duty| duty.0))
    }
}

#[derive(Clone, Copy)]
struct Line(u16);

// SAFETY: the number is that of a line of the chip, and does not change.
unsafe impl cortex_m::interrupt::InterruptNumber for Line {
    fn number(self) -> u16 {
        self.0
    }
}

impl Board for Qemu {
    const SERVOS: [Calibration; DOFS] = [Calibration::COMMON; DOFS];
    const FRAME: f32 = 20_000.0;

    fn wait(&mut self) -> bool {
        // Masked, an interrupt that comes before `wfi` still ends it, and none is missed.
        cortex_m::interrupt::disable();
        if !PERIOD_OVER.load(Ordering::Acquire) {
            cortex_m::asm::wfi();
        }
        // SAFETY: they were enabled before.
        unsafe { cortex_m::interrupt::enable() };
        cortex_m::asm::isb();
        PERIOD_OVER.swap(false, Ordering::AcqRel)
    }

    fn now(&self) -> u32 {
        !read(TIMER1, 4)
    }

    fn period(&self) -> u32 {
        CLOCK_HZ / RATE_HZ
    }

    fn read(&mut self) -> Option<u8> {
        INBOX.take().or_else(|| {
            // Where there was no room, no interrupt told of the byte that waits.
            critical_section::with(|_| receive());
            INBOX.take()
        })
    }

    fn write(&mut self, frame: &[u8]) {
        OUTBOX.put_all(frame);
        critical_section::with(|_| send());
    }

    fn servos(&mut self) -> [Channel<'_>; DOFS] {
        self.duty.each_mut().map(|duty| duty as Channel<'_>)
    }
}

/// A PWM channel that only remembers; a step is a microsecond.
struct Duty(u16);

impl ErrorType for Duty {
    type Error = Infallible;
}

impl SetDutyCycle for Duty {
    fn max_duty_cycle(&self) -> u16 {
        Qemu::FRAME as u16
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        self.0 = duty;
        Ok(())
    }
}

/// Bytes of an erase block, as a common chip has it, and of a page.
const BLOCK: usize = 1024;
const PAGE: usize = Store::<RamFlash>::PAGE;

struct Pages(UnsafeCell<MaybeUninit<[u8; 2 * PAGE]>>);

// SAFETY: only the one `RamFlash` touches it, and that is not shared.
unsafe impl Sync for Pages {}

/// Left alone by the start-up code. Kept inverted: QEMU's memory is zero at power-on, which reads as erased flash.
#[unsafe(link_section = ".uninit.pages")]
static PAGES: Pages = Pages(UnsafeCell::new(MaybeUninit::uninit()));

/// Flash in RAM.
pub struct RamFlash;

/// Outside the pages.
#[derive(Clone, Copy, Debug)]
pub struct OutOfBounds;

impl NorFlashError for OutOfBounds {
    fn kind(&self) -> NorFlashErrorKind {
        NorFlashErrorKind::OutOfBounds
    }
}

impl RamFlash {
    /// The memory from `offset` on, if `length` bytes of it are there.
    fn at(&self, offset: u32, length: usize) -> Result<*mut u8, OutOfBounds> {
        let offset = usize::try_from(offset).map_err(|_| OutOfBounds)?;
        match offset.checked_add(length) {
            Some(end) if end <= 2 * PAGE => Ok(PAGES.0.get().cast::<u8>().wrapping_add(offset)),
            _ => Err(OutOfBounds),
        }
    }
}

impl nor_flash::ErrorType for RamFlash {
    type Error = OutOfBounds;
}

impl ReadNorFlash for RamFlash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), OutOfBounds> {
        let from = self.at(offset, bytes.len())?;
        for (i, byte) in bytes.iter_mut().enumerate() {
            // SAFETY: within the pages; volatile, for what memory holds after a reset is not the compiler's to know.
            *byte = unsafe { !from.wrapping_add(i).read_volatile() };
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        2 * PAGE
    }
}

impl NorFlash for RamFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = BLOCK;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), OutOfBounds> {
        let length = to.checked_sub(from).ok_or(OutOfBounds)? as usize;
        let start = self.at(from, length)?;
        for i in 0..length {
            // SAFETY: within the pages.
            unsafe { start.wrapping_add(i).write_volatile(0) };
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), OutOfBounds> {
        let to = self.at(offset, bytes.len())?;
        for (i, byte) in bytes.iter().enumerate() {
            // SAFETY: within the pages. Bits are only cleared, as in flash: set, kept inverted.
            unsafe {
                let at = to.wrapping_add(i);
                at.write_volatile(at.read_volatile() | !byte);
            }
        }
        Ok(())
    }
}
