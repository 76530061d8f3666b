//! What does not change during an episode: walls, bodies' masses, and the numbered parts they consist of.
//!
//! Constant properties are built once from a [`Setup`]; the moving quantities are in `bodies`, `broad_phase` and `memory`.

use super::collide::PlacedRectangle;
use super::math::{Aabb, Rotation, Vec2, vec2};
use super::shapes::{MAX_PARTS, Shape};
use std::fmt;

/// Duration of one substep, seconds.
pub const SUBSTEP_SECONDS: f64 = 0.01;
/// At most this many moving parts exist: three of the agent and three of the block.
pub(super) const MAX_LEAVES: usize = 2 * MAX_PARTS;
/// Number of walls.
pub(super) const WALLS: usize = 4;
/// Half the thickness of a wall, pixels.
pub const WALL_RADIUS: f64 = 2.0;
/// Largest allowed scale, pixels per unit. Up to here no part reaches two opposite walls at once, which bounds the
/// number of pairs in contact.
pub const MAX_SCALE: f32 = 120.0;

/// One of the two moving bodies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum BodyId {
    /// The body that the controller drives.
    Agent = 0,
    /// The body that is pushed.
    Block = 1,
}

/// How one body starts an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodySetup {
    /// Its shape; the block cannot be a disc.
    pub shape: Shape,
    /// Pixels per unit of the shape's coordinates, above 0 and at most [`MAX_SCALE`].
    pub scale: f32,
    /// Position of the origin of its coordinates, pixels.
    pub position: [f64; 2],
    /// Angle, radians; without effect on a disc.
    pub angle: f64,
}

/// What an episode is built from. The start poses only prime the order in which contacts are solved: place the bodies
/// afterwards, with [`Sim::place`](super::Sim::place).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setup {
    /// The agent.
    pub agent: BodySetup,
    /// The block.
    pub block: BodySetup,
    /// Fraction of a dynamic body's velocity that is left after one second; 0 stops it at every substep.
    pub damping: f64,
    /// Center of gravity of the block in its coordinates, pixels, instead of the shape's own.
    pub block_cog: Option<[f64; 2]>,
    /// Coefficient of friction of all contacts; the quasi-static engine has none and accepts only 0.
    pub friction: f64,
}

impl Default for Setup {
    /// The reference's default factors: a disc of scale 40 at (256, 400) and a T of scale 30 at (400, 100).
    fn default() -> Setup {
        Setup {
            agent: BodySetup { shape: Shape::Disc, scale: 40.0, position: [256.0, 400.0], angle: 0.0 },
            block: BodySetup { shape: Shape::T, scale: 30.0, position: [400.0, 100.0], angle: 0.0 },
            damping: 0.0,
            block_cog: None,
            friction: 0.0,
        }
    }
}

/// Why a world cannot be built or a state not be taken over.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PhysicsError {
    /// The scale of a body is not in (0, [`MAX_SCALE`]].
    Scale {
        /// Which body.
        body: BodyId,
        /// The offending value.
        scale: f32,
    },
    /// The block was asked to be a disc.
    DiscBlock,
    /// A number of the setup or placement is NaN or infinite.
    NotFinite {
        /// Which number.
        what: &'static str,
    },
    /// The damping is negative, NaN or infinite.
    Damping {
        /// The offending value.
        damping: f64,
    },
    /// The coefficient of friction is negative, NaN or infinite, or the engine has no friction.
    Friction {
        /// The offending value.
        friction: f64,
        /// What is allowed.
        allowed: &'static str,
    },
    /// The state is damaged, or belongs to bodies with another number of parts.
    ForeignState,
}

impl fmt::Display for PhysicsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            PhysicsError::Scale { body, scale } => {
                let body = if *body == BodyId::Agent { "agent" } else { "block" };
                write!(
                    f,
                    "{body} scale {scale} is out of range; give pixels per unit above 0, at most {MAX_SCALE}"
                )
            }
            PhysicsError::DiscBlock => {
                write!(f, "the block cannot be a disc; choose one of the polygon shapes (1 to 7)")
            }
            PhysicsError::NotFinite { what } => {
                write!(f, "{what} is not finite; give a number in pixels or radians")
            }
            PhysicsError::Damping { damping } => {
                write!(f, "damping {damping} is out of range; give a finite fraction per second, 0 or more")
            }
            PhysicsError::Friction { friction, allowed } => write!(f, "friction {friction}: {allowed}"),
            PhysicsError::ForeignState => {
                write!(
                    f,
                    "the physics state does not fit these bodies; restore it into a world of the same shapes"
                )
            }
        }
    }
}

impl std::error::Error for PhysicsError {}

/// A wall: a segment with a radius, which nothing moves.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Wall {
    /// First end, pixels.
    pub from: [f64; 2],
    /// Second end, pixels.
    pub to: [f64; 2],
}

