//! The simulation: two bodies, four walls, and the substep that moves them.
//!
//! The order of work in a substep is part of the dynamics. Positions follow the velocities that the previous substep's
//! contacts left; then contacts are found, dynamic bodies are stopped, and the contacts give them new velocities.

use super::bodies::{Body, Motion, Placed};
use super::broad_phase::{BroadPhase, Test, Tests};
use super::collide::{
    Manifold, PlacedRectangle, collide_disc_rectangle, collide_rectangle_rectangle, collide_wall_rectangle,
};
use super::controller::{self, ActionMode, ActionScalar};
use super::math::{Rotation, Vec2};
use super::memory::{MAX_TOUCHING, Memory, Pair, Touch};
use super::placement::Placement;
use super::shapes::Shape;
use super::solver::{BodyPair, Contacts};
use super::world::{BodyId, PhysicsError, Setup, WALL_BOXES, World};
use serde::{Deserialize, Serialize};

/// Substeps per control step.
pub const SUBSTEPS: u32 = 10;

/// A PushT world in motion: plain data of about 2 KB, without pointers. A copy continues exactly as the original does.
#[derive(Clone, Debug, PartialEq)]
pub struct Sim {
    world: World,
    state: State,
}

/// All that changes during an episode. Restored into a world of the same setup, it continues exactly.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct State {
    /// Agent and block, by [`BodyId`].
    bodies: [Body; 2],
    broad_phase: BroadPhase,
    memory: Memory,
}

/// One contact of the last substep.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Contact {
    /// The point on the first shape, pixels.
    pub on_first: [f64; 2],
    /// The point on the second shape, pixels.
    pub on_second: [f64; 2],
    /// Unit vector from the first shape to the second.
    pub normal: [f64; 2],
}

/// What a substep needs beside the state; it lives as long as a control step.
struct Scratch {
    placed: Placed,
    tests: Tests,
    touches: [Touch; MAX_TOUCHING],
    touches_len: usize,
    contacts: Contacts,
}

impl Scratch {
    fn new(world: &World, bodies: &[Body; 2]) -> Scratch {
        Scratch {
            placed: Placed::new(world, bodies),
            tests: Tests::new(),
            touches: [Touch::default(); MAX_TOUCHING],
            touches_len: 0,
            contacts: Contacts::new(),
        }
    }
}

impl Sim {
    /// Builds the world with both bodies at their start poses.
    ///
    /// As in the reference, the block's angle is written after its position and turns it about its center of gravity;
    /// call [`Sim::place`] or [`Sim::place_exactly`] next.
    ///
    /// # Errors
    /// [`PhysicsError`] if a number is out of range or the block is a disc.
    pub fn new(setup: &Setup) -> Result<Sim, PhysicsError> {
        if setup.friction != 0.0 {
            let allowed = "this engine has no friction; leave it at 0, or use swm/PushTRapier-v0";
            return Err(PhysicsError::Friction { friction: setup.friction, allowed });
        }
        let mut world = World::new(setup)?;
        let mut bodies = [Body::default(); 2];
        for (body, setup, properties) in
            [(0, &setup.agent, &world.bodies[0]), (1, &setup.block, &world.bodies[1])]
        {
            bodies[body].center = Vec2::from(setup.position) + properties.cog;
            bodies[body].angle = if properties.shape == Shape::Disc { 0.0 } else { setup.angle };
        }
        let broad_phase = BroadPhase::new(&world, &Placed::new(&world, &bodies));
        if let Some(cog) = setup.block_cog {
            world.move_block_cog(Vec2::from(cog));
        }
        Ok(Sim { world, state: State { bodies, broad_phase, memory: Memory::new() } })
    }

    /// Puts the bodies somewhere as the reference does at a reset: follow it with one [`Sim::substep`].
    ///
    /// Not touched are the block's velocities, a polygon agent's angular velocity, and the memory of contacts. What the
    /// previous pose caused therefore acts for one more substep. [`Sim::place_exactly`] leaves no such trace.
    ///
    /// # Errors
    /// [`PhysicsError::NotFinite`] if a number is NaN or infinite; nothing has moved then.
    pub fn place(&mut self, placement: &Placement) -> Result<(), PhysicsError> {
        placement.check()?;
        let [agent, block] = &mut self.state.bodies;
        let [agent_properties, block_properties] = &self.world.bodies;
        agent.motion.linear = Vec2::from(placement.agent_velocity);
        if let (Some(angle), false) = (placement.agent_angle, self.world.layout.agent_is_disc) {
            agent.angle = angle;
        }
        agent.set_origin(agent_properties, Vec2::from(placement.agent));
        block.angle = placement.block_angle;
        block.set_origin(block_properties, Vec2::from(placement.block));
        Ok(())
    }

