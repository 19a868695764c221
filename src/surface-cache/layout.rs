//! Divides charts into pages of texels, finer near the casters than far from them, and packs the
//! charts' cells into one table.

use crate::charts::{Chart, Surface, charts};
use glam::{IVec2, UVec2, Vec2, Vec3};
use std::collections::BTreeMap;

/// Texels along a side of a page, without its border.
pub const PAGE: usize = 16;
/// Texels along a side with the border of one texel that bilinear interpolation reads.
pub const BORDERED: usize = PAGE + 2;
/// Texels of a page with its border.
pub const TEXELS: usize = BORDERED * BORDERED;
/// Coarsest level: its texels are 2⁴ times as long as those of level 0.
const COARSEST: u32 = 4;
/// Cells in a row of the table.
pub const TABLE_WIDTH: u32 = 1024;
/// Texels along the casters' extent below which twice as many pages are taken.
const COARSE: f32 = 100.0;
/// Distance from the casters, as a share of their extent, up to which pages have level 0; from
/// there on the length of texels grows with the distance, as penumbrae do.
const NEAR: f32 = 0.4;
/// Share of the texels' length by which the budget of pages may be left unused.
const WELL_FILLED: f32 = 0.94;
/// Distance from the casters, as a share of their extent, beyond which there are no pages.
const REACH: f32 = 7.0;

/// Bounds in the world, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Lower corner.
    pub low: Vec3,
    /// Upper corner.
    pub high: Vec3,
}

impl Bounds {
    /// Bounds that hold nothing.
    pub const NOTHING: Self = Self {
        low: Vec3::INFINITY,
        high: Vec3::NEG_INFINITY,
    };

    /// The bounds of these and `p`.
    #[must_use]
    pub fn with(self, p: Vec3) -> Self {
        Self {
            low: self.low.min(p),
            high: self.high.max(p),
        }
    }

    /// Its eight corners.
    pub fn corners(self) -> impl Iterator<Item = Vec3> {
        (0..8).map(move |i| {
            let pick = |k: usize| {
                if i >> k & 1 == 0 {
                    self.low[k]
                } else {
                    self.high[k]
                }
            };
            Vec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// Distance between two bounds, metres; 0 where they overlap.
    fn distance(&self, other: &Self) -> f32 {
        let gap = (other.low - self.high).max(self.low - other.high);
        gap.max(Vec3::ZERO).length()
    }

    /// The longest side, metres.
    pub fn extent(&self) -> f32 {
        (self.high - self.low).max_element()
    }
}

/// A part whose surface has texels.
pub struct Receiver {
    /// Corners of its triangles, world, metres.
    pub positions: Vec<Vec3>,
    /// Three per triangle.
    pub indices: Vec<u32>,
    /// Its charts.
    pub charts: Vec<Chart>,
}

impl Receiver {
    /// Divides the triangles of a part into charts. `normals`: of its vertices, world.
    pub fn new(positions: Vec<Vec3>, normals: &[Vec3], indices: Vec<u32>) -> Self {
        let surface = Surface {
            positions: &positions,
            indices: &indices,
        };
        let charts = charts(&surface, normals);
        Self {
            positions,
            indices,
            charts,
        }
    }

    /// Its triangles.
    pub fn surface(&self) -> Surface<'_> {
        Surface {
            positions: &self.positions,
            indices: &self.indices,
        }
    }
}

/// A square of texels on a chart.
#[derive(Clone, Debug)]
pub struct Page {
    /// Index of the receiver.
    pub receiver: usize,
    /// Its texels are 2^level times as long as the finest ones.
    pub level: u32,
    /// The cells of its charts.
    pub cells: ChartCells,
    /// Its first cell, relative to theirs.
    pub cell: UVec2,
    /// Triangles that touch it, each with the index of its chart.
    pub triangles: Vec<(usize, u32)>,
}

/// Where the cells of a chart lie in the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ChartCells {
    /// Its first cell in the table.
    pub origin: UVec2,
    /// Cells across and down.
    pub count: UVec2,
}

/// Coordinates of a chart in cells.
#[derive(Clone, Copy, Debug)]
pub struct ChartFrame {
    /// Lower corner of its first cell, metres on its plane.
    pub low: Vec2,
    /// Its cells.
    pub cells: ChartCells,
}

/// The frame of a chart without pages.
const NOWHERE: ChartFrame = ChartFrame {
    low: Vec2::ZERO,
    cells: ChartCells {
        origin: UVec2::ZERO,
        count: UVec2::ZERO,
    },
};

/// Texels across or down up to which charts near the casters share a sheet of pages.
const SLENDER: f32 = 24.0;
/// Texels between charts on a sheet: bilinear interpolation reads one on each side.
const GAP: f32 = 2.0;
/// Texels in a row of a sheet.
const SHEET: f32 = 32.0 * PAGE as f32;

/// All pages for one length of texels.
pub struct Layout {
    /// Length of the finest texels, metres.
    pub texel: f32,
    /// By receiver and chart.
    pub frames: Vec<Vec<ChartFrame>>,
    /// All pages.
    pub pages: Vec<Page>,
    /// Rows of the table.
    pub table_rows: u32,
    /// Receivers without pages, because all would be too many.
    pub left_out: Vec<usize>,
}

impl Layout {
    /// Length of a cell: a page of level 0, metres.
    pub fn cell(&self) -> f32 {
        PAGE as f32 * self.texel
    }

