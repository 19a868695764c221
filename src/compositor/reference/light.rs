//! Sums over the dome lights.

use super::surface::{Reaching, Surface};
use glam::DVec3;
use penumbra_lighting::{LightKind, Lighting};
use std::f64::consts::PI;

/// Light on a real surface.
pub(super) struct OnPhantom {
    /// What virtual casters keep away.
    pub lost: DVec3,
    /// What arrives in the real scene.
    pub arriving: DVec3,
    /// What the dome lights alone would, without any shadow.
    pub open: DVec3,
}

/// Supan 2006, eq. 3, with `P_i` the share of light i that phantoms let through and `S_i`
/// the share that virtual casters do (0 or 1 for hard shadows):
///
/// ```text
///   R = Σ C_i · N·L_i · P_i · (1 − S_i)
///   E = Σ C_i · N·L_i · P_i  +  π · L_ground · (1 − N_z) / 2
/// ```
pub(super) fn on_phantom(
    surface: &Surface,
    reaching: &[Reaching],
    lighting: &Lighting,
    ground: bool,
) -> OnPhantom {
    let below = if ground {
        0.5 * (1.0 - surface.normal.z)
    } else {
        0.0
    };
    let mut sums = OnPhantom {
        lost: DVec3::ZERO,
        open: DVec3::ZERO,
        arriving: lighting.ground_radiance.as_dvec3() * (PI * below),
    };
    for (light, reaching) in lighting.lights.iter().zip(reaching) {
        let facing = surface.normal.dot(light.direction.as_dvec3()).max(0.0);
        let received = light.irradiance.as_dvec3() * facing;
        sums.open += received;
        sums.arriving += received * reaching.past_phantoms;
        sums.lost += received * (reaching.past_phantoms - reaching.past_both);
    }
    sums
}

/// Radiance leaving a diffuse virtual surface: the sky and the compact sources, less what
/// is hidden of either, what virtual surfaces throw at one another instead of the sky, and the
/// irradiance from `lamps`.
pub(super) fn of_virtual(
    surface: &Surface,
    reaching: &[Reaching],
    lighting: &Lighting,
    lamps: DVec3,
) -> DVec3 {
    let mut irradiance = lighting
        .irradiance
        .irradiance(surface.normal.as_vec3())
        .as_dvec3();
    let (mut cells, mut hidden) = (DVec3::ZERO, DVec3::ZERO);
    for (light, reaching) in lighting.lights.iter().zip(reaching) {
        let facing = surface.normal.dot(light.direction.as_dvec3()).max(0.0);
        let received = light.irradiance.as_dvec3() * facing;
        if light.kind == LightKind::Compact {
            irradiance += received;
        } else {
            cells += received;
            hidden += received * (1.0 - reaching.past_virtual);
        }
        irradiance -= received * (1.0 - reaching.past_both);
    }
    let open = (1.0 - hidden / cells.max(DVec3::splat(1e-9))).clamp(DVec3::ZERO, DVec3::ONE);
    irradiance += cells * (with_bounces(open, surface.diffuse) - open);
    surface.diffuse * (irradiance + lamps).max(DVec3::ZERO) / PI + surface.emissive
}

/// Jimenez et al. 2016, eq. 10: the open share of the sky with light between surfaces of
/// one colour, as a cubic of the open share alone.
fn with_bounces(open: DVec3, albedo: DVec3) -> DVec3 {
    let (a, b, c) = (
        2.0404 * albedo - 0.3324,
        -4.7951 * albedo + 0.6417,
        2.7552 * albedo + 0.6903,
    );
    open.max(((open * a + b) * open + c) * open)
}
