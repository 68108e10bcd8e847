//! An arm controller for a Cortex-M: targets and synergies in over a serial line, joint angles out to servos.
//!
//! ```text
//! bytes ─► protocol ─► node ─► arm (sinew's controller, paced) ─► servo ─► PWM
//!                       └► store (flash)
//! ```
//!
//! - [`arm`]: the motion: a tick of the core's controller, held within limits of speed and acceleration
//! - [`pace`]: those limits, for one DoF
//! - [`planner`]: a synergy for each reach, from a learned map
//! - [`node`]: requests, replies, and the watchdog of the line
//! - [`store`]: what survives a reset
//! - [`servo`]: from an angle to a pulse
//! - [`convert`]: from what the line carries to what the core takes
//! - [`learned`]: a reach and its synergy, as `sinew export` wrote it from `learned.json`
//! - [`board`]: what a board has to offer, and the boards there are
//!
//! All but the boards runs on a host too, with the same bits.
#![no_std]
#![deny(unsafe_code)]

pub mod arm;
pub mod board;
pub mod convert;
pub mod learned;
pub mod node;
pub mod pace;
pub mod planner;
pub mod run;
pub mod servo;
pub mod store;

/// Ticks a second.
pub const RATE_HZ: u32 = 1000;

/// The period, seconds.
pub const PERIOD: f32 = 1.0 / RATE_HZ as f32;
