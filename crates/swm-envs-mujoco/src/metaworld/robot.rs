//! The arm and its scene: where things are in the model, the drive to the start, control steps, observations.

use serde::{Deserialize, Serialize};

use super::task::{Point, REACH, Reward, SUBSTEPS, Start, Target, Task, Turn};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// The orientation of the body that pulls the hand: not normalized, as in the original.
const DOWN: [f64; 4] = [1.0, 0.0, 1.0, 0.0];
/// Physics steps that the drive to the start takes.
const SETTLING: u32 = 250;
/// Where the object's joint is in `qpos` and `qvel`, behind the arm and the fingers.
pub(super) const JOINT: usize = 9;
/// How far a window opens, m.
const WINDOW: f64 = 0.2;
/// The largest opening of the fingers, m.
const OPEN: f64 = 0.1;

/// The half of an observation that is of one step: hand, gripper, object, orientation; the last seven are 0.
pub(super) type Frame = [f64; 18];

/// A [`Point`], looked up.
#[derive(Clone, Copy, Debug)]
enum Spot {
    Body(usize, [f64; 3]),
    Geom(usize),
    Site(usize),
    Tips,
}

/// Indices into the model.
struct Ids {
    hand: usize,
    /// Right and left.
    tips: [usize; 2],
    /// Right and left.
    claws: [usize; 2],
    /// Left and right, and their geoms.
    pads: [(usize, usize); 2],
    seen: Spot,
    turn: Option<Spot>,
    achieved: Spot,
    target: Option<usize>,
    /// The puck.
    puck: Option<usize>,
    /// Where an unpressed button is.
    unpressed: Option<usize>,
    /// Opposite corners of the two boxes before the hole of the peg.
    boxes: Option<[[usize; 2]; 2]>,
}

/// What an episode began with; rewards are measured by it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Origin {
    /// Where the hand and the middle of the finger tips were, m.
    pub(super) hand: [f64; 3],
    pub(super) tips: [f64; 3],
    /// Where the object or its fixture was put, where the object then was, and what has to come to the target, m.
    pub(super) placed: [f64; 3],
    pub(super) object: [f64; 3],
    pub(super) achieved: [f64; 3],
    /// Where it is wanted, m.
    pub(super) target: [f64; 3],
    /// How far the button goes, m.
    pub(super) gap: f64,
}

/// A simulation of one of the tasks.
pub(super) struct Robot {
    pub(super) sim: Simulation,
    pub(super) task: &'static Task,
    ids: Ids,
}

impl Robot {
    /// Finds everything in the simulation's model.
    pub(super) fn new(task: &'static Task, sim: Simulation) -> Result<Self, MujocoError> {
        let ids = Ids::of(task, sim.model())?;
        Ok(Self { sim, task, ids })
    }

    /// Begins an episode with the hand at `hand` and the object at `placed`: the model has its fixture there already. `goal`
    /// is where the goal is. What is read afterwards may be a physics step old: see [`Start::Joint`].
    pub(super) fn begin(
        &mut self,
        hand: [f64; 3],
        placed: [f64; 3],
        goal: [f64; 3],
    ) -> Result<Origin, MujocoError> {
        self.sim.reset();
        self.drive(hand)?;
        let mut origin =
            Origin { hand, tips: self.tips(), placed, achieved: self.achieved(), ..Origin::default() };
        let rest = self.object();
        match self.task.start {
            Start::Free => self.put(placed)?,
            Start::FreeAtRest => self.put([placed[0], placed[1], rest[2]])?,
            Start::Joint { at, stops, computes } => {
                if let Some(at) = at {
                    self.sim.qpos_mut()[JOINT] = at;
                }
                if stops {
                    self.sim.qvel_mut()[JOINT] = 0.0;
                }
                if computes {
                    self.sim.forward()?;
                }
            }
        }
        let from = |[x, y, z]: [f64; 3], by: [f64; 3]| [x + by[0], y + by[1], z + by[2]];
        origin.target = match self.task.target {
            Target::FromObject(by) => from(placed, by),
            Target::FromGoal(by) => from(goal, by),
            Target::AtRest => [goal[0], goal[1], rest[2]],
            Target::Site(_) => self.ids.target.map_or([0.0; 3], |site| self.sim.site_xpos(site)),
        };
        origin.object = match self.task.start {
            Start::Free => placed,
            _ => self.object(),
        };
        match self.task.reward {
            Reward::CloseDrawer => origin.achieved = origin.object,
            // The handle was not yet moved there.
            Reward::CloseWindow => origin.achieved[0] += WINDOW,
            _ => {}
        }
        if let Some(site) = self.ids.unpressed {
            origin.gap = (origin.target[2] - self.sim.site_xpos(site)[2]).abs();
        }
        Ok(origin)
    }

