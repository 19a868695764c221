//! The shadow of the ball on the ground, and what it tells of the strength of lamps.
//!
//! Divided by the picture without the ball, the picture with it shows the shadow and no texture. At a point p of
//! the ground that ratio is
//!
//! ```text
//!   R(p) = (S(p) + Σ f a(p)) / (S₀ + Σ f a₀)
//! ```
//!
//! with the irradiance S by the sky, a by each lamp as it is known, and its factor f; with index 0 without the
//! ball. That is linear in the factors, and solved robustly (iteratively reweighted least squares with the
//! weights of Geman and McClure 1985): other things stand beside the ball.

use crate::Analysis;
use crate::ball::FINEST;
use crate::photograph::reduced;
use crate::placement::{GroundFrom, Placement, by_tilt};
use glam::{DQuat, DVec3, IVec2, Vec3};
use penumbra_camera::Response;
use penumbra_lighting::Harmonics;
use penumbra_lighting::lamp_distance::SeenLamp;
use penumbra_lighting::sources::LUMINANCE;
use penumbra_numerics::{Matrix, median};
use penumbra_picture::Picture;
use std::f32::consts::{PI, TAU};

/// Radius of the ball in the picture in which its shadow is measured, pixels.
const RADIUS: f64 = 24.0;
/// Distances from the ball's centre between which the ground is compared, radii. Closer, the ball's outline
/// and what it throws back spoil it.
const RANGE: std::ops::Range<f64> = 1.2..6.0;
/// Distance from which most of the ground has no shadow, radii.
const OUTSIDE: f64 = 4.5;
/// Distance between the compared points, pixels.
const SPACING: usize = 2;
/// Smallest code that may be clipped.
pub(crate) const WHITE: u8 = 250;
/// Light below which a pixel is too noisy; 1 is white.
const DARKEST: f32 = 0.004;
/// Rays by which a point sees the sky.
const RAYS: usize = 96;
/// Passes of the fit, and the least scale of its residuals, shares of the light without the ball.
const PASSES: usize = 12;
const LEAST_SCALE: f64 = 0.02;
/// Share of a lamp's light below which a point is in its shadow.
const LIT: f32 = 0.8;
/// Points that tell as much as one that is independent of all others.
const DEPENDENT: f64 = 25.0;
/// The same, and the distance between points, pixels, where the camera's tilt is searched.
const COARSE: usize = 4;
const DEPENDENT_COARSE: f64 = DEPENDENT * ((SPACING * SPACING) as f64) / ((COARSE * COARSE) as f64);
/// Least number of points.
const ENOUGH: usize = 200;
/// Difference of ratios that the search for the tilt takes for an error, and its greatest standard error, degrees.
const TOLERATED: f64 = 0.05;
const CERTAIN: f64 = 8.0;
/// Error of the ball's outline, pixels of the picture in which it is sought: 0.8 to 1.3 in path-traced photographs.
const OUTLINE_ERROR: f64 = 1.0;
/// Standard errors from which a factor is believed.
const LIKELY: f64 = 2.0;
/// Relative standard deviation of a lamp's factors on red, green and blue.
const COLOUR: f64 = 0.3;
/// Largest factor.
const MOST: f64 = 4096.0;

/// A point of the ground near the ball, as the pictures show it.
struct SeenPoint {
    /// Unit vector from the camera, in its frame.
    ray: DVec3,
    /// Its light with the ball over that without: red, green, blue, luminance.
    ratio: [f32; 4],
}

/// The light at the ball as it is known, in the world of the placement with which it was found.
pub(crate) struct KnownLight<'a> {
    /// The compact sources.
    pub lamps: &'a [SeenLamp],
    /// The irradiance by everything else.
    pub irradiance: &'a Harmonics,
    /// The numbers of those lamps whose strength is not known, and the least factor on it.
    pub unknown: &'a [(usize, f32)],
}

/// The ball as something that throws a shadow.
#[derive(Clone, Copy)]
pub(crate) struct Ball {
    /// World, metres.
    pub centre: DVec3,
    /// Metres.
    pub radius: f64,
    /// Linear reflectance.
    pub reflectance: Vec3,
}

