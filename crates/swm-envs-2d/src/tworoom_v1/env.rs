//! `swm/TwoRoom-v1`: reset, step, observation, images.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::{
    Dtype, EnvError, EnvSpec, Episode, Field, ImageSize, Keypoint, Outcome, RowsMut, Slice, Space, Value,
};
use swm_fov::{Fov, FovSpace, Scene, SceneError};

use super::factors::{factors, goal_radius, position, setup};
use super::goal::{Overlap, task_cost};
use super::physics::{Sim, State, Vec2, contact_count};
use super::rendering::Look;
use super::settings::Settings;
use crate::image::Canvas;

// Field indices, in the order of `spec`.
const STATE: usize = 0;
const PROPRIO: usize = 1;
const POS_AGENT: usize = 2;
const POS_GOAL: usize = 3;
const N_CONTACTS: usize = 4;
const ENERGY: usize = 5;
const FRACTION_OF_GOAL: usize = 6;
const FRACTION_OF_AGENT: usize = 7;
const GOAL_POS: usize = 8;
const GOAL_POS_AGENT: usize = 9;
const MAX_ENERGY: usize = 10;

/// Reward of a step that ends at the goal, and of any other.
const REWARDS: [f64; 2] = [1.0, -0.01];
/// Side of the square that the image shows, pixels.
const IMAGE_PX: f64 = 512.0;

/// Steer a disc through the door of a wall to a goal in the other room. See the module's documentation.
pub(super) struct TwoRoom {
    sim: Sim,
    max_energy: i64,
    goal_radius: f64,
    /// The factor, in place of which a recorded goal may be.
    goal_position: [f32; 2],
}

/// What changes in an episode, and the goal.
#[derive(Serialize, Deserialize)]
pub(super) struct Moving {
    goal: Vec2,
    energy: i64,
    /// Contact points counted since the last observation.
    contact_points: u32,
    /// No action has been taken: the reference reports no overlap then.
    is_start: bool,
    disc: State,
}

/// Some finite values of a recorded row.
fn recorded<const N: usize>(
    row: &BTreeMap<String, Value>,
    column: &str,
) -> Result<Option<[f64; N]>, SceneError> {
    let Some(value) = row.get(column) else { return Ok(None) };
    let values = value.cast(column, Dtype::F64, &[N])?.to_f64s(column)?;
    if values.iter().any(|number| !number.is_finite()) {
        return Err(format!("the recorded `{column}` is not finite").into());
    }
    Ok(values.try_into().ok())
}

/// The recorded place of the agent: `pos_agent`, or the first two values of `state`.
fn recorded_agent(row: &BTreeMap<String, Value>) -> Result<Option<Vec2>, SceneError> {
    if let Some(place) = recorded::<2>(row, "pos_agent")? {
        return Ok(Some(place.into()));
    }
    Ok(recorded::<6>(row, "state")?.map(|[x, y, ..]| [x, y].into()))
}

impl TwoRoom {
    fn overlap(&self, moving: &Moving) -> Overlap {
        let (agent, goal) = (self.sim.position().to_array(), moving.goal.to_array());
        Overlap::new(agent, self.sim.setup().radius, goal, self.goal_radius)
    }
}

impl Scene for TwoRoom {
    const ID: &'static str = "swm/TwoRoom-v1";
    type Settings = Settings;
    type State = Moving;
    type Canvas = Canvas<Look>;

    fn factors(settings: &Settings) -> Result<FovSpace, SceneError> {
        Ok(factors().with_defaults(Self::ID, &settings.init_value)?)
    }

