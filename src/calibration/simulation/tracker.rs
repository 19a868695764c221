//! The tracker of a simulated rig: measurements of an electromagnetic tracker.

use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;
use penumbra_numerics::Random;

/// Distortion of the transmitter's field by metal, modelled as induced dipoles (Nixon et al., "The
/// effects of metals and interfering fields on electromagnetic trackers", Presence 1998).
#[derive(Clone, Debug, Default)]
pub struct Metal {
    plates: Vec<Plate>,
}

/// A metal plate; its effect decays with the cube of the distance.
#[derive(Clone, Copy, Debug)]
struct Plate {
    /// Position in the transmitter's frame, metres.
    position: DVec3,
    /// Displacement of readings at the reference distance, metres.
    shift: DVec3,
    /// Rotation vector of readings at the reference distance, radians.
    rotation: DVec3,
    /// Distance from the middle of the working volume, metres.
    reference_distance: f64,
}

impl Metal {
    /// Creates two plates near a working volume around `middle` (transmitter's frame). Each displaces
    /// readings there by `metres`.
    #[must_use]
    pub fn near(middle: DVec3, metres: f64, random: &mut Random) -> Self {
        let plates = (0..2).map(|_| {
            let direction = random.normal3().normalize_or(DVec3::X);
            let reference_distance = random.between(0.5, 0.7);
            Plate {
                position: middle + direction * reference_distance,
                shift: random.normal3().normalize_or(DVec3::Y) * metres,
                rotation: random.normal3() * metres * 1.2,
                reference_distance,
            }
        });
        Self {
            plates: plates.collect(),
        }
    }

    /// Returns the distorted measurement of a pose, `transmitter_from_sensor`.
    #[must_use]
    pub fn distort(&self, pose: RigidTransform) -> RigidTransform {
        let (mut shift, mut rotation) = (DVec3::ZERO, DVec3::ZERO);
        for plate in &self.plates {
            let distance = pose.translation.distance(plate.position).max(0.15);
            let strength = (plate.reference_distance / distance).powi(3);
            shift += plate.shift * strength;
            rotation += plate.rotation * strength;
        }
        RigidTransform::new(
            (DQuat::from_scaled_axis(rotation) * pose.rotation).normalize(),
            pose.translation + shift,
        )
    }
}

/// Returns a FASTRAK's record of a pose in its default ASCII format, centimetres (manual
/// OPM00PI002).
#[must_use]
pub fn fastrak_record(pose: RigidTransform) -> String {
    let p = pose.translation * 100.0;
    let (a, e, r) = pose.rotation.to_euler(EulerRot::ZYX);
    let [a, e, r] = [a, e, r].map(f64::to_degrees);
    format!(
        "01 {:7.2}{:7.2}{:7.2}{a:7.2}{e:7.2}{r:7.2}\r\n",
        p.x, p.y, p.z
    )
}
