//! The graphics adapter and device: selection, features, errors.

use super::compiled::Device;
use super::requirements::{required_limits, shortfalls};
use super::shaders::MAX_LIGHTS;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use thiserror::Error;

/// The graphics device could not be opened, or failed.
#[derive(Debug, Error)]
pub enum GpuError {
    /// There is no Vulkan (Metal, D3D12) driver.
    #[error(
        "no graphics adapter found; install a Vulkan driver (a software one: mesa-vulkan-drivers); run `penumbra doctor` for details"
    )]
    NoAdapter,
    /// There is no adapter of the requested name or number.
    #[error("adapter '{wanted}' not found; there are: {available}")]
    NotFound {
        /// The requested name or number.
        wanted: String,
        /// The available adapters.
        available: String,
    },
    /// The adapter lacks a required feature or limit.
    #[error("adapter '{adapter}' cannot run Penumbra: {reason}")]
    Unfit {
        /// Adapter name.
        adapter: String,
        /// The missing feature or limit.
        reason: String,
    },
    /// The device was lost, ran out of memory or refused a command.
    #[error(
        "graphics device '{adapter}' failed: {reason}; restart, or choose another with --adapter"
    )]
    Failed {
        /// Adapter name.
        adapter: String,
        /// The message of the driver.
        reason: String,
    },
    /// The caller stopped the work.
    #[error("ended before it was done")]
    Stopped,
}

/// An opened graphics device.
#[derive(Clone, Debug)]
pub struct Gpu {
    /// Creates surfaces.
    pub instance: wgpu::Instance,
    /// The physical device.
    pub adapter: wgpu::Adapter,
    /// The logical device.
    pub device: Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// Name of the adapter, for messages.
    pub name: String,
    /// Whether the driver runs on the CPU, where pixels take more time than on any GPU.
    pub software: bool,
    /// Whether passes can be timed on the device.
    pub timestamps: bool,
    fault: SharedFault,
}

type SharedFault = Arc<Mutex<Fault>>;

/// What went wrong with a device.
#[derive(Debug, Default)]
struct Fault {
    /// Why the device was lost; nothing that was created on it can be used any more.
    lost: Option<String>,
    /// The first error that no call returned.
    first: Option<String>,
}

/// Backends that print nothing where they are missing: GL warns about XDG_RUNTIME_DIR on a headless
/// machine.
const BACKENDS: wgpu::Backends = wgpu::Backends::VULKAN
    .union(wgpu::Backends::METAL)
    .union(wgpu::Backends::DX12);

impl Gpu {
    /// Opens the adapter with the number `wanted`, or whose name contains it (ignoring case);
    /// without it the fastest one that has the required limits, a real GPU before a software driver.
    ///
    /// # Errors
    /// There is no adapter, none of that name or number, or it lacks a required limit.
    pub fn open(wanted: Option<&str>) -> Result<Self, GpuError> {
        let instance = Self::instance();
        let all = adapters(&instance);
        if wanted.is_some() || all.is_empty() {
            return Self::from_adapter(&instance, choose(all, wanted)?);
        }
        Self::from_first(&instance, all)
    }

