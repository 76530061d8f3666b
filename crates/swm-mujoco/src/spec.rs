//! A model as its description: parsed from MJCF, edited, compiled.

use std::ffi::{CStr, CString, c_char};
use std::marker::PhantomData;
use std::path::Path;
use std::ptr::NonNull;

use super::bindings::*;
use super::guard::guarded;
use super::{Library, Model, Object, Shape};
use crate::error::MujocoError;

/// A model description (`mjSpec`). All access is through `&mut`.
pub struct Spec {
    library: &'static Library,
    raw: NonNull<mjSpec>,
    name: String,
    /// Descriptions whose elements are attached to this one. Freed after it.
    attached: Vec<Spec>,
}

// SAFETY: it owns its memory, and MuJoCo keeps no thread-bound state in it.
unsafe impl Send for Spec {}
// SAFETY: `&Spec` gives access to nothing but the name, a `String`.
unsafe impl Sync for Spec {}

/// Elements of a description: a type with setters for plain values, and how to find it.
macro_rules! elements {
    ($($(#[$meta:meta])* $find:ident -> $type:ident($raw:ident via $cast:ident, $kind:ident) {
        $($(#[$field_meta:meta])* $set:ident: $field:ident, $value:ty;)*
    })*) => {
        $(
            $(#[$meta])*
            pub struct $type<'a> {
                raw: NonNull<$raw>,
                spec: PhantomData<&'a mut Spec>,
            }

            impl $type<'_> {
                $(
                    $(#[$field_meta])*
                    pub fn $set(&mut self, value: $value) -> &mut Self {
                        // SAFETY: the element belongs to the spec, which `'a` keeps alive and untouched.
                        unsafe { self.raw.as_mut().$field = value };
                        self
                    }
                )*
            }
        )*

        impl Spec {
            $(
                #[doc = concat!("The ", stringify!($find), " of this name.")]
                ///
                /// # Errors
                ///
                /// [`MujocoError::NoObject`], with the nearest name that there is.
                pub fn $find(&mut self, name: &str) -> Result<$type<'_>, MujocoError> {
                    let element = self.find(Object::$kind, name)?;
                    // SAFETY: the element belongs to this spec and has the type that the cast asks for.
                    let raw = unsafe { (self.library.api().$cast)(element.as_ptr()) };
                    let raw = NonNull::new(raw).expect("it was found as this type");
                    Ok($type { raw, spec: PhantomData })
                }
            )*
        }
    };
}

elements! {
    /// A body of a [`Spec`].
    body -> SpecBody(mjsBody via mjs_asBody, Body) {
        /// Position in the parent, m.
        set_position: pos, [f64; 3];
        /// Orientation in the parent, quaternion w x y z.
        set_quaternion: quat, [f64; 4];
    }
    /// A joint of a [`Spec`].
    joint -> SpecJoint(mjsJoint via mjs_asJoint, Joint) {
        /// Dry friction.
        set_dry_friction: frictionloss, f64;
        /// Rotor inertia.
        set_armature: armature, f64;
        /// Limits, in the unit of the file (degrees, unless it says otherwise) or m.
        set_range: range, [f64; 2];
    }
    /// A geom of a [`Spec`].
    geom -> SpecGeom(mjsGeom via mjs_asGeom, Geom) {
        /// Position in the body, m.
        set_position: pos, [f64; 3];
        /// Size; its meaning depends on the shape.
        set_size: size, [f64; 3];
        /// End points of a capsule or cylinder, x y z x y z, m.
        set_from_to: fromto, [f64; 6];
        /// Sliding, torsional and rolling friction.
        set_friction: friction, [f64; 3];
        /// Density, kg/m³; it counts where no mass is given.
        set_density: density, f64;
        /// Mass, kg; NaN: from the density.
        set_mass: mass, f64;
        /// Color, 0..1.
        set_rgba: rgba, [f32; 4];
        /// Drawn by default in groups 0 to 2.
        set_group: group, i32;
        /// Directions in which a contact acts: 1 without friction, 3 with sliding, 4 with torsional, 6 with rolling friction.
        set_contact_dimensions: condim, i32;
        /// Of two geoms that touch, that of the higher priority decides about friction and softness.
        set_priority: priority, i32;
    }
    /// A site of a [`Spec`].
    site -> SpecSite(mjsSite via mjs_asSite, Site) {
        /// Position in the body, m.
        set_position: pos, [f64; 3];
        /// Size; its meaning depends on the shape.
        set_size: size, [f64; 3];
        /// Color, 0..1.
        set_rgba: rgba, [f32; 4];
        /// Drawn by default in groups 0 to 2.
        set_group: group, i32;
    }
    /// A light of a [`Spec`].
    light -> SpecLight(mjsLight via mjs_asLight, Light) {
        /// Diffuse color, 0..1.
        set_diffuse: diffuse, [f32; 3];
    }
    /// A material of a [`Spec`].
    material -> SpecMaterial(mjsMaterial via mjs_asMaterial, Material) {
        /// Color, 0..1.
        set_rgba: rgba, [f32; 4];
        /// Whether a texture has the same size everywhere; if not, it is stretched over the geom.
        set_uniform_texture: texuniform, bool;
    }
    /// A texture of a [`Spec`].
    texture -> SpecTexture(mjsTexture via mjs_asTexture, Texture) {
        /// First color of a built-in pattern, 0..1.
        set_rgb1: rgb1, [f64; 3];
        /// Second color of a built-in pattern, 0..1.
        set_rgb2: rgb2, [f64; 3];
    }
}

impl SpecGeom<'_> {
    /// Another shape; set the size too.
    pub fn set_shape(&mut self, shape: Shape) -> &mut Self {
        // SAFETY: as in the setters above.
        unsafe { self.raw.as_mut().type_ = shape.code() };
        self
    }

    /// Direction of the own z axis in the body; it need not have length 1.
    pub fn set_z_axis(&mut self, axis: [f64; 3]) -> &mut Self {
        // SAFETY: as in the setters above.
        let alternative = unsafe { &mut self.raw.as_mut().alt };
        alternative.type_ = mjORIENTATION_ZAXIS;
        alternative.zaxis = axis;
        self
    }
}

