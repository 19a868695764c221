//! The files of a simulated rig: `rig.json`, as its owner would have it, and the ground truth.

use super::{EnvironmentMount, SimulatedRig};
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;
use serde_json::{Value, json};

/// Ground truth of one picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameTruth {
    /// The driver's time stamp, nanoseconds.
    pub stamp: i64,
    /// Middle of the exposure, nanoseconds.
    pub captured: i64,
    /// Pose of the camera.
    pub world_from_camera: RigidTransform,
}

fn pose(pose: RigidTransform) -> Value {
    let rows = pose.to_matrix().transpose().to_cols_array_2d();
    json!({ "matrix_row_major": rows })
}

fn pinhole(lens: &Lens) -> Value {
    json!({
        "image_size": [lens.width, lens.height],
        "K": [[lens.focal.x, 0.0, lens.centre.x], [0.0, lens.focal.y, lens.centre.y], [0.0, 0.0, 1.0]],
        "lens_distortion": &lens.coefficients[..5],
    })
}

impl SimulatedRig {
    /// Returns `rig.json`: the lenses, and the markers and the tracker if the options include them.
    #[must_use]
    pub fn rig_json(&self) -> Value {
        let is_known = self.options.known_tracker;
        let known_pose = |p: RigidTransform| {
            pose(if is_known {
                p
            } else {
                RigidTransform::IDENTITY
            })
        };
        let mut rig = json!({
            "name": format!("simulated rig {}", self.options.seed),
            "scene_camera": pinhole(self.scene.lens()),
            "tracker": {
                "T_world_source": known_pose(self.world_from_transmitter),
                "T_sensor_cam": known_pose(self.sensor_from_camera),
                "latency_s": if is_known { self.options.tracker_latency } else { 0.0 },
                "fastrak": { "units": "centimetres" },
            },
        });
        rig["scene_camera"]["latency_s"] = json!(self.options.camera_latency);
        if self.options.known_markers {
            rig["markers"] = self.markers();
        }
        if let Some(camera) = &self.environment {
            rig["environment_camera"] = self.environment_json(camera.lens());
        }
        rig
    }

    fn environment_json(&self, lens: &Lens) -> Value {
        json!({
            "kind": "fisheye",
            "image_size": [lens.width, lens.height],
            "projection": {
                "model": "equidistant", "f": lens.focal.x,
                "cx": lens.centre.x, "cy": lens.centre.y, "max_theta_rad": 1.55,
            },
            "T_world_cam": pose(self.world_from_environment(0.0)),
        })
    }

    fn markers(&self) -> Value {
        let marker = |t: &penumbra_fiducials::Tag| {
            json!({
                "family": t.family.to_string(), "id": t.id, "size_m": t.size,
                "T_world_marker": pose(t.map_from_tag),
            })
        };
        self.tags.iter().map(marker).collect()
    }

    /// Returns the ground truth of the rig and of `frames`.
    #[must_use]
    pub fn truth_json(&self, frames: &[FrameTruth]) -> Value {
        let frames: Vec<Value> = frames
            .iter()
            .map(|f| {
                json!({
                    "timestamp_ns": f.stamp, "capture_ns": f.captured,
                    "T_world_cam": pose(f.world_from_camera),
                })
            })
            .collect();
        json!({
            "seed": self.options.seed,
            "scene_camera": pinhole(self.scene.lens()),
            "scene_camera_latency_s": self.options.camera_latency,
            "tracker_latency_s": self.options.tracker_latency,
            "T_world_source": pose(self.world_from_transmitter),
            "T_sensor_cam": pose(self.sensor_from_camera),
            "markers": self.markers(),
            "environment_camera": (self.options.environment != EnvironmentMount::None)
                .then(|| pose(self.environment_pose)),
            "frames": frames,
        })
    }
}