    /// Pulls the hand to a place and lets it settle, with open fingers.
    pub(super) fn drive(&mut self, hand: [f64; 3]) -> Result<(), MujocoError> {
        self.sim.mocap_pos_mut().copy_from_slice(&hand);
        self.sim.mocap_quat_mut().copy_from_slice(&DOWN);
        self.sim.ctrl_mut().copy_from_slice(&[-1.0, 1.0]);
        self.sim.steps(SETTLING)
    }

    /// Puts the free object somewhere, at rest.
    fn put(&mut self, place: [f64; 3]) -> Result<(), MujocoError> {
        self.sim.qpos_mut()[JOINT..JOINT + 3].copy_from_slice(&place);
        self.sim.qvel_mut()[JOINT..JOINT + 6].fill(0.0);
        self.sim.forward()
    }

    /// One control step. The stride is multiplied in single precision, as in the original.
    pub(super) fn advance(&mut self, action: [f32; 4], stride: f32) -> Result<(), MujocoError> {
        let [low, high] = REACH;
        for (k, place) in self.sim.mocap_pos_mut().iter_mut().enumerate() {
            *place = (*place + f64::from(action[k] * stride)).clamp(low[k], high[k]);
        }
        self.sim.mocap_quat_mut().copy_from_slice(&DOWN);
        let closing = f64::from(action[3]);
        self.sim.ctrl_mut().copy_from_slice(&[closing, -closing]);
        self.sim.steps(SUBSTEPS)?;
        self.sim.forward()
    }

    /// What is observed of the positions that were last computed.
    pub(super) fn look(&self) -> Frame {
        let [right, left] = self.ids.claws.map(|claw| self.sim.xpos(claw));
        let mut frame = [0.0; 18];
        frame[..3].copy_from_slice(&self.sim.xpos(self.ids.hand));
        frame[3] = (norm(minus(right, left)) / OPEN).clamp(0.0, 1.0);
        frame[4..7].copy_from_slice(&self.object());
        let turn = match self.ids.turn {
            Some(Spot::Geom(geom)) => quaternion(self.sim.geom_xmat(geom)),
            Some(Spot::Site(site)) => quaternion(self.sim.site_xmat(site)),
            Some(Spot::Body(body, _)) => self.sim.xquat(body),
            _ => [0.0; 4],
        };
        frame[7..11].copy_from_slice(&turn);
        frame
    }

    /// The middle between the finger tips, m.
    pub(super) fn tips(&self) -> [f64; 3] {
        let [right, left] = self.ids.tips.map(|tip| self.sim.site_xpos(tip));
        std::array::from_fn(|k| (right[k] + left[k]) / 2.0)
    }

    /// Where the object is, m.
    pub(super) fn object(&self) -> [f64; 3] {
        self.at(self.ids.seen)
    }

    /// Where what has to come to the target is, m.
    pub(super) fn achieved(&self) -> [f64; 3] {
        self.at(self.ids.achieved)
    }

    /// y of the left and the right pad, m.
    pub(super) fn pads(&self) -> [f64; 2] {
        self.ids.pads.map(|(body, _)| self.sim.xpos(body)[1])
    }

    /// Whether both pads press on the puck.
    pub(super) fn is_touched(&self) -> bool {
        let presses = |puck| self.ids.pads.iter().all(|(_, pad)| self.sim.pressure(*pad, puck) > 0.0);
        self.ids.puck.is_some_and(presses)
    }

