//! A lens that bends straight lines.
//!
//! Graphics hardware draws straight triangles. So a bent picture is straightened, everything
//! is composed in the straight one, and what was changed is bent back into the camera's own
//! picture: each pixel of that looks up where it lies in the straight one, exactly by the
//! camera's model, whatever the triangles' size. Pixels that nothing virtual changes stay the
//! camera's, bit for bit. A camera without distortion has no such stage.

use super::Compositor;
use super::bindings::{PipelineSpec, Slot, group, layout, view};
use super::passes::cover;
use super::shaders::{self, Variant};
use super::targets::{Target, Targets, format};
use super::timing::Timer;
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_picture::Picture;
use wgpu::TextureUsages as U;

/// The straight picture is at most so many times the camera's, each way: a lens that bends
/// more shows the camera's picture alone in its corners.
const LARGEST: f64 = 2.0;
/// Finest scale of the straight picture, for lenses that magnify towards the corners.
const FINEST: f64 = 1.5;
/// A pixel that the model cannot be inverted at lies here: nowhere.
const NOWHERE: [f32; 2] = [-1e6, -1e6];
/// Pixels by which an inverted model may miss.
const INVERTED: f64 = 0.01;

/// How the picture of a lens that bends comes out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LensOutput {
    /// Bent, like the camera's: what nothing virtual touches is its own, bit for bit.
    #[default]
    Camera,
    /// Straight, with the camera's focal length and size; corners are cut or stretched.
    Undistorted,
}

/// What straightens and bends pictures of one camera.
pub(super) struct LensStage {
    /// The camera that bends.
    pub camera: PinholeCamera,
    wanted: LensOutput,
    /// The camera of the straight picture.
    pub straight: PinholeCamera,
    /// Squared tangent of the farthest direction that the bent picture shows.
    pub reach: f64,
    /// A picture of its size, without pixels.
    pub blank: Picture,
    /// What is uploaded.
    pub raw: Target,
    straighten: (wgpu::RenderPipeline, wgpu::BindGroup),
    bend: Option<Bend>,
}

struct Bend {
    /// In the camera's exposure, and in another.
    pipelines: [wgpu::RenderPipeline; 2],
    layout: wgpu::BindGroupLayout,
    inputs: wgpu::BindGroup,
    output: Target,
}

impl LensStage {
    /// For pictures of `camera`, or `None` where it does not bend.
    pub fn new(
        gpu: (&wgpu::Device, &wgpu::Queue),
        camera: &PinholeCamera,
        wanted: LensOutput,
        variant: Variant,
    ) -> Option<Self> {
        if camera.distortion == [0.0; 5] {
            return None;
        }
        let straight = match wanted {
            LensOutput::Camera => straight_camera(camera),
            LensOutput::Undistorted => PinholeCamera {
                distortion: [0.0; 5],
                ..camera.clone()
            },
        };
        let (device, _) = gpu;
        let module = shaders::module(device, "lens", variant);
        let uploaded = U::COPY_DST | U::TEXTURE_BINDING;
        let size = (camera.width, camera.height);
        let raw = Target::new(device, "bent camera", size, format::CAMERA, uploaded);
        let places = upload(gpu, &straight, |pixel| bent_place(camera, &straight, pixel));
        let slots = [Slot::Unfilterable; 2];
        let inputs = layout(device, "straighten", &slots);
        let bound = [view(&raw.view), view(&places.view)];
        let bound = group(device, "straighten", &inputs, &bound);
        let pipeline = pipeline(device, &module, &[&inputs], "straightened");
        let bend = (wanted == LensOutput::Camera).then(|| {
            let place = |pixel| straight_place(camera, &straight, pixel);
            let places = upload(gpu, camera, place);
            let bound = [view(&raw.view), view(&places.view)];
            let bound = group(device, "bend camera", &inputs, &bound);
            Bend::new(device, &module, (&inputs, bound), (size, variant))
        });
        Some(Self {
            camera: camera.clone(),
            wanted,
            reach: reach(camera),
            blank: Picture {
                width: straight.width,
                height: straight.height,
                rgba: Vec::new(),
            },
            straight,
            raw,
            straighten: (pipeline, bound),
            bend,
        })
    }

