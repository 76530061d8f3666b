//! Composing one description from several: attached models, added bodies, cameras and sites, and a lighter version for
//! physics alone.

use std::collections::BTreeSet;
use std::ffi::{CStr, CString};
use std::ptr::NonNull;

use super::bindings::*;
use super::guard::guarded;
use super::spec::Spec;
use super::{Object, Shape};
use crate::error::MujocoError;

impl Spec {
    /// Adds an empty body to the body `parent` (`world` is one), behind the bodies that are there.
    ///
    /// # Errors
    ///
    /// No such parent, a name that holds a null byte, or one that is taken.
    pub fn add_body(
        &mut self,
        parent: &str,
        name: &str,
        position: [f64; 3],
        quaternion: [f64; 4],
    ) -> Result<(), MujocoError> {
        let (parent, name) = (self.body_pointer(parent)?, self.c_name(name)?);
        // SAFETY: the parent belongs to this spec; null stands for no defaults. The new body lives in the spec, and
        // `&mut self` is the only access.
        let status = guarded(|| unsafe {
            let body = (self.api().mjs_addBody)(parent.as_ptr(), std::ptr::null());
            ((*body).pos, (*body).quat) = (position, quaternion);
            (self.api().mjs_setName)((*body).element, name.as_ptr())
        })?;
        self.accept(status == 0)
    }

    /// Attaches everything of another description to a body, each name behind `prefix`. The options of this one count.
    ///
    /// # Errors
    ///
    /// No such parent, a prefix that holds a null byte, or MuJoCo cannot attach it.
    pub fn attach(&mut self, parent: &str, child: Spec, prefix: &str) -> Result<(), MujocoError> {
        let (parent, prefix) = (self.body_pointer(parent)?, self.c_name(prefix)?);
        // SAFETY: both specs are valid, the frame belongs to this one, and the texts are null-terminated. The elements
        // stay the child's, which is kept as long as this spec.
        let attached = guarded(|| unsafe {
            let frame = (self.api().mjs_addFrame)(parent.as_ptr(), std::ptr::null_mut());
            let (element, none) = ((*frame).element, c"".as_ptr());
            (self.api().mjs_attach)(element, (*child.as_mut_ptr()).element, prefix.as_ptr(), none)
        })?;
        self.keep(child);
        self.accept(!attached.is_null())
    }

    /// Adds a camera to the world: its place, m, and its x and y axes.
    ///
    /// # Errors
    ///
    /// A name that holds a null byte, or one that is taken.
    pub fn add_camera(
        &mut self,
        name: &str,
        position: [f64; 3],
        xy_axes: [f64; 6],
    ) -> Result<(), MujocoError> {
        let (world, name) = (self.body_pointer("world")?, self.c_name(name)?);
        // SAFETY: as in `add_body`.
        let status = guarded(|| unsafe {
            let camera = (self.api().mjs_addCamera)(world.as_ptr(), std::ptr::null());
            (*camera).pos = position;
            ((*camera).alt.type_, (*camera).alt.xyaxes) = (mjORIENTATION_XYAXES, xy_axes);
            (self.api().mjs_setName)((*camera).element, name.as_ptr())
        })?;
        self.accept(status == 0)
    }

    /// Adds a box without mass and contacts to the world, from its lower to its upper corner, m.
    ///
    /// # Errors
    ///
    /// A name that holds a null byte, or one that is taken.
    pub fn add_box_site(
        &mut self,
        name: &str,
        [low, high]: [[f64; 3]; 2],
        rgba: [f32; 4],
        group: i32,
    ) -> Result<(), MujocoError> {
        /// A side of length 0 is no size.
        const THIN: f64 = 1e-7;
        let (world, name) = (self.body_pointer("world")?, self.c_name(name)?);
        // SAFETY: as in `add_body`.
        let status = guarded(|| unsafe {
            let site = (self.api().mjs_addSite)(world.as_ptr(), std::ptr::null());
            ((*site).type_, (*site).rgba, (*site).group) = (mjGEOM_BOX, rgba, group);
            (*site).pos = [0, 1, 2].map(|k| (low[k] + high[k]) / 2.0);
            (*site).size = [0, 1, 2].map(|k| (high[k] - low[k]) / 2.0 + THIN);
            (self.api().mjs_setName)((*site).element, name.as_ptr())
        })?;
        self.accept(status == 0)
    }

