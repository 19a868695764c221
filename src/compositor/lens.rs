//! Lens distortion.
//!
//! Graphics hardware draws straight triangles. The picture of a camera with distortion is therefore
//! undistorted, the frame is composed in the undistorted picture, and its changes are distorted
//! back into the camera picture: each pixel of the camera picture looks up its position in the
//! undistorted picture, exactly by the camera model, independently of the size of the triangles.
//! Pixels without virtual changes stay the camera's, bit for bit. A camera without distortion has
//! no such stage.

use super::bindings::{CachedGroup, PipelineSpec, Slot, group, layout, view};
use super::compiled::{Device, Shader};
use super::passes::shadow_buffer::Surfaces;
use super::recorder::Recorder;
use super::response_table::RealPicture;
use super::shaders::{self, Variant};
use super::textures::{FrameTexture, format};
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use wgpu::TextureUsages as U;

/// Maximum ratio of the size of the undistorted picture to the camera picture, each way: a lens
/// with more distortion shows the camera picture alone in its corners.
const MAX_SIZE_RATIO: f64 = 2.0;
/// Maximum scale of the undistorted picture, for lenses that magnify towards the corners.
const MAX_SCALE: f64 = 1.5;
/// The position of pixels at which the lens model cannot be inverted.
const NO_POSITION: [f32; 2] = [-1e6, -1e6];
/// Maximum error of an inverted lens model, pixels.
const MAX_INVERSION_ERROR_PIXELS: f64 = 0.01;

/// The form in which the picture of a lens with distortion is returned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LensOutput {
    /// Distorted like the camera picture: pixels without virtual changes are the camera's, bit for
    /// bit.
    #[default]
    Camera,
    /// Undistorted, with the camera's focal length and size; corners are cut or stretched.
    Undistorted,
}

/// Undistorts and distorts the pictures of one camera.
pub(super) struct LensStage {
    /// The camera with distortion.
    camera: PinholeCamera,
    output: LensOutput,
    /// Whether the distorted picture holds in alpha how much of a pixel virtual surfaces leave open.
    coverage: bool,
    /// The camera of the undistorted picture.
    pub undistorted: PinholeCamera,
    /// Squared tangent of the direction farthest from the axis that the camera picture shows.
    pub reach: f64,
    /// The camera picture as it is uploaded.
    pub raw: FrameTexture,
    undistort: (wgpu::RenderPipeline, wgpu::BindGroup),
    distort: Option<Distort>,
}

/// The pass that distorts the composed picture back into the camera picture.
struct Distort {
    /// Pipelines for the camera's exposure, and for another.
    pipelines: [wgpu::RenderPipeline; 2],
    /// The position of each pixel in the undistorted picture.
    position_texture: FrameTexture,
    /// The raw picture and the positions of its pixels in the undistorted one.
    positions: wgpu::BindGroup,
    /// The undistorted pictures.
    undistorted: CachedGroup,
    output: FrameTexture,
}

impl LensStage {
    /// The stage of `camera`, or `None` if it has no distortion.
    pub fn new(
        gpu: (&Device, &wgpu::Queue),
        camera: &PinholeCamera,
        (output, coverage): (LensOutput, bool),
        variant: Variant,
    ) -> Option<Self> {
        if camera.distortion == [0.0; 5] {
            return None;
        }
        let undistorted = match output {
            LensOutput::Camera => undistorted_camera(camera),
            LensOutput::Undistorted => PinholeCamera {
                distortion: [0.0; 5],
                ..camera.clone()
            },
        };
        let (device, _) = gpu;
        let shader = shaders::shader("lens", variant);
        let uploaded = U::COPY_DST | U::TEXTURE_BINDING;
        let size = (camera.width, camera.height);
        let raw = FrameTexture::new(device, "distorted camera", size, format::CAMERA, uploaded);
        let positions = upload(gpu, &undistorted, |pixel| {
            distorted_position(camera, &undistorted, pixel)
        });
        let slots = [Slot::Unfilterable; 2];
        let inputs = layout(device, "undistort", &slots);
        let bound = [view(&raw.view), view(&positions.view)];
        let bound = group(device, "undistort", &inputs, &bound);
        let pipeline = pipeline(device, &shader, &[&inputs], "undistorted");
        let distort = (output == LensOutput::Camera).then(|| {
            let position = |pixel| undistorted_position(camera, &undistorted, pixel);
            let positions = upload(gpu, camera, position);
            let bound = [view(&raw.view), view(&positions.view)];
            let bound = group(device, "distort camera", &inputs, &bound);
            let positions = (&inputs, bound, positions);
            Distort::new(device, &shader, positions, (size, variant), coverage)
        });
        Some(Self {
            camera: camera.clone(),
            output,
            coverage,
            reach: reach(camera),
            undistorted,
            raw,
            undistort: (pipeline, bound),
            distort,
        })
    }