impl SpecSite<'_> {
    /// Another shape; set the size too.
    pub fn set_shape(&mut self, shape: Shape) -> &mut Self {
        // SAFETY: as in the setters above.
        unsafe { self.raw.as_mut().type_ = shape.code() };
        self
    }
}

impl SpecJoint<'_> {
    /// Damping, without its terms of higher order.
    pub fn set_damping(&mut self, damping: f64) -> &mut Self {
        // SAFETY: as in the setters above.
        unsafe { self.raw.as_mut().damping[0] = damping };
        self
    }
}

impl Spec {
    /// Reads an MJCF file. Files that it includes are found beside it.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoAsset`]: there is no such file; [`MujocoError::Model`]: it is no MJCF; or
    /// MuJoCo cannot be loaded.
    pub fn read(path: &Path) -> Result<Self, MujocoError> {
        let library = Library::get()?;
        let name = path.display().to_string();
        if !path.is_file() {
            return Err(MujocoError::NoAsset { path: path.to_owned() });
        }
        let unusable = |reason: String| MujocoError::Model { model: name.clone(), reason };
        let file = path.to_str().and_then(|path| CString::new(path).ok());
        let file = file.ok_or_else(|| unusable("its path is not valid UTF-8".to_owned()))?;
        let mut message: [c_char; 1000] = [0; 1000];
        // SAFETY: both texts are null-terminated or buffers of the given size; no virtual file system is given.
        let raw = guarded(|| unsafe {
            let (buffer, size) = (message.as_mut_ptr(), message.len() as i32);
            (library.api().mj_parseXML)(file.as_ptr(), std::ptr::null(), buffer, size)
        })?;
        let raw = NonNull::new(raw).ok_or_else(|| unusable(text_of(&message)))?;
        Ok(Self { library, raw, name, attached: Vec::new() })
    }

    /// Compiles the model as the description now stands. It may be edited and compiled again.
    ///
    /// # Errors
    ///
    /// [`MujocoError::Model`], with what MuJoCo says.
    pub fn compile(&mut self) -> Result<Model, MujocoError> {
        let api = self.library.api();
        // SAFETY: the spec is valid; no virtual file system is given.
        let model = guarded(|| unsafe { (api.mj_compile)(self.raw.as_ptr(), std::ptr::null()) })?;
        match NonNull::new(model) {
            // SAFETY: MuJoCo has just allocated it for us.
            Some(model) => Ok(unsafe { Model::from_raw(self.library, model) }),
            None => Err(self.unusable(self.last_error())),
        }
    }

    /// Removes an object and what belongs to it: with a body all that it holds, and what refers to that.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoObject`], or MuJoCo cannot remove it.
    pub fn delete(&mut self, kind: Object, name: &str) -> Result<(), MujocoError> {
        let element = self.find(kind, name)?;
        self.delete_element(element)
    }

