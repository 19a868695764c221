//! The adapter and the device: which one, what it can do, and what to say when there is
//! none.

use std::sync::{Arc, Mutex, PoisonError};
use thiserror::Error;

/// The graphics device could not be had or was lost.
#[derive(Debug, Error)]
pub enum GpuError {
    /// No Vulkan (Metal, D3D12) driver at all.
    #[error(
        "no graphics adapter found; install a Vulkan driver (a software one: mesa-vulkan-drivers), `penumbra doctor` tells more"
    )]
    NoAdapter,
    /// `--adapter` named one that is not there.
    #[error("adapter '{wanted}' not found; there are: {available}")]
    NotFound {
        /// What was asked for.
        wanted: String,
        /// What there is.
        available: String,
    },
    /// The adapter lacks something Penumbra cannot do without.
    #[error("adapter '{adapter}' cannot run Penumbra: {reason}")]
    Unfit {
        /// Adapter name.
        adapter: String,
        /// What is missing.
        reason: String,
    },
    /// Lost, out of memory, or a mapping failed.
    #[error(
        "graphics device '{adapter}' failed: {reason}; restart, or choose another with --adapter"
    )]
    Failed {
        /// Adapter name.
        adapter: String,
        /// What the driver said.
        reason: String,
    },
    /// Whoever wanted it does not want it any more.
    #[error("ended before it was done")]
    Stopped,
}

/// An opened graphics device.
#[derive(Clone, Debug)]
pub struct Gpu {
    /// Kept for making surfaces.
    pub instance: wgpu::Instance,
    /// The physical device.
    pub adapter: wgpu::Adapter,
    /// The logical device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// Name and driver for people.
    pub name: String,
    /// True for a software driver, on which pixels cost more than on any GPU.
    pub software: bool,
    /// True when passes can be timed on the device.
    pub timestamps: bool,
    /// The first error that nobody asked the device about.
    fault: Fault,
}

/// Where the device leaves its first complaint. Left to itself, wgpu would panic.
type Fault = Arc<Mutex<Option<String>>>;

/// Backends that print nothing on a machine without them: asking for GL on a headless
/// machine complains about XDG_RUNTIME_DIR.
const BACKENDS: wgpu::Backends = wgpu::Backends::VULKAN
    .union(wgpu::Backends::METAL)
    .union(wgpu::Backends::DX12);

impl Gpu {
    /// Opens the adapter whose name contains `wanted` (case does not matter) or whose
    /// number it is; without it the fastest one, a real GPU before a software driver.
    ///
    /// # Errors
    /// No adapter, none of that name, or one that cannot run Penumbra.
    pub fn open(wanted: Option<&str>) -> Result<Self, GpuError> {
        let instance = Self::instance();
        let adapter = choose(adapters(&instance), wanted)?;
        Self::from_adapter(instance, adapter)
    }

    /// The same with an adapter that can show pictures on `surface`, which `instance` has
    /// made.
    ///
    /// # Errors
    /// As [`Self::open`]; the adapter that was asked for cannot reach the surface.
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
                .partition(|a| a.is_surface_supported(surface));
            // With none able, the best of the others is named in the complaint.
            choose(if able.is_empty() { others } else { able }, None)?
        };
        if !adapter.is_surface_supported(surface) {
            return Err(GpuError::Unfit {
                adapter: adapter.get_info().name,
                reason: "it cannot show pictures in a window here; run with --headless".to_owned(),
            });
        }
        Self::from_adapter(instance, adapter)
    }

    /// What makes surfaces and finds adapters.
    #[must_use]
    pub fn instance() -> wgpu::Instance {
        let mut description = wgpu::InstanceDescriptor::new_without_display_handle();
        description.backends = BACKENDS;
        // Their sizes are our own shaders', which keep to the limits; to check each takes longer
        // than what it starts.
        description
            .flags
            .remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
        wgpu::Instance::new(description)
    }

    fn from_adapter(instance: wgpu::Instance, adapter: wgpu::Adapter) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let timestamps = adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let mut features = wgpu::Features::empty();
        features.set(wgpu::Features::TIMESTAMP_QUERY, timestamps);
        let limits = adapter.limits();
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("penumbra"),
            required_features: features,
            required_limits: limits,
            memory_hints: wgpu::MemoryHints::Performance,
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|e| GpuError::Unfit {
            adapter: info.name.clone(),
            reason: e.to_string(),
        })?;
        let software = info.device_type == wgpu::DeviceType::Cpu;
        Ok(Self {
            fault: watch(&device),
            instance,
            adapter,
            device,
            queue,
            name: info.name,
            software,
            timestamps,
        })
    }

    /// Waits until everything submitted has run.
    ///
    /// # Errors
    /// The device was lost, ran out of memory or refused something since it was opened.
    pub fn wait(&self) -> Result<(), GpuError> {
        let polled = self.device.poll(wgpu::PollType::wait_indefinitely());
        let fault = self
            .fault
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone();
        match fault.or_else(|| polled.err().map(|e| e.to_string())) {
            None => Ok(()),
            Some(reason) => Err(GpuError::Failed {
                adapter: self.name.clone(),
                reason,
            }),
        }
    }
}

/// Keeps the device's first complaint for [`Gpu::wait`] to tell.
fn watch(device: &wgpu::Device) -> Fault {
    let fault = Fault::default();
    let keep = fault.clone();
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        let mut kept = keep.lock().unwrap_or_else(PoisonError::into_inner);
        kept.get_or_insert_with(|| error.to_string());
    }));
    fault
}

/// All there are, the fastest first.
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