    /// Puts the bodies somewhere as if the world had just been built there: the block at rest, no contact remembered,
    /// no substep needed.
    ///
    /// # Errors
    /// [`PhysicsError::NotFinite`] if a number is NaN or infinite; nothing has moved then.
    pub fn place_exactly(&mut self, placement: &Placement) -> Result<(), PhysicsError> {
        self.place(placement)?;
        let [agent, block] = &mut self.state.bodies;
        (agent.motion.angular, agent.bias) = (0.0, Motion::default());
        (block.motion, block.bias) = (Motion::default(), Motion::default());
        let placed = Placed::new(&self.world, &self.state.bodies);
        self.state.broad_phase = BroadPhase::new(&self.world, &placed);
        self.state.memory = Memory::new();
        Ok(())
    }

    /// Everything that changes, for [`Sim::restore`]. Copying the whole `Sim` does the same without a check.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// Continues from a state of this world, or of another one with the same setup.
    ///
    /// # Errors
    /// [`PhysicsError::ForeignState`] if the state was damaged or its bodies have other numbers of parts; this world
    /// is then unchanged.
    pub fn restore(&mut self, state: &State) -> Result<(), PhysicsError> {
        let layout = self.world.layout;
        if !state.broad_phase.is_sound(layout) || !state.memory.is_sound(layout) {
            return Err(PhysicsError::ForeignState);
        }
        self.state = *state;
        Ok(())
    }

    /// Moves the world by 0.01 s without the controller. Returns the number of contact points.
    pub fn substep(&mut self) -> u32 {
        let mut scratch = Scratch::new(&self.world, &self.state.bodies);
        self.state.advance(&self.world, &mut scratch)
    }

    /// Lets the contacts at the present poses set the velocities, without moving anything: a substep without its
    /// motion. After [`Sim::place_exactly`] at a recorded pose, bodies in contact then go on with the next substep and
    /// not one later. Impulses that the recorded world remembered are not known, so the continuation is close but not
    /// exact. Returns the number of contact points.
    pub fn settle(&mut self) -> u32 {
        let mut scratch = Scratch::new(&self.world, &self.state.bodies);
        self.state.resolve_contacts(&self.world, &mut scratch)
    }

    /// One control step of 0.1 s: ten times the controller and a substep. Returns the contact points of all ten; see
    /// [`contact_count`].
    ///
    /// The action, `[2]`, is not clipped. With `f32` the controller rounds as the reference does for `f32` actions.
    /// An action that is not finite spoils the world but does not panic.
    pub fn control_step<T: ActionScalar>(&mut self, action: [T; 2], mode: ActionMode) -> u32 {
        self.control_step_with(action, mode, |_, _| {})
    }

    /// [`Sim::control_step`] that shows the state after each substep, with the substep's contact points.
    pub fn control_step_with<T: ActionScalar>(
        &mut self,
        action: [T; 2],
        mode: ActionMode,
        mut after_substep: impl FnMut(&Sim, u32),
    ) -> u32 {
        let mut scratch = Scratch::new(&self.world, &self.state.bodies);
        let target = controller::target(action, mode, self.origin(BodyId::Agent, &scratch.placed));
        let mut points = 0;
        for _ in 0..SUBSTEPS {
            let position = self.origin(BodyId::Agent, &scratch.placed);
            let motion = &mut self.state.bodies[BodyId::Agent as usize].motion;
            motion.linear = controller::velocity(target, position, motion.linear);
            let now = self.state.advance(&self.world, &mut scratch);
            points += now;
            after_substep(self, now);
        }
        points
    }

    /// Position of the origin of a body's coordinates, pixels.
    pub fn position(&self, body: BodyId) -> [f64; 2] {
        let state = self.body(body);
        state.origin(self.world.body(body), Rotation::new(state.angle)).to_array()
    }

    /// Position of a body's center of gravity, pixels.
    pub fn center_of_gravity(&self, body: BodyId) -> [f64; 2] {
        self.body(body).center.to_array()
    }

    /// Angle of a body, radians, not wrapped; 0 for a disc.
    pub fn angle(&self, body: BodyId) -> f64 {
        self.body(body).angle
    }

    /// Velocity of a body's center of gravity, px/s. For the block and for a polygon agent: what the contacts of the
    /// last substep gave it.
    pub fn velocity(&self, body: BodyId) -> [f64; 2] {
        self.body(body).motion.linear.to_array()
    }

    /// Angular velocity of a body, rad/s.
    pub fn angular_velocity(&self, body: BodyId) -> f64 {
        self.body(body).motion.angular
    }

    /// Shape of a body.
    pub fn shape(&self, body: BodyId) -> Shape {
        self.world.body(body).shape
    }

    /// Scale of a body, pixels per unit of its shape's coordinates.
    pub fn scale(&self, body: BodyId) -> f32 {
        self.world.body(body).scale
    }

