//! The pass on the processor: traces the covered tiles of a frame and uploads the result.

use super::super::cover::{Corners, MIRROR};
use super::super::frame_input::FrameInput;
use super::super::frame_view::FrameView;
use super::super::textures::{FrameTexture, TILE, format};
use super::bvh::LANES;
use super::nearby::{Between, Nearby, PERIOD};
use super::nearby_scene::NearbyScene;
use super::radiance::NearbyLight;
use super::texel::{NOTHING, Texel, is_changed, is_uneven, packed, unpacked};
use super::trace::{BESIDE_CENTRE, Lobes, Tracer, WITHIN_PIXEL, slopes};
use super::view::View;
use crate::compiled::Device;
use glam::{DMat4, Vec2};
use penumbra_camera::Response;
use penumbra_interface::threads;
use wgpu::TextureUsages as U;

/// Points of the lattice in a packet, each way.
const PACKET: [usize; 2] = [4, 2];
/// Rows of the lattice that a thread takes at a time; few, because most rays meet a few objects.
const ROWS: usize = PACKET[1];
/// Rows of pixels that it takes at a time.
const PIXEL_ROWS: usize = 4;
/// Rays for a lobe at each of the places within a pixel that differs from those beside it, ...
const RAYS: usize = 24;
/// ... at a pixel that mirrors several things, ...
const SOME_RAYS: usize = 12;
/// ... and at a point of a lattice that stands for several pixels, or an outline.
const FEW_RAYS: usize = 3;

/// The scene, and the picture of what its glossy surfaces mirror.
pub struct ReflectionsStage {
    device: Device,
    scene: Option<NearbyScene>,
    /// Pixels from one point of the lattice to the next.
    step: u32,
    rays: LobeRays,
    picture: FrameTexture,
    /// The points of the lattice in the rectangle of covered tiles.
    lattice: Vec<Nearby>,
    /// The same with soft points, if there are any, averaged over those around them.
    softened: Vec<Nearby>,
    /// The pixels of that rectangle.
    texels: Vec<Texel>,
    /// The same with more rays where one differs from those beside it.
    refined: Vec<Texel>,
    /// By tile of the picture: whether it is a real mirror's and shows something virtual.
    shows: Vec<bool>,
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
    pub fn new(device: &Device, step: u32) -> Self {
        Self {
            device: device.clone(),
            scene: None,
            step,
            rays: LobeRays::new(if step > 1 { FEW_RAYS } else { RAYS }),
            picture: picture(device, (1, 1)),
            lattice: Vec::new(),
            softened: Vec::new(),
            texels: Vec::new(),
            refined: Vec::new(),
            shows: Vec::new(),
        }
    }

    /// Replaces the scene; `None` if nothing in it is glossy.
    pub fn set_scene(&mut self, scene: Option<NearbyScene>) {
        self.scene = scene;
        // No texel of the scene before may be taken for one of this scene.
        self.picture = picture(&self.device, (1, 1));
    }

    /// Moves a moving virtual part to `world`.
    pub fn place(&mut self, part: usize, world: DMat4) {
        if let Some(scene) = &mut self.scene {
            scene.place(part, world);
        }
    }

    /// The boxes around the real mirrors of the scene, world.
    pub fn mirrors(&self) -> impl Iterator<Item = Corners> {
        self.scene.iter().flat_map(|scene| &scene.mirrors).copied()
    }

