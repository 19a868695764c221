//! Moving objects: at each instant the picture equals that of the same objects placed there.

use crate::comparison::{difference, square_differences};
use crate::golden::{assert_golden, golden_stage};
use crate::stage::Stage;
use glam::{DVec3, Vec3};
use penumbra_compositor::{Compositor, Refresh};
use penumbra_picture::Picture;
use penumbra_scene::Motions;
use penumbra_scene::{SceneAddition, primitives};

/// A box that slides and rotates, a ring that spins about a slanted axis and grows, a static post,
/// and a spot attached to the box.
const SCENE: &str = r##"
[[object]]
name = "box"
shape = "box"
size_m = [0.07, 0.05, 0.06]
position_m = [-0.1, -0.04, 0.0]
material = { base_colour = "#b04030", roughness = 0.5 }
repeat_s = 4.0
keys = [
    { at_s = 0.0 },
    { at_s = 2.0, position_m = [0.08, -0.05, 0.0], rotation_deg = [120.0, 0.0, 0.0] },
    { at_s = 4.0 },
]

[[object]]
name = "ring"
shape = "torus"
radius_m = 0.05
tube_radius_m = 0.015
position_m = [0.02, 0.1, 0.08]
easing = "linear"
repeat_s = 3.0
keys = [
    { at_s = 0.0, rotation_deg = [0.0, 60.0, 0.0] },
    { at_s = 3.0, rotation_deg = [360.0, 60.0, 0.0], scale = [1.0, 1.0, 1.6] },
]
material = { base_colour = "#d8b050", metallic = 1.0, roughness = 0.3 }

[[object]]
name = "post"
shape = "cylinder"
radius_m = 0.012
height_m = 0.1
position_m = [0.12, 0.02, 0.0]
material = { base_colour = "#4080a0" }

[[lamp]]
attached_to = "box"
position_m = [0.0, 0.0, 0.14]
target_m = [0.08, 0.05, 0.0]
intensity = [0.05, 0.04, 0.02]
beam_deg = 30
cutoff_deg = 45
"##;

/// `cached`: with light kept on surfaces.
fn stage(cached: bool) -> Stage {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("moving.toml");
    std::fs::write(&path, SCENE).unwrap();
    let mut stage = golden_stage();
    stage.settings.cached = cached;
    // A low sun casts long shadows.
    let sun = crate::stage::sun(Vec3::new(-0.6, -0.3, 0.7), Vec3::new(1.2, 1.1, 0.9));
    stage.lighting.as_mut().unwrap().lights[63] = sun;
    stage.scene = SceneAddition::load(&path).unwrap().onto(stage.scene);
    let real = crate::stage::part(
        primitives::cuboid(Vec3::new(0.03, 0.03, 0.05)),
        DVec3::new(0.0, -0.12, 0.0),
    );
    stage.with_phantom(real)
}

/// A compositor without mesh simplification, so that all stages have the same triangles.
fn compositor(stage: &Stage) -> Compositor {
    let response = stage.response.clone();
    let mut compositor = Compositor::new(crate::stage::gpu(), stage.settings.clone(), response);
    compositor.set_scene(&stage.scene, &stage.scene.virtual_parts);
    compositor
}

/// The picture at `seconds` of a compositor that has shown other times.
fn moved(stage: &mut Stage, compositor: &mut Compositor, seconds: f64) -> Picture {
    stage.scene.lamps_at(seconds, &mut stage.lamps);
    stage.seconds = seconds;
    stage.compose_with(compositor)
}

/// The picture of the same objects placed statically, in a new compositor.
fn placed(seconds: f64, cached: bool) -> Picture {
    let mut stage = stage(cached);
    stage.scene.lamps_at(seconds, &mut stage.lamps);
    stage.scene.place_at(seconds);
    stage.scene.motions = Motions::default();
    stage.compose_with(&mut compositor(&stage))
}

#[test]
fn moving_objects_look_and_cast_shadows_as_if_placed_there() {
    // At outlines of the metal ring, mirror rays meet other triangles by rounding.
    assert_as_if_placed(false, (3.0, 0.03));
    // Texels lie elsewhere on objects that were turned.
    assert_as_if_placed(true, (4.0, 0.2));
}

/// Tolerances, codes: the largest mean difference of a square of the picture, and the mean
/// difference of the picture.
fn assert_as_if_placed(cached: bool, (of_square, of_picture): (f64, f64)) {
    let mut stage = stage(cached);
    assert_eq!(stage.scene.motions.parts.len(), 2);
    let mut compositor = compositor(&stage);
    let first = moved(&mut stage, &mut compositor, 0.0);
    for seconds in [0.7, 2.0, 5.3] {
        let (ours, truth) = (
            moved(&mut stage, &mut compositor, seconds),
            placed(seconds, cached),
        );
        let squares = square_differences(&ours, &truth);
        let worst = squares.iter().map(|s| s.1).fold(0.0, f64::max);
        let (_, mean) = difference(&ours, &truth);
        assert!(
            worst < of_square && mean < of_picture,
            "{seconds} s, cached {cached}: {worst} {mean}"
        );
        let (_, change) = difference(&ours, &first);
        assert!(change > 1.0, "{seconds} s: nothing has moved ({change})");
    }
    let again = moved(&mut stage, &mut compositor, 0.0);
    assert_eq!(
        difference(&again, &first).0,
        0,
        "the same time gives other bytes"
    );
}

#[test]
fn shadow_maps_of_resting_objects_are_not_drawn_again() {
    let mut stage = stage(false);
    stage.scene.motions.parts.retain(|mover| mover.index == 0);
    let mut compositor = compositor(&stage);
    let lights = stage.lighting.as_ref().map_or(&[][..], |l| &l.lights);
    let lit = lights.iter().filter(|l| l.irradiance.element_sum() > 0.0);
    let lights = lit.count();
    moved(&mut stage, &mut compositor, 2.0);
    for (seconds, drawn) in [(2.0, 0), (2.1, lights), (2.1, 0)] {
        moved(&mut stage, &mut compositor, seconds);
        assert_eq!(compositor.maps_refreshed(), drawn, "{seconds} s");
    }
    stage.refresh = Refresh::UpTo(5);
    moved(&mut stage, &mut compositor, 2.2);
    assert_eq!(compositor.maps_refreshed(), 5);
}

#[test]
fn golden_moving_objects_with_an_attached_lamp() {
    let mut stage = stage(false);
    let mut compositor = stage.compositor();
    moved(&mut stage, &mut compositor, 0.4);
    assert_golden("moving", &moved(&mut stage, &mut compositor, 1.3));
}
