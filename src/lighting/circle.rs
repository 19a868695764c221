//! Finds the image circle of a fisheye picture or the outline of a mirrored sphere.

use glam::DVec2;
use penumbra_picture::Picture;

/// A circle in a picture, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre.
    pub centre: DVec2,
    /// Radius.
    pub radius: f64,
}

/// Minimum part of an outline that must be visible.
const MIN_SUPPORT: f64 = 0.3;
/// Rays from the centre along which a circle is searched, refined and judged.
const RAYS: usize = 360;

/// Maximum luminance of what surrounds a fisheye's image circle, codes: brighter is a wall behind a
/// sphere. Fisheye pictures have 13 to 32, one with much stray light 56.
const MAX_BORDER: f32 = 64.0;
/// Error of the border of a fisheye's image circle, which is soft, in radii.
const FISHEYE_ERROR: f64 = 0.02;

/// Finds the image circle of a fisheye, which is brighter than the black around it. Returns it with
/// the share of its visible part where that border lies on it, 0 to 1. `None` if there is no such
/// border.
#[must_use]
pub fn fisheye_circle(picture: &Picture) -> Option<(Circle, f64)> {
    let grey = Grey::new(picture);
    let middle = DVec2::new(f64::from(picture.width), f64::from(picture.height)) / 2.0;
    let border = grey.border_level();
    if border > MAX_BORDER {
        return None;
    }
    let dark = border + 14.0;
    let points: Vec<DVec2> = rays()
        .filter_map(|side| grey.last_above(middle, side, dark))
        .collect();
    // A picture that fills its frame has its last bright pixel at the frame in all directions.
    let inside: Vec<DVec2> = points
        .into_iter()
        .filter(|p| grey.is_inside(*p, 2.0))
        .collect();
    if inside.len() < RAYS / 4 {
        return None;
    }
    let circle = fit(&inside)?;
    let on_circle = |p: &&DVec2| {
        (p.distance(circle.centre) - circle.radius).abs() <= FISHEYE_ERROR * circle.radius
    };
    let agreeing = inside.iter().filter(on_circle).count();
    let in_picture = grey.part_inside(circle);
    Some((
        circle,
        (agreeing as f64 / RAYS as f64 / in_picture).min(1.0),
    ))
}

/// Where the outline of a mirrored sphere is searched.
#[derive(Clone, Copy)]
pub struct OutlineSearch<'a> {
    /// Minimum and maximum radius, as shares of the picture's shorter side.
    pub radii: [f64; 2],
    /// Maximum side of the reduced picture in which it is searched, pixels.
    pub max_side: u32,
    /// How likely the sphere is at a circle (pixels of the full picture), from 0, apart from its
    /// edges.
    pub prior: &'a dyn Fn(Circle) -> f64,
}

impl OutlineSearch<'static> {
    /// A sphere that fills a large part of the picture.
    pub const LARGE: Self = Self {
        radii: [0.25, 0.55],
        max_side: 240,
        prior: &|_| 1.0,
    };
}

/// Finds the outline of a mirrored sphere that fills a large part of the picture: the circle with
/// the most edges across it (Hough transform), refined along rays.
#[must_use]
pub fn sphere_outline(picture: &Picture) -> Option<Circle> {
    find_outline(picture, &OutlineSearch::LARGE)
}

/// As [`sphere_outline`], for other sizes and with what is known beforehand.
#[must_use]
pub fn find_outline(picture: &Picture, search: &OutlineSearch<'_>) -> Option<Circle> {
    let scale = reduction(picture, search.max_side);
    let small = Grey::new(picture).shrunk(scale);
    let scale = f64::from(scale);
    let full = |circle: Circle| Circle {
        centre: (circle.centre + 0.5) * scale - 0.5,
        radius: circle.radius * scale,
    };
    let coarse = small.hough(search.radii, &|circle| (search.prior)(full(circle)))?;
    let mut circle = full(coarse);
    let fine = Grey::new(picture);
    for reach in [0.04, 0.02, 0.015] {
        circle = fine.refine(circle, reach).unwrap_or(circle);
    }
    Some(circle)
}

/// Returns the points of the strongest steps of luminance along rays from a circle's centre, within
/// `reach` radii of the circle, pixels.
#[must_use]
pub fn outline_points(picture: &Picture, circle: Circle, reach: f64) -> Vec<DVec2> {
    Grey::new(picture).steepest(circle, reach)
}

