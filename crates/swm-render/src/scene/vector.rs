//! Small vectors for setting things up, in `f64`: what is done once per surface and frame can afford precision.

pub(super) type Vector = [f64; 3];
/// Rows of a matrix.
pub(super) type Matrix = [Vector; 3];

pub(super) fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(super) fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(super) fn scale(a: Vector, by: f64) -> Vector {
    [a[0] * by, a[1] * by, a[2] * by]
}

pub(super) fn length(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// `a` with length 1; zero stays zero.
pub(super) fn normalized(a: Vector) -> Vector {
    let length = length(a);
    if length > 0.0 { scale(a, 1.0 / length) } else { a }
}

/// Some vector of length 1 across `a`.
pub(super) fn across(a: Vector) -> Vector {
    let axis = if a[0].abs() < 0.9 * length(a) { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    normalized(cross(a, axis))
}

pub(super) fn column(m: Matrix, index: usize) -> Vector {
    [m[0][index], m[1][index], m[2][index]]
}

/// `m v`.
pub(super) fn rotate(m: Matrix, v: Vector) -> Vector {
    [dot(m[0], v), dot(m[1], v), dot(m[2], v)]
}

/// The transpose of `m` times `v`: into the frame whose axes are the columns of `m`.
pub(super) fn unrotate(m: Matrix, v: Vector) -> Vector {
    [dot(column(m, 0), v), dot(column(m, 1), v), dot(column(m, 2), v)]
}

pub(super) fn wide(v: [f32; 3]) -> Vector {
    v.map(f64::from)
}
