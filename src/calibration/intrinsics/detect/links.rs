//! Links neighbouring saddles: a saddle's neighbour along each of its four edges is the nearest
//! saddle on that edge, if the edge is dark on one side and bright on the other over its entire
//! length.

use super::Grey;
use super::saddles::{Saddle, wrapped};
use glam::DVec2;

/// For each saddle its neighbour along each of its edges: (saddle, its edge that leads back).
pub(super) type Links = Vec<[Option<(usize, usize)>; 4]>;

/// Maximum angle between a neighbour's direction and the edge's direction at the saddle, radians.
const MAX_ANGLE: f64 = 0.35;
/// Maximum edge of a square, as a share of the picture's longer side.
const MAX_SQUARE: f64 = 0.35;
/// Maximum number of candidates along an edge, nearest first.
const MAX_TRIED: usize = 4;

/// Returns all links that are mutual.
pub(super) fn find(picture: &Grey, saddles: &[Saddle]) -> Links {
    let index = Buckets::new(picture, saddles);
    let one_way: Links = (0..saddles.len())
        .map(|i| std::array::from_fn(|edge| neighbour(picture, saddles, &index, i, edge)))
        .collect();
    let mutual = |i: usize, edge: usize| {
        let (j, back) = one_way[i][edge]?;
        (one_way[j][back] == Some((i, edge))).then_some((j, back))
    };
    (0..saddles.len())
        .map(|i| std::array::from_fn(|edge| mutual(i, edge)))
        .collect()
}

fn neighbour(
    picture: &Grey,
    saddles: &[Saddle],
    index: &Buckets,
    i: usize,
    edge: usize,
) -> Option<(usize, usize)> {
    let from = &saddles[i];
    let direction = from.edges[edge];
    let largest = MAX_SQUARE * picture.width.max(picture.height) as f64;
    let mut candidates: Vec<(f64, usize, usize)> = Vec::new();
    // Increasing radii, so that the search is fast for small squares.
    for reach in [largest / 8.0, largest / 2.5, largest] {
        candidates.clear();
        index.within(from.at, reach, |j| {
            let offset = saddles[j].at - from.at;
            let distance = offset.length();
            let aside = wrapped(offset.to_angle() - direction).abs();
            if j != i
                && distance > 3.0
                && distance <= reach
                && aside < MAX_ANGLE
                && let Some(back) = edge_towards(&saddles[j], -offset)
            {
                candidates.push((distance, j, back));
            }
        });
        candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
        let found = candidates.iter().take(MAX_TRIED).find(|&&(_, j, _)| {
            let bright_left = is_bright_after(from, edge);
            is_edge_between(picture, from.at, saddles[j].at, bright_left)
        });
        if let Some(&(_, j, back)) = found {
            return (is_bright_after(&saddles[j], back) != is_bright_after(from, edge))
                .then_some((j, back));
        }
    }
    None
}

/// Returns the edge of a saddle that leads in the direction of `offset`.
pub(super) fn edge_towards(saddle: &Saddle, offset: DVec2) -> Option<usize> {
    let angle = offset.to_angle();
    (0..4).find(|&e| wrapped(saddle.edges[e] - angle).abs() < MAX_ANGLE)
}

/// Returns whether the sector after an edge, in the sense of ascending angles, is bright.
fn is_bright_after(saddle: &Saddle, edge: usize) -> bool {
    saddle.is_first_bright == edge.is_multiple_of(2)
}

/// Returns whether one side of the line between two points is brighter at each of several
/// positions.
fn is_edge_between(picture: &Grey, a: DVec2, b: DVec2, bright_left: bool) -> bool {
    let along = b - a;
    // Ascending angles rotate from +X to +Y, as `perp` does.
    let aside = along.perp() * 0.2;
    let aside = aside.clamp_length(1.0, 12.0);
    let sign = if bright_left { 1.0 } else { -1.0 };
    [0.2, 0.35, 0.5, 0.65, 0.8].into_iter().all(|t| {
        let p = a + along * t;
        sign * (picture.sample(p + aside) - picture.sample(p - aside)) > 2.0
    })
}

/// Saddles by picture cell of 32×32 pixels.
struct Buckets {
    size: f64,
    columns: usize,
    rows: usize,
    members: Vec<Vec<usize>>,
}

impl Buckets {
    fn new(picture: &Grey, saddles: &[Saddle]) -> Self {
        let size = 32.0;
        let columns = picture.width / 32 + 1;
        let rows = picture.height / 32 + 1;
        let mut members = vec![Vec::new(); columns * rows];
        for (i, saddle) in saddles.iter().enumerate() {
            let (x, y) = ((saddle.at.x / size) as usize, (saddle.at.y / size) as usize);
            members[y.min(rows - 1) * columns + x.min(columns - 1)].push(i);
        }
        Self {
            size,
            columns,
            rows,
            members,
        }
    }

    fn within(&self, at: DVec2, reach: f64, mut visit: impl FnMut(usize)) {
        let cell = |v: f64, count: usize| ((v / self.size).max(0.0) as usize).min(count - 1);
        for y in cell(at.y - reach, self.rows)..=cell(at.y + reach, self.rows) {
            for x in cell(at.x - reach, self.columns)..=cell(at.x + reach, self.columns) {
                self.members[y * self.columns + x]
                    .iter()
                    .for_each(|&i| visit(i));
            }
        }
    }
}
