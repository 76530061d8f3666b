//! What PushT asks of a physics engine. `swm/PushT-v1` runs on the quasi-static [`Sim`]; another engine gives another
//! environment with the same factors, columns and images.

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::physics::{
    ActionMode, ActionScalar, BodyId, Contact, PhysicsError, Placement, Setup, Shape, Sim, State,
};

/// A world of an agent and a block between four walls. A clone continues exactly as the original does.
pub trait Engine: Clone + Send + Sync + Sized + 'static {
    /// All that changes during an episode. Restored into a world of the same setup, it continues exactly.
    type State: Clone + Send + Sync + Serialize + DeserializeOwned;

    /// The registered name of PushT on it.
    const PUSHT: &'static str;

    /// Coefficient of friction of all contacts, unless the setting `friction` gives another. 0: the engine has none.
    const FRICTION: f64;

    /// Whether the agent stops at walls when it is a disc. Polygons always do.
    const WALLS_STOP_DISCS: bool;

    /// Builds the world. Place the bodies next.
    ///
    /// # Errors
    /// [`PhysicsError`] if a number is out of range or the block is a disc.
    fn new(setup: &Setup) -> Result<Self, PhysicsError>;

    /// Puts the bodies somewhere as a reset does: follow it with one [`Engine::substep`].
    ///
    /// # Errors
    /// [`PhysicsError::NotFinite`] if a number is NaN or infinite.
    fn place(&mut self, placement: &Placement) -> Result<(), PhysicsError>;

    /// Puts the bodies somewhere as if the world had just been built there, the block at rest.
    ///
    /// # Errors
    /// [`PhysicsError::NotFinite`] if a number is NaN or infinite.
    fn place_exactly(&mut self, placement: &Placement) -> Result<(), PhysicsError>;

    /// Finds the contacts at the present poses without moving anything. Returns the number of contact points.
    fn settle(&mut self) -> u32;

    /// Moves the world by 0.01 s without the controller. Returns the number of contact points.
    fn substep(&mut self) -> u32;

    /// One control step of 0.1 s. Returns the contact points of its ten substeps together.
    fn control_step<T: ActionScalar>(&mut self, action: [T; 2], mode: ActionMode) -> u32;

    /// Everything that changes, for [`Engine::restore`].
    fn state(&self) -> &Self::State;

    /// Continues from a state of this world, or of another one with the same setup.
    ///
    /// # Errors
    /// [`PhysicsError::ForeignState`] if the state is damaged or belongs to other bodies.
    fn restore(&mut self, state: &Self::State) -> Result<(), PhysicsError>;

    /// Position of the origin of a body's coordinates, pixels.
    fn position(&self, body: BodyId) -> [f64; 2];

    /// Position of a body's center of gravity, pixels.
    fn center_of_gravity(&self, body: BodyId) -> [f64; 2];

    /// Angle of a body, radians, not wrapped; 0 for a disc.
    fn angle(&self, body: BodyId) -> f64;

    /// Velocity of a body's center of gravity, px/s.
    fn velocity(&self, body: BodyId) -> [f64; 2];

    /// Shape of a body.
    fn shape(&self, body: BodyId) -> Shape;

    /// Scale of a body, pixels per unit of its shape's coordinates.
    fn scale(&self, body: BodyId) -> f32;

    /// The corners `[4][2]` of a body's rectangles in the world, in hull order, pixels; none for a disc.
    fn corners(&self, body: BodyId) -> impl Iterator<Item = [[f64; 2]; 4]> + '_;

    /// The contacts at the present poses, in the order in which they are solved.
    fn contacts(&self) -> impl Iterator<Item = Contact> + '_;
}

impl Engine for Sim {
    type State = State;

    const PUSHT: &'static str = "swm/PushT-v1";
    const FRICTION: f64 = 0.0;
    const WALLS_STOP_DISCS: bool = false;

    fn new(setup: &Setup) -> Result<Self, PhysicsError> {
        Sim::new(setup)
    }

    fn place(&mut self, placement: &Placement) -> Result<(), PhysicsError> {
        Sim::place(self, placement)
    }

    fn place_exactly(&mut self, placement: &Placement) -> Result<(), PhysicsError> {
        Sim::place_exactly(self, placement)
    }

    fn settle(&mut self) -> u32 {
        Sim::settle(self)
    }

    fn substep(&mut self) -> u32 {
        Sim::substep(self)
    }

    fn control_step<T: ActionScalar>(&mut self, action: [T; 2], mode: ActionMode) -> u32 {
        Sim::control_step(self, action, mode)
    }

    fn state(&self) -> &State {
        Sim::state(self)
    }

    fn restore(&mut self, state: &State) -> Result<(), PhysicsError> {
        Sim::restore(self, state)
    }

    fn position(&self, body: BodyId) -> [f64; 2] {
        Sim::position(self, body)
    }

    fn center_of_gravity(&self, body: BodyId) -> [f64; 2] {
        Sim::center_of_gravity(self, body)
    }

    fn angle(&self, body: BodyId) -> f64 {
        Sim::angle(self, body)
    }

    fn velocity(&self, body: BodyId) -> [f64; 2] {
        Sim::velocity(self, body)
    }

    fn shape(&self, body: BodyId) -> Shape {
        Sim::shape(self, body)
    }

    fn scale(&self, body: BodyId) -> f32 {
        Sim::scale(self, body)
    }

    fn corners(&self, body: BodyId) -> impl Iterator<Item = [[f64; 2]; 4]> + '_ {
        Sim::corners(self, body)
    }

    fn contacts(&self) -> impl Iterator<Item = Contact> + '_ {
        Sim::contacts(self)
    }
}
