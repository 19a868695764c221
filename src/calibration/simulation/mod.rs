//! Simulated rigs: the recordings of their cameras and tracker, with ground truth, to try and to
//! assess calibration without hardware.
//!
//! `options` describe a rig and its defects, `motion` moves it, `camera` casts rays at the `panel`s
//! of a `room`, `tracker` measures poses as an electromagnetic tracker does; `rig_files` creates
//! `rig.json` and the ground truth. No path tracing, to keep pictures cheap.

mod camera;
mod motion;
mod options;
mod panel;
mod rig_files;
mod room;
mod tracker;
mod webcam;

pub use camera::SimulatedCamera;
pub use motion::{Hand, Motion};
pub use options::{EnvironmentMount, SimulationOptions};
pub use panel::Panel;
pub use penumbra_numerics::Random;
pub use rig_files::FrameTruth;
pub use room::Room;
pub use tracker::{Metal, fastrak_record};
pub use webcam::{LAMP, SimulatedWebcam};

use crate::intrinsics::{Board, Grey};
use glam::{DQuat, DVec2, DVec3, EulerRot};
use penumbra_camera::Response;
use penumbra_camera::{Lens, LensModel};
use penumbra_fiducials::{Family, Tag};
use penumbra_interface::RigidTransform;
use std::f64::consts::{FRAC_PI_2, PI};

/// Edge of the tags' black border, metres.
const TAG_SIZE: f64 = 0.08;
/// Samples of the motion blur during an exposure.
const SHUTTER_SAMPLES: u32 = 5;

/// A simulated rig. Times are seconds since the recording began.
#[derive(Clone, Debug)]
pub struct SimulatedRig {
    /// The options that it was created from.
    pub options: SimulationOptions,
    /// The scene camera.
    pub scene: SimulatedCamera,
    /// The environment camera.
    pub environment: Option<SimulatedCamera>,
    /// Pose of the environment camera in the world or on the scene camera, depending on its mount.
    pub environment_pose: RigidTransform,
    /// Hand–eye transform.
    pub sensor_from_camera: RigidTransform,
    /// Pose of the tracker's transmitter.
    pub world_from_transmitter: RigidTransform,
    /// The tags.
    pub tags: Vec<Tag>,
    hand: Hand,
    metal: Metal,
    room: Room,
    /// The room after the loose tag has been moved.
    room_after_move: Option<Room>,
}

/// Returns the pose of a panel flat on the table at `position`: without the rotation by `angle`
/// (radians), +X is the world's, +Y points to the viewer, +Z into the table.
#[must_use]
pub fn flat_on_table(angle: f64, position: DVec3) -> RigidTransform {
    RigidTransform::new(
        DQuat::from_rotation_z(angle) * DQuat::from_rotation_x(PI),
        position,
    )
}

impl SimulatedRig {
    /// Creates the rig that the options describe.
    #[must_use]
    pub fn new(options: SimulationOptions) -> Self {
        let mut random = Random::new(options.seed.wrapping_mul(0x51_7cc1_b727_220a));
        let lens = scene_lens(options.size, &mut random);
        let tags = if options.board.is_some() {
            Vec::new()
        } else {
            tags(options.tags, &mut random)
        };
        let (panels, middle, extent) = panels(&tags, options.board.as_ref());
        let room_after_move = (options.loose && !tags.is_empty()).then(|| {
            let mut moved = panels.clone();
            if let Some(last) = moved.last_mut() {
                let displacement =
                    RigidTransform::new(DQuat::from_rotation_z(0.2), DVec3::new(0.03, -0.02, 0.0));
                last.world_from_panel = last.world_from_panel * displacement;
            }
            Room::new(moved, options.seed)
        });
        let distance = (2.2 * extent).max(0.35);
        let hand = Hand::new(options.motion, middle, distance, &mut random);
        let world_from_transmitter = RigidTransform::new(
            DQuat::from_euler(
                EulerRot::ZYX,
                random.between(-0.6, 0.6),
                random.between(-0.1, 0.1),
                PI + random.between(-0.1, 0.1),
            ),
            DVec3::new(-0.75, random.between(-0.5, 0.0), random.between(0.0, 0.25)),
        );
        let volume = world_from_transmitter
            .inverse()
            .transform_point(hand.at(0.0).translation);
        Self {
            scene: SimulatedCamera::new(&lens),
            environment: environment_lens(options.environment).map(|l| SimulatedCamera::new(&l)),
            environment_pose: environment_pose(options.environment, &mut random),
            sensor_from_camera: RigidTransform::new(
                DQuat::from_euler(EulerRot::XYZ, FRAC_PI_2, 0.0, FRAC_PI_2)
                    * DQuat::from_scaled_axis(random.normal3() * 0.1),
                random.normal3() * 0.035,
            ),
            metal: Metal::near(volume, options.metal, &mut random),
            room: Room::new(panels, options.seed),
            world_from_transmitter,
            hand,
            room_after_move,
            tags,
            options,
        }
    }

