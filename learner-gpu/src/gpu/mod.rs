//! The search on a GPU: the whole population lives on the device and is annealed there, many generations a submission.
//!
//! A workgroup is an island on one of its motions, a thread a member. The kernel is composed for the problem's arms, stepper and model
//! ([`crate::kernel::compose`]) and runs on whatever wgpu finds: Vulkan (lavapipe too, on the CPU), Metal, Direct3D 12.
//! The host sees the population only when it asks for it.
//!
//! The same seed and problem on the same adapter give the same bits, however the work is split into submissions and
//! whenever the search was stopped and went on.

mod adapter;
mod device;
mod error;
mod group;
mod kernel;
mod motions;
mod pace;
pub mod peak;
#[cfg(test)]
mod tests;

use std::ops::Range;
use std::time::{Duration, Instant};

pub use adapter::{Adapter, AdapterKind, Which, adapters};
pub use error::GpuError;

use self::kernel::{Kernel, MOST_GENERATIONS, Part, Step, WINDOW};
use crate::kernel::anneal::Island;
use crate::kernel::proposal::ISLAND;
use crate::problem::Problem;
use device::Device;
use group::Group;
use motions::Motions;
use pace::Pace;

/// Motions that are scored at once, at most: what adds their scores up is in a loop, of which lavapipe makes 65,535 turns.
const MOST_MOTIONS: u32 = 60_000;

/// A problem's population on a device.
pub struct Gpu {
    device: Device,
    kernel: Kernel,
    groups: Vec<Group>,
    /// The generation that the population is to begin.
    generation: u32,
    genes: usize,
    /// No buffer is larger, bytes.
    limit: u64,
    pace: Pace,
    /// Frames of the longest motion.
    longest: u64,
    preparation: Duration,
}

impl Gpu {
    /// Puts a problem and its islands (those of set 0, then those of set 1, and so on) on an adapter.
    ///
    /// # Errors
    /// No adapter, or none of that name; a task that the core refuses; motions whose arms cannot share a kernel; a set
    /// too large for the device; or what the driver says.
    pub fn new(problem: &Problem, islands: &[Island], which: Which) -> Result<Self, GpuError> {
        Self::within(problem, islands, which, u64::MAX)
    }

    /// [`new`](Self::new) with no buffer above `limit` bytes.
    fn within(
        problem: &Problem,
        islands: &[Island],
        which: Which,
        limit: u64,
    ) -> Result<Self, GpuError> {
        check_population(problem, islands)?;
        let motions = Motions::new(problem)?;
        let device = Device::open(&which)?;
        let limits = device.device.limits();
        let limit = limit
            .min(limits.max_storage_buffer_binding_size)
            .min(limits.max_buffer_size);

        let began = Instant::now();
        // For lavapipe. A real GPU gains nothing, and runs one large group faster than several.
        let window = device.adapter.kind == AdapterKind::Software
            && motions.most_data(problem) <= WINDOW
            && limits.max_uniform_buffer_binding_size >= WINDOW
            && limit >= WINDOW;
        let kernel = Kernel::new(&device, &motions.structure, problem, window)?;
        let mut gpu = Gpu {
            device,
            kernel,
            groups: Vec::new(),
            generation: 0,
            genes: problem.genes(),
            limit,
            pace: Pace::new(),
            longest: 0,
            preparation: Duration::ZERO,
        };
        gpu.fill(problem, &motions, islands)?;
        if let Some(group) = gpu.groups.first() {
            // Drivers compile at the first dispatch: proposals that nobody decides on get that over with.
            let part = Part {
                islands: 0..1,
                generations: 0..1,
                motions: 0..1,
                as_they_are: false,
            };
            let steps = gpu.kernel.steps(group);
            gpu.run(group, part, &steps[..steps.len() - 1])?;
        }
        gpu.preparation = began.elapsed();
        Ok(gpu)
    }

    /// Puts other islands of the same problem on the device: those that a round of the search leaves, or those of a
    /// search that goes on. `problem` says how many there are of each set.
    ///
    /// # Errors
    /// See [`new`](Self::new).
    pub fn replace(&mut self, problem: &Problem, islands: &[Island]) -> Result<(), GpuError> {
        check_population(problem, islands)?;
        self.fill(problem, &Motions::new(problem)?, islands)
    }

    fn fill(
        &mut self,
        problem: &Problem,
        motions: &Motions,
        islands: &[Island],
    ) -> Result<(), GpuError> {
        self.groups = Group::all(
            &self.device,
            &self.kernel,
            problem,
            motions,
            islands,
            self.limit,
        )?;
        let frames = motions.each.iter().map(|motion| u64::from(motion.frames));
        self.longest = frames.max().unwrap_or(0).max(1);
        for group in &self.groups {
            // As if the population had just come out of a generation, scores and all.
            let part = Part {
                islands: 0..group.islands.len(),
                generations: 0..1,
                motions: 0..0,
                as_they_are: true,
            };
            self.run(group, part, &[Step::Settle])?;
        }
        self.generation = 1;
        Ok(())
    }

    /// What it runs on.
    pub fn adapter(&self) -> &Adapter {
        &self.device.adapter
    }

    /// How long it took to compile the kernel and upload the problem.
    pub fn preparation(&self) -> Duration {
        self.preparation
    }

