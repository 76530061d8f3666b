//! The arm's geometry: where its flange is for given joint angles, and which angles bring the flange to a pose. No
//! simulation: the reference's inverse kinematics (OGBench's `diff_ik.py`) over the six hinges alone.

use super::pose::{self, Pose, Quaternion};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object};

/// Angles of the six joints, rad.
pub(super) type Angles = [f64; 6];

/// The names of the arm's joints, from the base on.
pub(super) const JOINTS: [&str; 6] = [
    "ur5e/shoulder_pan_joint",
    "ur5e/shoulder_lift_joint",
    "ur5e/elbow_joint",
    "ur5e/wrist_1_joint",
    "ur5e/wrist_2_joint",
    "ur5e/wrist_3_joint",
];

/// The site at the flange.
pub(super) const FLANGE: &str = "ur5e/attachment_site";

/// Where searches for angles begin at a reset, rad.
pub(super) const HOME: Angles = {
    const QUARTER: f64 = std::f64::consts::FRAC_PI_2;
    [-QUARTER, -QUARTER, QUARTER, -QUARTER, -QUARTER, 0.0]
};

/// The chain from the world to the flange.
#[derive(Clone, Debug)]
pub(super) struct Arm {
    links: Vec<Link>,
    flange: Pose,
}

/// A body, seen from the one before, and the hinge that turns it.
#[derive(Clone, Debug)]
struct Link {
    pose: Pose,
    hinge: Option<Hinge>,
}

/// One of the six joints.
#[derive(Clone, Copy, Debug)]
struct Hinge {
    joint: usize,
    anchor: [f64; 3],
    axis: [f64; 3],
}

/// Where the flange is, and where the hinges are and point to.
struct Stance {
    flange: Pose,
    anchors: [[f64; 3]; 6],
    axes: [[f64; 3]; 6],
}

/// At most so many steps towards a pose.
const ITERATIONS: usize = 20;
/// Near enough: m, and rad.
const CLOSE: f64 = 1e-4;
/// No joint turns further in one step, rad.
const LONGEST_TURN: f64 = std::f64::consts::FRAC_PI_4;
/// Keeps the equations solvable where the arm is stretched.
const DAMPING: f64 = 1e-12;

impl Arm {
    /// Reads the chain from a model.
    pub(super) fn new(model: &Model) -> Result<Self, MujocoError> {
        let site = model.id(Object::Site, FLANGE)?;
        let joints = JOINTS.map(|name| model.id(Object::Joint, name));
        let row3 = |values: &[f64], row: usize| [0, 1, 2].map(|k| values[3 * row + k]);
        let row4 = |values: &[f64], row: usize| [0, 1, 2, 3].map(|k| values[4 * row + k]);
        let mut links = Vec::new();
        let mut body = model.site_body()[site] as usize;
        while body != 0 {
            let mut hinge = None;
            for (joint, id) in joints.iter().enumerate() {
                let id = id.clone()?;
                if model.joint_body()[id] as usize == body {
                    let (anchor, axis) = (row3(model.jnt_pos(), id), row3(model.jnt_axis(), id));
                    hinge = Some(Hinge { joint, anchor, axis });
                }
            }
            let pose =
                Pose { position: row3(model.body_pos(), body), rotation: row4(model.body_quat(), body) };
            links.push(Link { pose, hinge });
            body = model.body_parent()[body] as usize;
        }
        links.reverse();
        let flange = Pose { position: row3(model.site_pos(), site), rotation: row4(model.site_quat(), site) };
        Ok(Self { links, flange })
    }

    /// The angles that bring the flange to `target`, from `start` on: at most 20 steps of damped least squares. What is out
    /// of reach is approached.
    pub(super) fn reach(&self, target: Pose, start: Angles) -> Angles {
        let mut angles = start;
        for _ in 0..ITERATIONS {
            let stance = self.stance(&angles);
            let off: [f64; 3] = std::array::from_fn(|k| target.position[k] - stance.flange.position[k]);
            let turn = pose::multiply(target.rotation, pose::inverse(stance.flange.rotation));
            let turn = pose::to_vector(turn);
            if length(off) <= CLOSE && length(turn) <= CLOSE {
                break;
            }
            let error = [off[0], off[1], off[2], turn[0], turn[1], turn[2]];
            let mut step = stance.step_towards(error);
            let longest = step.iter().fold(0.0f64, |longest, angle| longest.max(angle.abs()));
            if longest > LONGEST_TURN {
                step = step.map(|angle| angle * (LONGEST_TURN / longest));
            }
            angles.iter_mut().zip(step).for_each(|(angle, step)| *angle += step);
        }
        angles
    }

