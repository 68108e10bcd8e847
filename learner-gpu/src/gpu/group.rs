//! As many islands as fit the device's bindings, with all that they are scored on.
//!
//! Islands know nothing of each other, so a population too large for one binding is split into groups that run in
//! turn, and a dispatch may run any part of a group: neither changes a bit.

use std::collections::HashMap;
use std::num::NonZero;
use std::ops::Range;

use wgpu::{
    BindGroup, BindGroupDescriptor, BindGroupEntry, BindGroupLayout, BindingResource, Buffer,
    BufferBinding, BufferDescriptor, BufferUsages,
};

use super::device::{Device, PART};
use super::error::GpuError;
use super::kernel::{MOST_GENERATIONS, RUN_BYTES, RUN_STRIDE};
use super::motions::Motions;
use crate::kernel::anneal::Island;
use crate::kernel::proposal::ISLAND;
use crate::problem::Problem;

/// Words of a `Summary` in `anneal.wgsl`: best score ever, mean score, temperature, best member.
const SUMMARY: usize = 4;

/// What goes into a group's buffers, in words of 4 bytes.
#[derive(Default)]
struct Contents {
    /// A row a motion: its arm and task.
    numbers: Vec<u32>,
    /// The recorded points.
    recorded: Vec<u32>,
    /// For each motion of each set: row of numbers, first frame, frames.
    motions: Vec<u32>,
    /// For each island: set, number in it, the set's first motion, how many.
    places: Vec<u32>,
    /// The islands themselves.
    islands: Vec<u32>,
    /// For each island, [`SUMMARY`] words.
    summaries: Vec<u32>,
    /// How many words what the islands try takes.
    tried: usize,
    /// Ticks that a generation of each island takes.
    ticks: Vec<u64>,
    /// Motions of the largest set.
    most_motions: u32,
}

impl Contents {
    /// The largest buffer: what it holds, and its size in bytes.
    fn largest(&self) -> (&'static str, u64) {
        let sizes = [
            ("the arms' numbers", self.numbers.len()),
            ("the recordings", self.recorded.len()),
            ("the list of motions", self.motions.len()),
            ("the list of islands", self.places.len()),
            ("the population", self.islands.len()),
            ("what the population tries", self.tried),
        ];
        let (what, words) = sizes
            .into_iter()
            .max_by_key(|&(_, words)| words)
            .unwrap_or_default();
        (what, words as u64 * 4)
    }
}

/// Islands that run together.
pub(super) struct Group {
    /// Which of the problem's.
    pub islands: Range<usize>,
    /// Ticks that a generation of each takes.
    pub ticks: Vec<u64>,
    /// Motions of the largest set.
    pub most_motions: u32,
    pub bindings: BindGroup,
    pub run: Buffer,
    population: Buffer,
    summaries: Buffer,
    tried: Buffer,
}

impl Group {
    /// The problem's islands in as few groups as have no buffer above `limit` bytes.
    ///
    /// # Errors
    /// A single island whose motions are above it.
    pub fn all(
        device: &Device,
        layout: &BindGroupLayout,
        problem: &Problem,
        motions: &Motions,
        islands: &[Island],
        limit: u64,
    ) -> Result<Vec<Group>, GpuError> {
        let mut groups = Vec::new();
        let mut first = 0;
        while first < islands.len() {
            let (contents, end) = gather(problem, motions, islands, first, limit)?;
            groups.push(Group::new(device, layout, contents, first..end));
            device.check()?;
            first = end;
        }
        Ok(groups)
    }

