//! The eight PushT shapes: their rectangles, center of gravity and moment of inertia.
//!
//! Every shape except the disc is a union of one to three rectangles whose sides lie along the body's axes. Nothing
//! here knows positions, velocities or contacts.

use super::math::{Vec2, vec2};
use serde::{Deserialize, Serialize};

/// At most this many rectangles make up a shape.
pub const MAX_PARTS: usize = 3;

/// A shape of the agent or of the block. The order is that of the factor values 0 to 7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Shape {
    /// A disc, `o`. Only the agent may have it; it is moved by the controller alone and pushes with full strength.
    Disc,
    /// Two 1 x 2 bars joined at a corner.
    L,
    /// The letter T: a 4 x 1 bar and a 1 x 3 stem.
    T,
    /// Two 2 x 1 bars, shifted against each other.
    Z,
    /// A 2 x 2 square.
    Square,
    /// A 1 x 4 bar.
    I,
    /// A T with a 3 x 1 bar and a 1 x 1 stem.
    SmallTee,
    /// A plus sign, `+`: a 3 x 1 bar with a square above and below.
    Plus,
}

/// One rectangle of a shape, in units of the shape's scale.
struct UnitPart {
    min: [f32; 2],
    max: [f32; 2],
    /// The order in which the reference lists the corners (indices into the hull order), for rendering.
    listed: [u8; 4],
}

/// What is known about a shape before its scale.
struct ShapeData {
    name: &'static str,
    parts: &'static [UnitPart],
    /// How often the inertia of each part counts. The reference adds up parts with the full mass each, and counts the
    /// first part of T and `+` in place of the others.
    inertia_counts: [f64; MAX_PARTS],
}

const fn part(min: [f32; 2], max: [f32; 2], listed: [u8; 4]) -> UnitPart {
    UnitPart { min, max, listed }
}

const DATA: [ShapeData; 8] = [
    ShapeData { name: "o", parts: &[], inertia_counts: [0.0; 3] },
    ShapeData {
        name: "L",
        parts: &[part([0.0, 0.0], [1.0, 2.0], [0, 3, 2, 1]), part([0.0, -1.0], [2.0, 0.0], [3, 2, 1, 0])],
        inertia_counts: [1.0, 1.0, 0.0],
    },
    ShapeData {
        name: "T",
        parts: &[part([-2.0, 0.0], [2.0, 1.0], [3, 2, 1, 0]), part([-0.5, 1.0], [0.5, 4.0], [0, 3, 2, 1])],
        inertia_counts: [2.0, 0.0, 0.0],
    },
    ShapeData {
        name: "Z",
        parts: &[part([-0.5, 0.0], [1.5, 1.0], [0, 3, 2, 1]), part([-1.5, -1.0], [0.5, 0.0], [3, 2, 1, 0])],
        inertia_counts: [1.0, 1.0, 0.0],
    },
    ShapeData {
        name: "square",
        parts: &[part([-1.0, -1.0], [1.0, 1.0], [0, 3, 2, 1])],
        inertia_counts: [1.0, 0.0, 0.0],
    },
    ShapeData {
        name: "I",
        parts: &[part([-0.5, -2.0], [0.5, 2.0], [0, 3, 2, 1])],
        inertia_counts: [1.0, 0.0, 0.0],
    },
    ShapeData {
        name: "small_tee",
        parts: &[part([-1.5, 0.0], [1.5, 1.0], [3, 2, 1, 0]), part([-0.5, 1.0], [0.5, 2.0], [0, 3, 2, 1])],
        inertia_counts: [1.0, 1.0, 0.0],
    },
    ShapeData {
        name: "+",
        parts: &[
            part([-1.5, -0.5], [1.5, 0.5], [3, 2, 1, 0]),
            part([-0.5, 0.5], [0.5, 1.5], [0, 3, 1, 2]),
            part([-0.5, -1.5], [0.5, -0.5], [3, 0, 2, 1]),
        ],
        inertia_counts: [3.0, 0.0, 0.0],
    },
];

impl Shape {
    /// All shapes, in the order of their factor values.
    pub const ALL: [Shape; 8] =
        [Shape::Disc, Shape::L, Shape::T, Shape::Z, Shape::Square, Shape::I, Shape::SmallTee, Shape::Plus];

    /// The factor value of this shape, 0 to 7.
    pub fn index(self) -> usize {
        self as usize
    }

    /// The shape of a factor value; `None` above 7.
    pub fn from_index(index: usize) -> Option<Shape> {
        Shape::ALL.get(index).copied()
    }

