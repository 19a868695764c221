//! Irradiance by normal on an octahedron: the tables of the device, for what the processor lights.

use glam::{UVec2, Vec2, Vec3, Vec4};

/// RGB by normal, and 0.
pub(super) struct NormalTable {
    side: usize,
    texels: Vec<Vec4>,
}

/// Where a normal lies between four texels of a table.
#[derive(Clone, Copy)]
pub(super) struct Place {
    first: u32,
    part: Vec2,
}

impl NormalTable {
    /// A dark table of `side²` texels.
    pub fn new(side: u32) -> Self {
        let side = side as usize;
        Self {
            side,
            texels: vec![Vec4::ZERO; side * side],
        }
    }

    /// Sums lights: directions towards them, and their irradiance on a surface that faces them.
    pub fn sum(&mut self, lights: impl Iterator<Item = (Vec3, Vec3)> + Clone) {
        self.fill(|n| {
            let each = lights.clone();
            let sum: Vec3 = each.map(|(l, s)| s * l.dot(n).max(0.0)).sum();
            sum.extend(0.0)
        });
    }

    /// Takes over what `irradiance` is for each normal.
    pub fn fill(&mut self, irradiance: impl Fn(Vec3) -> Vec4) {
        let step = 2.0 / (self.side - 1) as f32;
        let rows = self.texels.chunks_exact_mut(self.side).zip(0_u16..);
        for (row, y) in rows {
            for (texel, x) in row.iter_mut().zip(0_u16..) {
                let at = Vec2::new(f32::from(x), f32::from(y)) * step - 1.0;
                *texel = irradiance(normal_from_octahedron(at));
            }
        }
    }

    /// Place of the normal `n`.
    pub fn place(&self, n: Vec3) -> Place {
        let at = (octahedron_from_normal(n) * 0.5 + 0.5) * (self.side - 1) as f32;
        let low = at.as_uvec2().min(UVec2::splat(self.side as u32 - 2));
        Place {
            first: low.y * self.side as u32 + low.x,
            part: at - low.as_vec2(),
        }
    }

    /// Irradiance at a place.
    pub fn at(&self, place: Place) -> Vec4 {
        let (first, part) = (place.first as usize, place.part);
        let row = |first: usize| self.texels[first].lerp(self.texels[first + 1], part.x);
        row(first).lerp(row(first + self.side), part.y)
    }
}

/// Twin of WGSL `normal_from_octahedron` in `lib/normal.wgsl`.
pub(super) fn normal_from_octahedron(p: Vec2) -> Vec3 {
    let mut n = Vec3::new(p.x, p.y, 1.0 - p.x.abs() - p.y.abs());
    let t = (-n.z).max(0.0);
    n.x -= t.copysign(n.x);
    n.y -= t.copysign(n.y);
    n.normalize()
}

/// Twin of WGSL `octahedron_from_normal`.
fn octahedron_from_normal(n: Vec3) -> Vec2 {
    let p = n.truncate() / (n.x.abs() + n.y.abs() + n.z.abs());
    if n.z >= 0.0 {
        return p;
    }
    let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
    Vec2::new((1.0 - p.y.abs()) * sign(p.x), (1.0 - p.x.abs()) * sign(p.y))
}
