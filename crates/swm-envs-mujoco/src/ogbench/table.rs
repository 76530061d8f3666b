//! A table in simulation: where its cubes, their goals and the furniture are, and whether they are where they belong.

use super::furniture::{Furniture, Which};
use super::layout::{Kind, REACHED};
use super::pose::{self, Quaternion};
use super::robot::Robot;
use super::state::{Pursued, TaskState};
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// Where everything on a table is found in the simulation.
pub(super) struct Table {
    pub(super) kind: Kind,
    pub(super) robot: Robot,
    cubes: Vec<Cube>,
    pub(super) furniture: Option<Furniture>,
}

/// Where a cube's values are.
struct Cube {
    qpos: usize,
    qvel: usize,
    /// Of the marker that shows its goal.
    mocap: usize,
    /// The marker.
    marker: usize,
}

impl Table {
    /// Whether what is read and rendered after a control step belongs to the state before the last physics step. With furniture,
    /// everything is computed again.
    pub(super) fn is_late(&self) -> bool {
        self.furniture.is_none()
    }

    /// Finds everything. The simulation stands at its reference position, computed.
    pub(super) fn new(kind: Kind, sim: &Simulation) -> Result<Self, MujocoError> {
        let model: &Model = sim.model();
        let cube = |index: usize| {
            let joint = model.id(Object::Joint, &format!("object_joint_{index}"))?;
            let (qpos, qvel) = model.joint_addresses(joint);
            let body = model.id(Object::Body, &format!("object_target_{index}"))?;
            let mocap = model
                .mocap_index(body)
                .ok_or_else(|| MujocoError::Start("a goal that cannot move".to_owned()))?;
            let marker = model.id(Object::Geom, &format!("target_object_{index}"))?;
            Ok::<_, MujocoError>(Cube { qpos, qvel, mocap, marker })
        };
        let furniture = (kind == Kind::Scene).then(|| Furniture::new(model)).transpose()?;
        let cubes = (0..kind.cubes()).map(cube).collect::<Result<_, _>>()?;
        Ok(Self { kind, robot: Robot::new(sim)?, cubes, furniture })
    }

    /// Where a cube is, m.
    pub(super) fn cube(&self, sim: &Simulation, index: usize) -> [f64; 3] {
        self.cube_in(sim.qpos(), index)
    }

    /// Where a cube is in these positions of the model, m.
    pub(super) fn cube_in(&self, qpos: &[f64], index: usize) -> [f64; 3] {
        let at = self.cubes[index].qpos;
        [0, 1, 2].map(|k| qpos[at + k])
    }

    /// How a cube is turned.
    pub(super) fn cube_rotation(&self, sim: &Simulation, index: usize) -> Quaternion {
        self.cube_rotation_in(sim.qpos(), index)
    }

    /// How a cube is turned in these positions of the model.
    pub(super) fn cube_rotation_in(&self, qpos: &[f64], index: usize) -> Quaternion {
        let at = self.cubes[index].qpos + 3;
        [0, 1, 2, 3].map(|k| qpos[at + k])
    }

    /// Puts a cube somewhere, at rest. Computes nothing.
    pub(super) fn set_cube(
        &self,
        sim: &mut Simulation,
        index: usize,
        position: [f64; 3],
        rotation: Quaternion,
    ) {
        let Cube { qpos, qvel, .. } = self.cubes[index];
        sim.qpos_mut()[qpos..qpos + 3].copy_from_slice(&position);
        sim.qpos_mut()[qpos + 3..qpos + 7].copy_from_slice(&rotation);
        sim.qvel_mut()[qvel..qvel + 6].fill(0.0);
    }

    /// Where a cube belongs, m, and how it is turned there.
    pub(super) fn goal(&self, sim: &Simulation, index: usize) -> ([f64; 3], Quaternion) {
        let at = self.cubes[index].mocap;
        let (positions, rotations) = (sim.mocap_pos(), sim.mocap_quat());
        ([0, 1, 2].map(|k| positions[3 * at + k]), [0, 1, 2, 3].map(|k| rotations[4 * at + k]))
    }