    fn new(
        device: &Device,
        layout: &BindGroupLayout,
        contents: Contents,
        islands: Range<usize>,
    ) -> Self {
        let run = device.device.create_buffer(&BufferDescriptor {
            label: Some("run"),
            size: u64::from(MOST_GENERATIONS) * RUN_STRIDE,
            usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let population = device.storage("islands", contents.islands.len());
        let summaries = device.storage("summaries", contents.summaries.len());
        let tried = device.storage("tried", contents.tried);
        device.write(&population, &contents.islands);
        device.write(&summaries, &contents.summaries);
        let uploaded = |label, words: &[u32]| {
            let buffer = device.storage(label, words.len());
            device.write(&buffer, words);
            buffer
        };
        let buffers = [
            &run,
            &uploaded("numbers", &contents.numbers),
            &uploaded("recorded", &contents.recorded),
            &uploaded("motions", &contents.motions),
            &uploaded("places", &contents.places),
            &population,
            &summaries,
            &tried,
        ];
        let bindings = device.device.create_bind_group(&BindGroupDescriptor {
            label: Some("group"),
            layout,
            entries: &std::array::from_fn::<_, 8, _>(|binding| BindGroupEntry {
                binding: binding as u32,
                resource: match binding {
                    // A window on it that moves from generation to generation.
                    0 => BindingResource::Buffer(BufferBinding {
                        buffer: &run,
                        offset: 0,
                        size: NonZero::new(RUN_BYTES),
                    }),
                    _ => buffers[binding].as_entire_binding(),
                },
            }),
        });
        Group {
            islands,
            ticks: contents.ticks,
            most_motions: contents.most_motions,
            bindings,
            run,
            population,
            summaries,
            tried,
        }
    }

    /// The islands, from the device.
    ///
    /// # Errors
    /// The device is lost.
    pub fn read(&self, device: &Device, genes: usize) -> Result<Vec<Island>, GpuError> {
        let each = words_an_island(genes);
        let mut islands = Vec::with_capacity(self.islands.len());
        for some in self.summaries(device)?.chunks((PART / each).max(1)) {
            let from = islands.len() * each;
            let words = device.read_part(&self.population, from..from + some.len() * each)?;
            let words = words.chunks_exact(each);
            islands.extend(
                words
                    .zip(some)
                    .map(|(words, &(best, _))| unpacked(words, genes, best)),
            );
        }
        Ok(islands)
    }

    /// Of each island: the best score ever, and the members' mean score.
    ///
    /// # Errors
    /// The device is lost.
    pub fn summaries(&self, device: &Device) -> Result<Vec<(f32, f32)>, GpuError> {
        let words = device.read(&self.summaries)?;
        let each = words.chunks_exact(SUMMARY).take(self.islands.len());
        Ok(each
            .map(|words| (f32::from_bits(words[0]), f32::from_bits(words[1])))
            .collect())
    }

    /// The scores that `score_members` wrote, or those last tried: for each island, its members'.
    ///
    /// # Errors
    /// The device is lost.
    pub fn scores(&self, device: &Device, genes: usize) -> Result<Vec<Vec<f32>>, GpuError> {
        let words = device.read(&self.tried)?;
        let each = words
            .chunks_exact(words_tried(genes))
            .take(self.islands.len());
        Ok(each
            .map(|words| {
                let scores = words.iter().skip(genes * ISLAND).take(ISLAND);
                scores.copied().map(f32::from_bits).collect()
            })
            .collect())
    }
}

/// Islands from `first` on, until the next would make a buffer larger than `limit` bytes; and the one after them.
fn gather(
    problem: &Problem,
    motions: &Motions,
    islands: &[Island],
    first: usize,
    limit: u64,
) -> Result<(Contents, usize), GpuError> {
    let islands_a_set = problem.islands.max(1);
    let mut contents = Contents::default();
    let mut rows = HashMap::new();
    let mut set_at = (usize::MAX, 0, 0);
    let mut frames = 0u32;
    for (number, island) in islands.iter().enumerate().skip(first) {
        let (set, place) = (number / islands_a_set, number % islands_a_set);
        let members: &[usize] = problem.sets.get(set).map_or(&[], Vec::as_slice);
        // The sizes as they would be with this island, before it is put in.
        let before = (
            contents.numbers.len(),
            contents.recorded.len(),
            contents.motions.len(),
        );
        if set_at.0 != set {
            let begin = contents.motions.len() as u32 / 3;
            let mut ticks = 0;
            for task in members {
                let Some(motion) = motions.each.get(*task) else {
                    continue;
                };
                let (row, first_frame) = *rows.entry(*task).or_insert_with(|| {
                    let at = (contents.numbers.len() / motion.numbers.len().max(1), frames);
                    contents.numbers.extend(&motion.numbers);
                    contents.recorded.extend(&motion.recorded);
                    frames += motion.frames;
                    at
                });
                contents
                    .motions
                    .extend([row as u32, first_frame, motion.frames]);
                ticks += u64::from(motion.frames) * ISLAND as u64;
            }
            set_at = (set, begin, ticks);
            contents.most_motions = contents.most_motions.max(members.len() as u32);
        }
        let (_, begin, ticks) = set_at;
        contents.places.extend([
            set as u32,
            place as u32,
            begin,
            contents.motions.len() as u32 / 3 - begin,
        ]);
        pack(&mut contents.islands, island);
        contents.summaries.push(island.best_score.to_bits());
        contents.summaries.extend([0; SUMMARY - 1]);
        contents.tried += words_tried(problem.genes());
        contents.ticks.push(ticks);

        let (what, needed) = contents.largest();
        if needed > limit {
            if number == first {
                return Err(GpuError::Limit {
                    what,
                    needed,
                    limit,
                });
            }
            // One too many.
            let kept = number - first;
            contents.numbers.truncate(before.0);
            contents.recorded.truncate(before.1);
            contents.motions.truncate(before.2);
            contents.places.truncate(4 * kept);
            contents
                .islands
                .truncate(contents.islands.len() / (kept + 1) * kept);
            contents.summaries.truncate(SUMMARY * kept);
            contents.tried = contents.tried / (kept + 1) * kept;
            contents.ticks.truncate(kept);
            return Ok((contents, number));
        }
    }
    Ok((contents, islands.len()))
}

/// Words of an `Island` in `anneal.wgsl`.
fn words_an_island(genes: usize) -> usize {
    genes * ISLAND + ISLAND + genes
}

/// Words of a `Tried` in `anneal.wgsl`.
fn words_tried(genes: usize) -> usize {
    genes * ISLAND + 2 * ISLAND
}

fn pack(words: &mut Vec<u32>, island: &Island) {
    for row in &island.genes {
        words.extend(row);
    }
    words.extend(island.scores.iter().map(|score| score.to_bits()));
    words.extend(&island.best);
}

fn unpacked(words: &[u32], genes: usize, best_score: f32) -> Island {
    let (rows, rest) = words.split_at(genes * ISLAND);
    let (scores, best) = rest.split_at(ISLAND);
    Island {
        genes: rows.chunks_exact(ISLAND).map(<[u32]>::to_vec).collect(),
        scores: scores.iter().copied().map(f32::from_bits).collect(),
        best: best.to_vec(),
        best_score,
    }
}