    fn spec() -> EnvSpec {
        let step = |name: &str, shape: &[usize]| Field::step(name, Dtype::F64, shape);
        let fields = vec![
            step("state", &[6]),
            step("proprio", &[2]),
            step("pos_agent", &[2]),
            step("pos_goal", &[2]),
            Field::step("n_contacts", Dtype::I64, &[]),
            Field::step("energy", Dtype::I64, &[]),
            step("fraction_of_goal", &[]),
            step("fraction_of_agent", &[]),
            Field::episode("goal_pos", Dtype::F32, &[2]),
            Field::episode("goal_pos_agent", Dtype::F64, &[2]),
            Field::episode("max_energy", Dtype::I64, &[]),
        ];
        EnvSpec::new(Self::ID, Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), fields)
            .time_step_s(0.1)
            .start_columns(&["state", "pos_agent"])
            .goal_columns(&["pos_agent"])
    }

    fn canvas(settings: &Settings, size: ImageSize) -> Result<Self::Canvas, SceneError> {
        Canvas::new(size, settings.render)
    }

    fn sample(space: &FovSpace, episode: &Episode<'_>) -> Result<Fov, SceneError> {
        let options = episode.options;
        match space.sample(Self::ID, episode) {
            // A recorded start is elsewhere than the factor's: it is the one that must be possible.
            Err(EnvError::Constraint { .. }) if options.start.is_some() => {
                let mut in_use = Vec::new();
                for (factor, row) in [("agent.position", &options.start), ("goal.position", &options.goal)] {
                    if let Some(at) = row.as_ref().map(recorded_agent).transpose()?.flatten() {
                        in_use.push((factor, Value::vector(&at.to_array())));
                    }
                }
                Ok(space.sample_in_use(Self::ID, episode, &in_use)?)
            }
            sampled => Ok(sampled?),
        }
    }

    fn new(settings: &Settings, fov: &Fov) -> Result<Self, SceneError> {
        Ok(Self {
            sim: Sim::new(setup(fov, settings), position(fov, "agent")),
            max_energy: fov.i64("agent.max_energy"),
            goal_radius: goal_radius(fov),
            goal_position: fov.vector("goal.position"),
        })
    }

    /// The reference's order: agent at the goal and one substep, then at its start and one substep. What the goal leaves
    /// in contacts acts in the second. A recorded start is taken over exactly instead.
    fn start(&mut self, _: &EnvSpec, fov: &Fov, episode: &Episode<'_>) -> Result<Moving, SceneError> {
        let (mut agent, mut goal, mut energy) = (None, position(fov, "goal"), self.max_energy);
        if let Some(row) = &episode.options.start {
            let state = recorded::<6>(row, "state")?;
            let at = recorded_agent(row)?;
            agent = Some(at.ok_or("a recorded start needs the column `state` or `pos_agent`")?);
            if let Some([_, _, x, y, left, _]) = state {
                (goal, energy) = ([x, y].into(), (left as i64).clamp(0, self.max_energy));
            }
        }
        if let Some(row) = &episode.options.goal {
            let at = recorded_agent(row)?;
            goal = at.ok_or("a recorded goal needs the column `pos_agent` or `state`")?;
        }
        let contact_points = match agent {
            Some(agent) => self.sim.place_exactly(agent),
            None => [goal, position(fov, "agent")]
                .map(|place| {
                    self.sim.place(place);
                    self.sim.settle()
                })
                .iter()
                .sum(),
        };
        Ok(Moving { goal, energy, contact_points, is_start: true, disc: self.sim.state() })
    }

    fn restore(&mut self, moving: &Moving) -> Result<(), SceneError> {
        match moving.goal.is_finite() && self.sim.restore(moving.disc) {
            true => Ok(()),
            false => Err("it holds values that are not finite".into()),
        }
    }

    fn is_same_goal(a: &Moving, b: &Moving) -> bool {
        a.goal == b.goal
    }

    fn step(&mut self, moving: &mut Moving, action: Slice<'_>) -> Result<Outcome, SceneError> {
        let Slice::F32(&[x, y]) = action else {
            return Err(format!("{} values of {} are no action", action.len(), action.dtype()).into());
        };
        let contact_points = self.sim.control_step([x, y]);
        moving.disc = self.sim.state();
        if !self.sim.position().is_finite() {
            return Err(format!("the agent's place is not finite after the action {:?}", [x, y]).into());
        }
        (moving.contact_points, moving.is_start) = (contact_points, false);
        moving.energy -= 1;
        Ok(self.outcome(moving))
    }

    fn outcome(&self, moving: &Moving) -> Outcome {
        let success = self.overlap(moving).is_success();
        Outcome { reward: REWARDS[usize::from(!success)], terminated: success, success: Some(success) }
    }

    fn is_truncated(&self, moving: &Moving) -> bool {
        moving.energy <= 0
    }

    fn write_episode(&self, moving: &Moving, out: &mut RowsMut<'_>) {
        out.write(GOAL_POS, &self.goal_position);
        out.write(GOAL_POS_AGENT, &moving.goal.to_array());
        out.write(MAX_ENERGY, &[self.max_energy]);
    }

    fn observe(&self, moving: &Moving, out: &mut RowsMut<'_>) {
        let ([x, y], [gx, gy]) = (self.sim.position().to_array(), moving.goal.to_array());
        let overlap = if moving.is_start { Overlap::default() } else { self.overlap(moving) };
        out.write(STATE, &[x, y, gx, gy, moving.energy as f64, f64::from(self.sim.setup().speed)]);
        out.write(PROPRIO, &[x, y]);
        out.write(POS_AGENT, &[x, y]);
        out.write(POS_GOAL, &[gx, gy]);
        out.write(N_CONTACTS, &[contact_count(moving.contact_points)]);
        out.write(ENERGY, &[moving.energy]);
        out.write(FRACTION_OF_GOAL, &[overlap.of_goal]);
        out.write(FRACTION_OF_AGENT, &[overlap.of_agent]);
    }

    fn dress(&self, _: &Moving, look: &Fov, canvas: &mut Self::Canvas) -> Result<(), SceneError> {
        canvas.set_look(Look::new(look, &self.sim.setup().plan));
        Ok(())
    }

    fn render(&self, moving: &Moving, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(pixels, |look, painter| look.render(self.sim.position(), moving.goal, painter));
    }

    fn render_goal(&self, moving: &Moving, canvas: &mut Self::Canvas, pixels: &mut [u8]) {
        canvas.render(pixels, |look, painter| look.render(moving.goal, moving.goal, painter));
    }

    fn task_cost(&self, moving: &Moving) -> Option<f64> {
        Some(task_cost(&self.sim, moving.goal))
    }

    fn keypoints(&self, _: &Moving) -> Vec<Keypoint> {
        let Vec2 { x, y } = self.sim.position();
        vec![Keypoint { name: "agent", at: [x, y].map(|px| px / IMAGE_PX) }]
    }
}
