//! The bright pixels of a picture and the directions of lights.
//!
//! The weight of a pixel rises from 0 at a quarter of the maximum to 1 at three quarters, so that
//! pixels at a rim count by how much of them is covered. Centres are means of directions weighted by
//! solid angle, so that a window has the same centre through any lens and in any mirror. The panes of a
//! window are one light.

use super::super::intrinsics::Grey;
use glam::{DVec2, DVec3};
use penumbra_camera::Response;
use penumbra_picture::Picture;

/// Maximum share of bright pixels: a picture with more has no lights.
const MAX_SHARE: f64 = 0.2;
/// Minimum ratio of a light's brightness to the picture's median.
const ABOVE_MEDIAN: f32 = 4.0;
/// Maximum number of lights in a picture.
const MAX_LIGHTS: usize = 12;

/// The bright pixels of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BrightPixels {
    width: usize,
    height: usize,
    /// Position and weight, 0 to 1.
    pixels: Vec<(u16, u16, f32)>,
}

/// A light in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Unit vector towards its centre, in the frame of the given directions.
    pub direction: DVec3,
    /// Solid angle, steradians.
    pub solid_angle: f64,
    /// Centre, pixels.
    pub pixel: DVec2,
    /// Sum of the pixels' weights.
    pub count: f64,
}

impl Light {
    /// Returns the radius of a disc of equal solid angle, radians.
    #[must_use]
    pub fn radius(&self) -> f64 {
        (self.solid_angle / std::f64::consts::PI).sqrt()
    }
}

impl BrightPixels {
    /// Finds the bright pixels of a picture from a camera with this response; there are none if
    /// nothing stands out.
    #[must_use]
    pub fn new(picture: &Picture, response: &Response) -> Self {
        let linear = response.linear_from_code();
        let light = |p: &[u8]| {
            let at = |c: usize| linear[usize::from(p[c])];
            0.2126 * at(0) + 0.7152 * at(1) + 0.0722 * at(2)
        };
        let values: Vec<f32> = picture.rgba.chunks_exact(4).map(light).collect();
        let mut some: Vec<f32> = values
            .iter()
            .step_by((values.len() / 5000).max(1))
            .copied()
            .collect();
        some.sort_unstable_by(f32::total_cmp);
        let median = some.get(some.len() / 2).copied().unwrap_or(1.0);
        let peak = values.iter().copied().fold(0.0, f32::max);
        let mut out = Self {
            width: picture.width as usize,
            height: picture.height as usize,
            pixels: Vec::new(),
        };
        let threshold = (0.25 * peak).max(ABOVE_MEDIAN * median);
        if peak < 0.2
            || threshold > 0.6 * peak
            || out.width.max(out.height) > usize::from(u16::MAX)
            || out.width == 0
        {
            return out;
        }
        let max_count = (MAX_SHARE * values.len() as f64) as usize;
        for (i, v) in values.iter().enumerate().filter(|(_, v)| **v > threshold) {
            let share = ((v - threshold) / (0.5 * peak)).min(1.0);
            out.pixels
                .push(((i % out.width) as u16, (i / out.width) as u16, share));
            if out.pixels.len() > max_count {
                out.pixels.clear();
                break;
            }
        }
        out
    }

    /// Returns the directions of the bright pixels and their bright solid angle, steradians.
    #[must_use]
    pub fn samples(&self, direction: &dyn Fn(DVec2) -> Option<DVec3>) -> Vec<(DVec3, f64)> {
        let sample = |(x, y, share): &(u16, u16, f32)| {
            let (d, area) =
                direction_and_area(DVec2::new(f64::from(*x), f64::from(*y)), direction)?;
            Some((d, area * f64::from(*share)))
        };
        self.pixels.iter().filter_map(sample).collect()
    }

    /// Returns the lights, largest first; `direction` returns the direction of a pixel, `None` for
    /// pixels to be ignored.
    #[must_use]
    pub fn lights(&self, direction: &dyn Fn(DVec2) -> Option<DVec3>) -> Vec<Light> {
        let mut share = Grey {
            width: self.width,
            height: self.height,
            data: vec![0.0; self.width * self.height],
        };
        for (x, y, s) in &self.pixels {
            share.data[usize::from(*y) * self.width + usize::from(*x)] = *s;
        }
        let mut lights = Vec::new();
        let mut stack = Vec::new();
        for (x, y, _) in &self.pixels {
            stack.clear();
            stack.push((usize::from(*x), usize::from(*y)));
            if let Some(light) = collect_connected(&mut share, &mut stack, direction) {
                lights.push(light);
            }
        }
        merged(lights)
    }
}

