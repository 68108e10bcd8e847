//! What a host and the arm controller say to each other, defined once for both.
//!
//! A frame on the line is `COBS(postcard(Envelope) ‖ CRC-32C) ‖ 0x00`: COBS leaves no zero inside a frame, so that a
//! receiver that lost its place finds it again at the next zero; the CRC (Castagnoli's polynomial, RFC 3720 appendix
//! B.4) refuses what noise made of a frame. Every request has a sequence number ahead of the one before, by less than 2³¹,
//! for numbers wrap; the controller refuses any other, so that a frame that a line repeats or delays moves nothing twice.
//! After a reset it counts from 0 again.
//!
//! - [`message`]: requests, replies, and what they carry
//! - [`frame`]: encoding, and a receiver that takes one byte at a time
//!
//! Not here: encryption, and proof of who sent a frame. Keep the line to yourself.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod frame;
pub mod message;

pub use frame::{FrameError, MOST_FRAME, MOST_REPLY, Receiver, encode};
pub use message::*;
