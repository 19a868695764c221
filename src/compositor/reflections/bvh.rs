//! A bounding-volume hierarchy over triangles that eight rays traverse together.
//!
//! Boxes are divided by the surface-area heuristic over bins (Wald 2007). Loops over the lanes of a
//! packet become vector instructions where a caller compiles them for those.

use glam::Vec3;

/// Rays of a packet.
pub const LANES: usize = 8;
/// A number for each ray.
pub type Lanes = [f32; LANES];
/// Vectors, component by component.
pub type Lanes3 = [Lanes; 3];

/// Triangles of a leaf.
const LEAF: usize = 4;
/// Intervals of an axis at whose borders a box may be divided.
const BINS: usize = 12;
/// Depth from which boxes are halved by number, so that [`STACK`] suffices.
const DEEP: usize = 32;
/// Boxes that wait at a time.
const STACK: usize = 64;

/// Rays with any common use; a ray is inactive where [`Hits::distance`] is negative.
#[derive(Clone, Copy)]
pub struct Rays {
    pub origin: Lanes3,
    pub direction: Lanes3,
}

/// The nearest triangle of each ray.
#[derive(Clone, Copy)]
pub struct Hits {
    /// In lengths of the direction; before the traversal the farthest distance of interest.
    pub distance: Lanes,
    /// Number of the triangle in the order of [`Bvh::new`]; [`NOTHING`] for none.
    pub triangle: [u32; LANES],
    /// Barycentric coordinates of the second and third corner.
    pub u: Lanes,
    pub v: Lanes,
}

/// No triangle.
pub const NOTHING: u32 = u32::MAX;

