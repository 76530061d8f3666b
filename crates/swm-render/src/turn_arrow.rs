//! The arrow by which Gymnasium's pendulum shows its torque: three quarters of an ellipse, clockwise from the top, and an
//! arrow head with a notch. It is described by geometry, fitted to Gymnasium's image, in pixels of that image.
//!
//! Like the image, it is sampled by 15 lines per pixel, with exact lengths along them, and composed of three layers: the arc,
//! the head, and a thin line about the head.

use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Height and width of Gymnasium's image.
pub(crate) const SIZE: [usize; 2] = [312, 329];

/// The middle of the arc: an ellipse, its half width, and how that and the radii vary along each quarter of the arc: cosines
/// of whole multiples.
const CENTER: [f64; 2] = [173.0602, 156.0164];
const RADII: [f64; 2] = [151.4641, 151.0054];
const HALF_WIDTH: f64 = 4.9831;
const WIDTHS: [f64; 8] = [0.0143, 0.0131, -0.0247, 0.0097, 0.0068, -0.0017, 0.003, 0.001];
const OFFSETS: [f64; 4] = [0.0014, -0.0028, -0.0017, 0.0004];
/// Sideways per upwards of the cut, left of the top, where the arc begins.
const CUT: f64 = 0.01718;
/// Above this the left half of the ellipse is missing: the head covers its end.
const END_Y: f64 = 150.0;
/// The arc's angle, and that of each quarter.
const ANGLE: f64 = 1.5 * PI;
const QUARTER: f64 = ANGLE / 4.0;
/// The head: tip, right end, notch, left end.
const HEAD: [[f64; 2]; 4] =
    [[21.3749, 111.3609], [44.5254, 169.3552], [22.0981, 152.8183], [0.2214, 169.671]];
/// How far the line about the head reaches outwards and inwards.
const LINE: [f64; 2] = [0.2505, 0.2403];

/// Lines per pixel.
const LINES: usize = 15;
/// Straight pieces of the arc in the fast style.
const PIECES: usize = 40;

/// The share of every pixel of Gymnasium's image that the arrow covers, of 255, `[312, 329]`.
pub(crate) fn coverage() -> &'static [u8] {
    static COVERAGE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let [outside, inside] = [offset(LINE[0]), offset(-LINE[1])];
        let [height, width] = SIZE;
        let share = |index: usize| {
            let pixel = [(index % width) as f64, (index / width) as f64];
            let line = (of_polygon(&outside, pixel) - of_polygon(&inside, pixel)).clamp(0.0, 1.0);
            let rest = (1.0 - of_arc(pixel)) * (1.0 - of_polygon(&HEAD, pixel)) * (1.0 - line);
            (255.0 * (1.0 - rest)).round() as u8
        };
        (0..height * width).map(share).collect()
    });
    &COVERAGE
}

/// The mean of a length over the lines of the pixel with the upper left corner `y`.
fn mean_over_lines(y: f64, length: impl Fn(f64) -> f64) -> f64 {
    (0..LINES).map(|line| length(y + (line as f64 + 0.5) / LINES as f64)).sum::<f64>() / LINES as f64
}

/// The length of `from..to` within the pixel that begins at `x`.
fn within(x: f64, from: f64, to: f64) -> f64 {
    (to.min(x + 1.0) - from.max(x)).clamp(0.0, 1.0)
}

