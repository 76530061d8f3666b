//! The simulation of one environment with what its task has placed in it for this episode.

use std::sync::Arc;

use swm_mujoco::MujocoError;
use swm_mujoco::{Model, Object, Simulation};

/// What a task places at the start of an episode, and where it lies. Its values are a step column, part of every saved
/// state, and part of recorded starts.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// The column.
    pub column: &'static str,
    /// Where its values go.
    pub place: Place,
}

/// Where the values of a [`Target`] go.
#[derive(Clone, Copy, Debug)]
pub enum Place {
    /// The position of a geom in its body, `[3]`, m.
    GeomPosition(&'static str),
    /// The position of a site in its body, `[3]`, m.
    SitePosition(&'static str),
    /// The position of a body in its parent, `[3]`, m.
    BodyPosition(&'static str),
    /// The orientation of a body in its parent, `[4]`, quaternion w x y z.
    BodyQuaternion(&'static str),
    /// Nowhere in the model: so many values that the task reads itself.
    Memory(usize),
}

impl Place {
    /// How many values it takes.
    pub fn dim(self) -> usize {
        match self {
            Place::GeomPosition(_) | Place::SitePosition(_) | Place::BodyPosition(_) => 3,
            Place::BodyQuaternion(_) => 4,
            Place::Memory(dim) => dim,
        }
    }
}

/// Sets touch sensors to what an observation has, as ln(1 + force).
pub(crate) fn recall_touch(stage: &mut Stage, sensors: &[usize], observed: &[f64]) {
    for (sensor, value) in sensors.iter().zip(observed) {
        stage.sim.sensor_mut(*sensor)[0] = value.exp_m1();
    }
}

/// The simulation, and the targets of the episode.
pub struct Stage {
    /// The simulation. Edits of its model by a task belong into [`Stage::set_target`], which undoes, saves and restores
    /// them.
    pub sim: Simulation,
    places: Vec<(Place, usize)>,
    /// Where each target begins in `values`.
    offsets: Vec<usize>,
    values: Vec<f64>,
}

impl Stage {
    pub(super) fn new(model: Arc<Model>, targets: &[Target]) -> Result<Self, MujocoError> {
        let mut places = Vec::new();
        for target in targets {
            let index = match target.place {
                Place::GeomPosition(name) => model.id(Object::Geom, name)?,
                Place::SitePosition(name) => model.id(Object::Site, name)?,
                Place::BodyPosition(name) | Place::BodyQuaternion(name) => model.id(Object::Body, name)?,
                Place::Memory(_) => 0,
            };
            places.push((target.place, index));
        }
        let mut offsets = vec![0];
        for target in targets {
            offsets.push(offsets[offsets.len() - 1] + target.place.dim());
        }
        let values = vec![0.0; offsets[targets.len()]];
        let mut stage = Self { sim: Simulation::new(model)?, places, offsets, values };
        stage.forget_targets();
        Ok(stage)
    }

    /// The values of target `index` of the domain.
    pub fn target(&self, index: usize) -> &[f64] {
        &self.values[self.offsets[index]..self.offsets[index + 1]]
    }

    /// Places target `index` of the domain for the rest of the episode. Computes nothing yet.
    ///
    /// # Panics
    /// If the number of values is not that of its place, a mistake in the domain.
    pub fn set_target(&mut self, index: usize, values: &[f64]) {
        let (place, id) = self.places[index];
        self.values[self.offsets[index]..self.offsets[index + 1]].copy_from_slice(values);
        let rows = match place {
            Place::Memory(_) => return,
            Place::GeomPosition(_) => self.sim.model_mut().geom_pos_mut(),
            Place::SitePosition(_) => self.sim.model_mut().site_pos_mut(),
            Place::BodyPosition(_) => self.sim.model_mut().body_pos_mut(),
            Place::BodyQuaternion(_) => self.sim.model_mut().body_quat_mut(),
        };
        rows[id * values.len()..(id + 1) * values.len()].copy_from_slice(values);
    }

    /// All targets, one after the other.
    pub(super) fn targets(&self) -> &[f64] {
        &self.values
    }

    /// Places all targets.
    pub(super) fn set_targets(&mut self, values: &[f64]) {
        for index in 0..self.places.len() {
            let range = self.offsets[index]..self.offsets[index + 1];
            self.set_target(index, &values[range]);
        }
    }

    /// Reads all targets from the model, where a new episode begins; memory is NaN until it is set.
    pub(super) fn forget_targets(&mut self) {
        let model = self.sim.model();
        for (index, &(place, id)) in self.places.iter().enumerate() {
            let values = &mut self.values[self.offsets[index]..self.offsets[index + 1]];
            let rows = match place {
                Place::Memory(_) => {
                    values.fill(f64::NAN);
                    continue;
                }
                Place::GeomPosition(_) => model.geom_pos(),
                Place::SitePosition(_) => model.site_pos(),
                Place::BodyPosition(_) => model.body_pos(),
                Place::BodyQuaternion(_) => model.body_quat(),
            };
            values.copy_from_slice(&rows[id * values.len()..(id + 1) * values.len()]);
        }
    }
}
