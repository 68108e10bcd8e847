//! Frames on a line of bytes.

use crc::{CRC_32_ISCSI, Crc};
use postcard::ser_flavors::{Cobs, Slice, crc::CrcModifier};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::message::{Envelope, MOST_MAP};

/// No frame is longer, its closing zero included, in bytes: room for a map of the richest model with every term and
/// every target, its number, its kind, its CRC, and a byte of COBS in 254.
///
/// A map comes in one frame and not in pieces: it is there whole or not at all, and nobody has to remember a half. That
/// is a fifth of a second at 115,200 baud, and a buffer of 2 KB.
pub const MOST_FRAME: usize = {
    let bytes = MOST_MAP + 5 + 1 + 4;
    bytes + bytes / 254 + 2
};

/// No reply's frame is longer.
pub const MOST_REPLY: usize = 96;

/// CRC-32C: what frames and what is stored end with.
pub const CHECK: Crc<u32> = Crc::<u32>::new(&CRC_32_ISCSI);

/// Why bytes are no message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameError {
    /// No frame of this protocol.
    Garbled,
    /// Longer than [`MOST_FRAME`].
    TooLong,
}

/// A message as a frame, closing zero included.
///
/// # Errors
/// A buffer that is too short; [`MOST_FRAME`] bytes are enough for every message, [`MOST_REPLY`] for every reply.
///
/// ```
/// use sinew_protocol::{Envelope, MOST_FRAME, Receiver, Request, encode};
/// let request = Envelope { sequence: 1, body: Request::GoTo([0.3, 0.2, -0.1]) };
/// let mut buffer = [0; MOST_FRAME];
/// let frame = encode(&request, &mut buffer).unwrap();
/// let mut receiver = Receiver::new();
/// let received = frame.iter().find_map(|&byte| receiver.take(byte));
/// assert_eq!(received, Some(Ok(request)));
/// ```
pub fn encode<'b, T: Serialize>(
    message: &Envelope<T>,
    buffer: &'b mut [u8],
) -> Result<&'b mut [u8], FrameError> {
    Cobs::try_new(Slice::new(buffer))
        .and_then(|cobs| {
            postcard::serialize_with_flavor(message, CrcModifier::new(cobs, CHECK.digest()))
        })
        .map_err(|_| FrameError::TooLong)
}

/// Takes bytes, gives messages.
#[derive(Clone, Debug)]
pub struct Receiver {
    buffer: [u8; MOST_FRAME],
    /// Bytes so far; above the buffer's length where the frame is too long.
    length: usize,
}

impl Default for Receiver {
    fn default() -> Self {
        Self::new()
    }
}

impl Receiver {
    /// With nothing received.
    pub const fn new() -> Self {
        Receiver {
            buffer: [0; MOST_FRAME],
            length: 0,
        }
    }

    /// One byte more. A message, or why there is none, at a frame's closing zero. Zeros on their own are skipped: a
    /// sender may begin with some to end whatever noise came before.
    pub fn take<T: DeserializeOwned>(
        &mut self,
        byte: u8,
    ) -> Option<Result<Envelope<T>, FrameError>> {
        if byte != 0 {
            if let Some(slot) = self.buffer.get_mut(self.length) {
                *slot = byte;
            }
            self.length = (self.length + 1).min(MOST_FRAME + 1);
            return None;
        }
        let length = core::mem::take(&mut self.length);
        if length == 0 {
            return None;
        }
        // The closing zero counts too.
        match self.buffer.get_mut(..length) {
            Some(frame) if length < MOST_FRAME => Some(decode(frame)),
            _ => Some(Err(FrameError::TooLong)),
        }
    }
}