    /// Whether a real mirror shows something virtual in a tile of the last frame.
    pub fn shows(&self, tile: usize) -> bool {
        self.shows.get(tile).is_some_and(|shows| *shows)
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
        self.shows.clear();
        let (Some(scene), Some(pose)) = (&self.scene, input.world_from_camera) else {
            return;
        };
        if self.picture.size() != view.size {
            self.picture = picture(&self.device, view.size);
        }
        let Some(light) = NearbyLight::new(input, response) else {
            return;
        };
        let work = Work {
            tracer: Tracer {
                scene,
                light,
                view: View::new(&view.camera, pose),
                spacing: self.step as f32 / view.camera.focal.x as f32,
            },
            tiles,
            step: self.step,
            rays: &self.rays,
        };
        let [_, _, across, down] = tiles.rectangle.map(|n| (n * TILE) as usize);
        if across == 0 || down == 0 {
            return;
        }
        let step = self.step as usize;
        let points = across * down / (step * step);
        self.lattice.resize(points, Nearby::NOTHING);
        let strips = self.lattice.chunks_exact_mut(ROWS * across / step);
        threads::for_each(strips.enumerate().collect(), |(number, strip)| {
            work.trace(number, strip);
        });
        let is_soft = self.lattice.iter().any(|point| point.is_soft);
        if is_soft {
            self.softened.resize(points, Nearby::NOTHING);
            let strips = self.softened.chunks_exact_mut(ROWS * across / step);
            threads::for_each(strips.enumerate().collect(), |(number, strip)| {
                soften(&self.lattice, across / step, number, strip);
            });
        }
        let lattice = if is_soft {
            &self.softened
        } else {
            &self.lattice
        };
        self.texels.resize(across * down, NOTHING);
        let strips = self.texels.chunks_exact_mut(PIXEL_ROWS * across);
        threads::for_each(strips.enumerate().collect(), |(number, strip)| {
            work.fill(lattice, number, strip);
        });
        self.refined.resize(across * down, NOTHING);
        let strips = self.refined.chunks_exact_mut(PIXEL_ROWS * across);
        threads::for_each(strips.enumerate().collect(), |(number, strip)| {
            work.refine(&self.texels, across, number, strip);
        });
        self.find_shown(tiles);
        upload(queue, &self.picture, &self.refined, tiles);
    }

    /// Finds the tiles of real mirrors that show something virtual.
    fn find_shown(&mut self, tiles: ReflectionTiles<'_>) {
        let [left, top, across, down] = tiles.rectangle.map(|n| n as usize);
        let side = TILE as usize;
        self.shows.resize(tiles.covered.len(), false);
        self.shows.fill(false);
        for (x, y) in (0..down).flat_map(|y| (0..across).map(move |x| (x, y))) {
            let tile = (top + y) * tiles.across as usize + left + x;
            if tiles.covered[tile] == MIRROR {
                let rows = (0..side).map(|row| ((y * side + row) * across + x) * side);
                let mut rows = rows.map(|first| &self.refined[first..first + side]);
                self.shows[tile] = rows.any(|row| row.iter().any(is_changed));
            }
        }
    }
}

/// Averages the soft points of strip `number` of [`ROWS`] rows over those around them.
fn soften(lattice: &[Nearby], across: usize, number: usize, softened: &mut [Nearby]) {
    let first = number * softened.len();
    for (k, softened) in softened.iter_mut().enumerate() {
        let own = &lattice[first + k];
        *softened = if own.is_soft {
            Nearby::softened(lattice, across, first + k)
        } else {
            *own
        };
    }
}

/// The rays for a lobe: the slopes of their half vectors, in units of its width.
struct LobeRays {
    /// At points of the lattice, and at outlines.
    few: Vec<Vec2>,
    /// At a pixel that mirrors several things.
    some: Vec<Vec2>,
    /// At each place within a pixel that differs from those beside it.
    many: Vec<Vec2>,
    /// At soft points of the lattice, by their place in a square of [`PERIOD`] points (interleaved sampling,
    /// Keller and Heidrich 2001): together, they divide the lobe evenly.
    soft: Vec<Vec<Vec2>>,
}

impl LobeRays {
    fn new(few: usize) -> Self {
        let sets = PERIOD * PERIOD;
        let all = slopes(few * sets);
        let set = |first: usize| all.iter().skip(first).step_by(sets).copied().collect();
        Self {
            few: slopes(few),
            some: slopes(SOME_RAYS),
            many: slopes(RAYS),
            soft: (0..sets).map(set).collect(),
        }
    }

    /// Those of the points of a packet, the first of which lies in row `y` of the lattice.
    fn of_packet(&self, y: usize) -> Lobes<'_> {
        // Packets begin at every fourth point of a row.
        let set = |lane: usize| {
            let row = (y + lane / PACKET[0]) % PERIOD;
            self.soft[row * PERIOD + lane % PACKET[0]].as_slice()
        };
        Lobes {
            fixed: &self.few,
            soft: Some(std::array::from_fn(set)),
        }
    }
}

/// The points of the picture at which rays are traced: those of the lattice, and the pixels between
/// points that differ.
struct Work<'a> {
    tracer: Tracer<'a>,
    tiles: ReflectionTiles<'a>,
    step: u32,
    rays: &'a LobeRays,
}

