//! Specular reflection of the environment on the GPU: the prefiltered radiance maps, the table of
//! the response of lobes, and the compact sources.

use super::gpu_data::CompactSourcesUniform;
use super::texels::{HalfTexels, write_level};
use crate::compiled::Device;
use half::f16;
use penumbra_lighting::box_chain::box_level;
use penumbra_lighting::lobes::{Family, Levels, LongLobe, own_width, widths};
use penumbra_lighting::{CubeMap, Filtering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// Columns of the table: n·v.
const COLUMNS: u32 = 32;
/// Rows of a family of lobes: its parameter. Twin of `GLOSS_ROWS` in `lib/gloss.wgsl`.
const ROWS: u32 = 64;
const FAMILIES: [Family; 2] = [Family::Ggx, Family::Phong];
/// Blocks of the table: one per family, and one for GGX's long lobes. Twin of `GLOSS_BLOCKS` in
/// `lib/gloss.wgsl`.
const BLOCKS: u32 = 3;

/// The radiance that glossy surfaces reflect.
pub struct GlossMaps {
    /// Scale, bias, tilt and level by n·v and parameter: GGX, below it Phong; then level, share
    /// and step of GGX's long lobes.
    pub table: wgpu::TextureView,
    pub ggx: Cube,
    pub phong: Cube,
    /// Compact sources, which the maps leave out.
    pub compact_sources: wgpu::Buffer,
    table_texture: wgpu::Texture,
    /// The maps for which the table holds levels.
    tabled: Option<(Filtering, u32, usize)>,
    texels: HalfTexels,
}

/// A cube map with its levels.
pub struct Cube {
    pub view: wgpu::TextureView,
    texture: wgpu::Texture,
}

impl Cube {
    fn new(device: &Device, size: u32, levels: u32) -> Self {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("radiance"),
            size: wgpu::Extent3d {
                width: size,
                height: size,
                depth_or_array_layers: 6,
            },
            mip_level_count: levels,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor {
            dimension: Some(wgpu::TextureViewDimension::Cube),
            ..Default::default()
        });
        Self { view, texture }
    }

    fn fits(&self, size: u32, levels: u32) -> bool {
        self.texture.width() == size && self.texture.mip_level_count() == levels
    }
}

impl GlossMaps {
    /// Black maps, until the first upload.
    pub fn new(device: &Device) -> Self {
        let table_texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("gloss table"),
            size: wgpu::Extent3d {
                width: COLUMNS,
                height: ROWS * BLOCKS,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba16Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        Self {
            table: table_texture.create_view(&wgpu::TextureViewDescriptor::default()),
            table_texture,
            ggx: Cube::new(device, 1, 1),
            phong: Cube::new(device, 1, 1),
            compact_sources: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("compact sources"),
                size: size_of::<CompactSourcesUniform>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            tabled: None,
            texels: HalfTexels::default(),
        }
    }

    /// The number of the coarsest level of the maps; 0 = the finest.
    pub fn highest_level(&self) -> u32 {
        self.ggx.texture.mip_level_count() - 1
    }

    /// Uploads a map. Where `phong` is requested of a map that was not filtered for it yet, GGX
    /// lobes of the same widths take its place.
    pub fn write(&mut self, device: &Device, queue: &wgpu::Queue, map: &CubeMap, phong: bool) {
        let levels = map.levels.len().max(1) as u32;
        if !self.ggx.fits(map.size, levels) {
            self.ggx = Cube::new(device, map.size, levels);
        }
        let (size, phong_levels) = if phong { (map.size, levels) } else { (1, 1) };
        if !self.phong.fits(size, phong_levels) {
            self.phong = Cube::new(device, size, phong_levels);
        }
        self.upload(queue, map, phong);
        let sources = CompactSourcesUniform::new(&map.compact_sources);
        queue.write_buffer(&self.compact_sources, 0, bytemuck::bytes_of(&sources));
        let wanted = (map.filtering, map.size, map.levels.len());
        if self.tabled != Some(wanted) {
            self.write_table(queue, wanted);
            self.tabled = Some(wanted);
        }
    }

    fn upload(&mut self, queue: &wgpu::Queue, map: &CubeMap, phong: bool) {
        let texels = &mut self.texels;
        let mut write = |cube: &Cube, level: usize, from: &[[f32; 3]]| {
            let size = (map.size >> level).max(1);
            let (texels, level) = (texels.converted(from), level as u32);
            write_level(queue, &cube.texture, level, size, 6, texels);
        };
        for (level, from) in map.levels.iter().enumerate() {
            write(&self.ggx, level, from);
        }
        // Level 0 is the map itself for both families.
        for (level, ggx) in map.levels.iter().enumerate().filter(|_| phong) {
            let own = level.checked_sub(1).and_then(|k| map.phong.get(k));
            write(&self.phong, level, own.unwrap_or(ggx));
        }
    }

    fn write_table(&self, queue: &wgpu::Queue, wanted: Tabled) {
        let texels = table(wanted);
        queue.write_texture(
            self.table_texture.as_image_copy(),
            bytemuck::cast_slice(&texels),
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(8 * COLUMNS),
                rows_per_image: Some(ROWS * BLOCKS),
            },
            self.table_texture.size(),
        );
    }
}

