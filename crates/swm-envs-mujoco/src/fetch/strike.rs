//! The expert of Slide: a strike at the puck, planned once per episode. The cross-entropy method searches direction, speed,
//! length and offset of the strike; each candidate is simulated from the episode's first row, with its mass, to the end.

use std::sync::Arc;

use swm_core::env::VARIATION_PREFIX;
use swm_core::seed::Stream;
use swm_core::{PolicyError, SlotView};

use super::expert::{Sight, heading, over, steer};
use super::factors;
use super::models::Shared;
use super::robot::{Robot, distance};
use super::task::Task;
use crate::suite::normal;
use swm_mujoco::MujocoError;
use swm_mujoco::Simulation;

/// Turn of the strike from the direction to the goal, rad; speed, as a value of actions; steps; offset to the side, m.
type Candidate = [f64; 4];

/// Candidates of a round; the best of them, from which the next round is sampled; rounds.
const SAMPLES: u64 = 16;
const ELITES: usize = 4;
const ROUNDS: u64 = 8;
/// A candidate that ends this near to the goal is good enough, m.
const GOOD: f64 = 0.025;
/// Steps of an episode.
const STEPS: usize = 50;
/// Standard deviations of the first round, and what is added to those of the elites.
const SPREAD: Candidate = [0.25, 0.25, 3.0, 0.01];
const WIDENING: Candidate = [0.02, 0.02, 0.3, 0.001];

/// A strike that is carried out.
pub(super) struct Strike {
    candidate: Candidate,
    direction: [f64; 2],
    /// Steps of the strike so far; none before the gripper is behind the puck.
    struck: Option<f64>,
}

impl Strike {
    fn new(candidate: Candidate) -> Self {
        Self { candidate, direction: [1.0, 0.0], struck: None }
    }

    /// Whether the strike is over.
    fn is_over(&self) -> bool {
        self.struck.is_some_and(|steps| steps > self.candidate[2] + 1.0)
    }

    /// The action at a row.
    pub(super) fn act(&mut self, sight: &Sight) -> [f64; 4] {
        /// The gripper below the middle of the puck, and behind it, m.
        const DEPTH: f64 = 0.005;
        const BEHIND: f64 = 0.075;
        let [turn, speed, steps, offset] = self.candidate;
        let low = sight.goal[2] - DEPTH;
        let Some(struck) = &mut self.struck else {
            let ([x, y], _) = heading(sight.object, sight.goal);
            let (sin, cos) = turn.sin_cos();
            let [x, y] = [cos * x - sin * y, sin * x + cos * y];
            self.direction = [x, y];
            let behind =
                [sight.object[0] - BEHIND * x - offset * y, sight.object[1] - BEHIND * y + offset * x, low];
            if distance(sight.grip, behind) < 0.012 {
                self.struck = Some(0.0);
                return self.act(sight);
            }
            let limited = |value: f64| value.clamp(-1.0, 1.0);
            return steer(over(sight, behind, [0.02, 0.07]), sight.grip, 14.0, 0.0).map(limited);
        };
        *struck += 1.0;
        // The last step is a part of one.
        let share = (steps - *struck + 1.0).clamp(0.0, 1.0);
        if share > 0.0 {
            let [x, y] = self.direction.map(|value| value * speed * share);
            return [x, y, 10.0 * (low - sight.grip[2]), 0.0];
        }
        [0.0, 0.0, if sight.grip[2] < low + 0.1 { 0.6 } else { 0.0 }, 0.0]
    }
}

