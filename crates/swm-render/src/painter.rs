//! What an environment's drawing code sees: the primitives, the colors, and the rounding that they share.

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// The primitives that scenes are drawn with, in drawing order: later ones cover earlier ones.
///
/// Points are `[x, y]` in canvas pixels (x right, y down; [`Geometry::canvas`](crate::Geometry) pixels a side) and may
/// lie anywhere: what falls outside is not drawn. The exact painter rounds coordinates and radii half to even.
pub trait Painter {
    /// Everything in one color.
    fn fill(&mut self, color: Rgb);

    /// A filled polygon, boundary included. Fewer than 1 vertex draws nothing. Where the boundary crosses itself the
    /// even-odd rule holds.
    fn polygon(&mut self, vertices: &[[f64; 2]], color: Rgb);

    /// A filled disc; a radius that rounds to less than 1 draws nothing.
    fn disc(&mut self, center: [f64; 2], radius: f64, color: Rgb);

    /// A line with round ends, of radius 2 px.
    fn fat_segment(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb);

    /// An anti-aliased line, 1 px wide.
    fn aa_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb);

    /// A filled polygon with anti-aliased edges. The exact painter truncates coordinates toward zero, and follows pygame's
    /// `gfxdraw.aapolygon` and `gfxdraw.filled_polygon`.
    fn smooth_polygon(&mut self, vertices: &[[f64; 2]], color: Rgb);

    /// A filled disc with an anti-aliased edge, about the middle of a pixel; a radius below 0 draws nothing. The exact
    /// painter truncates center and radius toward zero, and follows `gfxdraw.aacircle` and `gfxdraw.filled_circle`.
    fn smooth_disc(&mut self, center: [f64; 2], radius: f64, color: Rgb);

    /// An anti-aliased line between points that need not be whole pixels. The exact painter follows
    /// `pygame.draw.aaline`.
    fn smooth_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb);

    /// A horizontal or vertical line, 1 px wide, both ends included; any other draws nothing. The exact painter truncates
    /// coordinates toward zero.
    fn axis_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb);

    /// An arc with an arrow head, in a square of `side` px about `center`: how Gymnasium's pendulum shows its torque. It
    /// turns clockwise, or the other way if `mirrored`. A side below 1 draws nothing.
    fn turn_arrow(&mut self, center: [f64; 2], side: f64, mirrored: bool, color: Rgb);
}

/// The lighter shade in which the reference fills what it outlines: 1.2 times each channel, at most 255, rounded half
/// to even, in f32.
#[must_use]
pub fn light(color: Rgb) -> Rgb {
    color.map(|channel| (1.2_f32 * f32::from(channel)).min(255.0).round_ties_even() as u8)
}

/// Coordinates are clamped to this many pixels either side of the origin, so that raster arithmetic cannot overflow.
const MAX_COORDINATE: f64 = (1 << 20) as f64;

/// The pixel coordinate of a world coordinate, truncated toward zero, clamped to ±2^20; NaN becomes 0.
pub(crate) fn truncate(coordinate: f64) -> i32 {
    coordinate.clamp(-MAX_COORDINATE, MAX_COORDINATE) as i32
}

/// A world coordinate in f32, clamped to ±2^20.
pub(crate) fn single(coordinate: f64) -> f32 {
    coordinate.clamp(-MAX_COORDINATE, MAX_COORDINATE) as f32
}

/// The pixel coordinate of a world coordinate: rounded half to even, clamped to ±2^20; NaN becomes 0.
#[must_use]
pub fn round_half_even(coordinate: f64) -> i32 {
    coordinate.round_ties_even().clamp(-MAX_COORDINATE, MAX_COORDINATE) as i32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_rounds_in_f32_and_saturates() {
        assert_eq!(light([65, 105, 225]), [78, 126, 255]);
        assert_eq!(light([115, 127, 145]), [138, 152, 174]);
        assert_eq!(light([180, 189, 204]), [216, 227, 245]);
        assert_eq!(light([0, 255, 212]), [0, 255, 254]);
    }

    #[test]
    fn halves_go_to_the_even_neighbor() {
        let cases = [(0.5, 0), (1.5, 2), (2.5, 2), (-0.5, 0), (-1.5, -2), (2.499, 2), (f64::NAN, 0)];
        for (coordinate, expected) in cases {
            assert_eq!(round_half_even(coordinate), expected, "{coordinate}");
        }
        assert_eq!(round_half_even(f64::INFINITY), 1 << 20);
        assert_eq!(round_half_even(-1e300), -(1 << 20));
    }
}
