//! Which device runs the search: the adapters there are, and which of them is taken.

use std::fmt;

use wgpu::{Backends, DeviceType, Instance, InstanceDescriptor, InstanceFlags};

use super::GpuError;

/// What sort of device an adapter is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum AdapterKind {
    /// A card of its own.
    Discrete,
    /// Part of the processor, or of a virtual machine.
    Integrated,
    /// The driver does not say.
    Unknown,
    /// A driver that computes on the CPU, such as lavapipe.
    Software,
}

/// A device that kernels can run on, with its driver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// What the driver calls it.
    pub name: String,
    /// The driver and its version.
    pub driver: String,
    /// Vulkan, Metal or Dx12.
    pub backend: String,
    /// What sort of device it is.
    pub kind: AdapterKind,
}

impl fmt::Display for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.kind {
            AdapterKind::Software => "software",
            _ => "GPU",
        };
        write!(f, "{} ({}, {kind})", self.name, self.backend)
    }
}

/// Which adapter to take.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Which {
    /// The one that the environment variable `WGPU_ADAPTER_NAME` names, else the best: a GPU before software.
    Best,
    /// The best of those with this in their name, in upper or lower case.
    Named(String),
}

impl Which {
    /// What the name must have in it, in lower case.
    fn part_of_name(&self) -> Option<String> {
        match self {
            Which::Named(name) => Some(name.to_lowercase()),
            Which::Best => std::env::var("WGPU_ADAPTER_NAME")
                .ok()
                .filter(|name| !name.is_empty())
                .map(|name| name.to_lowercase()),
        }
    }
}

/// The adapters of this machine, best first.
pub fn adapters() -> Vec<Adapter> {
    found().iter().map(describe).collect()
}

/// The adapters to try, best first.
///
/// # Errors
/// There is none, or none of that name.
pub(super) fn candidates(which: &Which) -> Result<Vec<wgpu::Adapter>, GpuError> {
    let mut all = found();
    if all.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    if let Some(part) = which.part_of_name() {
        let has = all
            .iter()
            .map(|adapter| adapter.get_info().name)
            .collect::<Vec<_>>()
            .join(", ");
        all.retain(|adapter| adapter.get_info().name.to_lowercase().contains(&part));
        if all.is_empty() {
            return Err(GpuError::NoSuchAdapter { name: part, has });
        }
    }
    Ok(all)
}

/// What an adapter says of itself.
pub(super) fn describe(adapter: &wgpu::Adapter) -> Adapter {
    let info = adapter.get_info();
    Adapter {
        kind: kind(info.device_type),
        driver: format!("{} {}", info.driver, info.driver_info)
            .trim()
            .to_owned(),
        backend: format!("{:?}", info.backend),
        name: info.name,
    }
}

fn kind(device: DeviceType) -> AdapterKind {
    match device {
        DeviceType::DiscreteGpu => AdapterKind::Discrete,
        DeviceType::IntegratedGpu | DeviceType::VirtualGpu => AdapterKind::Integrated,
        DeviceType::Cpu => AdapterKind::Software,
        DeviceType::Other => AdapterKind::Unknown,
    }
}

fn found() -> Vec<wgpu::Adapter> {
    // No validation layers: whether a machine has them must not change what it does.
    let instance = Instance::new(InstanceDescriptor {
        backends: Backends::PRIMARY,
        flags: InstanceFlags::empty(),
        ..InstanceDescriptor::new_without_display_handle()
    });
    let mut all = pollster::block_on(instance.enumerate_adapters(Backends::PRIMARY));
    all.sort_by_key(|adapter| kind(adapter.get_info().device_type));
    all
}
