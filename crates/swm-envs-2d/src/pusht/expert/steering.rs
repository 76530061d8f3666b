//! From where the agent should be to the action that takes it there in one control step.
//!
//! The controller is linear: in a free control step the agent moves by a share of the target's offset plus a share of
//! its velocity. Both shares are measured on the simulator, so that discs and polygons, which are stopped in every
//! substep, need no formula of their own.

use swm_core::policy::write_action;
use swm_core::{PolicyError, SliceMut};

use crate::pusht::discrete;
use crate::pusht::engine::Engine;
use crate::pusht::physics::{
    ActionMode, BodyId, BodySetup, PhysicsError, Placement, Setup, Shape, Vec2, vec2,
};

/// Length of a relative action of 1, pixels.
const ACTION_PX: f64 = 100.0;
/// The agent is not asked to go further than this in a control step, pixels. Beyond it, it overshoots corners.
pub(super) const REACH_PX: f64 = 38.0;

/// What actions mean in the environment that is planned for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ActionKind {
    /// Offsets of the target in units of 100 px.
    Relative,
    /// Targets in pixels.
    Absolute,
    /// Offsets on a polar grid.
    Discrete,
}

/// An intended offset of the target from the agent, in units of 100 px, each component in [-1, 1]. It becomes an
/// action where it is carried out.
pub(super) type Command = [f32; 2];

/// How to move the agent of an episode.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Steering {
    kind: ActionKind,
    /// How often the world applies each action.
    frame_skip: u32,
    /// The longest way that the agent is asked to go in a control step, pixels.
    max_step_px: f64,
    /// Way in a free control step per offset of the target.
    offset_share: f64,
    /// Way in a free control step per velocity, seconds.
    velocity_share_s: f64,
}

impl Steering {
    /// Measures how the agent of `setup` answers.
    pub(super) fn new<E: Engine>(
        kind: ActionKind,
        frame_skip: u32,
        max_step_px: f64,
        setup: &Setup,
    ) -> Result<Steering, PhysicsError> {
        // A small agent of the same kind alone in the middle; the block is far off in a corner.
        let shape = if setup.agent.shape == Shape::Disc { Shape::Disc } else { Shape::Square };
        let body = |shape, position| BodySetup { shape, scale: 1.0, position, angle: 0.0 };
        let (agent, block) = ([256.0, 256.0], [30.0, 30.0]);
        let probe = Setup {
            agent: body(shape, agent),
            block: body(Shape::Square, block),
            damping: setup.damping,
            block_cog: None,
            friction: setup.friction,
        };
        let mut sim = E::new(&probe)?;
        let mut way = |velocity: f64, action: f64| -> Result<f64, PhysicsError> {
            let agent_velocity = [velocity, 0.0];
            sim.place_exactly(&Placement { agent, agent_velocity, block, ..Placement::default() })?;
            sim.control_step([action, 0.0], ActionMode::Relative);
            Ok(sim.position(BodyId::Agent)[0] - agent[0])
        };
        Ok(Steering {
            kind,
            frame_skip,
            max_step_px,
            offset_share: way(0.0, 1.0)? / ACTION_PX,
            velocity_share_s: way(100.0, 0.0)? / 100.0,
        })
    }

    /// The longest way along one axis in a control step from rest, pixels.
    pub(super) fn step_px(&self) -> f64 {
        self.offset_share * ACTION_PX
    }

    /// The command, or, if the agent would go further than it is allowed to, the one that takes it as far as that in the
    /// same direction.
    pub(super) fn limited(&self, sim: &impl Engine, command: Command) -> Command {
        let [position, velocity] = [sim.position(BodyId::Agent), sim.velocity(BodyId::Agent)].map(Vec2::from);
        let way =
            vec2(command[0].into(), command[1].into()) * self.step_px() + velocity * self.velocity_share_s;
        if way.norm() <= self.max_step_px { command } else { self.toward(sim, position + way) }
    }

    /// The command after which the agent is at `target`, or as near on the way to it as it can get.
    pub(super) fn toward(&self, sim: &impl Engine, target: Vec2) -> Command {
        let [position, velocity] = [sim.position(BodyId::Agent), sim.velocity(BodyId::Agent)].map(Vec2::from);
        let way = target - position;
        let distance = way.norm();
        let reach = REACH_PX.min(self.max_step_px);
        let way = if distance > reach { way * (reach / distance) } else { way };
        let offset = (way - velocity * self.velocity_share_s) * (1.0 / (self.offset_share * ACTION_PX));
        let scale = 1.0 / offset.x.abs().max(offset.y.abs()).max(1.0);
        [(offset.x * scale) as f32, (offset.y * scale) as f32]
    }

    /// The command that pushes in a direction. A strength of 1 is the most that this direction allows.
    pub(super) fn push(direction: Vec2, strength: f64) -> Command {
        let scale = strength / direction.x.abs().max(direction.y.abs());
        [(direction.x * scale) as f32, (direction.y * scale) as f32]
    }

