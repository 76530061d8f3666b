//! A compiled model: sizes, names, and values as slices.

use std::ffi::CString;
use std::ptr::NonNull;

use swm_core::error::nearest;

use super::bindings::*;
use super::guard::guarded;
use super::{Library, Object, Shape};
use crate::error::MujocoError;

/// A compiled model. Sharing it is free; [`Clone`] copies it whole, so that `Arc::make_mut` gives an own one to edit.
pub struct Model {
    library: &'static Library,
    raw: NonNull<mjModel>,
}

// SAFETY: the model owns all its memory, and MuJoCo keeps no thread-bound state in it.
unsafe impl Send for Model {}
// SAFETY: through `&Model` it is only read, by Rust and by MuJoCo (which takes it as `const`); writing needs `&mut`.
unsafe impl Sync for Model {}

/// Accessors to arrays: `name: type [rows, width]`, documented by their MuJoCo name.
macro_rules! arrays {
    ($($(#[$meta:meta])* $name:ident / $name_mut:ident: $type:ty [$rows:ident, $width:literal];)*) => {$(
        $(#[$meta])*
        pub fn $name(&self) -> &[$type] {
            let raw = self.header();
            // SAFETY: MuJoCo allocates `rows × width` values here, initialized, for as long as the model lives.
            unsafe { slice(raw.$name, raw.$rows, $width) }
        }
        #[doc = concat!("[`Model::", stringify!($name), "`], to be edited.")]
        pub fn $name_mut(&mut self) -> &mut [$type] {
            let (data, rows) = (self.header().$name, self.header().$rows);
            // SAFETY: as above, and `&mut self` is the only access.
            unsafe { slice_mut(data, rows, $width) }
        }
    )*
        /// Takes over every array that can be edited from a model with the same objects.
        ///
        /// # Panics
        /// If the other has other objects, a mistake of the caller.
        pub fn copy_values(&mut self, other: &Model) {
            $(self.$name_mut().copy_from_slice(other.$name());)*
        }
    };
}

impl Model {
    /// Takes ownership.
    ///
    /// # Safety
    /// `raw` is a model that MuJoCo allocated and that nothing else owns.
    pub(super) unsafe fn from_raw(library: &'static Library, raw: NonNull<mjModel>) -> Self {
        Self { library, raw }
    }

    pub(super) fn library(&self) -> &'static Library {
        self.library
    }

    pub(super) fn header(&self) -> &mjModel {
        // SAFETY: `raw` is valid as long as `self`, and nothing writes while `&self` is lent.
        unsafe { self.raw.as_ref() }
    }

    pub(super) fn as_ptr(&self) -> *const mjModel {
        self.raw.as_ptr()
    }

    arrays! {
        /// Reference positions, `[nq]`.
        qpos0 / qpos0_mut: f64 [nq, 1];
        /// Body positions in their parents, `[nbody, 3]`, m.
        body_pos / body_pos_mut: f64 [nbody, 3];
        /// Body orientations in their parents, `[nbody, 4]`, quaternions w x y z.
        body_quat / body_quat_mut: f64 [nbody, 4];
        /// Masses, `[nbody]`, kg.
        body_mass / body_mass_mut: f64 [nbody, 1];
        /// Centers of mass in the bodies' frames, `[nbody, 3]`, m.
        body_ipos / body_ipos_mut: f64 [nbody, 3];
        /// Diagonal inertias, `[nbody, 3]`, kg m².
        body_inertia / body_inertia_mut: f64 [nbody, 3];
        /// Anchors of joints in their bodies, `[njnt, 3]`, m.
        jnt_pos / jnt_pos_mut: f64 [njnt, 3];
        /// Axes of joints in their bodies, `[njnt, 3]`.
        jnt_axis / jnt_axis_mut: f64 [njnt, 3];
        /// Joint limits, `[njnt, 2]`, rad or m.
        jnt_range / jnt_range_mut: f64 [njnt, 2];
        /// Damping, `[nv]`.
        dof_damping / dof_damping_mut: f64 [nv, 1];
        /// Rotor inertia, `[nv]`.
        dof_armature / dof_armature_mut: f64 [nv, 1];
        /// Dry friction, `[nv]`.
        dof_frictionloss / dof_frictionloss_mut: f64 [nv, 1];
        /// Geom positions in their bodies, `[ngeom, 3]`, m.
        geom_pos / geom_pos_mut: f64 [ngeom, 3];
        /// Geom orientations in their bodies, `[ngeom, 4]`.
        geom_quat / geom_quat_mut: f64 [ngeom, 4];
        /// Geom sizes, `[ngeom, 3]`; their meaning depends on the shape. Contacts also use `geom_rbound` and the
        /// bounding boxes, which do not follow: recompile for geoms that touch.
        geom_size / geom_size_mut: f64 [ngeom, 3];
        /// Sliding, torsional and rolling friction, `[ngeom, 3]`.
        geom_friction / geom_friction_mut: f64 [ngeom, 3];
        /// Priorities of geoms, `[ngeom]`: that of the higher one decides about friction and softness of a contact.
        geom_priority / geom_priority_mut: i32 [ngeom, 1];
        /// Geom colors, `[ngeom, 4]`, 0..1; (.5, .5, .5, 1) means the material's.
        geom_rgba / geom_rgba_mut: f32 [ngeom, 4];
        /// Site positions in their bodies, `[nsite, 3]`, m.
        site_pos / site_pos_mut: f64 [nsite, 3];
        /// Site orientations in their bodies, `[nsite, 4]`.
        site_quat / site_quat_mut: f64 [nsite, 4];
        /// Camera positions in their bodies, `[ncam, 3]`, m.
        cam_pos / cam_pos_mut: f64 [ncam, 3];
        /// Camera orientations in their bodies, `[ncam, 4]`.
        cam_quat / cam_quat_mut: f64 [ncam, 4];
        /// Site sizes, `[nsite, 3]`.
        site_size / site_size_mut: f64 [nsite, 3];
        /// Groups of sites, `[nsite]`: those in 0 to 2 are drawn.
        site_group / site_group_mut: i32 [nsite, 1];
        /// Site colors, `[nsite, 4]`, 0..1.
        site_rgba / site_rgba_mut: f32 [nsite, 4];
        /// Material colors, `[nmat, 4]`, 0..1.
        mat_rgba / mat_rgba_mut: f32 [nmat, 4];
        /// Textures of materials by their role, `[nmat, 10]`; -1: none.
        mat_texid / mat_texid_mut: i32 [nmat, 10];
        /// Diffuse colors of lights, `[nlight, 3]`, 0..1.
        light_diffuse / light_diffuse_mut: f32 [nlight, 3];
        /// Gains of actuators, `[nu, 10]`.
        actuator_gainprm / actuator_gainprm_mut: f64 [nu, 10];
        /// Biases of actuators, `[nu, 10]`.
        actuator_biasprm / actuator_biasprm_mut: f64 [nu, 10];
        /// Gears of actuators, `[nu, 6]`: the first scales the force of a joint's motor.
        actuator_gear / actuator_gear_mut: f64 [nu, 6];
        /// Data of equality constraints, `[neq, 12]`; of a weld: anchor, relative position, relative quaternion, torque scale.
        eq_data / eq_data_mut: f64 [neq, 12];
        /// Control ranges, `[nu, 2]`.
        actuator_ctrlrange / actuator_ctrlrange_mut: f64 [nu, 2];
    }

    /// Numbers in `qpos`.
    pub fn nq(&self) -> usize {
        self.header().nq as usize
    }

    /// Degrees of freedom.
    pub fn nv(&self) -> usize {
        self.header().nv as usize
    }

    /// Controls.
    pub fn nu(&self) -> usize {
        self.header().nu as usize
    }

    /// Activations of actuators.
    pub fn na(&self) -> usize {
        self.header().na as usize
    }

    /// Joints.
    pub fn njnt(&self) -> usize {
        self.header().njnt as usize
    }

    /// Geoms.
    pub fn ngeom(&self) -> usize {
        self.header().ngeom as usize
    }

    /// Cameras.
    pub fn ncam(&self) -> usize {
        self.header().ncam as usize
    }

    /// Seconds per physics step.
    pub fn timestep_s(&self) -> f64 {
        self.header().opt.timestep
    }

    /// Whether it integrates by the Runge-Kutta method of fourth order.
    pub fn integrates_by_rk4(&self) -> bool {
        self.header().opt.integrator as mjtIntegrator == mjINT_RK4
    }

    /// The size of the model, m, in which distances of images are given.
    pub fn extent_m(&self) -> f64 {
        self.header().stat.extent
    }

    /// Sets [`Model::extent_m`].
    pub fn set_extent_m(&mut self, extent_m: f64) {
        // SAFETY: `raw` is valid, and `&mut self` is the only access.
        unsafe { self.raw.as_mut().stat.extent = extent_m };
    }

    /// Sets the acceleration of gravity, m/s².
    pub fn set_gravity(&mut self, gravity: [f64; 3]) {
        // SAFETY: `raw` is valid, and `&mut self` is the only access.
        unsafe { self.raw.as_mut().opt.gravity = gravity };
    }

    /// Gravity, m/s².
    pub fn gravity(&self) -> [f64; 3] {
        self.header().opt.gravity
    }

    /// The index of an object.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoObject`], with the nearest name that there is.
    pub fn id(&self, kind: Object, name: &str) -> Result<usize, MujocoError> {
        let found = CString::new(name).ok().and_then(|text| {
            // SAFETY: the model is valid and the text null-terminated.
            let id =
                unsafe { (self.library.api().mj_name2id)(self.as_ptr(), kind.code() as i32, text.as_ptr()) };
            usize::try_from(id).ok()
        });
        found.ok_or_else(|| MujocoError::NoObject {
            kind: kind.word(),
            name: name.to_owned(),
            nearest: nearest(name, self.names(kind).iter().map(String::as_str)),
        })
    }

    /// The names of all objects of a kind; unnamed ones are empty.
    pub fn names(&self, kind: Object) -> Vec<String> {
        let header = self.header();
        let count = match kind {
            Object::Body => header.nbody,
            Object::Joint => header.njnt,
            Object::Geom => header.ngeom,
            Object::Site => header.nsite,
            Object::Camera => header.ncam,
            Object::Light => header.nlight,
            Object::Texture => header.ntex,
            Object::Material => header.nmat,
            Object::Tendon => header.ntendon,
            Object::Actuator => header.nactuator,
            Object::Sensor => header.nsensor,
            Object::Mesh => header.nmesh,
            Object::Key => header.nkey,
        };
        let name = |id: i64| {
            // SAFETY: the model is valid; a name out of range or absent is null.
            let text =
                unsafe { (self.library.api().mj_id2name)(self.as_ptr(), kind.code() as i32, id as i32) };
            NonNull::new(text.cast_mut()).map(|text| {
                // SAFETY: a name is null-terminated and lives in the model.
                unsafe { std::ffi::CStr::from_ptr(text.as_ptr()) }.to_string_lossy().into_owned()
            })
        };
        (0..count).map(|id| name(id).unwrap_or_default()).collect()
    }

    /// Puts every geom that is a mesh where `other` has it: a mesh lies in its body by its own center and axes, so that
    /// one that was [shrunk](super::Spec::shrink_meshes) lies elsewhere.
    ///
    /// # Panics
    /// If the other has other objects, a mistake of the caller.
    pub fn copy_mesh_places(&mut self, other: &Model) {
        let meshes: Vec<usize> = (self.geom_types().iter().enumerate())
            .filter(|(_, kind)| **kind == mjGEOM_MESH as i32)
            .map(|(geom, _)| geom)
            .collect();
        let (into, from) = (self.header(), other.header());
        assert_eq!((into.ngeom, into.nv), (from.ngeom, from.nv), "models of the same objects");
        /// Copies `width` values of each mesh.
        ///
        /// # Safety
        /// Both arrays hold `width` values for each geom, and nothing else uses the first.
        unsafe fn copy<T: Copy>(into: *mut T, from: *const T, width: usize, count: i64, meshes: &[usize]) {
            // SAFETY: the caller's promise.
            let (into, from) = unsafe { (slice_mut(into, count, width), slice(from, count, width)) };
            for geom in meshes {
                let row = geom * width..(geom + 1) * width;
                into[row.clone()].copy_from_slice(&from[row]);
            }
        }
        // SAFETY: MuJoCo allocates these arrays by the number of geoms and degrees of freedom, which are equal, and
        // `&mut self` is the only access.
        unsafe {
            copy(into.geom_pos, from.geom_pos, 3, into.ngeom, &meshes);
            copy(into.geom_quat, from.geom_quat, 4, into.ngeom, &meshes);
            copy(into.geom_size, from.geom_size, 3, into.ngeom, &meshes);
            copy(into.geom_aabb, from.geom_aabb, 6, into.ngeom, &meshes);
            copy(into.geom_rbound, from.geom_rbound, 1, into.ngeom, &meshes);
            copy(into.geom_sameframe, from.geom_sameframe, 1, into.ngeom, &meshes);
            slice_mut(into.dof_length, into.nv, 1).copy_from_slice(slice(from.dof_length, from.nv, 1));
        }
    }

    /// Bytes of all names, and of all paths of files.
    pub fn text_bytes(&self) -> [usize; 2] {
        [self.header().nnames as usize, self.header().npaths as usize]
    }

    /// The model as MuJoCo writes it into a file: sizes, options and every array, one after the other.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Raised`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, MujocoError> {
        let mut bytes = vec![0u8; self.size_bytes()];
        // SAFETY: the model is valid, no file is named, and the buffer has the size that MuJoCo asks for.
        guarded(|| unsafe {
            let (buffer, size) = (bytes.as_mut_ptr().cast(), bytes.len() as i64);
            (self.library.api().mj_saveModel)(self.as_ptr(), std::ptr::null(), buffer, size);
        })?;
        Ok(bytes)
    }

    /// Gives a site another shape. Sites touch nothing, so that nothing else follows.
    pub fn set_site_shape(&mut self, site: usize, shape: Shape) {
        let header = self.header();
        // SAFETY: the array holds `nsite` values, `&mut self` is the only access; the slice checks the index.
        unsafe { slice_mut(header.site_type, header.nsite, 1)[site] = shape.code() as i32 };
    }

    /// Recomputes what follows from masses, armatures and positions (`mj_setConst`); call it after editing those.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Raised`]: MuJoCo finds the model impossible.
    pub fn set_constants(&mut self) -> Result<(), MujocoError> {
        let api = self.library.api();
        guarded(|| {
            // SAFETY: the model is valid and ours alone; the scratch data is made for it and freed here. An error on the
            // way leaks the scratch data, nothing else.
            unsafe {
                let scratch = (api.mj_makeData)(self.raw.as_ptr());
                if !scratch.is_null() {
                    (api.mj_setConst)(self.raw.as_ptr(), scratch);
                    (api.mj_deleteData)(scratch);
                }
            }
        })
    }

    /// Bytes that it occupies.
    pub fn size_bytes(&self) -> usize {
        // SAFETY: the model is valid.
        unsafe { (self.library.api().mj_sizeModel)(self.as_ptr()) as usize }
    }
}

