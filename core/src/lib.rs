//! Kinematics for arms that move like people do.
//!
//! A person's arm does not move like an inverse-kinematics solver: joints are recruited in fixed proportions and over
//! time, and the hand's speed is a bell. Aubry, Julliard and Gibet (2009, "the paper") put that into any iterative
//! inverse kinematics: a gain and a sigmoid in time on each degree of freedom (DoF). This crate is the model: what
//! runs every control tick on the arm, and what a learner scores when it looks for the parameters.
//!
//! - [`chain`]: a serial chain of revolute and prismatic DoFs, validated and folded once
//! - [`kinematics`]: forward kinematics, landmarks, Jacobian
//! - [`stepper`]: one step of inverse kinematics: Jᵀ, NJᵀ, J⁺, damped and selectively damped least squares
//! - [`synergy`]: gains and time functions on the DoFs
//! - [`map`]: which synergy serves a new target
//! - [`controller`]: the tick that puts these together
//! - [`metric`]: the distance between two motions
//! - [`real`], [`math`]: the scalar all of it is written for
//!
//! No `std`, no heap, no `unsafe`, no panic: sizes are const generics, and what could be invalid is refused where it
//! is constructed. Angles are radians, lengths metres, times seconds; frames are right-handed; vectors are in the
//! base frame unless said otherwise.
//!
//! ```
//! use sinew::{chain::human_arm, controller::{Controller, Limits}, stepper::Transpose, synergy::Synergy, target::Position};
//! # fn main() -> Result<(), sinew::Error> {
//! let arm = human_arm::<f32>(0.29, 0.25, 0.09)?;
//! let synergy = Synergy::c([1.0, 0.4, 0.2, 1.5, 0.0, 0.3, 0.1], 4.0, 8.0)?;
//! let controller = Controller::new(&arm, Transpose, synergy, 100.0, 1.0 / 60.0, Limits::Clamped)?;
//! let mut state = controller.start([0.0, 0.2, 0.0, 1.2, 0.0, 0.0, 0.0]);
//! let target = Position::new([0.3, 0.1, -0.2])?;
//! for _ in 0..120 {
//!     controller.tick(&mut state, &target);
//! }
//! let tip = arm.forward(state.angles()).tip();
//! # assert!((tip[0] - 0.3).abs() < 0.01 && (tip[1] - 0.1).abs() < 0.01 && (tip[2] + 0.2).abs() < 0.01, "{tip:?}");
//! # Ok(())
//! # }
//! ```
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

#[cfg(not(any(feature = "libm", feature = "micromath")))]
compile_error!("sinew needs the feature `libm` (the default) or `micromath` for its square roots");

pub mod chain;
pub mod controller;
mod error;
pub mod kinematics;
pub mod map;
pub mod math;
pub mod metric;
pub mod real;
pub mod stepper;
pub mod synergy;
pub mod target;
mod vector;

pub use error::Error;
