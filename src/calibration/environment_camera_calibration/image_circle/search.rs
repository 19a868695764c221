//! Initial image circle by RANSAC over steps from bright to dark.

use super::super::rays::{EdgeStep, RAYS, RandomIndices, Search, noise, steps};
use crate::intrinsics::Grey;
use glam::DVec2;

/// Number of random triples of steps.
const TRIES: usize = 6000;

/// Returns the centre and the radius of the circle that most steps lie on; pixels of `small`.
pub(super) fn search(small: &Grey) -> Option<(DVec2, f64)> {
    let size = DVec2::new(small.width as f64, small.height as f64);
    let frame_centre = 0.5 * (size - 1.0);
    let min_height = (4.0 * noise(small)).max(2.5);
    let smooth = small.blurred(0.7);
    let wanted = Search {
        reach: (0.12 * size.min_element(), 0.75 * size.length()),
        half: 3.0,
        min_height,
        max_count: 5,
        falling: true,
    };
    let mut all = Vec::new();
    for ray in (0..RAYS).step_by(2) {
        steps(&[&smooth], frame_centre, ray, &wanted, &mut all);
    }
    let mut random = RandomIndices::new();
    let (mut best, mut most) = (None, 0.0);
    for _ in 0..TRIES {
        let picked: [DVec2; 3] = std::array::from_fn(|_| {
            all.get(random.below(all.len()))
                .map_or(DVec2::NAN, |s| s.at)
        });
        let Some((centre, radius)) = through(picked) else {
            continue;
        };
        let fits = (0.15 * size.min_element()..0.75 * size.length()).contains(&radius)
            && (centre - frame_centre).abs().cmple(0.4 * size).all();
        if !fits {
            continue;
        }
        let votes = votes(&all, centre, radius, min_height);
        if votes > most {
            (most, best) = (votes, Some((centre, radius)));
        }
    }
    best.filter(|_| most > 20.0)
}

/// Returns the centre and the radius of the circle through three points.
fn through([a, b, c]: [DVec2; 3]) -> Option<(DVec2, f64)> {
    let (u, v) = (b - a, c - a);
    let twice = 2.0 * u.perp_dot(v);
    if twice.is_nan() || twice.abs() <= 1.0 {
        return None;
    }
    let (uu, vv) = (u.length_squared(), v.length_squared());
    let to_centre = DVec2::new(v.y * uu - u.y * vv, u.x * vv - v.x * uu) / twice;
    Some((a + to_centre, to_centre.length()))
}

/// Counts the steps on a circle, at most one per ray, weighted by their height.
fn votes(all: &[EdgeStep], centre: DVec2, radius: f64, min_height: f64) -> f64 {
    let (mut sum, mut ray, mut most) = (0.0, usize::MAX, 0.0_f64);
    for step in all {
        if step.ray != ray {
            sum += most;
            (ray, most) = (step.ray, 0.0);
        }
        if (step.at.distance(centre) - radius).abs() < 1.6 {
            most = most.max((step.height / (4.0 * min_height)).min(1.0));
        }
    }
    sum + most
}