    /// Whether it was made for this.
    pub fn suits(&self, camera: &PinholeCamera, wanted: LensOutput) -> bool {
        self.camera == *camera && self.wanted == wanted
    }

    /// What comes out, where that is not the straight picture.
    pub fn output(&self) -> Option<&Target> {
        self.bend.as_ref().map(|bend| &bend.output)
    }

    /// Size of what comes out, pixels.
    pub const fn size(&self) -> (u32, u32) {
        (self.camera.width, self.camera.height)
    }

    /// Binds the straight picture's textures.
    pub fn bind(&self, device: &wgpu::Device, t: &Targets) -> Option<wgpu::BindGroup> {
        let bend = self.bend.as_ref()?;
        let bound = [
            view(&t.camera.view),
            t.codes.as_entire_binding(),
            view(&t.output.view),
            view(&t.virtual_surface[0].view),
        ];
        Some(group(device, "bend", &bend.layout, &bound))
    }

    /// Records the way in: the straight picture becomes the compositor's.
    pub fn record_in(&self, encoder: &mut wgpu::CommandEncoder, timer: &mut Timer, t: &Targets) {
        let (pipeline, inputs) = &self.straighten;
        let span = timer.span("straighten", true, true);
        let to = &t.camera.view;
        cover(encoder, "straighten", to, span, pipeline, &[inputs]);
    }

    /// Records the way out.
    pub fn record_out(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        inputs: Option<&wgpu::BindGroup>,
        exposed: bool,
    ) {
        if let (Some(bend), Some(inputs)) = (&self.bend, inputs) {
            let pipeline = &bend.pipelines[usize::from(exposed)];
            let span = timer.span("bend", true, true);
            let to = &bend.output.view;
            cover(encoder, "bend", to, span, pipeline, &[&bend.inputs, inputs]);
        }
    }
}

impl Bend {
    fn new(
        device: &wgpu::Device,
        module: &wgpu::ShaderModule,
        (camera, inputs): (&wgpu::BindGroupLayout, wgpu::BindGroup),
        (size, variant): ((u32, u32), Variant),
    ) -> Self {
        let (shape, _) = Slot::sampled(variant.samples);
        let f = Slot::Unfilterable;
        let layout = layout(device, "bend", &[f, Slot::Uniform, f, shape]);
        let usage = U::RENDER_ATTACHMENT | U::TEXTURE_BINDING | U::COPY_SRC;
        Self {
            pipelines: ["bent", "bent_exposed"]
                .map(|entry| pipeline(device, module, &[camera, &layout], entry)),
            output: Target::new(device, "bent output", size, format::OUTPUT, usage),
            layout,
            inputs,
        }
    }
}

impl Compositor {
    /// Chooses how pictures of a lens that bends come out.
    pub fn set_lens_output(&mut self, wanted: LensOutput) {
        self.lens_output = wanted;
    }

    /// Makes the stage anew for another camera.
    pub(super) fn fit_lens(&mut self, camera: &PinholeCamera) {
        let wanted = self.lens_output;
        let bends = camera.distortion != [0.0; 5];
        let suits = self.lens.as_ref().map(|lens| lens.suits(camera, wanted));
        if suits.unwrap_or(!bends) {
            return;
        }
        let gpu = (&self.gpu.device, &self.gpu.queue);
        self.lens = LensStage::new(gpu, camera, wanted, self.variant).map(Into::into);
        // The straight picture may have another size.
        self.sized = None;
    }
}

fn pipeline(
    device: &wgpu::Device,
    module: &wgpu::ShaderModule,
    groups: &[&wgpu::BindGroupLayout],
    entry: &str,
) -> wgpu::RenderPipeline {
    PipelineSpec {
        label: entry,
        module,
        groups,
        vertex: "cover",
        buffers: &[],
        fragment: Some(entry),
        targets: &[format::OUTPUT],
        colours: wgpu::ColorWrites::ALL,
        depth: None,
        cull: None,
        samples: 1,
    }
    .build(device)
}