    /// Adds a geom to the body `parent` (`world` is one): shape, place and size, m, and material; for the rest the defaults of the
    /// file hold. What does not collide is only looked at.
    ///
    /// # Errors
    ///
    /// No such parent, a name that holds a null byte, or one that is taken. That there is no such material is found when
    /// compiling.
    pub fn add_geom(
        &mut self,
        parent: &str,
        name: &str,
        (shape, position, size): (Shape, [f64; 3], [f64; 3]),
        material: &str,
        collides: bool,
    ) -> Result<(), MujocoError> {
        let (parent, name, material) =
            (self.body_pointer(parent)?, self.c_name(name)?, self.c_name(material)?);
        // SAFETY: as in `add_body`; the defaults and the text of the material belong to this spec.
        let status = guarded(|| unsafe {
            let defaults = (self.api().mjs_getSpecDefault)(self.as_mut_ptr());
            let geom = (self.api().mjs_addGeom)(parent.as_ptr(), defaults);
            ((*geom).type_, (*geom).pos, (*geom).size) = (shape.code(), position, size);
            ((*geom).contype, (*geom).conaffinity) = (i32::from(collides), i32::from(collides));
            (self.api().mjs_setString)((*geom).material, material.as_ptr());
            (self.api().mjs_setName)((*geom).element, name.as_ptr())
        })?;
        self.accept(status == 0)
    }

    /// Lets a body of the world move freely, by a joint without limits and friction.
    ///
    /// # Errors
    ///
    /// No such body, a name that holds a null byte, or one that is taken.
    pub fn add_free_joint(&mut self, body: &str, name: &str) -> Result<(), MujocoError> {
        let (body, name) = (self.body_pointer(body)?, self.c_name(name)?);
        // SAFETY: as in `add_body`.
        let status = guarded(|| unsafe {
            let joint = (self.api().mjs_addFreeJoint)(body.as_ptr());
            (self.api().mjs_setName)((*joint).element, name.as_ptr())
        })?;
        self.accept(status == 0)
    }

    /// Adds a spotlight at `position` from a body, m, that follows the center of mass of the body and all below it, without turning.
    ///
    /// # Errors
    ///
    /// No such body, a name that holds a null byte, or one that is taken.
    pub fn add_following_light(
        &mut self,
        body: &str,
        name: &str,
        position: [f64; 3],
    ) -> Result<(), MujocoError> {
        let (body, name) = (self.body_pointer(body)?, self.c_name(name)?);
        // SAFETY: as in `add_body`; the defaults belong to this spec.
        let status = guarded(|| unsafe {
            let defaults = (self.api().mjs_getSpecDefault)(self.as_mut_ptr());
            let light = (self.api().mjs_addLight)(body.as_ptr(), defaults);
            ((*light).pos, (*light).mode) = (position, mjCAMLIGHT_TRACKCOM);
            (self.api().mjs_setName)((*light).element, name.as_ptr())
        })?;
        self.accept(status == 0)
    }

    /// Gives an object another name.
    ///
    /// # Errors
    ///
    /// No such object, or a name that holds a null byte or is taken.
    pub fn rename(&mut self, kind: Object, from: &str, to: &str) -> Result<(), MujocoError> {
        let (element, name) = (self.find(kind, from)?, self.c_name(to)?);
        // SAFETY: the element belongs to this spec, and the name is null-terminated.
        let status = guarded(|| unsafe { (self.api().mjs_setName)(element.as_ptr(), name.as_ptr()) })?;
        self.accept(status == 0)
    }

    /// Removes all objects of a kind.
    ///
    /// # Errors
    ///
    /// MuJoCo cannot remove one.
    pub fn delete_all(&mut self, kind: Object) -> Result<(), MujocoError> {
        for element in self.elements(kind) {
            self.delete_element(element)?;
        }
        Ok(())
    }

    /// Integrates by MuJoCo's `implicitfast`, with elliptic friction cones of this ratio of frictional to normal impedance.
    pub fn set_implicit_and_elliptic(&mut self, impedance_ratio: f64) {
        // SAFETY: the spec is valid, and `&mut self` is the only access.
        let option = unsafe { &mut (*self.as_mut_ptr()).option };
        option.integrator = mjINT_IMPLICITFAST as i32;
        option.cone = mjCONE_ELLIPTIC as i32;
        option.impratio = impedance_ratio;
    }

