//! Compact sources on shadowing planes: their shadows come from their own direction, not from the
//! centre of the face that contains them.

use crate::comparison::{Rule, assert_like, assert_same_where, strays, untouched};
use crate::planes::{EXACT, baked, compose, cube, lit_by, planes, stage_with};
use crate::stage::{Stage, gpu, sun};
use glam::{Quat, Vec3};
use penumbra_compositor::planes::{PlaneWork, SourceBaker};
use penumbra_compositor::{Compositor, CompositorSettings};
use penumbra_lighting::geodesic::{Face, FaceLight, FaceSource, GeodesicDome};
use penumbra_lighting::{LightPlace, Lighting};
use penumbra_picture::Picture;
use std::sync::Arc;

const STRENGTH: Vec3 = Vec3::new(1.6, 1.5, 1.2);

/// A compositor with the bake of a stage and its sources.
fn compositor(stage: &Stage) -> Compositor {
    let bake = baked(stage, planes());
    let sources = SourceBaker::new(&gpu(), &stage.scene, &bake).unwrap();
    let mut compositor = stage.compositor();
    let put = compositor.set_bake_with_sources(Some(&bake), Some(sources));
    put.unwrap();
    compositor
}

fn face_of(direction: Vec3) -> usize {
    GeodesicDome::new(2).unwrap().face_of(direction).unwrap()
}

fn source(direction: Vec3) -> FaceSource {
    FaceSource {
        id: 1,
        direction,
        angular_radius: 0.004,
        spread: vec![(direction, 1.0)],
        irradiance_in_faces: vec![(face_of(direction) as u32, STRENGTH)],
    }
}

/// A dim sky and one sun; the lights of the picture, the twin and the faces are consistent.
fn sunny(direction: Vec3, generation: u64) -> Lighting {
    let sky = [Vec3::new(0.02, 0.022, 0.025); 40];
    let mut faces = sky;
    faces[face_of(direction)] += STRENGTH;
    let mut lighting = lit_by(&sky, generation);
    lighting.lights.push(sun(direction, STRENGTH));
    let light = lit_by(&faces, generation).faces.unwrap();
    lighting.faces = Some(Arc::new(FaceLight {
        sources: vec![source(direction)],
        ..(*light).clone()
    }));
    lighting
}

/// A direction well away from its face's centre.
fn beside() -> Vec3 {
    let dome = GeodesicDome::new(2).unwrap();
    let [a, b, _] = dome.faces[11].corners;
    (a * 0.7 + b * 0.25 + dome.faces[11].centre * 0.05).normalize()
}

fn stage_in(lighting: Lighting) -> Stage {
    Stage::new(128, 96).with_virtual(cube()).lit(lighting)
}

fn pictures(
    compositor: &mut Compositor,
    stage: &mut Stage,
    path: &[Vec3],
) -> Vec<(Picture, PlaneWork)> {
    let frames = path.iter().zip(1..);
    frames
        .map(|(direction, generation)| {
            stage.lighting = Some(sunny(*direction, generation));
            compose(compositor, stage, EXACT)
        })
        .collect()
}

/// Number of codes that differ by more than the twin's tolerance.
fn differing(a: &Picture, b: &Picture) -> usize {
    let pairs = a.rgba.iter().zip(&b.rgba);
    pairs.filter(|(a, b)| a.abs_diff(**b) > 8).count()
}

#[test]
fn sun_casts_its_shadow_from_its_own_direction() {
    let direction = beside();
    let centre = GeodesicDome::new(2).unwrap().faces[11].centre;
    assert!(
        direction.angle_between(centre) > 0.2,
        "{}",
        direction.angle_between(centre)
    );
    let stage = stage_in(sunny(direction, 1));
    let twin = stage.twin();
    let (ours, work) = compose(&mut compositor(&stage), &stage, EXACT);
    assert_like("plane-sources", &ours, &twin, Rule::within(2));
    assert_eq!(
        (work.sources, work.source_images),
        (1, planes().len() as u64)
    );
    // By the papers' method the shadow lies elsewhere.
    let mut papers = stage.compositor();
    papers.set_bake(Some(&baked(&stage, planes()))).unwrap();
    let (moved, work) = compose(&mut papers, &stage, EXACT);
    assert_eq!((work.sources, work.source_images), (0, 0));
    let (near, far) = (strays(&ours, &twin, 2, 8), strays(&moved, &twin, 2, 8));
    assert!(far > 100 && far > 10 * near, "{near} {far}");
}

