//! Rotations as quaternions (w x y z), and rigid poses. Formulas in the order of MuJoCo's and OGBench's, whose rounding
//! trajectories follow.

use std::f64::consts::{PI, TAU};

/// A rotation, w x y z.
pub(super) type Quaternion = [f64; 4];

/// No rotation.
pub(super) const IDENTITY: Quaternion = [1.0, 0.0, 0.0, 0.0];

/// The rotation `b`, then `a`.
pub(super) fn multiply(a: Quaternion, b: Quaternion) -> Quaternion {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// The rotation back.
pub(super) fn inverse(q: Quaternion) -> Quaternion {
    [q[0], -q[1], -q[2], -q[3]]
}

/// A vector, turned.
pub(super) fn rotate(q: Quaternion, v: [f64; 3]) -> [f64; 3] {
    let u = [q[1], q[2], q[3]];
    let t = cross(u, v).map(|x| 2.0 * x);
    let twist = cross(u, t);
    [0, 1, 2].map(|k| v[k] + q[0] * t[k] + twist[k])
}

/// The cross product.
pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The rotation about an axis of length 1.
pub(super) fn about(axis: [f64; 3], angle_rad: f64) -> Quaternion {
    let (sin, cos) = (angle_rad * 0.5).sin_cos();
    [cos, axis[0] * sin, axis[1] * sin, axis[2] * sin]
}

/// The rotation about z.
pub(super) fn about_z(angle_rad: f64) -> Quaternion {
    about([0.0, 0.0, 1.0], angle_rad)
}

/// Of length 1.
pub(super) fn normalize(q: Quaternion) -> Quaternion {
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    if norm < f64::MIN_POSITIVE { IDENTITY } else { q.map(|x| x / norm) }
}

/// The rotation of a matrix, row-major (MuJoCo's `mju_mat2Quat`).
pub(super) fn from_matrix(m: [f64; 9]) -> Quaternion {
    let q = if m[0] + m[4] + m[8] > 0.0 {
        let w = 0.5 * (1.0 + m[0] + m[4] + m[8]).sqrt();
        [w, 0.25 * (m[7] - m[5]) / w, 0.25 * (m[2] - m[6]) / w, 0.25 * (m[3] - m[1]) / w]
    } else if m[0] > m[4] && m[0] > m[8] {
        let x = 0.5 * (1.0 + m[0] - m[4] - m[8]).sqrt();
        [0.25 * (m[7] - m[5]) / x, x, 0.25 * (m[1] + m[3]) / x, 0.25 * (m[2] + m[6]) / x]
    } else if m[4] > m[8] {
        let y = 0.5 * (1.0 - m[0] + m[4] - m[8]).sqrt();
        [0.25 * (m[2] - m[6]) / y, 0.25 * (m[1] + m[3]) / y, y, 0.25 * (m[5] + m[7]) / y]
    } else {
        let z = 0.5 * (1.0 - m[0] - m[4] + m[8]).sqrt();
        [0.25 * (m[3] - m[1]) / z, 0.25 * (m[2] + m[6]) / z, 0.25 * (m[5] + m[7]) / z, z]
    };
    normalize(q)
}

/// The angle about z, rad, in (-π, π].
pub(super) fn yaw(q: Quaternion) -> f64 {
    (2.0 * (q[0] * q[3] + q[1] * q[2])).atan2(1.0 - 2.0 * (q[2] * q[2] + q[3] * q[3]))
}

/// The rotation as axis times angle, rad, the short way round (MuJoCo's `mju_quat2Vel`).
pub(super) fn to_vector(q: Quaternion) -> [f64; 3] {
    let axis = [q[1], q[2], q[3]];
    let sine = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    if sine < f64::MIN_POSITIVE {
        return [0.0; 3];
    }
    let angle = 2.0 * sine.atan2(q[0]);
    let angle = if angle > PI { angle - TAU } else { angle };
    axis.map(|x| x / sine * angle)
}

/// A place and a rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// m.
    pub(super) position: [f64; 3],
    /// Rotation.
    pub(super) rotation: Quaternion,
}

impl Pose {
    /// `inner`, seen from where this pose is given.
    pub(super) fn then(self, inner: Pose) -> Pose {
        let turned = rotate(self.rotation, inner.position);
        Pose {
            position: [0, 1, 2].map(|k| self.position[k] + turned[k]),
            rotation: multiply(self.rotation, inner.rotation),
        }
    }

    /// The way back.
    pub(super) fn inverse(self) -> Pose {
        let rotation = inverse(self.rotation);
        Pose { position: rotate(rotation, self.position.map(|x| -x)), rotation }
    }
}

/// The distance of two points.
pub(super) fn distance<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close<const N: usize>(a: [f64; N], b: [f64; N]) -> bool {
        distance(a, b) < 1e-12
    }

    fn matrix(q: Quaternion) -> [f64; 9] {
        let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|axis| rotate(q, axis));
        std::array::from_fn(|at| columns[at % 3][at / 3])
    }

    #[test]
    fn matrices_of_every_case_come_back_as_their_quaternions() {
        for q in [[0.9, 0.1, -0.2, 0.3], [0.1, 0.9, 0.2, 0.3], [0.1, 0.2, 0.9, -0.3], [-0.1, 0.2, 0.3, 0.9]] {
            let q = normalize(q);
            let found = from_matrix(matrix(q));
            let sign = q.iter().zip(found).map(|(a, b)| a * b).sum::<f64>().signum();
            assert!(close(found.map(|x| sign * x), q), "{q:?} {found:?}");
        }
    }

    #[test]
    fn rotations_compose_and_undo() {
        let (a, b) = (about_z(0.7), about([1.0, 0.0, 0.0], -0.4));
        let v = [0.3, -1.0, 2.0];
        assert!(close(rotate(multiply(a, b), v), rotate(a, rotate(b, v))));
        assert!((yaw(a) - 0.7).abs() < 1e-15);
        assert!(close(to_vector(a), [0.0, 0.0, 0.7]));
        assert!(close(to_vector(about_z(4.0)), [0.0, 0.0, 4.0 - TAU]));
        let pose = Pose { position: v, rotation: a };
        assert!(close(pose.then(pose.inverse()).position, [0.0; 3]));
    }
}
