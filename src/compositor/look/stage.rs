//! The passes of the look. Nothing is compiled or allocated before a frame asks for a look.

use super::super::bindings::{CachedGroup, DepthTest, PipelineSpec, Slot, sampler, view};
use super::super::compiled::Device;
use super::super::recorder::{Recorder, bind_all, cleared, colour, depth};
use super::super::response_table::ResponseTable;
use super::super::shaders::{self, LookVariant};
use super::super::textures::{DRAWN, FrameTexture, format, tile_grid};
use super::blur_field::BlurField;
use super::grain::{self, SIDE};
use super::input::Look;
use super::uniform::{LookUniform, TAPS, filtered_class};
use penumbra_camera::NoiseTexture;
use wgpu::{CompareFunction as Compare, TextureFormat as F, TextureUsages as U};

/// The passes for pictures of one size.
pub struct LookStage {
    variant: LookVariant,
    size: (u32, u32),
    passes: Passes,
    pictures: Pictures,
    uniform: wgpu::Buffer,
    smooth: wgpu::Sampler,
    /// Correlation of the noise that was uploaded last.
    grain: NoiseTexture,
    /// Index in [`TAPS`] of the blur of this frame; `None` without a visible one.
    blurred: Option<usize>,
    /// Whether there may be tiles whose layers are not filtered.
    shades: bool,
}

/// A pipeline, and the group of its inputs.
type Pass = (wgpu::RenderPipeline, CachedGroup);

struct Passes {
    shared: CachedGroup,
    tiles: Pass,
    /// Pixels of each kind, or all at once where the depth buffer does not hold their kinds.
    layers: (Vec<wgpu::RenderPipeline>, CachedGroup),
    /// One pipeline for each number of [`TAPS`], compiled when it is first needed.
    blur: ([Option<wgpu::RenderPipeline>; TAPS.len()], CachedGroup),
    spread: Option<Pass>,
    /// Noise of shadows in tiles that are not filtered.
    shade: Pass,
    finish: Pass,
}

struct Pictures {
    marked: FrameTexture,
    /// Two sets of both layers.
    layers: [[FrameTexture; 2]; 2],
    /// The composed picture, where noise is added in place.
    composed: FrameTexture,
    field: FrameTexture,
    grain: FrameTexture,
}

/// The pictures that the passes read.
pub struct LookInputs<'a> {
    /// The real picture of the frame, with the distortion of the finished picture.
    pub real: &'a FrameTexture,
    pub codes: &'a ResponseTable,
    /// Shape of the virtual surfaces.
    pub shape: &'a FrameTexture,
    /// Tiles with shadows, and with virtual surfaces.
    pub tiles: [&'a FrameTexture; 2],
    /// Kinds of the pixels as depths, for a lens without distortion.
    pub kinds: Option<&'a FrameTexture>,
    /// Positions of the pixels in the undistorted picture, for a lens with distortion.
    pub positions: Option<&'a FrameTexture>,
}

impl Passes {
    fn new(device: &Device, variant: LookVariant) -> Self {
        let (f, i) = (Slot::Unfilterable, Slot::Integer);
        let (packed, _) = Slot::sampled(variant.samples);
        let group = |label, slots: &[Slot]| CachedGroup::from_slots(device, label, slots);
        let shared = group("look", &[Slot::Uniform, i]);
        let pass = |entry, inputs: CachedGroup, targets: &[wgpu::TextureFormat]| {
            let groups = [&shared, &inputs];
            let built = pipeline(device, entry, &groups, targets, variant);
            (built, inputs)
        };
        let tiles = group("look tiles", &[i, i, f]);
        let mark = pipeline(device, "mark", &[&tiles], &[format::COVERED], variant);
        let layers = group("look layers", &[f, Slot::Uniform, f, packed]);
        let slots = [f, Slot::Uniform, f, f, f];
        let [finish, shaded] = ["look finish", "look shade"].map(|label| group(label, &slots));
        let kinds: &[&str] = if variant.distorted {
            &["layers"]
        } else {
            &["open", "inside", "outline"]
        };
        let drawn = |entry: &&str| pipeline(device, entry, &[&shared, &layers], &LAYERS, variant);
        let kinds = kinds.iter().map(drawn).collect();
        let blur = [Slot::Texture, Slot::Texture, Slot::Sampler, f];
        Self {
            tiles: (mark, tiles),
            layers: (kinds, layers),
            blur: ([const { None }; TAPS.len()], group("look blur", &blur)),
            spread: variant
                .spread
                .then(|| pass("spread", group("look spread", &[f, f]), &LAYERS)),
            shade: pass("shade", shaded, &[format::OUTPUT]),
            finish: pass("finish", finish, &[format::OUTPUT]),
            shared,
        }
    }
}