    /// Whether the stage was made for this camera and output, and with or without coverage.
    pub fn suits(&self, camera: &PinholeCamera, output: (LensOutput, bool)) -> bool {
        self.camera == *camera && (self.output, self.coverage) == output
    }

    /// Undistorts the uploaded camera picture into `output`.
    pub fn undistort<'a>(
        &self,
        r: &mut Recorder<'_>,
        output: &'a FrameTexture,
    ) -> &'a FrameTexture {
        let (pipeline, inputs) = &self.undistort;
        r.cover("undistort", &output.view, pipeline, &[inputs]);
        output
    }

    /// The camera picture and the positions of its pixels in the undistorted one, where the finished
    /// picture is distorted.
    pub fn distorted(&self) -> Option<(&FrameTexture, &FrameTexture)> {
        let distort = self.distort.as_ref()?;
        Some((&self.raw, &distort.position_texture))
    }

    /// Distorts the composed picture, unless the undistorted one was requested. `surfaces` holds
    /// the virtual ones, for their outlines.
    pub fn distort<'a>(
        &'a mut self,
        r: &mut Recorder<'_>,
        real: RealPicture<'_>,
        composed: &'a FrameTexture,
        surfaces: Surfaces<'_>,
    ) -> &'a FrameTexture {
        let Some(distort) = &mut self.distort else {
            return composed;
        };
        let resources = [
            view(&real.camera.view),
            real.codes.binding(),
            view(&composed.view),
            view(&surfaces.virtual_surfaces.surface[0].view),
        ];
        let undistorted = distort.undistorted.get(r.device, &resources);
        let pipeline = &distort.pipelines[usize::from(real.exposed.is_some())];
        let groups = [&distort.positions, undistorted];
        r.cover("distort", &distort.output.view, pipeline, &groups);
        &distort.output
    }
}

impl Distort {
    fn new(
        device: &Device,
        shader: &Shader,
        (camera, positions, texture): (&wgpu::BindGroupLayout, wgpu::BindGroup, FrameTexture),
        (size, variant): ((u32, u32), Variant),
        coverage: bool,
    ) -> Self {
        let (shape, _) = Slot::sampled(variant.samples);
        let f = Slot::Unfilterable;
        let slots = [f, Slot::Uniform, f, shape];
        let undistorted = CachedGroup::from_slots(device, "distort", &slots);
        let usage = U::RENDER_ATTACHMENT | U::TEXTURE_BINDING | U::COPY_SRC;
        let entries = if coverage {
            ["distorted_covered", "distorted_exposed_covered"]
        } else {
            ["distorted", "distorted_exposed"]
        };
        Self {
            pipelines: entries
                .map(|entry| pipeline(device, shader, &[camera, &undistorted.layout], entry)),
            output: FrameTexture::new(device, "distorted output", size, format::OUTPUT, usage),
            positions,
            position_texture: texture,
            undistorted,
        }
    }
}

