//! What a task is: one row of [`super::table`]. Facts: metaworld 3.1.1.

/// Where the body that pulls the hand may be, m.
pub(super) const REACH: [[f64; 3]; 2] = [[-0.5, 0.4, 0.05], [0.5, 1.0, 0.5]];
/// How far an action of 1 moves that body, m.
pub(super) const STRIDE: f64 = 0.01;
/// Physics steps per control step.
pub(super) const SUBSTEPS: u32 = 5;

/// One of the ten tasks.
#[derive(Debug)]
pub(super) struct Task {
    pub(super) id: &'static str,
    /// The file of its model.
    pub(super) file: &'static str,
    /// Where the hand is driven to before an episode, m.
    pub(super) hand: [f64; 3],
    /// The bounds of where the object, or what it belongs to, starts, m.
    pub(super) object: [[f64; 3]; 2],
    /// The bounds of the goal, m, where it is free, and how many of its coordinates count.
    pub(super) goal: Option<([[f64; 3]; 2], usize)>,
    /// How far from the object the goal is at least, along x and y, m.
    pub(super) apart: f64,
    /// The body that is put in the place of the object (`false`) or the goal before the hand is driven.
    pub(super) fixture: Option<(&'static str, bool)>,
    pub(super) start: Start,
    /// The object as it is observed: place and orientation.
    pub(super) seen: Point,
    pub(super) turn: Turn,
    /// What has to come to the target.
    pub(super) achieved: Point,
    pub(super) target: Target,
    pub(super) reward: Reward,
    /// What the image of the goal shows.
    pub(super) done: Done,
    /// What has the color of the object, and that color.
    pub(super) paint: (Paint, [f64; 3]),
    pub(super) physics: Physics,
    pub(super) script: Script,
}

/// How an episode starts once the hand is where it should be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Start {
    /// The object is free, and put to its place.
    Free,
    /// The same, at the height at which it came to rest.
    FreeAtRest,
    /// The object moves along one joint, which is put somewhere.
    Joint {
        /// Its position, rad or m; `None`: as it came to rest.
        at: Option<f64>,
        /// Whether its velocity is made 0.
        stops: bool,
        /// Whether everything is computed anew before the first observation.
        computes: bool,
    },
}

/// A place in the simulation.
#[derive(Clone, Copy, Debug)]
pub(super) enum Point {
    /// A body, and how far from it, m.
    Body(&'static str, [f64; 3]),
    Geom(&'static str),
    Site(&'static str),
    /// The middle between the finger tips.
    Tips,
}

/// The orientation that is observed.
#[derive(Clone, Copy, Debug)]
pub(super) enum Turn {
    /// x y z w.
    Geom(&'static str),
    /// x y z w.
    Site(&'static str),
    /// w x y z, as MuJoCo has it.
    Body(&'static str),
    /// Zeros.
    None,
}

/// Where [`Task::achieved`] is wanted.
#[derive(Clone, Copy, Debug)]
pub(super) enum Target {
    /// So far from where the object or its fixture was put, m.
    FromObject([f64; 3]),
    /// So far from the goal, m.
    FromGoal([f64; 3]),
    /// At x and y of the goal, as high as the object came to rest.
    AtRest,
    /// Where a site is.
    Site(&'static str),
}

/// The shape of the reward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Reward {
    Reach,
    Push,
    PickPlace,
    Peg,
    Door,
    DrawerOpen,
    Press,
    CloseDrawer,
    OpenWindow,
    CloseWindow,
}

/// What the image of a goal shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Done {
    /// The hand driven to where the fingers are at the target.
    Hand,
    /// The free object so far from the target, m.
    Object([f64; 3]),
    /// The joint of the object, rad or m.
    Joint(f64),
}

/// What is colored.
#[derive(Clone, Copy, Debug)]
pub(super) enum Paint {
    Material(&'static str),
    Geom(&'static str),
}

/// Which factors act on physics, and their bounds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Physics {
    /// The puck: scale and friction.
    pub(super) is_puck: bool,
    /// A free object's body, and the bounds and the default of its mass, kg.
    pub(super) mass: Option<(&'static str, [f64; 3])>,
    /// Bounds of the strength of the gripper.
    pub(super) grip: Option<[f64; 2]>,
    /// Bounds and default of the damping of the joint.
    pub(super) damping: Option<[f64; 3]>,
    /// Bounds of [`STRIDE`].
    pub(super) stride: Option<[f64; 2]>,
    /// Bounds of the start of the hand along x, relative to [`Task::hand`].
    pub(super) sideways: [f64; 2],
}

/// The rules of an expert.
#[derive(Clone, Copy, Debug)]
pub(super) enum Script {
    /// The first rule that holds leads the hand; distances are from the object plus the offset.
    Rules { offset: [f64; 3], rules: &'static [Rule], grip: Grip },
    /// Carries the peg into its hole, and corrects by where the peg is, not the hand.
    Peg,
}

/// A rule: when it holds, where it leads, how fast.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rule(pub(super) When, pub(super) To, pub(super) f64);

/// Distances in m.
#[derive(Clone, Copy, Debug)]
pub(super) enum When {
    /// Farther along x and y.
    Far(f64),
    /// Higher or lower by more.
    High(f64),
    /// The same, of an object below this height.
    HighOver(f64, f64),
    /// Behind the object, and lower above it than this.
    BehindBelow(f64),
    Behind,
    /// The gripper is open wider than this.
    Open(f64),
    Always,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum To {
    /// So far from the object and its offset, m.
    Object([f64; 3]),
    Goal,
    /// Where the hand is.
    Stay,
    /// Straight up, to so far above the object, m.
    Rise(f64),
}

/// The command of the fingers; 1 closes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Grip {
    Constant(f64),
    /// 0.6 near the object: along x and y, and along z, m.
    Beside(f64, f64),
    /// 1 nearer than this, m.
    Within(f64),
}
