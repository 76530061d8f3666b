//! Rows that come from elsewhere than a [`World`](crate::World), such as a robot's sensors, as policies and planners see rows.

use crate::batch::{Batch, RowsMut, Slice};
use crate::env::{Env, EnvSpec, EnvState, Episode, Outcome};
use crate::error::{BatchError, EnvError};
use crate::policy::View;
use crate::run::{LiveEpisode, Progress, Slot};
use crate::space::Space;
use crate::threads::Threads;

/// The episodes of N rows without environments. Whoever has the rows says when an episode begins and when a step is over;
/// [`Observations::view`] is what a policy or planner sees.
///
/// ```
/// use swm_core::{Batch, Dtype, Field, LiveEpisode, Observations, Schema, Space};
///
/// let mut source = Observations::new(Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0), 1);
/// let mut rows = Batch::new(Schema::new(vec![Field::step("state", Dtype::F64, &[2])])?, 1);
/// source.begin(0, LiveEpisode::of(42, 0));
/// rows.get_mut::<f64>("state")?.copy_from_slice(&[0.5, 0.0]);
/// assert_eq!(source.view(&rows)?.live().count(), 1);
/// source.advance();
/// # Ok::<(), swm_core::BatchError>(())
/// ```
pub struct Observations {
    spec: EnvSpec,
    slots: Vec<Slot>,
    threads: Threads,
}

impl Observations {
    /// The id in the [description](View::spec) of such rows.
    pub const ID: &'static str = "rows without an environment";

    /// `rows` rows, for each of which actions of `action` are chosen. No episode has begun.
    pub fn new(action: Space, rows: usize) -> Self {
        let spec = EnvSpec::new(Self::ID, action, Vec::new());
        let slots = (0..rows).map(|_| Slot::new(Box::new(NoEnv(spec.clone())))).collect();
        Self { spec, slots, threads: Threads::one() }
    }

    /// The space of one action.
    pub fn action(&self) -> &Space {
        &self.spec.action
    }

    /// Begins an episode in `row`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn begin(&mut self, row: usize, episode: LiveEpisode) {
        self.slots[row].progress = Some(Progress::start(episode, None));
    }

    /// The actions for the last view were taken: all live rows are one step further.
    pub fn advance(&mut self) {
        for progress in self.slots.iter_mut().filter_map(|slot| slot.progress.as_mut()) {
            progress.episode.step += 1;
        }
    }

    /// What a policy or planner sees of `infos`, `[N]` rows.
    ///
    /// # Errors
    ///
    /// [`BatchError::WrongValue`]: another number of rows.
    pub fn view<'a>(&'a self, infos: &'a Batch) -> Result<View<'a>, BatchError> {
        let (expected, found) = (self.slots.len(), infos.rows());
        if expected != found {
            let [expected, found] = [expected, found].map(|rows| format!("{rows} rows"));
            return Err(BatchError::WrongValue { name: "the observation".to_owned(), expected, found });
        }
        let Self { spec, slots, threads } = self;
        Ok(View { infos, spec, slots, seed: 0, threads, cancel: None })
    }
}

/// In place of an environment where there is none.
struct NoEnv(EnvSpec);

impl NoEnv {
    fn refuse<T>() -> Result<T, EnvError> {
        let reason =
            "the rows come from elsewhere than a world, so there is no environment to simulate".into();
        Err(EnvError::State { env: Observations::ID.to_owned(), reason })
    }
}

impl Env for NoEnv {
    fn spec(&self) -> &EnvSpec {
        &self.0
    }

    fn reset(&mut self, _episode: &Episode<'_>) -> Result<Outcome, EnvError> {
        Self::refuse()
    }

    fn step(&mut self, _action: Slice<'_>) -> Result<Outcome, EnvError> {
        Self::refuse()
    }

    fn write_episode(&mut self, _out: &mut RowsMut<'_>) {}

    fn observe(&mut self, _out: &mut RowsMut<'_>) {}

    fn snapshot(&self, _state: &mut EnvState) -> Result<(), EnvError> {
        Self::refuse()
    }

    fn restore(&mut self, _state: &EnvState) -> Result<(), EnvError> {
        Self::refuse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Dtype, Field, Schema};

    #[test]
    fn rows_are_live_from_their_beginning_and_have_no_environment() {
        let mut source = Observations::new(Space::uniform_box(Dtype::F32, &[1], -1.0, 1.0), 2);
        let schema = Schema::new(vec![Field::step("state", Dtype::F64, &[1])]).unwrap();
        let rows = Batch::new(schema.clone(), 2);
        assert_eq!(source.view(&rows).unwrap().live().count(), 0);
        source.begin(1, LiveEpisode::of(42, 3));
        source.advance();
        let view = source.view(&rows).unwrap();
        let episode = view.row(1).expect("it has begun").episode;
        assert_eq!((view.live().collect::<Vec<_>>(), episode.index, episode.step), (vec![1], 3, 1));
        let refused = view.row(1).unwrap().snapshot(&mut EnvState::new()).unwrap_err().to_string();
        assert!(refused.contains("no environment to simulate"), "{refused}");
        let refused = source.view(&Batch::new(schema, 3)).err().expect("one row too many").to_string();
        assert_eq!(refused, "`the observation` must be 2 rows, found 3 rows");
    }
}
