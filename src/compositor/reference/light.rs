//! Sums over the dome lights.

use super::surface::{Surface, Visibility};
use glam::DVec3;
use penumbra_lighting::{LightKind, Lighting};
use std::f64::consts::PI;

/// Light on a real surface.
pub(super) struct OnPhantom {
    /// Light that virtual casters block.
    pub lost: DVec3,
    /// Light that arrives in the real scene.
    pub arriving: DVec3,
    /// Unshadowed light of the dome lights alone.
    pub open: DVec3,
}

/// Supan 2006, eq. 3, with `P_i` the fraction of light i that phantoms let through and `S_i` the
/// fraction that virtual casters do (0 or 1 for hard shadows):
///
/// ```text
///   R = Σ C_i · N·L_i · P_i · (1 − S_i)
///   E = Σ C_i · N·L_i · P_i  +  π · L_ground · (1 − N_z) / 2
/// ```
pub(super) fn on_phantom(
    surface: &Surface,
    visibility: &[Visibility],
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
    for (light, visibility) in lighting.lights.iter().zip(visibility) {
        let facing = f64::from(light.facing(surface.point, surface.normal.as_vec3()));
        let received = light.irradiance.as_dvec3() * facing;
        sums.open += received;
        sums.arriving += received * visibility.past_phantoms;
        sums.lost += received * (visibility.past_phantoms - visibility.past_both);
    }
    sums
}

/// Radiance leaving a diffuse virtual surface: from the sky and the compact sources, minus the
/// blocked light, plus interreflection between virtual surfaces and the irradiance from `lamps`.
pub(super) fn of_virtual(
    surface: &Surface,
    visibility: &[Visibility],
    lighting: &Lighting,
    lamps: DVec3,
) -> DVec3 {
    let mut irradiance = lighting
        .irradiance
        .irradiance(surface.normal.as_vec3())
        .as_dvec3();
    let (mut cells, mut hidden) = (DVec3::ZERO, DVec3::ZERO);
    for (light, visibility) in lighting.lights.iter().zip(visibility) {
        let facing = f64::from(light.facing(surface.point, surface.normal.as_vec3()));
        let received = light.irradiance.as_dvec3() * facing;
        if light.kind == LightKind::Compact {
            irradiance += received;
        } else {
            cells += received;
            hidden += received * (1.0 - visibility.past_virtual);
        }
        irradiance -= received * (1.0 - visibility.past_both);
    }
    let open = (1.0 - hidden / cells.max(DVec3::splat(1e-9))).clamp(DVec3::ZERO, DVec3::ONE);
    irradiance += cells * (with_bounces(open, surface.diffuse) - open);
    surface.diffuse * (irradiance + lamps).max(DVec3::ZERO) / PI + surface.emissive
}

/// Jimenez et al. 2016, eq. 10: the open fraction of the sky, corrected for interreflection between
/// surfaces of one colour, as a cubic of the open fraction.
fn with_bounces(open: DVec3, albedo: DVec3) -> DVec3 {
    let (a, b, c) = (
        2.0404 * albedo - 0.3324,
        -4.7951 * albedo + 0.6417,
        2.7552 * albedo + 0.6903,
    );
    open.max(((open * a + b) * open + c) * open)
}