    /// The corners `[4][2]` of a body's rectangles in the world, in hull order, pixels; none for a disc.
    pub fn corners(&self, body: BodyId) -> impl Iterator<Item = [[f64; 2]; 4]> + '_ {
        self.world.corners(body, self.body(body).center, Rotation::new(self.angle(body)))
    }

    /// Number of contact points of the last substep.
    pub fn contact_points(&self) -> u32 {
        self.state.memory.contact_points()
    }

    /// The contacts of the last substep in the order in which they were solved, at the present poses (which a substep
    /// leaves as they were when it found the contacts).
    pub fn contacts(&self) -> impl Iterator<Item = Contact> + '_ {
        let placed = Placed::new(&self.world, &self.state.bodies);
        self.state.memory.touching().flat_map(move |(pair, block_first)| {
            let test = Test { pair, block_first };
            let found = manifold(&self.world, &placed, test);
            found.into_iter().flat_map(|(_, manifold)| {
                manifold.points.into_iter().take(manifold.len).map(move |point| Contact {
                    on_first: point.on_first.to_array(),
                    on_second: point.on_second.to_array(),
                    normal: manifold.normal.to_array(),
                })
            })
        })
    }

    fn body(&self, id: BodyId) -> &Body {
        &self.state.bodies[id as usize]
    }

    fn origin(&self, id: BodyId, placed: &Placed) -> Vec2 {
        self.body(id).origin(self.world.body(id), placed.rotations[id as usize])
    }
}

impl State {
    /// One substep. Returns the number of contact points.
    fn advance(&mut self, world: &World, scratch: &mut Scratch) -> u32 {
        for (id, body) in [BodyId::Agent, BodyId::Block].into_iter().zip(&mut self.bodies) {
            body.integrate();
            scratch.placed.follow(world, id, body);
        }
        self.resolve_contacts(world, scratch)
    }

    /// Finds the contacts at the present poses and lets them set the velocities. Returns their number.
    fn resolve_contacts(&mut self, world: &World, scratch: &mut Scratch) -> u32 {
        let State { bodies, broad_phase, memory } = self;
        let Scratch { placed, tests, touches, touches_len, contacts } = scratch;

        broad_phase.update(world, placed, bodies, tests);
        contacts.clear();
        *touches_len = 0;
        for &test in tests.as_slice() {
            let Some((pair, manifold)) = manifold(world, placed, test) else { continue };
            let touch = Touch {
                pair: test.pair,
                block_first: test.block_first,
                features: manifold.points.map(|point| point.feature),
                len: manifold.len,
            };
            let inherited = memory.recall(&touch);
            for (point, impulse) in manifold.points[..manifold.len].iter().zip(inherited.impulses) {
                contacts.push(
                    &world.bodies,
                    bodies,
                    pair,
                    (manifold.normal, point),
                    (impulse, inherited.apply),
                );
            }
            touches[*touches_len] = touch;
            *touches_len += 1;
        }

        for (body, properties) in bodies.iter_mut().zip(&world.bodies) {
            if properties.inv_mass > 0.0 {
                body.motion.linear = body.motion.linear * world.velocity_kept;
                body.motion.angular *= world.velocity_kept;
            }
        }
        contacts.solve(&world.bodies, bodies);
        memory.renew(&touches[..*touches_len], contacts.impulses());
        contacts.len() as u32
    }
}

/// Number of contacts of a control step as the reference counts them: the mean per substep, rounded up.
pub fn contact_count(points: u32) -> u32 {
    points.div_ceil(SUBSTEPS)
}

/// How a pair of shapes touches, if it does, and which bodies they belong to.
fn manifold(world: &World, placed: &Placed, test: Test) -> Option<(BodyPair, Manifold)> {
    let layout = world.layout;
    let rectangle = |leaf: usize| PlacedRectangle {
        center: placed.centers[leaf],
        half: world.parts[leaf].half,
        rotation: placed.rotations[layout.body_of(leaf) as usize],
    };
    match test.pair.pair(layout) {
        Pair::Wall { wall, leaf } => {
            let near = WALL_BOXES[wall].intersects(&placed.boxes[leaf]);
            let found = if near { collide_wall_rectangle(wall, &rectangle(leaf)) } else { None };
            Some(([None, Some(layout.body_of(leaf))], found?))
        }
        Pair::AgentBlock { agent, block } => {
            if !placed.boxes[agent].intersects(&placed.boxes[block]) {
                return None;
            }
            let bodies = [Some(BodyId::Agent), Some(BodyId::Block)];
            if layout.agent_is_disc {
                let radius = world.parts[agent].half.x;
                let found = collide_disc_rectangle(placed.centers[agent], radius, &rectangle(block));
                Some((bodies, found?))
            } else if test.block_first {
                let found = collide_rectangle_rectangle(&rectangle(block), &rectangle(agent));
                Some(([bodies[1], bodies[0]], found?))
            } else {
                let found = collide_rectangle_rectangle(&rectangle(agent), &rectangle(block));
                Some((bodies, found?))
            }
        }
    }
}