impl Clone for Model {
    /// # Panics
    /// If memory runs out, as every allocation in Rust.
    fn clone(&self) -> Self {
        // SAFETY: the source is valid; a null destination asks for a new model, which nothing else owns.
        let raw = unsafe { (self.library.api().mj_copyModel)(std::ptr::null_mut(), self.as_ptr()) };
        let raw = NonNull::new(raw).expect("MuJoCo returns null only without memory");
        Self { library: self.library, raw }
    }
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Model({} bodies, {} degrees of freedom)", self.header().nbody, self.nv())
    }
}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: the model is ours and is not used again.
        unsafe { (self.library.api().mj_deleteModel)(self.raw.as_ptr()) };
    }
}

/// `rows × width` elements at `data`; an empty array may be null.
///
/// # Safety
/// That many initialized elements lie there, unchanged for `'a`.
pub(super) unsafe fn slice<'a, T>(data: *const T, rows: i64, width: usize) -> &'a [T] {
    let len = rows as usize * width;
    if len == 0 || data.is_null() {
        return &[];
    }
    // SAFETY: the caller's promise.
    unsafe { std::slice::from_raw_parts(data, len) }
}

/// As [`slice`], to be written.
///
/// # Safety
/// That many initialized elements lie there, and nothing else reads or writes them for `'a`.
pub(super) unsafe fn slice_mut<'a, T>(data: *mut T, rows: i64, width: usize) -> &'a mut [T] {
    let len = rows as usize * width;
    if len == 0 || data.is_null() {
        return &mut [];
    }
    // SAFETY: the caller's promise.
    unsafe { std::slice::from_raw_parts_mut(data, len) }
}
