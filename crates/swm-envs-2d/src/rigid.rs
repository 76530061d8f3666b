//! Rigid bodies on rapier2d, in worlds whose future depends on poses and velocities alone.
//!
//! Rapier keeps more than that between steps: contacts with the impulses to warm-start from, islands, a tree of boxes,
//! and the order in which all of it came about. A saved world would have to hold it to the bit. So a [`Stage`] forgets:
//! [`Stage::begin`] puts the bodies of a [`Blueprint`] at given [`Motion`]s as if the world had just been built, and
//! what happens between two calls of it is a function of them. States are then a few values, exact by construction,
//! and a stage is scratch memory that any copy may do without. Not here: what bodies mean, controllers, images.

use rapier2d_f64::na::{ComplexField, RealField};
use rapier2d_f64::prelude::*;
use serde::{Deserialize, Serialize};

/// The motion of one body: all that the future depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Motion {
    /// World position of the center of gravity.
    pub(crate) center: [f64; 2],
    /// Angle, radians, not wrapped.
    pub(crate) angle_rad: f64,
    /// Velocity of the center of gravity, length per second.
    pub(crate) velocity: [f64; 2],
    /// Angular velocity, rad/s.
    pub(crate) spin_rad_per_s: f64,
}

/// What stays the same in an episode: shapes, masses, parameters.
#[derive(Clone, Debug)]
pub(crate) struct Blueprint {
    parameters: IntegrationParameters,
    bodies: RigidBodySet,
    colliders: ColliderSet,
    moving: Vec<RigidBodyHandle>,
}

impl Blueprint {
    /// An empty world. `length_unit` is the size of a typical body, in the caller's unit; tolerances follow
    /// it, and so does the way per substep up to which contacts are foreseen.
    pub(crate) fn new(substep_s: f64, length_unit: f64) -> Blueprint {
        let parameters =
            IntegrationParameters { dt: substep_s, length_unit, ..IntegrationParameters::default() };
        Blueprint {
            parameters,
            bodies: RigidBodySet::new(),
            colliders: ColliderSet::new(),
            moving: Vec::new(),
        }
    }

    /// Adds something that nothing moves.
    pub(crate) fn add_fixed(&mut self, collider: ColliderBuilder) {
        self.colliders.insert(collider);
    }

    /// Adds a body with its center of gravity at the origin of its coordinates; it gets the next index. `inertia` is
    /// its moment of inertia; `None`: it does not turn.
    pub(crate) fn add_moving(
        &mut self,
        mass: f64,
        inertia: Option<f64>,
        parts: impl IntoIterator<Item = ColliderBuilder>,
    ) {
        let properties = MassProperties::new(Vector::ZERO, mass, inertia.unwrap_or_default());
        let mut body = RigidBodyBuilder::dynamic()
            .can_sleep(false)
            .soft_ccd_prediction(self.parameters.length_unit)
            .additional_mass_properties(properties);
        if inertia.is_none() {
            body = body.lock_rotations();
        }
        let handle = self.bodies.insert(body);
        for part in parts {
            self.colliders.insert_with_parent(part.density(0.0), handle, &mut self.bodies);
        }
        self.moving.push(handle);
    }
}

/// By the sine of the `libm` crate, which has the same bits on every machine.
fn rotation(angle_rad: f64) -> Rotation {
    let (sin, cos) = ComplexField::sin_cos(angle_rad);
    Rotation::from_cos_sin_unchecked(cos, sin)
}

/// One point where two bodies touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Touch {
    /// The point on the first body, in the world.
    pub(crate) on_first: [f64; 2],
    /// The point on the second body, in the world.
    pub(crate) on_second: [f64; 2],
    /// Unit vector from the first body to the second.
    pub(crate) normal: [f64; 2],
}

/// A world to step in: scratch memory.
pub(crate) struct Stage {
    world: PhysicsWorld,
    angles_rad: Vec<f64>,
}

impl Stage {
    /// Room for worlds of this blueprint. Call [`Stage::begin`] next.
    pub(crate) fn new(blueprint: &Blueprint) -> Stage {
        let mut world = PhysicsWorld::new();
        world.gravity = Vector::ZERO;
        world.integration_parameters = blueprint.parameters;
        Stage { world, angles_rad: Vec::with_capacity(blueprint.moving.len()) }
    }

    /// Forgets everything and puts the bodies where they are to be, one motion per moving body.
    pub(crate) fn begin(&mut self, blueprint: &Blueprint, motions: &[Motion]) {
        let Stage { world, angles_rad } = self;
        world.bodies.clone_from(&blueprint.bodies);
        world.colliders.clone_from(&blueprint.colliders);
        world.islands = IslandManager::new();
        world.broad_phase = BroadPhaseBvh::new();
        world.narrow_phase = NarrowPhase::new();
        angles_rad.clear();
        for (&handle, motion) in blueprint.moving.iter().zip(motions) {
            let rotation = rotation(motion.angle_rad);
            let body = &mut world.bodies[handle];
            body.set_position(Pose::from_parts(Vector::from(motion.center), rotation), false);
            body.set_linvel(Vector::from(motion.velocity), false);
            body.set_angvel(motion.spin_rad_per_s, false);
            angles_rad.push(motion.angle_rad);
        }
    }

    /// Gives a body another velocity.
    pub(crate) fn set_velocity(&mut self, blueprint: &Blueprint, index: usize, motion: &Motion) {
        let body = &mut self.world.bodies[blueprint.moving[index]];
        body.set_linvel(Vector::from(motion.velocity), false);
        body.set_angvel(motion.spin_rad_per_s, false);
    }

    /// Moves the world by one substep.
    pub(crate) fn step(&mut self, blueprint: &Blueprint, motions: &mut [Motion]) {
        let Stage { world, angles_rad } = self;
        world.step();
        for ((&handle, motion), angle) in blueprint.moving.iter().zip(motions).zip(angles_rad) {
            let body = &world.bodies[handle];
            // The turn since the last substep, so that the angle is not wrapped.
            let turn = rotation(*angle).inverse() * body.position().rotation;
            *angle += RealField::atan2(turn.im, turn.re);
            *motion = Motion {
                center: body.position().translation.to_array(),
                angle_rad: *angle,
                velocity: body.linvel().to_array(),
                spin_rad_per_s: body.angvel(),
            };
        }
    }

    /// Finds what touches at the present poses, without moving anything.
    pub(crate) fn detect(&mut self) {
        self.world.detect_collisions(&(), &());
    }

    /// The points where bodies touch, as last found: before the last substep moved them, or where they are now, after
    /// [`Stage::detect`].
    pub(crate) fn touches(&self) -> impl Iterator<Item = Touch> + '_ {
        let touching = self.world.integration_parameters.allowed_linear_error();
        self.world.narrow_phase.contact_pairs().flat_map(move |pair| {
            let poses =
                [pair.collider1, pair.collider2].map(|handle| *self.world.colliders[handle].position());
            pair.manifolds().iter().flat_map(move |manifold| {
                let points = manifold.points.iter().filter(move |point| point.dist <= touching);
                points.map(move |point| Touch {
                    on_first: poses[0].transform_point(point.local_p1).to_array(),
                    on_second: poses[1].transform_point(point.local_p2).to_array(),
                    normal: manifold.data.normal.to_array(),
                })
            })
        })
    }
}
