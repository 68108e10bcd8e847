//! The search on a GPU: the whole population lives on the device and is annealed there, many generations a dispatch.
//!
//! A workgroup is an island, a thread a member. The kernel is composed for the problem's arms, stepper and model
//! ([`crate::kernel::compose`]) and runs on whatever wgpu finds: Vulkan (lavapipe too, on the CPU), Metal, Direct3D 12.
//! The host sees the population only when it asks for it.
//!
//! The same seed and problem on the same adapter give the same bits, however dispatches are split and whenever the
//! search was stopped and went on.

mod adapter;
mod device;
mod error;
mod group;
mod motions;
mod pace;
#[cfg(test)]
mod tests;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType,
    BufferBindingType, CommandEncoderDescriptor, ComputePassDescriptor, ComputePipeline,
    ComputePipelineDescriptor, PipelineCompilationOptions, PipelineLayoutDescriptor,
    ShaderModuleDescriptor, ShaderSource, ShaderStages,
};

pub use adapter::{Adapter, AdapterKind, Which, adapters};
pub use error::GpuError;

use crate::kernel::anneal::Island;
use crate::kernel::compose::{Structure, compose};
use crate::kernel::proposal::ISLAND;
use crate::problem::Problem;
use device::Device;
use group::Group;
use motions::Motions;
use pace::Pace;

/// A problem's population on a device.
pub struct Gpu {
    device: Device,
    groups: Vec<Group>,
    anneal: ComputePipeline,
    score: ComputePipeline,
    genes: usize,
    seed: u64,
    pace: Pace,
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
        let needed = motions.structure.workgroup_bytes() as u64;
        if needed > u64::from(limits.max_compute_workgroup_storage_size) {
            // A driver need not complain of this itself.
            let limit = limits.max_compute_workgroup_storage_size.into();
            return Err(GpuError::Limit {
                what: "an island in workgroup memory",
                needed,
                limit,
            });
        }
        let limit = limit
            .min(limits.max_storage_buffer_binding_size)
            .min(limits.max_buffer_size);