impl Pictures {
    fn new(device: &Device, size: (u32, u32), cells: (u32, u32)) -> Self {
        let picture =
            |label, size, format, usage| FrameTexture::new(device, label, size, format, usage);
        let layer = |label| picture(label, size, format::LIGHT, DRAWN);
        let uploaded = U::COPY_DST | U::TEXTURE_BINDING;
        let side = (SIDE as u32, SIDE as u32);
        Self {
            marked: picture("look tiles", tile_grid(size), format::COVERED, DRAWN),
            layers: [
                ["surface", "change"],
                ["filtered surface", "filtered change"],
            ]
            .map(|set| set.map(layer)),
            composed: picture("composed", size, format::OUTPUT, uploaded),
            field: picture("blur field", cells, F::Rgba32Float, uploaded),
            grain: picture("grain", side, F::Rgba8Snorm, uploaded),
        }
    }
}

impl LookStage {
    /// Compiles the passes for pictures of `size`; `cells` is the size of the blur field.
    pub fn new(
        (device, queue): (&Device, &wgpu::Queue),
        size: (u32, u32),
        cells: (u32, u32),
        variant: LookVariant,
    ) -> Self {
        let pictures = Pictures::new(device, size, cells);
        upload_grain(queue, &pictures.grain, &NoiseTexture::WHITE);
        let linear = wgpu::FilterMode::Linear;
        Self {
            variant,
            size,
            passes: Passes::new(device, variant),
            pictures,
            uniform: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("look"),
                size: size_of::<LookUniform>() as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            }),
            smooth: device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("look"),
                mag_filter: linear,
                min_filter: linear,
                ..Default::default()
            }),
            grain: NoiseTexture::WHITE,
            blurred: None,
            shades: false,
        }
    }

    /// Whether the stage was made for pictures of this size and for this variant.
    pub fn suits(&self, size: (u32, u32), variant: LookVariant) -> bool {
        self.size == size && self.variant == variant
    }

    /// Compiles the blurs of all lengths, so that faster motion later keeps no frame waiting.
    pub fn compile_blurs(&mut self, device: &Device) {
        for k in 0..TAPS.len() {
            self.passes.compile_blur(device, k, self.variant);
        }
    }

    /// Uploads the look of the next frame: `field` has blurs of up to `extent` pixels; `factor` is
    /// that of the exposure.
    pub fn upload(
        &mut self,
        (device, queue): (&Device, &wgpu::Queue),
        look: &Look,
        (field, extent): (&BlurField, f64),
        factor: f32,
    ) {
        self.blurred = (extent > 0.0)
            .then(|| TAPS.iter().position(|(most, _)| extent <= *most))
            .flatten();
        if self.blurred.is_some() {
            let cells = bytemuck::cast_slice(field.cells());
            self.pictures.field.upload(queue, cells, 16);
            self.compile_blurs(device);
        }
        if let Some(noise) = &look.noise
            && noise.texture != self.grain
        {
            upload_grain(queue, &self.pictures.grain, &noise.texture);
            self.grain = noise.texture;
        }
        self.shades = filtered_class(extent) > 1;
        let taps = self.blurred.map_or(1, |k| TAPS[k].1);
        let uniform = LookUniform::new(look, self.size, (extent, taps), factor);
        queue.write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
    }

    /// Draws the look over the composed picture.
    pub fn record(
        &mut self,
        r: &mut Recorder<'_>,
        inputs: &LookInputs<'_>,
        picture: &FrameTexture,
    ) {
        self.mark(r, inputs);
        let shared = [
            self.uniform.as_entire_binding(),
            view(&self.pictures.marked.view),
        ];
        let shared = self.passes.shared.get(r.device, &shared).clone();
        let resources = [
            view(&inputs.real.view),
            inputs.codes.binding(),
            view(&picture.view),
            view(&inputs.shape.view),
        ];
        let tiles = self.vertices();
        let [from, to] = &self.pictures.layers.clone();
        let (pipelines, group) = &mut self.passes.layers;
        let groups = [&shared, group.get(r.device, &resources)];
        draw_kinds(r, pipelines, &groups, (targets(from), inputs.kinds), tiles);
        self.shade(r, inputs, &shared, picture);
        let filtered = self.passes.filter(
            r,
            (&shared, tiles),
            [from, to],
            (self.blurred, &self.smooth, &self.pictures),
        );
        let resources = [
            view(&inputs.real.view),
            inputs.codes.binding(),
            view(&filtered[0].view),
            view(&filtered[1].view),
            view(&self.pictures.grain.view),
        ];
        let (pipeline, group) = &mut self.passes.finish;
        let groups = [&shared, group.get(r.device, &resources)];
        let target = [colour(&picture.view, wgpu::LoadOp::Load)];
        draw(r, "look_finish", pipeline, &groups, target, tiles);
    }

    /// Adds the noise of shadows in tiles that are not filtered.
    fn shade(
        &mut self,
        r: &mut Recorder<'_>,
        inputs: &LookInputs<'_>,
        shared: &wgpu::BindGroup,
        picture: &FrameTexture,
    ) {
        if !self.variant.grain || !self.shades {
            return;
        }
        let (composed, vertices) = (&self.pictures.composed, self.vertices());
        r.encoder.copy_texture_to_texture(
            picture.texture.as_image_copy(),
            composed.texture.as_image_copy(),
            composed.texture.size(),
        );
        let resources = [
            view(&inputs.real.view),
            inputs.codes.binding(),
            view(&composed.view),
            view(&composed.view),
            view(&self.pictures.grain.view),
        ];
        let (pipeline, group) = &mut self.passes.shade;
        let target = [colour(&picture.view, wgpu::LoadOp::Load)];
        let groups = [shared, group.get(r.device, &resources)];
        draw(r, "look_shade", pipeline, &groups, target, vertices);
    }

    /// Vertices of all tiles.
    fn vertices(&self) -> u32 {
        let (across, down) = tile_grid(self.size);
        6 * across * down
    }

    /// Marks the tiles of the finished picture that were changed.
    fn mark(&mut self, r: &mut Recorder<'_>, inputs: &LookInputs<'_>) {
        let [shadowed, covered] = inputs.tiles;
        // Without distortion any texture takes the place of the positions.
        let positions = inputs.positions.unwrap_or(inputs.real);
        let resources = [&shadowed.view, &covered.view, &positions.view].map(view);
        let (pipeline, group) = &mut self.passes.tiles;
        let groups = [group.get(r.device, &resources)];
        let target = [cleared(&self.pictures.marked.view)];
        draw(r, "look_tiles", pipeline, &groups, target, 3);
    }
}