/// Returns how much of a circle is the border of something round, 0 to 1: the share of its
/// directions in which there is an edge within a pixel of it, across its radius to 18°, in the
/// picture reduced to 240 pixels. Of mirrored spheres in photographs 0.85 to 1 is visible, of spheres
/// that are half dark 0.55 to 0.76; of the best circles in pictures of other things 0.3 to 0.69.
#[must_use]
pub fn visible_share(picture: &Picture, circle: Circle) -> f64 {
    let scale = reduction(picture, OutlineSearch::LARGE.max_side);
    let factor = f64::from(scale);
    let reduced = Circle {
        centre: (circle.centre + 0.5) / factor - 0.5,
        radius: circle.radius / factor,
    };
    Grey::new(picture).shrunk(scale).support(reduced, 1, 0.95)
}

/// Returns the factor by which a picture is reduced to a maximum side.
fn reduction(picture: &Picture, max_side: u32) -> u32 {
    let side = picture.width.max(picture.height);
    side.div_ceil(max_side.max(1)).max(1)
}

/// Unit vectors in [`RAYS`] directions.
fn rays() -> impl Iterator<Item = DVec2> {
    (0..RAYS).map(|k| DVec2::from_angle(std::f64::consts::TAU * k as f64 / RAYS as f64))
}

/// An edge: a step of luminance.
struct Edge {
    at: DVec2,
    /// Unit vector along the gradient.
    across: DVec2,
    weight: f32,
}

