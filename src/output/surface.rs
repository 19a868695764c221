//! Presents the finished picture on a window's surface.

use crate::Screen;
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
    pass: PresentPass,
    format: TextureFormat,
    mode: PresentMode,
    /// Size that the surface is configured for; `None` if it must be configured again.
    configured: Option<(u32, u32)>,
}

impl SurfaceScreen {
    pub fn new(
        gpu: &Gpu,
        surface: wgpu::Surface<'static>,
        window: Arc<Window>,
        state: Arc<WindowState>,
    ) -> Self {
        let capabilities = surface.get_capabilities(&gpu.adapter);
        let format = format_without_srgb(&capabilities.formats);
        // Mailbox does not tear and does not wait for the monitor, whose rate differs from the camera's.
        let mailbox = capabilities.present_modes.contains(&PresentMode::Mailbox);
        Self {
            pass: PresentPass::new(&gpu.device, format),
            mode: if mailbox {
                PresentMode::Mailbox
            } else {
                PresentMode::Fifo
            },
            surface,
            window,
            state,
            format,
            configured: None,
        }
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
        if self.fit(compositor.gpu())
            && let Some(texture) = self.acquire(compositor.gpu())
        {
            self.present(compositor, texture);
        }
        true
    }
}

/// Returns a format without sRGB encoding if there is one, because the picture is already encoded.
fn format_without_srgb(formats: &[TextureFormat]) -> TextureFormat {
    let eight_bit = [TextureFormat::Bgra8Unorm, TextureFormat::Rgba8Unorm];
    let preferred = formats.iter().find(|f| eight_bit.contains(f));
    let first = preferred.or_else(|| formats.iter().find(|f| !f.is_srgb()));
    *first
        .or(formats.first())
        .unwrap_or(&TextureFormat::Bgra8Unorm)
}

#[cfg(test)]
mod tests {
    use super::{WindowState, format_without_srgb};
    use wgpu::TextureFormat::{Bgra8Unorm, Bgra8UnormSrgb, Rgba16Float};

    #[test]
    fn prefers_formats_without_srgb_encoding() {
        assert_eq!(
            format_without_srgb(&[Bgra8UnormSrgb, Rgba16Float, Bgra8Unorm]),
            Bgra8Unorm
        );
        assert_eq!(format_without_srgb(&[Bgra8UnormSrgb]), Bgra8UnormSrgb);
        assert_eq!(format_without_srgb(&[]), Bgra8Unorm);
    }

    #[test]
    fn size_is_stored_unchanged() {
        let state = WindowState::default();
        state.set_size((u32::MAX, 7));
        assert_eq!(state.size(), (u32::MAX, 7));
    }
}
