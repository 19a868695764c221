//! The tiles of the picture that virtual objects may cover, found from the boxes around them. A
//! software driver that examines every sample of every tile instead is far slower.

use super::textures::TILE;
use glam::{DMat4, DVec2, DVec3};

/// Eight corners of a box, world.
pub type Corners = [DVec3; 8];

/// A tile that virtual objects may cover.
const COVERED: u8 = 1;
/// A tile that only a real mirror covers, which may show some.
pub const MIRROR: u8 = 2;

/// Boxes around the virtual parts, and the tiles that they cover in this frame.
#[derive(Debug, Default)]
pub struct Cover {
    boxes: Vec<Option<Corners>>,
    tiles: Vec<u8>,
    across: u32,
    /// First and one past the last covered tile, each way; empty if no tile is covered.
    bounds: [[u32; 2]; 2],
    /// The same of the tiles on which virtual surfaces were drawn since they were last cleared.
    drawn: [[u32; 2]; 2],
    down: u32,
    /// Maximum displacement of objects from their projection, pixels.
    margin: f64,
}

/// The bounding box of `positions`, which are in the frame of the part, placed in the world.
pub fn corners(positions: impl Iterator<Item = DVec3>, world_from_part: DMat4) -> Option<Corners> {
    let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = positions.fold(nothing, |(low, high), p| (low.min(p), high.max(p)));
    low.is_finite().then(|| {
        std::array::from_fn(|i| {
            let pick = |bit: usize, lo: f64, hi: f64| if i >> bit & 1 == 1 { hi } else { lo };
            let p = DVec3::new(
                pick(0, low.x, high.x),
                pick(1, low.y, high.y),
                pick(2, low.z, high.z),
            );
            world_from_part.transform_point3(p)
        })
    })
}

impl Cover {
    /// Sets the boxes of a new scene: one for each part that has an extent.
    pub fn set_boxes(&mut self, boxes: Vec<Option<Corners>>) {
        self.boxes = boxes;
    }

    /// Sets the box of part `index` after it has moved.
    pub fn set_box(&mut self, index: usize, corners: Corners) {
        if let Some(slot) = self.boxes.get_mut(index) {
            *slot = Some(corners);
        }
    }

    /// The boxes around the virtual parts, world.
    pub fn boxes(&self) -> &[Option<Corners>] {
        &self.boxes
    }

    /// Sets the maximum displacement of objects from their projection, pixels.
    pub const fn set_margin(&mut self, pixels: f64) {
        self.margin = pixels;
    }

    /// Finds the covered tiles of a picture of `size` pixels; the boxes `more` are for this frame
    /// only, `mirrors` those of real mirrors.
    pub fn update(
        &mut self,
        clip_from_world: DMat4,
        (width, height): (u32, u32),
        visible: bool,
        more: impl Iterator<Item = Corners>,
        mirrors: impl Iterator<Item = Corners>,
    ) {
        let (across, down) = (width.div_ceil(TILE), height.div_ceil(TILE));
        (self.across, self.down) = (across, down);
        self.tiles.clear();
        self.tiles.resize((across * down) as usize, 0);
        if visible {
            let size = DVec2::new(f64::from(width), f64::from(height));
            let boxes = self.boxes.iter().flatten().copied().chain(more);
            let boxes = boxes.map(|corners| (corners, COVERED));
            for (corners, kind) in boxes.chain(mirrors.map(|corners| (corners, MIRROR))) {
                let tiles = Tiles {
                    kinds: &mut self.tiles,
                    size: (across, down),
                };
                tiles.mark(outline(&corners, clip_from_world, size), self.margin, kind);
            }
        }
        self.bounds = bounds(&self.tiles, across);
    }

    /// Leaves those tiles of real mirrors out of which `shows` says that they show nothing virtual.
    pub fn keep_mirrors(&mut self, shows: impl Fn(usize) -> bool) {
        for (i, tile) in self.tiles.iter_mut().enumerate() {
            if *tile == MIRROR && !shows(i) {
                *tile = 0;
            }
        }
        self.bounds = bounds(&self.tiles, self.across);
    }

    /// One byte per tile, row by row; 0 if it is not covered.
    pub fn tiles(&self) -> &[u8] {
        &self.tiles
    }

    /// The rectangle of covered tiles: x, y, width, height, tiles; width 0 if there are none.
    pub const fn rectangle(&self) -> [u32; 4] {
        rectangle(self.bounds)
    }

    /// The rectangle of the covered tiles and of all on which something was drawn before, likewise:
    /// where the picture of virtual surfaces must be cleared.
    pub fn rectangle_to_clear(&self) -> [u32; 4] {
        let limits = [self.across, self.down];
        let drawn = std::array::from_fn(|i| self.drawn[i].map(|at| at.min(limits[i])));
        rectangle(join(self.bounds, drawn))
    }