    /// Returns the scene camera's true pose.
    #[must_use]
    pub fn world_from_camera(&self, seconds: f64) -> RigidTransform {
        self.hand.at(seconds)
    }

    /// Returns the environment camera's true pose.
    #[must_use]
    pub fn world_from_environment(&self, seconds: f64) -> RigidTransform {
        match self.options.environment {
            EnvironmentMount::Carried => self.hand.at(seconds) * self.environment_pose,
            _ => self.environment_pose,
        }
    }

    /// Returns the sensor's true pose.
    #[must_use]
    pub fn transmitter_from_sensor(&self, seconds: f64) -> RigidTransform {
        self.world_from_transmitter.inverse()
            * self.hand.at(seconds)
            * self.sensor_from_camera.inverse()
    }

    /// Returns the tracker's measurement at that time, with noise and distortion by metal.
    #[must_use]
    pub fn measured(&self, seconds: f64, random: &mut Random) -> RigidTransform {
        let (millimetres, degrees) = self.options.tracker_noise;
        let distorted = self.metal.distort(self.transmitter_from_sensor(seconds));
        let mut shift = random.normal3() * millimetres * 1e-3;
        let rotation = random.normal3() * degrees.to_radians();
        if random.uniform() < self.options.jumps {
            shift += random.normal3() * 0.1;
        }
        RigidTransform::new(
            (DQuat::from_scaled_axis(rotation) * distorted.rotation).normalize(),
            distorted.translation + shift,
        )
    }

    /// Renders the scene camera's picture whose exposure is centred at `seconds`; returns grey codes.
    #[must_use]
    pub fn scene_picture(&self, seconds: f64, random: &mut Random) -> Vec<u8> {
        let at = |t: f64| self.hand.at(t);
        self.picture(&self.scene, &at, seconds, random)
    }

    /// Renders the environment camera's picture like [`Self::scene_picture`]; empty if there is no
    /// such camera.
    #[must_use]
    pub fn environment_picture(&self, seconds: f64, random: &mut Random) -> Vec<u8> {
        let at = |t: f64| self.world_from_environment(t);
        self.environment.as_ref().map_or_else(Vec::new, |camera| {
            self.picture(camera, &at, seconds, random)
        })
    }

    /// Renders a picture: rolling shutter, motion blur, blur, tone curve and noise.
    fn picture(
        &self,
        camera: &SimulatedCamera,
        pose: &dyn Fn(f64) -> RigidTransform,
        seconds: f64,
        random: &mut Random,
    ) -> Vec<u8> {
        let lens = camera.lens();
        let mut grey = Grey::from_bytes(lens.width as usize, lens.height as usize, &[]);
        let room = match &self.room_after_move {
            Some(moved) if seconds > 0.5 * self.options.seconds => moved,
            _ => &self.room,
        };
        let has_motion_blur = self.options.shutter > 0.0;
        let samples = if has_motion_blur { SHUTTER_SAMPLES } else { 1 };
        let rows = f64::from(lens.height);
        for i in 0..samples {
            let share = (f64::from(i) + 0.5) / f64::from(samples) - 0.5;
            let exposed = seconds + share * self.options.shutter;
            let still = pose(exposed);
            let row = |y: u32| match self.options.rolling {
                0.0 => still,
                rolling => pose(exposed + ((f64::from(y) + 0.5) / rows - 0.5) * rolling),
            };
            camera.add_picture(room, &row, 1.0 / samples as f32, &mut grey.data);
        }
        if self.options.blur > 0.0 {
            grey = grey.blurred(self.options.blur as f32);
        }
        let response = Response::srgb();
        let noise = self.options.noise;
        let code = |light: &f32| {
            let code = 255.0 * f64::from(response.encoded_from_linear(*light));
            (code + noise * random.normal()).round().clamp(0.0, 255.0) as u8
        };
        grey.data.iter().map(code).collect()
    }
}