impl Work<'_> {
    /// Traces strip `number` of [`ROWS`] rows of the lattice.
    fn trace(&self, number: usize, points: &mut [Nearby]) {
        let across = points.len() / ROWS;
        let side = (TILE / self.step) as usize;
        let [left, top, ..] = self.tiles.rectangle.map(|n| n as usize);
        let row = number * ROWS;
        let tile_row = (top + row / side) * self.tiles.across as usize;
        points.fill(Nearby::NOTHING);
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
                let lobes = self.rays.of_packet(row + y);
                let found = match self.step {
                    1 => self.tracer.trace_smoothly(lobes, pixels),
                    _ => self.tracer.trace(lobes, pixels),
                };
                for (lane, found) in found.into_iter().enumerate() {
                    let (x, y) = place(lane);
                    points[y * across + x] = found;
                }
            }
        }
    }

    /// Fills the pixels of strip `number` of [`PIXEL_ROWS`] rows.
    fn fill(&self, lattice: &[Nearby], number: usize, texels: &mut [Texel]) {
        let side = TILE as usize;
        let across = texels.len() / PIXEL_ROWS;
        let [left, top, ..] = self.tiles.rectangle.map(|n| n as usize);
        let first = number * PIXEL_ROWS;
        let tile_row = (top + first / side) * self.tiles.across as usize;
        let covered = &self.tiles.covered[tile_row + left..];
        texels.fill(NOTHING);
        let LobeRays { few, some, .. } = self.rays;
        let mut waiting = AllWaiting {
            outlines: Waiting::new(few, true),
            curves: Waiting::new(few, false),
            several: Waiting::new(some, false),
        };
        for x in (0..across).filter(|x| covered[x / side] != 0) {
            for y in 0..PIXEL_ROWS {
                let own = y * across + x;
                let of_kind = match self.between(lattice, across, (x, first + y)) {
                    Between::Known(found) => {
                        texels[own] = packed(&found);
                        continue;
                    }
                    Between::Outline => &mut waiting.outlines,
                    Between::Curve => &mut waiting.curves,
                    Between::Reflections => &mut waiting.several,
                };
                let row = top * side + first + y;
                of_kind.push(Vec2::new((left * side + x) as f32, row as f32), own);
                self.trace_waiting(&mut waiting, LANES, texels);
            }
        }
        self.trace_waiting(&mut waiting, 1, texels);
    }

    /// Copies strip `number` of [`PIXEL_ROWS`] rows, with more rays at pixels that differ from those beside
    /// them: edges and thin lines of what they mirror, and rays that meet the image of a lamp by chance.
    fn refine(&self, texels: &[Texel], across: usize, number: usize, refined: &mut [Texel]) {
        let first = number * refined.len();
        refined.copy_from_slice(&texels[first..first + refined.len()]);
        let [left, top, ..] = self.tiles.rectangle.map(|n| (n * TILE) as usize);
        let mut waiting = Waiting::new(&self.rays.many, false);
        for own in 0..refined.len() {
            if is_uneven(texels, across, first + own) {
                let (x, y) = ((first + own) % across, (first + own) / across);
                waiting.push(Vec2::new((left + x) as f32, (top + y) as f32), own);
                if waiting.count == LANES {
                    self.fill_finely(&mut waiting, refined);
                }
            }
        }
        if waiting.count > 0 {
            self.fill_finely(&mut waiting, refined);
        }
    }

    fn fill_finely(&self, waiting: &mut Waiting<'_>, texels: &mut [Texel]) {
        let known = waiting.texels.map(|texel| unpacked(&texels[texel]));
        let places = match self.step {
            1 => &WITHIN_PIXEL[..],
            _ => &BESIDE_CENTRE,
        };
        let pixels = waiting.filled();
        let found = (self.tracer).trace_finely(waiting.lobes(), places, pixels, known);
        for (found, texel) in found.iter().zip(&waiting.texels[..waiting.count]) {
            texels[*texel] = packed(found);
        }
        waiting.count = 0;
    }

    /// What the lattice tells of a pixel of the rectangle.
    fn between(&self, lattice: &[Nearby], across: usize, (x, y): (usize, usize)) -> Between {
        let step = self.step as usize;
        if step == 1 {
            return at_pixel(lattice, across, (x, y));
        }
        let across = across / step;
        let down = lattice.len() / across;
        let place = (Vec2::new(x as f32, y as f32) + 0.5) / self.step as f32 - 0.5;
        let corner = place.floor();
        let part = place - corner;
        let at = |dx: f32, dy: f32| {
            let x = (corner.x + dx).clamp(0.0, across as f32 - 1.0) as usize;
            let y = (corner.y + dy).clamp(0.0, down as f32 - 1.0) as usize;
            &lattice[y * across + x]
        };
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
        let (u, v) = (part.x, part.y);
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        Nearby::between(corners, weights)
    }

    /// Traces pixels of each kind of which at least `count` wait.
    fn trace_waiting(&self, waiting: &mut AllWaiting<'_>, count: usize, texels: &mut [Texel]) {
        let AllWaiting {
            outlines,
            curves,
            several,
        } = waiting;
        if curves.count >= count {
            let found = self.trace_all(curves);
            for (k, found) in found.iter().enumerate().take(curves.count) {
                if found.open == 1.0 {
                    texels[curves.texels[k]] = packed(found);
                    continue;
                }
                // A few rays do not tell what else such a surface shows.
                several.push(curves.pixels[k], curves.texels[k]);
                if several.count == LANES {
                    self.fill_texels(several, texels);
                }
            }
            curves.count = 0;
        }
        for waiting in [outlines, several] {
            if waiting.count >= count {
                self.fill_texels(waiting, texels);
            }
        }
    }

    fn fill_texels(&self, waiting: &mut Waiting<'_>, texels: &mut [Texel]) {
        let found = self.trace_all(waiting);
        for (found, texel) in found.iter().zip(&waiting.texels[..waiting.count]) {
            texels[*texel] = packed(found);
        }
        waiting.count = 0;
    }

    /// What the pixels that wait mirror; there must be one.
    fn trace_all(&self, waiting: &Waiting<'_>) -> [Nearby; LANES] {
        let (lobes, pixels) = (waiting.lobes(), waiting.filled());
        if waiting.is_outline {
            self.tracer.trace_outlines(lobes, pixels)
        } else {
            self.tracer.trace_smoothly(lobes, pixels)
        }
    }
}

