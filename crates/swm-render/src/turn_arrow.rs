//! The arrow by which Gymnasium's pendulum shows its torque: three quarters of an ellipse, clockwise from the top, and an
//! arrow head with a notch. It is described by geometry, fitted to Gymnasium's image, in pixels of that image.
//!
//! That image shows the marks of its rasterizer, so the same rules are followed here: curves are 32 straight pieces each, a
//! stroke is what a 16-sided pen sweeps, a pixel is sampled at 17 points along each of 15 lines, and three layers are composed:
//! the arc, the head, and a thin line about the head. All but a few of the image's pixels come out equal.

use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// Height and width of Gymnasium's image.
pub(crate) const SIZE: [usize; 2] = [312, 329];

type Point = [f64; 2];

/// The middle line of the arc: an ellipse by its center and radii, four cubic curves from `START`, each over the angle `SPAN`.
/// Angles are in radians, clockwise from the top.
const CENTER: Point = [173.06111, 156.01816];
const RADII: [f64; 2] = [151.47823, 151.01791];
const START: f64 = -0.017124;
const SPAN: f64 = 1.19299;
const CURVES: usize = 4;
/// Half the arc's width, and the angle of one corner of the pen that drew it.
const HALF_WIDTH: f64 = 5.0076;
const PEN_ANGLE: f64 = 0.1723;
/// The head: tip, right end, notch, left end.
const HEAD: [Point; 4] =
    [[21.37462, 111.38027], [44.49284, 169.2958], [22.10426, 152.85105], [0.25014, 169.60673]];
/// Half the width of the line about the head.
const LINE: f64 = 0.2506;

/// Sides of the pen, and straight pieces of a curve.
const PEN_SIDES: usize = 16;
const CURVE_PIECES: usize = 32;
/// Lines per pixel, and samples along each: 255 together, the levels of coverage.
const LINES: i32 = 15;
const SAMPLES: i32 = 17;
/// Straight pieces of the arc in the fast style.
const PIECES: usize = 40;

/// The share of every pixel of Gymnasium's image that the arrow covers, of 255, `[312, 329]`.
pub(crate) fn coverage() -> &'static [u8] {
    static COVERAGE: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let arc = layer((0..CURVES).map(stroke_of_curve));
        let head = layer([HEAD.to_vec()]);
        let line = layer(stroke_of_head());
        arc.iter()
            .zip(&head)
            .zip(&line)
            .map(|((&arc, &head), &line)| over(over(arc, head), line) as u8)
            .collect()
    });
    &COVERAGE
}

/// The coverage of two layers, of 255.
fn over(below: i32, above: i32) -> i32 {
    (255 * (below + above) - below * above + 127) / 255
}

/// How many of each pixel's 255 samples are in the polygons; where polygons overlap, samples count twice.
fn layer(polygons: impl IntoIterator<Item = Vec<Point>>) -> Vec<i32> {
    let [height, width] = SIZE;
    let mut total = vec![0; height * width];
    // Two more columns: an edge may be the image's own, and what it changes ends one later.
    let mut changes = vec![0; height * (width + 2)];
    for polygon in polygons {
        changes.fill(0);
        for (i, &from) in polygon.iter().enumerate() {
            add_edge(&mut changes, from, polygon[(i + 1) % polygon.len()]);
        }
        for (changes, total) in changes.chunks_exact(width + 2).zip(total.chunks_exact_mut(width)) {
            let mut inside = 0;
            for (change, total) in changes.iter().zip(total) {
                inside += change;
                *total = (*total + inside.abs()).min(255);
            }
        }
    }
    total
}

/// Adds what an edge changes in the count of samples inside, from each pixel to the next on its right.
fn add_edge(changes: &mut [i32], from: Point, to: Point) {
    let [height, width] = SIZE.map(|side| side as i32);
    let line_of = |y: f64| ((y * f64::from(LINES) - 0.5).ceil() as i32).clamp(0, height * LINES);
    let (first, last) = (line_of(from[1]), line_of(to[1]));
    for line in first.min(last)..first.max(last) {
        let y = (f64::from(line) + 0.5) / f64::from(LINES);
        let x = from[0] + (y - from[1]) * (to[0] - from[0]) / (to[1] - from[1]);
        let sample = ((x * f64::from(SAMPLES)).round() as i32).clamp(0, width * SAMPLES);
        let (column, skipped) = (sample / SAMPLES, sample % SAMPLES);
        let index = (line / LINES * (width + 2) + column) as usize;
        let sign = (last - first).signum();
        changes[index] += sign * (SAMPLES - skipped);
        changes[index + 1] += sign * skipped;
    }
}

/// The point of the unit circle at an angle, clockwise from the top.
fn unit(angle: f64) -> Point {
    [angle.sin(), -angle.cos()]
}