/// A texture of `camera`'s size with the place that `place` gives for each pixel.
fn upload(
    (device, queue): (&wgpu::Device, &wgpu::Queue),
    camera: &PinholeCamera,
    place: impl Fn(DVec2) -> [f32; 2],
) -> Target {
    let size = (camera.width, camera.height);
    let usage = U::COPY_DST | U::TEXTURE_BINDING;
    let target = Target::new(
        device,
        "places",
        size,
        wgpu::TextureFormat::Rg32Float,
        usage,
    );
    let (rows, columns) = (0..camera.height, camera.width);
    let pixels = rows.flat_map(|y| (0..columns).map(move |x| (f64::from(x), f64::from(y))));
    let places: Vec<[f32; 2]> = pixels.map(|(x, y)| place(DVec2::new(x, y))).collect();
    queue.write_texture(
        target.texture.as_image_copy(),
        bytemuck::cast_slice(&places),
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(8 * camera.width),
            rows_per_image: None,
        },
        target.texture.size(),
    );
    target
}

/// Where a pixel of the straight picture lies in the bent one.
fn bent_place(camera: &PinholeCamera, straight: &PinholeCamera, pixel: DVec2) -> [f32; 2] {
    let ray = ((pixel - straight.centre) / straight.focal).extend(1.0);
    let place = camera.project(ray).unwrap_or(DVec2::ZERO);
    // Far outside a polynomial model runs away; the edge is as good.
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    place.clamp(-size, 2.0 * size).as_vec2().to_array()
}

/// Where a pixel of the bent picture lies in the straight one.
fn straight_place(camera: &PinholeCamera, straight: &PinholeCamera, pixel: DVec2) -> [f32; 2] {
    ideal(camera, pixel).map_or(NOWHERE, |p| {
        (p * straight.focal + straight.centre).as_vec2().to_array()
    })
}

/// The undistorted point, on the plane z = 1, that a pixel shows: Newton's method from the
/// fixed-point answer, which strong lenses slow down. `None` past the model's fold.
fn ideal(camera: &PinholeCamera, pixel: DVec2) -> Option<DVec2> {
    const STEP: f64 = 1e-6;
    let shown = |p: DVec2| camera.project(p.extend(1.0));
    let ray: DVec3 = camera.unproject(pixel);
    let mut p = ray.truncate() / ray.z;
    if !p.is_finite() {
        p = (pixel - camera.centre) / camera.focal;
    }
    for _ in 0..8 {
        let off = pixel - shown(p)?;
        let across = (shown(p + DVec2::X * STEP)? - shown(p - DVec2::X * STEP)?) / (2.0 * STEP);
        let down = (shown(p + DVec2::Y * STEP)? - shown(p - DVec2::Y * STEP)?) / (2.0 * STEP);
        let determinant = across.perp_dot(down);
        // Turned inside out: past the fold.
        if determinant <= 0.0 {
            return None;
        }
        if off.length_squared() < 1e-12 {
            break;
        }
        p += DVec2::new(off.perp_dot(down), across.perp_dot(off)) / determinant;
    }
    let there = shown(p)?.distance(pixel) < INVERTED && p.is_finite();
    there.then_some(p)
}

/// Points of a grid over the whole picture, its edges included.
fn probes(camera: &PinholeCamera) -> impl Iterator<Item = DVec2> {
    const PROBES: u32 = 24;
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let share = |i: u32| f64::from(i) / f64::from(PROBES);
    let grid = (0..=PROBES).flat_map(|y| (0..=PROBES).map(move |x| (x, y)));
    grid.map(move |(x, y)| DVec2::new(share(x), share(y)) * size - 0.5)
}