impl Ball {
    /// Returns where a ray first meets it, as a share of the ray's direction.
    pub fn met(&self, origin: DVec3, to: DVec3) -> Option<f64> {
        let from = origin - self.centre;
        let (a, b) = (to.length_squared(), from.dot(to));
        let root = b * b - a * (from.length_squared() - self.radius * self.radius);
        let share = (-b - root.max(0.0).sqrt()) / a;
        (root >= 0.0 && share > 0.0).then_some(share)
    }

    /// Returns the direction in which it reflects a ray that meets it; unit vector.
    pub fn reflected(&self, origin: DVec3, to: DVec3) -> Option<DVec3> {
        let at = origin + to * self.met(origin, to)?;
        Some(to.normalize().reflect((at - self.centre) / self.radius))
    }
}

/// The factor on the light of a lamp that the shadow tells, RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ToldFactor {
    pub rgb: Vec3,
    /// Standard error of the factor on its luminance.
    pub sigma: f32,
}

/// Irradiance at the compared points, red, green, blue, luminance: with the ball, and without.
struct Light {
    with: Vec<[f32; 4]>,
    without: [f32; 4],
}

impl Analysis {
    /// Returns the ball where `placement` has it.
    pub(crate) fn ball_at(&self, placement: &Placement) -> Ball {
        Ball {
            centre: placement.ball,
            radius: self.ball_radius,
            reflectance: self.reflectance.into(),
        }
    }

    /// Returns the factors on the light of the unknown lamps, in their order, with which the ball's shadow is as
    /// deep as in the photographs. A lamp has the least one if the shadow does not tell it. `None` if no shadow
    /// can be measured.
    pub(crate) fn factors_by_shadow(&self, light: &KnownLight<'_>) -> Option<Vec<ToldFactor>> {
        let seen = self.shadow_seen(SPACING)?;
        let model = self.model(&self.placement, &seen, light);
        model.told(model.fit()?)
    }

    /// Returns where camera, ground and ball are if the ball's shadow shall fall where the photographs show it;
    /// `None` if it does not tell.
    pub(crate) fn placement_by_shadow(&self, light: &KnownLight<'_>) -> Option<Placement> {
        let seen = self.shadow_seen(COARSE)?;
        let at = |tilt: f64, ground| by_tilt(&self.ball, self.ball_radius, tilt, ground).ok();
        let loss_at = |tilt: f64| {
            let model = self.model(&at(tilt, GroundFrom::Assumed)?, &seen, light);
            let residuals = model.residuals(&model.fit()?.factors);
            let losses = residuals.iter().map(|r| (r / TOLERATED).powi(2));
            Some(losses.map(|l| l / (1.0 + l)).sum::<f64>() / DEPENDENT_COARSE)
        };
        let all = |tilts: &[f64]| -> Vec<(f64, f64)> {
            let with_loss = tilts.iter().filter_map(|t| Some((*t, loss_at(*t)?)));
            with_loss.collect()
        };
        let coarse: Vec<f64> = (1..=21).map(|k| 4.0 * f64::from(k)).collect();
        let around = least(&all(&coarse))?.0;
        let fine: Vec<f64> = (-8..=8).map(|k| around + f64::from(k)).collect();
        let fine = all(&fine);
        let (tilt, loss) = least(&fine)?;
        // As likely as one standard error beside the best.
        let likely = fine
            .iter()
            .filter(|(_, l)| *l < loss + 1.0)
            .map(|(t, _)| *t);
        let [first, last] = [f64::min, f64::max].map(|end| likely.clone().fold(tilt, end));
        let is_inner = fine.first()?.0 < first && last < fine.last()?.0;
        let by_shadow = (0.5 * (last - first)).max(1.0);
        // The normal of the ball where it shows a lamp is wrong by as much as its outline, and turns its
        // reflection twice as far.
        let by_outline = (2.0 * OUTLINE_ERROR / self.ball.circle.radius.min(FINEST)).to_degrees();
        let sigma = by_shadow.hypot(by_outline);
        let ground = GroundFrom::Shadow {
            sigma_degrees: sigma,
        };
        let is_told = is_inner && sigma < CERTAIN;
        is_told.then(|| at(0.5 * (first + last), ground)).flatten()
    }