/// Plans the strike of an episode from its first row.
pub(super) fn plan(view: &SlotView<'_>) -> Result<Strike, PolicyError> {
    let mut twin = Twin::new(view)?;
    let sight = twin.sight();
    let left = heading(sight.object, sight.goal).1;
    let mut mean = [0.0, (0.55 + 0.9 * left).min(1.4), (2.0 + 6.0 * left).min(10.0), 0.0];
    let mut spread = SPREAD;
    let mut best = (f64::INFINITY, mean);
    for round in 0..ROUNDS {
        let mut tried = Vec::with_capacity(SAMPLES as usize);
        for sample in 0..SAMPLES {
            let mut stream = view.episode.seed.indexed("policy fetch strike", [round, sample]);
            let candidate = sampled(mean, spread, &mut stream);
            tried.push((twin.end_of(candidate).map_err(failed)?, candidate));
        }
        tried.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        if tried[0].0 < best.0 {
            best = tried[0];
        }
        if best.0 < GOOD {
            break;
        }
        let elites = &tried[..ELITES];
        let average = |of: &dyn Fn(&Candidate) -> f64| {
            elites.iter().map(|(_, candidate)| of(candidate)).sum::<f64>() / ELITES as f64
        };
        mean = std::array::from_fn(|k| average(&|candidate| candidate[k]));
        spread = std::array::from_fn(|k| {
            average(&|candidate| (candidate[k] - mean[k]).powi(2)).sqrt() + WIDENING[k]
        });
    }
    Ok(Strike::new(best.1))
}

fn sampled(mean: Candidate, spread: Candidate, stream: &mut Stream) -> Candidate {
    let [turn, speed, steps, offset] = std::array::from_fn(|k| mean[k] + spread[k] * normal(stream));
    [turn, speed.clamp(0.1, 1.41), steps.clamp(1.0, 14.0), offset]
}

fn failed(error: MujocoError) -> PolicyError {
    PolicyError::Other(error.into())
}

/// The episode's simulation once more, at its first row.
struct Twin {
    robot: Robot,
    start: Vec<f64>,
    goal: [f64; 3],
    observation: Vec<f64>,
}

impl Twin {
    fn new(view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let values = |column: &str| Ok::<_, PolicyError>(view.row.get::<f64>(column)?.to_vec());
        let shared = Shared::get(Task::Slide).map_err(failed)?;
        let mut model = swm_mujoco::Model::clone(&shared.model);
        let mass = values(&format!("{VARIATION_PREFIX}{}", factors::MASS))?;
        factors::set_mass(&mut model, mass[0]).map_err(failed)?;
        let mut sim = Simulation::new(Arc::new(model)).map_err(failed)?;
        sim.reset();
        sim.qpos_mut().copy_from_slice(&values("qpos")?);
        sim.qvel_mut().copy_from_slice(&values("qvel")?);
        sim.set_time(values("time")?[0]);
        sim.mocap_pos_mut().copy_from_slice(&values("mocap_pos")?);
        sim.mocap_quat_mut().copy_from_slice(&values("mocap_quat")?);
        sim.qacc_warmstart_mut().copy_from_slice(&values("qacc_warmstart")?);
        let (mut start, goal) = (Vec::new(), values("desired_goal")?);
        sim.save(&mut start);
        let robot = Robot::new(Task::Slide, sim).map_err(failed)?;
        let mut twin = Self { robot, start, goal: [goal[0], goal[1], goal[2]], observation: Vec::new() };
        twin.begin().map_err(failed)?;
        Ok(twin)
    }

    fn begin(&mut self) -> Result<(), MujocoError> {
        self.robot.sim.load(&self.start)?;
        self.robot.observe(&mut self.observation);
        Ok(())
    }

    fn sight(&self) -> Sight {
        Sight::new(&self.observation, &self.goal)
    }

    /// How far from the goal the puck ends, m.
    fn end_of(&mut self, candidate: Candidate) -> Result<f64, MujocoError> {
        /// Slower than this the puck has come to rest, m/s.
        const REST: f64 = 0.005;
        self.begin()?;
        let mut strike = Strike::new(candidate);
        for _ in 0..STEPS {
            let action = strike.act(&self.sight()).map(|value| value.clamp(-1.0, 1.0) as f32);
            self.robot.advance(action, &mut self.observation)?;
            let [x, y, _] = self.robot.object_velocity();
            if strike.is_over() && x.hypot(y) < REST {
                break;
            }
        }
        Ok(distance(self.robot.achieved(), self.goal))
    }
}
