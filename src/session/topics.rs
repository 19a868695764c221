//! Names of the streams.

/// One of the two cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Camera {
    /// The camera whose picture is augmented.
    Scene,
    /// The camera that observes the environment's light.
    Environment,
}

impl Camera {
    /// The camera's coordinate frame, and the first part of its topics.
    #[must_use]
    pub const fn frame_id(self) -> &'static str {
        match self {
            Self::Scene => "scene_camera",
            Self::Environment => "environment_camera",
        }
    }

    /// Topic of the images of one exposure, coded (JPEG, PNG) or raw.
    pub(super) fn image_topic(self, bracket_ev: f64, raw: bool) -> String {
        let raw = if raw { "_raw" } else { "" };
        let bracket = if bracket_ev == 0.0 {
            String::new()
        } else {
            format!("_ev{bracket_ev:+}")
        };
        format!("/{}/image{raw}{bracket}", self.frame_id())
    }

    pub(super) fn exposure_topic(self) -> String {
        format!("/{}/exposure", self.frame_id())
    }

    pub(super) fn controls_topic(self) -> String {
        format!("/{}/controls", self.frame_id())
    }

    pub(super) fn calibration_topic(self) -> String {
        format!("/{}/calibration", self.frame_id())
    }
}

/// The stream that every session has.
pub(super) const SCENE_IMAGES: &str = "/scene_camera/image";
/// The live rig's journal: which pictures it prepared, when it stopped waiting. A file with a journal
/// is in the order of arrival.
pub(super) const JOURNAL: &str = "/rig/journal";
/// Raw bytes of the tracker.
pub(super) const TRACKER_BYTES: &str = "/tracker/bytes";
/// Poses of a tracker that is not a byte stream.
pub(super) const TRACKER_POSE: &str = "/tracker/pose";
/// The frame tree, for viewers.
pub(super) const FRAME_TREE: &str = "/tf";
/// Composited pictures, for viewers.
pub(super) const COMPOSITE: &str = "/composite/image";
/// Channel metadata: stops relative to the base exposure.
pub(super) const BRACKET_EV: &str = "bracket_ev";
/// Channel metadata: the tracker's protocol.
pub(super) const PROTOCOL: &str = "protocol";

/// Contents of a topic that is read back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Image(Camera),
    Exposure(Camera),
    Controls(Camera),
    TrackerBytes,
    TrackerPose,
    Journal,
}

impl Role {
    pub(super) fn from_topic(topic: &str) -> Option<Self> {
        match topic {
            TRACKER_BYTES => return Some(Self::TrackerBytes),
            TRACKER_POSE => return Some(Self::TrackerPose),
            JOURNAL => return Some(Self::Journal),
            _ => {}
        }
        let (camera, rest) =
            [Camera::Scene, Camera::Environment]
                .into_iter()
                .find_map(|camera| {
                    let rest = topic.strip_prefix('/')?.strip_prefix(camera.frame_id())?;
                    Some((camera, rest.strip_prefix('/')?))
                })?;
        let image = rest
            .strip_prefix("image")
            .map(|rest| rest.strip_prefix("_raw").unwrap_or(rest));
        match (rest, image) {
            ("exposure", _) => Some(Self::Exposure(camera)),
            ("controls", _) => Some(Self::Controls(camera)),
            (_, Some(bracket)) if bracket.is_empty() || bracket.starts_with("_ev") => {
                Some(Self::Image(camera))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recognises_every_written_topic() {
        for camera in [Camera::Scene, Camera::Environment] {
            for raw in [false, true] {
                for ev in [0.0, -4.0, 1.5] {
                    let topic = camera.image_topic(ev, raw);
                    assert_eq!(
                        Role::from_topic(&topic),
                        Some(Role::Image(camera)),
                        "{topic}"
                    );
                }
            }
            assert_eq!(
                Role::from_topic(&camera.exposure_topic()),
                Some(Role::Exposure(camera))
            );
            assert_eq!(
                Role::from_topic(&camera.controls_topic()),
                Some(Role::Controls(camera))
            );
            assert_eq!(Role::from_topic(&camera.calibration_topic()), None);
        }
        assert_eq!(
            Camera::Environment.image_topic(-4.0, false),
            "/environment_camera/image_ev-4"
        );
        assert_eq!(Camera::Scene.image_topic(0.0, false), SCENE_IMAGES);
        assert_eq!(Role::from_topic(FRAME_TREE), None);
        assert_eq!(Role::from_topic("/scene_camera/imagery"), None);
        assert_eq!(Role::from_topic(""), None);
    }
}
