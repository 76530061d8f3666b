//! The discrete variant's actions: 16 radii times 16 angles.

use std::f64::consts::TAU;

use swm_core::Space;

/// Bins per coordinate.
const BINS: i64 = 16;

/// The action space: radius bin, angle bin.
pub(super) fn space() -> Space {
    Space::MultiDiscrete { n: vec![BINS, BINS], start: vec![0, 0] }
}

/// The middle of a bin, as a relative action; the largest radius is 31/32.
pub fn to_continuous([radius, angle]: [i64; 2]) -> [f32; 2] {
    let radius = (radius as f64 + 0.5) / BINS as f64;
    let angle = (angle as f64 + 0.5) / BINS as f64 * TAU;
    [(angle.cos() * radius) as f32, (angle.sin() * radius) as f32]
}

/// The bin of a relative action; radii of 15/16 and more share the last.
pub fn from_continuous(action: [f32; 2]) -> [i64; 2] {
    let [x, y] = action.map(f64::from);
    let last = (BINS - 1) as f64;
    let radius = (BINS as f64 * x.hypot(y)).clamp(0.0, last);
    let angle = (BINS as f64 * y.atan2(x).rem_euclid(TAU) / TAU).clamp(0.0, last);
    [radius as i64, angle as i64]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bins_and_their_middles_agree() {
        for radius in 0..BINS {
            for angle in 0..BINS {
                assert_eq!(from_continuous(to_continuous([radius, angle])), [radius, angle]);
            }
        }
        assert_eq!(from_continuous([0.0, 0.0]), [0, 0]);
        assert_eq!(from_continuous([1.0, 1.0]), [15, 2]);
        assert_eq!(from_continuous([1.0, -1e-9]), [15, 15]);
    }
}
