//! How object and pusher move. rapier3d steps what may touch; an object at rest stays while the pusher is away, which moves by the
//! same rule of its motor.
//!
//! Rapier's world is rebuilt at each of its steps and remembers nothing, so that the state of the simulation is that of
//! [`State`] (`docs/design/0008-rapier-worlds-forget.md`).

use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::shape::SharedShape;
use rapier3d_f64::prelude as rapier;
use rapier3d_f64::prelude::{
    BroadPhaseBvh, CoefficientCombineRule, ColliderBuilder, ColliderSet, IntegrationParameters,
    IslandManager, NarrowPhase, PhysicsWorld, RigidBodyBuilder, RigidBodyHandle, RigidBodySet,
};
use swm_fov::Fov;

use super::body::{Object, Solid};
use super::state::State;
use crate::attitude::{UPRIGHT, unit};
use crate::shapes::{cylinder, pose};

/// Duration of a physics step, s, and their number in a step of the agent.
const PHYSICS_STEP_S: f64 = 0.02;
const PHYSICS_STEPS: usize = 2;
/// Duration of a step, s.
pub(super) const STEP_S: f64 = PHYSICS_STEP_S * PHYSICS_STEPS as f64;
/// Half the side and half the thickness of the table, m.
pub(super) const TABLE_HALF: f64 = 0.5;
pub(super) const TABLE_DEPTH: f64 = 0.025;
/// The pusher's middle stays within this of the table's along x and y, m, as far as its motor can hold it.
const WORKSPACE_HALF: f64 = 0.48;
/// Half the length of the pusher, height of its middle, m; mass, kg.
pub(super) const PUSHER_HALF: f64 = 0.05;
pub(super) const PUSHER_HEIGHT: f64 = 0.06;
const PUSHER_MASS: f64 = 0.5;
const PUSHER_FRICTION: f64 = 0.3;
/// Time in which the motor would reach the wanted velocity if its force were unlimited, s.
const RESPONSE_S: f64 = 0.05;
/// Farther from each other, object and pusher do not touch in a physics step, m.
const APART: f64 = 0.02;
/// An object on the table that is slower than this, away from the pusher, comes to rest: m/s and rad/s.
const REST_SPEED: f64 = 5e-3;
const REST_SPIN: f64 = 5e-2;
/// Below this height, m, an object has fallen off the table.
const FALLEN: f64 = -0.05;

/// What of an assignment matters for moving.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Conditions {
    pub(super) object: Object,
    friction: f64,
    restitution: f64,
    table_friction: f64,
    gravity: f64,
    pub(super) radius: f64,
    pub(super) speed: f64,
    force: f64,
}

impl Conditions {
    /// The conditions of an assignment.
    pub(super) fn new(fov: &Fov) -> Self {
        Self {
            object: Object::new(fov),
            friction: fov.f64("object.friction"),
            restitution: fov.f64("object.restitution"),
            table_friction: fov.f64("table.friction"),
            gravity: fov.f64("world.gravity"),
            radius: fov.f64("pusher.radius"),
            speed: fov.f64("pusher.speed"),
            force: fov.f64("pusher.force"),
        }
    }

    /// Whether the pusher is so far from the object that they do not touch in a physics step.
    fn are_apart(&self, state: &State) -> bool {
        let [x, y] = [0, 1].map(|axis| state.pusher[axis] - state.position[axis]);
        let reach = self.object.reach() + self.radius + APART;
        x * x + y * y > reach * reach
    }

    /// The motor's force towards a velocity, N.
    fn motor(&self, state: &State, wanted: [f64; 2]) -> [f64; 2] {
        let force: [f64; 2] = std::array::from_fn(|axis| {
            let (place, speed) = (state.pusher[axis], wanted[axis]);
            let leaves = place.abs() >= WORKSPACE_HALF && place * speed > 0.0;
            let wanted = if leaves { 0.0 } else { speed };
            PUSHER_MASS * (wanted - state.pusher_velocity[axis]) / RESPONSE_S
        });
        let strength = (force[0] * force[0] + force[1] * force[1]).sqrt();
        if strength > self.force { force.map(|part| part * (self.force / strength)) } else { force }
    }
}

/// Whether the object has fallen off the table.
pub(super) fn has_fallen(state: &State) -> bool {
    state.position[2] < FALLEN
}

/// Bodies and memory to step in. Its use leaves no trace: what it computes depends on conditions and state alone.
pub(super) struct Stage {
    conditions: Conditions,
    bodies: RigidBodySet,
    colliders: ColliderSet,
    object: RigidBodyHandle,
    pusher: RigidBodyHandle,
    world: Box<PhysicsWorld>,
}

fn shape(solid: Solid) -> (SharedShape, Pose) {
    match solid {
        Solid::Box([x, y, z]) => (SharedShape::cuboid(x, y, z), pose([0.0; 3], UPRIGHT)),
        Solid::Cylinder(radius, half) => cylinder(radius, half, [0.0; 3]),
    }
}

