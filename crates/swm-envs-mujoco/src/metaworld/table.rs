//! The ten tasks: constants of metaworld 3.1.1, one row each.

use super::task::{
    Done, Grip, Paint, Physics, Point, Reward, Rule, Script, Start, Target, Task, To, Turn, When,
};

/// Where the hand starts, m. Some files of the package have it in single precision.
const AHEAD: [f64; 3] = [0.0, 0.6, 0.2];
const AHEAD_SINGLE: [f64; 3] = [0.0, 0.6_f32 as f64, 0.2_f32 as f64];
const NEAR_SINGLE: [f64; 3] = [0.0, 0.4_f32 as f64, 0.2_f32 as f64];
const ORIGIN: [f64; 3] = [0.0; 3];
/// Where the puck starts.
const PUCK: [[f64; 3]; 2] = [[-0.1, 0.6, 0.02], [0.1, 0.7, 0.02]];
/// Goals in the air.
const AIR: [[f64; 3]; 2] = [[-0.1, 0.8, 0.05], [0.1, 0.9, 0.3]];
const STILL: Start = Start::Joint { at: None, stops: false, computes: false };
const SIDEWAYS: [f64; 2] = [-0.15, 0.15];
const ANY_STRIDE: Option<[f64; 2]> = Some([0.005, 0.02]);

/// Physics of what moves along a joint, by bounds and default of its damping.
const fn jointed(damping: [f64; 3]) -> Physics {
    Physics {
        is_puck: false,
        mass: None,
        grip: None,
        damping: Some(damping),
        stride: ANY_STRIDE,
        sideways: SIDEWAYS,
    }
}

/// Physics of the puck, by bounds of the gripper's strength and of the stride.
const fn puck(grip: Option<[f64; 2]>, stride: Option<[f64; 2]>) -> Physics {
    let mass = Some(("obj", [0.05, 5.0, 0.75]));
    Physics { is_puck: true, mass, grip, damping: None, stride, sideways: SIDEWAYS }
}

const DRAWER: ([[f64; 3]; 2], Option<(&str, bool)>) =
    ([[-0.1, 0.9, 0.0], [0.1, 0.9, 0.0]], Some(("drawer", false)));
const BEIGE: (Paint, [f64; 3]) = (Paint::Material("drawer_beige"), [0.4, 0.65, 0.4]);
const FRAME: (Paint, [f64; 3]) = (Paint::Material("window_red"), [0.36, 0.26, 0.27]);
const RED: (Paint, [f64; 3]) = (Paint::Geom("objGeom"), [1.0, 0.0, 0.0]);

pub(super) const REACH: Task = Task {
    id: "swm/MetaWorldReach-v0",
    file: "sawyer_reach_v3.xml",
    hand: AHEAD,
    object: PUCK,
    goal: Some((AIR, 3)),
    apart: 0.15,
    fixture: None,
    start: Start::Free,
    seen: Point::Body("obj", ORIGIN),
    turn: Turn::Geom("objGeom"),
    achieved: Point::Tips,
    target: Target::FromGoal(ORIGIN),
    reward: Reward::Reach,
    done: Done::Hand,
    paint: RED,
    physics: puck(None, ANY_STRIDE),
    script: Script::Rules {
        offset: ORIGIN,
        rules: &[Rule(When::Always, To::Goal, 5.0)],
        grip: Grip::Constant(0.0),
    },
};

pub(super) const PUSH: Task = Task {
    id: "swm/MetaWorldPush-v0",
    file: "sawyer_push_v3.xml",
    goal: Some(([[-0.1, 0.8, 0.01], [0.1, 0.9, 0.02]], 2)),
    start: Start::FreeAtRest,
    achieved: Point::Body("obj", ORIGIN),
    target: Target::AtRest,
    reward: Reward::Push,
    done: Done::Object(ORIGIN),
    physics: puck(Some([400.0, 600.0]), None),
    script: Script::Rules {
        offset: [-0.005, 0.0, 0.0],
        rules: &[
            Rule(When::Far(0.02), To::Object([0.0, 0.0, 0.2]), 10.0),
            Rule(When::High(0.04), To::Object([0.0, 0.0, 0.03]), 10.0),
            Rule(When::Always, To::Goal, 10.0),
        ],
        grip: Grip::Beside(0.02, 0.1),
    },
    ..REACH
};

