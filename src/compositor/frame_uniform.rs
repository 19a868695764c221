//! The uniform that every pass of a frame reads.

use super::frame_input::FrameInput;
use super::frame_view::{FrameView, NEAR};
use super::gpu_data::{FrameUniform, NearLightUniform};
use super::textures::TILE;
use glam::{DQuat, DVec3, DVec4, Vec3};
use penumbra_camera::RollingShutter;
use penumbra_interface::RigidTransform;
use penumbra_lighting::DomeLight;
use penumbra_lighting::place::MAX_NEAR_LIGHTS;
use penumbra_scene::indirect_light::{GroundMap, SurfaceIrradiance};
use penumbra_scene::{IndirectLight, ShadowMode};

/// The inputs of the uniform.
pub struct UniformInputs<'a> {
    pub input: &'a FrameInput<'a>,
    pub view: &'a FrameView,
    /// Whether virtual objects are shown.
    pub augmented: bool,
    /// Number of dome lights with shadow maps.
    pub lights: u32,
    /// The near lights where nothing blocks them; see
    /// [`penumbra_lighting::place::near_lights`].
    pub near: &'a [DomeLight],
    /// Whether virtual lights act on real surfaces by the paper's response.
    pub lamps_apart: bool,
    /// Height of the ground, metres; `None` without ground.
    pub ground_height: Option<f64>,
    /// Number of the coarsest level of the surroundings.
    pub highest_surroundings_level: u32,
    /// Number of the coarsest level of the radiance maps.
    pub highest_gloss_level: u32,
    /// Factor of the exposure on linear light.
    pub exposure_factor: f32,
}

/// The uniform of a frame.
pub fn frame_uniform(from: &UniformInputs<'_>) -> FrameUniform {
    let UniformInputs { input, view, .. } = from;
    // Without a pose or light the camera is placed far away from everything.
    let far_away = RigidTransform::new(DQuat::IDENTITY, DVec3::splat(1e6));
    let visible = from.augmented && input.lighting.is_some();
    let pose = input.world_from_camera.filter(|_| visible);
    let pose = pose.unwrap_or(far_away);
    let axis = |v: DVec3| (pose.rotation * v).as_vec3().extend(0.0).to_array();
    let (width, height) = (view.size.0 as f32, view.size.1 as f32);
    let ground = input.lighting.map_or(Vec3::ZERO, |l| l.ground_radiance);
    let (ground_height, has_ground) = from.ground_height.map_or((0.0, 0.0), |h| (h as f32, 1.0));
    let [f, c] = [view.camera.focal, view.camera.centre];
    let is_shown = |near: &&IndirectLight| near.generation != 0 && visible;
    let indirect = input.indirect_light.filter(is_shown);
    let [on_virtual, on_real] = surface_grids(indirect);
    let on_ground = indirect.map_or_else(GroundMap::default, |near| near.on_ground);
    let [rotation_per_row, translation_per_row] = rolling_shutter(from);
    let steps = from.highest_surroundings_level as f32;
    let [distortion, rows] = distortion(view);
    let [vignetting, vignetting_intrinsics] = vignetting(from);
    let (near_lights, near_count) = near_lights(from);
    FrameUniform {
        vignetting,
        vignetting_intrinsics,
        rotation_per_row,
        translation_per_row,
        distortion,
        rows,
        right: axis(DVec3::X),
        down: axis(DVec3::Y),
        forward: axis(DVec3::Z),
        eye: pose.translation.as_vec3().extend(NEAR as f32).to_array(),
        intrinsics: [f.x as f32, f.y as f32, c.x as f32, c.y as f32],
        size: [width, height, 1.0 / width, 1.0 / height],
        clip_from_world: view
            .clip_from_world(pose.inverse().to_matrix())
            .as_mat4()
            .to_cols_array_2d(),
        harmonics: input.lighting.map_or([[0.0; 4]; 9], |l| {
            l.irradiance.coefficients.map(|c| c.extend(0.0).to_array())
        }),
        counts: [
            from.lights,
            u32::from(input.shadow_mode == ShadowMode::Subtract),
            near_count,
            from.highest_gloss_level,
        ],
        params: [input.shadow_strength, ground_height, has_ground, steps],
        ground: ground.extend(from.exposure_factor).to_array(),
        tiling: [from.lights.div_ceil(64).max(1), TILE, 0, TILE.ilog2()],
        indirect_low: indirect.map_or([0.0; 4], |n| n.low.extend(1.0).to_array()),
        indirect_high: indirect.map_or([1.0; 4], |n| n.high.extend(0.0).to_array()),
        indirect_objects: on_ground.corners(),
        on_virtual,
        on_real,
        planes_low: [0.0; 4],
        planes_high: [0.0; 4],
        brightest: brightest(from),
        near_lights,
    }
}

