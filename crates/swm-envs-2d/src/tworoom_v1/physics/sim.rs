//! One disc in one floor plan: the substep, the control step, placing, saving.

use serde::{Deserialize, Serialize};

use super::plan::FloorPlan;
use super::soft::SoftDisc;
use super::{Vec2, solid};
use crate::pusht::physics::SUBSTEP_SECONDS;

/// Substeps of a control step.
pub(crate) const SUBSTEPS: u32 = 10;
/// Actions are shortened to this length.
pub(crate) const MAX_ACTION_NORM: f32 = 2.45;
/// Solver sweeps in the substeps of a reset, and in those of a control step.
const RESET_SWEEPS: u32 = 10;
const STEP_SWEEPS: u32 = 30;
/// Seconds of a control step, in the type of actions.
const CONTROL_SECONDS: f32 = 0.1;

/// What does not change in an episode.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Setup {
    pub(crate) plan: FloorPlan,
    /// Radius of the disc, pixels.
    pub(crate) radius: f64,
    /// Pixels per control step and unit of action.
    pub(crate) speed: f32,
    /// Walls are truly solid.
    pub(crate) solid: bool,
}

/// The disc in its rooms.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Sim {
    setup: Setup,
    disc: SoftDisc,
}

/// What changes in an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct State(SoftDisc);

impl Sim {
    /// A disc at rest.
    pub(crate) fn new(setup: Setup, position: Vec2) -> Sim {
        let disc = SoftDisc::new(&setup.plan, position, setup.radius);
        Sim { setup, disc }
    }

    pub(crate) fn setup(&self) -> &Setup {
        &self.setup
    }

    pub(crate) fn position(&self) -> Vec2 {
        self.disc.position
    }

    /// Moves the disc somewhere else as the reference does: what the last contacts ask for still acts. Between solid
    /// walls the disc is put where it overlaps nothing.
    pub(crate) fn place(&mut self, position: Vec2) {
        let Setup { plan, radius, solid, .. } = &self.setup;
        self.disc.position = if *solid { solid::pushed_out(plan, position, *radius) } else { position };
    }

    /// Puts the disc somewhere as if it had come there by itself: contacts are found, nothing moves. Returns how many
    /// contacts there are.
    pub(crate) fn place_exactly(&mut self, position: Vec2) -> u32 {
        self.place(position);
        let Setup { plan, radius, solid, .. } = &self.setup;
        if *solid {
            solid::count_touching(plan, self.disc.position, *radius)
        } else {
            self.disc.correct(plan, *radius, Vec2::ZERO, STEP_SWEEPS)
        }
    }

    /// One substep without drive, as resets run it. Returns how many contacts there are.
    pub(crate) fn settle(&mut self) -> u32 {
        self.substep(Vec2::ZERO, RESET_SWEEPS)
    }

    /// Moves by an action for a tenth of a second. Returns the contacts of all substeps.
    pub(crate) fn control_step(&mut self, action: [f32; 2]) -> u32 {
        let velocity = self.velocity(action);
        (0..SUBSTEPS).map(|_| self.substep(velocity, STEP_SWEEPS)).sum()
    }

    /// The velocity that an action asks for, px/s. In single precision, in the reference's order.
    fn velocity(&self, [x, y]: [f32; 2]) -> Vec2 {
        let norm = (x * x + y * y).sqrt();
        let short = |a: f32| if norm > MAX_ACTION_NORM { a / norm * MAX_ACTION_NORM } else { a };
        let speed = |a: f32| f64::from(short(a) / CONTROL_SECONDS * self.setup.speed);
        Vec2::from([speed(x), speed(y)])
    }

    fn substep(&mut self, velocity: Vec2, sweeps: u32) -> u32 {
        let Setup { plan, radius, solid, .. } = &self.setup;
        if *solid {
            let motion = velocity * SUBSTEP_SECONDS;
            self.disc.position = solid::slide(plan, self.disc.position, *radius, motion);
            solid::count_touching(plan, self.disc.position, *radius)
        } else {
            self.disc.substep(plan, *radius, velocity, sweeps)
        }
    }

    pub(crate) fn state(&self) -> State {
        State(self.disc)
    }

    /// Returns to a saved state; `false` and no change if it holds no finite values.
    pub(crate) fn restore(&mut self, State(disc): State) -> bool {
        let sound = disc.is_sound();
        if sound {
            self.disc = disc;
        }
        sound
    }
}

/// The contact count that is observed: the mean over the substeps, rounded up.
pub(crate) fn contact_count(points: u32) -> i64 {
    i64::from(points.div_ceil(SUBSTEPS))
}
