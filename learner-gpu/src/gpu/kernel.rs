//! The compiled kernel and how it is run.

use std::cell::OnceCell;
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
    /// Both at once, where islands have one motion.
    Try,
    /// Scores once more what needs it.
    ScoreHard,
    /// Decides and sums up.
    Settle,
}

impl Step {
    /// The entry point.
    fn entry(self) -> &'static str {
        match self {
            Step::Propose => "propose_members",
            Step::Score => "score_members",
            Step::Try => "try_members",
            Step::ScoreHard => "score_hard",
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
    /// Whether members are scored as they are, and not what they may become.
    pub as_they_are: bool,
}

/// The kernel for one problem.
pub(super) struct Kernel {
    pub layout: BindGroupLayout,
    /// Of each [`Step`]: drivers take their time, so none is made that is not used.
    pipelines: [OnceCell<ComputePipeline>; 5],
    module: ShaderModule,
    layouts: PipelineLayout,
    /// Whether `data` is a uniform buffer.
    pub window: bool,
    /// Whether some motions have to be scored once more.
    pub has_hard: bool,
    seed: u64,
    /// λ·dt, and dt in seconds: multiplied in `f32` as the core does.
    gain: f32,
    dt: f32,
    /// Workgroups that fit in a row, a multiple of eight.
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
        let dt = problem.settings.dt() as f32;
        Ok(Kernel {
            layout,
            pipelines: Default::default(),
            module,
            layouts,
            window,
            has_hard: structure.has_hard(),
            seed: problem.seed,
            gain: problem.settings.lambda as f32 * dt,
            dt,
            columns: device
                .device
                .limits()
                .max_compute_workgroups_per_dimension
                .max(8)
                & !7,
        })
    }

    /// What a generation takes.
    pub fn steps(&self, group: &Group) -> Vec<Step> {
        let mut steps = match group.most_motions {
            0 | 1 => vec![Step::Try],
            _ => vec![Step::Propose, Step::Score],
        };
        steps.extend(self.has_hard.then_some(Step::ScoreHard));
        steps.push(Step::Settle);
        steps
    }

    /// What scores members as they are.
    pub fn scoring(&self) -> &'static [Step] {
        match self.has_hard {
            true => &[Step::Score, Step::ScoreHard],
            false => &[Step::Score],
        }
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
        let mut runs = Vec::new();
        for generation in part.generations.clone() {
            let [low, high] = key(self.seed);
            runs.extend([
                low,
                high,
                generation,
                part.islands.start as u32,
                count,
                self.gain.to_bits(),
                self.dt.to_bits(),
                0,
                part.motions.start,
                part.motions.len() as u32,
                u32::from(!part.as_they_are),
            ]);
            runs.resize(runs.len().next_multiple_of(RUN_STRIDE as usize / 4), 0);
        }
        device.write(&group.run, &runs);

        let mut encoder = device
            .device
            .create_command_encoder(&CommandEncoderDescriptor::default());
        // `settle` does so between generations.
        encoder.clear_buffer(&group.hard, 0, Some(4));
        {
            let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
            for turn in 0..part.generations.len() as u32 {
                pass.set_bind_group(0, &group.bindings, &[turn * RUN_STRIDE as u32]);
                for &step in steps {
                    let workgroups = match step {
                        Step::Score => count * part.motions.len() as u32,
                        Step::ScoreHard => {
                            (count * part.motions.len() as u32).div_ceil(group.hard_a_thread)
                        }
                        Step::Propose | Step::Try | Step::Settle => count,
                    };
                    pass.set_pipeline(self.pipeline(device, step));
                    // A multiple of eight. Those past a row's limit go into the next; those left over do nothing.
                    let columns = workgroups.next_multiple_of(8).clamp(8, self.columns);
                    pass.dispatch_workgroups(columns, workgroups.div_ceil(columns), 1);
                }
            }
        }
        device.queue.submit([encoder.finish()]);
        device.wait()
    }

    /// An entry point, compiled.
    fn pipeline(&self, device: &Device, step: Step) -> &ComputePipeline {
        let entry = Some(step.entry());
        let made = || {
            let descriptor = ComputePipelineDescriptor {
                label: entry,
                layout: Some(&self.layouts),
                module: &self.module,
                entry_point: entry,
                compilation_options: PipelineCompilationOptions {
                    // Nothing is read there that was not written before.
                    zero_initialize_workgroup_memory: false,
                    ..PipelineCompilationOptions::default()
                },
                cache: None,
            };
            device.device.create_compute_pipeline(&descriptor)
        };
        self.pipelines[step as usize].get_or_init(made)
    }
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
                1..=3 => BufferBindingType::Storage { read_only: true },
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