    /// Says where a cube belongs. Computes nothing.
    pub(super) fn set_goal(
        &self,
        sim: &mut Simulation,
        index: usize,
        position: [f64; 3],
        rotation: Quaternion,
    ) {
        let at = self.cubes[index].mocap;
        sim.mocap_pos_mut()[3 * at..3 * at + 3].copy_from_slice(&position);
        sim.mocap_quat_mut()[4 * at..4 * at + 4].copy_from_slice(&rotation);
    }

    /// The markers of goals.
    pub(super) fn markers(&self) -> impl Iterator<Item = usize> + '_ {
        self.cubes.iter().map(|cube| cube.marker)
    }

    /// Whether a cube is where it belongs.
    fn cube_is_home(&self, sim: &Simulation, index: usize) -> bool {
        pose::distance(self.cube(sim, index), self.goal(sim, index).0) <= REACHED
    }

    fn slide_is_home(&self, sim: &Simulation, task_state: &TaskState, which: Which) -> bool {
        self.furniture.as_ref().is_none_or(|furniture| {
            let [position, _] = furniture.position(sim, which);
            (position - task_state.goal_slides[which as usize]).abs() <= REACHED
        })
    }

    /// Whether one thing is where it belongs.
    pub(super) fn is_met(&self, sim: &Simulation, task_state: &TaskState, pursued: Pursued) -> bool {
        match pursued {
            Pursued::Everything => self.unmet_count(sim, task_state) == 0,
            Pursued::Cube(index) => self.cube_is_home(sim, index.into()),
            Pursued::Button(index) => {
                task_state.buttons[usize::from(index)] == task_state.goal_buttons[usize::from(index)]
            }
            Pursued::Drawer => self.slide_is_home(sim, task_state, Which::Drawer),
            Pursued::Window => self.slide_is_home(sim, task_state, Which::Window),
        }
    }

    /// How many things are not where they belong.
    pub(super) fn unmet_count(&self, sim: &Simulation, task_state: &TaskState) -> usize {
        self.all().filter(|pursued| !self.is_met(sim, task_state, *pursued)).count()
    }

    /// What is to be done now: what is pursued, or of everything the first thing that is left: a button whose slide is
    /// locked and has to move, the cube with the lowest goal, slides, buttons.
    pub(super) fn next(&self, sim: &Simulation, task_state: &TaskState) -> Pursued {
        if task_state.pursued != Pursued::Everything {
            return task_state.pursued;
        }
        let is_left = |pursued: &Pursued| match *pursued {
            // What lies in the drawer as it should comes home with it.
            Pursued::Cube(index) => {
                !self.is_met(sim, task_state, *pursued)
                    && pose::distance(
                        self.cube(sim, index.into()),
                        self.next_place(sim, task_state, index.into()),
                    ) > REACHED
            }
            _ => !self.is_met(sim, task_state, *pursued),
        };
        if self.has_to_open_drawer(sim, task_state) {
            return if task_state.buttons[0] == 0 { Pursued::Button(0) } else { Pursued::Drawer };
        }
        if self.furniture.is_some() {
            let slides = [Pursued::Drawer, Pursued::Window].into_iter().enumerate();
            let mut locked =
                slides.filter(|(index, slide)| task_state.buttons[*index] == 0 && is_left(slide));
            if let Some((index, _)) = locked.next() {
                return Pursued::Button(index as u8);
            }
        }
        let cubes = (0..self.cubes.len() as u8).map(Pursued::Cube).filter(is_left);
        let height = |pursued: &Pursued| match *pursued {
            Pursued::Cube(index) => self.goal(sim, index.into()).0[2],
            _ => 0.0,
        };
        if let Some(lowest) = cubes.min_by(|a, b| height(a).total_cmp(&height(b))) {
            return lowest;
        }
        let furniture = [Pursued::Drawer, Pursued::Window, Pursued::Button(0), Pursued::Button(1)];
        let mut furniture = furniture.into_iter().filter(|_| self.furniture.is_some());
        furniture.find(is_left).unwrap_or(Pursued::Cube(0))
    }

    /// How far the drawer is from where it belongs, along y, if this cube belongs into it, m.
    fn off_in_drawer(&self, sim: &Simulation, task_state: &TaskState, index: usize) -> Option<f64> {
        /// The middle of the closed drawer, m, and how far from it a cube in it is at most.
        const MIDDLE: [f64; 2] = [0.33, -0.356];
        const INSIDE: f64 = 0.08;
        /// Its bottom is higher than the table by more than the smallest cube's half side.
        const BOTTOM: f64 = 0.05;
        let furniture = self.furniture.as_ref()?;
        let ([x, y, z], goal) = (self.goal(sim, index).0, task_state.goal_slides[Which::Drawer as usize]);
        let is_inside = z > BOTTOM && pose::distance([x, y], [MIDDLE[0], MIDDLE[1] - goal]) < INSIDE;
        is_inside.then(|| goal - furniture.position(sim, Which::Drawer)[0])
    }

    /// Where a cube is to be put now, m: where it belongs, or to its place in the drawer, wherever that is.
    pub(super) fn next_place(&self, sim: &Simulation, task_state: &TaskState, index: usize) -> [f64; 3] {
        let [x, y, z] = self.goal(sim, index).0;
        let is_next = task_state.pursued == Pursued::Everything;
        let off = if is_next { self.off_in_drawer(sim, task_state, index) } else { None };
        [x, y + off.unwrap_or(0.0), z]
    }

    /// Whether the drawer has to be opened for a cube that belongs into it.
    pub(super) fn has_to_open_drawer(&self, sim: &Simulation, task_state: &TaskState) -> bool {
        /// The drawer is open enough.
        const OPEN: f64 = -0.13;
        let Some(furniture) = &self.furniture else { return false };
        let is_outside = |index: usize| {
            self.off_in_drawer(sim, task_state, index).is_some()
                && pose::distance(self.cube(sim, index), self.next_place(sim, task_state, index)) > REACHED
        };
        task_state.pursued == Pursued::Everything
            && furniture.position(sim, Which::Drawer)[0] > OPEN
            && (0..self.cubes.len()).any(is_outside)
    }

    /// What is left to do, in m; see [`super::env::TableEnv`]'s `task_cost`.
    pub(super) fn cost(&self, sim: &Simulation, task_state: &TaskState) -> f64 {
        /// Weight of the effector's distance.
        const EFFECTOR: f64 = 0.3;
        /// A button that has to be pressed counts as much as so many m.
        const BUTTON: f64 = 0.1;
        let cube = |index: usize| pose::distance(self.cube(sim, index), self.goal(sim, index).0);
        let off = |pursued: Pursued| match (pursued, &self.furniture) {
            (Pursued::Cube(index), _) => cube(index.into()),
            (Pursued::Drawer, Some(furniture)) => {
                (furniture.position(sim, Which::Drawer)[0] - task_state.goal_slides[0]).abs()
            }
            (Pursued::Window, Some(furniture)) => {
                (furniture.position(sim, Which::Window)[0] - task_state.goal_slides[1]).abs()
            }
            _ => BUTTON * f64::from(u8::from(!self.is_met(sim, task_state, pursued))),
        };
        let next = self.next(sim, task_state);
        let wanted: f64 = match task_state.pursued {
            Pursued::Everything => self.all().map(off).sum(),
            one => off(one),
        };
        let reach = pose::distance(self.robot.effector(sim).position, self.place_of(sim, next));
        wanted + EFFECTOR * if self.is_met(sim, task_state, task_state.pursued) { 0.0 } else { reach }
    }

    /// Everything that can be where it belongs.
    fn all(&self) -> impl Iterator<Item = Pursued> {
        let furniture: &'static [Pursued] = if self.furniture.is_some() {
            &[Pursued::Button(0), Pursued::Button(1), Pursued::Drawer, Pursued::Window]
        } else {
            &[]
        };
        (0..self.cubes.len() as u8).map(Pursued::Cube).chain(furniture.iter().copied())
    }

    /// The place that matters for what is pursued: the cube, the button or the handle, m.
    pub(super) fn place_of(&self, sim: &Simulation, pursued: Pursued) -> [f64; 3] {
        match (pursued, &self.furniture) {
            (Pursued::Cube(index), _) => self.cube(sim, index.into()),
            (Pursued::Button(index), Some(furniture)) => furniture.button_top(sim, index.into()),
            (Pursued::Drawer, Some(furniture)) => furniture.handle(sim, Which::Drawer).0,
            (Pursued::Window, Some(furniture)) => furniture.handle(sim, Which::Window).0,
            _ => self.cube(sim, 0),
        }
    }
}
