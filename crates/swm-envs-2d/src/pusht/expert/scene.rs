//! What a planner needs to know of an episode and what does not change in it: figures, goal, limits.

use super::obstacle::{Figure, Obstacle, Room};
use super::outline::Outline;
use super::primitive::Spot;
use super::route::Routes;
use super::settings::ExpertSettings;
use super::steering::{ActionKind, Command, REACH_PX, Steering};
use crate::pusht::engine::Engine;
use crate::pusht::env::LoadedState;
use crate::pusht::goal::{PushTState, angle_error, is_success, observed_state};
use crate::pusht::physics::{BodyId, PhysicsError, Rotation, Shape, Vec2};

/// An episode, to be planned in.
pub(super) struct Scene {
    pub(super) steering: Steering,
    pub(super) agent: Figure,
    pub(super) block: Figure,
    pub(super) outline: Outline,
    pub(super) goal: PushTState,
    pub(super) limits: Limits,
    block_shape: Shape,
    /// How far the block should be from each wall, pixels; `None` if the agent walks through walls.
    wall_room: Option<[f64; 4]>,
    /// Cost of an angle error, px/rad.
    angle_weight: f64,
    /// Cost of a control step, pixels.
    pub(super) step_weight: f64,
}

/// How long the phases of a primitive may take, and how near things have to come. They depend on how fast the agent
/// is: a disc goes 26 px in its first control step, a polygon 10.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Control steps of an approach.
    pub(super) approach: u32,
    /// Control steps of a push.
    pub(super) push: u32,
    /// A push ends after so many control steps without improvement.
    pub(super) patience: u32,
    /// Control steps of the way to the agent's own goal.
    pub(super) finish: u32,
    /// Distance from the block at which a push begins, pixels.
    pub(super) standoff_px: f64,
    /// Weakest push, up to 1.
    pub(super) weakest: f64,
}

/// The finish is tried when the block is this near its goal.
const FINISH_PX: f64 = 20.0;
const FINISH_RAD: f64 = 0.349;

/// Room behind the block that an agent needs, in units of its scale, and the cost of each pixel less.
const WALL_ROOM: f64 = 2.0;
const WALL_WEIGHT: f64 = 1.0;

/// Steps in which a free standoff is looked for, pixels.
const OUTWARD_PX: f64 = 10.0;

/// The scale at which [`ExpertSettings::angle_weight`] is meant.
const USUAL_SCALE: f64 = 30.0;
/// The first step of the agent for which [`ExpertSettings::step_weight`] is meant: a disc's. A polygon's way and its
/// push are both shorter in a step, so its steps count less by the square of that.
const USUAL_STEP_PX: f64 = 26.0;

impl Scene {
    pub(super) fn new<E: Engine>(
        settings: &ExpertSettings,
        (kind, frame_skip): (ActionKind, u32),
        loaded: &LoadedState<E>,
    ) -> Result<Scene, PhysicsError> {
        let setup = &loaded.setup;
        let steering = Steering::new::<E>(kind, frame_skip, settings.max_step, setup)?;
        let rectangles: Vec<_> = setup.block.shape.rectangles(setup.block.scale).collect();
        let slow = setup.agent.shape != Shape::Disc;
        let fastest_px = if slow { steering.step_px() } else { REACH_PX };
        let slowdown = (fastest_px / settings.max_step).max(1.0);
        let steps = |count: u32| (f64::from(count) * slowdown).ceil() as u32;
        let limits = Limits {
            approach: steps(if slow { 60 } else { 25 }),
            push: steps(if slow { 45 } else { 12 }),
            patience: steps(if slow { 14 } else { 5 }),
            finish: steps(if slow { 60 } else { 30 }),
            standoff_px: if slow { 4.0 } else { 18.0 },
            weakest: if slow { 0.7 } else { 0.15 },
        };
        let block = Figure::new(setup, BodyId::Block);
        let [_, _, x, y, angle, ..] = loaded.goal;
        let behind = WALL_ROOM * f64::from(setup.agent.scale);
        let at_goal = block.wall_room(Vec2::from([x, y]), Rotation::new(angle));
        Ok(Scene {
            steering,
            agent: Figure::new(setup, BodyId::Agent),
            block,
            wall_room: (slow || E::WALLS_STOP_DISCS).then(|| at_goal.map(|room| room.clamp(0.0, behind))),
            outline: Outline::new(&rectangles),
            goal: loaded.goal,
            limits,
            block_shape: setup.block.shape,
            angle_weight: settings.angle_weight * f64::from(setup.block.scale) / USUAL_SCALE,
            step_weight: settings.step_weight
                * (steering.step_px().min(settings.max_step) / USUAL_STEP_PX).powi(2),
        })
    }

