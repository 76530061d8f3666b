//! PushT's bodies on rapier2d: the same shapes, masses, walls and controller as [`Sim`](super::Sim), with contacts that
//! have friction and are solved to convergence.
//!
//! Like there, dynamic bodies are stopped at every substep unless `damping` leaves them something, so that the block
//! moves only while it is pushed. Other than there, a disc is a body among others: heavy, but stopped by walls and by a
//! block that walls hold.

use std::sync::Arc;

use rapier2d_f64::prelude::{ColliderBuilder, SharedShape, Vector};
use serde::{Deserialize, Serialize};

use super::controller::{self, ActionMode, ActionScalar};
use super::math::{Rotation, Vec2};
use super::placement::Placement;
use super::shapes::Shape;
use super::sim::{Contact, SUBSTEPS};
use super::world::{BodyId, PhysicsError, SUBSTEP_SECONDS, Setup, WALL_RADIUS, WALL_SEGMENTS, World};
use crate::pusht::engine::Engine;
use crate::rigid::{Blueprint, Motion, Stage};

/// Mass of a disc; the block has mass 1. Much heavier ones the solver lets sink into a block that a wall holds: 24 px at
/// mass 30, 5 px at 10.
const DISC_MASS: f64 = 10.0;
/// Rapier's tolerances for lengths follow this one, pixels: penetration up to 0.1 px is left alone.
const LENGTH_UNIT_PX: f64 = 20.0;

/// A PushT world on rapier2d.
pub struct RapierSim {
    constants: Arc<Constants>,
    state: RapierState,
    /// Scratch, made when first needed.
    stage: Option<Box<Stage>>,
}

/// What stays as it is.
#[derive(Debug)]
struct Constants {
    world: World,
    blueprint: Blueprint,
}

/// All that changes during an episode: the motions of agent and block, by [`BodyId`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RapierState {
    bodies: [Motion; 2],
}

impl Clone for RapierSim {
    fn clone(&self) -> RapierSim {
        RapierSim { constants: Arc::clone(&self.constants), state: self.state, stage: None }
    }
}

impl std::fmt::Debug for RapierSim {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RapierSim").field("constants", &self.constants).field("state", &self.state).finish()
    }
}

impl Constants {
    fn new(world: World, friction: f64) -> Constants {
        let mut blueprint = Blueprint::new(SUBSTEP_SECONDS, LENGTH_UNIT_PX);
        for (wall, inward) in WALL_SEGMENTS.iter().zip([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]]) {
            let face = Vec2::from(wall.from) + Vec2::from(inward) * WALL_RADIUS;
            let half_space = ColliderBuilder::new(SharedShape::halfspace(Vector::from(inward)));
            blueprint.add_fixed(half_space.translation(Vector::from(face.to_array())).friction(friction));
        }
        for id in [BodyId::Agent, BodyId::Block] {
            let body = world.body(id);
            let is_disc = body.shape == Shape::Disc;
            let parts = world.layout.leaves_of(id).map(|leaf| {
                let part = &world.parts[leaf];
                let shape = match is_disc {
                    true => SharedShape::ball(part.half.x),
                    false => SharedShape::cuboid(part.half.x, part.half.y),
                };
                let collider = ColliderBuilder::new(shape);
                collider.translation(Vector::from(part.center.to_array())).friction(friction)
            });
            match is_disc {
                true => blueprint.add_moving(DISC_MASS, None, parts),
                false => blueprint.add_moving(1.0 / body.inv_mass, Some(1.0 / body.inv_inertia), parts),
            }
        }
        Constants { world, blueprint }
    }
}

impl RapierSim {
    /// Steps the world; before each substep the agent gets a velocity from `drive`, which knows position and velocity
    /// of its origin. Returns the number of contact points.
    fn advance(&mut self, substeps: u32, drive: impl Fn(Vec2, Vec2) -> Vec2) -> u32 {
        let RapierSim { constants, state, stage } = self;
        let Constants { world, blueprint } = &**constants;
        let stage = stage.get_or_insert_with(|| Box::new(Stage::new(blueprint)));
        stage.begin(blueprint, &state.bodies);
        let mut points = 0;
        for _ in 0..substeps {
            for id in [BodyId::Agent, BodyId::Block] {
                let motion = &mut state.bodies[id as usize];
                let mut velocity = Vec2::from(motion.velocity);
                if world.body(id).inv_mass > 0.0 {
                    velocity = velocity * world.velocity_kept;
                    motion.spin_rad_per_s *= world.velocity_kept;
                }
                if id == BodyId::Agent {
                    velocity = drive(origin(world, id, motion), velocity);
                }
                motion.velocity = velocity.to_array();
                stage.set_velocity(blueprint, id as usize, motion);
            }
            stage.step(blueprint, &mut state.bodies);
            points += stage.touches().count() as u32;
        }
        points
    }