/// Returns the lens of a typical webcam.
fn scene_lens(size: (u32, u32), random: &mut Random) -> Lens {
    let (w, h) = (f64::from(size.0), f64::from(size.1));
    let focal = DVec2::splat(w * random.between(0.9, 1.15));
    let centre = DVec2::new(w - 1.0, h - 1.0) * 0.5
        + DVec2::new(random.normal(), random.normal()) * 0.008 * w;
    let mut lens = Lens::ideal(LensModel::Brown, size, focal, centre);
    lens.coefficients[0] = random.between(-0.22, 0.05);
    lens.coefficients[1] = random.between(-0.05, 0.08);
    lens.coefficients[2] = random.between(-0.001, 0.001);
    lens.coefficients[3] = random.between(-0.001, 0.001);
    lens
}

fn environment_lens(mount: EnvironmentMount) -> Option<Lens> {
    let (size, focal) = ((480, 480), DVec2::splat(150.0));
    let lens = Lens::ideal(
        LensModel::KannalaBrandt,
        size,
        focal,
        DVec2::new(241.3, 238.1),
    );
    (mount != EnvironmentMount::None).then_some(lens)
}

/// Returns the pose of a camera that points upwards, on the table or on the rig's back.
fn environment_pose(mount: EnvironmentMount, random: &mut Random) -> RigidTransform {
    let tilt = DQuat::from_scaled_axis(random.normal3() * 0.05);
    match mount {
        EnvironmentMount::Carried => RigidTransform::new(
            tilt * DQuat::from_rotation_x(0.6 * PI),
            DVec3::new(0.0, -0.06, -0.04),
        ),
        _ => RigidTransform::new(tilt, DVec3::new(0.32, 0.28, 0.06)),
    }
}

/// Returns the tags: number 0 at the origin with its top to +Y, the others around it, every third
/// one on a stand.
fn tags(count: u32, random: &mut Random) -> Vec<Tag> {
    let side = f64::from(count).sqrt().ceil() as u32;
    // Cells nearest to the middle first, so that number 0 is in the middle.
    let mut cells: Vec<(i64, i64)> = (0..side * side)
        .map(|i| (i64::from(i % side), i64::from(i / side)))
        .collect();
    let middle = i64::from(side / 2);
    cells.sort_by_key(|(x, y)| (x - middle).pow(2) + (y - middle).pow(2));
    let position =
        |(x, y): (i64, i64)| DVec3::new((x - middle) as f64, (y - middle) as f64, 0.0) * 0.15;
    (0..count)
        .zip(cells)
        .map(|(id, cell)| {
            let jitter = DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.0);
            let at = position(cell) + jitter * 0.012;
            let map_from_tag = match id {
                0 => flat_on_table(0.0, DVec3::ZERO),
                _ if id % 3 == 2 => {
                    let stand = at + DVec3::Z * random.between(0.05, 0.08);
                    let tilt = DQuat::from_scaled_axis(DVec3::new(
                        random.between(0.3, 0.7),
                        random.between(-0.4, 0.4),
                        0.0,
                    ));
                    let flat = flat_on_table(0.3 * random.normal(), stand);
                    RigidTransform::new(tilt * flat.rotation, stand)
                }
                _ => flat_on_table(random.between(-PI, PI), at),
            };
            Tag {
                family: Family::Tag36h11,
                id,
                size: TAG_SIZE,
                map_from_tag,
            }
        })
        .collect()
}

/// Returns the printed panels, their centre and their maximum distance from it, metres.
fn panels(tags: &[Tag], board: Option<&Board>) -> (Vec<Panel>, DVec3, f64) {
    let panels: Vec<Panel> = match board {
        Some(Board::Chess {
            columns,
            rows,
            square,
        }) => vec![Panel::chess(
            (*columns, *rows),
            *square,
            flat_on_table(0.0, DVec3::ZERO),
        )],
        _ => tags
            .iter()
            .filter_map(|t| Panel::tag(t.family, t.id, t.size, t.map_from_tag))
            .collect(),
    };
    let corners: Vec<DVec3> = panels.iter().flat_map(Panel::corners).collect();
    let count = corners.len().max(1) as f64;
    let middle = corners.iter().sum::<DVec3>() / count;
    let extent = corners
        .iter()
        .map(|c| c.distance(middle))
        .fold(0.2, f64::max);
    (panels, middle, extent)
}

#[cfg(test)]
mod tests;