    /// Returns how the ball changes the light of the ground around it, at points this many pixels apart; `None`
    /// if too little of it is seen.
    fn shadow_seen(&self, spacing: usize) -> Option<Vec<SeenPoint>> {
        let with = self.balls.first()?;
        let factor = (self.ball.circle.radius / RADIUS).max(1.0) as u32;
        let pictures = [&self.empty.picture, &with.photograph.picture].map(|p| reduced(p, factor));
        let shift = (with.shift.as_dvec2() / f64::from(factor))
            .round()
            .as_ivec2();
        let circle = crate::session::reduced_circle(&self.ball, f64::from(factor));
        let along = |centre: f64| {
            let reach = RANGE.end * circle.radius;
            ((centre - reach) as i32..(centre + reach) as i32).step_by(spacing)
        };
        let all = along(circle.centre.y)
            .flat_map(|y| along(circle.centre.x).map(move |x| IVec2::new(x, y)));
        let (mut points, mut outside) = (Vec::new(), Vec::new());
        for at in all {
            let distance = at.as_dvec2().distance(circle.centre) / circle.radius;
            if !RANGE.contains(&distance) {
                continue;
            }
            let light = |k: usize, at| self.light_of_pixels(&pictures[k], at).map(values);
            let (Some(empty), Some(with)) = (light(0, at), light(1, at + shift)) else {
                continue;
            };
            if empty.iter().chain(&with).all(|light| *light > DARKEST) {
                let ratio: [f32; 4] = std::array::from_fn(|c| with[c] / empty[c]);
                let pixel = (at.as_dvec2() + 0.5) * f64::from(factor) - 0.5;
                let ray = self.camera.unproject(pixel);
                points.push(SeenPoint { ray, ratio });
                outside.extend((distance > OUTSIDE).then_some(ratio));
            }
        }
        // Exposures are rounded.
        for channel in 0..4 {
            let unchanged = median(outside.iter().map(|ratio| f64::from(ratio[channel])))? as f32;
            points
                .iter_mut()
                .for_each(|p| p.ratio[channel] /= unchanged);
        }
        (points.len() > ENOUGH).then_some(points)
    }

    /// Returns what the light predicts of points of the ground.
    fn model<'a>(
        &self,
        placement: &Placement,
        seen: &'a [SeenPoint],
        light: &KnownLight<'_>,
    ) -> Model<'a> {
        let ball = self.ball_at(placement);
        let pose = placement.world_from_camera;
        let here_from_known = pose.rotation * self.placement.world_from_camera.rotation.inverse();
        let on_ground = |point: &SeenPoint| {
            let (origin, ray) = (pose.translation, pose.rotation * point.ray);
            let share = -origin.z / ray.z;
            (share > 0.0 && share.is_finite()).then(|| origin + ray * share)
        };
        let points: Vec<Option<DVec3>> = seen.iter().map(on_ground).collect();
        let sky = Sky::new(light.irradiance, here_from_known);
        let open: Vec<(Vec3, f32)> = points.iter().map(|p| sky.seen(*p, &ball)).collect();
        let mut rest = Light {
            with: open.iter().map(|(light, _)| values(*light)).collect(),
            without: values(sky.all()),
        };
        let of = |lamp: &SeenLamp| light_of(lamp, here_from_known, (&points, &open), &ball);
        for (k, lamp) in light.lamps.iter().enumerate() {
            if light.unknown.iter().all(|(number, _)| *number != k) {
                rest.add(&of(lamp));
            }
        }
        Model {
            points: seen,
            rest,
            lamps: light
                .unknown
                .iter()
                .map(|(k, _)| of(&light.lamps[*k]))
                .collect(),
            least: light
                .unknown
                .iter()
                .map(|(_, least)| f64::from(*least))
                .collect(),
        }
    }

    /// Returns the mean light around a pixel; `None` outside, and where one may be clipped.
    fn light_of_pixels(&self, picture: &Picture, at: IVec2) -> Option<Vec3> {
        let is_clear = |codes: [u8; 3]| codes.iter().all(|code| *code < WHITE);
        let pixels = nine(picture, at)?;
        let is_seen = pixels.iter().all(|codes| is_clear(*codes));
        is_seen.then(|| mean_light(&pixels, &self.tone.response))
    }
}

