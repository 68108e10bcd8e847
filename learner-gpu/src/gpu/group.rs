//! As many islands as fit the device's bindings, with all that they are scored on.
//!
//! Islands know nothing of each other, so a population too large for one binding is split into groups that run in
//! turn, and a dispatch may run any part of a group: neither changes a bit.

use std::collections::HashMap;
use std::num::NonZero;
use std::ops::Range;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindingResource, Buffer, BufferBinding,
    BufferDescriptor, BufferUsages,
};

use super::device::{Device, PART};
use super::error::GpuError;
use super::kernel::{Kernel, MOST_GENERATIONS, RUN_BYTES, RUN_STRIDE, WINDOW};
use super::motions::{Motions, TURNS, TURNS_A_HARD_FRAME};
use crate::kernel::anneal::Island;
use crate::kernel::proposal::ISLAND;
use crate::problem::Problem;

/// How large buffers can be, bytes.
struct Limits {
    /// The motions' data.
    data: u64,
    /// Every other.
    each: u64,
}

/// What goes into a group's buffers, in words of 4 bytes.
#[derive(Default)]
struct Contents {
    /// Of each motion, its arm, its task and its recorded points.
    data: Vec<u32>,
    /// For each motion of each set: where its data begin, in fours, and how many frames there are.
    motions: Vec<u32>,
    /// For each island: set, number in it, the set's first motion, how many.
    places: Vec<u32>,
    /// The islands themselves.
    islands: Vec<u32>,
    /// For each island, what is known of it as a whole.
    summaries: Vec<u32>,
    /// Ticks that a generation of each island takes.
    ticks: Vec<u64>,
}

impl Contents {
    /// Motions that each island is scored on.
    fn motions_each(&self) -> Vec<u32> {
        let places = self.places.chunks_exact(4);
        places.map(|place| place[3]).collect()
    }

    /// A buffer above its limit: what it holds, its size and its limit in bytes.
    fn too_large(&self, limits: &Limits) -> Option<(&'static str, u64, u64)> {
        let sizes = [
            ("the recordings", self.data.len(), limits.data),
            ("the list of motions", self.motions.len(), limits.each),
            ("the list of islands", self.places.len(), limits.each),
            ("the population", self.islands.len(), limits.each),
            (
                "the population's summary",
                self.summaries.len(),
                limits.each,
            ),
        ];
        sizes
            .into_iter()
            .map(|(what, words, limit)| (what, words as u64 * 4, limit))
            .find(|&(_, needed, limit)| needed > limit)
    }
}

/// Islands that run together.
pub(super) struct Group {
    /// Which of the problem's.
    pub islands: Range<usize>,
    /// Ticks that a generation of each takes.
    pub ticks: Vec<u64>,
    /// Motions that each is scored on, and the most of these.
    pub motions: Vec<u32>,
    pub most_motions: u32,
    /// Islands, each on one motion, for whose scores there is room at once: as many as there are islands, at least.
    pub slots: usize,
    pub bindings: BindGroup,
    pub run: Buffer,
    population: Buffer,
    summaries: Buffer,
    scored: Buffer,
    /// Which of the scored motions have to be scored once more, and how many of them a thread has at most.
    pub hard: Buffer,
    pub hard_a_thread: u32,
}

impl Group {
    /// The problem's islands in as few groups as have no buffer above its limit.
    ///
    /// # Errors
    /// A single island whose motions are above it.
    pub fn all(
        device: &Device,
        kernel: &Kernel,
        problem: &Problem,
        motions: &Motions,
        islands: &[Island],
        limit: u64,
    ) -> Result<Vec<Group>, GpuError> {
        let data = match kernel.window {
            true => WINDOW,
            false => limit,
        };
        let limits = Limits { data, each: limit };
        let mut groups = Vec::new();
        let mut first = 0;
        while first < islands.len() {
            let (contents, end) = gather(problem, motions, islands, first, &limits)?;
            let group = Group::new(device, kernel, motions, contents, first..end, limit);
            groups.push(group);
            device.check()?;
            first = end;
        }
        Ok(groups)
    }

