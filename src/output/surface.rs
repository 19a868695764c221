//! Presents the finished picture on a window's surface.

use crate::{OutputError, Screen};
use penumbra_compositor::{Compositor, Gpu, PresentPass};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use wgpu::{CurrentSurfaceTexture, PresentMode, TextureFormat};
use winit::window::Window;

/// State that the window's thread shares with the frames' thread.
#[derive(Debug, Default)]
pub(super) struct WindowState {
    /// Width in the upper half, height in the lower: both change together.
    size: AtomicU64,
    closed: AtomicBool,
}

impl WindowState {
    pub fn set_size(&self, (width, height): (u32, u32)) {
        let packed = u64::from(width) << 32 | u64::from(height);
        self.size.store(packed, Ordering::Relaxed);
    }

    fn size(&self) -> (u32, u32) {
        let packed = self.size.load(Ordering::Relaxed);
        ((packed >> 32) as u32, packed as u32)
    }

    pub fn close(&self) {
        self.closed.store(true, Ordering::Relaxed);
    }
}

/// Presents on a surface and adapts it to the window's size.
pub(super) struct SurfaceScreen {
    surface: wgpu::Surface<'static>,
    window: Arc<Window>,
    state: Arc<WindowState>,
    device: penumbra_compositor::Device,
    pass: PresentPass,
    format: TextureFormat,
    mode: PresentMode,
    /// Size that the surface is configured for; `None` if it must be configured again.
    configured: Option<(u32, u32)>,
}

impl SurfaceScreen {
    /// Creates a screen on a surface of `window`.
    ///
    /// # Errors
    /// The window has no format that can be presented.
    pub fn new(
        gpu: &Gpu,
        surface: wgpu::Surface<'static>,
        window: Arc<Window>,
        state: Arc<WindowState>,
    ) -> Result<Self, OutputError> {
        let capabilities = surface.get_capabilities(&gpu.adapter);
        let (format, mode) = format_and_mode(&capabilities).ok_or_else(|| OutputError::Window {
            reason: format!("no usable format among {:?}", capabilities.formats),
        })?;
        Ok(Self {
            device: gpu.device.clone(),
            pass: PresentPass::new(&gpu.device, format),
            mode,
            surface,
            window,
            state,
            format,
            configured: None,
        })
    }

    /// Presents from now on with the device that replaced a lost one, on a new surface, because the
    /// old one still has images of the lost device.
    fn follow(&mut self, gpu: &Gpu) {
        self.renew(gpu);
        self.device = gpu.device.clone();
        // Without a format nothing is presented; see `fit`.
        let found = format_and_mode(&self.surface.get_capabilities(&gpu.adapter));
        if let Some((format, mode)) = found {
            (self.format, self.mode) = (format, mode);
        }
        self.pass = PresentPass::new(&gpu.device, self.format);
    }

    /// Configures the surface for the window's size. Returns false while the window has no size.
    fn fit(&mut self, gpu: &Gpu) -> bool {
        let largest = gpu.device.limits().max_texture_dimension_2d;
        let (width, height) = self.state.size();
        let size = (width.min(largest), height.min(largest));
        if size.0 == 0 || size.1 == 0 {
            return false;
        }
        if self.configured != Some(size) {
            self.configure(gpu, size);
        }
        self.configured.is_some()
    }

    fn configure(&mut self, gpu: &Gpu, (width, height): (u32, u32)) {
        let configuration = wgpu::SurfaceConfiguration {
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            format: self.format,
            color_space: wgpu::SurfaceColorSpace::Auto,
            width,
            height,
            present_mode: self.mode,
            desired_maximum_frame_latency: 1,
            alpha_mode: wgpu::CompositeAlphaMode::Auto,
            view_formats: Vec::new(),
        };
        // A window that changes while its surface is configured is not a device error.
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        self.surface.configure(&gpu.device, &configuration);
        let refused = pollster::block_on(scope.pop()).is_some();
        self.configured = (!refused).then_some((width, height));
    }

    /// Returns the surface's next texture, if one is available.
    fn acquire(&mut self, gpu: &Gpu) -> Option<wgpu::SurfaceTexture> {
        let scope = gpu.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let acquired = self.surface.get_current_texture();
        drop(scope);
        match acquired {
            CurrentSurfaceTexture::Success(texture) => Some(texture),
            CurrentSurfaceTexture::Suboptimal(texture) => {
                self.configured = None;
                Some(texture)
            }
            CurrentSurfaceTexture::Timeout | CurrentSurfaceTexture::Occluded => None,
            CurrentSurfaceTexture::Outdated | CurrentSurfaceTexture::Validation => {
                self.configured = None;
                None
            }
            CurrentSurfaceTexture::Lost => {
                self.renew(gpu);
                None
            }
        }
    }

