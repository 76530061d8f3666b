//! Arithmetic on which the recorded trajectories depend to the last bit.
//!
//! The reference takes sine, cosine and powers from the C library, which does not always round them correctly. So do these
//! environments: where the C library is another, states may differ from the recorded ones in the last bits.

use std::f64::consts::{FRAC_PI_2, TAU};

/// A square as NumPy and Python raise to a power: by `pow`, which misses x · x in one of a thousand cases.
pub(super) fn squared(x: f64) -> f64 {
    // A constant exponent would become a product.
    x.powf(std::hint::black_box(2.0))
}

/// Python's `x % modulus`, for a positive modulus.
pub(super) fn modulo(x: f64, modulus: f64) -> f64 {
    let rest = x % modulus;
    if rest < 0.0 { rest + modulus } else { rest }
}

/// A point turned by an angle, as `pygame.math.Vector2.rotate_rad` does it: exactly by quarter turns.
pub(super) fn rotated([x, y]: [f64; 2], angle: f64) -> [f64; 2] {
    const NEAR: f64 = 1e-6;
    let angle = modulo(angle, TAU);
    if (angle + NEAR) % FRAC_PI_2 < 2.0 * NEAR {
        return match ((angle + NEAR) / FRAC_PI_2) as u8 {
            1 => [-y, x],
            2 => [-x, -y],
            3 => [y, -x],
            _ => [x, y],
        };
    }
    let (sin, cos) = (angle.sin(), angle.cos());
    [cos * x - sin * y, sin * x + cos * y]
}

/// The corners of a rectangle, in Gymnasium's order, turned by an angle and moved.
pub(super) fn turned_rectangle(x: [f64; 2], y: [f64; 2], angle: f64, to: [f64; 2]) -> [[f64; 2]; 4] {
    [[x[0], y[0]], [x[0], y[1]], [x[1], y[1]], [x[1], y[0]]].map(|corner| {
        let turned = rotated(corner, angle);
        [turned[0] + to[0], turned[1] + to[1]]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_those_of_the_power_function() {
        let differs = |i: u32| {
            let x = f64::from(i) * 0.001_234_567_891;
            assert!((squared(x) - x * x).abs() <= x * x * f64::EPSILON);
            squared(x) != x * x
        };
        let count = (1..20_000).filter(|&i| differs(i)).count();
        assert!(count < 200, "{count} of 20,000 squares are not the product");
    }

    #[test]
    fn quarter_turns_are_exact() {
        for turns in -5..=5_i32 {
            let [x, y] = rotated([2.0, 1.0], f64::from(turns) * FRAC_PI_2);
            let expected = [[2.0, 1.0], [-1.0, 2.0], [-2.0, -1.0], [1.0, -2.0]];
            assert_eq!([x, y], expected[turns.rem_euclid(4) as usize], "{turns}");
        }
        let [x, y] = rotated([1.0, 0.0], 0.5);
        assert_eq!([x, y], [0.5_f64.cos(), 0.5_f64.sin()]);
    }
}