/// The four walls by number: left, top, right, bottom. Each has the radius [`WALL_RADIUS`].
pub const WALL_SEGMENTS: [Wall; WALLS] = [
    Wall { from: [5.0, 506.0], to: [5.0, 5.0] },
    Wall { from: [5.0, 5.0], to: [506.0, 5.0] },
    Wall { from: [506.0, 5.0], to: [506.0, 506.0] },
    Wall { from: [5.0, 506.0], to: [506.0, 506.0] },
];

/// The reference normal of each wall: the right-hand perpendicular of its direction, which only orders its two ends.
pub(super) const WALL_NORMALS: [Vec2; WALLS] =
    [vec2(-1.0, 0.0), vec2(0.0, -1.0), vec2(1.0, 0.0), vec2(0.0, -1.0)];

/// The bounding box of each wall, radius included.
pub(super) const WALL_BOXES: [Aabb; WALLS] = [
    Aabb { min: vec2(3.0, 3.0), max: vec2(7.0, 508.0) },
    Aabb { min: vec2(3.0, 3.0), max: vec2(508.0, 7.0) },
    Aabb { min: vec2(504.0, 3.0), max: vec2(508.0, 508.0) },
    Aabb { min: vec2(3.0, 504.0), max: vec2(508.0, 508.0) },
];

/// A part in the coordinates of its body, relative to the center of gravity; a disc has half sizes of its radius.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Part {
    pub(super) center: Vec2,
    pub(super) half: Vec2,
}

/// A body's constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BodyProperties {
    pub(super) shape: Shape,
    pub(super) scale: f32,
    /// Center of gravity in body coordinates.
    pub(super) cog: Vec2,
    /// 1 / mass: 0 for a body that contacts cannot move.
    pub(super) inv_mass: f64,
    /// 1 / moment of inertia: 0 for a body that contacts cannot turn.
    pub(super) inv_inertia: f64,
}

impl BodyProperties {
    fn new(id: BodyId, setup: &BodySetup) -> Result<BodyProperties, PhysicsError> {
        let BodySetup { shape, scale, .. } = *setup;
        if !(scale > 0.0 && scale <= MAX_SCALE) {
            return Err(PhysicsError::Scale { body: id, scale });
        }
        let dynamic = shape != Shape::Disc;
        Ok(BodyProperties {
            shape,
            scale,
            cog: Vec2::from(shape.center_of_gravity(scale)),
            inv_mass: if dynamic { 1.0 } else { 0.0 },
            inv_inertia: if dynamic { 1.0 / shape.inertia(scale) } else { 0.0 },
        })
    }
}

/// Which of the moving parts ("leaves") belong to which body. Leaves are numbered from 0: the agent's, then the
/// block's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) agent_parts: usize,
    pub(super) leaves: usize,
    /// The agent is a disc: moved by the controller only, and not stopped by walls.
    pub(super) agent_is_disc: bool,
}

impl Layout {
    pub(super) fn body_of(self, leaf: usize) -> BodyId {
        if leaf < self.agent_parts { BodyId::Agent } else { BodyId::Block }
    }

    pub(super) fn meets_walls(self, leaf: usize) -> bool {
        leaf >= self.agent_parts || !self.agent_is_disc
    }

    pub(super) fn leaves_of(self, body: BodyId) -> std::ops::Range<usize> {
        match body {
            BodyId::Agent => 0..self.agent_parts,
            BodyId::Block => self.agent_parts..self.leaves,
        }
    }
}

/// Everything about an episode that stays as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct World {
    pub(super) layout: Layout,
    /// Agent and block, by [`BodyId`].
    pub(super) bodies: [BodyProperties; 2],
    /// The first [`Layout::leaves`] entries are in use.
    pub(super) parts: [Part; MAX_LEAVES],
    /// What each substep multiplies the velocities of dynamic bodies by.
    pub(super) velocity_kept: f64,
}

