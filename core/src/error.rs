//! What can be wrong with what a caller gives.

use core::fmt;

/// Why something was refused. `joint` counts DoFs from 0 at the base.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// A number is NaN or infinite.
    NotFinite {
        /// What it belongs to.
        what: &'static str,
        /// The DoF, where it belongs to one.
        joint: Option<usize>,
    },
    /// A number lies outside what is accepted.
    OutOfRange {
        /// What it is, and what is accepted.
        what: &'static str,
        /// The DoF, where it belongs to one.
        joint: Option<usize>,
    },
    /// A DoF's axis has no direction.
    ZeroAxis {
        /// The DoF.
        joint: usize,
    },
    /// A DoF's lower limit is above its upper one.
    LimitsReversed {
        /// The DoF.
        joint: usize,
    },
    /// A landmark lies on a DoF that the chain does not have, or the landmarks are not in chain order.
    NoSuchLandmark {
        /// The landmark, counted from 0.
        landmark: usize,
        /// The DoF it names.
        joint: usize,
        /// How many DoFs there are.
        joints: usize,
    },
    /// There are not as many items as the type says.
    WrongCount {
        /// Of what.
        what: &'static str,
        /// How many there should be.
        expected: usize,
        /// How many there were.
        found: usize,
    },
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let at = |f: &mut fmt::Formatter<'_>, joint: Option<usize>| match joint {
            Some(joint) => write!(f, " (joint {joint})"),
            None => Ok(()),
        };
        match *self {
            Error::NotFinite { what, joint } => {
                write!(f, "{what} must be a finite number")?;
                at(f, joint)
            }
            Error::OutOfRange { what, joint } => {
                f.write_str(what)?;
                at(f, joint)
            }
            Error::ZeroAxis { joint } => write!(f, "the axis must not be zero (joint {joint})"),
            Error::LimitsReversed { joint } => {
                write!(
                    f,
                    "the lower limit must not be above the upper one (joint {joint})"
                )
            }
            Error::NoSuchLandmark {
                landmark,
                joint,
                joints,
            } => write!(
                f,
                "landmark {landmark} lies on joint {joint}: landmarks must be in chain order and on joints 0 to {}",
                joints.saturating_sub(1)
            ),
            Error::WrongCount {
                what,
                expected,
                found,
            } => {
                write!(f, "expected {expected} {what}, found {found}")
            }
        }
    }
}

impl core::error::Error for Error {}