/// The share of a pixel that the arc covers: that of an outer ellipse less that of an inner one.
fn of_arc([x, y]: [f64; 2]) -> f64 {
    let to_middle = [x + 0.5 - CENTER[0], y + 0.5 - CENTER[1]];
    let distance = to_middle[0].hypot(to_middle[1]);
    if (distance - RADII[1]).abs() > HALF_WIDTH + 3.0 {
        return 0.0;
    }
    let angle = to_middle[0].atan2(-to_middle[1]).rem_euclid(TAU);
    let waves = |sizes: &[f64]| -> f64 {
        if angle > ANGLE + 0.1 {
            return 0.0;
        }
        let wave = |(k, size): (usize, &f64)| size * ((k + 1) as f64 * angle * TAU / QUARTER).cos();
        sizes.iter().enumerate().map(wave).sum()
    };
    let (half, shift) = (HALF_WIDTH + waves(&WIDTHS), waves(&OFFSETS));
    mean_over_lines(y, |y| {
        let chord = |grown: f64| {
            let [a, b] = RADII.map(|radius| radius + grown);
            let height = (y - CENTER[1]) / b;
            let reach = a * (1.0 - height * height).max(0.0).sqrt();
            let left = CENTER[0] - reach;
            let cut = CENTER[0] - CUT * (CENTER[1] - y);
            let left = if y < END_Y { left.max(cut) } else { left };
            if reach == 0.0 { 0.0 } else { within(x, left, CENTER[0] + reach) }
        };
        chord(shift + half) - chord(shift - half)
    })
}

/// The share of a pixel that a polygon covers: the lengths to the right of its edges, with their signs.
fn of_polygon(corners: &[[f64; 2]; 4], [x, y]: [f64; 2]) -> f64 {
    let right_of_edges = |y: f64| -> f64 {
        let edges = (0..4).map(|i| (corners[i], corners[(i + 1) % 4]));
        let length = |(a, b): ([f64; 2], [f64; 2])| {
            if !(a[1].min(b[1]) <= y && y < a[1].max(b[1])) {
                return 0.0;
            }
            let crossing = a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]);
            (x + 1.0 - crossing).clamp(0.0, 1.0) * (b[1] - a[1]).signum()
        };
        edges.map(length).sum()
    };
    mean_over_lines(y, right_of_edges).abs().min(1.0)
}

/// The head with its edges moved outwards by a distance.
fn offset(distance: f64) -> [[f64; 2]; 4] {
    // Points and directions of the moved edges. Corners go clockwise, y down: outwards is to the left.
    let edge = |i: usize| {
        let (a, b) = (HEAD[i], HEAD[(i + 1) % 4]);
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let length = dx.hypot(dy);
        ([a[0] + distance * dy / length, a[1] - distance * dx / length], [dx, dy])
    };
    std::array::from_fn(|i| {
        let ((p, u), (q, v)) = (edge((i + 3) % 4), edge(i));
        let along = ((q[0] - p[0]) * v[1] - (q[1] - p[1]) * v[0]) / (u[0] * v[1] - u[1] * v[0]);
        [p[0] + along * u[0], p[1] + along * u[1]]
    })
}

/// The arrow in a square of side 1 about the origin, y down: pieces of its arc with half their width, and its head.
pub(crate) fn outline() -> (impl Iterator<Item = [[f64; 2]; 2]>, f64, [[f64; 2]; 4]) {
    let place = |[x, y]: [f64; 2]| [x / SIZE[1] as f64 - 0.5, y / SIZE[0] as f64 - 0.5];
    let on_arc = move |i: usize| {
        let angle = ANGLE * i as f64 / PIECES as f64;
        place([CENTER[0] + RADII[0] * angle.sin(), CENTER[1] - RADII[1] * angle.cos()])
    };
    let pieces = (0..PIECES).map(move |i| [on_arc(i), on_arc(i + 1)]);
    (pieces, HALF_WIDTH / SIZE[1] as f64, HEAD.map(place))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arrow_is_an_arc_with_a_head() {
        let at = |x: usize, y: usize| coverage()[y * SIZE[1] + x];
        assert_eq!([at(180, 5), at(324, 156), at(173, 307), at(22, 180)], [255; 4], "on the arc");
        assert_eq!([at(173, 156), at(100, 30), at(5, 5), at(22, 100)], [0; 4], "off it");
        assert_eq!([at(22, 130), at(10, 155), at(34, 155)], [255; 3], "in the head");
        assert_eq!([at(10, 168), at(34, 168)], [0; 2], "in the notch");
    }
}
