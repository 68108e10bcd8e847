//! How a member of the population is varied (SPEC section 6). Mirror of `proposal.wgsl`.
//!
//! A parameter is held as a whole number in [0, 2²⁴] that spans its bounds (its *gene*), and a proposal is whole-number
//! arithmetic on genes and draws, so that no device's rounding comes between two backends: same seed, same bits.
//!
//! Members live in *islands* of [`ISLAND`]; a proposal looks only at the members of its own. Of every four:
//! - two step along the difference of two other members, x + γ(a − b) with γ = 2.38/√(2d) for the d genes that take
//!   part (differential evolution Monte Carlo: ter Braak 2006, *Statistics and Computing* 16), one in eight of these
//!   with γ = 1 to change valleys;
//! - one also steps a part of the way to the island's best (current-to-best differential evolution: Storn and Price
//!   1997);
//! - one jitters its genes by a step whose size is drawn over all scales, 2⁻¹ to 2⁻²² of the bounds.
//!
//! So steps follow the population's own shape and size, and need no tuning. All of them, half or a quarter of the
//! genes take part, drawn each time. A gene that would leave its bounds stays on them.

use super::philox::philox;

/// Members of an island: a GPU workgroup.
pub const ISLAND: usize = 64;
/// A gene at its upper bound.
pub const GENE: u32 = 1 << 24;
/// The most parameters a member can have.
pub const MOST_GENES: usize = 24;

/// What the draws of one member in one generation depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draws {
    /// The run's seed, low and high half.
    pub seed: [u32; 2],
    /// The set of motions that the population is for.
    pub set: u32,
    /// The member, counted over all islands of the set.
    pub member: u32,
    /// The generation.
    pub generation: u32,
}

impl Draws {
    /// The `block`th four draws.
    #[inline(always)]
    pub fn block(&self, block: u32) -> [u32; 4] {
        philox([block, self.generation, self.member, self.set], self.seed)
    }
}

/// 64·2.38/√(2d) for d genes, to the nearest whole number.
const STEP: [i32; MOST_GENES + 1] = [
    0, 108, 76, 62, 54, 48, 44, 41, 38, 36, 34, 32, 31, 30, 29, 28, 27, 26, 25, 25, 24, 24, 23, 22,
    22,
];

/// A member's genes in generation 0: uniform in the bounds.
#[inline(always)]
pub fn first(draws: &Draws, genes: usize) -> [u32; MOST_GENES] {
    let mut out = [0; MOST_GENES];
    for (four, row) in out.chunks_mut(4).enumerate().take(genes.div_ceil(4)) {
        for (gene, draw) in row.iter_mut().zip(draws.block(1 + four as u32)) {
            *gene = draw >> 8;
        }
    }
    out
}

/// A member's genes to be tried in a later generation.
///
/// `island[k][i]` is gene k of member i as the generation began, `me` the member's place in the island, `best` that of
/// the best. `own` is the first block of draws, whose third decides acceptance.
#[inline(always)]
pub fn propose(
    draws: &Draws,
    own: [u32; 4],
    island: &[[u32; ISLAND]],
    me: usize,
    best: usize,
) -> [u32; MOST_GENES] {
    let others = ISLAND as u32 - 1;
    let first = own[0] % others;
    let second = (own[0] / others) % (others - 1);
    let second = if second >= first { second + 1 } else { second };
    let a = (me + 1 + first as usize) % ISLAND;
    let b = (me + 1 + second as usize) % ISLAND;

    // Which kind of step, what share of the genes, and how large a jitter.
    let kind = own[1] & 3;
    let leap = (own[1] >> 2) & 7 == 0;
    let share = [64, 128, 256, 256][((own[1] >> 5) & 3) as usize];
    let jitter = 1 + (own[1] >> 7) % 22;

    let genes = island.len();
    let mut noise = [0; MOST_GENES];
    for (four, row) in noise.chunks_mut(4).enumerate().take(genes.div_ceil(4)) {
        row.copy_from_slice(&draws.block(1 + four as u32));
    }
    // At least one gene takes part.
    let sure = (own[3] as usize) % genes;
    let takes_part = |k: usize, noise: u32| (noise & 255) < share || k == sure;
    let mut count = 0;
    for k in 0..genes {
        count += usize::from(takes_part(k, noise[k]));
    }
    let step = if leap && kind < 2 { 64 } else { STEP[count] };

    let mut out = [0; MOST_GENES];
    for (k, row) in island.iter().enumerate() {
        let x = row[me] as i32;
        let difference = (row[a] as i32 - row[b] as i32) * step / 64;
        // A uniform draw in ±2²³.
        let uniform = (noise[k] >> 8) as i32 - (1 << 23);
        let delta = match kind {
            0 | 1 => difference + uniform / (1 << 19),
            2 => difference + (row[best] as i32 - x) * 32 / 64,
            _ => uniform / (1 << jitter),
        };
        let moved = (x + delta).clamp(0, GENE as i32) as u32;
        out[k] = if takes_part(k, noise[k]) {
            moved
        } else {
            row[me]
        };
    }
    out
}

/// The parameter that a gene stands for.
#[inline(always)]
pub fn parameter(gene: u32, (lower, upper): (f32, f32)) -> f32 {
    lower + (upper - lower) * (gene as f32 * (1.0 / GENE as f32))
}

/// The gene that stands for a parameter: [`parameter`]'s inverse, and within the bounds.
pub fn gene(parameter: f64, (lower, upper): (f32, f32)) -> u32 {
    let share = (parameter - f64::from(lower)) / f64::from(upper - lower);
    ((share * f64::from(GENE)) as u32).min(GENE)
}

/// Whether annealing accepts a change of score: always where it does not rise, else with probability exp(−rise/T), by
/// a draw (Metropolis et al. 1953).
///
/// T is the island's spread of scores, mean − best, over the number of parameters: as the members gather the island
/// cools, and no schedule is needed.
#[inline(always)]
pub fn accepts(current: f32, proposed: f32, temperature: f32, draw: u32) -> bool {
    let rise = proposed - current;
    rise <= 0.0 || sinew::math::exp(-rise / temperature) > (draw >> 8) as f32 * (1.0 / 16_777_216.0)
}