/// Luminance of a picture as floats.
struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Grey {
    fn new(picture: &Picture) -> Self {
        let values = picture
            .rgba
            .chunks_exact(4)
            .map(|p| 0.299 * f32::from(p[0]) + 0.587 * f32::from(p[1]) + 0.114 * f32::from(p[2]))
            .collect();
        Self {
            width: picture.width as usize,
            height: picture.height as usize,
            values,
        }
    }

    fn at(&self, p: DVec2) -> Option<f32> {
        let (x, y) = (p.x.round(), p.y.round());
        let inside =
            x >= 0.0 && y >= 0.0 && (x as usize) < self.width && (y as usize) < self.height;
        inside.then(|| self.values[y as usize * self.width + x as usize])
    }

    fn is_inside(&self, p: DVec2, margin: f64) -> bool {
        p.min_element() >= margin
            && p.x <= self.width as f64 - 1.0 - margin
            && p.y <= self.height as f64 - 1.0 - margin
    }

    /// Returns the share of a circle that lies in the picture, more than 0.
    fn part_inside(&self, circle: Circle) -> f64 {
        let inside = |side: &DVec2| self.is_inside(circle.centre + *side * circle.radius, 2.0);
        rays().filter(inside).count().max(1) as f64 / RAYS as f64
    }

    /// Median of the picture's corners, which are black in a fisheye picture.
    fn border_level(&self) -> f32 {
        let n = (self.width.min(self.height) / 40).max(1);
        let (w, h) = (
            self.width - n.min(self.width),
            self.height - n.min(self.height),
        );
        let mut corner: Vec<f32> = [(0, 0), (w, 0), (0, h), (w, h)]
            .into_iter()
            .flat_map(|(x, y)| (0..n * n).map(move |i| (x + i % n, y + i / n)))
            .filter_map(|(x, y)| self.values.get(y * self.width + x).copied())
            .collect();
        corner.sort_by(f32::total_cmp);
        corner.get(corner.len() / 2).copied().unwrap_or(0.0)
    }

    /// Returns the outermost point of a ray that begins a run of eight pixels above a level.
    fn last_above(&self, from: DVec2, side: DVec2, level: f32) -> Option<DVec2> {
        let reach = self.width.max(self.height);
        let mut run = 0;
        for r in (0..reach).rev() {
            let p = from + side * r as f64;
            run = if self.at(p).is_some_and(|v| v > level) {
                run + 1
            } else {
                0
            };
            if run == 8 {
                return Some(from + side * (r + 7) as f64);
            }
        }
        None
    }

    fn shrunk(&self, factor: u32) -> Self {
        let k = factor as usize;
        let (width, height) = (self.width / k, self.height / k);
        let mean = |x: usize, y: usize| {
            let cells =
                (0..k * k).map(|i| self.values[(y * k + i / k) * self.width + x * k + i % k]);
            cells.sum::<f32>() / (k * k) as f32
        };
        let values = (0..width * height)
            .map(|i| mean(i % width, i / width))
            .collect();
        Self {
            width,
            height,
            values,
        }
    }

    fn gradient(&self, x: usize, y: usize) -> DVec2 {
        let v = |dx: usize, dy: usize| self.values[(y + dy - 1) * self.width + x + dx - 1];
        let gx = v(2, 0) + 2.0 * v(2, 1) + v(2, 2) - v(0, 0) - 2.0 * v(0, 1) - v(0, 2);
        let gy = v(0, 2) + 2.0 * v(1, 2) + v(2, 2) - v(0, 0) - 2.0 * v(1, 0) - v(2, 0);
        DVec2::new(f64::from(gx), f64::from(gy))
    }

    /// Finds a circle: every edge votes for the centres on its normal, at every radius between two
    /// shares of the shorter side, weighted by the square root of its contrast; the best centre of
    /// each radius is scored by its support and `prior`.
    fn hough(&self, radii: [f64; 2], prior: &dyn Fn(Circle) -> f64) -> Option<Circle> {
        let side = self.width.min(self.height) as f64;
        let [low, high] = radii.map(|share| (share * side).max(2.0) as usize);
        let edges = self.edges();
        let candidates = (low..=high).filter_map(|radius| {
            let mut votes = vec![0.0f32; self.width * self.height];
            for edge in &edges {
                self.vote(edge, radius as f64, &mut votes);
            }
            let i = self.strongest(&votes)?;
            let centre = DVec2::new((i % self.width) as f64, (i / self.width) as f64);
            let circle = Circle {
                centre,
                radius: radius as f64,
            };
            let support = self.support(circle, 2, 0.85);
            // A complete outline counts more than what is known beforehand.
            Some((support * support * prior(circle), support, circle))
        });
        let (_, support, circle) = candidates.max_by(|a, b| a.0.total_cmp(&b.0))?;
        (support > MIN_SUPPORT).then_some(circle)
    }

    /// Returns the part of a circle along which there is an edge within `reach` pixels, across its
    /// radius (cosine at least `across`), of any contrast: a complete outline is preferred to a
    /// strong fragment.
    fn support(&self, circle: Circle, reach: i32, across: f64) -> f64 {
        let has_edge = |side: DVec2| {
            (-reach..=reach).any(|r| {
                let p = circle.centre + side * (circle.radius + f64::from(r));
                if !self.is_inside(p, 1.5) {
                    return false;
                }
                let g = self.gradient(p.x.round() as usize, p.y.round() as usize);
                g.dot(side).abs() > 20.0 && g.dot(side).abs() > across * g.length()
            })
        };
        rays().filter(|&side| has_edge(side)).count() as f64 / RAYS as f64
    }

    fn edges(&self) -> Vec<Edge> {
        let mut edges = Vec::new();
        for y in 1..self.height.saturating_sub(1) {
            for x in 1..self.width.saturating_sub(1) {
                let gradient = self.gradient(x, y);
                let contrast = gradient.length();
                if contrast >= 24.0 {
                    edges.push(Edge {
                        at: DVec2::new(x as f64, y as f64),
                        across: gradient / contrast,
                        weight: (contrast.min(200.0) as f32).sqrt(),
                    });
                }
            }
        }
        edges
    }

    fn vote(&self, edge: &Edge, radius: f64, votes: &mut [f32]) {
        for centre in [edge.across * radius, edge.across * -radius] {
            let p = edge.at + centre;
            if self.is_inside(p, 1.0) {
                let i = p.y.round() as usize * self.width + p.x.round() as usize;
                votes[i] += edge.weight;
            }
        }
    }

    /// Returns the centre of the 3×3 neighbourhood with the most votes.
    fn strongest(&self, votes: &[f32]) -> Option<usize> {
        let w = self.width;
        (w + 1..votes.len().saturating_sub(w + 1))
            .map(|i| {
                let rows = [i - w, i, i + w];
                (
                    i,
                    rows.iter()
                        .flat_map(|&r| &votes[r - 1..=r + 1])
                        .sum::<f32>(),
                )
            })
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(i, _)| i)
    }

    /// Refines a circle by the strongest step along rays, within `reach` radii of the outline.
    fn refine(&self, circle: Circle, reach: f64) -> Option<Circle> {
        let points = self.steepest(circle, reach);
        if points.len() < RAYS / 6 {
            None
        } else {
            fit(&points)
        }
    }

    /// Returns the points of the strongest steps along rays, within `reach` radii of the outline.
    fn steepest(&self, circle: Circle, reach: f64) -> Vec<DVec2> {
        let span = (reach * circle.radius).ceil().max(2.0) as i32;
        rays()
            .filter_map(|side| {
                let at = |r: f64| self.at(circle.centre + side * (circle.radius + r));
                let step = |r: i32| {
                    let r = f64::from(r);
                    Some((at(r + 1.5)? + at(r + 2.5)? - at(r - 1.5)? - at(r - 2.5)?).abs())
                };
                let (r, s) = (-span..=span)
                    .filter_map(|r| Some((r, step(r)?)))
                    .max_by(|a, b| a.1.total_cmp(&b.1))?;
                (s > 16.0).then(|| circle.centre + side * (circle.radius + f64::from(r)))
            })
            .collect()
    }
}