impl Passes {
    fn compile_blur(&mut self, device: &Device, k: usize, variant: LookVariant) {
        let (pipelines, inputs) = &mut self.blur;
        let groups = [&self.shared, inputs];
        let (_, taps) = TAPS[k];
        let variant = LookVariant { taps, ..variant };
        pipelines[k].get_or_insert_with(|| pipeline(device, "blur", &groups, &LAYERS, variant));
    }

    /// Draws blur and spread from one set of layers into the other; returns the set with the result.
    fn filter<'a>(
        &mut self,
        r: &mut Recorder<'_>,
        (shared, tiles): (&wgpu::BindGroup, u32),
        [mut from, mut to]: [&'a [FrameTexture; 2]; 2],
        (blurred, smooth, pictures): (Option<usize>, &wgpu::Sampler, &Pictures),
    ) -> &'a [FrameTexture; 2] {
        if let Some(pipeline) = blurred.and_then(|k| self.blur.0[k].as_ref()) {
            let resources = [
                view(&from[0].view),
                view(&from[1].view),
                sampler(smooth),
                view(&pictures.field.view),
            ];
            let groups = [shared, self.blur.1.get(r.device, &resources)];
            draw(r, "look_blur", pipeline, &groups, targets(to), tiles);
            (from, to) = (to, from);
        }
        if let Some((pipeline, group)) = &mut self.spread {
            let resources = [view(&from[0].view), view(&from[1].view)];
            let groups = [shared, group.get(r.device, &resources)];
            draw(r, "look_spread", pipeline, &groups, targets(to), tiles);
            from = to;
        }
        from
    }
}