    /// Records that the rectangle was cleared and the covered tiles drawn.
    pub const fn set_drawn(&mut self) {
        self.drawn = self.bounds;
    }
}

const fn rectangle([x, y]: [[u32; 2]; 2]) -> [u32; 4] {
    [x[0], y[0], x[1] - x[0], y[1] - y[0]]
}

/// The bounds of two rectangles, of which either may be empty.
fn join(a: [[u32; 2]; 2], b: [[u32; 2]; 2]) -> [[u32; 2]; 2] {
    let is_empty = |[x, y]: [[u32; 2]; 2]| x[0] == x[1] || y[0] == y[1];
    match (is_empty(a), is_empty(b)) {
        // An empty one may begin beyond a picture that has become smaller.
        (true, true) => [[0; 2]; 2],
        (true, false) => b,
        (false, true) => a,
        _ => std::array::from_fn(|i| [a[i][0].min(b[i][0]), a[i][1].max(b[i][1])]),
    }
}

/// The pixels of the corners of a box; `None` if it reaches behind the camera.
fn outline(corners: &Corners, clip_from_world: DMat4, size: DVec2) -> Option<[DVec2; 8]> {
    let mut pixels = [DVec2::ZERO; 8];
    for (pixel, corner) in pixels.iter_mut().zip(corners) {
        let clip = clip_from_world * corner.extend(1.0);
        if clip.w < 1e-3 {
            return None;
        }
        let ndc = clip.truncate().truncate() / clip.w;
        *pixel = (ndc * DVec2::new(0.5, -0.5) + 0.5) * size;
    }
    Some(pixels)
}

/// The kinds of tiles, row by row, and their number across and down.
struct Tiles<'a> {
    kinds: &'a mut [u8],
    size: (u32, u32),
}

impl Tiles<'_> {
    /// Marks those that the convex hull of `outline` touches, all without one. No kind replaces another.
    fn mark(self, outline: Option<[DVec2; 8]>, margin: f64, kind: u8) {
        let Self { kinds, size } = self;
        let mark = |tile: &mut u8| *tile = if *tile == 0 { kind } else { *tile };
        match outline {
            Some(outline) => touched(size, &outline, margin, |tile| mark(&mut kinds[tile])),
            None => kinds.iter_mut().for_each(mark),
        }
    }
}

/// Calls `mark` for the tiles that the convex hull of `outline` touches: those that no line through
/// two of its points separates from it.
fn touched(
    (across, down): (u32, u32),
    outline: &[DVec2; 8],
    margin: f64,
    mut mark: impl FnMut(usize),
) {
    let side = f64::from(TILE);
    let low = outline
        .iter()
        .copied()
        .reduce(DVec2::min)
        .unwrap_or_default();
    let high = outline
        .iter()
        .copied()
        .reduce(DVec2::max)
        .unwrap_or_default();
    // One pixel more on each side: surfaces reach half a pixel beyond the centre of their edge.
    let more = 1.0 + margin;
    let range = |lo: f64, hi: f64, count: u32| {
        let last = f64::from(count);
        let from = ((lo - more) / side).floor().clamp(0.0, last) as u32;
        from..((hi + more) / side).ceil().clamp(0.0, last) as u32
    };
    let edges = hull_edges(outline);
    for y in range(low.y, high.y, down) {
        for x in range(low.x, high.x, across) {
            let centre = (DVec2::new(f64::from(x), f64::from(y)) + 0.5) * side;
            let apart = edges.iter().flatten().any(|(normal, offset)| {
                let reach = (side * 0.5 + more) * (normal.x.abs() + normal.y.abs());
                normal.dot(centre) - offset > reach
            });
            if !apart {
                mark((y * across + x) as usize);
            }
        }
    }
}

/// Outward normals and offsets of the lines through pairs of points that have all other points on
/// one side.
fn hull_edges(points: &[DVec2; 8]) -> [Option<(DVec2, f64)>; 56] {
    let mut edges = [None; 56];
    let pairs = (0..8).flat_map(|a| (0..8).filter(move |b| *b != a).map(move |b| (a, b)));
    for (edge, (a, b)) in edges.iter_mut().zip(pairs) {
        let normal = (points[b] - points[a]).perp();
        let offset = normal.dot(points[a]);
        let outermost = points.iter().all(|p| normal.dot(*p) <= offset + 1e-6);
        *edge = (outermost && normal != DVec2::ZERO).then_some((normal, offset));
    }
    edges
}