    /// The boxes before the hole, as two opposite corners, m.
    pub(super) fn boxes(&self) -> [[[f64; 3]; 2]; 2] {
        self.ids.boxes.map_or([[[0.0; 3]; 2]; 2], |boxes| {
            boxes.map(|corners| corners.map(|site| self.sim.site_xpos(site)))
        })
    }

    fn at(&self, spot: Spot) -> [f64; 3] {
        match spot {
            Spot::Body(body, by) => {
                let place = self.sim.xpos(body);
                std::array::from_fn(|k| place[k] + by[k])
            }
            Spot::Geom(geom) => self.sim.geom_xpos(geom),
            Spot::Site(site) => self.sim.site_xpos(site),
            Spot::Tips => self.tips(),
        }
    }
}

impl Ids {
    fn of(task: &Task, model: &Model) -> Result<Self, MujocoError> {
        let body = |name| model.id(Object::Body, name);
        let geom = |name| model.id(Object::Geom, name);
        let site = |name: &str| model.id(Object::Site, name);
        let spot = |point| {
            Ok::<_, MujocoError>(match point {
                Point::Body(name, by) => Spot::Body(body(name)?, by),
                Point::Geom(name) => Spot::Geom(geom(name)?),
                Point::Site(name) => Spot::Site(site(name)?),
                Point::Tips => Spot::Tips,
            })
        };
        let turn = match task.turn {
            Turn::Geom(name) => Some(Spot::Geom(geom(name)?)),
            Turn::Site(name) => Some(Spot::Site(site(name)?)),
            Turn::Body(name) => Some(Spot::Body(body(name)?, [0.0; 3])),
            Turn::None => None,
        };
        let corners = |n: usize| {
            let [zero, one] =
                ["bottom_right", "top_left"].map(|corner| format!("{corner}_corner_collision_box_{n}"));
            Ok::<_, MujocoError>([site(&zero)?, site(&one)?])
        };
        let is_press = matches!(task.reward, Reward::Press);
        let target = if let Target::Site(name) = task.target { Some(site(name)?) } else { None };
        Ok(Self {
            hand: body("hand")?,
            tips: [site("rightEndEffector")?, site("leftEndEffector")?],
            claws: [body("rightclaw")?, body("leftclaw")?],
            pads: [(body("leftpad")?, geom("leftpad_geom")?), (body("rightpad")?, geom("rightpad_geom")?)],
            seen: spot(task.seen)?,
            turn,
            achieved: spot(task.achieved)?,
            target,
            puck: task.physics.is_puck.then(|| geom("objGeom")).transpose()?,
            unpressed: is_press.then(|| site("buttonStart")).transpose()?,
            boxes: if matches!(task.reward, Reward::Peg) { Some([corners(1)?, corners(2)?]) } else { None },
        })
    }
}

pub(super) fn minus<const N: usize>(a: [f64; N], b: [f64; N]) -> [f64; N] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// The length of a vector: squares summed in order.
pub(super) fn norm<const N: usize>(v: [f64; N]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The quaternion x y z w of a row-major rotation matrix, by SciPy's rule: from the largest of the diagonal and the trace.
fn quaternion(m: [f64; 9]) -> [f64; 4] {
    let at = |row: usize, column: usize| m[3 * row + column];
    let trace = at(0, 0) + at(1, 1) + at(2, 2);
    let mut largest = (3, trace);
    for k in (0..3).rev() {
        // The first of equal ones.
        if at(k, k) >= largest.1 {
            largest = (k, at(k, k));
        }
    }
    let mut q = [0.0; 4];
    if largest.0 == 3 {
        q = [at(2, 1) - at(1, 2), at(0, 2) - at(2, 0), at(1, 0) - at(0, 1), 1.0 + trace];
    } else {
        let (i, j, k) = (largest.0, (largest.0 + 1) % 3, (largest.0 + 2) % 3);
        q[i] = 1.0 - trace + 2.0 * at(i, i);
        q[j] = at(j, i) + at(i, j);
        q[k] = at(k, i) + at(i, k);
        q[3] = at(k, j) - at(j, k);
    }
    let length = norm(q);
    q.map(|x| x / length)
}