/// Returns the codes of 3 × 3 pixels, in which noise and grain do not select the pixels; `None` at the picture's border
/// and outside.
pub(crate) fn nine(picture: &Picture, at: IVec2) -> Option<[[u8; 3]; 9]> {
    let end = IVec2::new(picture.width as i32, picture.height as i32) - 1;
    if at.min_element() < 1 || at.cmpge(end).any() {
        return None;
    }
    let pixel = |i: usize| at + IVec2::new(i as i32 % 3 - 1, i as i32 / 3 - 1);
    let codes = |at: IVec2| picture.rgb(at.x as u32, at.y as u32);
    Some(std::array::from_fn(|i| codes(pixel(i))))
}

/// Returns the mean light of pixels.
pub(crate) fn mean_light(pixels: &[[u8; 3]; 9], response: &Response) -> Vec3 {
    let light = pixels.map(|codes| Vec3::from(response.linear_from_rgb(codes)));
    light.iter().sum::<Vec3>() / 9.0
}

impl Light {
    fn add(&mut self, other: &Self) {
        let add = |to: &mut [f32; 4], light: &[f32; 4]| {
            to.iter_mut().zip(light).for_each(|(a, b)| *a += b)
        };
        self.with
            .iter_mut()
            .zip(&other.with)
            .for_each(|(to, light)| add(to, light));
        add(&mut self.without, &other.without);
    }
}

/// The sky above the ground, by rays that each bring the same share of a uniform sky's irradiance.
struct Sky<'a> {
    harmonics: &'a Harmonics,
    /// From the world of the ball into that of the harmonics.
    rotation: DQuat,
    /// Directions, and the irradiance that comes from there.
    rays: Vec<(DVec3, Vec3)>,
}

impl<'a> Sky<'a> {
    fn new(harmonics: &'a Harmonics, here_from_known: DQuat) -> Self {
        let golden = PI * (3.0 - 5f32.sqrt());
        let mut sky = Self {
            harmonics,
            rotation: here_from_known.inverse(),
            rays: Vec::new(),
        };
        let ray = |k: usize| {
            let share = (k as f32 + 0.5) / RAYS as f32;
            let turn = (golden * k as f32) % TAU;
            let across = share.sqrt();
            let to = Vec3::new(
                across * turn.cos(),
                across * turn.sin(),
                (1.0 - share).sqrt(),
            );
            (to.as_dvec3(), sky.of_ray(to.as_dvec3()))
        };
        sky.rays = (0..RAYS).map(ray).collect();
        sky
    }

    /// The irradiance by one of the rays.
    fn of_ray(&self, to: DVec3) -> Vec3 {
        let radiance = self.harmonics.radiance((self.rotation * to).as_vec3());
        radiance.max(Vec3::ZERO) * (PI / RAYS as f32)
    }

    fn all(&self) -> Vec3 {
        self.rays.iter().map(|(_, light)| *light).sum()
    }

    /// Returns the irradiance of a point of the ground, with what the ball reflects in place of what it hides,
    /// and the share of the rays that meet the ball. Where there is no ground, the ball changes nothing.
    fn seen(&self, at: Option<DVec3>, ball: &Ball) -> (Vec3, f32) {
        let Some(at) = at else {
            return (self.all(), 0.0);
        };
        let (mut sum, mut met) = (Vec3::ZERO, 0.0);
        for (to, light) in &self.rays {
            sum += match ball.reflected(at, *to) {
                None => *light,
                Some(mirrored) => {
                    met += 1.0 / RAYS as f32;
                    ball.reflectance * self.of_ray(mirrored)
                }
            };
        }
        (sum, met)
    }
}

