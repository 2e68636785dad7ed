//! Devices: which there are, and opening one.

use crate::splat::backend::GpuError;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll, Waker};

/// What a device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceKind {
    /// A graphics card.
    Discrete,
    /// A GPU in the processor's package.
    Integrated,
    /// A GPU of a virtual machine.
    Virtual,
    /// A program that imitates a GPU on the processor, such as Mesa's lavapipe.
    Software,
    /// The driver does not say.
    Unknown,
}

impl std::fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Discrete => "graphics card",
            Self::Integrated => "integrated",
            Self::Virtual => "virtual",
            Self::Software => "software",
            Self::Unknown => "unknown",
        })
    }
}

/// A device that drivers offer.
#[derive(Clone, Debug)]
pub struct DeviceInfo {
    /// Number by which `--device gpu:N` names it, from 0.
    pub number: usize,
    /// Name of the device.
    pub name: String,
    /// Name and version of its driver.
    pub driver: String,
    /// The interface of the driver: Vulkan, Metal or DX12.
    pub interface: String,
    /// What it is.
    pub kind: DeviceKind,
    /// Largest array that a kernel can use, bytes.
    pub largest_binding: u64,
    /// Largest array, bytes.
    pub largest_buffer: u64,
    /// What it lacks of that which training needs; empty if it can train.
    pub missing: Vec<String>,
}

/// An open device.
#[derive(Clone, Debug)]
pub struct GpuDevice {
    /// What it is.
    pub info: DeviceInfo,
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// The first error that the driver reported.
    fault: Arc<Mutex<Option<String>>>,
}

/// The devices that drivers offer, in the order of their numbers.
#[must_use]
pub fn devices() -> Vec<DeviceInfo> {
    adapters().iter().enumerate().map(|(number, adapter)| info(number, adapter)).collect()
}

/// All adapters of Vulkan, Metal and DX12: graphics cards first, software last.
fn adapters() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12;
    // The sizes of dispatches that kernels write are within the limits.
    descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
    let instance = wgpu::Instance::new(descriptor);
    let mut adapters = ready(instance.enumerate_adapters(wgpu::Backends::all())).unwrap_or_default();
    adapters.sort_by_key(|adapter| match kind(adapter.get_info().device_type) {
        DeviceKind::Discrete => 0,
        DeviceKind::Integrated => 1,
        DeviceKind::Virtual | DeviceKind::Unknown => 2,
        DeviceKind::Software => 3,
    });
    adapters
}

fn kind(of: wgpu::DeviceType) -> DeviceKind {
    match of {
        wgpu::DeviceType::DiscreteGpu => DeviceKind::Discrete,
        wgpu::DeviceType::IntegratedGpu => DeviceKind::Integrated,
        wgpu::DeviceType::VirtualGpu => DeviceKind::Virtual,
        wgpu::DeviceType::Cpu => DeviceKind::Software,
        wgpu::DeviceType::Other => DeviceKind::Unknown,
    }
}

fn info(number: usize, adapter: &wgpu::Adapter) -> DeviceInfo {
    let (of, limits, least) = (adapter.get_info(), adapter.limits(), wgpu::Limits::default());
    let mut missing = Vec::new();
    if !adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS) {
        missing.push("compute shaders".to_owned());
    }
    let mut require = |what: &str, found: u32, needed: u32| {
        if found < needed {
            missing.push(format!("{what}: {found} of {needed}"));
        }
    };
    require(
        "storage buffers of a shader",
        limits.max_storage_buffers_per_shader_stage,
        least.max_storage_buffers_per_shader_stage,
    );
    require(
        "bytes of workgroup memory",
        limits.max_compute_workgroup_storage_size,
        least.max_compute_workgroup_storage_size,
    );
    require(
        "lanes of a workgroup",
        limits.max_compute_invocations_per_workgroup,
        least.max_compute_invocations_per_workgroup,
    );
    DeviceInfo {
        number,
        name: of.name,
        driver: format!("{} {}", of.driver, of.driver_info).trim().to_owned(),
        interface: of.backend.to_string(),
        kind: kind(of.device_type),
        largest_binding: limits.max_storage_buffer_binding_size,
        largest_buffer: limits.max_buffer_size,
        missing,
    }
}

impl GpuDevice {
    /// Opens the device of a number, or the first that is no software, graphics cards before others.
    ///
    /// # Errors
    /// [`GpuError::NoDevice`], [`GpuError::NoSuchDevice`], [`GpuError::Lacks`], [`GpuError::Refused`].
    pub fn open(number: Option<usize>) -> Result<Self, GpuError> {
        let adapters = adapters();
        let infos: Vec<_> = adapters.iter().enumerate().map(|(number, a)| info(number, a)).collect();
        let number = match number {
            Some(number) => number,
            None => {
                let is_fit = |i: &&DeviceInfo| i.kind != DeviceKind::Software && i.missing.is_empty();
                let found = infos.iter().map(|i| i.name.clone()).collect();
                infos.iter().find(is_fit).ok_or(GpuError::NoDevice { found })?.number
            }
        };
        let (Some(adapter), Some(info)) = (adapters.get(number), infos.get(number)) else {
            return Err(GpuError::NoSuchDevice { number, count: adapters.len() });
        };
        if !info.missing.is_empty() {
            return Err(GpuError::Lacks { device: info.name.clone(), missing: info.missing.join(", ") });
        }
        let limits = adapter.limits();
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("satgs"),
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: wgpu::Limits {
                max_storage_buffer_binding_size: limits.max_storage_buffer_binding_size,
                max_buffer_size: limits.max_buffer_size,
                ..wgpu::Limits::default()
            },
            ..wgpu::DeviceDescriptor::default()
        };
        let refused = |reason: String| GpuError::Refused { device: info.name.clone(), reason };
        let opened = ready(adapter.request_device(&descriptor));
        let (device, queue) =
            opened.ok_or_else(|| refused("no answer".into()))?.map_err(|e| refused(e.to_string()))?;
        let fault = Arc::new(Mutex::new(None));
        let note = |fault: &Arc<Mutex<Option<String>>>| {
            let fault = fault.clone();
            move |reason: String| {
                if let Ok(mut fault) = fault.lock() {
                    fault.get_or_insert(reason);
                }
            }
        };
        let (of_error, of_loss) = (note(&fault), note(&fault));
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| of_error(e.to_string())));
        device.set_device_lost_callback(move |_, message| of_loss(format!("the device was lost: {message}")));
        Ok(Self { info: info.clone(), device, queue, fault })
    }

    /// Fails if the driver has reported an error.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub(super) fn check(&self) -> Result<(), GpuError> {
        let fault = self.fault.lock().ok().and_then(|fault| fault.clone());
        fault.map_or(Ok(()), |reason| Err(GpuError::Failed { device: self.info.name.clone(), reason }))
    }

    /// Waits until the device has done everything that was submitted.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub(super) fn wait(&self) -> Result<(), GpuError> {
        let failed =
            |e: wgpu::PollError| GpuError::Failed { device: self.info.name.clone(), reason: e.to_string() };
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(failed)?;
        self.check()
    }
}

/// The value of a future that is ready at once, as those of wgpu are outside of browsers.
fn ready<T>(future: impl Future<Output = T>) -> Option<T> {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}
