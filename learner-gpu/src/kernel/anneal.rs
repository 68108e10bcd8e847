//! A generation of one island: propose, score, accept (SPEC section 6). Mirror of `anneal.wgsl`.

use fearless_simd::Simd;
use serde::{Deserialize, Serialize};
use sinew::real::Real;

use super::philox::key;
use super::proposal::{Draws, ISLAND, MOST_GENES, accepts, blocks, firsts, parameter, propose};
use super::score::{Ready, mean};
use crate::lanes::{Instructions, Lanes, SideBySide};
use crate::problem::Settings;
use crate::refine::Floor;

/// The score of a member that has none yet: every score is better.
pub const UNSCORED: f32 = 1e30;

/// Members that evolve together, and the best that was ever among them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Island {
    /// For each parameter, the members' genes: [`ISLAND`] of them.
    pub genes: Vec<Vec<u32>>,
    /// Each member's score, metres.
    pub scores: Vec<f32>,
    /// The genes of the best ever.
    pub best: Vec<u32>,
    /// Its score, metres.
    pub best_score: f32,
}

impl Island {
    /// Before generation 0.
    pub fn new(genes: usize) -> Self {
        Island {
            genes: vec![vec![0; ISLAND]; genes],
            scores: vec![UNSCORED; ISLAND],
            best: vec![0; genes],
            best_score: UNSCORED,
        }
    }

    /// A member's genes.
    pub fn member(&self, member: usize) -> Vec<u32> {
        self.genes.iter().map(|row| row[member]).collect()
    }

    /// The member with the least score.
    pub fn leader(&self) -> usize {
        let by_score = |&a: &usize, &b: &usize| self.scores[a].total_cmp(&self.scores[b]);
        (0..self.scores.len()).min_by(by_score).unwrap_or(0)
    }

    /// The member with the greatest score.
    pub fn worst(&self) -> usize {
        let by_score = |&a: &usize, &b: &usize| self.scores[a].total_cmp(&self.scores[b]);
        (0..self.scores.len()).max_by(by_score).unwrap_or(0)
    }

    /// Puts what was found in a member's place, where it is better, and notes the best ever.
    pub fn settle(&mut self, member: usize, floor: &Floor) {
        if floor.score < self.scores[member] {
            self.scores[member] = floor.score;
            for (row, &gene) in self.genes.iter_mut().zip(&floor.genes) {
                row[member] = gene;
            }
        }
        if floor.score < self.best_score {
            self.best_score = floor.score;
            self.best.copy_from_slice(&floor.genes);
        }
    }
}

/// Which island this is, and what its members are scored on.
pub(crate) struct Place<'a, S: Simd, const N: usize> {
    /// How the controller is set.
    pub settings: &'a Settings,
    /// The bounds of each parameter.
    pub bounds: &'a [(f32, f32)],
    /// The motions of the set.
    pub motions: &'a [Ready<Lanes<S>, N>],
    /// The run's seed.
    pub seed: u64,
    /// The set's number.
    pub set: u32,
    /// The island's number in its set.
    pub island: u32,
}

impl<S: Instructions, const N: usize> Place<'_, S, N> {
    /// Runs one generation.
    #[inline(always)]
    pub fn generation(&self, island: &mut Island, generation: u32) {
        let count = island.genes.len();
        let draws = Draws {
            seed: key(self.seed),
            set: self.set,
            member: self.island * ISLAND as u32,
            generation,
        };
        let own = blocks(&draws, 0);
        let (best, temperature) = spread(&island.scores, count);
        let mut proposed = [[0; ISLAND]; MOST_GENES];
        let proposed = &mut proposed[..count];
        match generation {
            0 => firsts(&draws, proposed),
            _ => propose(&draws, &own, &island.genes, best, proposed),
        }

        let mut values = [[0.0; ISLAND]; MOST_GENES];
        for (k, genes) in proposed.iter().enumerate() {
            for me in 0..ISLAND {
                values[k][me] = parameter(genes[me], self.bounds[k]);
            }
        }
        let lanes = Lanes::<S>::COUNT;
        let mut scores = [0.0; ISLAND];
        for (some, scores) in scores.chunks_mut(lanes).enumerate() {
            let mut parameters = [Lanes::<S>::zero(); MOST_GENES];
            for (parameter, values) in parameters.iter_mut().zip(&values) {
                *parameter = Lanes::load(&values[lanes * some..][..lanes]);
            }
            mean::<S, _, N>(self.motions, self.settings, &parameters[..count]).store(scores);
        }

        let mut taken = [false; ISLAND];
        for (me, current) in island.scores.iter_mut().enumerate() {
            taken[me] = accepts(*current, scores[me], temperature, own[2][me]);
            if taken[me] {
                *current = scores[me];
            }
        }
        for (row, proposed) in island.genes.iter_mut().zip(proposed.iter()) {
            let Some(row) = row.first_chunk_mut::<ISLAND>() else {
                continue;
            };
            let before = *row;
            for me in 0..ISLAND {
                row[me] = if taken[me] { proposed[me] } else { before[me] };
            }
        }
        let (leader, _) = spread(&scores, count);
        if scores[leader] < island.best_score {
            island.best_score = scores[leader];
            for (gene, proposed) in island.best.iter_mut().zip(proposed.iter()) {
                *gene = proposed[leader];
            }
        }
    }
}

/// The least temperature: where all scores are alike, rounding may put their mean below the least of them.
const COLDEST: f32 = 1e-20;

/// The member with the least score, and the temperature: the mean less the least, over the number of parameters.
fn spread(scores: &[f32], genes: usize) -> (usize, f32) {
    let (mut best, mut least, mut sum) = (0, UNSCORED, 0.0);
    for (member, &score) in scores.iter().enumerate() {
        sum += score;
        if score < least {
            (best, least) = (member, score);
        }
    }
    let temperature = (sum / ISLAND as f32 - least) / genes as f32;
    (best, temperature.max(COLDEST))
}