    /// Length of the texels of page `number`, metres.
    pub fn length(&self, number: usize) -> f32 {
        (1 << self.pages[number].level) as f32 * self.texel
    }

    /// Divides the charts of `receivers` into at most `budget` pages, as fine as that allows; into
    /// up to twice as many where texels would be coarse. `casters` bounds the parts that cast shadows.
    /// Where even the coarsest pages are too many, as in a rough scan, each triangle of which is a
    /// chart, receivers get none, those with the most charts first: [`Self::left_out`].
    pub fn fitted(receivers: &[&Receiver], casters: &[Bounds], budget: usize) -> Self {
        let all = casters
            .iter()
            .fold(Bounds::NOTHING, |all, b| all.with(b.low).with(b.high));
        let extent = all.extent();
        if !extent.is_finite() || extent <= 0.0 {
            return Self::empty(receivers);
        }
        let mut roughest: Vec<usize> = (0..receivers.len()).collect();
        roughest.sort_by_key(|r| std::cmp::Reverse(receivers[*r].charts.len()));
        let counts = std::iter::once(0).chain((0..).map(|power| 1 << power));
        for count in counts.take_while(|count| *count < receivers.len()) {
            let left_out = &roughest[..count];
            let fit = |budget| Self::finest(receivers, left_out, casters, extent, budget);
            let fine = fit(budget).filter(|layout| layout.texel < extent / COARSE);
            if let Some(layout) = fine.or_else(|| fit(2 * budget)) {
                return layout;
            }
        }
        Self {
            left_out: roughest,
            ..Self::empty(receivers)
        }
    }

    /// `None` if even the coarsest pages are more than `budget`.
    fn finest(
        receivers: &[&Receiver],
        left_out: &[usize],
        casters: &[Bounds],
        extent: f32,
        budget: usize,
    ) -> Option<Self> {
        let mut texel = extent / 64.0;
        let mut best = None;
        while texel < extent && texel > extent / 2000.0 {
            let layout = Self::new(receivers, left_out, casters, extent, texel, budget);
            let Some(layout) = layout else {
                if best.is_some() {
                    break;
                }
                texel *= 1.6;
                continue;
            };
            // Twice as fine takes at most four times as many pages, and fewer where charts are
            // smaller than a page.
            let finer = (layout.pages.len() as f32 / budget as f32).sqrt();
            best = Some(layout);
            if finer > WELL_FILLED {
                break;
            }
            texel *= finer.max(0.3);
        }
        best
    }

    fn empty(receivers: &[&Receiver]) -> Self {
        Self {
            texel: 1.0,
            frames: receivers
                .iter()
                .map(|r| vec![NOWHERE; r.charts.len()])
                .collect(),
            pages: Vec::new(),
            table_rows: 1,
            left_out: Vec::new(),
        }
    }

