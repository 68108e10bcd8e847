//! What can go wrong on a device.

use crate::kernel::compose::ComposeError;
use crate::task::TaskError;

/// Why the GPU path cannot be taken, or goes no further.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no driver for any device.
    #[error("no Vulkan, Metal or Direct3D 12 adapter was found")]
    NoAdapter,
    /// No adapter has that name.
    #[error("no adapter has {name:?} in its name; there are: {has}")]
    NoSuchAdapter {
        /// What was asked for.
        name: String,
        /// The names that there are.
        has: String,
    },
    /// The adapter gave no device.
    #[error("{adapter} cannot be used: {reason}")]
    Open {
        /// The adapter.
        adapter: String,
        /// What its driver said.
        reason: String,
    },
    /// A task is wrong.
    #[error(transparent)]
    Task(#[from] TaskError),
    /// No kernel can be made for the motions' arms.
    #[error("no kernel: {0}")]
    Compose(#[from] ComposeError),
    /// A recorded frame has another number of points than the arm has landmarks.
    #[error("motion {motion:?}: frame {frame} has {found} points, expected {expected}")]
    Points {
        /// The motion.
        motion: String,
        /// The frame.
        frame: usize,
        /// Landmarks and the tip.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// A motion is longer than a thread may run in a dispatch.
    #[error("motion {motion:?} has {found} frames, the GPU path takes {most} at most")]
    Frames {
        /// The motion.
        motion: String,
        /// How many it has.
        found: usize,
        /// How many it may have.
        most: usize,
    },
    /// The islands are not the problem's.
    #[error("the population does not fit the problem: {what} is {found}, expected {expected}")]
    Population {
        /// What is wrong.
        what: &'static str,
        /// How many there should be.
        expected: usize,
        /// How many there are.
        found: usize,
    },
    /// More of something is needed than the device offers.
    #[error("the device is too small: {what} takes {needed} bytes, the limit is {limit}")]
    Limit {
        /// Of what.
        what: &'static str,
        /// Bytes needed.
        needed: u64,
        /// Bytes there are.
        limit: u64,
    },
    /// The driver refused something: out of memory, or a fault of it or of ours.
    #[error("the device refused: {0}")]
    Refused(String),
    /// The device is gone, and the population on it. What was read back before is whole and can go on elsewhere.
    #[error("the device was lost: {0}")]
    Lost(String),
}
