//! The finished picture on a window's surface.

use crate::stage::{Stage, gpu, noise};
use penumbra_compositor::PresentPass;
use penumbra_picture::Picture;
use wgpu::{TextureFormat, TextureUsages};

/// Presents `picture` on a surface of this format and size, and returns the surface's bytes.
fn presented(picture: &Picture, format: TextureFormat, (width, height): (u32, u32)) -> Picture {
    let mut stage = Stage::new(picture.width, picture.height);
    stage.picture = picture.clone();
    let mut compositor = stage.compositor();
    stage.compose_with(&mut compositor);
    let (device, queue) = (&gpu().device, &gpu().queue);
    let surface = device.create_texture(&wgpu::TextureDescriptor {
        label: Some("surface"),
        size: wgpu::Extent3d {
            width,
            height,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: TextureUsages::RENDER_ATTACHMENT | TextureUsages::COPY_SRC,
        view_formats: &[],
    });
    let view = surface.create_view(&wgpu::TextureViewDescriptor::default());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    PresentPass::new(device, format).record(
        (device, queue),
        &mut encoder,
        (compositor.output().unwrap(), compositor.size().unwrap()),
        (&view, (width, height)),
    );
    read(encoder, &surface)
}

fn read(mut encoder: wgpu::CommandEncoder, texture: &wgpu::Texture) -> Picture {
    let (width, height) = (texture.width(), texture.height());
    let row = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = gpu().device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: u64::from(row * height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    encoder.copy_texture_to_buffer(
        texture.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(row),
                rows_per_image: None,
            },
        },
        texture.size(),
    );
    gpu().queue.submit([encoder.finish()]);
    buffer.map_async(wgpu::MapMode::Read, .., |_| ());
    gpu().wait().unwrap();
    let mapped = buffer.get_mapped_range(..).unwrap();
    let rows = mapped.chunks_exact(row as usize);
    Picture {
        width,
        height,
        rgba: rows
            .flat_map(|r| r[..4 * width as usize].to_vec())
            .collect(),
    }
}

#[test]
fn surface_of_the_pictures_size_shows_its_codes() {
    let picture = noise(40, 30);
    for format in [TextureFormat::Rgba8Unorm, TextureFormat::Rgba8UnormSrgb] {
        let shown = presented(&picture, format, (40, 30));
        for (a, b) in shown.rgba.chunks_exact(4).zip(picture.rgba.chunks_exact(4)) {
            let close = (0..3).all(|c| a[c].abs_diff(b[c]) <= 1);
            assert!(close && a[3] == 255, "{format:?} {a:?} {b:?}");
        }
    }
}

#[test]
fn borders_around_the_picture_are_black() {
    let picture = crate::stage::flat(40, 30, [200, 100, 50]);
    // Scaled by two, with borders of 20 pixels on two sides.
    let wide = presented(&picture, TextureFormat::Rgba8Unorm, (120, 60));
    let tall = presented(&picture, TextureFormat::Rgba8Unorm, (80, 100));
    for y in 0..60 {
        assert_eq!([wide.rgb(19, y), wide.rgb(100, y)], [[0; 3]; 2]);
        assert_eq!([wide.rgb(20, y), wide.rgb(99, y)], [[200, 100, 50]; 2]);
    }
    for x in 0..80 {
        assert_eq!([tall.rgb(x, 19), tall.rgb(x, 80)], [[0; 3]; 2]);
        assert_eq!([tall.rgb(x, 20), tall.rgb(x, 79)], [[200, 100, 50]; 2]);
    }
}