pub(super) const PICK_PLACE: Task = Task {
    id: "swm/MetaWorldPickPlace-v0",
    file: "sawyer_pick_place_v3.xml",
    achieved: Point::Body("obj", ORIGIN),
    reward: Reward::PickPlace,
    done: Done::Object(ORIGIN),
    physics: puck(Some([100.0, 1600.0]), Some([0.005, 0.015])),
    script: Script::Rules {
        offset: [-0.005, 0.0, 0.0],
        rules: &[
            Rule(When::Far(0.02), To::Object([0.0, 0.0, 0.1]), 10.0),
            Rule(When::HighOver(0.05, 0.04), To::Object([0.0, 0.0, 0.03]), 10.0),
            Rule(When::Open(0.73), To::Stay, 10.0),
            Rule(When::Always, To::Goal, 10.0),
        ],
        grip: Grip::Within(0.07),
    },
    ..REACH
};

pub(super) const DOOR_OPEN: Task = Task {
    id: "swm/MetaWorldDoorOpen-v0",
    file: "sawyer_door_pull.xml",
    hand: AHEAD,
    object: [[0.0, 0.85, 0.15], [0.1, 0.95, 0.15]],
    goal: None,
    apart: 0.0,
    fixture: Some(("door", false)),
    start: Start::Joint { at: Some(0.0), stops: true, computes: true },
    seen: Point::Geom("handle"),
    turn: Turn::Geom("handle"),
    achieved: Point::Geom("handle"),
    target: Target::FromObject([-0.3, -0.45, 0.0]),
    reward: Reward::Door,
    done: Done::Joint(-1.2),
    paint: (Paint::Material("dl_metal2"), [0.3, 0.32, 0.35]),
    physics: Physics { sideways: [-0.15, 0.0], ..jointed([0.5, 8.0, 2.0]) },
    // The package's last rule stays beside the handle, and opens 46 of 50 doors.
    script: Script::Rules {
        offset: [-0.05, 0.0, 0.0],
        rules: &[
            Rule(When::Far(0.12), To::Object([0.06, 0.02, 0.2]), 25.0),
            Rule(When::High(0.04), To::Object([0.06, 0.02, 0.0]), 25.0),
            Rule(When::Always, To::Object([-0.05, -0.05, 0.0]), 25.0),
        ],
        grip: Grip::Constant(1.0),
    },
};

pub(super) const DRAWER_OPEN: Task = Task {
    id: "swm/MetaWorldDrawerOpen-v0",
    file: "sawyer_drawer.xml",
    hand: AHEAD_SINGLE,
    object: DRAWER.0,
    fixture: DRAWER.1,
    start: STILL,
    seen: Point::Body("drawer_link", [0.0, -0.16, 0.0]),
    turn: Turn::Body("drawer_link"),
    achieved: Point::Body("drawer_link", [0.0, -0.16, 0.0]),
    target: Target::FromObject([0.0, -0.16 - 0.2, 0.09]),
    reward: Reward::DrawerOpen,
    done: Done::Joint(-0.19),
    paint: BEIGE,
    physics: jointed([0.5, 20.0, 2.0]),
    script: Script::Rules {
        offset: [0.0, 0.0, -0.02],
        rules: &[
            Rule(When::Far(0.06), To::Object([0.0, 0.0, 0.3]), 4.0),
            Rule(When::High(0.04), To::Object(ORIGIN), 4.0),
            Rule(When::Always, To::Object([0.0, -0.06, 0.0]), 50.0),
        ],
        grip: Grip::Constant(-1.0),
    },
    ..DOOR_OPEN
};

pub(super) const DRAWER_CLOSE: Task = Task {
    id: "swm/MetaWorldDrawerClose-v0",
    start: Start::Joint { at: Some(-0.15), stops: false, computes: true },
    seen: Point::Body("drawer_link", [0.0, -0.16, 0.05]),
    turn: Turn::None,
    achieved: Point::Body("drawer_link", [0.0, -0.16, 0.05]),
    target: Target::FromObject([0.0, -0.16, 0.09]),
    reward: Reward::CloseDrawer,
    done: Done::Joint(0.0),
    script: Script::Rules {
        offset: [0.0, 0.0, -0.02],
        rules: &[
            Rule(When::BehindBelow(0.23), To::Rise(0.5), 25.0),
            Rule(When::Behind, To::Object([0.0, -0.075, 0.23]), 25.0),
            Rule(When::High(0.04), To::Object([0.0, -0.075, 0.0]), 25.0),
            Rule(When::Always, To::Object(ORIGIN), 25.0),
        ],
        grip: Grip::Constant(1.0),
    },
    ..DRAWER_OPEN
};

