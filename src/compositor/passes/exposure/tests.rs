//! The running_sums-area table against plain sums.
use super::*;
use crate::gpu::Gpu;
use crate::timing::Timer;
use penumbra_picture::Picture;

fn gpu() -> Gpu {
    let adapter = std::env::var("PENUMBRA_TEST_ADAPTER").unwrap_or_else(|_| "llvmpipe".to_owned());
    Gpu::open(Some(&adapter)).expect("a Vulkan driver; `make test` installs a software one")
}

/// The contents of a buffer of the device.
fn contents<const N: usize>(gpu: &Gpu, buffer: &wgpu::Buffer) -> Vec<[u32; N]> {
    let copy = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("copy"),
        size: buffer.size(),
        usage: Usage::COPY_DST | Usage::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, buffer.size());
    gpu.queue.submit([encoder.finish()]);
    copy.map_async(wgpu::MapMode::Read, .., |_| ());
    gpu.wait().unwrap();
    let bytes = copy.get_mapped_range(..).unwrap();
    let numbers: &[u32] = bytemuck::cast_slice(&bytes);
    numbers
        .chunks_exact(N)
        .map(|c| c.try_into().unwrap())
        .collect()
}

/// Sums of blocks, then running sums: colours and brightness of each.
struct Table {
    across: usize,
    blocks: (Vec<[u32; 4]>, Vec<[u32; 2]>),
    sums: (Vec<[u32; 4]>, Vec<[u32; 2]>),
}

fn table_of(picture: &Picture, response: &Response) -> Table {
    let gpu = gpu();
    let mut pass = ExposurePass::new(&gpu.device);
    let size = (picture.width, picture.height);
    let usage = U::COPY_DST | U::TEXTURE_BINDING;
    let camera = FrameTexture::new(&gpu.device, "camera", size, format::CAMERA, usage);
    camera.upload(&gpu.queue, &picture.rgba, 4);
    let codes = ResponseTable::new(&gpu.device, &gpu.queue, response);
    pass.upload(
        &gpu.queue,
        (0.5, Highlights::Estimated),
        Region::for_factor(0.5, picture.height),
        response,
    );
    let exposed = ExposedPictures::new(&gpu.device, size);
    let mut timer = Timer::new(&gpu.device, &gpu.queue, false);
    let mut run = |steps: Range<usize>| {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut recorder = Recorder {
            device: &gpu.device,
            encoder: &mut encoder,
            timer: &mut timer,
        };
        pass.record_table(&mut recorder, (&camera, &codes), &exposed, steps);
        gpu.queue.submit([encoder.finish()]);
        let (colours, brightness) = &exposed.sums;
        (contents(&gpu, colours), contents(&gpu, brightness))
    };
    Table {
        across: exposed.blocks.0 as usize,
        blocks: run(0..1),
        sums: run(1..3),
    }
}

/// Running sums both ways, modulo 2³².
fn running_sums<const N: usize>(blocks: &[[u32; N]], across: usize) -> Vec<[u32; N]> {
    let mut sums: Vec<[u32; N]> = Vec::with_capacity(blocks.len());
    for (i, block) in blocks.iter().enumerate() {
        let (x, y) = (i % across, i / across);
        let at = |dx: usize, dy: usize| (x >= dx && y >= dy).then(|| sums[i - dx - dy * across]);
        let [left, above, both] = [at(1, 0), at(0, 1), at(1, 1)].map(|s| s.unwrap_or([0; N]));
        sums.push(std::array::from_fn(|k| {
            block[k]
                .wrapping_add(left[k])
                .wrapping_add(above[k])
                .wrapping_sub(both[k])
        }));
    }
    sums
}

fn mixed(width: u32, height: u32, brightest: u8) -> Picture {
    let mut state = 0x9e37_79b9_u32;
    let rgba = (0..4 * width * height).map(|_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8 % brightest.saturating_add(1).max(1)
    });
    Picture {
        rgba: rgba.collect(),
        width,
        height,
    }
}

#[test]
fn running_sums_are_exact_at_any_size() {
    for (width, height) in [
        (1, 1),
        (3, 9),
        (101, 67),
        (257, 260),
        (640, 480),
        (1920, 1080),
    ] {
        let table = table_of(&mixed(width, height, 255), &Response::srgb());
        assert!(
            running_sums(&table.blocks.0, table.across) == table.sums.0,
            "{width}×{height}"
        );
        assert!(
            running_sums(&table.blocks.1, table.across) == table.sums.1,
            "{width}×{height}"
        );
    }
}

/// The brightest picture without clipped pixels: the sum over the entire picture exceeds 2³², yet
/// differences are exact.
#[test]
fn sums_over_a_region_are_exact_in_the_brightest_picture() {
    let (width, height) = (1920, 1080);
    let picture = Picture {
        width,
        height,
        rgba: vec![242; 4 * (width * height) as usize],
    };
    let table = table_of(&picture, &Response::linear());
    let linear = 242.0 / 255.0;
    let block = f64::from(table.blocks.0[0][0]);
    assert!(
        (block - 16.0 * 4096.0 * linear * linear).abs() <= 0.5,
        "{block}"
    );
    let (across, down) = (table.across, table.blocks.0.len() / table.across);
    assert!(block * (across * down) as f64 > 2.0_f64.powi(32));
    let side = 2 * Region::for_factor(0.0, height).reach as usize + 3;
    let at = |x: usize, y: usize| table.sums.0[y * across + x][0];
    let (x, y) = (across - 1, down - 1);
    let sum = at(x, y)
        .wrapping_sub(at(x - side, y))
        .wrapping_sub(at(x, y - side))
        .wrapping_add(at(x - side, y - side));
    assert_eq!(f64::from(sum), block * (side * side) as f64);
}

#[test]
fn blocks_are_rounded_once() {
    let (width, height) = (101, 67);
    let (picture, response) = (mixed(width, height, 255), Response::srgb());
    let table = table_of(&picture, &response);
    for (i, block) in table.blocks.0.iter().enumerate() {
        let (x0, y0) = (4 * (i % table.across) as u32, 4 * (i / table.across) as u32);
        let mut sum = [0.0_f64; 4];
        for (x, y) in (0..16).map(|k| (x0 + k % 4, y0 + k / 4)) {
            if x >= width || y >= height {
                continue;
            }
            let codes = picture.rgb(x, y);
            let [r, g, b] = response.linear_from_rgb(codes).map(f64::from);
            let clipped = f64::from(codes.into_iter().max().unwrap_or(0));
            let clipped = ((clipped - 243.0) / 7.0).clamp(0.0, 1.0);
            let weight = (0.2126 * r + 0.7152 * g + 0.0722 * b) * (1.0 - clipped);
            let own = [r * weight, g * weight, b * weight, clipped];
            (0..4).for_each(|k| sum[k] += own[k] * 4096.0);
        }
        for k in 0..4 {
            assert!(
                (f64::from(block[k]) - sum[k]).abs() < 0.52,
                "{i} {k}: {block:?} {sum:?}"
            );
        }
    }
}