    /// Opens the adapter `wanted`, as [`Self::open`] does, with no more than the required limits and
    /// without optional features: the device of the weakest adapter that is supported. Tests on it
    /// show that the requirements are complete.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_least(wanted: Option<&str>) -> Result<Self, GpuError> {
        let instance = Self::instance();
        let adapter = choose(adapters(&instance), wanted)?;
        let none = wgpu::Features::empty();
        Self::request(&instance, adapter, required_limits(), none)
    }

    /// Opens an adapter, as [`Self::open`] does, that can show pictures on `surface`, which
    /// `instance` created.
    ///
    /// # Errors
    /// As [`Self::open`]; the adapter cannot show pictures on the surface.
    pub fn open_for(
        instance: wgpu::Instance,
        surface: &wgpu::Surface<'_>,
        wanted: Option<&str>,
    ) -> Result<Self, GpuError> {
        let all = adapters(&instance);
        let adapter = if wanted.is_some() {
            choose(all, wanted)?
        } else {
            let (able, others): (Vec<_>, Vec<_>) = all
                .into_iter()
                .partition(|a| is_fit(a) && a.is_surface_supported(surface));
            // If no adapter is able, the error names the best of the others.
            choose(if able.is_empty() { others } else { able }, None)?
        };
        if !adapter.is_surface_supported(surface) {
            return Err(GpuError::Unfit {
                adapter: adapter.get_info().name,
                reason: "it cannot show pictures in a window here; run with --headless".to_owned(),
            });
        }
        Self::from_adapter(&instance, adapter)
    }

    /// Creates the instance, which creates surfaces and finds adapters.
    #[must_use]
    pub fn instance() -> wgpu::Instance {
        let mut description = wgpu::InstanceDescriptor::new_without_display_handle();
        description.backends = BACKENDS;
        // Lines of the shaders' text in what drivers compile, which takes a debug build longer than
        // to translate them. WGPU_DEBUG=1 brings them back.
        description.flags.remove(wgpu::InstanceFlags::DEBUG);
        description.flags = description.flags.with_env();
        // The sizes of indirect dispatches come from our own shaders, which respect the limits; the
        // check of each takes longer than the work that it starts.
        description
            .flags
            .remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
        wgpu::Instance::new(description)
    }

    /// Opens an adapter with all its limits and, if it has them, time stamps.
    fn from_adapter(instance: &wgpu::Instance, adapter: wgpu::Adapter) -> Result<Self, GpuError> {
        let limits = adapter.limits();
        let features = adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
        Self::request(instance, adapter, limits, features)
    }

    /// Opens the first adapter that can be opened; the error is that of the first one.
    fn from_first(
        instance: &wgpu::Instance,
        adapters: Vec<wgpu::Adapter>,
    ) -> Result<Self, GpuError> {
        let mut first = None;
        for adapter in adapters {
            match Self::from_adapter(instance, adapter) {
                Err(error) => first = first.or(Some(error)),
                opened => return opened,
            }
        }
        Err(first.unwrap_or(GpuError::NoAdapter))
    }

    fn request(
        instance: &wgpu::Instance,
        adapter: wgpu::Adapter,
        limits: wgpu::Limits,
        features: wgpu::Features,
    ) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let unfit = |reason| GpuError::Unfit {
            adapter: info.name.clone(),
            reason,
        };
        let flags = adapter.get_downlevel_capabilities().flags;
        if !flags.contains(wgpu::DownlevelFlags::SHADER_F16_IN_F32) {
            let reason = "no half floats in shaders; a software driver needs a processor with F16C";
            return Err(unfit(reason.to_owned()));
        }
        let lacking = shortfalls(&adapter.limits());
        if !lacking.is_empty() {
            return Err(unfit(format!("limits too small: {}", lacking.join(", "))));
        }
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("penumbra"),
            required_features: features,
            required_limits: limits,
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        });
        let opened = pollster::block_on(request);
        let (device, queue) = opened.map_err(|e| unfit(e.to_string()))?;
        let software = info.device_type == wgpu::DeviceType::Cpu;
        Ok(Self {
            fault: watch(&device),
            instance: instance.clone(),
            adapter,
            device: Device::new(device),
            queue,
            name: info.name,
            software,
            timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
        })
    }

    /// Waits until all submitted work has finished.
    ///
    /// # Errors
    /// The device was lost, ran out of memory or refused a command since it was opened.
    pub fn wait(&self) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        let fault = lock(&self.fault);
        let reason = fault.lost.as_ref().or(fault.first.as_ref()).cloned();
        match reason.or_else(|| polled.err().map(|e| e.to_string())) {
            None => Ok(()),
            Some(reason) => Err(GpuError::Failed {
                adapter: self.name.clone(),
                reason,
            }),
        }
    }

    /// Returns why the device was lost (reset by its driver, unplugged, out of memory); `None` while
    /// it can be used. Nothing that was created on a lost device can be used any more.
    #[must_use]
    pub fn loss(&self) -> Option<String> {
        // The loss may be reported by a poll only.
        let _ = self.device.poll(wgpu::PollType::Poll);
        lock(&self.fault).lost.clone()
    }

    /// Opens a new device after a loss: of the same adapter or, if that is gone, of the fastest
    /// other one.
    ///
    /// # Errors
    /// No adapter can be opened; the error is that of the lost one.
    pub fn reopen(&self) -> Result<Self, GpuError> {
        let mut candidates = vec![self.adapter.clone()];
        candidates.extend(adapters(&self.instance));
        Self::from_first(&self.instance, candidates)
    }

    /// Maximum number of dome lights, whose shadow maps are the layers of one texture.
    #[must_use]
    pub fn max_lights(&self) -> u32 {
        MAX_LIGHTS.min(self.device.limits().max_texture_array_layers)
    }
}

/// Keeps the loss and the first error of the device, which [`Gpu::wait`] returns. Without handlers
/// wgpu would panic.
fn watch(device: &wgpu::Device) -> SharedFault {
    let fault = SharedFault::default();
    let (on_error, on_loss) = (fault.clone(), fault.clone());
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        let mut fault = lock(&on_error);
        fault.first.get_or_insert_with(|| error.to_string());
    }));
    device.set_device_lost_callback(move |reason, message| {
        let text = match message.trim() {
            "" => format!("{reason:?}").to_lowercase(),
            text => text.to_owned(),
        };
        lock(&on_loss).lost.get_or_insert(text);
    });
    fault
}

fn lock(fault: &SharedFault) -> MutexGuard<'_, Fault> {
    fault.lock().unwrap_or_else(PoisonError::into_inner)
}

fn is_fit(adapter: &wgpu::Adapter) -> bool {
    shortfalls(&adapter.limits()).is_empty()
}

/// All adapters, the fastest first.
fn adapters(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut adapters = pollster::block_on(instance.enumerate_adapters(BACKENDS));
    adapters.sort_by_key(|a| rank(a.get_info().device_type));
    adapters
}

const fn rank(kind: wgpu::DeviceType) -> u8 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

fn choose(adapters: Vec<wgpu::Adapter>, wanted: Option<&str>) -> Result<wgpu::Adapter, GpuError> {
    if adapters.is_empty() {
        return Err(GpuError::NoAdapter);
    }
    let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
    let position = match wanted {
        None => Some(0),
        Some(text) => text.parse().ok().filter(|n| *n < names.len()).or_else(|| {
            let text = text.to_lowercase();
            names
                .iter()
                .position(|name| name.to_lowercase().contains(&text))
        }),
    };
    position
        .and_then(|at| adapters.into_iter().nth(at))
        .ok_or_else(|| GpuError::NotFound {
            wanted: wanted.unwrap_or_default().to_owned(),
            available: names
                .iter()
                .enumerate()
                .map(|(i, name)| format!("{i} '{name}'"))
                .collect::<Vec<_>>()
                .join(", "),
        })
}
