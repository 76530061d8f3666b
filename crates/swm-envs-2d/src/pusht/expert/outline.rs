//! The outline of a block: the border of the union of its rectangles, by arc length. It knows shapes, no poses.

use crate::pusht::physics::{Rectangle, Vec2, vec2};

/// The border of a union of rectangles, in the coordinates of the body.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Outline {
    /// In order along the border: each begins where the one before ends, until a loop closes.
    edges: Vec<Edge>,
}

/// A piece of a straight side; the body is on its left (as seen with y up).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    from: Vec2,
    to: Vec2,
}

impl Edge {
    fn length(&self) -> f64 {
        (self.to - self.from).norm()
    }
}

impl Outline {
    /// Traces the border on the grid of the rectangles' sides.
    pub(super) fn new(rectangles: &[Rectangle]) -> Outline {
        let grid = |axis: usize| {
            let mut lines: Vec<f64> = rectangles.iter().flat_map(|r| [r.min[axis], r.max[axis]]).collect();
            lines.sort_by(f64::total_cmp);
            lines.dedup();
            lines
        };
        let (xs, ys) = (grid(0), grid(1));
        let covered = |column: usize, row: usize| {
            let middle = [(column, &xs), (row, &ys)].map(|(i, lines)| (lines[i] + lines[i + 1]) / 2.0);
            rectangles
                .iter()
                .any(|r| (0..2).all(|axis| r.min[axis] < middle[axis] && middle[axis] < r.max[axis]))
        };
        // One cell more on every side, which nothing covers, spares the special cases.
        let (columns, rows) = (xs.len() - 1, ys.len() - 1);
        let inside = |column: Option<usize>, row: Option<usize>| match (column, row) {
            (Some(column), Some(row)) if column < columns && row < rows => covered(column, row),
            _ => false,
        };
        let mut edges = Vec::new();
        for (column, row) in (0..columns).flat_map(|column| (0..rows).map(move |row| (column, row))) {
            if !covered(column, row) {
                continue;
            }
            let ([left, right], [low, high]) = ([xs[column], xs[column + 1]], [ys[row], ys[row + 1]]);
            let (here, above) = ((Some(column), Some(row)), (Some(column + 1), Some(row + 1)));
            let sides = [
                (inside(here.0, row.checked_sub(1)), vec2(left, low), vec2(right, low)),
                (inside(above.0, here.1), vec2(right, low), vec2(right, high)),
                (inside(here.0, above.1), vec2(right, high), vec2(left, high)),
                (inside(column.checked_sub(1), here.1), vec2(left, high), vec2(left, low)),
            ];
            edges.extend(sides.into_iter().filter(|side| !side.0).map(|(_, from, to)| Edge { from, to }));
        }
        Outline { edges: chain(edges) }
    }

    /// Length of the border, pixels.
    pub(super) fn length(&self) -> f64 {
        self.edges.iter().map(Edge::length).sum()
    }

    /// The point at an arc position (taken modulo the length), and the unit normal that points away from the body.
    pub(super) fn at(&self, arc_px: f64) -> (Vec2, Vec2) {
        let mut rest = arc_px.rem_euclid(self.length());
        let mut last = self.edges[0];
        for &edge in &self.edges {
            last = edge;
            if rest <= edge.length() {
                break;
            }
            rest -= edge.length();
        }
        let along = (last.to - last.from) * (1.0 / last.length());
        (last.from + along * rest.min(last.length()), vec2(along.y, -along.x))
    }
}

/// Puts edges into the order in which they follow each other.
fn chain(mut edges: Vec<Edge>) -> Vec<Edge> {
    for next in 1..edges.len() {
        let end = edges[next - 1].to;
        if let Some(offset) = edges[next..].iter().position(|edge| edge.from == end) {
            edges.swap(next, next + offset);
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pusht::physics::Shape;

    fn outline(shape: Shape, scale: f32) -> Outline {
        Outline::new(&shape.rectangles(scale).collect::<Vec<_>>())
    }

    #[test]
    fn lengths_are_those_of_the_unions() {
        let lengths = [
            (Shape::L, 10.0),
            (Shape::T, 16.0),
            (Shape::Z, 10.0),
            (Shape::Square, 8.0),
            (Shape::I, 10.0),
            (Shape::SmallTee, 10.0),
            (Shape::Plus, 12.0),
        ];
        for (shape, cells) in lengths {
            assert!((outline(shape, 30.0).length() - 30.0 * cells).abs() < 1e-9, "{shape:?}");
        }
    }

    #[test]
    fn the_border_is_one_closed_loop_with_normals_outwards() {
        for shape in Shape::ALL.into_iter().filter(|&shape| shape != Shape::Disc) {
            let outline = outline(shape, 20.0);
            let inside = |p: Vec2| {
                shape
                    .rectangles(20.0)
                    .any(|r| r.min[0] < p.x && p.x < r.max[0] && r.min[1] < p.y && p.y < r.max[1])
            };
            for (edge, next) in outline.edges.iter().zip(outline.edges.iter().cycle().skip(1)) {
                assert_eq!(edge.to, next.from, "{shape:?}");
            }
            for step in 0..100 {
                let (point, normal) = outline.at(f64::from(step) * outline.length() / 100.0 + 0.3);
                assert!(!inside(point + normal * 0.1) && inside(point - normal * 0.1), "{shape:?} {point:?}");
            }
        }
    }
}
