//! An STM32F411 at 84 MHz from its internal oscillator, as on ST's Nucleo-F411RE (ST UM1724) and on "black pill"
//! boards. Built and linked by the tests; it has not run on the chip there.
//!
//! | what | where |
//! |---|---|
//! | line, 115,200 baud, 8N1 | USART2: PA2 out, PA3 in (on a Nucleo: its USB) |
//! | servos 0 to 3 | TIM3: PA6, PA7, PB0, PB1 |
//! | servos 4 to 6 | TIM4: PB6, PB7, PB8 |
//! | settings | flash sectors 6 and 7 |
//! | tick | TIM2 |
//! | clock for costs | the processor's cycle counter |
#![allow(unsafe_code)]

use core::cell::RefCell;
use core::sync::atomic::{AtomicBool, Ordering};

use critical_section::Mutex;
use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use sinew_protocol::DOFS;
use stm32f4xx_hal::flash::{self, FlashExt, LockedFlash};
use stm32f4xx_hal::pac::{self, DWT, NVIC, TIM2, TIM3, TIM4, USART2, interrupt};
use stm32f4xx_hal::prelude::*;
use stm32f4xx_hal::rcc::Config as Clocks;
use stm32f4xx_hal::serial::{Config as Line, Rx, RxListen, Serial, Tx, TxListen};
use stm32f4xx_hal::timer::{CounterHz, Event, PwmChannel};

use super::{Board, Queue};
use crate::RATE_HZ;
use crate::servo::{Calibration, Channel};
use crate::store::Store;

const CLOCK_HZ: u32 = 84_000_000;

/// From one pulse to the next, microseconds: hobby servos want 50 a second.
const FRAME_US: u32 = 20_000;

/// Sectors 6 and 7, from the flash's beginning: 128 KB each.
const PAGES: [u32; 2] = [256 * 1024, 384 * 1024];

static PERIOD_OVER: AtomicBool = AtomicBool::new(false);
static INBOX: Queue = Queue::new();
static OUTBOX: Queue = Queue::new();
static TIMER: Mutex<RefCell<Option<CounterHz<TIM2>>>> = Mutex::new(RefCell::new(None));
static RECEIVER: Mutex<RefCell<Option<Rx<USART2>>>> = Mutex::new(RefCell::new(None));
static SENDER: Mutex<RefCell<Option<Tx<USART2>>>> = Mutex::new(RefCell::new(None));

#[interrupt]
fn TIM2() {
    critical_section::with(|cs| {
        if let Some(timer) = TIMER.borrow_ref_mut(cs).as_mut() {
            timer.clear_all_flags();
        }
    });
    PERIOD_OVER.store(true, Ordering::Release);
}

#[interrupt]
fn USART2() {
    critical_section::with(|cs| {
        if let Some(receiver) = RECEIVER.borrow_ref_mut(cs).as_mut() {
            // A byte with an error is lost, and its frame's CRC tells.
            if let Ok(byte) = receiver.read() {
                INBOX.put(byte);
            }
        }
        if let Some(sender) = SENDER.borrow_ref_mut(cs).as_mut()
            && sender.is_tx_empty()
        {
            match OUTBOX.take() {
                // There is room: it does not wait.
                Some(byte) => drop(sender.write(byte)),
                None => sender.unlisten(),
            }
        }
    });
}

/// The board.
pub struct Stm32f411 {
    first: (
        PwmChannel<TIM3, 0>,
        PwmChannel<TIM3, 1>,
        PwmChannel<TIM3, 2>,
        PwmChannel<TIM3, 3>,
    ),
    last: (
        PwmChannel<TIM4, 0>,
        PwmChannel<TIM4, 1>,
        PwmChannel<TIM4, 2>,
    ),
}

impl Stm32f411 {
    /// Starts clocks, timers and line. Nothing if it was started before, or a setting is beyond the chip.
    pub fn start() -> Option<(Self, Store<Flash>)> {
        let chip = pac::Peripherals::take()?;
        let mut processor = cortex_m::Peripherals::take()?;
        processor.DCB.enable_trace();
        processor.DWT.enable_cycle_counter();
        let mut rcc = chip.RCC.freeze(Clocks::hsi().sysclk(CLOCK_HZ.Hz()));
        let a = chip.GPIOA.split(&mut rcc);
        let b = chip.GPIOB.split(&mut rcc);

        let frame = FRAME_US.micros();
        let (_, (c0, c1, c2, c3)) = chip.TIM3.pwm_us(frame, &mut rcc);
        let mut first = (
            c0.with(a.pa6),
            c1.with(a.pa7),
            c2.with(b.pb0),
            c3.with(b.pb1),
        );
        let (_, (c0, c1, c2, _)) = chip.TIM4.pwm_us(frame, &mut rcc);
        let mut last = (c0.with(b.pb6), c1.with(b.pb7), c2.with(b.pb8));
        first.0.enable();
        first.1.enable();
        first.2.enable();
        first.3.enable();
        last.0.enable();
        last.1.enable();
        last.2.enable();

        let settings = Line::default().baudrate(115_200.bps());
        let serial = Serial::new(chip.USART2, (a.pa2, a.pa3), settings, &mut rcc).ok()?;
        let (sender, mut receiver) = serial.split();
        receiver.listen();
        let mut timer = chip.TIM2.counter_hz(&mut rcc);
        timer.listen(Event::Update);
        timer.start(RATE_HZ.Hz()).ok()?;
        critical_section::with(|cs| {
            TIMER.borrow_ref_mut(cs).replace(timer);
            RECEIVER.borrow_ref_mut(cs).replace(receiver);
            SENDER.borrow_ref_mut(cs).replace(sender);
        });
        // SAFETY: the handlers are in place, and no critical section relies on these being masked.
        unsafe {
            NVIC::unmask(pac::Interrupt::TIM2);
            NVIC::unmask(pac::Interrupt::USART2);
        }
        let store = Store::new(Flash(LockedFlash::new(chip.FLASH)), PAGES);
        Some((Stm32f411 { first, last }, store))
    }
}

impl Board for Stm32f411 {
    const SERVOS: [Calibration; DOFS] = [Calibration::COMMON; DOFS];
    const FRAME: f32 = FRAME_US as f32;

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
        DWT::cycle_count()
    }

    fn period(&self) -> u32 {
        CLOCK_HZ / RATE_HZ
    }

    fn read(&mut self) -> Option<u8> {
        INBOX.take()
    }

    fn write(&mut self, frame: &[u8]) {
        OUTBOX.put_all(frame);
        critical_section::with(|cs| {
            if let Some(sender) = SENDER.borrow_ref_mut(cs).as_mut() {
                sender.listen();
            }
        });
    }

    fn servos(&mut self) -> [Channel<'_>; DOFS] {
        let (first, last) = (&mut self.first, &mut self.last);
        [
            &mut first.0,
            &mut first.1,
            &mut first.2,
            &mut first.3,
            &mut last.0,
            &mut last.1,
            &mut last.2,
        ]
    }
}

/// The chip's flash, locked but while it is written.
pub struct Flash(LockedFlash);

impl ErrorType for Flash {
    type Error = flash::Error;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), flash::Error> {
        ReadNorFlash::read(&mut self.0, offset, bytes)
    }

    fn capacity(&self) -> usize {
        ReadNorFlash::capacity(&self.0)
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 1;
    const ERASE_SIZE: usize = 128 * 1024;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), flash::Error> {
        NorFlash::erase(&mut self.0.unlocked(), from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), flash::Error> {
        NorFlash::write(&mut self.0.unlocked(), offset, bytes)
    }
}
