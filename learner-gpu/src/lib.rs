//! Learns joint synergies from recorded reaches (Aubry, Julliard and Gibet 2009, algorithm 1): a whole population of
//! annealers at once, on a GPU or on a CPU's SIMD lanes.
//!
//! - [`csv`], [`motion`], [`recordings`], [`sample`]: from files to motions, whatever the format
//! - [`chain`], [`urdf`]: the arm
//! - [`task`]: what a recording asks of an arm: an initial posture, a target, a reference to be near to
//! - [`problem`]: what is to be learned, and how the controller is set
//! - [`kernel`]: what runs for every member in every generation
//! - [`cpu`], [`gpu`]: where it runs
//! - [`choice`]: which of them is faster for a search
//! - [`learn`], [`finish`]: the search, and its end; [`checkpoint`]: what is kept of it meanwhile
//! - [`mod@bench`]: how fast each of the places is
//! - [`refine`], [`mod@adapt`]: from a member to the floor of its valley, and on from there where that is rugged
//! - [`map`], [`predict`]: from a new target to parameters
//! - [`synergies`], [`synthesis`]: what was learned as a file, and new motions from it
//! - [`experiment`], [`speed`]: what the paper's experiments compare: distances, and the hand's speed
//! - [`export`], [`play`]: what was learned as an arm controller takes it, and a reach on one

pub mod adapt;
pub mod bench;
pub mod chain;
pub mod checkpoint;
pub mod choice;
pub mod cpu;
pub mod csv;
pub mod experiment;
pub mod export;
pub mod finish;
pub mod gpu;
pub mod guess;
pub mod kernel;
mod lanes;
pub mod learn;
pub mod map;
pub mod motion;
pub mod output;
pub mod play;
pub mod predict;
pub mod problem;
pub mod recordings;
pub mod refine;
pub mod sample;
pub mod speed;
pub mod synergies;
pub mod synthesis;
pub mod task;
pub mod urdf;
