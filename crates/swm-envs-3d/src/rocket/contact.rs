//! Contact with pad and floor: parry3d tells what is near, rapier3d steps what touches.
//!
//! Rapier's world is rebuilt at each touching step and remembers nothing, so that the state of the simulation is that of
//! [`State`]; see [`flight`](super::flight) for steps that do not touch.

use nalgebra::Vector3;
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query;
use parry3d_f64::shape::SharedShape;
use rapier3d_f64::prelude as rapier;
use rapier3d_f64::prelude::{
    BroadPhaseBvh, ColliderBuilder, ColliderSet, IntegrationParameters, IslandManager, NarrowPhase,
    PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, RigidBodySet,
};

use super::aerodynamics::Load;
use super::body::{MassProperties, PARTS, Part, RADIUS, Solid};
use super::flight::{Conditions, GRAVITY, PHYSICS_STEP_S};
use super::state::State;
use crate::attitude::{sin_cos, unit, world_from_body};
use crate::shapes::{cylinder, pose};

/// The pad: radius, half its length, height of its center.
pub(super) const PAD: [f64; 3] = [2.0, 0.05, 0.1];
/// Half the side of the floor, whose top is at height 0.
pub(super) const FLOOR_HALF: f64 = 100.0;
const FLOOR_DEPTH: f64 = 10.0;
/// Nearer surfaces touch: the margins of two of PyBullet's shapes.
const TOUCHING: f64 = 0.002;
/// Coefficients of friction, which multiply.
const FRICTION: f64 = 0.5;
const FLOOR_FRICTION: f64 = 1.0;

/// What the rocket touches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Touch {
    pub(super) pad: bool,
    pub(super) floor: bool,
}

impl Touch {
    /// Whether it touches anything.
    pub(super) fn any(self) -> bool {
        self.pad || self.floor
    }

    /// What either touches.
    pub(super) fn or(self, other: Self) -> Self {
        Self { pad: self.pad || other.pad, floor: self.floor || other.floor }
    }
}

/// Shapes, and memory to step in. Its use leaves no trace: what it computes depends on the arguments alone.
pub(super) struct Stage {
    parts: Vec<(SharedShape, Pose)>,
    pad: (SharedShape, Pose),
    floor: (SharedShape, Pose),
    bodies: RigidBodySet,
    colliders: ColliderSet,
    rocket: RigidBodyHandle,
    world: Box<PhysicsWorld>,
}

fn shape(part: &Part) -> (SharedShape, Pose) {
    match part.solid {
        Solid::Cylinder { radius, half } => cylinder(radius, half, part.place),
        Solid::Box { half: [x, y, z] } => {
            let (sin, cos) = sin_cos(0.5 * part.turn_rad);
            let rotation = Rotation::from_xyzw(0.0, 0.0, sin, cos);
            (SharedShape::cuboid(x, y, z), Pose::from_parts(Vector::from(part.place), rotation))
        }
    }
}

impl Stage {
    pub(super) fn new() -> Self {
        let parts: Vec<_> = PARTS.iter().map(shape).collect();
        let [radius, half, height] = PAD;
        let pad = cylinder(radius, half, [0.0, 0.0, height]);
        let half = FLOOR_DEPTH / 2.0;
        let floor = SharedShape::cuboid(FLOOR_HALF, FLOOR_HALF, half);
        let floor = (floor, pose([0.0, 0.0, -half], crate::attitude::UPRIGHT));
        let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
        let collider = |(shape, pose): &(SharedShape, Pose), friction: f64| {
            let collider = ColliderBuilder::new(shape.clone()).position(*pose).density(0.0);
            collider.friction(friction).friction_combine_rule(rapier::CoefficientCombineRule::Multiply)
        };
        colliders.insert(collider(&pad, FRICTION));
        colliders.insert(collider(&floor, FLOOR_FRICTION));
        let rocket =
            bodies.insert(RigidBodyBuilder::dynamic().can_sleep(false).gyroscopic_forces_enabled(true));
        for part in &parts {
            colliders.insert_with_parent(collider(part, FRICTION), rocket, &mut bodies);
        }
        let mut world = Box::new(PhysicsWorld::new());
        world.gravity = Vector::new(0.0, 0.0, -GRAVITY);
        world.integration_parameters = IntegrationParameters {
            dt: PHYSICS_STEP_S,
            num_solver_iterations: 1,
            ..IntegrationParameters::default()
        };
        Self { parts, pad, floor, bodies, colliders, rocket, world }
    }

    /// What is nearer than two millimeters.
    pub(super) fn touch(&self, state: &State) -> Touch {
        let [.., z] = state.position;
        let [_, half, height] = PAD;
        if z - RADIUS > height + half + TOUCHING {
            return Touch::default();
        }
        let body = pose(state.position, state.attitude);
        let touches = |(other, place): &(SharedShape, Pose)| {
            self.parts.iter().any(|(part, offset)| {
                // Shapes of these kinds always have a distance.
                let distance = query::distance(&(body * *offset), &**part, place, &**other);
                distance.is_ok_and(|found| found.distance < TOUCHING)
            })
        };
        Touch { pad: touches(&self.pad), floor: touches(&self.floor) }
    }

    /// One physics step of a body that touches something.
    pub(super) fn step(&mut self, conditions: &Conditions, state: &mut State, load: &Load) {
        let world_from = world_from_body(state.attitude);
        let properties = MassProperties::new(conditions.dry_mass, state.fuel);
        let (center, to_vector) = (properties.center(), |v: Vector3<f64>| Vector::new(v.x, v.y, v.z));
        let spin = Vector3::from(state.spin);
        let velocity = Vector3::from(state.velocity) + spin.cross(&(world_from * center));
        let torque = world_from * (load.torque - center.cross(&load.force));
        let Self { world, .. } = self;
        world.bodies.clone_from(&self.bodies);
        world.colliders.clone_from(&self.colliders);
        world.islands = IslandManager::new();
        world.broad_phase = BroadPhaseBvh::new();
        world.narrow_phase = NarrowPhase::new();
        let body = &mut world.bodies[self.rocket];
        let [ix, iy, iz] = properties.inertia;
        let mass = rapier::MassProperties::new(to_vector(center), properties.mass, Vector::new(ix, iy, iz));
        body.set_position(pose(state.position, state.attitude), true);
        body.set_additional_mass_properties(mass, true);
        body.recompute_mass_properties_from_colliders(&world.colliders);
        body.set_linvel(to_vector(velocity), true);
        body.set_angvel(Vector::from(state.spin), true);
        body.add_force(to_vector(world_from * load.force), true);
        body.add_torque(to_vector(torque), true);
        world.step();
        let body = &world.bodies[self.rocket];
        let (position, rotation) = (body.position().translation, body.position().rotation);
        state.lagging_attitude = state.attitude;
        state.attitude = unit([rotation.x, rotation.y, rotation.z, rotation.w]);
        state.position = position.to_array();
        state.spin = body.angvel().to_array();
        let of_center = Vector3::from(body.linvel().to_array());
        let arm = world_from_body(state.attitude) * center;
        state.velocity = (of_center - Vector3::from(state.spin).cross(&arm)).into();
    }
}
