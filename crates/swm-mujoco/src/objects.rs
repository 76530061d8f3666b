//! Kinds of named objects, and shapes. Plain names for MuJoCo's numbers.

use super::bindings as mj;

/// A kind of named object in a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Object {
    /// A rigid body.
    Body,
    /// A joint.
    Joint,
    /// A geometric shape with mass and contacts.
    Geom,
    /// A marked place.
    Site,
    /// A camera.
    Camera,
    /// A light.
    Light,
    /// A texture.
    Texture,
    /// A material.
    Material,
    /// A tendon.
    Tendon,
    /// An actuator.
    Actuator,
    /// A sensor.
    Sensor,
    /// A mesh.
    Mesh,
    /// A stored state, a key frame.
    Key,
}

impl Object {
    pub(super) fn code(self) -> mj::mjtObj {
        match self {
            Object::Body => mj::mjOBJ_BODY,
            Object::Joint => mj::mjOBJ_JOINT,
            Object::Geom => mj::mjOBJ_GEOM,
            Object::Site => mj::mjOBJ_SITE,
            Object::Camera => mj::mjOBJ_CAMERA,
            Object::Light => mj::mjOBJ_LIGHT,
            Object::Texture => mj::mjOBJ_TEXTURE,
            Object::Material => mj::mjOBJ_MATERIAL,
            Object::Tendon => mj::mjOBJ_TENDON,
            Object::Actuator => mj::mjOBJ_ACTUATOR,
            Object::Sensor => mj::mjOBJ_SENSOR,
            Object::Mesh => mj::mjOBJ_MESH,
            Object::Key => mj::mjOBJ_KEY,
        }
    }

    /// The word for messages.
    pub fn word(self) -> &'static str {
        match self {
            Object::Body => "body",
            Object::Joint => "joint",
            Object::Geom => "geom",
            Object::Site => "site",
            Object::Camera => "camera",
            Object::Light => "light",
            Object::Texture => "texture",
            Object::Material => "material",
            Object::Tendon => "tendon",
            Object::Actuator => "actuator",
            Object::Sensor => "sensor",
            Object::Mesh => "mesh",
            Object::Key => "key frame",
        }
    }
}

/// Shapes that geoms and sites may be given: those without data of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Size: radius.
    Sphere,
    /// Size: radius, half length.
    Capsule,
    /// Size: three radii.
    Ellipsoid,
    /// Size: radius, half length.
    Cylinder,
    /// Size: three half lengths.
    Box,
}

impl Shape {
    pub(super) fn code(self) -> mj::mjtGeom {
        match self {
            Shape::Sphere => mj::mjGEOM_SPHERE,
            Shape::Capsule => mj::mjGEOM_CAPSULE,
            Shape::Ellipsoid => mj::mjGEOM_ELLIPSOID,
            Shape::Cylinder => mj::mjGEOM_CYLINDER,
            Shape::Box => mj::mjGEOM_BOX,
        }
    }
}

/// What a joint lets move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Everything: 7 values in `qpos`, 6 in `qvel`.
    Free,
    /// Rotation: a quaternion in `qpos`, 3 values in `qvel`.
    Ball,
    /// Translation along an axis.
    Slide,
    /// Rotation about an axis.
    Hinge,
}

impl JointKind {
    pub(super) fn of(code: i32) -> Self {
        match code as mj::mjtJoint {
            mj::mjJNT_FREE => JointKind::Free,
            mj::mjJNT_BALL => JointKind::Ball,
            mj::mjJNT_SLIDE => JointKind::Slide,
            _ => JointKind::Hinge,
        }
    }
}
