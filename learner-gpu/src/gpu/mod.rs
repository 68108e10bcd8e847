//! The search on a GPU: the whole population lives on the device and is annealed there, many generations a submission.
//!
//! A workgroup is an island, a thread a member. The kernel is composed for the problem's arms, stepper and model
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
use motions::{Motions, most_frames};
use pace::Pace;

/// A problem's population on a device.
pub struct Gpu {
    device: Device,
    kernel: Kernel,
    groups: Vec<Group>,
    /// Which of its two buffers each group's population is in.
    at: usize,
    /// The generation that the population is to begin.
    generation: u32,
    genes: usize,
    /// No buffer is larger, bytes.
    limit: u64,
    pace: Pace,
    /// Frames of the longest motion.
    longest: u64,
    /// Motions of a set that a dispatch scores, at most.
    most_motions: u32,
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
            at: 0,
            generation: 0,
            genes: problem.genes(),
            limit,
            pace: Pace::new(),
            longest: 0,
            most_motions: 1,
            preparation: Duration::ZERO,
        };
        gpu.fill(problem, &motions, islands)?;
        if let Some(group) = gpu.groups.first() {
            // Drivers compile at the first dispatch: an attempt that is never settled gets that over with.
            let part = Part {
                islands: 0..1,
                generations: 0..1,
                motions: 0..1,
                at: gpu.at,
            };
            gpu.run(group, part, &[Step::Attempt])?;
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
        // A turn of a loop for each frame, and one to leave it.
        let most_frames = most_frames(problem.settings.stepper) as u64;
        self.most_motions = (most_frames / (self.longest + 1)).max(1) as u32;
        for group in &self.groups {
            // As if the population had just come out of a generation.
            let part = Part {
                islands: 0..group.islands.len(),
                generations: 0..1,
                motions: 0..1,
                at: 1,
            };
            self.run(group, part, &[Step::Settle])?;
        }
        self.at = 0;
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
            let generations = self.pace.generations(ticks).min(MOST_GENERATIONS);
            let next = to.min(at.saturating_add(generations));
            self.everywhere(at..next, &[Step::Attempt, Step::Settle])?;
            self.at = (self.at + (next - at) as usize) % 2;
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
        self.gathered(|group| group.read(&self.device, self.genes, self.at, self.generation))
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
        self.everywhere(0..1, &[Step::Score])?;
        self.gathered(|group| group.scores(&self.device, self.genes, self.at))
    }

    /// Runs these steps for these generations on all islands, as many at once as the pace allows. Where one island's
    /// motions are too many, a dispatch scores a part of them; the parts' sums are added up in the motions' order.
    fn everywhere(&mut self, generations: Range<u32>, steps: &[Step]) -> Result<(), GpuError> {
        for group in &self.groups {
            let mut first = 0;
            while let Some(left) = group.ticks.get(first..).filter(|left| !left.is_empty()) {
                // Many islands before many motions: these come one after the other in a thread.
                let deep = generations.len() as u64 * self.longest;
                let count = self.pace.islands(left.len(), deep * ISLAND as u64);
                let islands = first..first + count;
                first += count;
                let ticks: u64 = left.iter().take(count).sum();
                let at_once = self.pace.motions(self.longest, (count * ISLAND) as u64);
                let at_once = at_once.min(self.most_motions);
                let all = Part {
                    islands,
                    generations: generations.clone(),
                    motions: 0..group.most_motions,
                    at: self.at,
                };
                if at_once >= group.most_motions {
                    let began = Instant::now();
                    self.run(group, all, steps)?;
                    let ran = ticks * generations.len() as u64;
                    let deep = deep * u64::from(group.most_motions);
                    self.pace.measured(ran, deep, began.elapsed());
                    continue;
                }
                for (turn, generation) in generations.clone().enumerate() {
                    for begin in (0..group.most_motions).step_by(at_once as usize) {
                        let end = group.most_motions.min(begin + at_once);
                        // What comes after scoring comes once.
                        let steps = match end == group.most_motions {
                            true => steps,
                            false => &steps[..1],
                        };
                        let part = Part {
                            generations: generation..generation + 1,
                            motions: begin..end,
                            at: self.at + turn,
                            ..all.clone()
                        };
                        let began = Instant::now();
                        self.run(group, part, steps)?;
                        let share = u64::from(end - begin) * ticks / u64::from(group.most_motions);
                        let deep = u64::from(end - begin) * self.longest;
                        self.pace.measured(share, deep, began.elapsed());
                    }
                }
            }
        }
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
