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

/// A number of each member of an island.
pub type Row = [u32; ISLAND];

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

/// Writes to `out` the genes of an island's members in generation 0 ([`first`]), where `draws` are those of its first.
#[inline(always)]
pub fn firsts(draws: &Draws, out: &mut [Row]) {
    for (four, rows) in out.chunks_mut(4).enumerate() {
        for (row, draws) in rows.iter_mut().zip(blocks(draws, 1 + four as u32)) {
            *row = draws.map(|draw| draw >> 8);
        }
    }
}

/// The `number`th four draws of each member of an island, where `draws` are those of its first.
#[inline(always)]
pub fn blocks(draws: &Draws, number: u32) -> [Row; 4] {
    let mut out = [[0; ISLAND]; 4];
    for me in 0..ISLAND {
        let member = draws.member + me as u32;
        let four = Draws { member, ..*draws }.block(number);
        for (row, draw) in out.iter_mut().zip(four) {
            row[me] = draw;
        }
    }
    out
}

/// Writes to `out` the genes that each member of an island is to try in a later generation.
///
/// `island[k]` has the members' gene k as the generation began, `best` is the member with the least score, `own` are the
/// first [`blocks`] of draws, of which the third decides acceptance.
#[inline(always)]
pub fn propose(draws: &Draws, own: &[Row; 4], island: &[Vec<u32>], best: usize, out: &mut [Row]) {
    // A loop over the members for each thing that a thread of the shader does, so that they run on SIMD lanes.
    let genes = island.len();
    let others = ISLAND as u32 - 1;
    let (mut a, mut b, mut sure) = ([0; ISLAND], [0; ISLAND], [0; ISLAND]);
    let (mut kind, mut share, mut bits) = ([0; ISLAND], [0; ISLAND], [0; ISLAND]);
    for me in 0..ISLAND {
        let first = own[0][me] % others;
        let second = (own[0][me] / others) % (others - 1);
        let second = if second >= first { second + 1 } else { second };
        a[me] = (me as u32 + 1 + first) % ISLAND as u32;
        b[me] = (me as u32 + 1 + second) % ISLAND as u32;
        // Which kind of step, what share of the genes, and how large a jitter.
        kind[me] = own[1][me] & 3;
        share[me] = (64 << ((own[1][me] >> 5) & 3)).min(256);
        let jitter = 1 + (own[1][me] >> 7) % 22;
        bits[me] = if kind[me] < 2 { 19 } else { jitter };
        // At least one gene takes part.
        sure[me] = own[3][me] % genes as u32;
    }

    let mut noise = [[0; ISLAND]; MOST_GENES];
    for (four, rows) in noise.chunks_mut(4).enumerate().take(genes.div_ceil(4)) {
        rows.copy_from_slice(&blocks(draws, 1 + four as u32));
    }
    let takes_part =
        |k: usize, me: usize, noise: u32| (noise & 255 < share[me]) | (k as u32 == sure[me]);
    let mut count = [0; ISLAND];
    for (k, noise) in noise.iter().enumerate().take(genes) {
        for me in 0..ISLAND {
            count[me] += u32::from(takes_part(k, me, noise[me]));
        }
    }
    let mut step = [0; ISLAND];
    for me in 0..ISLAND {
        let leap = ((own[1][me] >> 2) & 7 == 0) & (kind[me] < 2);
        step[me] = if leap { 64 } else { STEP[count[me] as usize] };
    }

    for (k, (row, out)) in island.iter().zip(out).enumerate() {
        let Some(&row) = row.first_chunk::<ISLAND>() else {
            continue;
        };
        let best = row[best] as i32;
        let mut apart = [0; ISLAND];
        for me in 0..ISLAND {
            let of = |other: u32| row[other as usize % ISLAND] as i32;
            apart[me] = of(a[me]) - of(b[me]);
        }
        let mut moved = [0; ISLAND];
        for me in 0..ISLAND {
            let x = row[me] as i32;
            let difference = without_last_bits(apart[me] * step[me], 6);
            let approach = without_last_bits((best - x) * 32, 6);
            // A uniform draw in ±2²³.
            let uniform = (noise[k][me] >> 8) as i32 - (1 << 23);
            let jitter = without_last_bits(uniform, bits[me]);
            let varied = difference + if kind[me] == 2 { approach } else { jitter };
            let delta = if kind[me] == 3 { jitter } else { varied };
            let to = (x + delta).clamp(0, GENE as i32);
            let end = if takes_part(k, me, noise[k][me]) {
                to
            } else {
                x
            };
            moved[me] = end as u32;
        }
        *out = moved;
    }
}

/// x / 2^bits, rounded towards 0.
#[inline(always)]
fn without_last_bits(x: i32, bits: u32) -> i32 {
    (x + ((x >> 31) & (1_i32.wrapping_shl(bits) - 1))).wrapping_shr(bits)
}

/// The parameter that a gene stands for.
#[inline(always)]
pub fn parameter(gene: u32, (lower, upper): (f32, f32)) -> f32 {
    // Signed: AVX2 has no conversion from what is not.
    lower + (upper - lower) * (gene as i32 as f32 * (1.0 / GENE as f32))
}

/// The gene that stands for a parameter, rounded down and within the bounds: [`parameter`]'s inverse.
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