/// Returns the light of a lamp at points of the ground, with what they see of the sky.
fn light_of(
    lamp: &SeenLamp,
    here_from_known: DQuat,
    (points, open): (&[Option<DVec3>], &[(Vec3, f32)]),
    ball: &Ball,
) -> Light {
    let light = lamp.source.irradiance;
    let turned = lamp
        .parts
        .iter()
        .map(|part| here_from_known * part.as_dvec3());
    let parts: Vec<DVec3> = turned.collect();
    let cosine = |part: &DVec3| part.z.max(0.0);
    let of_all = |sum: f64| (sum / parts.len().max(1) as f64) as f32;
    let with = points.iter().zip(open).map(|(point, (_, met))| {
        let is_seen = |part: &&DVec3| point.is_none_or(|at| ball.met(at, **part).is_none());
        let direct = of_all(parts.iter().filter(is_seen).map(cosine).sum());
        // A mirrored ball throws the light of a lamp evenly into all directions: its mean radiance is that of
        // a white ball, over 4.
        values(light * (direct + 0.25 * met * ball.reflectance))
    });
    Light {
        with: with.collect(),
        without: values(light * of_all(parts.iter().map(cosine).sum())),
    }
}

/// The tilt with the least loss.
fn least(all: &[(f64, f64)]) -> Option<(f64, f64)> {
    all.iter().copied().min_by(|a, b| a.1.total_cmp(&b.1))
}

/// Red, green, blue and luminance of linear light.
fn values(light: Vec3) -> [f32; 4] {
    [light.x, light.y, light.z, light.dot(LUMINANCE)]
}

const LUMINANCE_OF: usize = 3;

/// Factors on the luminance of lamps.
struct Fitted {
    factors: Vec<f64>,
    /// Their standard errors.
    sigmas: Vec<f64>,
    /// Weights of the points.
    weights: Vec<f64>,
}

/// What light predicts of the points, and what is not known of it.
struct Model<'a> {
    points: &'a [SeenPoint],
    rest: Light,
    /// The lamps whose factors are not known.
    lamps: Vec<Light>,
    least: Vec<f64>,
}