/// Fits a circle to points: Kåsa's linear fit, iterated with Cauchy weights against outliers.
fn fit(points: &[DVec2]) -> Option<Circle> {
    let mut weights = vec![1.0; points.len()];
    let mut circle = None;
    for _ in 0..30 {
        let c = weighted_fit(points, &weights)?;
        let scale = (0.002 * c.radius).max(0.5);
        for (w, p) in weights.iter_mut().zip(points) {
            let residual = (p.distance(c.centre) - c.radius) / scale;
            *w = 1.0 / (1.0 + residual * residual);
        }
        circle = Some(c);
    }
    circle.filter(|c| c.radius.is_finite() && c.centre.is_finite())
}

fn weighted_fit(points: &[DVec2], weights: &[f64]) -> Option<Circle> {
    let total: f64 = weights.iter().sum();
    let mean = points
        .iter()
        .zip(weights)
        .map(|(p, w)| *p * *w)
        .sum::<DVec2>()
        / total;
    let mut m = glam::DMat3::ZERO;
    let mut v = glam::DVec3::ZERO;
    for (p, &w) in points.iter().zip(weights) {
        let row = (*p - mean).extend(1.0);
        m += glam::DMat3::from_cols(row * row.x, row * row.y, row * row.z) * w;
        v += row * (w * (*p - mean).length_squared());
    }
    if m.determinant().abs() < 1e-9 {
        return None;
    }
    let solved = m.inverse() * v;
    let offset = solved.truncate() / 2.0;
    let radius = (solved.z + offset.length_squared()).max(0.0).sqrt();
    Some(Circle {
        centre: mean + offset,
        radius,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rendered(width: u32, height: u32, shade: impl Fn(DVec2) -> u8) -> Picture {
        let rgba = (0..width * height)
            .flat_map(|i| {
                let v = shade(DVec2::new(f64::from(i % width), f64::from(i / width)));
                [v, v, v, 255]
            })
            .collect();
        Picture {
            width,
            height,
            rgba,
        }
    }

    #[test]
    fn finds_image_circle_within_a_pixel() {
        let centre = DVec2::new(203.0, 190.0);
        let picture = rendered(
            400,
            380,
            |p| if p.distance(centre) < 170.0 { 90 } else { 3 },
        );
        let (found, visible) = fisheye_circle(&picture).unwrap();
        assert!(visible > 0.98, "{visible}");
        assert!(
            found.centre.distance(centre) < 1.0 && (found.radius - 170.0).abs() < 1.0,
            "{found:?}"
        );
        assert!(fisheye_circle(&rendered(100, 100, |_| 128)).is_none());
    }

    #[test]
    fn finds_sphere_before_textured_wall() {
        let centre = DVec2::new(310.0, 260.0);
        let picture = rendered(640, 480, |p| {
            let d = (p - centre) / 180.0;
            if d.length() < 1.0 {
                (40.0 + 60.0 * (1.0 - d.x)) as u8
            } else if (p.x / 60.0).floor() % 2.0 == 0.0 {
                180
            } else {
                150
            }
        });
        let found = sphere_outline(&picture).unwrap();
        assert!(
            found.centre.distance(centre) < 2.0 && (found.radius - 180.0).abs() < 2.0,
            "{found:?}"
        );
        assert!(sphere_outline(&rendered(64, 64, |_| 9)).is_none());
    }
}