    /// `None` if that takes more than `budget` pages.
    fn new(
        receivers: &[&Receiver],
        left_out: &[usize],
        casters: &[Bounds],
        extent: f32,
        texel: f32,
        budget: usize,
    ) -> Option<Self> {
        let mut division = Division {
            casters,
            extent,
            cell: PAGE as f32 * texel,
            budget,
            pages: Vec::new(),
            shelf: Shelf::default(),
        };
        let mut frames = Vec::with_capacity(receivers.len());
        for (r, receiver) in receivers.iter().enumerate() {
            let mut of_charts = vec![NOWHERE; receiver.charts.len()];
            if left_out.contains(&r) {
                frames.push(of_charts);
                continue;
            }
            let mut slender = Vec::new();
            for (c, chart) in receiver.charts.iter().enumerate() {
                let is_slender = (chart.high - chart.low).min_element() < SLENDER * texel;
                if is_slender && division.is_near(receiver, c) {
                    slender.push(c);
                } else {
                    of_charts[c] = division.divide(receiver, (r, c))?;
                }
            }
            if !slender.is_empty() {
                division.pack(receiver, (r, slender), &mut of_charts)?;
            }
            frames.push(of_charts);
        }
        Some(Self {
            texel,
            frames,
            pages: division.pages,
            table_rows: division.shelf.rows(),
            left_out: left_out.to_vec(),
        })
    }
}

/// The division of all charts in progress.
struct Division<'a> {
    casters: &'a [Bounds],
    extent: f32,
    cell: f32,
    budget: usize,
    pages: Vec<Page>,
    shelf: Shelf,
}

/// A square block of cells of a chart.
#[derive(Clone, Copy)]
struct Block {
    level: u32,
    cell: UVec2,
}

