//! `demo/Point-v0`: a point on a line that must reach a goal.

use serde::{Deserialize, Serialize};
use swm_core::policy::{scripted, write_action};
use swm_core::registry::NoArgs;
use swm_core::{
    Dtype, Env, EnvConfig, EnvEntry, EnvError, EnvSpec, EnvState, Episode, Field, Outcome, PolicyEntry,
    RowsMut, Slice, Space,
};
use swm_fov::{Factor, Fov, FovSpace, SavedFov};

/// The environment as tables and command lines know it.
pub const POINT: EnvEntry =
    EnvEntry::new("demo/Point-v0", "a point on a line that must reach a goal", |config| {
        Ok(Box::new(Point::new(config)?))
    })
    .success("nearer to the goal than 0.05")
    .policies(&[EXPERT]);

/// A policy of this environment: `--policy expert`. One that remembers implements `Actor`, wrapped in `PerEpisode`.
const EXPERT: PolicyEntry = PolicyEntry::new("expert", "moves to the goal", |_, args| {
    args.parse_as::<NoArgs>()?;
    Ok(Box::new(scripted("expert", |view, action| {
        let [state, goal]: [&[f64]; 2] = [view.row.get("state")?, view.row.get("goal_state")?];
        write_action(action, &[(10.0 * (goal[0] - state[0])).clamp(-1.0, 1.0) as f32]);
        Ok(())
    })))
});

// Field indices, in the order of `fields`.
const STATE: usize = 0;
const GOAL_STATE: usize = 1;
const FACTORS: usize = 2;

/// Success: the point is nearer to the goal than this.
const REACH: f64 = 0.05;

/// What may differ between episodes. Every factor must change something: the conformance checks look.
fn factors() -> FovSpace {
    FovSpace::new(vec![
        Factor::scalar("point.speed", 0.05, 0.2, 0.1).doc("distance per step at full action"),
        Factor::scalar("point.start", -1.0, 1.0, -0.5).doc("where it starts").sampled_by_default(),
        Factor::scalar("goal.position", -1.0, 1.0, 0.5).doc("where it shall be").sampled_by_default(),
        Factor::rgb("point.color", [200, 30, 30]).doc("color of the point, in images"),
    ])
}

struct Point {
    spec: EnvSpec,
    space: FovSpace,
    fov: Fov,
    position: f64,
    goal: f64,
}

/// A saved moment: everything that the future depends on.
#[derive(Serialize, Deserialize)]
struct Saved {
    fov: SavedFov,
    position: f64,
    goal: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Settings {}

impl Point {
    fn new(config: &EnvConfig) -> Result<Self, EnvError> {
        config.parse_settings::<Settings>(POINT.id)?;
        let space = factors();
        let mut fields =
            vec![Field::step("state", Dtype::F64, &[1]), Field::episode("goal_state", Dtype::F64, &[1])];
        fields.extend(space.fields());
        fields.extend(config.image.map(|size| size.field("pixels")));
        let spec = EnvSpec::new(POINT.id, Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0), fields)
            .factors(space.specs())
            .time_step_s(0.1)
            .start_columns(&["state"])
            .goal_columns(&["state"]);
        let fov = space.defaults();
        Ok(Self { spec, space, fov, position: 0.0, goal: 0.0 })
    }

    fn outcome(&self) -> Outcome {
        let distance = (self.position - self.goal).abs();
        Outcome { reward: -distance, terminated: distance < REACH, success: Some(distance < REACH) }
    }
}

impl Env for Point {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.fov = self.space.sample(&self.spec.id, episode)?;
        // A recorded row may say where to start and what the goal is, else factors do.
        let start = episode.start(&self.spec, "state")?.map(|state| state[0]);
        let goal = episode.goal(&self.spec, "state")?.map(|state| state[0]);
        self.position = start.unwrap_or(self.fov.f64("point.start"));
        self.goal = goal.unwrap_or(self.fov.f64("goal.position"));
        Ok(Outcome { reward: f64::NAN, terminated: false, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        let push = action.as_f64(0).unwrap_or(0.0).clamp(-1.0, 1.0);
        self.position = (self.position + self.fov.f64("point.speed") * push).clamp(-1.0, 1.0);
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(GOAL_STATE, &[self.goal]);
        self.fov.write(FACTORS, out);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        out.write(STATE, &[self.position]);
        let last = self.spec.fields.len() - 1;
        if self.spec.fields[last].name == "pixels" {
            let width = self.spec.fields[last].shape[1];
            let pixels: &mut [u8] = out.at(last);
            pixels.fill(255);
            // The goal in gray, the point over it.
            for (place, color) in [(self.goal, [180; 3]), (self.position, self.fov.rgb("point.color"))] {
                let column = ((place + 1.0) / 2.0 * (width - 1) as f64).round() as usize;
                for line in pixels.chunks_exact_mut(3 * width) {
                    line[3 * column..][..3].copy_from_slice(&color);
                }
            }
        }
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        let saved = Saved { fov: self.fov.save(), position: self.position, goal: self.goal };
        state.store(&self.spec.id, &saved)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        let saved: Saved = state.load(&self.spec.id)?;
        self.fov = self.space.recall(&saved.fov)?;
        (self.position, self.goal) = (saved.position, saved.goal);
        Ok(())
    }

    /// What planners on the true dynamics minimize.
    fn task_cost(&self) -> Option<f64> {
        Some((self.position - self.goal).abs())
    }
}
