//! What a board has to offer, and the boards there are. To add one: its file here, its memory map in `memory/`, and a
//! feature.

#[cfg(feature = "qemu")]
pub mod qemu;
#[cfg(feature = "stm32f411")]
pub mod stm32f411;

use sinew_protocol::DOFS;

use crate::servo::{Calibration, Channel};

/// A board with a timer, a line and servos.
pub trait Board {
    /// The servos' calibration, from the shoulder on.
    const SERVOS: [Calibration; DOFS];

    /// From one pulse to the next, microseconds.
    const FRAME: f32;

    /// Sleeps until something happened. True: a period is over.
    fn wait(&mut self) -> bool;

    /// A clock that counts up and wraps.
    fn now(&self) -> u32;

    /// A period in that clock.
    fn period(&self) -> u32;

    /// The next byte that the line brought.
    fn read(&mut self) -> Option<u8>;

    /// Sends a frame while other things go on. It is lost where what was sent before leaves no room: the host asks again.
    fn write(&mut self, frame: &[u8]);

    /// The servos' channels, from the shoulder on.
    fn servos(&mut self) -> [Channel<'_>; DOFS];
}

/// Bytes between an interrupt and the main loop: those of the line that come, or those that go.
#[cfg(any(feature = "qemu", feature = "stm32f411"))]
pub(crate) struct Queue(critical_section::Mutex<core::cell::RefCell<heapless::Deque<u8, 256>>>);

#[cfg(any(feature = "qemu", feature = "stm32f411"))]
impl Queue {
    pub const fn new() -> Self {
        Queue(critical_section::Mutex::new(core::cell::RefCell::new(
            heapless::Deque::new(),
        )))
    }

    /// Puts a byte in; it is lost where there is no room, and its frame's CRC will tell.
    pub fn put(&self, byte: u8) {
        critical_section::with(|cs| {
            let _full = self.0.borrow_ref_mut(cs).push_back(byte);
        });
    }

    /// Puts all of a frame in, or nothing of it.
    pub fn put_all(&self, frame: &[u8]) {
        critical_section::with(|cs| {
            let mut queue = self.0.borrow_ref_mut(cs);
            if queue.len() + frame.len() <= queue.capacity() {
                queue.extend(frame);
            }
        });
    }

    pub fn take(&self) -> Option<u8> {
        critical_section::with(|cs| self.0.borrow_ref_mut(cs).pop_front())
    }

    /// Whether there is room for a byte.
    #[cfg(feature = "qemu")]
    pub fn has_room(&self) -> bool {
        critical_section::with(|cs| !self.0.borrow_ref(cs).is_full())
    }
}
