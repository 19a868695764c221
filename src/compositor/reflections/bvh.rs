//! A bounding-volume hierarchy over triangles that eight rays traverse together.
//!
//! Boxes are divided by the surface-area heuristic over bins (Wald 2007). Loops over the lanes of a
//! packet become vector instructions.

use glam::Vec3;
use pulp::Simd;

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
    /// The bits of [`Self::triangle`].
    number: Lanes,
    /// Barycentric coordinates of the second and third corner.
    pub u: Lanes,
    pub v: Lanes,
}

/// No triangle.
pub const NOTHING: u32 = u32::MAX;

impl Hits {
    /// Nothing yet; `farthest` is negative for rays without interest.
    pub const fn within(farthest: Lanes) -> Self {
        Self {
            distance: farthest,
            number: [f32::from_bits(NOTHING); LANES],
            u: [0.0; LANES],
            v: [0.0; LANES],
        }
    }

    /// Number of the triangle in the order of [`Bvh::new`]; [`NOTHING`] for none.
    pub const fn triangle(&self, lane: usize) -> u32 {
        self.number[lane].to_bits()
    }

    /// Forgets the triangles, but not how near they were.
    pub const fn forget(&mut self) {
        self.number = [f32::from_bits(NOTHING); LANES];
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
    pub fn nearest(&self, rays: &Rays, hits: &mut Hits) {
        if !self.nodes.is_empty() {
            let bvh = self;
            pulp::Arch::new().dispatch(Traversal { bvh, rays, hits });
        }
    }

    #[inline(always)]
    fn traverse<S: Simd>(&self, simd: S, rays: &Rays, hits: &mut Hits) {
        const { assert!(S::F32_LANES <= LANES, "a packet fills whole registers") };
        let inverse = inverse(simd, rays);
        let mut stack = [(0, 0.0); STACK];
        let mut waiting = 1;
        while waiting > 0 {
            waiting -= 1;
            let (number, entry) = stack[waiting];
            if entry > farthest(simd, &hits.distance) {
                continue;
            }
            let node = &self.nodes[number as usize];
            let first = node.first as usize;
            if node.count > 0 {
                for triangle in &self.triangles[first..first + node.count as usize] {
                    triangle.cross(simd, rays, hits);
                }
                continue;
            }
            let [left, right] = [&self.nodes[first], &self.nodes[first + 1]];
            let left = left.entry(simd, &rays.origin, &inverse, &hits.distance);
            let right = right.entry(simd, &rays.origin, &inverse, &hits.distance);
            let (left, right) = ((node.first, left), (node.first + 1, right));
            let is_left_nearer = left.1 <= right.1;
            let near = if is_left_nearer { left } else { right };
            let far = if is_left_nearer { right } else { left };
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

/// A traversal with the instructions that the processor has.
struct Traversal<'a> {
    bvh: &'a Bvh,
    rays: &'a Rays,
    hits: &'a mut Hits,
}

impl pulp::WithSimd for Traversal<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.bvh.traverse(simd, self.rays, self.hits);
    }
}

/// Directions shorter than this along an axis are taken for this long: their reciprocals are
/// finite.
const LEAST: f32 = 1e-12;

/// Reciprocals of the directions.
#[inline(always)]
fn inverse<S: Simd>(simd: S, rays: &Rays) -> Lanes3 {
    let mut inverse = rays.direction;
    let (least, one) = (simd.splat_f32s(LEAST), simd.splat_f32s(1.0));
    for axis in &mut inverse {
        for at in (0..LANES).step_by(S::F32_LANES) {
            let x = load(simd, axis, at);
            let is_long = simd.less_than_or_equal_f32s(least, simd.abs_f32s(x));
            let x = simd.select_f32s(is_long, x, least);
            store(simd, axis, at, simd.div_f32s(one, x));
        }
    }
    inverse
}

/// The register of the lanes from `at` on.
#[inline(always)]
fn load<S: Simd>(_: S, lanes: &Lanes, at: usize) -> S::f32s {
    S::as_simd_f32s(&lanes[at..at + S::F32_LANES]).0[0]
}

#[inline(always)]
fn load3<S: Simd>(simd: S, [x, y, z]: &Lanes3, at: usize) -> [S::f32s; 3] {
    [load(simd, x, at), load(simd, y, at), load(simd, z, at)]
}

#[inline(always)]
fn store<S: Simd>(_: S, lanes: &mut Lanes, at: usize, value: S::f32s) {
    S::as_mut_simd_f32s(&mut lanes[at..at + S::F32_LANES]).0[0] = value;
}

#[inline(always)]
fn splat3<S: Simd>(simd: S, v: Vec3) -> [S::f32s; 3] {
    [
        simd.splat_f32s(v.x),
        simd.splat_f32s(v.y),
        simd.splat_f32s(v.z),
    ]
}

#[inline(always)]
fn dot<S: Simd>(simd: S, a: [S::f32s; 3], b: [S::f32s; 3]) -> S::f32s {
    let sum = simd.add_f32s(simd.mul_f32s(a[0], b[0]), simd.mul_f32s(a[1], b[1]));
    simd.add_f32s(sum, simd.mul_f32s(a[2], b[2]))
}

#[inline(always)]
fn cross<S: Simd>(simd: S, a: [S::f32s; 3], b: [S::f32s; 3]) -> [S::f32s; 3] {
    [
        simd.sub_f32s(simd.mul_f32s(a[1], b[2]), simd.mul_f32s(a[2], b[1])),
        simd.sub_f32s(simd.mul_f32s(a[2], b[0]), simd.mul_f32s(a[0], b[2])),
        simd.sub_f32s(simd.mul_f32s(a[0], b[1]), simd.mul_f32s(a[1], b[0])),
    ]
}

#[inline(always)]
fn farthest<S: Simd>(simd: S, distance: &Lanes) -> f32 {
    let mut far = load(simd, distance, 0);
    for at in (S::F32_LANES..LANES).step_by(S::F32_LANES) {
        far = simd.max_f32s(far, load(simd, distance, at));
    }
    simd.reduce_max_f32s(far)
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
    fn entry<S: Simd>(&self, simd: S, origin: &Lanes3, inverse: &Lanes3, farthest: &Lanes) -> f32 {
        let (low, high) = (splat3(simd, self.low), splat3(simd, self.high));
        let never = simd.splat_f32s(f32::INFINITY);
        let mut first = never;
        for at in (0..LANES).step_by(S::F32_LANES) {
            let mut near = simd.splat_f32s(0.0);
            let mut far = load(simd, farthest, at);
            for axis in 0..3 {
                let origin = load(simd, &origin[axis], at);
                let inverse = load(simd, &inverse[axis], at);
                let a = simd.mul_f32s(simd.sub_f32s(low[axis], origin), inverse);
                let b = simd.mul_f32s(simd.sub_f32s(high[axis], origin), inverse);
                near = simd.max_f32s(near, simd.min_f32s(a, b));
                far = simd.min_f32s(far, simd.max_f32s(a, b));
            }
            let enters = simd.less_than_or_equal_f32s(near, far);
            first = simd.min_f32s(first, simd.select_f32s(enters, near, never));
        }
        simd.reduce_min_f32s(first)
    }
}

impl Triangle {
    /// Where rays cross it, from either side (Möller and Trumbore 1997).
    #[inline(always)]
    fn cross<S: Simd>(&self, simd: S, rays: &Rays, hits: &mut Hits) {
        let [a, b] = self.edges;
        let (a, b, corner) = (splat3(simd, a), splat3(simd, b), splat3(simd, self.corner));
        let (zero, one) = (simd.splat_f32s(0.0), simd.splat_f32s(1.0));
        for at in (0..LANES).step_by(S::F32_LANES) {
            let direction = load3(simd, &rays.direction, at);
            let origin = load3(simd, &rays.origin, at);
            let p = cross(simd, direction, b);
            let scale = simd.div_f32s(one, dot(simd, a, p));
            let s = [
                simd.sub_f32s(origin[0], corner[0]),
                simd.sub_f32s(origin[1], corner[1]),
                simd.sub_f32s(origin[2], corner[2]),
            ];
            let u = simd.mul_f32s(dot(simd, s, p), scale);
            let q = cross(simd, s, a);
            let v = simd.mul_f32s(dot(simd, direction, q), scale);
            let t = simd.mul_f32s(dot(simd, b, q), scale);
            // Comparisons with the NaN of a degenerate triangle are false.
            let known = load(simd, &hits.distance, at);
            let least = simd.min_f32s(u, v);
            let inside = simd.and_m32s(
                simd.less_than_or_equal_f32s(zero, least),
                simd.less_than_or_equal_f32s(simd.add_f32s(u, v), one),
            );
            let nearer = simd.and_m32s(simd.less_than_f32s(zero, t), simd.less_than_f32s(t, known));
            let nearer = simd.and_m32s(inside, nearer);
            if simd.first_true_m32s(nearer) == S::F32_LANES {
                continue;
            }
            let number = simd.splat_f32s(f32::from_bits(self.number));
            for (to, value) in [
                (&mut hits.distance, t),
                (&mut hits.u, u),
                (&mut hits.v, v),
                (&mut hits.number, number),
            ] {
                let before = load(simd, to, at);
                store(simd, to, at, simd.select_f32s(nearer, value, before));
            }
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
                    let is_nearer = expected.distance[i] != before.distance[i];
                    let number = if is_nearer {
                        number
                    } else {
                        before.triangle(i)
                    };
                    expected.number[i] = f32::from_bits(number);
                }
            }
            let triangles = |hits: &Hits| [0, 1, 2, 3, 4, 5, 6, 7].map(|i| hits.triangle(i));
            assert_eq!(triangles(&hits), triangles(&expected));
            assert_eq!(hits.distance, expected.distance);
            assert_eq!(hits.triangle(3), NOTHING);
            found += triangles(&hits).iter().filter(|t| **t != NOTHING).count();
        }
        assert!(found > 20, "{found}");
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
