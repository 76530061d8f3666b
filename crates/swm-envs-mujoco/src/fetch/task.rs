//! The four tasks: constants of gymnasium-robotics 1.4.2.

/// What the arm is to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Task {
    /// Move the gripper to a place in the air.
    Reach,
    /// Push a block to a place on the table, with closed fingers.
    Push,
    /// Hit a puck so that it slides to a place that the arm cannot reach.
    Slide,
    /// Grasp a block and carry it to a place on or above the table.
    PickAndPlace,
}

/// How an action is rewarded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reward {
    /// -1 before the goal, 0 at it.
    Sparse,
    /// The negative distance to the goal, m.
    Dense,
}

/// What the column `observation` holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// The observation and the goal, f32.
    Flat,
    /// The observation alone, f64: the goal has columns of its own.
    Parts,
}

/// One of the twelve environments.
#[derive(Clone, Copy, Debug)]
pub(super) struct Variant {
    pub(super) id: &'static str,
    pub(super) task: Task,
    pub(super) reward: Reward,
    pub(super) form: Form,
}

/// Nearer than this to the goal is success, m.
pub(super) const REACHED: f64 = 0.05;
/// Physics steps per control step.
pub(super) const SUBSTEPS: u32 = 20;
/// How far an action of 1 moves the target of the gripper, m.
pub(super) const STRIDE: f32 = 0.05;
/// Objects start at least so far from the gripper, m.
pub(super) const CLEARANCE: f64 = 0.1;

impl Task {
    /// The file of its model.
    pub(super) fn file(self) -> &'static str {
        match self {
            Task::Reach => "reach.xml",
            Task::Push => "push.xml",
            Task::Slide => "slide.xml",
            Task::PickAndPlace => "pick_and_place.xml",
        }
    }

    /// Where the base of the robot stands, m.
    pub(super) fn base(self) -> [f64; 3] {
        let x = match self {
            Task::Reach => 0.4049,
            Task::Slide => 0.05,
            Task::Push | Task::PickAndPlace => 0.405,
        };
        [x, 0.48, 0.0]
    }

    /// Where the object is dropped before the first episode, m.
    pub(super) fn object_at_first(self) -> Option<[f64; 3]> {
        match self {
            Task::Reach => None,
            Task::Push | Task::PickAndPlace => Some([1.25, 0.53, 0.4]),
            Task::Slide => Some([1.7, 1.1, 0.41]),
        }
    }

    /// Whether there is a block or a puck.
    pub(super) fn has_object(self) -> bool {
        self != Task::Reach
    }

    /// Whether the fingers stay closed, and the last value of an action does nothing.
    pub(super) fn blocks_gripper(self) -> bool {
        self != Task::PickAndPlace
    }

    /// How much higher than on the table the gripper starts, m.
    pub(super) fn extra_height(self) -> f64 {
        match self {
            Task::Reach | Task::PickAndPlace => 0.2,
            Task::Push => 0.0,
            Task::Slide => -0.02,
        }
    }

    /// Where the gripper starts, m, rounded to 0.1 mm.
    pub(super) fn gripper(self) -> [f64; 3] {
        match self {
            Task::Reach => [1.3418, 0.7491, 0.5347],
            Task::Push => [1.3629, 0.7491, 0.4160],
            Task::Slide => [1.0130, 0.7492, 0.4155],
            Task::PickAndPlace => [1.3419, 0.7491, 0.5347],
        }
    }

    /// The height of the middle of an object that lies on the table, m.
    pub(super) fn height(self) -> f64 {
        if self == Task::Slide { 0.419_999_41 } else { 0.424_892_22 }
    }

    /// How far from the gripper along x and y the object starts at most, m.
    pub(super) fn object_range(self) -> f64 {
        if self == Task::Slide { 0.1 } else { 0.15 }
    }

    /// The bounds of goals, m.
    pub(super) fn goals(self) -> [[f64; 3]; 2] {
        let [x, y, z] = self.gripper();
        let height = self.height();
        let (ahead, range) = if self == Task::Slide { (0.4, 0.3) } else { (0.0, 0.15) };
        let [low_z, high_z] = match self {
            Task::Reach => [z - range, z + range],
            Task::Push | Task::Slide => [height; 2],
            Task::PickAndPlace => [height, height + 0.45],
        };
        [[x + ahead - range, y - range, low_z], [x + ahead + range, y + range, high_z]]
    }

    /// Where the object starts by default, m.
    pub(super) fn object_by_default(self) -> [f64; 2] {
        match self {
            Task::Reach | Task::Push => [1.25, 0.75],
            Task::Slide => [1.09, 0.83],
            Task::PickAndPlace => [1.23, 0.75],
        }
    }

    /// Values of an observation.
    pub(super) fn observation_dim(self) -> usize {
        if self.has_object() { 25 } else { 10 }
    }
}