/// The direction that each pixel of a camera shows, on the plane z = 1.
pub(super) fn direction_places(
    gpu: (&wgpu::Device, &wgpu::Queue),
    camera: &PinholeCamera,
) -> Target {
    upload(gpu, camera, |pixel| {
        ideal(camera, pixel).map_or(NOWHERE, |p| p.as_vec2().to_array())
    })
}

/// Squared tangent of the farthest direction that a picture shows: past it the model may fold.
pub(super) fn reach(camera: &PinholeCamera) -> f64 {
    let shown = probes(camera).filter_map(|pixel| ideal(camera, pixel));
    shown.map(DVec2::length_squared).fold(1e-6, f64::max)
}

/// The camera of a straight picture that shows all that `camera` does, as finely.
fn straight_camera(camera: &PinholeCamera) -> PinholeCamera {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let (mut low, mut high, mut finest) = (DVec2::ZERO, DVec2::ZERO, 1.0_f64);
    for pixel in probes(camera) {
        let Some(p) = ideal(camera, pixel) else {
            continue;
        };
        (low, high) = (low.min(p), high.max(p));
        let shown = |p: DVec2| camera.project(p.extend(1.0)).unwrap_or_default();
        let across = shown(p + DVec2::X * 1e-4) - shown(p - DVec2::X * 1e-4);
        let scale = across.length() / (2e-4 * camera.focal.x);
        finest = finest.max(scale);
    }
    let focal = camera.focal * finest.min(FINEST);
    let axis = |low: f64, high: f64, focal: f64, most: f64| {
        let (low, high) = ((low * focal).floor() - 2.0, (high * focal).ceil() + 2.0);
        let cut = (high - low + 1.0 - most).max(0.0) * 0.5;
        let (low, high) = ((low + cut).ceil(), (high - cut).floor());
        (-low, (high - low + 1.0) as u32)
    };
    let (x, width) = axis(low.x, high.x, focal.x, size.x * LARGEST);
    let (y, height) = axis(low.y, high.y, focal.y, size.y * LARGEST);
    PinholeCamera {
        width,
        height,
        focal,
        centre: DVec2::new(x, y),
        distortion: [0.0; 5],
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn lens(distortion: [f64; 5]) -> PinholeCamera {
        PinholeCamera {
            width: 640,
            height: 480,
            focal: DVec2::new(400.0, 402.0),
            centre: DVec2::new(322.3, 237.1),
            distortion,
        }
    }

    #[test]
    fn every_pixel_of_a_strong_lens_is_found_in_the_straight_picture() {
        let strong = [
            [-0.32, 0.12, 0.001, -0.0008, -0.02],
            [0.25, -0.05, -0.002, 0.001, 0.0],
            [-0.4, 0.25, 0.0, 0.0, -0.04],
        ];
        for camera in strong.map(lens) {
            let straight = straight_camera(&camera);
            for (x, y) in [
                (0.0, 0.0),
                (639.0, 0.0),
                (639.0, 479.0),
                (0.0, 479.0),
                (320.0, 240.0),
            ] {
                let pixel = DVec2::new(x, y);
                let p = ideal(&camera, pixel).unwrap();
                assert!(camera.project(p.extend(1.0)).unwrap().distance(pixel) < 1e-5);
                let there = straight.project(p.extend(1.0)).unwrap();
                let size = DVec2::new(f64::from(straight.width), f64::from(straight.height));
                assert!(
                    there.cmpge(DVec2::ZERO).all() && there.cmplt(size).all(),
                    "{there}"
                );
            }
        }
    }

    #[test]
    fn what_lies_past_the_fold_lies_nowhere() {
        // Its radius never grows past 0.67 (268 pixels); the corners lie at 400.
        let camera = lens([-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(ideal(&camera, DVec2::new(0.0, 0.0)).is_none());
        assert!(ideal(&camera, DVec2::new(322.0, 100.0)).is_some());
        let straight = straight_camera(&camera);
        assert!(straight.width <= 1280 && straight.height <= 960);
    }
}
