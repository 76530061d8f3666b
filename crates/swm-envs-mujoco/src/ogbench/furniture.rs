//! What the scene has beside its cube: two buttons, and the drawer and the window that they lock.

use super::layout::WHITE;
use super::pose;
use crate::suite::set_color;
use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// Where the furniture's values are.
#[derive(Clone, Debug)]
pub(super) struct Furniture {
    buttons: [Button; 2],
    /// The drawer, then the window: what the buttons lock, in their order.
    slides: [Slide; 2],
}

#[derive(Clone, Debug)]
struct Button {
    qpos: usize,
    qvel: usize,
    geom: usize,
    top: usize,
}

/// A drawer or a window.
#[derive(Clone, Debug)]
struct Slide {
    qpos: usize,
    qvel: usize,
    material: usize,
    handle: usize,
    target: usize,
    /// The axis along which the site of the target moves in its body.
    axis: usize,
}

/// A button is pressed where it passes this position, m.
const PRESSED: f64 = -0.02;
/// Damping of a slide that is locked: high enough to hold, low enough to stay stable.
const LOCKED_DAMPING: f64 = 1e6;
const FREE_DAMPING: f64 = 2.0;

/// Which of the two slides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Which {
    Drawer,
    Window,
}

impl Which {
    /// Position of the closed, then of the open one, m.
    pub(super) fn range(self) -> [f64; 2] {
        match self {
            Which::Drawer => [0.0, -0.16],
            Which::Window => [0.0, 0.2],
        }
    }

    /// The column that tells where it belongs.
    pub(super) fn target_column(self) -> &'static str {
        match self {
            Which::Drawer => "privileged.target_drawer_pos",
            Which::Window => "privileged.target_window_pos",
        }
    }
}

impl Furniture {
    pub(super) fn new(model: &Model) -> Result<Self, MujocoError> {
        let joint = |name: &str| Ok::<_, MujocoError>(model.joint_addresses(model.id(Object::Joint, name)?));
        let button = |index: usize| {
            let (qpos, qvel) = joint(&format!("buttonbox_joint_{index}"))?;
            let geom = model.id(Object::Geom, &format!("btngeom_{index}"))?;
            Ok::<_, MujocoError>(Button {
                qpos,
                qvel,
                geom,
                top: model.id(Object::Site, &format!("btntop_{index}"))?,
            })
        };
        let slide = |name: &str, axis: usize| {
            let (qpos, qvel) = joint(&format!("{name}_slide"))?;
            Ok::<_, MujocoError>(Slide {
                qpos,
                qvel,
                material: model.id(Object::Material, &format!("{name}_handle"))?,
                handle: model.id(Object::Site, &format!("{name}_handle_center"))?,
                target: model.id(Object::Site, &format!("{name}_handle_center_target"))?,
                axis,
            })
        };
        Ok(Self { buttons: [button(0)?, button(1)?], slides: [slide("drawer", 1)?, slide("window", 0)?] })
    }

    fn slide(&self, which: Which) -> &Slide {
        &self.slides[which as usize]
    }

    /// Position, m, and velocity of a button.
    pub(super) fn button(&self, sim: &Simulation, index: usize) -> [f64; 2] {
        let Button { qpos, qvel, .. } = self.buttons[index];
        [sim.qpos()[qpos], sim.qvel()[qvel]]
    }

    /// Where the top of a button is, as last computed.
    pub(super) fn button_top(&self, sim: &Simulation, index: usize) -> [f64; 3] {
        sim.site_xpos(self.buttons[index].top)
    }

    /// Position, m, and velocity of a slide.
    pub(super) fn position(&self, sim: &Simulation, which: Which) -> [f64; 2] {
        let Slide { qpos, qvel, .. } = *self.slide(which);
        [sim.qpos()[qpos], sim.qvel()[qvel]]
    }

    /// The position of a slide in other positions of the model.
    pub(super) fn position_in(&self, qpos: &[f64], which: Which) -> f64 {
        qpos[self.slide(which).qpos]
    }

    /// Puts a slide to a position. Computes nothing.
    pub(super) fn set_position(&self, sim: &mut Simulation, which: Which, position: f64) {
        sim.qpos_mut()[self.slide(which).qpos] = position;
    }

    /// Where a handle is, m, and how it is turned, rad, as last computed.
    pub(super) fn handle(&self, sim: &Simulation, which: Which) -> ([f64; 3], f64) {
        let site = self.slide(which).handle;
        (sim.site_xpos(site), pose::yaw(pose::from_matrix(sim.site_xmat(site))))
    }

    /// Where a handle belongs, as last computed.
    pub(super) fn handle_target(&self, sim: &Simulation, which: Which) -> [f64; 3] {
        sim.site_xpos(self.slide(which).target)
    }

    /// Moves the place where a handle belongs. Computes nothing.
    pub(super) fn set_handle_target(&self, model: &mut Model, which: Which, position: f64) {
        let Slide { target, axis, .. } = *self.slide(which);
        model.site_pos_mut()[3 * target + axis] = position;
    }

    /// Which buttons were pressed since the model stood at `before`.
    pub(super) fn pressed(&self, before: &[f64], sim: &Simulation) -> [bool; 2] {
        [0, 1].map(|index| {
            let at = self.buttons[index].qpos;
            before[at] > PRESSED && sim.qpos()[at] <= PRESSED
        })
    }

    /// Locks and frees the slides by the buttons' states, and shows that: `locked` colors, `[2, 3]`, or white.
    pub(super) fn show_states(&self, model: &mut Model, states: [u8; 2], locked: &[f64]) {
        for index in 0..2 {
            let Slide { qvel, material, .. } = self.slides[index];
            let is_locked = states[index] == 0;
            let color = if is_locked { &locked[3 * index..3 * index + 3] } else { &WHITE };
            set_color(&mut model.geom_rgba_mut()[4 * self.buttons[index].geom..], color);
            set_color(&mut model.mat_rgba_mut()[4 * material..], color);
            model.dof_damping_mut()[qvel] = if is_locked { LOCKED_DAMPING } else { FREE_DAMPING };
        }
    }
}
