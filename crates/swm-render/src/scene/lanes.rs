//! Eight values at a time (SIMD). Only operations that IEEE rounds exactly, so that lanes are the same on every CPU.

use std::ops::{Add, Mul, Neg, Sub};

use wide::{f32x8, i32x8};

use super::vector::Vector;

/// Numbers per lane group.
pub(super) const LANES: usize = 8;

/// Eight values.
pub(super) type Lanes = f32x8;

pub(super) fn splat(value: f32) -> Lanes {
    Lanes::splat(value)
}

/// Up to eight values from a slice; what is missing is `fill`.
#[inline]
pub(super) fn load(values: &[f32], fill: f32) -> Lanes {
    match values.first_chunk::<LANES>() {
        Some(chunk) => Lanes::new(*chunk),
        None => {
            let mut padded = [fill; LANES];
            padded[..values.len()].copy_from_slice(values);
            Lanes::new(padded)
        }
    }
}

/// Four values and four more.
#[inline]
pub(super) fn both([a, b, c, d]: [f32; 4], [e, f, g, h]: [f32; 4]) -> Lanes {
    Lanes::new([a, b, c, d, e, f, g, h])
}

/// Eight points or directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lanes3 {
    pub(super) x: Lanes,
    pub(super) y: Lanes,
    pub(super) z: Lanes,
}

impl Lanes3 {
    pub(super) fn splat(v: Vector) -> Self {
        Self { x: splat(v[0] as f32), y: splat(v[1] as f32), z: splat(v[2] as f32) }
    }

    #[inline]
    pub(super) fn dot(self, other: Self) -> Lanes {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline]
    pub(super) fn scaled(self, by: Lanes) -> Self {
        Self { x: self.x * by, y: self.y * by, z: self.z * by }
    }

    /// The values of x, of y and of z.
    #[inline]
    pub(super) fn to_arrays(self) -> [[f32; LANES]; 3] {
        [self.x.to_array(), self.y.to_array(), self.z.to_array()]
    }

    /// Length 1; zero vectors stay what they are.
    #[inline]
    pub(super) fn normalized(self) -> Self {
        let squared = self.dot(self);
        let some = squared.simd_gt(splat(0.0));
        let inverse = some.select(splat(1.0) / squared.sqrt(), splat(0.0));
        self.scaled(inverse)
    }

    /// The rows of `m` times this.
    #[inline]
    pub(super) fn rotated(self, m: &[[f32; 3]; 3]) -> Self {
        let row = |r: [f32; 3]| self.x * splat(r[0]) + self.y * splat(r[1]) + self.z * splat(r[2]);
        Self { x: row(m[0]), y: row(m[1]), z: row(m[2]) }
    }
}

impl Add for Lanes3 {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl Sub for Lanes3 {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl Mul for Lanes3 {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        Self { x: self.x * other.x, y: self.y * other.y, z: self.z * other.z }
    }
}

impl Neg for Lanes3 {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}

/// `base` to the power of `exponent`, for bases from 0 to 1 and exponents from 0 to 128; within 3e-5.
///
/// A custom polynomial, because the system's `pow` differs from machine to machine.
#[inline]
pub(super) fn power(base: Lanes, exponent: f32) -> Lanes {
    exp2(log2(base.max(splat(1e-30))) * splat(exponent))
}

/// Base-2 logarithm of positive values: the exponent, and a series in (m - 1) / (m + 1) for the mantissa.
#[inline]
fn log2(value: Lanes) -> Lanes {
    let bits = i32x8::new(value.to_array().map(|number| number.to_bits() as i32));
    let exponent = Lanes::from_i32x8((bits >> 23) - i32x8::splat(127));
    let mantissa = (bits & i32x8::splat(0x007f_ffff)) | i32x8::splat(0x3f80_0000);
    let mantissa = Lanes::new(mantissa.to_array().map(|bits| f32::from_bits(bits as u32)));
    // Around 1, where the series is best.
    let is_large = mantissa.simd_gt(splat(std::f32::consts::SQRT_2));
    let exponent = exponent + is_large.select(splat(1.0), splat(0.0));
    let mantissa = is_large.select(splat(0.5) * mantissa, mantissa);
    let s = (mantissa - splat(1.0)) / (mantissa + splat(1.0));
    let s2 = s * s;
    // 2 / ln 2 times (s + s^3/3 + s^5/5 + s^7/7 + s^9/9).
    let series = s2 * splat(0.320_599) + splat(0.412_198_58);
    let series = s2 * series + splat(0.577_078_02);
    let series = s2 * series + splat(0.961_796_7);
    let series = s2 * series + splat(2.885_39);
    exponent + s * series
}

/// 2 to the power of values up to 0; below -126 it is 0.
#[inline]
fn exp2(value: Lanes) -> Lanes {
    let value = value.max(splat(-127.0));
    // Rounded down: values here are at most 0.
    let whole = Lanes::from_i32x8(value.fast_trunc_int());
    let whole = whole - whole.simd_gt(value).select(splat(1.0), splat(0.0));
    let part = (value - whole) * splat(std::f32::consts::LN_2);
    let series = part * splat(1.0 / 720.0) + splat(1.0 / 120.0);
    let series = part * series + splat(1.0 / 24.0);
    let series = part * series + splat(1.0 / 6.0);
    let series = part * series + splat(0.5);
    let series = part * series + splat(1.0);
    let series = part * series + splat(1.0);
    // The number with this exponent and nothing behind it; with none at all, 0.
    let biased: i32x8 = (whole.fast_trunc_int() + i32x8::splat(127)) << 23;
    let scale = Lanes::new(biased.to_array().map(|bits| f32::from_bits(bits as u32)));
    series * scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_near_the_exact_ones() {
        for exponent in [0.0, 0.5, 1.0, 10.0, 64.0, 128.0] {
            for step in 0..=1000 {
                let base = step as f32 / 1000.0;
                let found = power(splat(base), exponent).to_array()[3];
                let exact = f64::from(base).powf(f64::from(exponent));
                assert!((f64::from(found) - exact).abs() < 3e-5, "{base}^{exponent}: {found} {exact}");
            }
        }
    }

    #[test]
    fn short_slices_are_padded() {
        assert_eq!(load(&[1.0, 2.0], 9.0).to_array(), [1.0, 2.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0]);
    }
}