    /// The reference's name: `o`, `L`, `T`, `Z`, `square`, `I`, `small_tee` or `+`.
    pub fn name(self) -> &'static str {
        self.data().name
    }

    /// The rectangles of this shape at a scale (pixels per unit), in the order of their numbers; none for the disc.
    ///
    /// Coordinates are products in `f32`, then widened: so a scale that was sampled in `f32` gives the reference's
    /// corners.
    pub fn rectangles(self, scale: f32) -> impl ExactSizeIterator<Item = Rectangle> {
        self.data().parts.iter().map(move |part| {
            let [min, max] = [part.min, part.max].map(|[x, y]| [f64::from(x * scale), f64::from(y * scale)]);
            Rectangle { min, max, listed: part.listed }
        })
    }

    /// Radius of the disc at a scale, in pixels.
    pub fn disc_radius(scale: f32) -> f64 {
        f64::from(0.375_f32 * scale)
    }

    /// Center of gravity in body coordinates, pixels: the plain mean of the rectangles' centers.
    pub fn center_of_gravity(self, scale: f32) -> [f64; 2] {
        let count = self.data().parts.len().max(1) as f64;
        let sum = self.rectangles(scale).fold(Vec2::ZERO, |sum, rectangle| sum + rectangle.center());
        vec2(sum.x / count, sum.y / count).to_array()
    }

    /// Moment of inertia, in px² (the mass is 1), about the origin of the body's coordinates and not about its center
    /// of gravity: the reference's value, with its way of counting parts. Zero for the disc, which nothing can turn.
    pub fn inertia(self, scale: f32) -> f64 {
        self.rectangles(scale)
            .zip(self.data().inertia_counts)
            .map(|(part, count)| count * part.inertia())
            .sum()
    }

    /// The number of moving parts: rectangles, or the one disc.
    pub fn part_count(self) -> usize {
        self.data().parts.len().max(1)
    }

    fn data(self) -> &'static ShapeData {
        &DATA[self.index()]
    }
}

/// A rectangle in body coordinates, pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// Corner with the smallest x and y.
    pub min: [f64; 2],
    /// Corner with the largest x and y.
    pub max: [f64; 2],
    listed: [u8; 4],
}

impl Rectangle {
    /// The corners in hull order: from (min, min) along x first.
    pub fn corners(&self) -> [[f64; 2]; 4] {
        let ([x0, y0], [x1, y1]) = (self.min, self.max);
        [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    }

    /// The corners in the order in which the reference lists them. For the small squares of `+` this is a bow tie.
    pub fn listed_corners(&self) -> [[f64; 2]; 4] {
        self.listed.map(|index| self.corners()[usize::from(index)])
    }

    pub(super) fn center(&self) -> Vec2 {
        (Vec2::from(self.min) + Vec2::from(self.max)) * 0.5
    }

    pub(super) fn half_size(&self) -> Vec2 {
        (Vec2::from(self.max) - Vec2::from(self.min)) * 0.5
    }

    /// Moment of inertia about the origin, for mass 1: the means of x² and of y².
    fn inertia(&self) -> f64 {
        let mean_square = |a: f64, b: f64| (a * a + a * b + b * b) / 3.0;
        mean_square(self.min[0], self.max[0]) + mean_square(self.min[1], self.max[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_and_centers_are_those_of_the_reference() {
        let expected = [
            (Shape::T, 3000.0, [0.0, 45.0]),
            (Shape::SmallTee, 3150.0, [0.0, 30.0]),
            (Shape::L, 3000.0, [22.5, 7.5]),
            (Shape::Z, 1650.0, [0.0, 0.0]),
            (Shape::Square, 600.0, [0.0, 0.0]),
            (Shape::I, 1275.0, [0.0, 0.0]),
            (Shape::Plus, 2250.0, [0.0, 0.0]),
        ];
        for (shape, inertia, cog) in expected {
            assert!((shape.inertia(30.0) - inertia).abs() < 1e-9, "{shape:?}: {}", shape.inertia(30.0));
            assert_eq!(shape.center_of_gravity(30.0), cog, "{shape:?}");
        }
        assert_eq!(Shape::disc_radius(40.0), 15.0);
    }

    #[test]
    fn corners_keep_both_orders() {
        let t: Vec<Rectangle> = Shape::T.rectangles(30.0).collect();
        assert_eq!(t[0].corners(), [[-60.0, 0.0], [60.0, 0.0], [60.0, 30.0], [-60.0, 30.0]]);
        assert_eq!(t[0].listed_corners(), [[-60.0, 30.0], [60.0, 30.0], [60.0, 0.0], [-60.0, 0.0]]);
        assert_eq!(t[1].listed_corners(), [[-15.0, 30.0], [-15.0, 120.0], [15.0, 120.0], [15.0, 30.0]]);
        let plus: Vec<Rectangle> = Shape::Plus.rectangles(2.0).collect();
        assert_eq!(plus[1].listed_corners(), [[-1.0, 1.0], [-1.0, 3.0], [1.0, 1.0], [1.0, 3.0]]);
        assert_eq!(plus[2].listed_corners(), [[-1.0, -1.0], [-1.0, -3.0], [1.0, -1.0], [1.0, -3.0]]);
    }

    #[test]
    fn names_and_indices_agree() {
        for (index, shape) in Shape::ALL.into_iter().enumerate() {
            assert_eq!(shape.index(), index);
            assert_eq!(Shape::from_index(index), Some(shape));
        }
        assert_eq!(Shape::from_index(8), None);
        assert_eq!(Shape::ALL.map(Shape::name), ["o", "L", "T", "Z", "square", "I", "small_tee", "+"]);
    }
}