        let began = Instant::now();
        let layout = layout(&device);
        let [anneal, score] = pipelines(&device, &layout, &motions.structure)?;
        let groups = Group::all(&device, &layout, problem, &motions, islands, limit)?;
        let mut gpu = Gpu {
            device,
            groups,
            anneal,
            score,
            genes: problem.genes(),
            seed: problem.seed,
            pace: Pace::new(),
            preparation: Duration::ZERO,
        };
        // Drivers compile at the first dispatch: a generation of none gets that over with, and shows what is wrong.
        for group in &gpu.groups {
            gpu.dispatch(&gpu.anneal, group, 0, group.islands.len(), 0..0)?;
        }
        gpu.preparation = began.elapsed();
        Ok(gpu)
    }

    /// What it runs on.
    pub fn adapter(&self) -> &Adapter {
        &self.device.adapter
    }

    /// How long it took to compile the kernel and upload the problem.
    pub fn preparation(&self) -> Duration {
        self.preparation
    }

    /// Runs every island from generation `from` until `to`, and returns the generation reached: less where `stop` was
    /// set, but the same for all islands.
    ///
    /// # Errors
    /// The device is lost, or refuses. The population on it is then not to be relied on: what
    /// [`islands`](Self::islands) returned last is.
    pub fn advance(&mut self, from: u32, to: u32, stop: &AtomicBool) -> Result<u32, GpuError> {
        let ticks: u64 = self.groups.iter().flat_map(|group| &group.ticks).sum();
        let mut at = from;
        while at < to && !stop.load(Ordering::Relaxed) {
            let generations = self.pace.generations(ticks).min(to - at);
            for group in &self.groups {
                let mut first = 0;
                while let Some(ticks) = group.ticks.get(first..).filter(|ticks| !ticks.is_empty()) {
                    let islands = self.pace.islands(ticks, generations);
                    let began = Instant::now();
                    self.dispatch(&self.anneal, group, first, islands, at..at + generations)?;
                    let ran: u64 = ticks.iter().take(islands).sum();
                    self.pace
                        .measured(ran * u64::from(generations), began.elapsed());
                    first += islands;
                }
            }
            at += generations;
        }
        Ok(at)
    }

    /// The population, from the device: in the order it was given in.
    ///
    /// # Errors
    /// The device is lost, or refuses.
    pub fn islands(&mut self) -> Result<Vec<Island>, GpuError> {
        self.gathered(|group| group.read(&self.device, self.genes))
    }

    /// Of each island, the best score ever and the members' mean score, metres: less to read back than
    /// [`islands`](Self::islands).
    ///
    /// # Errors
    /// The device is lost, or refuses.
    pub fn summary(&mut self) -> Result<Vec<(f32, f32)>, GpuError> {
        self.gathered(|group| group.summaries(&self.device))
    }

    /// Scores the members as they are, and changes nothing: of each island, its members' scores in metres.
    ///
    /// # Errors
    /// The device is lost, or refuses.
    pub fn scores(&mut self) -> Result<Vec<Vec<f32>>, GpuError> {
        for group in &self.groups {
            let mut first = 0;
            while let Some(ticks) = group.ticks.get(first..).filter(|ticks| !ticks.is_empty()) {
                let islands = self.pace.islands(ticks, 1);
                self.dispatch(&self.score, group, first, islands, 0..0)?;
                first += islands;
            }
        }
        self.gathered(|group| group.scored(&self.device))
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

    /// Runs `islands` of a group from its `first` on, and waits.
    fn dispatch(
        &self,
        pipeline: &ComputePipeline,
        group: &Group,
        first: usize,
        islands: usize,
        generations: std::ops::Range<u32>,
    ) -> Result<(), GpuError> {
        let islands = islands as u32;
        // Workgroups past a dimension's limit go into the next; those left over in the last row do nothing.
        let columns = islands.clamp(
            1,
            self.device
                .device
                .limits()
                .max_compute_workgroups_per_dimension,
        );
        group.instruct(
            &self.device,
            [
                self.seed as u32,
                (self.seed >> 32) as u32,
                generations.start,
                generations.end,
                first as u32,
                islands,
                columns,
                0,
            ],
        );
        let mut encoder = self
            .device
            .device
            .create_command_encoder(&CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, &group.bindings, &[]);
            pass.dispatch_workgroups(columns, islands.div_ceil(columns), 1);
        }
        self.device.queue.submit([encoder.finish()]);
        self.device.wait()
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
    check(
        "the number of islands",
        problem.sets.len() * problem.islands,
        islands.len(),
    )?;
    for island in islands {
        check("the number of genes", problem.genes(), island.genes.len())?;
        check(
            "the number of genes of the best",
            problem.genes(),
            island.best.len(),
        )?;
        check("the number of scores", ISLAND, island.scores.len())?;
        for row in &island.genes {
            check("the number of members", ISLAND, row.len())?;
        }
    }
    Ok(())
}

/// The bindings of `anneal.wgsl` and the pieces it is composed with.
fn layout(device: &Device) -> BindGroupLayout {
    let entry = |binding| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::COMPUTE,
        ty: BindingType::Buffer {
            ty: match binding {
                0 => BufferBindingType::Uniform,
                1..=4 => BufferBindingType::Storage { read_only: true },
                _ => BufferBindingType::Storage { read_only: false },
            },
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    };
    device
        .device
        .create_bind_group_layout(&BindGroupLayoutDescriptor {
            label: Some("group"),
            entries: &(0..8).map(entry).collect::<Vec<_>>(),
        })
}

/// The two entry points, `anneal` and `score_members`.
fn pipelines(
    device: &Device,
    layout: &BindGroupLayout,
    structure: &Structure,
) -> Result<[ComputePipeline; 2], GpuError> {
    let kernel = compose(structure)?;
    let module = device.device.create_shader_module(ShaderModuleDescriptor {
        label: Some("kernel"),
        source: ShaderSource::Wgsl(kernel.source.into()),
    });
    device.check()?;
    let layout = device
        .device
        .create_pipeline_layout(&PipelineLayoutDescriptor {
            label: Some("kernel"),
            bind_group_layouts: &[Some(layout)],
            ..PipelineLayoutDescriptor::default()
        });
    let pipelines = ["anneal", "score_members"].map(|entry| {
        device
            .device
            .create_compute_pipeline(&ComputePipelineDescriptor {
                label: Some(entry),
                layout: Some(&layout),
                module: &module,
                entry_point: Some(entry),
                compilation_options: PipelineCompilationOptions::default(),
                cache: None,
            })
    });
    device.check()?;
    Ok(pipelines)
}
