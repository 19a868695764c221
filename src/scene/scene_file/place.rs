//! Poses of a scene file.

use super::typed::Place;
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::RigidTransform;
use penumbra_strict_toml::Fault;

/// Maximum coordinate, metres.
pub(super) const MAX_COORDINATE: f64 = 1e5;

impl Place {
    /// Returns the pose given at the key `at`; missing values mean no translation or rotation.
    pub(super) fn placement(&self, at: &str) -> Result<RigidTransform, Fault> {
        let position = DVec3::from(self.position_m.unwrap_or_default());
        if !position.is_finite() || position.abs().max_element() > MAX_COORDINATE {
            return Err(Fault::new(
                format!("{at}.position_m"),
                "expected x, y, z within 100000 m",
            ));
        }
        Ok(RigidTransform::new(self.rotation(at)?, position))
    }

    fn rotation(&self, at: &str) -> Result<DQuat, Fault> {
        let wrong = |key: &str, reason: &str| Err(Fault::new(format!("{at}.{key}"), reason));
        let rotation = match (self.rotation_deg, self.rotation_wxyz) {
            (Some(_), Some(_)) => {
                return wrong("rotation_wxyz", "goes without rotation_deg; leave one out");
            }
            (None, Some([w, x, y, z])) => {
                let q = DQuat::from_xyzw(x, y, z, w);
                if !((0.99..=1.01).contains(&q.length())) {
                    return wrong("rotation_wxyz", "expected a unit quaternion w, x, y, z");
                }
                q.normalize()
            }
            (degrees, None) => {
                let [yaw, pitch, roll] = degrees.unwrap_or_default().map(f64::to_radians);
                DQuat::from_euler(EulerRot::ZYX, yaw, pitch, roll)
            }
        };
        if !rotation.is_finite() {
            return wrong(
                "rotation_deg",
                "expected three finite angles: yaw, pitch, roll",
            );
        }
        Ok(rotation)
    }
}
