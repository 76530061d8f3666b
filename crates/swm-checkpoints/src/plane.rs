//! The environment of the tests of imports and exports.

use swm_core::{
    Dtype, Env, EnvEntry, EnvError, EnvSpec, EnvState, Episode, Field, Outcome, Registry, RowsMut, Slice,
    Space,
};

/// Two actions, and the state that the golden agents observe.
pub(crate) const PLANE: EnvEntry =
    EnvEntry::new("swm/Plane-v0", "two actions (for tests)", |_| Ok(Box::new(Plane(spec()))));

struct Plane(EnvSpec);

fn spec() -> EnvSpec {
    let action = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
    EnvSpec::new(PLANE.id, action, vec![Field::step("state", Dtype::F32, &[6])]).time_step_s(0.1)
}

impl Env for Plane {
    fn spec(&self) -> &EnvSpec {
        &self.0
    }

    fn reset(&mut self, _episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        Ok(Outcome { reward: f64::NAN, terminated: false, success: None })
    }

    fn step(&mut self, _action: Slice<'_>) -> Result<Outcome, EnvError> {
        Ok(Outcome { reward: 0.0, terminated: false, success: None })
    }

    fn write_episode(&mut self, _out: &mut RowsMut<'_>) {}

    fn observe(&mut self, _out: &mut RowsMut<'_>) {}

    fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        state.store(PLANE.id, &0_u8)
    }

    fn restore(&mut self, _state: &EnvState) -> Result<(), EnvError> {
        Ok(())
    }
}

pub(crate) fn registry() -> Registry {
    Registry::new().with(&[PLANE])
}
