//! What survives a reset: one record in a flash page, and the one before it in another.
//!
//! A record is postcard with a CRC. The page that holds the older one is erased and written, so that power lost on
//! the way leaves the newer one whole.

use embedded_storage::nor_flash::NorFlash;
use postcard::ser_flavors::{Slice, crc::CrcModifier};
use sinew_protocol::{FORMAT, Record, Settings, frame::CHECK};

/// Bytes set aside for a record in a page.
const ROOM: usize = 640;

/// The flash did not do as asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreError;

/// Two pages of a flash.
pub struct Store<F> {
    flash: F,
    /// Where they begin, bytes; each is at least one erase block.
    pages: [u32; 2],
}

impl<F: NorFlash> Store<F> {
    /// On two pages that nothing else uses.
    pub fn new(flash: F, pages: [u32; 2]) -> Self {
        Store { flash, pages }
    }

    /// What was saved last; nothing where nothing valid is.
    pub fn load(&mut self) -> Option<Settings> {
        self.newest().map(|(_, record)| record.settings)
    }

    /// Whether a page holds something, valid or not.
    pub fn is_blank(&mut self) -> bool {
        self.pages.into_iter().all(|page| {
            let mut bytes = [0xff; 4];
            self.flash.read(page, &mut bytes).is_ok() && bytes == [0xff; 4]
        })
    }

    /// Saves.
    ///
    /// # Errors
    /// The flash did not erase or write.
    pub fn save(&mut self, settings: Settings) -> Result<(), StoreError> {
        let (page, count) = match self.newest() {
            Some((page, record)) => (1 - page, record.count.wrapping_add(1)),
            None => (0, 0),
        };
        let record = Record {
            format: FORMAT,
            count,
            settings,
        };
        let mut bytes = [0xff; ROOM];
        let flavor = CrcModifier::new(Slice::new(&mut bytes), CHECK.digest());
        let written = postcard::serialize_with_flavor(&record, flavor).map_err(|_| StoreError)?;
        let blocks = written
            .len()
            .div_ceil(F::WRITE_SIZE)
            .saturating_mul(F::WRITE_SIZE);
        let at = self.pages.get(page).copied().ok_or(StoreError)?;
        let end = at.saturating_add(F::ERASE_SIZE as u32);
        self.flash.erase(at, end).map_err(|_| StoreError)?;
        let bytes = bytes.get(..blocks).ok_or(StoreError)?;
        self.flash.write(at, bytes).map_err(|_| StoreError)
    }

    /// The newest valid record and its page.
    fn newest(&mut self) -> Option<(usize, Record)> {
        match (self.record(0), self.record(1)) {
            // The count wraps: the newer one is just ahead.
            (Some(a), Some(b)) if b.count.wrapping_sub(a.count) < 1 << 31 => Some((1, b)),
            (Some(a), _) => Some((0, a)),
            (None, b) => b.map(|b| (1, b)),
        }
    }

    fn record(&mut self, page: usize) -> Option<Record> {
        let mut bytes = [0; ROOM];
        self.flash
            .read(self.pages.get(page).copied()?, &mut bytes)
            .ok()?;
        let (record, _): (Record, _) =
            postcard::take_from_bytes_crc32(&bytes, CHECK.digest()).ok()?;
        (record.format == FORMAT).then_some(record)
    }
}