impl Division<'_> {
    /// Adds the pages of one chart; `None` if there are too many.
    fn divide(&mut self, receiver: &Receiver, (r, c): (usize, usize)) -> Option<ChartFrame> {
        let chart = &receiver.charts[c];
        let reach = REACH * self.extent;
        let all = self
            .casters
            .iter()
            .fold(Bounds::NOTHING, |all, b| all.with(b.low).with(b.high));
        let near = [all.low - reach, all.high + reach].map(|p| chart.axis.project(p));
        let low = chart.low.max(near[0].min(near[1])) - 0.05 * self.cell;
        let high = chart.high.min(near[0].max(near[1])) + 0.05 * self.cell;
        let size = (high - low) / self.cell;
        if size.min_element() <= 0.0 {
            return Some(ChartFrame {
                low,
                cells: ChartCells::default(),
            });
        }
        let count = size.ceil().as_uvec2().max(UVec2::ONE);
        let cells = ChartCells {
            origin: self.shelf.place(count)?,
            count,
        };
        let frame = ChartFrame { low, cells };
        let surface = receiver.surface();
        let flat = FlatChart {
            owner: (r, c),
            chart,
            surface: &surface,
            frame,
            cell: self.cell,
        };
        let side = 1 << COARSEST;
        for y in (0..count.y).step_by(side) {
            for x in (0..count.x).step_by(side) {
                let block = Block {
                    level: COARSEST,
                    cell: UVec2::new(x, y),
                };
                let triangles = flat.touching(block, &chart.triangles);
                self.split(&flat, block, triangles)?;
            }
        }
        Some(frame)
    }

    /// Adds a block as one page or as four smaller blocks.
    fn split(&mut self, flat: &FlatChart<'_>, block: Block, triangles: Vec<u32>) -> Option<()> {
        let count = flat.frame.cells.count;
        if triangles.is_empty() || block.cell.x >= count.x || block.cell.y >= count.y {
            return Some(());
        }
        let bounds = flat.bounds(block, &triangles);
        let distances = self.casters.iter().map(|c| c.distance(&bounds));
        let distance = distances.fold(f32::INFINITY, f32::min);
        if distance > REACH * self.extent {
            return Some(());
        }
        let wanted = (distance / (NEAR * self.extent)).max(1.0).log2().floor() as u32;
        if block.level > wanted.min(COARSEST) {
            let half = 1 << (block.level - 1);
            for offset in [UVec2::ZERO, UVec2::X, UVec2::Y, UVec2::ONE] {
                let smaller = Block {
                    level: block.level - 1,
                    cell: block.cell + offset * half,
                };
                let inside = flat.touching(smaller, &triangles);
                self.split(flat, smaller, inside)?;
            }
            return Some(());
        }
        let (receiver, chart) = flat.owner;
        self.pages.push(Page {
            receiver,
            level: block.level,
            cells: flat.frame.cells,
            cell: block.cell,
            triangles: triangles.into_iter().map(|t| (chart, t)).collect(),
        });
        (self.pages.len() <= self.budget).then_some(())
    }

    /// Packs the charts `slender` of a receiver side by side into a sheet, row by row, and adds its
    /// pages; `None` if there are too many.
    fn pack(
        &mut self,
        receiver: &Receiver,
        (r, mut slender): (usize, Vec<usize>),
        frames: &mut [ChartFrame],
    ) -> Option<()> {
        let texel = self.cell / PAGE as f32;
        let size = |c: &usize| {
            let chart = &receiver.charts[*c];
            ((chart.high - chart.low) / texel).ceil() + GAP
        };
        slender.sort_by(|a, b| size(b).y.total_cmp(&size(a).y));
        let widest = slender.iter().map(|c| size(c).x).fold(SHEET, f32::max);
        let (mut at, mut height) = (Vec2::ZERO, 0.0);
        for c in &slender {
            let size = size(c);
            if at.x + size.x > widest || at == Vec2::ZERO {
                at = Vec2::new(0.0, at.y + height);
                height = size.y;
            }
            frames[*c].low = receiver.charts[*c].low - (at + 0.5 * GAP) * texel;
            at.x += size.x;
        }
        let count = (Vec2::new(widest, at.y + height) / PAGE as f32).ceil();
        let cells = ChartCells {
            origin: self.shelf.place(count.as_uvec2())?,
            count: count.as_uvec2(),
        };
        slender.iter().for_each(|c| frames[*c].cells = cells);
        self.add_sheet(receiver, (r, &slender), frames)
    }

    /// Adds the pages of a sheet.
    fn add_sheet(
        &mut self,
        receiver: &Receiver,
        (r, charts): (usize, &[usize]),
        frames: &[ChartFrame],
    ) -> Option<()> {
        let surface = receiver.surface();
        let mut pages: BTreeMap<(u32, u32), Vec<(usize, u32)>> = BTreeMap::new();
        for c in charts {
            let (chart, frame) = (&receiver.charts[*c], frames[*c]);
            let flat = FlatChart {
                owner: (r, *c),
                chart,
                surface: &surface,
                frame,
                cell: self.cell,
            };
            let edge = 1.5 * self.cell / PAGE as f32;
            let low = (chart.low - edge - frame.low) / self.cell;
            let high = (chart.high + edge - frame.low) / self.cell;
            let (low, high) = (low.max(Vec2::ZERO).as_uvec2(), high.as_uvec2());
            let high = high.min(frame.cells.count - UVec2::ONE);
            for (y, x) in (low.y..=high.y).flat_map(|y| (low.x..=high.x).map(move |x| (y, x))) {
                let block = Block {
                    level: 0,
                    cell: UVec2::new(x, y),
                };
                let triangles = flat.touching(block, &chart.triangles);
                let own = triangles.into_iter().map(|t| (*c, t));
                pages.entry((y, x)).or_default().extend(own);
            }
        }
        for ((y, x), triangles) in pages.into_iter().filter(|(_, t)| !t.is_empty()) {
            self.pages.push(Page {
                receiver: r,
                level: 0,
                cells: frames[charts[0]].cells,
                cell: UVec2::new(x, y),
                triangles,
            });
        }
        (self.pages.len() <= self.budget).then_some(())
    }

    /// Whether a chart is near enough to the casters for pages of level 0.
    fn is_near(&self, receiver: &Receiver, chart: usize) -> bool {
        let surface = receiver.surface();
        let triangles = receiver.charts[chart].triangles.iter();
        let corners = triangles.flat_map(|t| surface.corners(*t));
        let bounds = corners.fold(Bounds::NOTHING, Bounds::with);
        let distances = self.casters.iter().map(|c| c.distance(&bounds));
        distances.fold(f32::INFINITY, f32::min) <= NEAR * self.extent
    }
}

/// A chart with its frame.
struct FlatChart<'a> {
    owner: (usize, usize),
    chart: &'a Chart,
    surface: &'a Surface<'a>,
    frame: ChartFrame,
    cell: f32,
}

