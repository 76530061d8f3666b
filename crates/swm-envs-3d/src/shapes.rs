//! Shapes and poses as rapier3d and parry3d take them.

use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::shape::SharedShape;

use crate::attitude::Xyzw;

/// A cylinder along z: parry's lie along y.
pub(crate) fn cylinder(radius: f64, half: f64, place: [f64; 3]) -> (SharedShape, Pose) {
    let (sin, cos) = (std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2);
    let pose = Pose::from_parts(Vector::from(place), Rotation::from_xyzw(sin, 0.0, 0.0, cos));
    (SharedShape::cylinder(half, radius), pose)
}

/// The pose of a body.
pub(crate) fn pose(position: [f64; 3], [x, y, z, w]: Xyzw) -> Pose {
    Pose::from_parts(Vector::from(position), Rotation::from_xyzw(x, y, z, w))
}
