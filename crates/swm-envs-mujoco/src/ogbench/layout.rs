//! The two tables: what stands on them, where things may be, where cameras look from. Numbers of OGBench 1.2.2 and of the
//! reference's wrappers; no behavior.

/// What stands on the table beside the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// So many cubes.
    Cubes(usize),
    /// One cube, two buttons that lock a drawer and a window.
    Scene,
}

impl Kind {
    /// How many cubes there are.
    pub(super) fn cubes(self) -> usize {
        match self {
            Kind::Cubes(count) => count,
            Kind::Scene => 1,
        }
    }

    /// Where everything may be.
    pub(super) fn bounds(self) -> &'static Bounds {
        match self {
            Kind::Cubes(_) => &CUBES,
            Kind::Scene => &SCENE,
        }
    }

    /// The cameras, as (name, position in m, x and y axes).
    pub(super) fn cameras(self) -> [(&'static str, [f64; 3], [f64; 6]); 3] {
        match self {
            Kind::Cubes(_) => [
                ("front", [1.287, 0.0, 0.509], [0.0, 1.0, 0.0, -0.342, 0.0, 0.940]),
                (CAMERA, [1.053, -0.014, 0.639], [0.0, 1.0, 0.0, -0.628, 0.001, 0.778]),
                ("side_pixels", [0.414, -0.753, 0.639], [1.0, 0.0, 0.0, -0.001, 0.628, 0.778]),
            ],
            Kind::Scene => [
                ("front", [1.139, 0.0, 0.821], [0.0, 1.0, 0.0, -0.627, 0.0, 0.779]),
                (CAMERA, [0.905, 0.0, 0.762], [0.0, 1.0, 0.0, -0.771, 0.0, 0.637]),
                ("side_pixels", [0.4, -0.505, 0.762], [1.0, 0.0, 0.0, 0.0, 0.771, 0.637]),
            ],
        }
    }
}

/// The camera that images are taken from, unless another is asked for.
pub(super) const CAMERA: &str = "front_pixels";
/// The names of all cameras.
pub(super) const CAMERAS: [&str; 3] = ["front", CAMERA, "side_pixels"];

/// Where things may be, m: lower and upper corners.
#[derive(Debug)]
pub(super) struct Bounds {
    /// Where the effector starts and ends.
    pub(super) arm: [[f64; 3]; 2],
    /// Where cubes start, and goals of cubes lie: x, y.
    pub(super) object: [[f64; 2]; 2],
}

/// Where commands may lead the effector, m.
pub(super) const WORKSPACE: [[f64; 3]; 2] = [[0.25, -0.35, 0.02], [0.6, 0.35, 0.35]];

static CUBES: Bounds =
    Bounds { arm: [[0.25, -0.35, 0.20], [0.6, 0.35, 0.35]], object: [[0.3, -0.3], [0.55, 0.3]] };

static SCENE: Bounds =
    Bounds { arm: [[0.25, -0.2, 0.20], [0.6, 0.2, 0.35]], object: [[0.3, -0.07], [0.45, 0.18]] };

/// Half the side of a cube by default, m: 0.02 as the reference stores it.
pub(super) const HALF_SIZE: f64 = 0.02f32 as f64;
/// Distance of neighboring cubes by default, m.
pub(super) const SPACING: f64 = 0.1;
/// How far a cube, drawer or window may be from its goal, m.
pub(super) const REACHED: f64 = 0.04;

/// Purple: the gripper.
pub(super) const PURPLE: [f64; 3] = [0.61, 0.28, 0.82];
/// Red: the first cube; what is locked.
pub(super) const RED: [f64; 3] = [0.96, 0.26, 0.33];
/// White: what is not locked.
pub(super) const WHITE: [f64; 3] = [0.9, 0.9, 0.9];
/// The colors of the cubes, in order: red, blue, orange, green.
pub(super) const CUBE_COLORS: [[f64; 3]; 4] =
    [RED, [0.35, 0.55, 0.91], [1.0, 0.69, 0.21], [0.06, 0.74, 0.21]];
/// The two colors of the floor's checker.
pub(super) const FLOOR: [f64; 6] = [0.08, 0.11, 0.16, 0.15, 0.18, 0.25];