/// A frame without its zero.
fn decode<T: DeserializeOwned>(frame: &mut [u8]) -> Result<Envelope<T>, FrameError> {
    let length = cobs::decode_in_place(frame).map_err(|_| FrameError::Garbled)?;
    let bytes = frame.get(..length).ok_or(FrameError::Garbled)?;
    match postcard::take_from_bytes_crc32(bytes, CHECK.digest()) {
        Ok((message, [])) => Ok(message),
        _ => Err(FrameError::Garbled),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::*;
    use sinew::map::{INPUTS, MOST_TARGETS, TERMS};

    fn receive(bytes: &[u8]) -> std::vec::Vec<Result<Envelope<Request>, FrameError>> {
        let mut receiver = Receiver::new();
        bytes
            .iter()
            .filter_map(|&byte| receiver.take(byte))
            .collect()
    }

    fn request(sequence: u32, body: Request) -> (Envelope<Request>, std::vec::Vec<u8>) {
        let message = Envelope { sequence, body };
        let mut buffer = [0; MOST_FRAME];
        let frame = encode(&message, &mut buffer).map(|frame| frame.to_vec());
        (message, frame.unwrap_or_default())
    }

    fn longest_map() -> Request {
        Request::LoadMap(Map {
            stepper: Stepper::SelectivelyDamped,
            rate: -1e4,
            model: Model::D,
            centre: [-1e4; INPUTS],
            scale: [1e3; INPUTS],
            coefficients: Vec::from_array([-1e4; 3 * DOFS * TERMS]),
            targets: Vec::from_array([[-1e4; 3]; MOST_TARGETS]),
            radius: 1e3,
        })
    }

    fn longest_chain() -> Request {
        let transform = Transform {
            translation: [-1e4; 3],
            rotation: [0.5; 4],
        };
        let joint = Joint {
            slides: true,
            translation: [-1e4; 3],
            rotation: [0.5; 4],
            axis: [1e3; 3],
            lower: -8e3,
            upper: 8e3,
        };
        Request::LoadChain(Chain {
            base: transform,
            joints: [joint; DOFS],
            tip: transform,
            landmarks: (0..7).collect(),
        })
    }

    #[test]
    fn the_longest_requests_fit_a_frame() {
        for longest in [longest_chain(), longest_map()] {
            let (message, frame) = request(u32::MAX, longest);
            assert!((1..=MOST_FRAME).contains(&frame.len()), "{}", frame.len());
            assert_eq!(receive(&frame), [Ok(message)]);
        }
    }

    #[test]
    fn the_longest_reply_fits_its_buffer() {
        let reply = Envelope {
            sequence: u32::MAX,
            body: Reply::Report(Report {
                mode: Mode::Stopped,
                faults: Faults(u8::MAX),
                ticks: u32::MAX,
                angles: [-1e4; DOFS],
                tip: [-1e4; 3],
                distance: 1e4,
                cost: u32::MAX,
                worst_cost: u32::MAX,
            }),
        };
        assert!(encode(&reply, &mut [0; MOST_REPLY]).is_ok());
    }

    #[test]
    fn the_longest_settings_fit_a_record() {
        let (Request::LoadChain(chain), Request::LoadMap(map)) = (longest_chain(), longest_map())
        else {
            panic!("other requests");
        };
        let synergy = Synergy {
            stepper: map.stepper,
            rate: map.rate,
            model: map.model,
            parameters: Vec::from_array([-1e4; 3 * DOFS]),
        };
        let record = Record {
            format: u16::MAX,
            count: u32::MAX,
            settings: Settings {
                chain: Some(chain),
                synergy: Some(synergy),
                map: Some(map),
                limits: Limits {
                    silence_ms: u32::MAX,
                    ..Limits::DEFAULT
                },
            },
        };
        let mut bytes = [0; MOST_RECORD];
        assert!(postcard::to_slice_crc32(&record, &mut bytes, CHECK.digest()).is_ok());
    }

    #[test]
    fn every_wrong_bit_and_every_truncation_is_refused() {
        let (_, frame) = request(7, Request::GoTo([0.3, -0.2, 0.1]));
        for bit in 0..8 * (frame.len() - 1) {
            let mut wrong = frame.clone();
            wrong[bit / 8] ^= 1 << (bit % 8);
            assert!(receive(&wrong).iter().all(Result::is_err), "bit {bit}");
        }
        for length in 1..frame.len() - 1 {
            let mut short = frame[..length].to_vec();
            short.push(0);
            assert_eq!(receive(&short), [Err(FrameError::Garbled)], "{length}");
        }
    }

    #[test]
    fn a_frame_that_is_too_long_costs_only_itself() {
        let (message, frame) = request(7, Request::Hold);
        let mut bytes = std::vec![1; 3 * MOST_FRAME];
        bytes.push(0);
        bytes.extend(&frame);
        assert_eq!(receive(&bytes), [Err(FrameError::TooLong), Ok(message)]);
    }
}