pub(super) const BUTTON_PRESS_TOPDOWN: Task = Task {
    id: "swm/MetaWorldButtonPressTopdown-v0",
    file: "sawyer_button_press_topdown.xml",
    hand: NEAR_SINGLE,
    object: [[-0.1, 0.8, 0.115], [0.1, 0.9, 0.115]],
    fixture: Some(("box", false)),
    start: Start::Joint { at: None, stops: false, computes: true },
    seen: Point::Body("button", [0.0, 0.0, 0.193]),
    turn: Turn::Body("button"),
    achieved: Point::Body("button", [0.0, 0.0, 0.193]),
    target: Target::Site("hole"),
    reward: Reward::Press,
    done: Done::Joint(-0.09),
    paint: (Paint::Material("btn_red"), [0.6, 0.0, 0.0]),
    physics: jointed([0.2, 20.0, 1.0]),
    script: Script::Rules {
        offset: ORIGIN,
        rules: &[
            Rule(When::Far(0.04), To::Object([0.0, 0.0, 0.1]), 25.0),
            Rule(When::Always, To::Object(ORIGIN), 25.0),
        ],
        grip: Grip::Constant(1.0),
    },
    ..DOOR_OPEN
};

pub(super) const PEG_INSERT_SIDE: Task = Task {
    id: "swm/MetaWorldPegInsertSide-v0",
    file: "sawyer_peg_insertion_side.xml",
    object: [[0.0, 0.5, 0.02], [0.2, 0.7, 0.02]],
    goal: Some(([[-0.35, 0.4, -0.001], [-0.25, 0.7, 0.001]], 3)),
    apart: 0.1,
    fixture: Some(("box", true)),
    seen: Point::Site("pegGrasp"),
    turn: Turn::Site("pegGrasp"),
    achieved: Point::Site("pegHead"),
    target: Target::FromGoal([0.03, 0.0, 0.13]),
    reward: Reward::Peg,
    done: Done::Object([0.1, 0.0, 0.0]),
    paint: (Paint::Geom("peg"), [0.3, 1.0, 0.3]),
    physics: Physics {
        is_puck: false,
        mass: Some(("peg", [0.02, 0.5, 0.1])),
        grip: Some([100.0, 800.0]),
        stride: Some([0.008, 0.02]),
        ..puck(None, None)
    },
    script: Script::Peg,
    ..REACH
};

pub(super) const WINDOW_OPEN: Task = Task {
    id: "swm/MetaWorldWindowOpen-v0",
    file: "sawyer_window_horizontal.xml",
    hand: NEAR_SINGLE,
    object: [[-0.1, 0.7, 0.16], [0.1, 0.9, 0.16]],
    fixture: Some(("window", false)),
    start: Start::Joint { at: Some(0.0), stops: false, computes: false },
    seen: Point::Site("handleOpenStart"),
    turn: Turn::None,
    achieved: Point::Site("handleOpenStart"),
    target: Target::FromObject([0.2, 0.0, 0.0]),
    reward: Reward::OpenWindow,
    done: Done::Joint(0.2),
    paint: FRAME,
    physics: jointed([0.5, 20.0, 2.0]),
    script: Script::Rules {
        offset: [-0.03, -0.03, -0.08],
        rules: &[
            Rule(When::Far(0.04), To::Object([0.0, 0.0, 0.3]), 25.0),
            Rule(When::High(0.02), To::Object(ORIGIN), 25.0),
            Rule(When::Always, To::Object([0.1, 0.0, 0.0]), 25.0),
        ],
        grip: Grip::Constant(1.0),
    },
    ..DOOR_OPEN
};

pub(super) const WINDOW_CLOSE: Task = Task {
    id: "swm/MetaWorldWindowClose-v0",
    object: [[0.0, 0.75, 0.2], [0.0, 0.9, 0.2]],
    start: Start::Joint { at: Some(0.2), stops: false, computes: false },
    seen: Point::Site("handleCloseStart"),
    achieved: Point::Site("handleCloseStart"),
    target: Target::FromObject(ORIGIN),
    reward: Reward::CloseWindow,
    done: Done::Joint(0.0),
    script: Script::Rules {
        offset: [0.03, -0.03, -0.08],
        rules: &[
            Rule(When::Far(0.04), To::Object([0.0, 0.0, 0.25]), 25.0),
            Rule(When::High(0.02), To::Object(ORIGIN), 25.0),
            Rule(When::Always, To::Object([-0.1, 0.0, 0.0]), 25.0),
        ],
        grip: Grip::Constant(1.0),
    },
    ..WINDOW_OPEN
};