/// Corners of the grids with the irradiance on virtual surfaces and on phantoms.
fn surface_grids(indirect: Option<&IndirectLight>) -> [[[f32; 4]; 2]; 2] {
    let grids = |light: &IndirectLight| [&light.on_virtual, &light.change.surfaces].map(corners);
    indirect.map_or([NO_GRID; 2], grids)
}

const NO_GRID: [[f32; 4]; 2] = [[0.0; 4], [1.0; 4]];

fn corners(light: &SurfaceIrradiance) -> [[f32; 4]; 2] {
    let grid = &light.grid;
    if grid.cells.is_empty() {
        return NO_GRID;
    }
    [grid.low.extend(1.0), grid.high.extend(0.0)].map(|corner| corner.to_array())
}

/// The near lights where nothing blocks them, and their number.
fn near_lights(from: &UniformInputs<'_>) -> ([NearLightUniform; MAX_NEAR_LIGHTS], u32) {
    let mut all = [NearLightUniform::default(); MAX_NEAR_LIGHTS];
    let mut count = 0;
    for (to, light) in all.iter_mut().zip(from.near) {
        let towards = light.towards(Vec3::ZERO);
        to.place = towards.extend(light.place.inverse_distance).to_array();
        to.irradiance = light.irradiance.extend(0.0).to_array();
        count += 1;
    }
    (all, count)
}

/// Motion from one row of the camera picture to the next: `rotation_per_row` and
/// `translation_per_row` of the shaders' frame.
fn rolling_shutter(from: &UniformInputs<'_>) -> [[f32; 4]; 2] {
    let Some(shutter) = &from.input.rolling_shutter else {
        return [[0.0; 4]; 2];
    };
    let middle = RollingShutter::middle_row(&from.view.own);
    [
        shutter.rotation_per_row.extend(middle),
        shutter.translation_per_row.extend(0.0),
    ]
    .map(|row| row.as_vec4().to_array())
}

/// Distortion of the camera picture, and which row shows a direction: `distortion` and `rows`.
fn distortion(view: &FrameView) -> [[f32; 4]; 2] {
    let own = &view.own;
    let [k1, k2, p1, p2, k3] = own.distortion;
    [
        DVec4::new(k1, k2, k3, p1),
        DVec4::new(p2, own.focal.y, own.centre.y, view.reach),
    ]
    .map(|row| row.as_vec4().to_array())
}

/// Vignetting of the camera: `vignetting` and `vignetting_intrinsics`.
fn vignetting(from: &UniformInputs<'_>) -> [[f32; 4]; 2] {
    let own = &from.view.own;
    let (centre, radius, [k1, k2, k3]) = match &from.input.vignetting {
        Some(vignetting) => (
            vignetting.centre,
            vignetting.radius,
            vignetting.coefficients,
        ),
        None => (own.centre, 1.0, [0.0; 3]),
    };
    let offset = own.centre - centre;
    [
        DVec4::new(k1, k2, k3, 1.0 / (radius * radius)),
        DVec4::new(own.focal.x, own.focal.y, offset.x, offset.y),
    ]
    .map(|row| row.as_vec4().to_array())
}

/// Direction to the brightest physical light times its dominance; w = 1 where the paper's response
/// is used.
fn brightest(from: &UniformInputs<'_>) -> [f32; 4] {
    if !from.lamps_apart {
        return [0.0; 4];
    }
    let brightest = from.input.brightest;
    let finite = brightest.is_finite();
    let known = if finite { brightest } else { Vec3::ZERO };
    known.clamp_length_max(1.0).extend(1.0).to_array()
}
