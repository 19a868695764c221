//! Virtual objects in the picture of a camera with vignetting.

use crate::stage::{Stage, flat, lighting, looking_from, matt, painted, spiral};
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::Vignetting;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_compositor::LensOutput;
use penumbra_picture::Picture;
use penumbra_scene::ShadowMode;
use penumbra_scene::primitives;

const SIZE: (u32, u32) = (320, 240);
const VIGNETTING: Vignetting = Vignetting {
    centre: DVec2::new(150.0, 128.0),
    radius: 200.0,
    coefficients: [-0.5, 0.12, -0.05],
    sigma: [0.0; 3],
};

/// Mean red light of 5×5 pixels.
fn light(picture: &Picture, (x, y): (u32, u32)) -> f64 {
    let linear = Response::srgb();
    let linear = linear.linear_from_code();
    let near = (0..25).map(|k| (x + k % 5 - 2, y + k / 5 - 2));
    let codes = near.map(|(x, y)| picture.rgba[4 * (y * picture.width + x) as usize]);
    codes
        .map(|c| f64::from(linear[usize::from(c)]))
        .sum::<f64>()
        / 25.0
}

fn stage(distortion: [f64; 5]) -> Stage {
    let wall = painted(
        primitives::plane(6.0, 6.0),
        DVec3::ZERO,
        matt(Vec3::splat(0.6)),
    );
    let mut stage = Stage::new(SIZE.0, SIZE.1)
        .without_ground()
        .with_virtual(wall)
        .lit(lighting(spiral(8, 2.0), 0.3));
    stage.camera = PinholeCamera {
        width: SIZE.0,
        height: SIZE.1,
        focal: DVec2::new(230.0, 232.0),
        centre: DVec2::new(157.3, 121.6),
        distortion,
    };
    stage.pose = Some(looking_from(DVec3::Z, DVec3::ZERO));
    stage.picture = flat(SIZE.0, SIZE.1, [70, 70, 70]);
    stage
}

/// The position of a pixel of the output in the camera picture.
fn own(camera: &PinholeCamera, lens_output: LensOutput, pixel: DVec2) -> DVec2 {
    match lens_output {
        LensOutput::Camera => pixel,
        LensOutput::Undistorted => {
            let ray = (pixel - camera.centre) / camera.focal;
            camera.project(ray.extend(1.0)).unwrap()
        }
    }
}

#[test]
fn virtual_objects_have_the_vignetting_of_the_camera() {
    for distortion in [[0.0; 5], [-0.25, 0.06, 0.003, -0.002, 0.0]] {
        for lens_output in [LensOutput::Camera, LensOutput::Undistorted] {
            let mut stage = stage(distortion);
            let mut compositor = stage.compositor();
            compositor.set_lens_output(lens_output);
            let even = stage.compose_with(&mut compositor);
            stage.vignetting = Some(VIGNETTING);
            let faded = stage.compose_with(&mut compositor);
            for at in [
                (8, 8),
                (310, 10),
                (160, 120),
                (9, 229),
                (240, 200),
                (310, 230),
            ] {
                let pixel = DVec2::new(at.0.into(), at.1.into());
                let expected = VIGNETTING.at(own(&stage.camera, lens_output, pixel));
                let share = light(&faded, at) / light(&even, at);
                println!("{at:?}: {share:.4} of {expected:.4}");
                assert!(
                    (share - expected).abs() < 0.012,
                    "{at:?}: {share}, {expected}"
                );
            }
        }
    }
}

/// A shadow that multiplies the picture needs no vignetting; the paper's, which is subtracted,
/// does. Pixels without virtual light or shadow stay the camera's.
#[test]
fn subtracted_shadow_has_the_vignetting_of_the_camera() {
    let block = painted(
        primitives::plane(0.12, 0.12),
        DVec3::new(0.0, 0.0, 0.1),
        matt(Vec3::ONE),
    );
    let mut stage = Stage::new(SIZE.0, SIZE.1)
        .with_virtual(block)
        .lit(lighting(spiral(8, 2.0), 0.1));
    stage.pose = Some(looking_from(DVec3::new(0.05, -0.3, 0.8), DVec3::ZERO));
    stage.picture = flat(SIZE.0, SIZE.1, [150, 150, 150]);
    let vignetting = Vignetting {
        centre: DVec2::splat(20.0),
        coefficients: [-0.4, 0.0, 0.0],
        ..VIGNETTING
    };
    let lacking = |mode: ShadowMode, vignetting: Option<Vignetting>| {
        let stage = Stage {
            mode,
            vignetting,
            ..stage.clone()
        };
        let out = stage.compose();
        let corner = 4 * (2 * SIZE.0 + 2) as usize;
        assert_eq!(out.rgba[corner..corner + 4], [150, 150, 150, 255]);
        let darkest = |at: &(u32, u32)| (light(&stage.picture, *at) - light(&out, *at), *at);
        let pixels = (3..SIZE.1 - 3).flat_map(|y| (3..SIZE.0 - 3).map(move |x| (x, y)));
        (
            out.clone(),
            pixels
                .map(|at| darkest(&at))
                .fold((0.0, (0, 0)), |a, b| if b.0 > a.0 { b } else { a }),
        )
    };
    let (even, (_, at)) = lacking(ShadowMode::Ratio, None);
    let (faded, _) = lacking(ShadowMode::Ratio, Some(vignetting));
    assert!((light(&even, at) - light(&faded, at)).abs() < 2e-3);
    let (_, (even, at)) = lacking(ShadowMode::Subtract, None);
    let (out, _) = lacking(ShadowMode::Subtract, Some(vignetting));
    let share = (light(&stage.picture, at) - light(&out, at)) / even;
    let expected = vignetting.at(DVec2::new(at.0.into(), at.1.into()));
    println!("at {at:?}: {share:.3} of {expected:.3}");
    assert!(
        expected < 0.8 && (share - expected).abs() < 0.03,
        "{share}, {expected}"
    );
}