impl FlatChart<'_> {
    /// The block with half a texel more on each side, metres on the chart's plane.
    fn rectangle(&self, block: Block) -> (Vec2, Vec2) {
        let side = (1 << block.level) as f32 * self.cell;
        let low = self.frame.low + block.cell.as_vec2() * self.cell;
        let more = 1.5 * side / PAGE as f32;
        (low - more, low + side + more)
    }

    /// The triangles among `of` whose bounds touch the block.
    fn touching(&self, block: Block, of: &[u32]) -> Vec<u32> {
        let (low, high) = self.rectangle(block);
        of.iter()
            .copied()
            .filter(|t| {
                let flat = self.surface.corners(*t).map(|p| self.chart.axis.project(p));
                let (from, to) = flat
                    .iter()
                    .fold((flat[0], flat[0]), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
                from.cmple(high).all() && to.cmpge(low).all() && !is_apart(flat, low, high)
            })
            .collect()
    }

    /// Bounds of the triangles within the block.
    fn bounds(&self, block: Block, triangles: &[u32]) -> Bounds {
        let (low, high) = self.rectangle(block);
        let mut bounds = Bounds::NOTHING;
        for t in triangles {
            let corners = self.surface.corners(*t);
            let all = corners.iter().fold(Bounds::NOTHING, |b, p| b.with(*p));
            let plane = Plane::through(corners);
            for (x, y) in [
                (low.x, low.y),
                (high.x, low.y),
                (low.x, high.y),
                (high.x, high.y),
            ] {
                let p = plane.point_at(self.chart, Vec2::new(x, y));
                bounds = bounds.with(p.clamp(all.low, all.high));
            }
        }
        bounds
    }
}

/// The plane of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Plane {
    origin: Vec3,
    normal: Vec3,
}

impl Plane {
    /// The plane through three points.
    pub fn through([a, b, c]: [Vec3; 3]) -> Self {
        Self {
            origin: a,
            normal: (b - a).cross(c - a),
        }
    }

    /// The point of the plane at coordinates of a chart, world.
    pub fn point_at(&self, chart: &Chart, flat: Vec2) -> Vec3 {
        let point = chart.axis.lift(flat);
        let direction = chart.axis.unit();
        let steep = self.normal.dot(direction);
        let along = (self.origin - point).dot(self.normal) / steep;
        point + direction * along
    }
}

/// Whether an edge of the triangle separates it from the rectangle.
fn is_apart(flat: [Vec2; 3], low: Vec2, high: Vec2) -> bool {
    let [a, b, c] = flat;
    let sign = (b - a).perp_dot(c - a).signum();
    let rectangle = [
        low,
        Vec2::new(high.x, low.y),
        high,
        Vec2::new(low.x, high.y),
    ];
    [(a, b), (b, c), (c, a)].iter().any(|(u, v)| {
        rectangle
            .iter()
            .all(|p| (*v - *u).perp_dot(*p - *u) * sign < 0.0)
    })
}

/// Packs rectangles into rows of the table. Cell (0, 0) stays free: it belongs to no chart.
#[derive(Debug)]
struct Shelf {
    at: UVec2,
    height: u32,
}

impl Default for Shelf {
    fn default() -> Self {
        Self {
            at: UVec2::X,
            height: 1,
        }
    }
}

/// Rows that the table may have: the device's largest texture has at least as many.
const MAX_ROWS: u32 = 8192;

impl Shelf {
    /// `None` if the table is full.
    fn place(&mut self, size: UVec2) -> Option<UVec2> {
        if size.x > TABLE_WIDTH {
            return None;
        }
        if self.at.x + size.x > TABLE_WIDTH {
            self.at = UVec2::new(0, self.at.y + self.height);
            self.height = 0;
        }
        let origin = self.at;
        self.at.x += size.x;
        self.height = self.height.max(size.y);
        (origin.y + size.y <= MAX_ROWS).then_some(origin)
    }

    const fn rows(&self) -> u32 {
        self.at.y + self.height
    }
}

/// The cells that a page covers within its chart.
pub fn cells_of(page: &Page) -> impl Iterator<Item = (UVec2, UVec2)> {
    let side = 1 << page.level;
    let last = page.cells.count;
    let first = page.cell;
    (0..side * side).filter_map(move |i| {
        let offset = UVec2::new(i % side, i / side);
        let cell = first + offset;
        (cell.x < last.x && cell.y < last.y).then_some((cell, offset))
    })
}

/// Centre of a texel of a page in metres on the chart's plane; the border has coordinates -1 and
/// [`PAGE`].
pub fn texel_centre(layout: &Layout, page: &Page, frame: &ChartFrame, texel: IVec2) -> Vec2 {
    let length = (1 << page.level) as f32 * layout.texel;
    let low = frame.low + page.cell.as_vec2() * layout.cell();
    low + (texel.as_vec2() + 0.5) * length
}