/// What the pen sweeps along one curve of the arc.
fn stroke_of_curve(curve: usize) -> Vec<Point> {
    let ends = [curve, curve + 1].map(|end| START + end as f64 * SPAN);
    let [a, d] = ends.map(unit);
    let slopes = ends.map(|angle| unit(angle + PI / 2.0));
    let reach = 4.0 / 3.0 * (SPAN / 4.0).tan();
    let b: Point = std::array::from_fn(|i| a[i] + reach * slopes[0][i]);
    let c: Point = std::array::from_fn(|i| d[i] - reach * slopes[1][i]);
    let point = |piece: usize| -> Point {
        let t = piece as f64 / CURVE_PIECES as f64;
        let s = 1.0 - t;
        std::array::from_fn(|i| {
            let on_circle =
                s * s * s * a[i] + 3.0 * s * s * t * b[i] + 3.0 * s * t * t * c[i] + t * t * t * d[i];
            CENTER[i] + RADII[i] * on_circle
        })
    };
    let mut points: Vec<Point> = (0..=CURVE_PIECES).map(point).collect();
    // Ends are cut across the curve: there the pen has corners of its own.
    let corners = (0..PEN_SIDES).map(|i| PEN_ANGLE + TAU * i as f64 / PEN_SIDES as f64);
    let mut angles: Vec<f64> =
        corners.chain(ends).chain(ends.map(|angle| angle + PI)).map(|angle| angle.rem_euclid(TAU)).collect();
    angles.sort_by(f64::total_cmp);
    let scale = HALF_WIDTH / ((RADII[0] + RADII[1]) / 2.0);
    let pen: Vec<Point> =
        angles.iter().map(|&angle| std::array::from_fn(|i| scale * RADII[i] * unit(angle)[i])).collect();
    let [first, last] = slopes.map(|slope| [RADII[0] * slope[0], RADII[1] * slope[1]]);
    let mut outline = left_side(&points, &pen, first, last);
    points.reverse();
    outline.extend(left_side(&points, &pen, last.map(|x| -x), first.map(|x| -x)));
    outline
}

/// What the pen reaches to the left of a line of `points` that begins and ends with these slopes; `pen` is convex and clockwise.
fn left_side(points: &[Point], pen: &[Point], first: Point, last: Point) -> Vec<Point> {
    let to_left = |corner: Point, slope: Point| corner[0] * slope[1] - corner[1] * slope[0];
    let slope_from =
        |i: usize| points.get(i + 1).map_or(last, |next| [next[0] - points[i][0], next[1] - points[i][1]]);
    let farthest =
        |slope| (0..pen.len()).max_by(|&a, &b| to_left(pen[a], slope).total_cmp(&to_left(pen[b], slope)));
    let mut active = farthest(first).unwrap_or(0);
    let mut side = Vec::new();
    for (i, point) in points.iter().enumerate() {
        let slope = slope_from(i);
        loop {
            side.push([point[0] + pen[active][0], point[1] + pen[active][1]]);
            let now = to_left(pen[active], slope) + 1e-9;
            let neighbors = [active + 1, active + pen.len() - 1].map(|corner| corner % pen.len());
            let Some(next) = neighbors.into_iter().find(|&corner| to_left(pen[corner], slope) > now) else {
                break;
            };
            active = next;
        }
    }
    side
}

/// The line about the head: a rectangle along each edge, which all reach to the corners, and outside of each corner what
/// extends both edges until they meet.
fn stroke_of_head() -> Vec<Vec<Point>> {
    let edge = |i: usize| {
        let (a, b) = (HEAD[i % 4], HEAD[(i + 1) % 4]);
        let [dx, dy] = [b[0] - a[0], b[1] - a[1]];
        let length = dx.hypot(dy);
        ([dx / length, dy / length], [LINE * dy / length, -LINE * dx / length])
    };
    let plus = |p: Point, sign: f64, q: Point| [p[0] + sign * q[0], p[1] + sign * q[1]];
    let along = |i: usize| {
        let (from, to, (_, out)) = (HEAD[i], HEAD[(i + 1) % 4], edge(i));
        vec![plus(from, 1.0, out), plus(to, 1.0, out), plus(to, -1.0, out), plus(from, -1.0, out)]
    };
    let corner = |i: usize| {
        let (corner, (u, out), (v, next_out)) = (HEAD[i], edge(i + 3), edge(i));
        let turn = u[0] * v[1] - u[1] * v[0];
        let sign = turn.signum();
        let (from, to) = (plus(corner, sign, out), plus(corner, sign, next_out));
        let reach = ((to[0] - from[0]) * v[1] - (to[1] - from[1]) * v[0]) / turn;
        vec![corner, from, plus(from, reach, u), to]
    };
    (0..4).map(along).chain((0..4).map(corner)).collect()
}

/// The arrow in a square of side 1 about the origin, y down: pieces of its arc with half their width, and its head.
pub(crate) fn outline() -> (impl Iterator<Item = [Point; 2]>, f64, [Point; 4]) {
    let place = |[x, y]: Point| [x / SIZE[1] as f64 - 0.5, y / SIZE[0] as f64 - 0.5];
    let on_arc = move |i: usize| {
        let [x, y] = unit(START + SPAN * (CURVES * i) as f64 / PIECES as f64);
        place([CENTER[0] + RADII[0] * x, CENTER[1] + RADII[1] * y])
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
