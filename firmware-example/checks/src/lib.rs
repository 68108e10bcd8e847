//! What the checks share: the motions that a microcontroller and a host compute alike.
#![cfg_attr(target_os = "none", no_std)]
#![deny(unsafe_code)]

pub mod console;
pub mod motions;
pub mod plain;
