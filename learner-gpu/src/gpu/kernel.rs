//! The compiled kernel and how it is run.

use std::ops::Range;

use wgpu::{
    BindGroupLayout, BindGroupLayoutDescriptor, BindGroupLayoutEntry, BindingType,
    BufferBindingType, CommandEncoderDescriptor, ComputePassDescriptor, ComputePipeline,
    ComputePipelineDescriptor, PipelineCompilationOptions, PipelineLayout,
    PipelineLayoutDescriptor, ShaderModule, ShaderModuleDescriptor, ShaderSource, ShaderStages,
};

use super::device::Device;
use super::error::GpuError;
use super::group::Group;
use crate::kernel::compose::{Structure, compose};
use crate::kernel::philox::key;
use crate::problem::Problem;

/// Generations in one submission, at most.
pub(super) const MOST_GENERATIONS: u32 = 256;
/// Bytes of a `Run` in `anneal.wgsl`.
pub(super) const RUN_BYTES: u64 = 48;
/// Bytes of a uniform buffer that every device can bind.
pub(super) const WINDOW: u64 = 1 << 16;
/// Bytes from one to the next: what every device can begin a binding at.
pub(super) const RUN_STRIDE: u64 = 256;

/// What a dispatch does: an entry point of `anneal.wgsl`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Step {
    /// Proposes.
    Propose,
    /// Scores what is proposed.
    Score,
    /// Decides and sums up.
    Settle,
}

impl Step {
    /// A generation's, in their order.
    pub const ALL: [Step; 3] = [Step::Propose, Step::Score, Step::Settle];

    /// The entry point.
    fn entry(self) -> &'static str {
        match self {
            Step::Propose => "propose_members",
            Step::Score => "score_members",
            Step::Settle => "settle",
        }
    }
}

/// What of a group's work is done at once.
#[derive(Clone)]
pub(super) struct Part {
    /// These of its islands.
    pub islands: Range<usize>,
    /// Generations, at most [`MOST_GENERATIONS`].
    pub generations: Range<u32>,
    /// These of each set's motions.
    pub motions: Range<u32>,
    /// Which of its two buffers the population is in: after each generation it is in the other.
    pub at: usize,
}

/// The kernel for one problem.
pub(super) struct Kernel {
    pub layout: BindGroupLayout,
    /// Of each of [`Step::ALL`].
    pipelines: [ComputePipeline; 3],
    /// Whether `data` is a uniform buffer.
    pub window: bool,
    seed: u64,
    /// λ·dt, and dt in seconds: multiplied in `f32` as the core does.
    gain: f32,
    dt: f32,
    /// Workgroups that fit in a row.
    pub columns: u32,
}

impl Kernel {
    /// Composes the kernel and hands it to the driver. `window`: the data of every set are at most [`WINDOW`] bytes.
    ///
    /// # Errors
    /// The device refuses it.
    pub fn new(
        device: &Device,
        structure: &Structure,
        problem: &Problem,
        window: bool,
    ) -> Result<Self, GpuError> {
        let fours = window.then_some(WINDOW as usize / 16);
        let source = compose(structure, fours)?.source;
        let module = device.device.create_shader_module(ShaderModuleDescriptor {
            label: Some("kernel"),
            source: ShaderSource::Wgsl(source.into()),
        });
        device.check()?;
        let layout = layout(device, window);
        let layouts = device
            .device
            .create_pipeline_layout(&PipelineLayoutDescriptor {
                label: Some("kernel"),
                bind_group_layouts: &[Some(&layout)],
                ..PipelineLayoutDescriptor::default()
            });
        let pipelines = Step::ALL.map(|step| pipeline(device, &module, &layouts, step.entry()));
        device.check()?;
        let dt = problem.settings.dt() as f32;
        Ok(Kernel {
            layout,
            pipelines,
            window,
            seed: problem.seed,
            gain: problem.settings.lambda as f32 * dt,
            dt,
            columns: device
                .device
                .limits()
                .max_compute_workgroups_per_dimension
                .max(1),
        })
    }

    /// Runs these steps on a part of a group, for each generation in turn, and waits.
    ///
    /// # Errors
    /// The device is lost, or refuses.
    pub fn run(
        &self,
        device: &Device,
        group: &Group,
        part: Part,
        steps: &[Step],
    ) -> Result<(), GpuError> {
        let count = part.islands.len() as u32;
        // Workgroups past a row's limit go into the next; those left over in the last row do nothing.
        let columns = count.clamp(1, self.columns);
        let mut runs = Vec::new();
        for generation in part.generations.clone() {
            let [low, high] = key(self.seed);
            runs.extend([
                low,
                high,
                generation,
                part.islands.start as u32,
                count,
                columns,
                self.gain.to_bits(),
                self.dt.to_bits(),
                0,
                part.motions.start,
                part.motions.len() as u32,
            ]);
            runs.resize(runs.len().next_multiple_of(RUN_STRIDE as usize / 4), 0);
        }
        device.write(&group.run, &runs);

        let mut encoder = device
            .device
            .create_command_encoder(&CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            for turn in 0..part.generations.len() as u32 {
                let bindings = &group.bindings[(part.at + turn as usize) % 2];
                pass.set_bind_group(0, bindings, &[turn * RUN_STRIDE as u32]);
                for &step in steps {
                    let workgroups = match step {
                        Step::Score => count * part.motions.len() as u32,
                        Step::Propose | Step::Settle => count,
                    };
                    pass.set_pipeline(&self.pipelines[step as usize]);
                    pass.dispatch_workgroups(
                        columns.min(workgroups),
                        workgroups.div_ceil(columns),
                        1,
                    );
                }
            }
        }
        device.queue.submit([encoder.finish()]);
        device.wait()
    }
}

/// An entry point, compiled.
fn pipeline(
    device: &Device,
    module: &ShaderModule,
    layout: &PipelineLayout,
    entry: &str,
) -> ComputePipeline {
    device
        .device
        .create_compute_pipeline(&ComputePipelineDescriptor {
            label: Some(entry),
            layout: Some(layout),
            module,
            entry_point: Some(entry),
            compilation_options: PipelineCompilationOptions {
                // Nothing is read there that was not written before.
                zero_initialize_workgroup_memory: false,
                ..PipelineCompilationOptions::default()
            },
            cache: None,
        })
}

/// The bindings of `anneal.wgsl` and the pieces it is composed with.
fn layout(device: &Device, window: bool) -> BindGroupLayout {
    let entry = |binding| BindGroupLayoutEntry {
        binding,
        visibility: ShaderStages::COMPUTE,
        ty: BindingType::Buffer {
            ty: match binding {
                0 => BufferBindingType::Uniform,
                1 if window => BufferBindingType::Uniform,
                1..=4 => BufferBindingType::Storage { read_only: true },
                _ => BufferBindingType::Storage { read_only: false },
            },
            has_dynamic_offset: binding == 0,
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