fn bounds(tiles: &[u8], across: u32) -> [[u32; 2]; 2] {
    let mut bounds = [[u32::MAX, 0]; 2];
    for (tile, i) in tiles.iter().zip(0..) {
        if *tile != 0 {
            for (b, at) in bounds.iter_mut().zip([i % across, i / across]) {
                *b = [b[0].min(at), b[1].max(at + 1)];
            }
        }
    }
    bounds.map(|[from, to]| [from.min(to), to])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(at: DVec3, side: f64) -> Option<Corners> {
        let ends = [DVec3::splat(-side / 2.0), DVec3::splat(side / 2.0)];
        corners(ends.into_iter(), DMat4::from_translation(at))
    }

    /// A camera at the origin that looks along +Z, with a field of view of 90°.
    fn clip() -> DMat4 {
        DMat4::from_cols_array(&[
            1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.02, 0.0,
        ])
    }

    fn update(cover: &mut Cover, size: (u32, u32), visible: bool, mirror: Option<Corners>) {
        let none = std::iter::empty();
        cover.update(clip(), size, visible, none, mirror.into_iter());
    }

    #[test]
    fn box_covers_the_tiles_of_its_projection() {
        let mut cover = Cover::default();
        cover.set_boxes(vec![cube(DVec3::new(0.0, 0.0, 2.0), 0.1)]);
        update(&mut cover, (20 * TILE, 20 * TILE), true, None);
        // 0.1 m at 1.95 m is half a tile each way about the centre: tiles 9 and 10.
        assert_eq!(cover.rectangle(), [9, 9, 2, 2]);
        assert_eq!(cover.tiles().iter().filter(|t| **t != 0).count(), 4);
        update(&mut cover, (20 * TILE, 20 * TILE), false, None);
        assert_eq!(cover.rectangle()[2], 0);
    }

    #[test]
    fn mirrors_cover_tiles_only_where_they_show_something() {
        let mut cover = Cover::default();
        cover.set_boxes(vec![cube(DVec3::new(0.0, 0.0, 2.0), 0.1)]);
        let size = (20 * TILE, 20 * TILE);
        let mirror = cube(DVec3::new(0.4, 0.0, 2.0), 0.1);
        update(&mut cover, size, true, mirror);
        assert!(cover.rectangle()[2] > 2);
        cover.keep_mirrors(|_| false);
        assert_eq!(cover.rectangle(), [9, 9, 2, 2]);
        let same = cube(DVec3::new(0.0, 0.0, 2.0), 0.1);
        update(&mut cover, size, true, same);
        cover.keep_mirrors(|_| false);
        assert_eq!(cover.rectangle(), [9, 9, 2, 2]);
    }

    #[test]
    fn what_was_drawn_is_cleared_even_where_nothing_is_any_more() {
        let mut cover = Cover::default();
        let mut show = |at: f64, size: u32, is_drawn: bool| {
            cover.set_boxes(vec![cube(DVec3::new(at, 0.0, 2.0), 0.1)]);
            update(&mut cover, (size, size), true, None);
            let cleared = cover.rectangle_to_clear();
            if is_drawn {
                cover.set_drawn();
            }
            cleared
        };
        assert_eq!(show(0.0, 20 * TILE, true), [9, 9, 2, 2]);
        let moved = show(0.4, 20 * TILE, false);
        assert!(moved[0] == 9 && moved[2] >= 3, "{moved:?}");
        // The frame before was not drawn: what the first one drew is still there.
        assert_eq!(
            show(-0.4, 20 * TILE, true)[0] + show(0.0, 20 * TILE, true)[0],
            14
        );
        // A smaller picture has new textures; the rectangle must lie in it.
        let [x, y, width, height] = show(0.0, 4 * TILE, true);
        assert!(x + width <= 4 && y + height <= 4);
    }

    #[test]
    fn nothing_is_cleared_beyond_a_smaller_picture_without_objects() {
        let mut cover = Cover::default();
        cover.set_boxes(vec![cube(DVec3::new(0.0, 0.0, 2.0), 0.1)]);
        update(&mut cover, (20 * TILE, 20 * TILE), true, None);
        cover.set_drawn();
        update(&mut cover, (5, 5), false, None);
        assert_eq!(cover.rectangle_to_clear(), [0; 4]);
    }

    #[test]
    fn diagonal_bar_covers_no_corner_tiles_and_box_around_the_camera_covers_all() {
        let mut cover = Cover::default();
        let turn = DMat4::from_translation(DVec3::Z * 2.0)
            * DMat4::from_rotation_z(std::f64::consts::FRAC_PI_4);
        let ends = [DVec3::new(-1.0, -0.01, 0.0), DVec3::new(1.0, 0.01, 0.0)];
        cover.set_boxes(vec![corners(ends.into_iter(), turn)]);
        update(&mut cover, (20 * TILE, 20 * TILE), true, None);
        let covered = cover.tiles().iter().filter(|t| **t != 0).count();
        assert!((10..60).contains(&covered), "{covered}");
        cover.set_boxes(vec![cube(DVec3::ZERO, 1.0)]);
        update(&mut cover, (20 * TILE, 20 * TILE), true, None);
        assert_eq!(cover.rectangle(), [0, 0, 20, 20]);
    }
}