    fn motion(&self, body: BodyId) -> &Motion {
        &self.state.bodies[body as usize]
    }
}

/// Position of the origin of a body's coordinates.
fn origin(world: &World, id: BodyId, motion: &Motion) -> Vec2 {
    Vec2::from(motion.center) - Rotation::new(motion.angle_rad).world_from_body(world.body(id).cog)
}

impl Engine for RapierSim {
    type State = RapierState;

    const PUSHT: &'static str = "swm/PushTRapier-v0";
    const FRICTION: f64 = 0.5;
    const WALLS_STOP_DISCS: bool = true;

    fn new(setup: &Setup) -> Result<Self, PhysicsError> {
        let mut world = World::new(setup)?;
        if let Some(cog) = setup.block_cog {
            world.move_block_cog(Vec2::from(cog));
        }
        let constants = Arc::new(Constants::new(world, setup.friction));
        let mut sim = RapierSim { constants, state: RapierState::default(), stage: None };
        let ([x, y], [bx, by]) = (setup.agent.position, setup.block.position);
        let placement = Placement::from([x, y, bx, by, setup.block.angle]);
        sim.place(&Placement { agent_angle: Some(setup.agent.angle), ..placement })?;
        Ok(sim)
    }

    /// Keeps nothing of the pose before but the agent's angle.
    fn place(&mut self, placement: &Placement) -> Result<(), PhysicsError> {
        placement.check()?;
        let world = &self.constants.world;
        let agent_angle = match world.layout.agent_is_disc {
            true => 0.0,
            false => placement.agent_angle.unwrap_or(self.state.bodies[BodyId::Agent as usize].angle_rad),
        };
        let at = |id, origin: [f64; 2], angle_rad: f64, velocity| {
            let center = Vec2::from(origin) + Rotation::new(angle_rad).world_from_body(world.body(id).cog);
            Motion { center: center.to_array(), angle_rad, velocity, spin_rad_per_s: 0.0 }
        };
        self.state.bodies = [
            at(BodyId::Agent, placement.agent, agent_angle, placement.agent_velocity),
            at(BodyId::Block, placement.block, placement.block_angle, [0.0; 2]),
        ];
        Ok(())
    }

    fn place_exactly(&mut self, placement: &Placement) -> Result<(), PhysicsError> {
        self.place(placement)
    }

    fn settle(&mut self) -> u32 {
        self.contacts().count() as u32
    }

    fn substep(&mut self) -> u32 {
        self.advance(1, |_, velocity| velocity)
    }

    fn control_step<T: ActionScalar>(&mut self, action: [T; 2], mode: ActionMode) -> u32 {
        let target = controller::target(action, mode, Vec2::from(self.position(BodyId::Agent)));
        self.advance(SUBSTEPS, |position, velocity| controller::velocity(target, position, velocity))
    }

    fn state(&self) -> &RapierState {
        &self.state
    }

    fn restore(&mut self, state: &RapierState) -> Result<(), PhysicsError> {
        let values = |motion: &Motion| {
            let Motion { center: [x, y], angle_rad, velocity: [vx, vy], spin_rad_per_s } = *motion;
            [x, y, angle_rad, vx, vy, spin_rad_per_s]
        };
        if !state.bodies.iter().flat_map(values).all(f64::is_finite) {
            return Err(PhysicsError::ForeignState);
        }
        self.state = *state;
        Ok(())
    }

    fn position(&self, body: BodyId) -> [f64; 2] {
        origin(&self.constants.world, body, self.motion(body)).to_array()
    }

    fn center_of_gravity(&self, body: BodyId) -> [f64; 2] {
        self.motion(body).center
    }

    fn angle(&self, body: BodyId) -> f64 {
        self.motion(body).angle_rad
    }

    fn velocity(&self, body: BodyId) -> [f64; 2] {
        self.motion(body).velocity
    }

    fn shape(&self, body: BodyId) -> Shape {
        self.constants.world.body(body).shape
    }

    fn scale(&self, body: BodyId) -> f32 {
        self.constants.world.body(body).scale
    }

    fn corners(&self, body: BodyId) -> impl Iterator<Item = [[f64; 2]; 4]> + '_ {
        let rotation = Rotation::new(self.angle(body));
        self.constants.world.corners(body, self.motion(body).center.into(), rotation)
    }

    fn contacts(&self) -> impl Iterator<Item = Contact> + '_ {
        let mut stage = Stage::new(&self.constants.blueprint);
        stage.begin(&self.constants.blueprint, &self.state.bodies);
        stage.detect();
        let contacts: Vec<Contact> = stage
            .touches()
            .map(|touch| Contact {
                on_first: touch.on_first,
                on_second: touch.on_second,
                normal: touch.normal,
            })
            .collect();
        contacts.into_iter()
    }
}