impl World {
    /// Builds the world without the override of the center of gravity, see [`World::move_block_cog`].
    pub(super) fn new(setup: &Setup) -> Result<World, PhysicsError> {
        if setup.block.shape == Shape::Disc {
            return Err(PhysicsError::DiscBlock);
        }
        if !(setup.damping >= 0.0 && setup.damping.is_finite()) {
            return Err(PhysicsError::Damping { damping: setup.damping });
        }
        if !(setup.friction >= 0.0 && setup.friction.is_finite()) {
            let allowed = "give a finite coefficient, 0 or more";
            return Err(PhysicsError::Friction { friction: setup.friction, allowed });
        }
        let finite = [
            ("the agent's start position", Vec2::from(setup.agent.position).is_finite()),
            ("the block's start position", Vec2::from(setup.block.position).is_finite()),
            ("the agent's angle", setup.agent.angle.is_finite()),
            ("the block's angle", setup.block.angle.is_finite()),
            ("the block's center of gravity", setup.block_cog.is_none_or(|cog| Vec2::from(cog).is_finite())),
        ];
        if let Some((what, _)) = finite.into_iter().find(|(_, finite)| !finite) {
            return Err(PhysicsError::NotFinite { what });
        }
        let agent = BodyProperties::new(BodyId::Agent, &setup.agent)?;
        let block = BodyProperties::new(BodyId::Block, &setup.block)?;

        let mut parts = [Part::default(); MAX_LEAVES];
        let mut leaves = 0;
        let mut agent_parts = 0;
        for (id, body) in [(BodyId::Agent, &agent), (BodyId::Block, &block)] {
            if body.shape == Shape::Disc {
                let radius = Shape::disc_radius(body.scale);
                parts[leaves] = Part { center: Vec2::ZERO, half: vec2(radius, radius) };
                leaves += 1;
            }
            for rectangle in body.shape.rectangles(body.scale) {
                parts[leaves] = Part { center: rectangle.center() - body.cog, half: rectangle.half_size() };
                leaves += 1;
            }
            if id == BodyId::Agent {
                agent_parts = leaves;
            }
        }
        let agent_is_disc = agent.shape == Shape::Disc;
        Ok(World {
            layout: Layout { agent_parts, leaves, agent_is_disc },
            bodies: [agent, block],
            parts,
            velocity_kept: setup.damping.powf(SUBSTEP_SECONDS),
        })
    }

    /// Puts the block's center of gravity elsewhere; its moment of inertia stays.
    pub(super) fn move_block_cog(&mut self, cog: Vec2) {
        let block = &mut self.bodies[BodyId::Block as usize];
        let shift = block.cog - cog;
        block.cog = cog;
        for leaf in self.layout.leaves_of(BodyId::Block) {
            self.parts[leaf].center = self.parts[leaf].center + shift;
        }
    }

    pub(super) fn body(&self, id: BodyId) -> &BodyProperties {
        &self.bodies[id as usize]
    }

    /// Center of a leaf in the world, from the pose of its body.
    pub(super) fn leaf_center(&self, leaf: usize, body_position: Vec2, rotation: Rotation) -> Vec2 {
        body_position + rotation.world_from_body(self.parts[leaf].center)
    }

    /// The corners `[4][2]` of a body's rectangles in the world, in hull order; none for a disc.
    pub(super) fn corners(
        &self,
        body: BodyId,
        center: Vec2,
        rotation: Rotation,
    ) -> impl Iterator<Item = [[f64; 2]; 4]> + '_ {
        let is_polygon = self.body(body).shape != Shape::Disc;
        self.layout.leaves_of(body).filter(move |_| is_polygon).map(move |leaf| {
            let center = self.leaf_center(leaf, center, rotation);
            let rectangle = PlacedRectangle { center, half: self.parts[leaf].half, rotation };
            [0, 1, 2, 3].map(|index| rectangle.vertex(index).to_array())
        })
    }

    /// Bounding box of a leaf around its center.
    pub(super) fn leaf_box(&self, leaf: usize, center: Vec2, rotation: Rotation) -> Aabb {
        let half = self.parts[leaf].half;
        if leaf < self.layout.agent_parts && self.layout.agent_is_disc {
            return Aabb::around(center, half);
        }
        let (cos, sin) = (rotation.cos.abs(), rotation.sin.abs());
        Aabb::around(center, vec2(cos * half.x + sin * half.y, sin * half.x + cos * half.y))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leaves_are_numbered_agent_first() {
        let world = World::new(&Setup::default()).unwrap();
        assert_eq!(world.layout, Layout { agent_parts: 1, leaves: 3, agent_is_disc: true });
        assert_eq!(world.layout.leaves_of(BodyId::Block), 1..3);
        assert_eq!(world.body(BodyId::Block).cog, vec2(0.0, 45.0));
        assert_eq!(1.0 / world.body(BodyId::Block).inv_inertia, 3000.0);
        assert_eq!(world.velocity_kept, 0.0);
    }

    #[test]
    fn bad_setups_are_errors_that_name_the_cause() {
        let with = |change: fn(&mut Setup)| {
            let mut setup = Setup::default();
            change(&mut setup);
            World::new(&setup).unwrap_err().to_string()
        };
        assert!(with(|s| s.agent.scale = 0.0).starts_with("agent scale 0 is out of range"));
        assert!(with(|s| s.block.scale = f32::NAN).starts_with("block scale NaN"));
        assert!(with(|s| s.block.shape = Shape::Disc).contains("cannot be a disc"));
        assert!(with(|s| s.damping = -1.0).starts_with("damping -1"));
        assert!(with(|s| s.block.angle = f64::INFINITY).starts_with("the block's angle is not finite"));
    }
}