    /// Creates a new surface of the same window; on failure the old one is kept.
    fn renew(&mut self, gpu: &Gpu) {
        self.configured = None;
        if let Ok(surface) = gpu.instance.create_surface(self.window.clone()) {
            self.surface = surface;
        }
    }

    fn present(&self, compositor: &Compositor, texture: wgpu::SurfaceTexture) {
        let (Some(picture), Some(size)) = (compositor.output(), compositor.size()) else {
            return;
        };
        let gpu = compositor.gpu();
        let view = texture
            .texture
            .create_view(&wgpu::TextureViewDescriptor::default());
        let extent = (texture.texture.width(), texture.texture.height());
        let mut encoder = gpu
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor {
                label: Some("window"),
            });
        self.pass.record(
            (&gpu.device, &gpu.queue),
            &mut encoder,
            (picture, size),
            (&view, extent),
        );
        gpu.queue.submit([encoder.finish()]);
        self.window.pre_present_notify();
        gpu.queue.present(texture);
    }
}

impl Screen for SurfaceScreen {
    fn show(&mut self, compositor: &Compositor) -> bool {
        if self.state.closed.load(Ordering::Relaxed) {
            return false;
        }
        if self.device != compositor.gpu().device {
            self.follow(compositor.gpu());
        }
        if self.fit(compositor.gpu())
            && let Some(texture) = self.acquire(compositor.gpu())
        {
            self.present(compositor, texture);
        }
        true
    }
}

/// Chooses format and mode; `None` if the window has no format that can be presented. Mailbox does not tear and does not wait for the monitor, whose rate
/// differs from the camera's.
fn format_and_mode(
    capabilities: &wgpu::SurfaceCapabilities,
) -> Option<(TextureFormat, PresentMode)> {
    let mailbox = capabilities.present_modes.contains(&PresentMode::Mailbox);
    let mode = if mailbox {
        PresentMode::Mailbox
    } else {
        PresentMode::Fifo
    };
    Some((format_of(&capabilities.formats)?, mode))
}

/// The formats in which pictures are presented, the preferred ones first: the picture is already
/// encoded, and one with sRGB encoding is decoded for it. Others (half floats) would need another
/// colour space.
const FORMATS: [TextureFormat; 6] = [
    TextureFormat::Bgra8Unorm,
    TextureFormat::Rgba8Unorm,
    TextureFormat::Bgra8UnormSrgb,
    TextureFormat::Rgba8UnormSrgb,
    TextureFormat::Rgb10a2Unorm,
    TextureFormat::Rgba16Unorm,
];

/// Chooses the format; `None` if the window has none of those that can be presented.
fn format_of(formats: &[TextureFormat]) -> Option<TextureFormat> {
    FORMATS.into_iter().find(|f| formats.contains(f))
}

#[cfg(test)]
mod tests {
    use super::{WindowState, format_and_mode, format_of};
    use wgpu::PresentMode::{Fifo, Mailbox};
    use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgb10a2Unorm, Rgba16Float};

    #[test]
    fn prefers_formats_without_srgb_encoding() {
        let all = [Bgra8UnormSrgb, Rgba16Float, Bgra8Unorm];
        assert_eq!(format_of(&all), Some(Bgra8Unorm));
        assert_eq!(format_of(&all[..2]), Some(Bgra8UnormSrgb));
        assert_eq!(format_of(&[Rgba16Float, Rgb10a2Unorm]), Some(Rgb10a2Unorm));
    }

    #[test]
    fn window_without_usable_format_is_refused() {
        assert_eq!(format_of(&[Rgba16Float]), None);
        assert_eq!(format_of(&[]), None);
    }

    #[test]
    fn presents_in_step_with_the_monitor_without_mailbox() {
        let mut offered = wgpu::SurfaceCapabilities {
            formats: vec![Bgra8Unorm],
            present_modes: vec![Fifo],
            ..wgpu::SurfaceCapabilities::default()
        };
        assert_eq!(format_and_mode(&offered), Some((Bgra8Unorm, Fifo)));
        offered.present_modes.push(Mailbox);
        assert_eq!(format_and_mode(&offered), Some((Bgra8Unorm, Mailbox)));
    }

    #[test]
    fn size_is_stored_unchanged() {
        let state = WindowState::default();
        state.set_size((u32::MAX, 7));
        assert_eq!(state.size(), (u32::MAX, 7));
    }
}
