//! A slow CPU reference of the compositor, for its tests.
//!
//! One ray through the centre of each pixel, one ray to each light, sums in `f64`; no shadow maps,
//! no tiles, no tables. Specular reflection of virtual objects and the light that the nearby ground
//! reflects onto them are omitted, so virtual surfaces are compared without specular reflection and
//! without ground.

pub mod area;
pub mod exposure;
mod lamps;
mod light;
pub mod look;
mod surface;

pub use lamps::response;
pub use surface::{Reference, Seen};

use super::frame_input::FrameInput;
use glam::DVec3;
use penumbra_camera::Response;
use penumbra_picture::Picture;
use penumbra_scene::{LampResponse, ShadowMode};

/// One reference pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferencePixel {
    /// Kind of the visible surface.
    pub seen: Seen,
    /// Linear light.
    pub linear: DVec3,
    /// Hash of the visible surface's part and of the lights that reach it. No outline and no shadow
    /// edge separates pixels of equal footprints.
    pub footprint: u64,
    /// Normal of the visible surface; zero if there is none.
    pub normal: DVec3,
    /// Whether the pixel shows no virtual surface and no virtual shadow.
    pub untouched: bool,
}

/// A reference picture.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferencePicture {
    /// Row by row.
    pub pixels: Vec<ReferencePixel>,
    /// The same, encoded.
    pub picture: Picture,
}

impl Reference {
    /// Renders the reference picture of a frame.
    #[must_use]
    pub fn compose(&self, input: &FrameInput<'_>, response: &Response) -> ReferencePicture {
        let (width, height) = (input.picture.width, input.picture.height);
        let factor = exposure::factor(input);
        let exposed = exposure::exposed(input.picture, response, factor, input.highlights);
        let mut pixels = Vec::with_capacity((width * height) as usize);
        let mut rgba = Vec::with_capacity(4 * (width * height) as usize);
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let codes = input.picture.rgb(x, y);
            let video = DVec3::from(response.linear_from_rgb(codes).map(f64::from));
            let camera = [exposed[(y * width + x) as usize], video];
            let pixel = self.pixel((x, y), camera, input);
            let shown = if pixel.untouched && factor == 1.0 {
                codes
            } else {
                pixel
                    .linear
                    .to_array()
                    .map(|v| response.code_from_linear(v as f32))
            };
            rgba.extend(shown);
            rgba.push(255);
            pixels.push(pixel);
        }
        let picture = Picture {
            width,
            height,
            rgba,
        };
        ReferencePicture { pixels, picture }
    }

    /// `camera`: the picture's light at the pixel in the shown exposure, and in the camera's own.
    fn pixel(
        &self,
        at: (u32, u32),
        [camera, video]: [DVec3; 2],
        input: &FrameInput<'_>,
    ) -> ReferencePixel {
        // Virtual surfaces are shown in the exposure of `camera`.
        let factor = f64::from(exposure::factor(input));
        let bare = ReferencePixel {
            seen: Seen::Camera,
            linear: camera,
            footprint: 0,
            normal: DVec3::ZERO,
            untouched: true,
        };
        let (Some(pose), Some(lighting)) = (input.world_from_camera, input.lighting) else {
            return bare;
        };
        let Some(surface) = self.surface(at, input.camera, pose, input.show_virtual) else {
            return bare;
        };
        let visibility = self.visibility(&surface, &lighting.lights);
        let strength = input.shadow_strength;
        let shown: &[_] = if input.show_virtual { input.lamps } else { &[] };
        let lamps = self.lamps(&surface, shown, strength);
        let footprint = surface::footprint(&surface, &visibility, lamps.iter().map(|l| l.seen));
        let lit = lamps::irradiance(surface.normal, &lamps);
        if surface.seen == Seen::Virtual {
            return ReferencePixel {
                seen: Seen::Virtual,
                linear: light::of_virtual(&surface, &visibility, lighting, lit) * factor,
                footprint,
                normal: surface.normal,
                untouched: false,
            };
        }
        let sums = light::on_phantom(&surface, &visibility, lighting, self.has_ground);
        let lost = sums.lost * f64::from(strength);
        let untouched =
            !input.show_virtual || surface.mirror || (lost == DVec3::ZERO && lit == DVec3::ZERO);
        // Lamps multiply the picture, or are added to it.
        let (multiplied, apart) = match input.lamp_response {
            LampResponse::Intrinsic => (lit, DVec3::ZERO),
            LampResponse::Paper => {
                let added = lamps::added_by_paper(&surface, &lamps, input.brightest, video);
                (DVec3::ZERO, added * factor)
            }
        };
        let arriving = sums.arriving.max(DVec3::splat(1e-9));
        let linear = match input.shadow_mode {
            _ if untouched => camera,
            ShadowMode::Ratio => {
                // Where almost no light arrives, the reflectance cannot be estimated.
                let lowest = (0.05 * sums.open).max(DVec3::splat(1e-4));
                camera * (1.0 - lost / arriving + multiplied / arriving.max(lowest)) + apart
            }
            ShadowMode::Subtract => {
                let less = (lost - multiplied) * (factor / std::f64::consts::PI);
                (camera - less).max(DVec3::ZERO) + apart
            }
        };
        ReferencePixel {
            seen: Seen::Phantom,
            linear,
            footprint,
            normal: surface.normal,
            untouched,
        }
    }
}