    /// Carries a command out, rounded as the environment's actions are and as often as they are applied, until
    /// `is_over`. Returns whether it is.
    pub(super) fn drive<E: Engine>(
        &self,
        sim: &mut E,
        command: Command,
        is_over: impl Fn(&E) -> bool,
    ) -> bool {
        let (action, mode) = match self.kind {
            ActionKind::Relative => (command, ActionMode::Relative),
            ActionKind::Absolute => (absolute(sim, command), ActionMode::Absolute),
            ActionKind::Discrete => {
                (discrete::to_continuous(discrete::from_continuous(command)), ActionMode::Relative)
            }
        };
        (0..self.frame_skip).any(|_| {
            sim.control_step(action, mode);
            is_over(sim)
        })
    }

    /// Writes a command as the action of an environment that stands as `sim` does.
    pub(super) fn write(
        &self,
        sim: &impl Engine,
        command: Command,
        action: &mut SliceMut<'_>,
    ) -> Result<(), PolicyError> {
        match (self.kind, action) {
            (ActionKind::Discrete, SliceMut::I64(bins)) => {
                bins.copy_from_slice(&discrete::from_continuous(command));
            }
            (ActionKind::Relative, action) => write_action(action, &command),
            (ActionKind::Absolute, action) => write_action(action, &absolute(sim, command)),
            (ActionKind::Discrete, other) => {
                let reason = format!("discrete actions are i64, not {}", other.dtype());
                return Err(PolicyError::Unsupported { policy: "expert".to_owned(), reason });
            }
        }
        Ok(())
    }
}

/// The target of a command, pixels.
fn absolute(sim: &impl Engine, command: Command) -> Command {
    let position = sim.position(BodyId::Agent);
    [0, 1].map(|axis| (position[axis] + ACTION_PX * f64::from(command[axis])) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pusht::physics::Sim;

    fn alone(shape: Shape) -> (Setup, Sim) {
        let mut setup = Setup::default();
        (setup.agent.shape, setup.block.scale) = (shape, 5.0);
        let mut sim = Sim::new(&setup).unwrap();
        let agent_velocity = if shape == Shape::Disc { [90.0, -40.0] } else { [0.0, 0.0] };
        let placement =
            Placement { agent: [250.0, 250.0], agent_velocity, block: [30.0, 30.0], ..Placement::default() };
        sim.place_exactly(&placement).unwrap();
        (setup, sim)
    }

    #[test]
    fn a_near_target_is_met_in_one_step() {
        for (shape, kind) in [
            (Shape::Disc, ActionKind::Relative),
            (Shape::Disc, ActionKind::Absolute),
            (Shape::L, ActionKind::Relative),
        ] {
            let (setup, mut sim) = alone(shape);
            let steering = Steering::new::<Sim>(kind, 1, 100.0, &setup).unwrap();
            let target = vec2(254.0, 243.0);
            let command = steering.toward(&sim, target);
            steering.drive(&mut sim, command, |_| false);
            let miss = (Vec2::from(sim.position(BodyId::Agent)) - target).norm();
            assert!(miss < 1e-3, "{shape:?} {kind:?}: {miss}");
        }
    }

    #[test]
    fn polygons_cover_a_tenth_of_the_way() {
        let (setup, _) = alone(Shape::Z);
        let steering = Steering::new::<Sim>(ActionKind::Relative, 1, 100.0, &setup).unwrap();
        assert!((steering.step_px() - 100.0 * (1.0 - 0.99_f64.powi(10))).abs() < 1e-9);
    }

    #[test]
    fn far_targets_keep_commands_in_the_box_and_the_direction() {
        let (setup, sim) = alone(Shape::Square);
        let steering = Steering::new::<Sim>(ActionKind::Relative, 1, 100.0, &setup).unwrap();
        let [x, y] = steering.toward(&sim, vec2(450.0, 350.0));
        assert!((x - 1.0).abs() < 1e-6 && (y - 0.5).abs() < 1e-6);
        assert_eq!(Steering::push(vec2(0.6, -0.8), 0.5), [0.375, -0.5]);
    }

    #[test]
    fn a_limited_agent_goes_no_further_in_a_step() {
        let (setup, mut sim) = alone(Shape::Disc);
        let steering = Steering::new::<Sim>(ActionKind::Relative, 1, 12.0, &setup).unwrap();
        let command = [1.0, 0.25];
        for step in 0..6 {
            let before = Vec2::from(sim.position(BodyId::Agent));
            let limited = steering.limited(&sim, command);
            steering.drive(&mut sim, limited, |_| false);
            let way = (Vec2::from(sim.position(BodyId::Agent)) - before).norm();
            assert!((way - 12.0).abs() < 1e-3, "step {step}: {way} px");
        }
        let weak = [0.05, 0.0];
        let resting = alone(Shape::Square).1;
        assert_eq!(steering.limited(&resting, weak), weak, "what is shorter anyway stays");
    }
}