#[test]
fn unshadowed_pixels_keep_the_cameras_codes() {
    let stage = stage_in(sunny(beside(), 1));
    let (ours, _) = compose(&mut compositor(&stage), &stage, EXACT);
    let calm = untouched(&stage.twin(), 3);
    assert!(calm.iter().filter(|c| **c).count() > 100);
    assert_same_where("plane-sources-open", &ours, &stage.picture, &calm);
}

#[test]
fn pictures_without_sources_are_unchanged() {
    let sky: Vec<Vec3> = (0..40)
        .map(|i| Vec3::splat(0.02 + 0.01 * (i % 7) as f32))
        .collect();
    let stage = stage_with(&sky);
    let mut papers = stage.compositor();
    papers.set_bake(Some(&baked(&stage, planes()))).unwrap();
    let (expected, _) = compose(&mut papers, &stage, EXACT);
    // No source in the light.
    let (none, _) = compose(&mut compositor(&stage), &stage, EXACT);
    assert_eq!(none, expected);
    // A source in the light, but sources are off.
    let sunny = sunny(beside(), 1);
    let mut without = sunny.clone();
    let light = sunny.faces.as_deref().unwrap().clone();
    without.faces = Some(Arc::new(FaceLight {
        sources: Vec::new(),
        ..light
    }));
    let pictures = [sunny, without].map(|lighting| {
        let stage = stage_in(lighting);
        let mut papers = stage.compositor();
        papers.set_bake(Some(&baked(&stage, planes()))).unwrap();
        compose(&mut papers, &stage, EXACT).0
    });
    assert_eq!(pictures[0], pictures[1]);
}

/// Directions along the sky, across an edge between two faces.
fn path(frames: usize, degrees: f32) -> Vec<Vec3> {
    let dome = GeodesicDome::new(2).unwrap();
    let common = |f: &Face| {
        f.corners
            .iter()
            .filter(|c| dome.faces[11].corners.contains(c))
            .count()
    };
    let next = dome.faces.iter().position(|f| common(f) == 2).unwrap();
    let (from, to) = (dome.faces[11].centre, dome.faces[next].centre);
    let axis = from.cross(to).normalize();
    let total = from.angle_between(to);
    let at = |i: usize| {
        let from_middle = (i as f32 - frames as f32 / 2.0) * degrees.to_radians();
        Quat::from_axis_angle(axis, 0.5 * total + from_middle) * from
    };
    (0..frames).map(at).collect()
}

#[test]
fn shadow_moves_smoothly_across_an_edge_between_faces() {
    let path = path(40, 0.5);
    assert_ne!(face_of(path[0]), face_of(path[39]));
    let mut stage = stage_in(sunny(path[0], 1));
    let steps = |frames: &[(Picture, PlaneWork)]| {
        let pairs = frames.windows(2);
        let steps = pairs.map(|pair| differing(&pair[0].0, &pair[1].0));
        steps.max().unwrap()
    };
    let ours = pictures(&mut compositor(&stage), &mut stage, &path);
    let mut papers = stage.compositor();
    papers.set_bake(Some(&baked(&stage, planes()))).unwrap();
    let jumping = pictures(&mut papers, &mut stage, &path);
    let (step, jump) = (steps(&ours), steps(&jumping));
    assert!(3 * step < jump, "{step} {jump}");
    // The images have followed the source.
    assert!(ours.last().unwrap().1.source_images > 3 * planes().len() as u64);
    assert!(ours.iter().all(|(_, work)| work.sources == 1));
}

/// Where light is kept on surfaces, the surface cache casts the shadow of a moving sun, and at best quality
/// pictures wait for its images: in both the shadow lies where the sun is.
#[test]
fn shadow_of_a_moving_sun_does_not_lag() {
    let path = path(8, 3.0);
    let strays_with = |change: fn(&mut CompositorSettings)| {
        let mut stage = stage_in(sunny(path[0], 1));
        change(&mut stage.settings);
        let mut ours = compositor(&stage);
        let (last, work) = pictures(&mut ours, &mut stage, &path).pop().unwrap();
        assert_eq!(work.sources, 1);
        strays(&last, &stage.twin(), 2, 8)
    };
    let lagging = strays_with(|_| ());
    let on_surfaces = strays_with(|settings| settings.cached = true);
    let waiting = strays_with(|settings| settings.waits_for_sources = true);
    assert!(lagging > 50, "{lagging}");
    assert!(10 * on_surfaces < lagging, "{on_surfaces} {lagging}");
    assert!(10 * waiting < lagging, "{waiting} {lagging}");
}

