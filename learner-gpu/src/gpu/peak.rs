//! The most that a device computes, measured: what a search's speed is a share of.

use std::time::Instant;

use wgpu::{
    BindGroupDescriptor, BindGroupEntry, CommandEncoderDescriptor, ComputePassDescriptor,
    ComputePipelineDescriptor, PipelineCompilationOptions, ShaderModuleDescriptor, ShaderSource,
};

use super::adapter::Which;
use super::device::Device;
use super::error::GpuError;

/// Operations of one thread of `peak.wgsl`: 12 chains of 4096 multiplications and additions.
const OPERATIONS: f64 = 12.0 * 4096.0 * 2.0;

/// Floating-point operations a second of a device, by a small kernel, over `seconds`: the greater of multiplications
/// with additions, and of fused ones.
///
/// # Errors
/// No such adapter, or what the driver says.
pub fn operations_a_second(which: &Which, seconds: f64) -> Result<f64, GpuError> {
    let device = Device::open(which)?;
    let module = device.device.create_shader_module(ShaderModuleDescriptor {
        label: Some("peak"),
        source: ShaderSource::Wgsl(include_str!("peak.wgsl").into()),
    });
    device.check()?;
    let workgroups = device
        .device
        .limits()
        .max_compute_workgroups_per_dimension
        .min(16_384);
    let data = device.storage("data", workgroups as usize * 64 * 4);
    let mut most = 0.0f64;
    for entry in ["fused", "separate"] {
        let pipeline = device
            .device
            .create_compute_pipeline(&ComputePipelineDescriptor {
                label: Some(entry),
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: PipelineCompilationOptions::default(),
                cache: None,
            });
        let bindings = device.device.create_bind_group(&BindGroupDescriptor {
            label: Some("peak"),
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[BindGroupEntry {
                binding: 0,
                resource: data.as_entire_binding(),
            }],
        });
        device.check()?;
        let began = Instant::now();
        // As long a dispatch as is well below what a watchdog waits for.
        let mut count = 1;
        while began.elapsed().as_secs_f64() < seconds / 2.0 {
            let mut encoder = device
                .device
                .create_command_encoder(&CommandEncoderDescriptor::default());
            {
                let mut pass = encoder.begin_compute_pass(&ComputePassDescriptor::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &bindings, &[]);
                pass.dispatch_workgroups(count, 1, 1);
            }
            let began = Instant::now();
            device.queue.submit([encoder.finish()]);
            device.wait()?;
            let took = began.elapsed().as_secs_f64();
            most = most.max(f64::from(count) * 64.0 * OPERATIONS / took);
            if took < 0.01 {
                count = (count * 4).min(workgroups);
            }
        }
    }
    Ok(most)
}
