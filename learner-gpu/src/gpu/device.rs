//! An open device: its queue, what it complained of, and the way back to the host.

use std::cell::Cell;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::{Arc, Mutex, Once, PoisonError};
use std::time::Duration;

use wgpu::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoderDescriptor, DeviceDescriptor, Limits,
    MapMode, PollError, PollType,
};

use super::adapter::{self, Adapter, Which};
use super::error::GpuError;

/// A device that does not answer for so long is taken for lost.
const PATIENCE: Duration = Duration::from_secs(120);

/// Words that are moved at once: what lies twice in memory meanwhile is small.
pub(super) const PART: usize = 1 << 20;

/// What the device complained of since it was opened: wgpu tells by callbacks, from whatever call is at hand.
#[derive(Debug, Default)]
struct Complaints {
    lost: Option<String>,
    refused: Option<String>,
}

thread_local! {
    /// Whether this thread's panics are no news.
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Waits for a device: where its driver says meanwhile that it is lost, wgpu panics. That is an error here, and nothing that
/// is to be printed; what panicked is not used again.
fn quietly<R>(wait: impl FnOnce() -> R) -> std::thread::Result<R> {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |panic| {
            if !QUIET.get() {
                others(panic);
            }
        }));
    });
    QUIET.set(true);
    let waited = catch_unwind(AssertUnwindSafe(wait));
    QUIET.set(false);
    waited
}

/// An open device.
pub(super) struct Device {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub adapter: Adapter,
    complaints: Arc<Mutex<Complaints>>,
}

impl Device {
    /// The first of the adapters that opens.
    ///
    /// # Errors
    /// No adapter, or none that opens: what the last one said.
    pub fn open(which: &Which) -> Result<Self, GpuError> {
        let mut last = GpuError::NoAdapter;
        for candidate in adapter::candidates(which)? {
            match Self::of(&candidate) {
                Ok(device) => return Ok(device),
                Err(error) => last = error,
            }
        }
        Err(last)
    }

    fn of(candidate: &wgpu::Adapter) -> Result<Self, GpuError> {
        let adapter = adapter::describe(candidate);
        let descriptor = DeviceDescriptor {
            label: Some("sinew"),
            required_limits: Limits::default().or_worse_values_from(&candidate.limits()),
            ..DeviceDescriptor::default()
        };
        let (device, queue) =
            pollster::block_on(candidate.request_device(&descriptor)).map_err(|error| {
                GpuError::Open {
                    adapter: adapter.to_string(),
                    reason: error.to_string(),
                }
            })?;
        let complaints = Arc::new(Mutex::new(Complaints::default()));
        let heard = Arc::clone(&complaints);
        device.set_device_lost_callback(move |reason, message| {
            let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
            heard
                .lost
                .get_or_insert(format!("{reason:?} {message}").trim().to_owned());
        });
        let heard = Arc::clone(&complaints);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
            heard.refused.get_or_insert(error.to_string());
        }));
        Ok(Device {
            device,
            queue,
            adapter,
            complaints,
        })
    }

    /// What the device complained of, if it did.
    ///
    /// # Errors
    /// That.
    pub fn check(&self) -> Result<(), GpuError> {
        let mut complaints = self
            .complaints
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let refused = complaints.refused.take();
        match (&complaints.lost, refused) {
            (Some(lost), _) => Err(GpuError::Lost(lost.clone())),
            (None, Some(refused)) => Err(GpuError::Refused(refused)),
            (None, None) => Ok(()),
        }
    }

    /// Waits until all that was submitted is done.
    ///
    /// # Errors
    /// The device is lost, or complained.
    pub fn wait(&self) -> Result<(), GpuError> {
        let until_done = PollType::Wait {
            submission_index: None,
            timeout: Some(PATIENCE),
        };
        match quietly(|| self.device.poll(until_done)) {
            Ok(Ok(_)) => self.check(),
            Ok(Err(PollError::Timeout)) => {
                // Whoever lets go of the last handle waits once more, and for ever.
                std::mem::forget((self.device.clone(), self.queue.clone()));
                let seconds = PATIENCE.as_secs();
                let words = format!("it did not answer for {seconds} seconds");
                Err(GpuError::Lost(words))
            }
            Ok(Err(error)) => Err(GpuError::Lost(error.to_string())),
            Err(panic) => {
                let words = panic.downcast_ref::<String>().map(String::as_str);
                let words = words.or_else(|| panic.downcast_ref::<&str>().copied());
                let words = words.unwrap_or("while waiting").split_whitespace();
                Err(GpuError::Lost(words.collect::<Vec<_>>().join(" ")))
            }
        }
    }

    /// A storage buffer for so many words, all 0, and for at least one 16-byte item: a binding must not be empty.
    pub fn storage(&self, label: &str, words: usize) -> Buffer {
        self.device.create_buffer(&BufferDescriptor {
            label: Some(label),
            size: words.max(4) as u64 * 4,
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
    }

    /// Writes words at the beginning of a buffer, before whatever is submitted next.
    pub fn write(&self, buffer: &Buffer, words: &[u32]) {
        for (part, words) in words.chunks(PART).enumerate() {
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_ne_bytes()).collect();
            let at = (part * PART) as u64 * 4;
            self.queue.write_buffer(buffer, at, &bytes);
        }
    }

    /// A buffer's words.
    ///
    /// # Errors
    /// See [`read_part`](Self::read_part).
    pub fn read(&self, buffer: &Buffer) -> Result<Vec<u32>, GpuError> {
        self.read_part(buffer, 0..buffer.size() as usize / 4)
    }

    /// Some of a buffer's words.
    ///
    /// # Errors
    /// The device is lost, or has no memory for the copy.
    pub fn read_part(&self, buffer: &Buffer, words: Range<usize>) -> Result<Vec<u32>, GpuError> {
        let size = words.len() as u64 * 4;
        let copy = self.device.create_buffer(&BufferDescriptor {
            label: Some("read-back"),
            size,
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self
            .device
            .create_command_encoder(&CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, words.start as u64 * 4, &copy, 0, size);
        self.queue.submit([encoder.finish()]);
        // Whether mapping failed shows in the view below.
        copy.map_async(MapMode::Read, .., |_| {});
        self.wait()?;
        let view = copy
            .get_mapped_range(..)
            .map_err(|error| GpuError::Lost(error.to_string()))?;
        let words = view
            .as_chunks::<4>()
            .0
            .iter()
            .map(|&word| u32::from_ne_bytes(word))
            .collect();
        drop(view);
        copy.unmap();
        Ok(words)
    }
}

#[cfg(test)]
mod tests {
    use super::quietly;

    #[test]
    fn a_panic_while_waiting_is_an_error_and_others_are_not() {
        assert_eq!(quietly(|| 3).ok(), Some(3));
        let lost = quietly(|| panic!("lost")).unwrap_err();
        assert_eq!(lost.downcast_ref::<&str>(), Some(&"lost"));
        assert_eq!(quietly(|| 4).ok(), Some(4));
    }
}