/// Targets of passes that draw both layers.
const LAYERS: [wgpu::TextureFormat; 2] = [format::LIGHT; 2];

/// Tiles that are not drawn are not read, so that nothing need be cleared.
fn targets(to: &[FrameTexture; 2]) -> [Option<wgpu::RenderPassColorAttachment<'_>>; 2] {
    [
        colour(&to[0].view, wgpu::LoadOp::Load),
        colour(&to[1].view, wgpu::LoadOp::Load),
    ]
}

fn draw<const N: usize>(
    r: &mut Recorder<'_>,
    label: &'static str,
    pipeline: &wgpu::RenderPipeline,
    groups: &[&wgpu::BindGroup],
    targets: [Option<wgpu::RenderPassColorAttachment<'_>>; N],
    vertices: u32,
) {
    let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments: &targets,
        timestamp_writes: r.timer.span(label, true, true),
        ..Default::default()
    });
    pass.set_pipeline(pipeline);
    bind_all(&mut pass, groups);
    pass.draw(0..vertices, 0..1);
}

/// Draws the layers by one pipeline for each kind of pixels; the kinds are in a depth buffer.
fn draw_kinds(
    r: &mut Recorder<'_>,
    pipelines: &[wgpu::RenderPipeline],
    groups: &[&wgpu::BindGroup],
    (targets, kinds): (
        [Option<wgpu::RenderPassColorAttachment<'_>>; 2],
        Option<&FrameTexture>,
    ),
    vertices: u32,
) {
    let kinds = kinds.and_then(|kinds| depth(&kinds.view, wgpu::LoadOp::Load));
    let mut pass = r.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("look_layers"),
        color_attachments: &targets,
        depth_stencil_attachment: kinds,
        timestamp_writes: r.timer.span("look_layers", true, true),
        ..Default::default()
    });
    bind_all(&mut pass, groups);
    for pipeline in pipelines {
        pass.set_pipeline(pipeline);
        pass.draw(0..vertices, 0..1);
    }
}

fn pipeline(
    device: &Device,
    entry: &str,
    groups: &[&CachedGroup],
    targets: &[wgpu::TextureFormat],
    variant: LookVariant,
) -> wgpu::RenderPipeline {
    let file = match entry {
        "mark" => "tiles",
        "shade" => "finish",
        "open" | "inside" | "outline" => "layers",
        other => other,
    };
    let name = format!("look_{file}");
    let shader = shaders::look_shader(&name, variant);
    let layouts: Vec<_> = groups.iter().map(|g| &g.layout).collect();
    let vertex = match entry {
        "mark" => "cover".to_owned(),
        "outline" => "layers_tile".to_owned(),
        other => format!("{other}_tile"),
    };
    let compare = match entry {
        "open" => Some(Compare::Equal),
        "inside" => Some(Compare::Less),
        "outline" => Some(Compare::Greater),
        _ => None,
    };
    PipelineSpec {
        label: &name,
        shader: &shader,
        groups: &layouts,
        vertex: &vertex,
        buffers: &[],
        fragment: Some(if entry == "outline" { "layers" } else { entry }),
        targets,
        colours: wgpu::ColorWrites::ALL,
        depth: compare.map(DepthTest::without_writing),
        cull: None,
        samples: 1,
    }
    .build(device)
}

fn upload_grain(queue: &wgpu::Queue, target: &FrameTexture, texture: &NoiseTexture) {
    let codes = grain::codes(texture);
    target.upload(queue, bytemuck::cast_slice(&codes), 4);
}
