//! The moving state of the two bodies, and where their parts are in the world.
//!
//! Knows nothing of contacts.

use super::math::{Aabb, Rotation, Vec2};
use super::world::{BodyId, BodyProperties, MAX_LEAVES, SUBSTEP_SECONDS, World};
use serde::{Deserialize, Serialize};

/// State of one body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Body {
    /// World position of the center of gravity.
    pub(super) center: Vec2,
    /// Angle, radians, not wrapped.
    pub(super) angle: f64,
    /// Velocity of the center of gravity, px/s, and angular velocity, rad/s.
    pub(super) motion: Motion,
    /// What pushes overlapping bodies apart: like `motion`, but forgotten after one substep.
    pub(super) bias: Motion,
}

/// A linear and an angular velocity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Motion {
    pub(super) linear: Vec2,
    pub(super) angular: f64,
}

impl Body {
    /// Moves the body by one substep and forgets the bias.
    pub(super) fn integrate(&mut self) {
        self.center = self.center + (self.motion.linear + self.bias.linear) * SUBSTEP_SECONDS;
        self.angle += (self.motion.angular + self.bias.angular) * SUBSTEP_SECONDS;
        self.bias = Motion::default();
    }

    /// World position of the origin of the body's coordinates.
    pub(super) fn origin(&self, properties: &BodyProperties, rotation: Rotation) -> Vec2 {
        self.center - rotation.world_from_body(properties.cog)
    }

    /// Puts the origin of the body's coordinates somewhere, at the present angle.
    pub(super) fn set_origin(&mut self, properties: &BodyProperties, origin: Vec2) {
        self.center = origin + Rotation::new(self.angle).world_from_body(properties.cog);
    }
}

/// Where everything is: rotations of the bodies, and centers and bounding boxes of the leaves. Derived from the
/// bodies, and recomputed only for a body that moved.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    poses: [(Vec2, f64); 2],
    pub(super) rotations: [Rotation; 2],
    pub(super) centers: [Vec2; MAX_LEAVES],
    pub(super) boxes: [Aabb; MAX_LEAVES],
}

impl Placed {
    pub(super) fn new(world: &World, bodies: &[Body; 2]) -> Placed {
        let mut placed = Placed {
            poses: bodies.map(|body| (body.center, body.angle)),
            rotations: bodies.map(|body| Rotation::new(body.angle)),
            centers: [Vec2::ZERO; MAX_LEAVES],
            boxes: [Aabb::default(); MAX_LEAVES],
        };
        placed.place_leaves(world, BodyId::Agent);
        placed.place_leaves(world, BodyId::Block);
        placed
    }

    /// Follows a body to its present pose.
    pub(super) fn follow(&mut self, world: &World, id: BodyId, body: &Body) {
        let (center, angle) = self.poses[id as usize];
        if body.angle != angle {
            self.rotations[id as usize] = Rotation::new(body.angle);
        } else if body.center == center {
            return;
        }
        self.poses[id as usize] = (body.center, body.angle);
        self.place_leaves(world, id);
    }

    fn place_leaves(&mut self, world: &World, id: BodyId) {
        let rotation = self.rotations[id as usize];
        let (body_position, _) = self.poses[id as usize];
        for leaf in world.layout.leaves_of(id) {
            let center = world.leaf_center(leaf, body_position, rotation);
            self.centers[leaf] = center;
            self.boxes[leaf] = world.leaf_box(leaf, center, rotation);
        }
    }
}