impl Stage {
    pub(super) fn new(conditions: Conditions) -> Self {
        let (mut bodies, mut colliders) = (RigidBodySet::new(), ColliderSet::new());
        // Restitution is the product of two bodies': the table does not bounce, the pusher does as the object says.
        let collider = |(shape, pose): (SharedShape, Pose), friction: f64, restitution: f64| {
            let collider = ColliderBuilder::new(shape).position(pose).density(0.0).friction(friction);
            collider
                .friction_combine_rule(CoefficientCombineRule::Average)
                .restitution(restitution)
                .restitution_combine_rule(CoefficientCombineRule::Multiply)
        };
        let table = SharedShape::cuboid(TABLE_HALF, TABLE_HALF, TABLE_DEPTH);
        colliders.insert(collider(
            (table, pose([0.0, 0.0, -TABLE_DEPTH], UPRIGHT)),
            conditions.table_friction,
            0.0,
        ));
        let Object { mass, .. } = conditions.object;
        let [ix, iy, iz] = conditions.object.inertia();
        let properties = rapier::MassProperties::new(Vector::ZERO, mass, Vector::new(ix, iy, iz));
        let object = RigidBodyBuilder::dynamic().can_sleep(false).additional_mass_properties(properties);
        let object = bodies.insert(object);
        for solid in conditions.object.solids() {
            let solid = collider(shape(solid), conditions.friction, conditions.restitution);
            colliders.insert_with_parent(solid, object, &mut bodies);
        }
        let pusher = RigidBodyBuilder::dynamic()
            .can_sleep(false)
            .lock_rotations()
            .enabled_translations(true, true, false)
            .gravity_scale(0.0)
            .additional_mass(PUSHER_MASS);
        let pusher = bodies.insert(pusher);
        let tool = cylinder(conditions.radius, PUSHER_HALF, [0.0; 3]);
        colliders.insert_with_parent(collider(tool, PUSHER_FRICTION, 1.0), pusher, &mut bodies);
        let mut world = Box::new(PhysicsWorld::new());
        world.gravity = Vector::new(0.0, 0.0, -conditions.gravity);
        world.integration_parameters =
            IntegrationParameters { dt: PHYSICS_STEP_S, ..IntegrationParameters::default() };
        Self { conditions, bodies, colliders, object, pusher, world }
    }

    /// One step of the agent: the pusher's motor strives for a velocity.
    pub(super) fn step(&mut self, state: &mut State, wanted: [f64; 2]) {
        for _ in 0..PHYSICS_STEPS {
            let force = self.conditions.motor(state, wanted);
            let is_at_rest = state.velocity == [0.0; 3] && state.spin == [0.0; 3];
            if is_at_rest && self.conditions.are_apart(state) {
                for (axis, part) in force.iter().enumerate() {
                    state.pusher_velocity[axis] += part / PUSHER_MASS * PHYSICS_STEP_S;
                    state.pusher[axis] += state.pusher_velocity[axis] * PHYSICS_STEP_S;
                }
                continue;
            }
            self.touch(state, force);
            let length = |v: [f64; 3]| v.iter().map(|part| part * part).sum::<f64>().sqrt();
            let is_slow = length(state.velocity) < REST_SPEED && length(state.spin) < REST_SPIN;
            let is_on_table = state.object().iter().all(|c| c.abs() < TABLE_HALF) && state.position[2] > 0.0;
            if is_slow && is_on_table && self.conditions.are_apart(state) {
                (state.velocity, state.spin) = ([0.0; 3], [0.0; 3]);
            }
        }
    }

    /// One physics step of bodies that may touch.
    fn touch(&mut self, state: &mut State, force: [f64; 2]) {
        let Self { world, .. } = self;
        world.bodies.clone_from(&self.bodies);
        world.colliders.clone_from(&self.colliders);
        world.islands = IslandManager::new();
        world.broad_phase = BroadPhaseBvh::new();
        world.narrow_phase = NarrowPhase::new();
        let object = &mut world.bodies[self.object];
        object.set_position(pose(state.position, state.attitude), true);
        object.set_linvel(Vector::from(state.velocity), true);
        object.set_angvel(Vector::from(state.spin), true);
        let ([x, y], [vx, vy], [fx, fy]) = (state.pusher, state.pusher_velocity, force);
        let pusher = &mut world.bodies[self.pusher];
        pusher.set_position(pose([x, y, PUSHER_HEIGHT], UPRIGHT), true);
        pusher.set_linvel(Vector::new(vx, vy, 0.0), true);
        pusher.add_force(Vector::new(fx, fy, 0.0), true);
        for (_, body) in world.bodies.iter_mut() {
            body.recompute_mass_properties_from_colliders(&world.colliders);
        }
        world.step();
        let object = &world.bodies[self.object];
        let (position, rotation) = (object.position().translation, object.position().rotation);
        state.position = position.to_array();
        state.attitude = unit([rotation.x, rotation.y, rotation.z, rotation.w]);
        (state.velocity, state.spin) = (object.linvel().to_array(), object.angvel().to_array());
        let pusher = &world.bodies[self.pusher];
        let [x, y, _] = pusher.position().translation.to_array();
        let [vx, vy, _] = pusher.linvel().to_array();
        (state.pusher, state.pusher_velocity) = ([x, y], [vx, vy]);
    }
}
