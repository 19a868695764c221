//! Reads the lights of glTF files (KHR_lights_punctual).

use super::gltf_bytes::Fault;
use super::gltf_motion::z_up_from_y_up;
use crate::virtual_light::{VirtualLight, VirtualLightKey, VirtualLightKind};
use glam::{DMat4, DVec3, Vec3};
use gltf::khr_lights_punctual::{Kind, Light};

/// A lamp in the frame of its model.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelLamp {
    /// The node's name, else the light's.
    pub name: String,
    /// Distribution of its light. A spot falls off linearly with the angle instead of by the
    /// extension's squared ratio of cosines.
    pub kind: VirtualLightKind,
    /// Linear RGB, candela; of a directional light such that it has its lux at the model.
    pub candela: Vec3,
    /// Whether it is a directional light: a point light `FAR` away.
    pub parallel: bool,
    /// Model's frame (+Z up), metres.
    pub position: DVec3,
    /// Unit vector along which a spot emits, model's frame.
    pub direction: DVec3,
}

impl ModelLamp {
    /// Converts the lamp to the world and to scene camera units; the camera's white is `white` cd/m².
    #[must_use]
    pub fn placed(&self, world_from_model: DMat4, white: f64) -> VirtualLight {
        let mut position = world_from_model.transform_point3(self.position);
        let along = world_from_model.transform_vector3(self.direction);
        if self.parallel {
            position -= along.normalize_or(DVec3::NEG_Z) * FAR;
        }
        let aim = world_from_model.transform_point3(self.position + self.direction);
        VirtualLight {
            name: self.name.clone(),
            kind: self.kind,
            intensity: self.candela / white as f32,
            keys: vec![VirtualLightKey {
                seconds: 0.0,
                position,
                target: matches!(self.kind, VirtualLightKind::Spot { .. }).then_some(aim),
                gain: 1.0,
            }],
            repeat: None,
            screen: None,
        }
    }
}

/// Distance of a directional light, metres: over a scene of one metre the direction of its light
/// then varies by 0.001 rad and its irradiance by 0.2 %.
pub const FAR: f64 = 1000.0;

/// Reads the light of a node at `matrix` in glTF's frame.
pub(super) fn lamp(
    node: &gltf::Node<'_>,
    light: &Light<'_>,
    matrix: DMat4,
) -> Result<ModelLamp, Fault> {
    let name = node.name().or(light.name()).unwrap_or("light").to_owned();
    let kind = match light.kind() {
        Kind::Directional | Kind::Point => VirtualLightKind::Point,
        Kind::Spot {
            inner_cone_angle,
            outer_cone_angle,
        } => VirtualLightKind::Spot {
            beam: inner_cone_angle.into(),
            cutoff: outer_cone_angle.into(),
        },
    };
    if let VirtualLightKind::Spot { beam, cutoff } = kind
        && !(beam >= 0.0 && beam < cutoff && cutoff <= std::f64::consts::FRAC_PI_2 + 1e-6)
    {
        return Err(format!(
            "light `{name}`: expected 0 ≤ innerConeAngle < outerConeAngle ≤ π/2"
        ));
    }
    let parallel = matches!(light.kind(), Kind::Directional);
    let reach = if parallel { FAR * FAR } else { 1.0 };
    let candela = Vec3::from(light.color()) * light.intensity() * reach as f32;
    if !candela.is_finite() || candela.min_element() < 0.0 {
        return Err(format!(
            "light `{name}`: expected a colour and an intensity of 0 or more"
        ));
    }
    let z_up = z_up_from_y_up();
    let along = matrix.transform_vector3(DVec3::NEG_Z).try_normalize();
    let along = along.ok_or_else(|| format!("light `{name}`: its node has no size"))?;
    Ok(ModelLamp {
        name,
        kind,
        candela,
        parallel,
        position: z_up.transform_point3(matrix.w_axis.truncate()),
        direction: z_up.transform_vector3(along),
    })
}