    fn stance(&self, angles: &Angles) -> Stance {
        let mut at = Pose { position: [0.0; 3], rotation: pose::IDENTITY };
        let (mut anchors, mut axes) = ([[0.0; 3]; 6], [[0.0; 3]; 6]);
        for link in &self.links {
            at = at.then(link.pose);
            if let Some(Hinge { joint, anchor, axis }) = link.hinge {
                let offset = pose::rotate(at.rotation, anchor);
                anchors[joint] = std::array::from_fn(|k| at.position[k] + offset[k]);
                axes[joint] = pose::rotate(at.rotation, axis);
                at.rotation = pose::multiply(at.rotation, pose::about(axis, angles[joint]));
                let offset = pose::rotate(at.rotation, anchor);
                at.position = std::array::from_fn(|k| anchors[joint][k] - offset[k]);
            }
            at.rotation = pose::normalize(at.rotation);
        }
        Stance { flange: at.then(self.flange), anchors, axes }
    }

    /// Where the flange is.
    #[cfg(test)]
    pub(super) fn flange(&self, angles: &Angles) -> Pose {
        self.stance(angles).flange
    }
}

impl Stance {
    /// The change of the angles that moves the flange by `error`, m and rad, to first order: `Jᵀ (J Jᵀ + λ I)⁻¹ e`.
    fn step_towards(&self, error: [f64; 6]) -> Angles {
        // Rows: motion along x, y, z, then rotation about them. Columns: joints.
        let mut jacobian = [[0.0; 6]; 6];
        for (joint, (axis, anchor)) in self.axes.into_iter().zip(self.anchors).enumerate() {
            let lever = std::array::from_fn(|k| self.flange.position[k] - anchor[k]);
            let motion = pose::cross(axis, lever);
            for k in 0..3 {
                (jacobian[k][joint], jacobian[k + 3][joint]) = (motion[k], axis[k]);
            }
        }
        let mut square = [[0.0; 6]; 6];
        for (row, square_row) in square.iter_mut().enumerate() {
            for (column, entry) in square_row.iter_mut().enumerate() {
                *entry = jacobian[row].iter().zip(jacobian[column]).map(|(a, b)| a * b).sum();
            }
            square_row[row] += DAMPING;
        }
        let weights = solve(square, error);
        std::array::from_fn(|joint| (0..6).map(|row| jacobian[row][joint] * weights[row]).sum())
    }
}

/// `x` with `a x = b`, by elimination with the largest pivot of each column.
fn solve(mut a: [[f64; 6]; 6], mut b: [f64; 6]) -> [f64; 6] {
    for column in 0..6 {
        let largest = (column..6)
            .fold(column, |best, row| if a[row][column].abs() > a[best][column].abs() { row } else { best });
        a.swap(column, largest);
        b.swap(column, largest);
        let pivot = a[column];
        for row in column + 1..6 {
            let factor = a[row][column] / pivot[column];
            for (entry, above) in a[row].iter_mut().zip(pivot).skip(column) {
                *entry -= factor * above;
            }
            b[row] -= factor * b[column];
        }
    }
    let mut x = [0.0; 6];
    for row in (0..6).rev() {
        let known: f64 = (row + 1..6).map(|k| a[row][k] * x[k]).sum();
        x[row] = (b[row] - known) / a[row][row];
    }
    x
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The rotation of a gripper that points down, turned about z.
pub(super) fn downward(yaw_rad: f64) -> Quaternion {
    pose::multiply(pose::about_z(yaw_rad), DOWN)
}

/// The rotation of a gripper that points down.
pub(super) const DOWN: Quaternion = [0.0, 1.0, 0.0, 0.0];
