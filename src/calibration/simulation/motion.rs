//! Hand motion of a simulated rig.

use glam::{DMat3, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_numerics::Random;

/// What kind of motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Motion {
    /// Round what is to be seen, with turns about all axes, brisk and uneven.
    #[default]
    Free,
    /// The same, slowly: no shaking.
    Slow,
    /// Turns about the vertical through what is to be seen, and nothing else.
    OneAxis,
    /// Shifts without turns.
    Slide,
    /// To and fro at one pace.
    Pendulum,
    /// At rest.
    Still,
}

/// One hand.
#[derive(Clone, Debug)]
pub struct Hand {
    motion: Motion,
    target: DVec3,
    distance: f64,
    waves: Vec<[(f64, f64, f64); 3]>,
}

/// Freedoms that are waved: azimuth, elevation, distance, roll, look aside, look up, and shakes
/// about three axes.
const FREEDOMS: usize = 9;

impl Hand {
    /// A hand that shows the camera what stands at `target` from so many metres.
    #[must_use]
    pub fn new(motion: Motion, target: DVec3, distance: f64, random: &mut Random) -> Self {
        let waves = (0..FREEDOMS)
            .map(|freedom| {
                let fast = freedom >= 6;
                std::array::from_fn(|_| {
                    let pace = if fast {
                        random.between(4.0, 11.0)
                    } else {
                        random.between(0.7, 2.6)
                    };
                    (
                        pace,
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

    /// Between −1 and 1.
    fn wave(&self, freedom: usize, t: f64) -> f64 {
        let waves = &self.waves[freedom];
        let sum: f64 = waves.iter().map(|(w, p, a)| a * (w * t + p).sin()).sum();
        let most: f64 = waves.iter().map(|w| w.2).sum();
        sum / most
    }

    /// `world_from_camera` at seconds.
    #[must_use]
    pub fn at(&self, t: f64) -> RigidTransform {
        let wave = |i| self.wave(i, t);
        match self.motion {
            Motion::Free => self.posed(&std::array::from_fn(wave)),
            Motion::Slow => {
                let slow = |i| if i < 6 { self.wave(i, 0.6 * t) } else { 0.0 };
                self.posed(&std::array::from_fn(slow))
            }
            Motion::OneAxis => {
                let mut v = [0.0; FREEDOMS];
                v[0] = wave(0);
                self.posed(&v)
            }
            Motion::Slide => {
                let still = self.posed(&[0.0; FREEDOMS]);
                let aside = DVec3::new(wave(0), wave(1), 0.5 * wave(2)) * 0.3 * self.distance;
                RigidTransform::new(still.rotation, still.translation + aside)
            }
            Motion::Pendulum => {
                let mut v = [0.0; FREEDOMS];
                (v[0], v[3]) = ((9.0 * t).sin() * 0.3, (9.0 * t).cos() * 0.4);
                self.posed(&v)
            }
            Motion::Still => self.posed(&[0.0; FREEDOMS]),
        }
    }

    fn posed(&self, v: &[f64; FREEDOMS]) -> RigidTransform {
        let (azimuth, elevation) = (-1.6 + 0.9 * v[0], 0.95 + 0.4 * v[1]);
        let away = DVec3::new(
            azimuth.cos() * elevation.cos(),
            azimuth.sin() * elevation.cos(),
            elevation.sin(),
        );
        let place = self.target + away * self.distance * (1.0 + 0.28 * v[2]);
        let forward = -away;
        let right = forward.cross(DVec3::Z).normalize();
        let looking = DMat3::from_cols(right, forward.cross(right), forward);
        let aside = DQuat::from_rotation_z(0.7 * v[3])
            * DQuat::from_rotation_y(0.12 * v[4])
            * DQuat::from_rotation_x(0.1 * v[5]);
        let shake = DQuat::from_scaled_axis(DVec3::new(v[6], v[7], v[8]) * 0.05);
        RigidTransform::new(
            (DQuat::from_mat3(&looking) * aside * shake).normalize(),
            place,
        )
    }
}