    /// What cameras and lights take for the middle and the size of the scene, m, and how near and far images reach, in
    /// sizes.
    pub fn set_extent(&mut self, center: [f64; 3], extent: f64, mean_size: f64, [near, far]: [f32; 2]) {
        // SAFETY: the spec is valid, and `&mut self` is the only access.
        let spec = unsafe { &mut *self.as_mut_ptr() };
        (spec.stat.center, spec.stat.extent, spec.stat.meansize) = (center, extent, mean_size);
        (spec.visual.map.znear, spec.visual.map.zfar) = (near, far);
    }

    /// Replaces every mesh that is only looked at by a tetrahedron, and the pixels of files by one: physics need none.
    ///
    /// A mesh is kept where a geom of it collides, or gives its body mass. The geoms of the others lie elsewhere
    /// afterwards: see [`super::Model::copy_mesh_places`].
    pub fn shrink_meshes(&mut self) {
        let kept = self.meshes_that_matter();
        let api = self.api();
        let mut vertices = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let faces = [[0i32, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        let (vertices, faces) = (vertices.as_flattened_mut(), faces.as_flattened());
        for element in self.elements(Object::Mesh) {
            // SAFETY: the element is a mesh of this spec, `&mut self` is the only access, and the arrays have the
            // lengths that are given with them.
            unsafe {
                if kept.contains(&self.text((api.mjs_getName)(element.as_ptr()))) {
                    continue;
                }
                let Some(mesh) = (api.mjs_asMesh)(element.as_ptr()).as_mut() else { continue };
                (api.mjs_setString)(mesh.file, c"".as_ptr());
                (api.mjs_setFloat)(mesh.uservert, vertices.as_ptr(), vertices.len() as i32);
                (api.mjs_setInt)(mesh.userface, faces.as_ptr(), faces.len() as i32);
            }
        }
        for element in self.elements(Object::Texture) {
            // SAFETY: the element is a texture of this spec, and `&mut self` is the only access.
            unsafe {
                let Some(texture) = (api.mjs_asTexture)(element.as_ptr()).as_mut() else { continue };
                if texture.builtin == mjBUILTIN_NONE {
                    (api.mjs_setString)(texture.file, c"".as_ptr());
                    texture.builtin = mjBUILTIN_FLAT;
                }
            }
        }
        self.shrink_textures();
    }

    /// The names of the meshes of which a geom collides or has mass that counts.
    fn meshes_that_matter(&mut self) -> BTreeSet<String> {
        let api = self.api();
        let mut names = BTreeSet::new();
        for element in self.elements(Object::Geom) {
            // SAFETY: the element is a geom of this spec, and its parent a body of it; both are only read.
            unsafe {
                let Some(geom) = (api.mjs_asGeom)(element.as_ptr()).as_ref() else { continue };
                let parent = (api.mjs_getParent)(element.as_ptr()).as_ref();
                let collides = geom.contype != 0 || geom.conaffinity != 0;
                let weighs = parent.is_none_or(|body| !body.explicitinertial);
                if geom.type_ == mjGEOM_MESH && (collides || weighs) {
                    names.insert(self.text(geom.meshname));
                }
            }
        }
        names
    }

    fn body_pointer(&mut self, name: &str) -> Result<NonNull<mjsBody>, MujocoError> {
        let element = self.find(Object::Body, name)?;
        // SAFETY: the element is a body of this spec.
        let body = unsafe { (self.api().mjs_asBody)(element.as_ptr()) };
        Ok(NonNull::new(body).expect("it was found as this type"))
    }

    fn c_name(&self, name: &str) -> Result<CString, MujocoError> {
        CString::new(name).map_err(|_| self.unusable(format!("`{name}` is no name")))
    }

    /// # Safety
    /// `text` is null, or a text of this spec.
    unsafe fn text(&self, text: *const mjString) -> String {
        if text.is_null() {
            return String::new();
        }
        // SAFETY: the caller's promise; the text is null-terminated and lives in the spec.
        unsafe { CStr::from_ptr((self.api().mjs_getString)(text)) }.to_string_lossy().into_owned()
    }
}
