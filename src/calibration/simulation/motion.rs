//! Hand motion of a simulated rig.

use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::Random;

/// Kind of motion of the hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Motion {
    /// Around the target with rotations about all axes, brisk and irregular.
    #[default]
    Free,
    /// Like `free`, but slow and without shaking.
    Slow,
    /// Rotation about the vertical axis through the target only.
    OneAxis,
    /// Translation without rotation.
    Slide,
    /// Periodic motion to and fro at one frequency.
    Pendulum,
    /// At rest.
    Still,
}

/// A hand that moves the rig in front of a target.
#[derive(Clone, Debug)]
pub struct Hand {
    motion: Motion,
    target: DVec3,
    distance: f64,
    /// Angular frequency (radians per second), phase and amplitude of each component's waves.
    waves: Vec<[(f64, f64, f64); 3]>,
}

/// Number of components of the motion: azimuth, elevation, distance, roll, yaw, pitch and shaking
/// about three axes.
const COMPONENTS: usize = 9;

impl Hand {
    /// Creates a hand that points the camera at `target` from about `distance` metres.
    #[must_use]
    pub fn new(motion: Motion, target: DVec3, distance: f64, random: &mut Random) -> Self {
        let waves = (0..COMPONENTS)
            .map(|component| {
                let is_shaking = component >= 6;
                std::array::from_fn(|_| {
                    let frequency = if is_shaking {
                        random.between(4.0, 11.0)
                    } else {
                        random.between(0.7, 2.6)
                    };
                    (
                        frequency,
                        random.between(0.0, std::f64::consts::TAU),
                        random.between(0.6, 1.0),
                    )
                })
            })
            .collect();
        Self {
            motion,
            target,
            distance,
            waves,
        }
    }

    /// Returns a component at `t` seconds, −1 to 1.
    fn wave(&self, component: usize, t: f64) -> f64 {
        let waves = &self.waves[component];
        let sum: f64 = waves.iter().map(|(w, p, a)| a * (w * t + p).sin()).sum();
        let total: f64 = waves.iter().map(|w| w.2).sum();
        sum / total
    }

    /// Returns `world_from_camera` at `t` seconds.
    #[must_use]
    pub fn at(&self, t: f64) -> RigidTransform {
        let wave = |i| self.wave(i, t);
        match self.motion {
            Motion::Free => self.pose(&std::array::from_fn(wave)),
            Motion::Slow => {
                let slow = |i| if i < 6 { self.wave(i, 0.6 * t) } else { 0.0 };
                self.pose(&std::array::from_fn(slow))
            }
            Motion::OneAxis => {
                let mut v = [0.0; COMPONENTS];
                v[0] = wave(0);
                self.pose(&v)
            }
            Motion::Slide => {
                let still = self.pose(&[0.0; COMPONENTS]);
                let shift = DVec3::new(wave(0), wave(1), 0.5 * wave(2)) * 0.3 * self.distance;
                RigidTransform::new(still.rotation, still.translation + shift)
            }
            Motion::Pendulum => {
                let mut v = [0.0; COMPONENTS];
                (v[0], v[3]) = ((9.0 * t).sin() * 0.3, (9.0 * t).cos() * 0.4);
                self.pose(&v)
            }
            Motion::Still => self.pose(&[0.0; COMPONENTS]),
        }
    }

    /// Returns the pose of these components.
    fn pose(&self, v: &[f64; COMPONENTS]) -> RigidTransform {
        let (azimuth, elevation) = (-1.6 + 0.9 * v[0], 0.95 + 0.4 * v[1]);
        let away = DVec3::new(
            azimuth.cos() * elevation.cos(),
            azimuth.sin() * elevation.cos(),
            elevation.sin(),
        );
        let position = self.target + away * self.distance * (1.0 + 0.28 * v[2]);
        let forward = -away;
        let right = forward.cross(DVec3::Z).normalize();
        let towards_target = DMat3::from_cols(right, forward.cross(right), forward);
        let deviation = DQuat::from_rotation_z(0.7 * v[3])
            * DQuat::from_rotation_y(0.12 * v[4])
            * DQuat::from_rotation_x(0.1 * v[5]);
        let shake = DQuat::from_scaled_axis(DVec3::new(v[6], v[7], v[8]) * 0.05);
        RigidTransform::new(
            (DQuat::from_mat3(&towards_target) * deviation * shake).normalize(),
            position,
        )
    }
}
