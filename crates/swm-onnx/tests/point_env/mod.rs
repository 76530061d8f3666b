//! The environment that the models of the tests know.

use std::io::Write as _;

use swm_core::{
    Dtype, Env, EnvConfig, EnvEntry, EnvError, EnvSpec, EnvState, Episode, Field, Outcome, RowsMut, Slice,
    Space, World, WorldOptions,
};
use swm_onnx::find_library;

/// A point that moves five times the action; start and goal are those of `make_model.py`.
pub(crate) const POINT: EnvEntry = EnvEntry::new("swm/Point-v0", "a point on a plane (for tests)", |_| {
    Ok(Box::new(Point { spec: spec(), at: START }))
});

const START: [f32; 2] = [60.0, 110.0];
const GOAL: [f32; 2] = [90.0, 80.0];

fn spec() -> EnvSpec {
    EnvSpec::new(
        POINT.id,
        Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0),
        vec![Field::step("state", Dtype::F32, &[2]), Field::episode("goal_state", Dtype::F32, &[2])],
    )
    .time_step_s(0.1)
    .start_columns(&["state"])
    .goal_columns(&["state"])
}

struct Point {
    spec: EnvSpec,
    at: [f32; 2],
}

impl Point {
    fn outcome(&self) -> Outcome {
        let success = (0..2).all(|axis| (self.at[axis] - GOAL[axis]).abs() < 5.0);
        Outcome { reward: 0.0, terminated: success, success: Some(success) }
    }
}

impl Env for Point {
    fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    fn reset(&mut self, _episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        self.at = START;
        Ok(Outcome { reward: f64::NAN, ..self.outcome() })
    }

    fn step(&mut self, action: Slice<'_>) -> Result<Outcome, EnvError> {
        (0..2).for_each(|axis| self.at[axis] += 5.0 * action.as_f64(axis).unwrap_or(0.0) as f32);
        Ok(self.outcome())
    }

    fn write_episode(&mut self, out: &mut RowsMut<'_>) {
        out.write(1, &GOAL);
    }

    fn observe(&mut self, out: &mut RowsMut<'_>) {
        out.write(0, &self.at);
    }

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(POINT.id, &self.at)
    }

    fn restore(&mut self, state: &EnvState) -> Result<(), EnvError> {
        self.at = state.load(POINT.id)?;
        Ok(())
    }
}

/// Whether ONNX Runtime is there; says so if not.
pub(crate) fn is_there() -> bool {
    let found = find_library();
    if let Err(error) = &found {
        // Not `eprintln!`: the test runner would keep it to itself, as the test does not fail.
        let _ = writeln!(std::io::stderr(), "skipped: {error}; `cargo xtask test` fetches it");
    }
    found.is_ok()
}

/// A world of points.
pub(crate) fn world(num_envs: usize) -> World {
    let env = EnvConfig::default();
    let options = WorldOptions::new(num_envs).env(env).max_episode_steps(25);
    World::new(&POINT, options).expect("sound in this test")
}
