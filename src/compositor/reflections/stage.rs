//! The pass on the processor: traces the covered tiles of a frame and uploads the result.

use super::super::frame_input::FrameInput;
use super::super::frame_view::FrameView;
use super::super::textures::{FrameTexture, TILE, coarse_size, format};
use super::bvh::LANES;
use super::nearby_scene::NearbyScene;
use super::radiance::{NearbyLight, PointGrid};
use super::trace::{Nearby, Tracer, View, slopes};
use glam::{DMat4, Vec2};
use half::f16;
use penumbra_camera::Response;
use penumbra_interface::threads;
use wgpu::TextureUsages as U;

/// Points of the lattice in a packet, each way.
const PACKET: [usize; 2] = [4, 2];
/// Rows of the lattice that a thread takes at a time.
const ROWS: usize = 4;
/// Rays for a lobe where every pixel has a point of the lattice, and where not.
const RAYS: [usize; 2] = [12, 3];

/// A texel: light, open, seen, seen · metres as half floats, then z.
type Texel = [u32; 4];

/// The scene, and the picture of what its glossy surfaces mirror.
pub struct ReflectionsStage {
    device: wgpu::Device,
    scene: Option<NearbyScene>,
    points: PointGrid,
    /// Pixels from one point of the lattice to the next.
    step: u32,
    /// Of the rays for a lobe.
    slopes: Vec<Vec2>,
    picture: FrameTexture,
    /// The rectangle of texels in which something was traced.
    texels: Vec<Texel>,
}

/// The tiles of a frame: which are covered, row by row, their number in a row, and the rectangle of
/// covered ones (x, y, width, height).
#[derive(Clone, Copy)]
pub struct ReflectionTiles<'a> {
    pub covered: &'a [u8],
    pub across: u32,
    pub rectangle: [u32; 4],
}

impl ReflectionsStage {
    /// Without a scene; `step` pixels from one point to the next, 1, 2, 4 or 8.
    pub fn new(device: &wgpu::Device, step: u32) -> Self {
        Self {
            device: device.clone(),
            scene: None,
            points: PointGrid::default(),
            step,
            slopes: slopes(RAYS[usize::from(step > 1)]),
            picture: picture(device, (1, 1)),
            texels: Vec::new(),
        }
    }

    /// Replaces the scene; `None` if nothing in it is glossy.
    pub fn set_scene(&mut self, scene: Option<NearbyScene>) {
        self.scene = scene;
        // No texel of the scene before may be taken for one of this scene.
        self.picture = picture(&self.device, (1, 1));
    }

    /// Pixels from one point of the lattice to the next; 0 if nothing is glossy.
    pub const fn step(&self) -> u32 {
        if self.scene.is_some() { self.step } else { 0 }
    }

    /// Moves a moving virtual part to `world`.
    pub fn place(&mut self, part: usize, world: DMat4) {
        if let Some(scene) = &mut self.scene {
            scene.place(part, world);
        }
    }

    /// What the composite binds.
    pub const fn picture(&self) -> &FrameTexture {
        &self.picture
    }

    /// Traces the covered tiles of a frame and uploads what they mirror.
    pub fn update(
        &mut self,
        queue: &wgpu::Queue,
        (input, view): (&FrameInput<'_>, &FrameView),
        response: &Response,
        tiles: ReflectionTiles<'_>,
    ) {
        let (Some(scene), Some(pose)) = (&self.scene, input.world_from_camera) else {
            return;
        };
        let size = coarse_size(view.size, self.step);
        if self.picture.size() != size {
            self.picture = picture(&self.device, size);
        }
        if let Some(light) = input.indirect_light {
            self.points.fit(&light.nearby);
        }
        let Some(light) = NearbyLight::new(input, response, &self.points) else {
            return;
        };
        let lattice = Lattice {
            tracer: Tracer {
                scene,
                light,
                view: View::new(&view.camera, pose),
                slopes: &self.slopes,
            },
            tiles,
            step: self.step,
        };
        let [_, _, across, down] = tiles.rectangle.map(|n| (n * TILE / self.step) as usize);
        if across == 0 || down == 0 {
            return;
        }
        self.texels.resize(across * down, [0; 4]);
        let strips = self.texels[..across * down].chunks_exact_mut(ROWS * across);
        threads::for_each(strips.enumerate().collect(), |(number, strip)| {
            lattice.trace(number, strip);
        });
        upload(queue, &self.picture, &self.texels, (tiles, self.step));
    }
}

/// The points of the picture at which rays are traced.
struct Lattice<'a> {
    tracer: Tracer<'a>,
    tiles: ReflectionTiles<'a>,
    step: u32,
}

impl Lattice<'_> {
    /// Traces strip `number` of [`ROWS`] rows.
    fn trace(&self, number: usize, texels: &mut [Texel]) {
        let across = texels.len() / ROWS;
        let side = (TILE / self.step) as usize;
        let [left, top, ..] = self.tiles.rectangle.map(|n| n as usize);
        let row = number * ROWS;
        let tile_row = (top + row / side) * self.tiles.across as usize;
        texels.fill([0; 4]);
        for x in (0..across).step_by(PACKET[0]) {
            if self.tiles.covered[tile_row + left + x / side] == 0 {
                continue;
            }
            for y in (0..ROWS).step_by(PACKET[1]) {
                let place = |lane: usize| (x + lane % PACKET[0], y + lane / PACKET[0]);
                let pixels: [Vec2; LANES] = std::array::from_fn(|lane| {
                    let (x, y) = place(lane);
                    let at = Vec2::new((left * side + x) as f32, (top * side + row + y) as f32);
                    (at + 0.5) * self.step as f32 - 0.5
                });
                for (lane, found) in self.tracer.trace(pixels).iter().enumerate() {
                    let (x, y) = place(lane);
                    texels[y * across + x] = packed(found);
                }
            }
        }
    }
}

/// Twin of WGSL `nearby_at`, which reads it.
fn packed(nearby: &Nearby) -> Texel {
    if nearby.z == 0.0 {
        return [0; 4];
    }
    let half = |x: f32| u32::from(f16::from_f32(x.clamp(0.0, 6e4)).to_bits());
    let halves = |a: f32, b: f32| half(a) | half(b) << 16;
    let Nearby {
        light,
        open,
        seen,
        metres,
        z,
    } = *nearby;
    [
        halves(light.x, light.y),
        halves(light.z, open),
        halves(seen, seen * metres),
        z.to_bits(),
    ]
}

/// Uploads the rectangle of covered tiles, as far as it lies in the picture.
fn upload(
    queue: &wgpu::Queue,
    to: &FrameTexture,
    texels: &[Texel],
    (tiles, step): (ReflectionTiles<'_>, u32),
) {
    let [x, y, across, down] = tiles.rectangle.map(|n| n * TILE / step);
    let (width, height) = to.size();
    queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture: &to.texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x, y, z: 0 },
            aspect: wgpu::TextureAspect::All,
        },
        bytemuck::cast_slice(texels),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(across * size_of::<Texel>() as u32),
            rows_per_image: None,
        },
        wgpu::Extent3d {
            width: across.min(width - x),
            height: down.min(height - y),
            depth_or_array_layers: 1,
        },
    );
}

fn picture(device: &wgpu::Device, size: (u32, u32)) -> FrameTexture {
    let usage = U::TEXTURE_BINDING | U::COPY_DST;
    FrameTexture::new(device, "nearby", size, format::TILES, usage)
}
