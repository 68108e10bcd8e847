//! What survives a reset: one record in a flash page, and the one before it in another.
//!
//! A record is postcard with a CRC. The page that holds the older one is erased and written, so that power lost on
//! the way leaves the newer one whole.

use embedded_storage::nor_flash::NorFlash;
use postcard::ser_flavors::{Slice, crc::CrcModifier};
use sinew_protocol::{FORMAT, MOST_RECORD, Record, Settings, frame::CHECK};

/// The flash did not do as asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreError;

/// Two pages of a flash.
pub struct Store<F> {
    flash: F,
    /// Where they begin, bytes; each is whole erase blocks, with room for a record.
    pages: [u32; 2],
}

impl<F: NorFlash> Store<F> {
    /// What a page takes, bytes: the erase blocks that a record may fill.
    pub const PAGE: usize = MOST_RECORD.div_ceil(F::ERASE_SIZE) * F::ERASE_SIZE;

    /// On two pages that nothing else uses, each of [`Store::PAGE`] bytes or more.
    pub fn new(flash: F, pages: [u32; 2]) -> Self {
        Store { flash, pages }
    }

    /// What was saved last; nothing where nothing valid is.
    pub fn load(&mut self) -> Option<Settings> {
        let (page, _) = self.newest()?;
        self.record(page).map(|record| record.settings)
    }

    /// Whether no page holds anything, valid or not.
    pub fn is_blank(&mut self) -> bool {
        self.pages.into_iter().all(|page| {
            let mut bytes = [0xff; 4];
            self.flash.read(page, &mut bytes).is_ok() && bytes == [0xff; 4]
        })
    }

    /// Saves, where the newest record does not hold the same already: a page bears some ten thousand erasures.
    ///
    /// # Errors
    /// The flash did not erase or write.
    pub fn save(&mut self, settings: &Settings) -> Result<(), StoreError> {
        let newest = self.newest();
        let (page, count) = match newest {
            Some((page, count)) => (1 - page, count.wrapping_add(1)),
            None => (0, 0),
        };
        // As a `Record` is written, without a copy of the settings.
        let record = (FORMAT, count, settings);
        // Whole blocks: no chip writes longer ones than 32 bytes.
        let mut bytes = [0xff; BUFFER];
        let flavor = CrcModifier::new(Slice::new(&mut bytes), CHECK.digest());
        let written = postcard::serialize_with_flavor(&record, flavor).map_err(|_| StoreError)?;
        let length = written.len();
        let saved = bytes.get(head(count)..length - CRC).ok_or(StoreError)?;
        if newest.is_some_and(|(page, count)| self.holds(page, head(count), saved)) {
            return Ok(());
        }
        let bytes = bytes
            .get(..length.next_multiple_of(F::WRITE_SIZE))
            .ok_or(StoreError)?;
        let at = self.pages.get(page).copied().ok_or(StoreError)?;
        let end = at.saturating_add(Self::PAGE as u32);
        self.flash.erase(at, end).map_err(|_| StoreError)?;
        self.flash.write(at, bytes).map_err(|_| StoreError)
    }

    /// Whether these bytes are in a page, from there on.
    fn holds(&mut self, page: usize, from: usize, bytes: &[u8]) -> bool {
        let mut there = [0; BUFFER];
        match (self.pages.get(page), there.get_mut(..bytes.len())) {
            (Some(&at), Some(there)) => {
                let at = at.saturating_add(from as u32);
                self.flash.read(at, there).is_ok() && there == bytes
            }
            _ => false,
        }
    }

    /// The page with the newest valid record, and its count.
    fn newest(&mut self) -> Option<(usize, u32)> {
        let [first, second] = [0, 1].map(|page| self.record(page).map(|record| record.count));
        match (first, second) {
            // The count wraps: the newer one is just ahead.
            (Some(a), Some(b)) if b.wrapping_sub(a) < 1 << 31 => Some((1, b)),
            (Some(a), _) => Some((0, a)),
            (None, b) => b.map(|b| (1, b)),
        }
    }

    fn record(&mut self, page: usize) -> Option<Record> {
        let mut bytes = [0; MOST_RECORD];
        self.flash
            .read(self.pages.get(page).copied()?, &mut bytes)
            .ok()?;
        let (record, _): (Record, _) =
            postcard::take_from_bytes_crc32(&bytes, CHECK.digest()).ok()?;
        (record.format == FORMAT).then_some(record)
    }
}

/// A record in whole blocks.
const BUFFER: usize = MOST_RECORD.next_multiple_of(32);

/// A record's last bytes are its checksum.
const CRC: usize = 4;

/// A record's first bytes are its format and its count, seven bits in a byte: how many these are.
fn head(count: u32) -> usize {
    let bytes = |number: u32| number.checked_ilog2().unwrap_or(0) as usize / 7 + 1;
    bytes(FORMAT.into()) + bytes(count)
}
