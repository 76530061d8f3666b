//! One simulated state over a model: reading and saving; `stepping` moves it.

mod stepping;

use std::ptr::NonNull;
use std::sync::Arc;

use super::bindings::{mjData, mjModel, mjSTATE_INTEGRATION, mjtSize};
use super::guard::guarded;
use super::model::{slice, slice_mut};
use super::{Library, Model};
use crate::error::MujocoError;

/// A state of a model (`mjData`), and everything that MuJoCo computes from it.
///
/// After an error it must be [reset](Simulation::reset): until then every step is refused.
pub struct Simulation {
    library: &'static Library,
    model: Arc<Model>,
    raw: NonNull<mjData>,
    failed: bool,
}

// SAFETY: it owns its memory, and MuJoCo keeps no thread-bound state in it (no thread pool is attached).
unsafe impl Send for Simulation {}
// SAFETY: through `&Simulation` it is only read.
unsafe impl Sync for Simulation {}

/// What the state consists of: everything that the future depends on.
const STATE: i32 = mjSTATE_INTEGRATION as i32;

/// Arrays that are read: `name: [rows, width]`, `rows` a size of the model.
macro_rules! arrays {
    ($($(#[$meta:meta])* $name:ident [$rows:ident, $width:literal];)*) => {$(
        $(#[$meta])*
        pub fn $name(&self) -> &[f64] {
            // SAFETY: MuJoCo allocates `rows × width` values here, initialized, for as long as the data lives.
            unsafe { slice(self.header().$name, self.model.header().$rows, $width) }
        }
    )*};
}

/// Arrays of which one row is read at a time.
macro_rules! rows {
    ($($(#[$meta:meta])* $name:ident [$rows:ident, $width:literal];)*) => {$(
        $(#[$meta])*
        pub fn $name(&self, index: usize) -> [f64; $width] {
            // SAFETY: MuJoCo allocates `rows × width` values here; the slice checks the index.
            let all = unsafe { slice(self.header().$name, self.model.header().$rows, $width) };
            std::array::from_fn(|column| all[index * $width + column])
        }
    )*};
}

impl Simulation {
    /// A new state at the model's reference position.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Raised`]: there is no memory.
    pub fn new(model: Arc<Model>) -> Result<Self, MujocoError> {
        let library = model.library();
        // SAFETY: the model is valid.
        let raw = guarded(|| unsafe { (library.api().mj_makeData)(model.as_ptr()) })?;
        let raw = NonNull::new(raw).ok_or_else(|| MujocoError::Raised("no memory for a state".to_owned()))?;
        Ok(Self { library, model, raw, failed: false })
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The model, to be edited: copied first if it is shared.
    pub fn model_mut(&mut self) -> &mut Model {
        Arc::make_mut(&mut self.model)
    }

    /// Continues with another model. The state is lost where their structure differs; else it stays.
    ///
    /// # Errors
    ///
    /// As of [`Simulation::new`].
    pub fn set_model(&mut self, model: Arc<Model>) -> Result<(), MujocoError> {
        if Arc::ptr_eq(&self.model, &model) {
            return Ok(());
        }
        if same_structure(self.model.header(), model.header()) {
            self.model = model;
        } else {
            *self = Self::new(model)?;
        }
        Ok(())
    }

    pub(super) fn as_mut_ptr(&mut self) -> *mut mjData {
        self.raw.as_ptr()
    }

    fn header(&self) -> &mjData {
        // SAFETY: `raw` is valid as long as `self`, and nothing writes while `&self` is lent.
        unsafe { self.raw.as_ref() }
    }

    arrays! {
        /// Positions, `[nq]`.
        qpos [nq, 1];
        /// Velocities, `[nv]`.
        qvel [nv, 1];
        /// Activations, `[na]`.
        act [na, 1];
        /// Controls, `[nu]`.
        ctrl [nu, 1];
        /// Accelerations from which the next solution starts, `[nv]`.
        qacc_warmstart [nv, 1];
        /// All sensors, `[nsensordata]`; see [`Simulation::sensor`].
        sensordata [nsensordata, 1];
    }

    rows! {
        /// The position of a body's frame, m.
        xpos [nbody, 3];
        /// The orientation of a body's frame, row-major.
        xmat [nbody, 9];
        /// The orientation of a body's frame, quaternion w x y z.
        xquat [nbody, 4];
        /// The position of a body's center of mass, m.
        xipos [nbody, 3];
        /// The position of a geom, m.
        geom_xpos [ngeom, 3];
        /// The orientation of a geom, row-major.
        geom_xmat [ngeom, 9];
        /// The position of a site, m.
        site_xpos [nsite, 3];
        /// The orientation of a site, row-major.
        site_xmat [nsite, 9];
        /// The center of mass of a body and all below it, m.
        subtree_com [nbody, 3];
        /// The force and torque on a body from contacts and the like, in the frame of its tree's center of mass: torque,
        /// then force. Only up to date after [`Simulation::advance`].
        cfrc_ext [nbody, 6];
        /// The angular momentum of a body and all below it, kg m²/s. Only up to date in models with a sensor of subtree
        /// velocity or momentum.
        subtree_angmom [nbody, 3];
    }

    /// Positions, to be set.
    pub fn qpos_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocates `nq` values here, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().qpos, self.model.header().nq, 1) }
    }

    /// Velocities, to be set.
    pub fn qvel_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocates `nv` values here, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().qvel, self.model.header().nv, 1) }
    }

    /// Activations, to be set.
    pub fn act_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocates `na` values here, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().act, self.model.header().na, 1) }
    }

    /// Controls, to be set.
    pub fn ctrl_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocates `nu` values here, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().ctrl, self.model.header().nu, 1) }
    }

    /// The start of the next solution, to be set.
    pub fn qacc_warmstart_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocates `nv` values here, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().qacc_warmstart, self.model.header().nv, 1) }
    }

    /// Places of bodies that are moved by hand, `[nmocap, 3]`, m.
    pub fn mocap_pos(&self) -> &[f64] {
        // SAFETY: MuJoCo allocates that many values here, initialized, for as long as the data lives.
        unsafe { slice(self.header().mocap_pos, self.model.header().nmocap, 3) }
    }

    /// Places of bodies that are moved by hand, to be set.
    pub fn mocap_pos_mut(&mut self) -> &mut [f64] {
        // SAFETY: as above, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().mocap_pos, self.model.header().nmocap, 3) }
    }

    /// Orientations of bodies that are moved by hand, `[nmocap, 4]`, quaternions w x y z.
    pub fn mocap_quat(&self) -> &[f64] {
        // SAFETY: MuJoCo allocates that many values here, initialized, for as long as the data lives.
        unsafe { slice(self.header().mocap_quat, self.model.header().nmocap, 4) }
    }

    /// Orientations of bodies that are moved by hand, to be set.
    pub fn mocap_quat_mut(&mut self) -> &mut [f64] {
        // SAFETY: as above, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().mocap_quat, self.model.header().nmocap, 4) }
    }

    /// The force and torque on a body, to be set: see [`Simulation::cfrc_ext`].
    ///
    /// # Panics
    /// If there is no such body, a mistake of the caller.
    pub fn set_cfrc_ext(&mut self, body: usize, values: [f64; 6]) {
        // SAFETY: MuJoCo allocates `nbody × 6` values here, and `&mut self` is the only access.
        let all = unsafe { slice_mut(self.header().cfrc_ext, self.model.header().nbody, 6) };
        all[6 * body..][..6].copy_from_slice(&values);
    }

    /// The linear velocity, m/s, and the angular velocity, rad/s, of a site: its Jacobian, by the positions that were last
    /// computed, times the present velocities. `jacobian` is scratch.
    pub fn site_velocity(&self, site: usize, jacobian: &mut Vec<f64>) -> [[f64; 3]; 2] {
        let nv = self.qvel().len();
        assert!(site < self.model.header().nsite as usize, "the model has no site {site}");
        jacobian.clear();
        jacobian.resize(6 * nv, 0.0);
        let (linear, angular) = jacobian.split_at_mut(3 * nv);
        // SAFETY: model and data are valid and belong together, the site exists, and both arrays have room for 3 × nv values.
        unsafe {
            let (linear, angular) = (linear.as_mut_ptr(), angular.as_mut_ptr());
            let (model, data) = (self.model.as_ptr(), self.raw.as_ptr());
            (self.library.api().mj_jacSite)(model, data, linear, angular, site as i32);
        }
        let times = |row: &[f64]| row.iter().zip(self.qvel()).map(|(a, b)| a * b).sum::<f64>();
        let product = |half: &[f64]| std::array::from_fn(|k| times(&half[k * nv..][..nv]));
        [product(linear), product(angular)]
    }

    /// Simulated seconds since the reset.
    pub fn time_s(&self) -> f64 {
        self.header().time
    }

    /// Sets the simulated time.
    pub fn set_time(&mut self, time_s: f64) {
        // SAFETY: `raw` is valid, and `&mut self` is the only access.
        unsafe { self.raw.as_mut().time = time_s };
    }

    /// Contacts found.
    pub fn contacts(&self) -> usize {
        self.header().ncon as usize
    }

    /// The force with which two geoms press on each other: the sum over their contacts, N.
    pub fn pressure(&self, a: usize, b: usize) -> f64 {
        let header = self.header();
        // SAFETY: MuJoCo has filled `ncon` contacts and `nefc` forces in its arena, which stay while the data is lent; the slices
        // check every index. Contacts that are not solved have the address -1.
        let (contacts, forces) = unsafe {
            (slice(header.contact, header.ncon.into(), 1), slice(header.efc_force, header.nefc.into(), 1))
        };
        let is_theirs = |pair: [i32; 2]| [[a, b], [b, a]].contains(&pair.map(|geom| geom as usize));
        let theirs = contacts.iter().filter(|contact| is_theirs([contact.geom1, contact.geom2]));
        theirs.filter_map(|contact| forces.get(usize::try_from(contact.efc_address).ok()?)).sum()
    }

    /// The values of one sensor, by its index in the model.
    pub fn sensor(&self, sensor: usize) -> &[f64] {
        &self.sensordata()[self.model.sensor_range(sensor)]
    }

    /// All sensors, to be set: those of accelerations do not follow from the state.
    pub fn sensordata_mut(&mut self) -> &mut [f64] {
        // SAFETY: MuJoCo allocates `nsensordata` values here, and `&mut self` is the only access.
        unsafe { slice_mut(self.header().sensordata, self.model.header().nsensordata, 1) }
    }

    /// The values of one sensor, to be set.
    pub fn sensor_mut(&mut self, sensor: usize) -> &mut [f64] {
        let range = self.model.sensor_range(sensor);
        &mut self.sensordata_mut()[range]
    }

    /// Back to the reference position: time, velocities, controls and activations are zero. Computes nothing yet.
    pub fn reset(&mut self) {
        // SAFETY: model and data are valid and belong together. It only writes.
        unsafe { (self.library.api().mj_resetData)(self.model.as_ptr(), self.raw.as_ptr()) };
        self.failed = false;
    }

    /// Returns to a state that [`Simulation::save_state`] saved, and computes everything that follows from it. That
    /// changes where the next solution begins: see [`Simulation::set_state`].
    ///
    /// # Errors
    ///
    /// A state of another size, and those of [`Simulation::forward`].
    pub fn load_state_and_compute(&mut self, state: &[f64]) -> Result<(), MujocoError> {
        self.load_state(state)?;
        self.forward()
    }

    /// Appends the state, without what was computed from it.
    pub fn save_state(&self, out: &mut Vec<f64>) {
        let start = out.len();
        out.resize(start + self.state_size(), 0.0);
        // SAFETY: model and data are valid and belong together; the buffer has the size that MuJoCo asks for.
        unsafe {
            let state = out[start..].as_mut_ptr();
            (self.library.api().mj_getState)(self.model.as_ptr(), self.raw.as_ptr(), state, STATE);
        }
    }

    fn load_state(&mut self, state: &[f64]) -> Result<(), MujocoError> {
        let (found, expected) = (state.len(), self.state_size());
        if found != expected {
            return Err(MujocoError::StateSize { found, expected });
        }
        self.reset();
        self.set_state(state);
        Ok(())
    }

    /// Sets a state that [`Simulation::save_state`] saved, and computes nothing.
    ///
    /// # Panics
    /// If it has another size, a mistake of the caller.
    pub fn set_state(&mut self, state: &[f64]) {
        assert_eq!(state.len(), self.state_size(), "a state of another model");
        // SAFETY: model and data are valid and belong together; the buffer has the size that MuJoCo asks for.
        unsafe {
            (self.library.api().mj_setState)(self.model.as_ptr(), self.raw.as_ptr(), state.as_ptr(), STATE);
        }
    }

    /// Appends everything that the future depends on to `out`.
    pub fn save(&self, out: &mut Vec<f64>) {
        self.save_state(out);
        // Sensors of accelerations belong to the last physics step and do not follow from the state.
        out.extend_from_slice(self.sensordata());
    }

    /// Returns to what [`Simulation::save`] saved, under a model of the same structure.
    ///
    /// # Errors
    ///
    /// [`MujocoError::StateSize`], and those of [`Simulation::forward`].
    pub fn load(&mut self, saved: &[f64]) -> Result<(), MujocoError> {
        let (size, sensors) = (self.state_size(), self.sensordata().len());
        if saved.len() != size + sensors {
            return Err(MujocoError::StateSize { found: saved.len(), expected: size + sensors });
        }
        let (state, sensordata) = saved.split_at(size);
        self.load_state(state)?;
        // SAFETY: model and data are valid and belong together.
        self.checked(|api, model, data| unsafe { (api.mj_step1)(model, data) })?;
        self.sensordata_mut().copy_from_slice(sensordata);
        Ok(())
    }

    fn state_size(&self) -> usize {
        // SAFETY: the model is valid.
        unsafe { (self.library.api().mj_stateSize)(self.model.as_ptr(), STATE) as usize }
    }
}

/// Whether data of one model fits the other: all sizes and flags that MuJoCo allocates by are equal.
fn same_structure(a: &mjModel, b: &mjModel) -> bool {
    const SIZES: usize = std::mem::offset_of!(mjModel, flg_gravcomp) / size_of::<mjtSize>();
    // SAFETY: the header begins with integers of this type, one after the other, up to the flags.
    let sizes = |model: &mjModel| unsafe { slice((&raw const *model).cast::<mjtSize>(), SIZES as i64, 1) };
    let flags = |model: &mjModel| [model.flg_gravcomp, model.flg_surfacevel, model.flg_adhesion];
    sizes(a) == sizes(b) && flags(a) == flags(b)
}

impl Drop for Simulation {
    fn drop(&mut self) {
        // SAFETY: the data is ours and is not used again.
        unsafe { (self.library.api().mj_deleteData)(self.raw.as_ptr()) };
    }
}
