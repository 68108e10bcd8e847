//! The kernels: what runs for every member of a population in every generation. Each piece is a `.rs` for the CPU
//! beside a `.wgsl` of the same name for the GPU, with the same operations in the same order.

pub mod anneal;
pub mod compose;
pub mod philox;
pub mod proposal;
pub mod score;