impl Hits {
    /// Nothing yet; `farthest` is negative for rays without interest.
    #[inline(always)]
    pub const fn within(farthest: Lanes) -> Self {
        Self {
            distance: farthest,
            triangle: [NOTHING; LANES],
            u: [0.0; LANES],
            v: [0.0; LANES],
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Node {
    low: Vec3,
    high: Vec3,
    /// The first of two children, or of `count` triangles.
    first: u32,
    /// 0 for boxes with children.
    count: u32,
}

/// A triangle, with its number in the order in which it was given.
#[derive(Clone, Copy, Debug)]
struct Triangle {
    corner: Vec3,
    edges: [Vec3; 2],
    number: u32,
}

/// The hierarchy.
#[derive(Debug, Default)]
pub struct Bvh {
    nodes: Vec<Node>,
    triangles: Vec<Triangle>,
}

impl Bvh {
    /// Builds the hierarchy over triangles, whose corners must be finite.
    pub fn new(corners: &[[Vec3; 3]]) -> Self {
        let mut items: Vec<Item> = (corners.iter().zip(0..))
            .map(|(corners, number)| Item::new(*corners, number))
            .collect();
        let mut nodes = Vec::with_capacity(corners.len());
        if !items.is_empty() {
            nodes.push(Node::around(&items, 0));
            divide(&mut nodes, 0, &mut items, 0, 0);
        }
        let triangles = items.iter().map(|item| {
            let [a, b, c] = corners[item.number as usize];
            Triangle {
                corner: a,
                edges: [b - a, c - a],
                number: item.number,
            }
        });
        Self {
            triangles: triangles.collect(),
            nodes,
        }
    }

    /// Finds the nearest triangle of each ray, nearer than what `hits` already has.
    #[inline(always)]
    pub fn nearest(&self, rays: &Rays, hits: &mut Hits) {
        if self.nodes.is_empty() {
            return;
        }
        let inverse = rays.direction.map(|axis| axis.map(reciprocal));
        let mut stack = [(0, 0.0); STACK];
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (number, entry) = stack[waiting];
            if entry > farthest(&hits.distance) {
                continue;
            }
            let node = &self.nodes[number as usize];
            let first = node.first as usize;
            if node.count > 0 {
                for triangle in &self.triangles[first..first + node.count as usize] {
                    triangle.cross(rays, hits);
                }
                continue;
            }
            let children = [first as u32, first as u32 + 1].map(|child| {
                let node = &self.nodes[child as usize];
                (child, node.entry(&rays.origin, &inverse, &hits.distance))
            });
            let [near, far] = if children[0].1 <= children[1].1 {
                children
            } else {
                [children[1], children[0]]
            };
            // The nearer one is taken first.
            for child in [far, near] {
                if child.1 < f32::INFINITY && waiting < STACK {
                    stack[waiting] = child;
                    waiting += 1;
                }
            }
        }
    }
}

/// The reciprocal, finite even for 0.
#[inline(always)]
fn reciprocal(x: f32) -> f32 {
    1.0 / if x.abs() < 1e-12 {
        1e-12_f32.copysign(x)
    } else {
        x
    }
}

/// `f32::min` and `max` take more instructions, because they treat NaN.
#[inline(always)]
const fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
const fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn farthest(distance: &Lanes) -> f32 {
    distance.iter().fold(-1.0, |far, d| most(far, *d))
}

impl Node {
    fn around(items: &[Item], first: usize) -> Self {
        let (low, high) = bounds(items);
        Self {
            low,
            high,
            first: first as u32,
            count: items.len() as u32,
        }
    }

    /// Distance at which the first ray enters the box; infinite if none does before `farthest`.
    #[inline(always)]
    fn entry(&self, origin: &Lanes3, inverse: &Lanes3, farthest: &Lanes) -> f32 {
        let mut near = [0.0; LANES];
        let mut far = *farthest;
        for axis in 0..3 {
            let (low, high) = (self.low[axis], self.high[axis]);
            for i in 0..LANES {
                let a = (low - origin[axis][i]) * inverse[axis][i];
                let b = (high - origin[axis][i]) * inverse[axis][i];
                near[i] = most(near[i], least(a, b));
                far[i] = least(far[i], most(a, b));
            }
        }
        let mut first = [f32::INFINITY; LANES];
        for i in 0..LANES {
            first[i] = if near[i] <= far[i] {
                near[i]
            } else {
                f32::INFINITY
            };
        }
        first.iter().fold(f32::INFINITY, |a, b| least(a, *b))
    }
}

impl Triangle {
    /// Where rays cross it, from either side (Möller and Trumbore 1997).
    #[inline(always)]
    fn cross(&self, rays: &Rays, hits: &mut Hits) {
        let [a, b] = self.edges;
        let [ox, oy, oz] = &rays.origin;
        let [dx, dy, dz] = &rays.direction;
        for i in 0..LANES {
            let (px, py, pz) = (
                dy[i] * b.z - dz[i] * b.y,
                dz[i] * b.x - dx[i] * b.z,
                dx[i] * b.y - dy[i] * b.x,
            );
            let scale = 1.0 / (a.x * px + a.y * py + a.z * pz);
            let (sx, sy, sz) = (
                ox[i] - self.corner.x,
                oy[i] - self.corner.y,
                oz[i] - self.corner.z,
            );
            let u = (sx * px + sy * py + sz * pz) * scale;
            let (qx, qy, qz) = (
                sy * a.z - sz * a.y,
                sz * a.x - sx * a.z,
                sx * a.y - sy * a.x,
            );
            let v = (dx[i] * qx + dy[i] * qy + dz[i] * qz) * scale;
            let t = (b.x * qx + b.y * qy + b.z * qz) * scale;
            // Comparisons with the NaN of a degenerate triangle are false.
            let is_nearer =
                (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0) & (t < hits.distance[i]);
            hits.distance[i] = if is_nearer { t } else { hits.distance[i] };
            hits.u[i] = if is_nearer { u } else { hits.u[i] };
            hits.v[i] = if is_nearer { v } else { hits.v[i] };
            hits.triangle[i] = if is_nearer {
                self.number
            } else {
                hits.triangle[i]
            };
        }
    }
}

/// A triangle while the hierarchy is built.
#[derive(Clone, Copy)]
struct Item {
    low: Vec3,
    high: Vec3,
    number: u32,
}

impl Item {
    fn new([a, b, c]: [Vec3; 3], number: u32) -> Self {
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        // Rounding must not let a ray pass between boxes that touch.
        let margin = 1e-6 * low.abs().max(high.abs()).max_element();
        Self {
            low: low - margin,
            high: high + margin,
            number,
        }
    }

    fn centre(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }
}

fn bounds(items: &[Item]) -> (Vec3, Vec3) {
    let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    items.iter().fold(nothing, |(low, high), item| {
        (low.min(item.low), high.max(item.high))
    })
}

/// Half the surface of a box.
fn half_area((low, high): (Vec3, Vec3)) -> f32 {
    let size = (high - low).max(Vec3::ZERO);
    size.x * size.y + size.y * size.z + size.z * size.x
}

/// Divides the box `node` over `items`, which begin at `first` among all.
fn divide(nodes: &mut Vec<Node>, node: usize, items: &mut [Item], first: usize, depth: usize) {
    if items.len() <= LEAF {
        return;
    }
    let middle = match best_split(items).filter(|_| depth < DEEP) {
        Some(split) => sorted_by(items, split),
        None => 0,
    };
    let middle = if middle == 0 || middle == items.len() {
        halved(items)
    } else {
        middle
    };
    let (left, right) = items.split_at_mut(middle);
    let child = nodes.len();
    nodes.push(Node::around(left, first));
    nodes.push(Node::around(right, first + middle));
    nodes[node].first = child as u32;
    nodes[node].count = 0;
    divide(nodes, child, left, first, depth + 1);
    divide(nodes, child + 1, right, first + middle, depth + 1);
}

/// An axis, the interval of centres along it, and the number of bins before the division.
type Split = (usize, (f32, f32), usize);

fn bin_of(item: &Item, axis: usize, (low, high): (f32, f32)) -> usize {
    let at = (item.centre()[axis] - low) / (high - low) * BINS as f32;
    (at as usize).min(BINS - 1)
}

fn best_split(items: &[Item]) -> Option<Split> {
    let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = items.iter().fold(nothing, |(low, high), item| {
        (low.min(item.centre()), high.max(item.centre()))
    });
    let axis = (high - low).max_position();
    let interval = (low[axis], high[axis]);
    if interval.1 - interval.0 <= 0.0 {
        return None;
    }
    let mut bins = [(nothing, 0_usize); BINS];
    for item in items {
        let ((low, high), count) = &mut bins[bin_of(item, axis, interval)];
        (*low, *high) = (low.min(item.low), high.max(item.high));
        *count += 1;
    }
    let side = |bins: &[((Vec3, Vec3), usize)]| {
        let join = |(a, n): ((Vec3, Vec3), usize), (b, m): &((Vec3, Vec3), usize)| {
            ((a.0.min(b.0), a.1.max(b.1)), n + m)
        };
        let (bounds, count) = bins.iter().fold((nothing, 0), join);
        half_area(bounds) * count as f32
    };
    let cost = |k: &usize| side(&bins[..*k]) + side(&bins[*k..]);
    let best = (1..BINS).min_by(|a, b| cost(a).total_cmp(&cost(b)))?;
    Some((axis, interval, best))
}

/// Moves the items before the division to the front; returns their number.
fn sorted_by(items: &mut [Item], (axis, interval, before): Split) -> usize {
    let mut count = 0;
    for i in 0..items.len() {
        if bin_of(&items[i], axis, interval) < before {
            items.swap(i, count);
            count += 1;
        }
    }
    count
}

/// Sorts items into halves along the longest axis of their bounds.
fn halved(items: &mut [Item]) -> usize {
    let (low, high) = bounds(items);
    let axis = (high - low).max_position();
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |a, b| a.centre()[axis].total_cmp(&b.centre()[axis]));
    middle
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pseudo_random(seed: &mut u32) -> f32 {
        *seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (*seed >> 8) as f32 / 16_777_216.0
    }

    #[test]
    fn packets_find_what_single_triangles_say() {
        let mut seed = 7;
        let mut random = || Vec3::new(0.0, 0.0, 0.0).map(|_| 2.0 * pseudo_random(&mut seed) - 1.0);
        let corners: Vec<[Vec3; 3]> = (0..500)
            .map(|_| {
                let at = random();
                [at, at + 0.2 * random(), at + 0.2 * random()]
            })
            .collect();
        let bvh = Bvh::new(&corners);
        let each: Vec<Bvh> = corners.iter().map(|c| Bvh::new(&[*c])).collect();
        let mut found = 0;
        for _ in 0..50 {
            let mut rays = Rays {
                origin: [[0.0; LANES]; 3],
                direction: [[0.0; LANES]; 3],
            };
            for i in 0..LANES {
                let (o, d) = (2.0 * random(), random());
                for axis in 0..3 {
                    rays.origin[axis][i] = o[axis];
                    rays.direction[axis][i] = d[axis];
                }
            }
            let mut hits = Hits::within([f32::MAX; LANES]);
            hits.distance[3] = -1.0;
            let mut expected = hits;
            bvh.nearest(&rays, &mut hits);
            for (one, number) in each.iter().zip(0..) {
                let before = expected;
                one.nearest(&rays, &mut expected);
                for i in 0..LANES {
                    if expected.distance[i] != before.distance[i] {
                        expected.triangle[i] = number;
                    }
                }
            }
            assert_eq!(hits.triangle, expected.triangle);
            assert_eq!(hits.distance, expected.distance);
            assert_eq!(hits.triangle[3], NOTHING);
            found += hits.triangle.iter().filter(|t| **t != NOTHING).count();
        }
        assert!(found > 50, "{found}");
    }

    #[test]
    fn equal_triangles_do_not_exhaust_the_stack() {
        let corner = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let bvh = Bvh::new(&vec![corner; 5000]);
        let rays = Rays {
            origin: [[0.2; LANES], [0.2; LANES], [1.0; LANES]],
            direction: [[0.0; LANES], [0.0; LANES], [-1.0; LANES]],
        };
        let mut hits = Hits::within([f32::MAX; LANES]);
        bvh.nearest(&rays, &mut hits);
        assert_eq!(hits.distance, [1.0; LANES]);
    }
}
