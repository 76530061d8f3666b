//! The arrow by which Gymnasium's pendulum shows its torque: an arc, three quarters of an ellipse clockwise from the top, and
//! an arrow head with a hollow back. Described by geometry that was fitted to Gymnasium's image, in pixels of that image.

use std::sync::LazyLock;

/// Height and width of Gymnasium's image.
pub(crate) const SIZE: [usize; 2] = [312, 329];

const CENTER: [f64; 2] = [173.0, 156.0];
const RADII: [f64; 2] = [151.3, 150.9];
const HALF_WIDTH: f64 = 5.0;
/// The arc begins here, left of the ellipse's top.
const START_X: f64 = 170.4;
/// Above this the left half of the ellipse is missing.
const END_Y: f64 = 150.0;
/// The head: its tip, its left and right end, and the two points that pull its back inwards (a cubic Bézier curve).
const TIP: [f64; 2] = [21.8, 112.1];
const BACK: [[f64; 2]; 4] = [[41.5, 165.8], [29.9, 157.2], [13.9, 157.3], [2.1, 165.8]];
/// The head is drawn with a round pen of this radius.
const PEN: f64 = 0.95;

/// Straight pieces of the back, and of a coarse arc.
const PIECES: usize = 12;
const ARC_PIECES: usize = 40;

/// The share of every pixel of Gymnasium's image that the arrow covers, of 255, `[312, 329]`.
pub(crate) fn coverage() -> &'static [u8] {
    static COVERAGE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let head = head();
        let [height, width] = SIZE;
        (0..height * width)
            .map(|index| {
                let corner = [(index % width) as f64, (index / width) as f64];
                (255.0 * share(&head, corner)).round() as u8
            })
            .collect()
    });
    &COVERAGE
}

/// The share of a pixel that is covered, by 16 samples near an edge.
fn share(head: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    const SAMPLES: usize = 4;
    let middle = distance(head, [x + 0.5, y + 0.5]);
    if middle.abs() > 1.0 {
        return if middle < 0.0 { 1.0 } else { 0.0 };
    }
    let at = |i: usize| (i as f64 + 0.5) / SAMPLES as f64;
    let samples = (0..SAMPLES * SAMPLES).map(|i| {
        let from_edge = distance(head, [x + at(i % SAMPLES), y + at(i / SAMPLES)]);
        (0.5 - SAMPLES as f64 * from_edge).clamp(0.0, 1.0)
    });
    samples.sum::<f64>() / (SAMPLES * SAMPLES) as f64
}

/// The corners of the head.
fn head() -> [[f64; 2]; PIECES + 2] {
    let [a, b, c, d] = BACK;
    std::array::from_fn(|i| {
        let Some(i) = i.checked_sub(1) else { return TIP };
        let t = i as f64 / PIECES as f64;
        let weights = [(1.0 - t).powi(3), 3.0 * (1.0 - t).powi(2) * t, 3.0 * (1.0 - t) * t * t, t.powi(3)];
        [0, 1].map(|axis| weights.iter().zip([a, b, c, d]).map(|(weight, point)| weight * point[axis]).sum())
    })
}

/// The signed distance from the arrow's edge, negative inside.
fn distance(head: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let offset = [x - CENTER[0], y - CENTER[1]];
    let [u, v] = [0, 1].map(|axis| offset[axis] / RADII[axis]);
    // To first order, F / |grad F| is the distance from the curve F = 0.
    let slope = 2.0 * (u / RADII[0]).hypot(v / RADII[1]);
    let band = ((u * u + v * v - 1.0) / slope).abs() - HALF_WIDTH;
    let arc = band.max((START_X - x).min(END_Y - y));
    arc.min(from_polygon(head, [x, y]) - PEN)
}

/// The signed distance from a polygon, negative inside.
fn from_polygon(corners: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let mut inside = false;
    let mut nearest = f64::INFINITY;
    for (&a, &b) in corners.iter().zip(corners.iter().cycle().skip(1)) {
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let foot = (((x - a[0]) * dx + (y - a[1]) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
        nearest = nearest.min((x - a[0] - foot * dx).hypot(y - a[1] - foot * dy));
        inside ^= (a[1] > y) != (b[1] > y) && x < a[0] + (y - a[1]) * dx / dy;
    }
    if inside { -nearest } else { nearest }
}

/// The arrow in a square of side 1 about the origin, y down: pieces of its arc with half their width, and its head.
pub(crate) fn outline() -> (impl Iterator<Item = [[f64; 2]; 2]>, f64, [[f64; 2]; PIECES + 2]) {
    let place = |[x, y]: [f64; 2]| [x / SIZE[1] as f64 - 0.5, y / SIZE[0] as f64 - 0.5];
    let on_arc = move |i: usize| {
        let angle = 1.5 * std::f64::consts::PI * i as f64 / ARC_PIECES as f64;
        place([CENTER[0] + RADII[0] * angle.sin(), CENTER[1] - RADII[1] * angle.cos()])
    };
    let pieces = (0..ARC_PIECES).map(move |i| [on_arc(i), on_arc(i + 1)]);
    (pieces, HALF_WIDTH / SIZE[1] as f64, head().map(place))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arrow_is_an_arc_with_a_head() {
        let at = |x: usize, y: usize| coverage()[y * SIZE[1] + x];
        assert_eq!([at(180, 5), at(324, 156), at(173, 307), at(22, 180)], [255; 4], "on the arc");
        assert_eq!([at(173, 156), at(100, 30), at(5, 5), at(22, 100)], [0; 4], "off it");
        assert_eq!([at(22, 130), at(8, 160), at(36, 160)], [255; 3], "in the head");
    }
}
