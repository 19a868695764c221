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

#[derive(Clone, Copy, Debug)]
struct Plate {
    place: DVec3,
    shift: DVec3,
    turn: DVec3,
    reach: f64,
}

impl Metal {
    /// Two plates beside a working volume round `middle` (transmitter's frame) which shift what
    /// is read by some `metres` there.
    #[must_use]
    pub fn beside(middle: DVec3, metres: f64, random: &mut Random) -> Self {
        let plates = (0..2).map(|_| {
            let away = random.normal3().normalize_or(DVec3::X);
            let reach = random.between(0.5, 0.7);
            Plate {
                place: middle + away * reach,
                shift: random.normal3().normalize_or(DVec3::Y) * metres,
                turn: random.normal3() * metres * 1.2,
                reach,
            }
        });
        Self {
            plates: plates.collect(),
        }
    }

    /// Returns the measurement of a pose, `transmitter_from_sensor`.
    #[must_use]
    pub fn read(&self, pose: RigidTransform) -> RigidTransform {
        let (mut shift, mut turn) = (DVec3::ZERO, DVec3::ZERO);
        for plate in &self.plates {
            let near = plate.reach / pose.translation.distance(plate.place).max(0.15);
            shift += plate.shift * near.powi(3);
            turn += plate.turn * near.powi(3);
        }
        RigidTransform::new(
            (DQuat::from_scaled_axis(turn) * pose.rotation).normalize(),
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