/// Filtering, texels along a side and levels of a map.
type Tabled = (Filtering, u32, usize);
type Table = Arc<Vec<[f16; 4]>>;

/// The table for a map. Kept, because it takes tens of milliseconds and rigs have few kinds of maps.
fn table(wanted: Tabled) -> Table {
    const MAX_TABLES: usize = 16;
    static TABLES: Mutex<Vec<(Tabled, Table)>> = Mutex::new(Vec::new());
    let mut tables = TABLES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, known)) = tables.iter().find(|(of, _)| *of == wanted) {
        return Arc::clone(known);
    }
    let table = Arc::new(computed_table(wanted));
    if tables.len() == MAX_TABLES {
        tables.remove(0);
    }
    tables.push((wanted, Arc::clone(&table)));
    table
}

fn computed_table((filtering, size, levels): Tabled) -> Vec<[f16; 4]> {
    let mut texels = Vec::with_capacity((COLUMNS * ROWS * BLOCKS) as usize);
    for (family, responses) in FAMILIES.iter().zip(RESPONSES.iter()) {
        let ladder = Levels::new(*family, size, levels);
        for (i, response) in responses.iter().enumerate() {
            let [scale, bias, tilt, width] = *response;
            let row = parameter(i as u32 / COLUMNS);
            let entry = match (filtering, family) {
                (Filtering::Prefiltered, _) => [scale, bias, tilt, ladder.level(width)],
                (Filtering::Box, Family::Ggx) => {
                    [scale, bias, 0.0, box_level(*family, row, size, levels)]
                }
                // Supan 2006 multiplies the map by the colour of the material alone.
                (Filtering::Box, Family::Phong) => {
                    [1.0, 0.0, 0.0, box_level(*family, row, size, levels)]
                }
            };
            texels.push(entry.map(f16::from_f32));
        }
    }
    let ladder = Levels::new(Family::Ggx, size, levels);
    let narrowest = widths(size, levels).next();
    texels.extend((0..COLUMNS * ROWS).map(|i| {
        let alpha = own_width(Family::Ggx, parameter(i / COLUMNS));
        // Supan 2006 has round lobes.
        let narrowest = narrowest.filter(|_| filtering == Filtering::Prefiltered);
        let long = LongLobe::of(n_dot_v(i), alpha, narrowest.unwrap_or(1.0));
        [ladder.level(long.width), long.share, long.step, 0.0].map(f16::from_f32)
    }));
    texels
}

/// n·v at the middle of a texel's column.
fn n_dot_v(texel: u32) -> f32 {
    ((texel % COLUMNS) as f32 + 0.5) / COLUMNS as f32
}

/// The parameter at the middle of a row.
fn parameter(row: u32) -> f32 {
    (row as f32 + 0.5) / ROWS as f32
}

/// Scale, bias, tilt and width of both families, row by row. Computed once per process, because it
/// takes tens of milliseconds.
static RESPONSES: LazyLock<[Vec<[f32; 4]>; 2]> = LazyLock::new(|| {
    FAMILIES.map(|family| {
        (0..COLUMNS * ROWS)
            .map(|i| {
                let r = family.response(n_dot_v(i), parameter(i / COLUMNS));
                [r.scale, r.bias, r.tilt, r.width]
            })
            .collect()
    })
});