    /// Removes all rangefinder sensors.
    ///
    /// # Errors
    ///
    /// MuJoCo cannot remove one.
    pub fn delete_rangefinders(&mut self) -> Result<(), MujocoError> {
        let api = self.library.api();
        let is_rangefinder = |element: NonNull<mjsElement>| {
            // SAFETY: the element is a sensor of this spec.
            let sensor = unsafe { (api.mjs_asSensor)(element.as_ptr()) };
            // SAFETY: a null pointer gives `None`; else it is a sensor that the spec owns.
            unsafe { sensor.as_ref() }.is_some_and(|sensor| sensor.type_ == mjSENS_RANGEFINDER)
        };
        for element in self.elements(Object::Sensor) {
            if is_rangefinder(element) {
                self.delete_element(element)?;
            }
        }
        Ok(())
    }

    /// Makes every built-in texture as small as it can be: physics need none. Their order and their materials stay.
    pub fn shrink_textures(&mut self) {
        for element in self.elements(Object::Texture) {
            // SAFETY: the element is a texture of this spec.
            let texture = unsafe { (self.library.api().mjs_asTexture)(element.as_ptr()) };
            // SAFETY: a null pointer gives `None`; else it is a texture that the spec owns, and `&mut self` is the only
            // access.
            if let Some(texture) = unsafe { texture.as_mut() }
                && texture.builtin != mjBUILTIN_NONE
            {
                (texture.width, texture.height) = (1, 1);
            }
        }
    }

    pub(super) fn delete_element(&mut self, element: NonNull<mjsElement>) -> Result<(), MujocoError> {
        let api = self.library.api();
        // SAFETY: the element belongs to this spec, and no reference to it is kept.
        let status = guarded(|| unsafe { (api.mjs_delete)(self.raw.as_ptr(), element.as_ptr()) })?;
        self.accept(status == 0)
    }

    /// What MuJoCo said of the last call that failed.
    fn last_error(&self) -> String {
        // SAFETY: the spec is valid; the text is null-terminated and lives in it.
        let reason = unsafe { CStr::from_ptr((self.api().mjs_getError)(self.raw.as_ptr())) };
        reason.to_string_lossy().into_owned()
    }

    /// An error with MuJoCo's reason, unless the call succeeded.
    pub(super) fn accept(&self, succeeded: bool) -> Result<(), MujocoError> {
        if succeeded { Ok(()) } else { Err(self.unusable(self.last_error())) }
    }

    pub(super) fn unusable(&self, reason: String) -> MujocoError {
        MujocoError::Model { model: self.name.clone(), reason }
    }

    pub(super) fn api(&self) -> &'static Api {
        self.library.api()
    }

    pub(super) fn as_mut_ptr(&self) -> *mut mjSpec {
        self.raw.as_ptr()
    }

    /// Keeps a description whose elements belong to this one from now on.
    pub(super) fn keep(&mut self, attached: Spec) {
        self.attached.push(attached);
    }

    pub(super) fn find(&mut self, kind: Object, name: &str) -> Result<NonNull<mjsElement>, MujocoError> {
        let found = CString::new(name).ok().and_then(|text| {
            // SAFETY: the spec is valid and the text null-terminated.
            NonNull::new(unsafe {
                (self.library.api().mjs_findElement)(self.raw.as_ptr(), kind.code(), text.as_ptr())
            })
        });
        found.ok_or_else(|| MujocoError::NoObject { kind: kind.word(), name: name.to_owned(), nearest: None })
    }

    pub(super) fn elements(&mut self, kind: Object) -> Vec<NonNull<mjsElement>> {
        let api = self.library.api();
        let mut elements = Vec::new();
        // SAFETY: the spec is valid.
        let mut next = unsafe { (api.mjs_firstElement)(self.raw.as_ptr(), kind.code()) };
        while let Some(element) = NonNull::new(next) {
            elements.push(element);
            // SAFETY: the element belongs to the spec.
            next = unsafe { (api.mjs_nextElement)(self.raw.as_ptr(), element.as_ptr()) };
        }
        elements
    }
}

impl Drop for Spec {
    fn drop(&mut self) {
        // SAFETY: the spec is ours and is not used again.
        unsafe { (self.library.api().mj_deleteSpec)(self.raw.as_ptr()) };
    }
}

fn text_of(buffer: &[c_char]) -> String {
    let bytes = buffer.iter().take_while(|&&c| c != 0).map(|&c| c as u8);
    String::from_utf8_lossy(&bytes.collect::<Vec<_>>()).into_owned()
}