impl Model<'_> {
    /// Fits the factors on the lamps' luminance.
    fn fit(&self) -> Option<Fitted> {
        // The ground outside of all shadows tells nothing, and hides how large residuals are within them.
        let in_shadow: Vec<f64> = (0..self.points.len()).map(|i| self.in_shadow(i)).collect();
        let mut fitted = Fitted {
            factors: vec![1.0; self.lamps.len()],
            sigmas: Vec::new(),
            weights: in_shadow.clone(),
        };
        // Nothing is searched where nothing is unknown.
        let passes = if self.lamps.is_empty() { 0 } else { PASSES };
        for pass in 0..passes {
            let light = self.without(LUMINANCE_OF, &fitted.factors);
            let solved = self.solved((LUMINANCE_OF, light), &fitted.weights, None)?;
            (fitted.factors, fitted.sigmas) = solved;
            let residuals = self.residuals(&fitted.factors);
            let all = residuals.iter().zip(&in_shadow);
            let of_shadow = all.clone().filter(|(_, is)| **is > 0.0);
            let spread = 1.5 * median(of_shadow.map(|(r, _)| r.abs()))?;
            // Wide at first, so that the shadow itself is not taken for an error.
            let scale = spread.max(LEAST_SCALE).max(0.3 * 0.7f64.powi(pass as i32));
            let weight = |r: f64| (1.0 + (r / scale).powi(2)).powi(-2);
            let share = (scale * scale * DEPENDENT).recip();
            fitted.weights = all.map(|(r, is)| is * share * weight(*r)).collect();
        }
        Some(fitted)
    }

    /// Returns the factors that the shadow tells, with their colours.
    fn told(&self, fitted: Fitted) -> Option<Vec<ToldFactor>> {
        let Fitted {
            factors,
            sigmas,
            weights,
        } = fitted;
        let is_told = |k: usize| factors[k] - LIKELY * sigmas[k] > self.least[k];
        let luminance: Vec<f64> = (0..factors.len())
            .map(|k| {
                if is_told(k) {
                    factors[k]
                } else {
                    self.least[k]
                }
            })
            .collect();
        let channel = |c: usize| {
            let light = self.without(c, &luminance);
            self.solved((c, light), &weights, Some(&luminance))
                .map(|(found, _)| found)
        };
        let rgb = [channel(0)?, channel(1)?, channel(2)?];
        let found = (0..factors.len()).map(|k| {
            let of_channel = |c: usize| if is_told(k) { rgb[c][k] } else { self.least[k] };
            ToldFactor {
                rgb: Vec3::from_array([0, 1, 2].map(|c| of_channel(c) as f32)),
                sigma: sigmas[k] as f32,
            }
        });
        Some(found.collect())
    }

    /// 1 at a point to which the ball hides much of a lamp, else 0.
    fn in_shadow(&self, i: usize) -> f64 {
        let is_hidden =
            |lamp: &Light| lamp.with[i][LUMINANCE_OF] < LIT * lamp.without[LUMINANCE_OF];
        f64::from(u8::from(self.lamps.iter().any(is_hidden)))
    }

    /// The predicted ratio at each point less the seen one.
    fn residuals(&self, factors: &[f64]) -> Vec<f64> {
        let without = self.without(LUMINANCE_OF, factors);
        let each = self.points.iter().enumerate().map(|(i, p)| {
            let lamps = self.lamps.iter().zip(factors);
            let light = lamps
                .map(|(lamp, f)| f * f64::from(lamp.with[i][LUMINANCE_OF]))
                .sum::<f64>();
            (light + f64::from(self.rest.with[i][LUMINANCE_OF])) / without
                - f64::from(p.ratio[LUMINANCE_OF])
        });
        each.collect()
    }

    fn without(&self, channel: usize, factors: &[f64]) -> f64 {
        let lamps = self.lamps.iter().zip(factors);
        let light: f64 = lamps
            .map(|(lamp, f)| f * f64::from(lamp.without[channel]))
            .sum();
        (light + f64::from(self.rest.without[channel])).max(1e-9)
    }

    /// The factors in a channel, in which the ground has about so much light, and their standard errors, within
    /// their limits; `beside` are those of luminance, from which those of colours do not differ much.
    fn solved(
        &self,
        (channel, scale): (usize, f64),
        weights: &[f64],
        beside: Option<&[f64]>,
    ) -> Option<(Vec<f64>, Vec<f64>)> {
        let n = self.lamps.len();
        let (mut normal, mut right) = (Matrix::zeros(n, n), vec![0.0; n]);
        for (i, point) in self.points.iter().enumerate() {
            let ratio = f64::from(point.ratio[channel]);
            let change = |light: &Light| {
                (f64::from(light.with[i][channel]) - ratio * f64::from(light.without[channel]))
                    / scale
            };
            let row: Vec<f64> = self.lamps.iter().map(change).collect();
            normal.add_outer(weights[i], &row, &row);
            let value = -weights[i] * change(&self.rest);
            right
                .iter_mut()
                .zip(&row)
                .for_each(|(sum, a)| *sum += value * a);
        }
        for k in 0..n {
            let sigma = beside.map_or(MOST, |beside| COLOUR * beside[k]);
            normal[(k, k)] += sigma.powi(-2);
            right[k] += sigma.powi(-2) * beside.map_or(0.0, |beside| beside[k]);
        }
        let sigmas = normal.cholesky()?.inverse();
        let sigmas = (0..n).map(|k| sigmas[(k, k)].max(0.0).sqrt()).collect();
        Some((self.within_limits(&normal, &right)?, sigmas))
    }

    /// Solves the normal equations; those that would be below their limits stay there.
    fn within_limits(&self, normal: &Matrix, right: &[f64]) -> Option<Vec<f64>> {
        let n = right.len();
        let mut fixed: Vec<Option<f64>> = vec![None; n];
        loop {
            let (mut a, mut b) = (normal.clone(), right.to_vec());
            for k in 0..n {
                let Some(value) = fixed[k] else { continue };
                for j in 0..n {
                    b[j] -= normal[(j, k)] * value;
                    a[(j, k)] = 0.0;
                    a[(k, j)] = 0.0;
                }
                a[(k, k)] = 1.0;
            }
            fixed
                .iter()
                .enumerate()
                .for_each(|(k, value)| b[k] = value.unwrap_or(b[k]));
            let found = a.cholesky()?.solve(&b);
            let below = (0..n).filter(|k| fixed[*k].is_none() && found[*k] < self.least[*k]);
            let Some(worst) = below.min_by(|j, k| found[*j].total_cmp(&found[*k])) else {
                return Some(found.into_iter().map(|f| f.min(MOST)).collect());
            };
            fixed[worst] = Some(self.least[worst]);
        }
    }
}

#[cfg(test)]
mod tests;
