//! Rotations: quaternions x, y, z, w and Euler angles by PyBullet's formulas.
//!
//! Sines and logarithms are those of the `libm` crate, which have the same bits on every machine.

use nalgebra::{ComplexField, Matrix3, Quaternion, RealField, UnitQuaternion, Vector3};

/// A quaternion of length 1: x, y, z, w.
pub(crate) type Xyzw = [f64; 4];

/// No rotation.
pub(crate) const UPRIGHT: Xyzw = [0.0, 0.0, 0.0, 1.0];

/// Sine and cosine.
pub(crate) fn sin_cos(angle_rad: f64) -> (f64, f64) {
    ComplexField::sin_cos(angle_rad)
}

/// The angle of the point (x, y), radians.
pub(crate) fn atan2(y: f64, x: f64) -> f64 {
    RealField::atan2(y, x)
}

/// The exponential function.
pub(crate) fn exp(value: f64) -> f64 {
    ComplexField::exp(value)
}

/// As nalgebra's type. The length stays as it is.
pub(crate) fn rotation([x, y, z, w]: Xyzw) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
}

/// The matrix that turns body coordinates into world coordinates.
pub(crate) fn world_from_body(attitude: Xyzw) -> Matrix3<f64> {
    rotation(attitude).to_rotation_matrix().into_inner()
}

/// The attitude after a rotation about the world axis `turn` by its length, radians.
pub(crate) fn turned(attitude: Xyzw, turn: Vector3<f64>) -> Xyzw {
    let turned = UnitQuaternion::from_scaled_axis(turn) * rotation(attitude);
    unit(turned.coords.into())
}

/// Scaled to length 1.
pub(crate) fn unit(quaternion: Xyzw) -> Xyzw {
    let length = quaternion.iter().map(|part| part * part).sum::<f64>().sqrt();
    quaternion.map(|part| part / length)
}

/// Roll, pitch and yaw, radians.
pub(crate) fn euler([x, y, z, w]: Xyzw) -> [f64; 3] {
    let sine = -2.0 * (x * z - w * y);
    if sine.abs() >= 0.99999 {
        let half = atan2(if sine < 0.0 { x } else { -x }, if sine < 0.0 { -y } else { y });
        return [0.0, std::f64::consts::FRAC_PI_2 * sine.signum(), 2.0 * half];
    }
    let (xx, yy, zz, ww) = (x * x, y * y, z * z, w * w);
    [
        atan2(2.0 * (y * z + w * x), ww - xx - yy + zz),
        ComplexField::asin(sine),
        atan2(2.0 * (x * y + w * z), ww + xx - yy - zz),
    ]
}

/// The quaternion of roll, pitch and yaw, radians.
pub(crate) fn from_euler(angles_rad: [f64; 3]) -> Xyzw {
    let [(sx, cx), (sy, cy), (sz, cz)] = angles_rad.map(|angle| sin_cos(0.5 * angle));
    unit([
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_angles_and_quaternions_convert_both_ways() {
        for angles in [[0.1, -0.2, 0.3], [-2.0, 1.2, 3.0], [0.0, -1.5, 0.0], [3.1, 0.0, -3.1]] {
            let again = euler(from_euler(angles));
            assert!(angles.iter().zip(again).all(|(a, b)| (a - b).abs() < 1e-12), "{angles:?}: {again:?}");
        }
        let up = world_from_body(from_euler([0.0, std::f64::consts::FRAC_PI_2, 0.0])) * Vector3::z();
        assert!((up - Vector3::x()).norm() < 1e-12, "pitch turns z towards x: {up}");
        let [roll, pitch, _] = euler(from_euler([0.0, std::f64::consts::FRAC_PI_2, 0.4]));
        assert_eq!((roll, pitch), (0.0, std::f64::consts::FRAC_PI_2));
    }

    #[test]
    fn turns_add_up() {
        let turn = Vector3::new(0.3, -0.2, 0.5);
        let there = turned(from_euler([0.4, 0.5, 0.6]), turn);
        let back = turned(there, -turn);
        assert!(back.iter().zip(from_euler([0.4, 0.5, 0.6])).all(|(a, b)| (a - b).abs() < 1e-15));
        assert_eq!(turned(UPRIGHT, Vector3::zeros()), UPRIGHT);
    }
}
