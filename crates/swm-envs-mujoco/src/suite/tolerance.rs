//! `tolerance`: the reward for being within bounds, falling off over a margin. From `dm_control`'s `utils/rewards.py`.

/// How the reward falls off beyond the bounds; each takes its value at the margin.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Falloff {
    /// exp(-(d k)²/2)
    Gaussian(f64),
    /// 1 / cosh(d k)
    Hyperbolic(f64),
    /// 1 / ((d k)² + 1)
    LongTail(f64),
    /// 1 / (|d| k + 1)
    Reciprocal(f64),
    /// (1 + cos(π d k)) / 2, and 0 where |d k| is 1 or more
    Cosine(f64),
    /// 1 - d k, and 0 where |d k| is 1 or more
    Linear(f64),
    /// 1 - (d k)², and 0 where |d k| is 1 or more
    Quadratic(f64),
    /// 1 - tanh²(d k)
    TanhSquared(f64),
}

/// The default of `dm_control`: a Gaussian that has fallen to 0.1 at the margin.
pub const GAUSSIAN: Falloff = Falloff::Gaussian(0.1);

/// 1 where `low <= x <= high`; else the fall-off of the distance to the nearer bound in units of `margin`, or 0 if the
/// margin is 0.
pub fn tolerance(x: f64, [low, high]: [f64; 2], margin: f64, falloff: Falloff) -> f64 {
    if low <= x && x <= high {
        return 1.0;
    }
    if margin == 0.0 {
        return 0.0;
    }
    let distance = if x < low { low - x } else { x - high } / margin;
    falloff.at(distance)
}

impl Falloff {
    fn at(self, x: f64) -> f64 {
        let inside = |scaled: f64, value: f64| if scaled.abs() < 1.0 { value } else { 0.0 };
        match self {
            Falloff::Gaussian(value) => {
                let scaled = x * (-2.0 * value.ln()).sqrt();
                (-0.5 * (scaled * scaled)).exp()
            }
            Falloff::Hyperbolic(value) => 1.0 / (x * (1.0 / value).acosh()).cosh(),
            Falloff::LongTail(value) => {
                let scaled = x * (1.0 / value - 1.0).sqrt();
                1.0 / (scaled * scaled + 1.0)
            }
            Falloff::Reciprocal(value) => 1.0 / (x.abs() * (1.0 / value - 1.0) + 1.0),
            Falloff::Cosine(value) => {
                let scaled = x * ((2.0 * value - 1.0).acos() / std::f64::consts::PI);
                inside(scaled, (1.0 + (std::f64::consts::PI * scaled).cos()) / 2.0)
            }
            Falloff::Linear(value) => {
                let scaled = x * (1.0 - value);
                inside(scaled, 1.0 - scaled)
            }
            Falloff::Quadratic(value) => {
                let scaled = x * (1.0 - value).sqrt();
                inside(scaled, 1.0 - scaled * scaled)
            }
            Falloff::TanhSquared(value) => {
                let tanh = (x * (1.0 - value).sqrt().atanh()).tanh();
                1.0 - tanh * tanh
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [fn(f64) -> Falloff; 8] = [
        Falloff::Gaussian,
        Falloff::Hyperbolic,
        Falloff::LongTail,
        Falloff::Reciprocal,
        Falloff::Cosine,
        Falloff::Linear,
        Falloff::Quadratic,
        Falloff::TanhSquared,
    ];

    #[test]
    fn every_falloff_is_one_at_the_bound_and_the_given_value_at_the_margin() {
        for falloff in ALL {
            for value in [0.1, 0.5, 0.9] {
                let at = |x| tolerance(x, [-1.0, 2.0], 4.0, falloff(value));
                assert_eq!(at(2.0), 1.0);
                assert!((at(2.0 + 1e-9) - 1.0).abs() < 1e-7, "{:?}", falloff(value));
                for x in [6.0, -5.0] {
                    assert!((at(x) - value).abs() < 1e-12, "{:?} at {x}: {}", falloff(value), at(x));
                }
                assert!(at(20.0) < at(5.0) && at(5.0) < at(3.0), "{:?} falls", falloff(value));
            }
        }
    }

    #[test]
    fn without_a_margin_it_is_all_or_nothing() {
        assert_eq!(tolerance(0.0, [0.0, 0.0], 0.0, GAUSSIAN), 1.0);
        assert_eq!(tolerance(1e-300, [0.0, 0.0], 0.0, GAUSSIAN), 0.0);
        assert_eq!(tolerance(1e300, [0.0, f64::INFINITY], 0.0, GAUSSIAN), 1.0);
    }

    #[test]
    fn finite_falloffs_end() {
        assert_eq!(tolerance(-11.0, [10.0, f64::INFINITY], 10.0, Falloff::Linear(0.0)), 0.0);
        assert_eq!(tolerance(4.0, [10.0, f64::INFINITY], 10.0, Falloff::Linear(0.0)), 0.4);
    }
}