    pub(super) fn is_success(&self, sim: &impl Engine) -> bool {
        is_success(self.block_shape, &self.goal, &observed_state(sim))
    }

    /// How far the block is from its goal, pixels.
    pub(super) fn block_cost(&self, sim: &impl Engine) -> f64 {
        let (position, angle) = self.block_errors(sim);
        position + self.angle_weight * angle + self.wall_cost(sim)
    }

    /// What makes the block hard to get away from walls: it is nearer to one than at its goal, and an agent that walls
    /// stop has no room behind it.
    fn wall_cost(&self, sim: &impl Engine) -> f64 {
        let Some(wanted) = &self.wall_room else { return 0.0 };
        let origin = Vec2::from(sim.position(BodyId::Block));
        let room = self.block.wall_room(origin, Rotation::new(sim.angle(BodyId::Block)));
        WALL_WEIGHT * room.iter().zip(wanted).map(|(room, wanted)| (wanted - room).max(0.0)).sum::<f64>()
    }

    /// Whether the block may already stand well enough.
    pub(super) fn is_nearly_placed(&self, sim: &impl Engine) -> bool {
        let (position, angle) = self.block_errors(sim);
        position < FINISH_PX && angle < FINISH_RAD
    }

    fn block_errors(&self, sim: &impl Engine) -> (f64, f64) {
        let goal = Vec2::from([self.goal[2], self.goal[3]]);
        let position = (Vec2::from(sim.position(BodyId::Block)) - goal).norm();
        (position, angle_error(self.block_shape, self.goal[4], sim.angle(BodyId::Block)))
    }

    /// Where the agent has to be in the end.
    pub(super) fn agent_goal(&self) -> Vec2 {
        Vec2::from([self.goal[0], self.goal[1]])
    }

    /// The ways of the agent from where it is.
    pub(super) fn routes(&self, sim: &impl Engine) -> Routes {
        let room = self.wall_room.map(|_| Room::new(&self.agent, Rotation::new(sim.angle(BodyId::Agent))));
        let obstacle = Obstacle::new(&self.agent, &self.block, sim);
        Routes::new(obstacle, room, sim.position(BodyId::Agent).into())
    }

    /// Where the agent's origin is when it touches the block at a spot, and the outward normal there.
    fn touch(&self, sim: &impl Engine, spot: Spot) -> (Vec2, Vec2) {
        let [agent, block] = [BodyId::Agent, BodyId::Block].map(|body| Rotation::new(sim.angle(body)));
        let (point, normal) = self.outline.at(spot.arc_px);
        let point = Vec2::from(sim.position(BodyId::Block)) + block.world_from_body(point);
        let normal = block.world_from_body(normal);
        (point - self.agent.contact(agent, -normal, spot.side), normal)
    }

    /// The command that keeps the agent at its spot and pushes in a direction that turns with the block.
    pub(super) fn push_at(&self, sim: &impl Engine, spot: Spot, turn_rad: f64, strength: f64) -> Command {
        let (place, normal) = self.touch(sim, spot);
        let slip = place - Vec2::from(sim.position(BodyId::Agent));
        let across = slip - normal * slip.dot(normal);
        let direction = Rotation::new(turn_rad).world_from_body(-normal);
        Steering::push(direction + across * (1.0 / self.steering.step_px()), strength)
    }

    /// A place of the agent's origin from which it can begin to push at a spot, and the outward normal there; `None`
    /// if there is no room.
    pub(super) fn standoff(&self, sim: &impl Engine, routes: &Routes, spot: Spot) -> Option<(Vec2, Vec2)> {
        let (touching, normal) = self.touch(sim, spot);
        let near = touching + normal * self.limits.standoff_px;
        let clearance = |place| routes.obstacle().clearance(place);
        // Where another part of the block is in the way, further out.
        let mut places = (0..8).map(|k| near + normal * (OUTWARD_PX * f64::from(k)));
        let place = places.find(|&place| clearance(place) >= 0.0);
        let mut place = place.unwrap_or_else(|| routes.obstacle().outside(near));
        if let Some(room) = routes.room() {
            place = room.clamp(place);
        }
        (clearance(place) >= 0.0).then_some((place, normal))
    }
}