/// The surface cache casts the shadow of a lamp half a metre away from where it is, and it fades with the
/// square of the distance.
#[test]
fn near_lamp_lights_planes_from_its_place() {
    let with_place = |inverse_distance: f32| {
        let mut lighting = sunny(beside(), 1);
        lighting.lights.last_mut().unwrap().place = LightPlace {
            reference: Vec3::Z * 0.05,
            inverse_distance,
        };
        let mut stage = stage_in(lighting);
        stage.settings.cached = true;
        stage
    };
    let [near, far] = [2.0, 0.0].map(with_place);
    let twin = near.twin();
    let [near, far] = [near, far].map(|stage| {
        let (picture, work) = compose(&mut compositor(&stage), &stage, EXACT);
        assert_eq!(work.sources, 1);
        strays(&picture, &twin, 2, 8)
    });
    assert!(far > 100 && 10 * near < far, "{near} {far}");
}

#[test]
fn incrementally_baked_images_equal_those_baked_at_once() {
    let path = path(12, 1.0);
    let mut stage = stage_in(sunny(path[0], 1));
    let mut ours = compositor(&stage);
    let first = pictures(&mut ours, &mut stage, &path);
    let last = vec![path[11]; 40];
    let (settled, work) = pictures(&mut ours, &mut stage, &last).pop().unwrap();
    stage.lighting = Some(sunny(path[11], 1));
    let (fresh, _) = compose(&mut compositor(&stage), &stage, EXACT);
    let off = settled.rgba.iter().zip(&fresh.rgba);
    let off = off.map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off <= Some(1), "{off:?}");
    // Steady light bakes nothing.
    let (_, later) = pictures(&mut ours, &mut stage, &last[..3]).pop().unwrap();
    assert_eq!(work.source_images, later.source_images);
    assert_eq!((later.images, later.recomputed), (0, 0));
    // Pictures depend only on the pictures before them.
    let again = pictures(&mut compositor(&stage), &mut stage, &path);
    assert_eq!(first, again);
}

#[test]
fn hidden_planes_use_the_new_images_when_visible_again() {
    let path = path(30, 0.7);
    let mut stage = stage_in(sunny(path[0], 1));
    let mut ours = compositor(&stage);
    pictures(&mut ours, &mut stage, &path);
    let settled = vec![path[29]; 40];
    pictures(&mut ours, &mut stage, &settled);
    let behind = glam::DVec3::new(0.06, 0.4, 0.34);
    stage.pose = Some(crate::stage::looking_from(behind, glam::DVec3::ZERO));
    let (seen, _) = compose(&mut ours, &stage, EXACT);
    let (fresh, _) = compose(&mut compositor(&stage), &stage, EXACT);
    let off = seen.rgba.iter().zip(&fresh.rgba);
    let off = off.map(|(a, b)| a.abs_diff(*b)).max();
    assert!(off <= Some(1), "{off:?}");
}

#[test]
fn appearing_source_fades_in() {
    let mut stage = stage_in(sunny(beside(), 1));
    let dark = lit_by(&[Vec3::new(0.02, 0.022, 0.025); 40], 2);
    stage.lighting = Some(dark);
    let mut ours = compositor(&stage);
    compose(&mut ours, &stage, EXACT);
    let came = pictures(&mut ours, &mut stage, &[beside(); 30]);
    assert_eq!(came[0].1.sources, 0);
    assert_eq!(came[29].1.sources, 1);
    stage.lighting = Some(sunny(beside(), 1));
    let (fresh, _) = compose(&mut compositor(&stage), &stage, EXACT);
    let off = came[29].0.rgba.iter().zip(&fresh.rgba);
    assert!(off.map(|(a, b)| a.abs_diff(*b)).max() <= Some(1));
    // No step is large: the shadow fades from the face's to the source's own.
    let total = differing(&came[0].0, &came[29].0);
    let steps = came.windows(2).map(|pair| {
        let codes = pair[0].0.rgba.iter().zip(&pair[1].0.rgba);
        codes.map(|(a, b)| u32::from(a.abs_diff(*b))).max().unwrap()
    });
    assert!(total > 0 && steps.max().unwrap() < 64);
}