    /// Runs every island from generation `from` until `to`, and returns the generation reached: less where it
    /// was due to be put down, but the same for all islands.
    ///
    /// # Errors
    /// The device is lost, or refuses. The population on it is then not to be relied on: what
    /// [`islands`](Self::islands) returned last is.
    pub fn advance(
        &mut self,
        from: u32,
        to: u32,
        is_due: impl Fn() -> bool,
    ) -> Result<u32, GpuError> {
        let ticks: u64 = self.groups.iter().flat_map(|group| &group.ticks).sum();
        let mut at = from;
        while at < to && !is_due() {
            let generations = self.pace.generations(ticks, self.longest);
            let next = to.min(at.saturating_add(generations.min(MOST_GENERATIONS)));
            self.everywhere(at..next, |gpu, group, part| {
                // Proposals are made once, and scored on some motions after others.
                let steps = gpu.kernel.steps(group);
                let first = usize::from(part.motions.start > 0);
                gpu.run(group, part, &steps[first..])
            })?;
            self.generation = next;
            at = next;
        }
        Ok(at)
    }

    /// The population, from the device: in the order it was given in.
    ///
    /// # Errors
    /// The device is lost, or refuses.
    pub fn islands(&mut self) -> Result<Vec<Island>, GpuError> {
        self.gathered(|group| group.read(&self.device, self.genes, self.generation))
    }

    /// Of each island, the best score ever and the members' mean score, metres: less to read back than
    /// [`islands`](Self::islands).
    ///
    /// # Errors
    /// The device is lost, or refuses.
    pub fn summary(&mut self) -> Result<Vec<(f32, f32)>, GpuError> {
        self.gathered(|group| group.summaries(&self.device, self.genes, self.generation))
    }

    /// Scores the members as they are, and changes nothing: of each island, its members' scores in metres.
    ///
    /// # Errors
    /// The device is lost, or refuses.
    pub fn scores(&mut self) -> Result<Vec<Vec<f32>>, GpuError> {
        let count = self.groups.last().map_or(0, |group| group.islands.end);
        let mut scores = vec![vec![0.0; ISLAND]; count];
        self.everywhere(0..1, |gpu, group, part| {
            let part = Part {
                as_they_are: true,
                ..part
            };
            gpu.run(group, part.clone(), gpu.kernel.scoring())?;
            let (islands, motions) = (part.islands.len(), part.motions.len());
            let scored = group.scored(&gpu.device, islands, motions)?;
            for (motion, scored) in part.motions.zip(scored.chunks(islands * ISLAND)) {
                for (island, scored) in part.islands.clone().zip(scored.chunks(ISLAND)) {
                    let motions = group.motions[island];
                    if motion >= motions {
                        continue;
                    }
                    let sums = &mut scores[group.islands.start + island];
                    for (sum, score) in sums.iter_mut().zip(scored) {
                        *sum += score;
                        if motion + 1 == motions {
                            *sum /= motions as f32;
                        }
                    }
                }
            }
            Ok(())
        })?;
        Ok(scores)
    }

    /// Has work done for these generations on all islands, part by part, each as large as the pace allows. Where one
    /// island's motions are too many for a part, each has some of them, in their order.
    fn everywhere(
        &mut self,
        generations: Range<u32>,
        mut work: impl FnMut(&Self, &Group, Part) -> Result<(), GpuError>,
    ) -> Result<(), GpuError> {
        let mut pace = self.pace;
        for group in &self.groups {
            let mut first = 0;
            while let Some(left) = group.ticks.get(first..).filter(|left| !left.is_empty()) {
                let an_island = generations.len() as u64 * self.longest * ISLAND as u64;
                let count = pace.islands(left.len(), an_island);
                let islands = first..first + count;
                first += count;
                let ticks: u64 = left.iter().take(count).sum();
                let at_once = pace
                    .motions(count as u64 * an_island)
                    .min((group.slots / count) as u32)
                    .clamp(1, MOST_MOTIONS);
                // Parts of the motions: one generation after the other.
                let turns = match at_once >= group.most_motions {
                    true => vec![generations.clone()],
                    false => generations.clone().map(|one| one..one + 1).collect(),
                };
                for generations in turns {
                    for from in (0..group.most_motions).step_by(at_once as usize) {
                        let motions = from..group.most_motions.min(from + at_once);
                        let share = motions.len() as u64 * ticks / u64::from(group.most_motions);
                        let part = Part {
                            islands: islands.clone(),
                            generations: generations.clone(),
                            motions,
                            as_they_are: false,
                        };
                        let began = Instant::now();
                        work(self, group, part)?;
                        let deep = generations.len() as u64 * self.longest;
                        let ran = share * generations.len() as u64;
                        pace.measured(ran, deep, began.elapsed());
                    }
                }
            }
        }
        self.pace = pace;
        Ok(())
    }

    fn run(&self, group: &Group, part: Part, steps: &[Step]) -> Result<(), GpuError> {
        self.kernel.run(&self.device, group, part, steps)
    }

    fn gathered<T>(
        &self,
        read: impl Fn(&Group) -> Result<Vec<T>, GpuError>,
    ) -> Result<Vec<T>, GpuError> {
        let groups = self
            .groups
            .iter()
            .map(read)
            .collect::<Result<Vec<_>, _>>()?;
        Ok(groups.into_iter().flatten().collect())
    }
}

/// Whether the islands are as many, and have as many genes, as the problem asks for.
fn check_population(problem: &Problem, islands: &[Island]) -> Result<(), GpuError> {
    let check = |what, expected, found| match expected == found {
        true => Ok(()),
        false => Err(GpuError::Population {
            what,
            expected,
            found,
        }),
    };
    let expected = problem.sets.len() * problem.islands;
    check("the number of islands", expected, islands.len())?;
    let genes = problem.genes();
    for island in islands {
        check("the number of genes", genes, island.genes.len())?;
        check("the number of genes of the best", genes, island.best.len())?;
        check("the number of scores", ISLAND, island.scores.len())?;
        for row in &island.genes {
            check("the number of members", ISLAND, row.len())?;
        }
    }
    Ok(())
}
