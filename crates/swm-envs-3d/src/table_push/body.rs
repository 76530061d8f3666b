//! The object: what it is made of, by its shape and size.

use swm_fov::Fov;

/// A solid of the object, upright at its middle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Solid {
    /// By its half lengths.
    Box([f64; 3]),
    /// Along z, by its radius and half its length.
    Cylinder(f64, f64),
}

/// Half the object's height as a share of its half width.
const HEIGHT: f64 = 0.6;
/// Width of the arms of a cross as a share of their length.
const ARM: f64 = 0.35;

/// An object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Object {
    /// 0 a box, 1 a cylinder, 2 a cross.
    shape: i64,
    /// Half its width.
    size: f64,
    pub(super) mass: f64,
}

impl Object {
    /// The object of an assignment.
    pub(super) fn new(fov: &Fov) -> Self {
        Self { shape: fov.i64("object.shape"), size: fov.f64("object.size"), mass: fov.f64("object.mass") }
    }

    /// Half its height.
    pub(super) fn half_height(&self) -> f64 {
        HEIGHT * self.size
    }

    /// No part of it is farther from its axis.
    pub(super) fn reach(&self) -> f64 {
        self.size
            * match self.shape {
                0 => std::f64::consts::SQRT_2,
                1 => 1.0,
                _ => (1.0 + ARM * ARM).sqrt(),
            }
    }

    /// What it is made of.
    pub(super) fn solids(&self) -> impl Iterator<Item = Solid> + use<> {
        let (size, height) = (self.size, self.half_height());
        let solids = match self.shape {
            0 => [Some(Solid::Box([size, size, height])), None],
            1 => [Some(Solid::Cylinder(size, height)), None],
            _ => [Some(Solid::Box([size, ARM * size, height])), Some(Solid::Box([ARM * size, size, height]))],
        };
        solids.into_iter().flatten()
    }

    /// Moments of inertia about its axes: those of a box or a cylinder that encloses it.
    pub(super) fn inertia(&self) -> [f64; 3] {
        let (size, height) = (self.size * self.size, self.half_height() * self.half_height());
        let [across, about] = match self.shape {
            1 => [size / 4.0 + height / 3.0, size / 2.0],
            _ => [(size + height) / 3.0, 2.0 * size / 3.0],
        };
        [across, across, about].map(|moment| self.mass * moment)
    }
}