fn pipeline(
    device: &Device,
    shader: &Shader,
    groups: &[&wgpu::BindGroupLayout],
    entry: &str,
) -> wgpu::RenderPipeline {
    PipelineSpec {
        label: entry,
        shader,
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

/// A texture of `camera`'s size that holds the result of `position` for each pixel.
fn upload(
    (device, queue): (&Device, &wgpu::Queue),
    camera: &PinholeCamera,
    position: impl Fn(DVec2) -> [f32; 2],
) -> FrameTexture {
    let size = (camera.width, camera.height);
    let usage = U::COPY_DST | U::TEXTURE_BINDING;
    let format = wgpu::TextureFormat::Rg32Float;
    let target = FrameTexture::new(device, "positions", size, format, usage);
    let (rows, columns) = (0..camera.height, camera.width);
    let pixels = rows.flat_map(|y| (0..columns).map(move |x| (f64::from(x), f64::from(y))));
    let positions: Vec<[f32; 2]> = pixels.map(|(x, y)| position(DVec2::new(x, y))).collect();
    target.upload(queue, bytemuck::cast_slice(&positions), 8);
    target
}

/// The position of a pixel of the undistorted picture in the camera picture.
fn distorted_position(
    camera: &PinholeCamera,
    undistorted: &PinholeCamera,
    pixel: DVec2,
) -> [f32; 2] {
    let ray = ((pixel - undistorted.centre) / undistorted.focal).extend(1.0);
    let position = camera.project(ray).unwrap_or(DVec2::ZERO);
    // A polynomial model diverges far outside the picture: the position is clamped to the edge.
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    position.clamp(-size, 2.0 * size).as_vec2().to_array()
}

/// The position of a pixel of the camera picture in the undistorted one.
fn undistorted_position(
    camera: &PinholeCamera,
    undistorted: &PinholeCamera,
    pixel: DVec2,
) -> [f32; 2] {
    undistorted_point(camera, pixel).map_or(NO_POSITION, |p| {
        (p * undistorted.focal + undistorted.centre)
            .as_vec2()
            .to_array()
    })
}

/// The undistorted point, on the plane z = 1, that a pixel shows: Newton's method from the result
/// of the fixed-point iteration, which converges slowly for strong distortion. `None` past the
/// fold of the model.
fn undistorted_point(camera: &PinholeCamera, pixel: DVec2) -> Option<DVec2> {
    const STEP: f64 = 1e-6;
    let shown = |p: DVec2| camera.project(p.extend(1.0));
    let ray: DVec3 = camera.unproject(pixel);
    let mut p = ray.truncate() / ray.z;
    if !p.is_finite() {
        p = (pixel - camera.centre) / camera.focal;
    }
    for _ in 0..8 {
        let error = pixel - shown(p)?;
        let across = (shown(p + DVec2::X * STEP)? - shown(p - DVec2::X * STEP)?) / (2.0 * STEP);
        let down = (shown(p + DVec2::Y * STEP)? - shown(p - DVec2::Y * STEP)?) / (2.0 * STEP);
        let determinant = across.perp_dot(down);
        // A negative determinant means that the point lies past the fold.
        if determinant <= 0.0 {
            return None;
        }
        if error.length_squared() < 1e-12 {
            break;
        }
        p += DVec2::new(error.perp_dot(down), across.perp_dot(error)) / determinant;
    }
    let error = shown(p)?.distance(pixel);
    (error < MAX_INVERSION_ERROR_PIXELS && p.is_finite()).then_some(p)
}

/// Points of a grid over the entire picture, its edges included.
fn probes(camera: &PinholeCamera) -> impl Iterator<Item = DVec2> {
    const PROBES: u32 = 24;
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let share = |i: u32| f64::from(i) / f64::from(PROBES);
    let grid = (0..=PROBES).flat_map(|y| (0..=PROBES).map(move |x| (x, y)));
    grid.map(move |(x, y)| DVec2::new(share(x), share(y)) * size - 0.5)
}

/// A texture of the direction, on the plane z = 1, that each pixel of a camera shows.
pub(super) fn direction_texture(
    gpu: (&Device, &wgpu::Queue),
    camera: &PinholeCamera,
) -> FrameTexture {
    upload(gpu, camera, |pixel| {
        undistorted_point(camera, pixel).map_or(NO_POSITION, |p| p.as_vec2().to_array())
    })
}

/// Squared tangent of the direction farthest from the axis that a picture shows: past it the lens
/// model may fold.
pub(super) fn reach(camera: &PinholeCamera) -> f64 {
    let points = probes(camera).filter_map(|pixel| undistorted_point(camera, pixel));
    points.map(DVec2::length_squared).fold(1e-6, f64::max)
}

/// The camera of an undistorted picture that shows all directions of `camera` at its resolution.
fn undistorted_camera(camera: &PinholeCamera) -> PinholeCamera {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let (mut low, mut high, mut finest) = (DVec2::ZERO, DVec2::ZERO, 1.0_f64);
    for pixel in probes(camera) {
        let Some(p) = undistorted_point(camera, pixel) else {
            continue;
        };
        (low, high) = (low.min(p), high.max(p));
        let shown = |p: DVec2| camera.project(p.extend(1.0)).unwrap_or_default();
        let across = shown(p + DVec2::X * 1e-4) - shown(p - DVec2::X * 1e-4);
        let scale = across.length() / (2e-4 * camera.focal.x);
        finest = finest.max(scale);
    }
    let focal = camera.focal * finest.min(MAX_SCALE);
    let axis = |low: f64, high: f64, focal: f64, most: f64| {
        let (low, high) = ((low * focal).floor() - 2.0, (high * focal).ceil() + 2.0);
        let cut = (high - low + 1.0 - most).max(0.0) * 0.5;
        let (low, high) = ((low + cut).ceil(), (high - cut).floor());
        (-low, (high - low + 1.0) as u32)
    };
    let (x, width) = axis(low.x, high.x, focal.x, size.x * MAX_SIZE_RATIO);
    let (y, height) = axis(low.y, high.y, focal.y, size.y * MAX_SIZE_RATIO);
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
    fn undistorted_picture_holds_every_pixel_of_a_strong_lens() {
        let strong = [
            [-0.32, 0.12, 0.001, -0.0008, -0.02],
            [0.25, -0.05, -0.002, 0.001, 0.0],
            [-0.4, 0.25, 0.0, 0.0, -0.04],
        ];
        for camera in strong.map(lens) {
            let undistorted = undistorted_camera(&camera);
            for (x, y) in [
                (0.0, 0.0),
                (639.0, 0.0),
                (639.0, 479.0),
                (0.0, 479.0),
                (320.0, 240.0),
            ] {
                let pixel = DVec2::new(x, y);
                let p = undistorted_point(&camera, pixel).unwrap();
                assert!(camera.project(p.extend(1.0)).unwrap().distance(pixel) < 1e-5);
                let there = undistorted.project(p.extend(1.0)).unwrap();
                let size = DVec2::new(f64::from(undistorted.width), f64::from(undistorted.height));
                assert!(
                    there.cmpge(DVec2::ZERO).all() && there.cmplt(size).all(),
                    "{there}"
                );
            }
        }
    }

    #[test]
    fn pixels_past_the_fold_have_no_position() {
        // The distorted radius never exceeds 0.67 (268 pixels); the corners lie at 400.
        let camera = lens([-1.0 / 3.0, 0.0, 0.0, 0.0, 0.0]);
        assert!(undistorted_point(&camera, DVec2::new(0.0, 0.0)).is_none());
        assert!(undistorted_point(&camera, DVec2::new(322.0, 100.0)).is_some());
        let undistorted = undistorted_camera(&camera);
        assert!(undistorted.width <= 1280 && undistorted.height <= 960);
    }
}