/// What a lattice of all pixels tells of one.
fn at_pixel(lattice: &[Nearby], across: usize, (x, y): (usize, usize)) -> Between {
    let own = &lattice[y * across + x];
    let down = lattice.len() / across;
    let beside = [
        (x.saturating_sub(1), y),
        ((x + 1).min(across - 1), y),
        (x, y.saturating_sub(1)),
        (x, (y + 1).min(down - 1)),
    ];
    let is_edge = beside
        .into_iter()
        .any(|(x, y)| !own.is_as_far_as(&lattice[y * across + x]));
    // Nothing at all lies nowhere: it is not as far as itself.
    let is_empty = own.z == 0.0
        && beside
            .into_iter()
            .all(|(x, y)| lattice[y * across + x].z == 0.0);
    if is_edge && !is_empty {
        Between::Outline
    } else {
        Between::Known(*own)
    }
}

/// Pixels that have rays of their own, by what lies between the points of the lattice around them.
struct AllWaiting<'a> {
    outlines: Waiting<'a>,
    curves: Waiting<'a>,
    /// Those that mirror several things.
    several: Waiting<'a>,
}

/// Pixels that are traced together, and their texels.
struct Waiting<'a> {
    /// Of their rays.
    slopes: &'a [Vec2],
    is_outline: bool,
    pixels: [Vec2; LANES],
    texels: [usize; LANES],
    count: usize,
}

impl<'a> Waiting<'a> {
    const fn new(slopes: &'a [Vec2], is_outline: bool) -> Self {
        Self {
            slopes,
            is_outline,
            pixels: [Vec2::ZERO; LANES],
            texels: [0; LANES],
            count: 0,
        }
    }

    const fn push(&mut self, pixel: Vec2, texel: usize) {
        self.pixels[self.count] = pixel;
        self.texels[self.count] = texel;
        self.count += 1;
    }

    const fn lobes(&self) -> Lobes<'a> {
        Lobes {
            fixed: self.slopes,
            soft: None,
        }
    }

    /// The pixels, of which there must be one, the last of them as often as fills a packet.
    fn filled(&self) -> [Vec2; LANES] {
        let mut pixels = self.pixels;
        pixels[self.count..].fill(self.pixels[self.count - 1]);
        pixels
    }
}

/// Uploads the rectangle of covered tiles, as far as it lies in the picture.
fn upload(queue: &wgpu::Queue, to: &FrameTexture, texels: &[Texel], tiles: ReflectionTiles<'_>) {
    let [x, y, across, down] = tiles.rectangle.map(|n| n * TILE);
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

fn picture(device: &Device, size: (u32, u32)) -> FrameTexture {
    let usage = U::TEXTURE_BINDING | U::COPY_DST;
    FrameTexture::new(device, "nearby", size, format::TILES, usage)
}

#[cfg(test)]
mod tests;
