//! Numbers in the lanes of the processor's registers.

use pulp::Simd;

/// Lanes of the widest registers.
pub const MOST: usize = 16;

/// A register with a value for each lane.
#[inline(always)]
pub fn each<S: Simd>(simd: S, value: impl Fn(usize) -> f32) -> S::f32s {
    let mut lanes = [0.0; MOST];
    for (lane, to) in lanes[..S::F32_LANES].iter_mut().enumerate() {
        *to = value(lane);
    }
    load(simd, &lanes)
}

/// A register with as many numbers as it has lanes.
#[inline(always)]
pub fn load<S: Simd>(_: S, from: &[f32; MOST]) -> S::f32s {
    S::as_simd_f32s(&from[..S::F32_LANES]).0[0]
}

/// The lanes of a register.
#[inline(always)]
pub fn lanes<S: Simd>(_: S, register: &S::f32s) -> &[f32] {
    bytemuck::cast_slice(std::slice::from_ref(register))
}

/// Whether a mask is set in any lane.
#[inline(always)]
pub fn any<S: Simd>(simd: S, mask: S::m32s) -> bool {
    simd.first_true_m32s(mask) < S::F32_LANES
}

/// The dot product of vectors in lanes with a vector.
#[inline(always)]
pub fn dot<S: Simd>(simd: S, [x, y, z]: [S::f32s; 3], with: glam::Vec3) -> S::f32s {
    let x = simd.mul_f32s(x, simd.splat_f32s(with.x));
    let y = simd.mul_f32s(y, simd.splat_f32s(with.y));
    let z = simd.mul_f32s(z, simd.splat_f32s(with.z));
    simd.add_f32s(simd.add_f32s(x, y), z)
}

/// The dot product of vectors in lanes.
#[inline(always)]
pub fn dot_each<S: Simd>(simd: S, a: [S::f32s; 3], b: [S::f32s; 3]) -> S::f32s {
    let (x, y) = (simd.mul_f32s(a[0], b[0]), simd.mul_f32s(a[1], b[1]));
    simd.add_f32s(simd.add_f32s(x, y), simd.mul_f32s(a[2], b[2]))
}

/// Rounds numbers of at most 2²² down; whole ones to themselves or to the next below.
#[inline(always)]
pub fn whole<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    const ROUND: f32 = 12_582_912.0;
    let round = simd.splat_f32s(ROUND);
    let x = simd.sub_f32s(x, simd.splat_f32s(0.5));
    simd.sub_f32s(simd.add_f32s(x, round), round)
}

/// The entries of a table at whole numbers, which are within its bounds and below 2²³.
#[inline(always)]
pub fn gather<S: Simd>(simd: S, table: &[f32], at: S::f32s) -> S::f32s {
    // This leaves the number in the lowest bits.
    let bits = simd.add_f32s(at, simd.splat_f32s(8_388_608.0));
    let bits = lanes(simd, &bits);
    let mut found = [0.0; MOST];
    for (to, bits) in found.iter_mut().zip(bits) {
        let index = (bits.to_bits() & 0x7f_ffff) as usize;
        *to = if index < table.len() {
            table[index]
        } else {
            f32::INFINITY
        };
    }
    load(simd, &found)
}