/// Collects the pixels connected with those on the stack, and clears them in `share`.
fn collect_connected(
    share: &mut Grey,
    stack: &mut Vec<(usize, usize)>,
    direction: &dyn Fn(DVec2) -> Option<DVec3>,
) -> Option<Light> {
    let (mut sum, mut pixels, mut solid, mut count) = (DVec3::ZERO, DVec2::ZERO, 0.0, 0.0);
    while let Some((x, y)) = stack.pop() {
        let value = std::mem::take(&mut share.data[y * share.width + x]);
        if value <= 0.0 {
            continue;
        }
        let p = DVec2::new(x as f64, y as f64);
        if let Some((d, area)) = direction_and_area(p, direction) {
            let weight = f64::from(value) * area;
            sum += d * weight;
            solid += weight;
            pixels += p * f64::from(value);
            count += f64::from(value);
        }
        let (right, below) = (share.width - 1, share.height - 1);
        for near_y in y.saturating_sub(1)..=(y + 1).min(below) {
            for near_x in x.saturating_sub(1)..=(x + 1).min(right) {
                if share.data[near_y * share.width + near_x] > 0.0 {
                    stack.push((near_x, near_y));
                }
            }
        }
    }
    let direction = sum.try_normalize()?;
    (count >= 1.0).then(|| Light {
        direction,
        solid_angle: solid,
        pixel: pixels / count,
        count,
    })
}

/// Returns the direction and the solid angle (steradians) of a pixel.
fn direction_and_area(
    p: DVec2,
    direction: &dyn Fn(DVec2) -> Option<DVec3>,
) -> Option<(DVec3, f64)> {
    let at = |x: f64, y: f64| direction(p + DVec2::new(x, y));
    let area = (at(0.5, 0.0)? - at(-0.5, 0.0)?).cross(at(0.0, 0.5)? - at(0.0, -0.5)?);
    Some((at(0.0, 0.0)?, area.length()))
}

/// Merges lights that are no farther apart than their size.
fn merged(mut lights: Vec<Light>) -> Vec<Light> {
    let near = |a: &Light, b: &Light| {
        a.direction.angle_between(b.direction) < 1.3 * (a.radius() + b.radius()) + 0.025
    };
    let pair = |lights: &[Light]| {
        let pairs = (0..lights.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
        pairs
            .into_iter()
            .find(|(i, j)| near(&lights[*i], &lights[*j]))
    };
    lights.sort_by(|a, b| b.solid_angle.total_cmp(&a.solid_angle));
    lights.truncate(8 * MAX_LIGHTS);
    while let Some((i, j)) = pair(&lights) {
        let b = lights.swap_remove(i);
        let a = &mut lights[j];
        let solid_angle = a.solid_angle + b.solid_angle;
        let sum = a.direction * a.solid_angle + b.direction * b.solid_angle;
        *a = Light {
            direction: sum.normalize_or(a.direction),
            solid_angle,
            pixel: (a.pixel * a.count + b.pixel * b.count) / (a.count + b.count),
            count: a.count + b.count,
        };
    }
    lights.sort_by(|a, b| b.solid_angle.total_cmp(&a.solid_angle));
    lights.truncate(MAX_LIGHTS);
    lights
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(light: impl Fn(DVec2) -> f64) -> Picture {
        let (width, height) = (120, 90);
        let rgba = (0..width * height)
            .flat_map(|i| {
                let p = DVec2::new(f64::from(i % width), f64::from(i / width));
                let code = light(p) as u8;
                [code, code, code, 255]
            })
            .collect();
        Picture {
            width,
            height,
            rgba,
        }
    }

    fn straight(p: DVec2) -> Option<DVec3> {
        Some(
            ((p - DVec2::new(60.0, 45.0)) / 80.0)
                .extend(1.0)
                .normalize(),
        )
    }

    #[test]
    fn panes_form_one_light_and_a_lamp_another() {
        let shown = picture(|p| {
            let pane =
                (p.x - 30.0).abs() < 10.0 && (p.y - 30.0).abs() < 8.0 && (p.x - 30.0).abs() > 1.2;
            if pane || p.distance(DVec2::new(95.0, 60.0)) < 3.0 {
                250.0
            } else {
                40.0
            }
        });
        let lights = BrightPixels::new(&shown, &Response::srgb()).lights(&straight);
        assert_eq!(lights.len(), 2, "{lights:?}");
        assert!(lights[0].pixel.distance(DVec2::new(30.0, 30.0)) < 0.1);
        assert!(
            lights[1]
                .direction
                .angle_between(straight(DVec2::new(95.0, 60.0)).unwrap())
                < 0.003
        );
    }

    #[test]
    fn uniform_picture_has_no_lights() {
        let response = Response::srgb();
        assert_eq!(
            BrightPixels::new(&picture(|_| 200.0), &response).lights(&straight),
            Vec::new()
        );
        assert_eq!(
            BrightPixels::new(&picture(|p| 2.0 * p.x), &response)
                .pixels
                .len(),
            0
        );
        assert_eq!(
            BrightPixels::new(&Picture::default(), &response).lights(&straight),
            Vec::new()
        );
    }
}