    fn new(
        device: &Device,
        kernel: &Kernel,
        motions: &Motions,
        contents: Contents,
        islands: Range<usize>,
        limit: u64,
    ) -> Self {
        let uniform = |label, size| {
            device.device.create_buffer(&BufferDescriptor {
                label: Some(label),
                size,
                usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let storage = |label, words: &[u32]| {
            let buffer = device.storage(label, words.len());
            device.write(&buffer, words);
            buffer
        };
        let run = uniform("run", u64::from(MOST_GENERATIONS) * RUN_STRIDE);
        let data = match kernel.window {
            true => uniform("data", WINDOW),
            false => device.storage("data", contents.data.len()),
        };
        device.write(&data, &contents.data);
        let list = storage("motions", &contents.motions);
        let places = storage("places", &contents.places);
        let summaries = storage("summaries", &contents.summaries);
        let population = storage("islands", &contents.islands);
        let each = contents.motions_each();
        let most_motions = each.iter().copied().max().unwrap_or(0);
        // An island's scores take less than its genes, so there is always room for one motion.
        let slots = (islands.len() as u64 * u64::from(most_motions))
            .min(limit / (ISLAND as u64 * 4))
            .max(1) as usize;
        let scored = device.storage("scored", slots * ISLAND);
        // A list as long as all scores, after its length.
        let hard = device.storage(
            "hard",
            if kernel.has_hard {
                1 + slots * ISLAND
            } else {
                1
            },
        );
        let longest = motions.each.iter().map(|motion| motion.frames).max();
        let turns = longest.unwrap_or(0).max(1) as usize * TURNS_A_HARD_FRAME;
        let buffers = [
            &data,
            &list,
            &places,
            &population,
            &summaries,
            &scored,
            &hard,
        ];
        // A window on it that moves from generation to generation.
        let moving = BindingResource::Buffer(BufferBinding {
            buffer: &run,
            offset: 0,
            size: NonZero::new(RUN_BYTES),
        });
        let whole = buffers.into_iter().map(Buffer::as_entire_binding);
        let resources = std::iter::once(moving).chain(whole).enumerate();
        let entry = |(binding, resource)| BindGroupEntry {
            binding: binding as u32,
            resource,
        };
        let bindings = device.device.create_bind_group(&BindGroupDescriptor {
            label: Some("group"),
            layout: &kernel.layout,
            entries: &resources.map(entry).collect::<Vec<_>>(),
        });
        Group {
            islands,
            motions: each,
            most_motions,
            ticks: contents.ticks,
            slots,
            bindings,
            run,
            population,
            summaries,
            scored,
            hard,
            // Few need it: a thread for each would mostly find nothing to do.
            hard_a_thread: (TURNS / turns).clamp(1, 32) as u32,
        }
    }

    /// The islands, from the device.
    ///
    /// # Errors
    /// The device is lost.
    pub fn read(
        &self,
        device: &Device,
        genes: usize,
        generation: u32,
    ) -> Result<Vec<Island>, GpuError> {
        let each = words_an_island(genes);
        let summaries = self.whole_summaries(device, genes, generation)?;
        let summaries: Vec<&[u32]> = summaries.chunks_exact(words_a_summary(genes)).collect();
        let mut islands = Vec::with_capacity(self.islands.len());
        for some in summaries[..self.islands.len()].chunks((PART / each).max(1)) {
            let from = islands.len() * each;
            let words = device.read_part(&self.population, from..from + some.len() * each)?;
            let words = words.chunks_exact(each).zip(some);
            islands.extend(words.map(|(words, summary)| unpacked(words, summary, genes)));
        }
        Ok(islands)
    }

    /// Of each island: the best score ever, and the members' mean score.
    ///
    /// # Errors
    /// The device is lost.
    pub fn summaries(
        &self,
        device: &Device,
        genes: usize,
        generation: u32,
    ) -> Result<Vec<(f32, f32)>, GpuError> {
        let words = self.whole_summaries(device, genes, generation)?;
        let each = words.chunks_exact(words_a_summary(genes));
        Ok(each
            .take(self.islands.len())
            .map(|words| (f32::from_bits(words[0]), f32::from_bits(words[1])))
            .collect())
    }

    /// The islands' summaries, if they are those with which this generation begins: not every driver says so when it has
    /// given up.
    fn whole_summaries(
        &self,
        device: &Device,
        genes: usize,
        generation: u32,
    ) -> Result<Vec<u32>, GpuError> {
        let words = device.read(&self.summaries)?;
        let each = words.chunks_exact(words_a_summary(genes));
        let mut each = each.take(self.islands.len());
        match each.find(|summary| summary[3] >> BEST_BITS != generation) {
            Some(_) => Err(GpuError::Lost(format!(
                "not all islands have come to generation {generation}"
            ))),
            None => Ok(words),
        }
    }

    /// What `score_members` wrote: the scores of so many islands' members on one motion, then on the next, for so many.
    ///
    /// # Errors
    /// The device is lost.
    pub fn scored(
        &self,
        device: &Device,
        islands: usize,
        motions: usize,
    ) -> Result<Vec<f32>, GpuError> {
        let words = device.read_part(&self.scored, 0..islands * motions * ISLAND)?;
        Ok(words.into_iter().map(f32::from_bits).collect())
    }
}

/// Islands from `first` on, until the next would make a buffer too large; and the one after them.
fn gather(
    problem: &Problem,
    motions: &Motions,
    islands: &[Island],
    first: usize,
    limits: &Limits,
) -> Result<(Contents, usize), GpuError> {
    let islands_a_set = problem.islands.max(1);
    let mut contents = Contents::default();
    let mut begins = HashMap::new();
    let mut set_at = (usize::MAX, 0, 0);
    for (number, island) in islands.iter().enumerate().skip(first) {
        let (set, place) = (number / islands_a_set, number % islands_a_set);
        let members: &[usize] = problem.sets.get(set).map_or(&[], Vec::as_slice);
        // The sizes as they would be with this island, before it is put in.
        let before = (contents.data.len(), contents.motions.len());
        if set_at.0 != set {
            let begin = contents.motions.len() as u32 / 2;
            let mut ticks = 0;
            for task in members {
                let Some(motion) = motions.each.get(*task) else {
                    continue;
                };
                let at = *begins.entry(*task).or_insert_with(|| {
                    let at = contents.data.len() as u32 / 4;
                    contents.data.extend(&motion.data);
                    at
                });
                contents.motions.extend([at, motion.frames]);
                ticks += u64::from(motion.frames) * ISLAND as u64;
            }
            set_at = (set, begin, ticks);
        }
        let (_, begin, ticks) = set_at;
        contents.places.extend([
            set as u32,
            place as u32,
            begin,
            contents.motions.len() as u32 / 2 - begin,
        ]);
        pack(&mut contents, island);
        contents.ticks.push(ticks);

        if let Some((what, needed, limit)) = contents.too_large(limits) {
            if number == first {
                return Err(GpuError::Limit {
                    what,
                    needed,
                    limit,
                });
            }
            // One too many.
            let kept = number - first;
            contents.data.truncate(before.0);
            contents.motions.truncate(before.1);
            for words in [
                &mut contents.places,
                &mut contents.islands,
                &mut contents.summaries,
            ] {
                words.truncate(words.len() / (kept + 1) * kept);
            }
            contents.ticks.truncate(kept);
            return Ok((contents, number));
        }
    }
    Ok((contents, islands.len()))
}

/// Bits of the best member's number in its island, in `anneal.wgsl`; above them is the generation.
const BEST_BITS: u32 = ISLAND.ilog2();

/// Words that all members' genes take.
fn words_a_side(genes: usize) -> usize {
    genes.next_multiple_of(4) * ISLAND
}

/// Words of a `Members` in `anneal.wgsl`: two sides, scores, sums, draws.
fn words_an_island(genes: usize) -> usize {
    2 * words_a_side(genes) + 3 * ISLAND
}

/// Words of a `Summary` in `anneal.wgsl` before the genes of the best ever: best score ever, mean score, temperature, best
/// member and generation, sides, and two that fill a four up.
const SUMMARY: usize = 8;

/// Words of a `Summary`.
fn words_a_summary(genes: usize) -> usize {
    SUMMARY + genes.next_multiple_of(4)
}

/// Puts an island in: all members' genes are on their first sides.
fn pack(contents: &mut Contents, island: &Island) {
    let each = words_an_island(island.genes.len());
    let end = contents.islands.len() + each;
    for four in island.genes.chunks(4) {
        for member in 0..ISLAND {
            let gene = |k: usize| four.get(k).map_or(0, |row| row[member]);
            contents.islands.extend([0, 1, 2, 3].map(gene));
        }
    }
    let other = contents.islands.len() + words_a_side(island.genes.len());
    contents.islands.resize(other, 0);
    let scores = island.scores.iter().map(|score| score.to_bits());
    contents.islands.extend(scores);
    contents.islands.resize(end, 0);
    let mut summary = [0; SUMMARY];
    summary[0] = island.best_score.to_bits();
    contents.summaries.extend(summary);
    contents.summaries.extend(&island.best);
    let whole = contents.summaries.len().next_multiple_of(4);
    contents.summaries.resize(whole, 0);
}

fn unpacked(words: &[u32], summary: &[u32], genes: usize) -> Island {
    let a_side = words_a_side(genes);
    let row = |k: usize| {
        let gene = |member: usize| {
            let side = summary[4 + member / 32] >> (member % 32) & 1;
            words[side as usize * a_side + (k / 4 * ISLAND + member) * 4 + k % 4]
        };
        (0..ISLAND).map(gene).collect()
    };
    let scores = words[2 * a_side..][..ISLAND].iter();
    Island {
        genes: (0..genes).map(row).collect(),
        scores: scores.copied().map(f32::from_bits).collect(),
        best: summary[SUMMARY..][..genes].to_vec(),
        best_score: f32::from_bits(summary[0]),
    }
}
