//! Policies: what chooses actions. A policy sees all rows at once; an actor, wrapped in [`PerEpisode`], sees one.

use std::any::Any;
use std::sync::Arc;

use rand_distr::{Distribution as _, StandardNormal};

use crate::batch::{Batch, Column, Element, Field, Row, SliceMut};
use crate::env::{Env, EnvSpec, EnvState};
use crate::error::{EnvError, PolicyError};
use crate::run::{Cancel, LiveEpisode, Slot};
use crate::seed::EpisodeSeed;
use crate::space::Space;
use crate::threads::{Pace, Threads};

/// Chooses one action per live environment.
pub trait Policy: Send {
    /// A short name with its settings, for reports: `cem:samples=300`.
    fn describe(&self) -> String;

    /// Step fields of its own, next to the actions, such as the figures of a planner. Asked when it is attached
    /// ([`crate::World::set_policy`]); they stand in the infos behind all others and are recorded with them.
    fn fields(&self) -> Vec<Field> {
        Vec::new()
    }

    /// Writes an action for every row of `view.live()`. Other rows are ignored.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Unsupported`]: the view lacks what the policy needs. Whatever else it may meet ends the run.
    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError>;

    /// Whether `act` divides its work by rayon, as planners do: it is then called on the world's threads, else on the
    /// caller's.
    fn is_parallel(&self) -> bool {
        true
    }

    /// Divides the policy for a run in which it acts in each of `rows` environments by itself: one part for each, in their order,
    /// which goes on with the episode that it is in. The environments then run on different threads and do not wait for each
    /// other. `None`: the policy wants to see them all at once, or keeps something for all of them.
    fn divide(&mut self, _rows: usize) -> Option<Vec<Box<dyn Policy>>> {
        None
    }

    /// Downcast hook: lets callers attach a trace to a planner. A policy that wraps a planner returns the planner. Default: `None`.
    fn as_any(&mut self) -> Option<&mut dyn Any> {
        None
    }
}

impl Policy for Box<dyn Policy> {
    fn describe(&self) -> String {
        (**self).describe()
    }

    fn fields(&self) -> Vec<Field> {
        (**self).fields()
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        (**self).act(view, actions)
    }

    fn is_parallel(&self) -> bool {
        (**self).is_parallel()
    }

    fn divide(&mut self, rows: usize) -> Option<Vec<Box<dyn Policy>>> {
        (**self).divide(rows)
    }

    fn as_any(&mut self) -> Option<&mut dyn Any> {
        (**self).as_any()
    }
}

/// What a policy sees: the infos of every environment, and which episode each is in.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub(crate) infos: &'a Batch,
    pub(crate) spec: &'a EnvSpec,
    pub(crate) slots: &'a [Slot],
    /// Seed of the policy's own noise; 0: that of the episodes.
    pub(crate) seed: u64,
    pub(crate) threads: &'a Threads,
    pub(crate) cancel: Option<&'a Cancel>,
}

impl<'a> View<'a> {
    /// The infos: row = environment.
    pub fn infos(&self) -> &'a Batch {
        self.infos
    }

    /// The environment's description.
    pub fn spec(&self) -> &'a EnvSpec {
        self.spec
    }

    /// The number of rows, live or not.
    pub fn rows(&self) -> usize {
        self.slots.len()
    }

    /// The rows that need an action.
    pub fn live(&self) -> impl Iterator<Item = usize> + 'a {
        self.slots.iter().enumerate().filter(|(_, slot)| slot.is_live()).map(|(row, _)| row)
    }

    /// What ends the run early, for policies that think for long: they stop with any error once it is set.
    pub fn cancel(&self) -> Option<&'a Cancel> {
        self.cancel
    }

    /// One live row; `None` for an idle one.
    pub fn row(&self, row: usize) -> Option<SlotView<'a>> {
        let slot = &self.slots[row];
        let mut episode = slot.live_episode()?;
        if self.seed != 0 {
            episode.seed = EpisodeSeed::of(self.seed, episode.seed.value() as u64);
        }
        Some(SlotView { row: self.infos.row(row), spec: self.spec, env: slot.env(), episode })
    }
}

/// One live environment, as an actor sees it.
#[derive(Clone, Copy)]
pub struct SlotView<'a> {
    /// Its row of the infos.
    pub row: Row<'a>,
    /// The environment's description.
    pub spec: &'a EnvSpec,
    /// Where it is in the run.
    pub episode: LiveEpisode,
    env: &'a dyn Env,
}

impl SlotView<'_> {
    /// Saves the true state of the environment, for policies that simulate it.
    ///
    /// # Errors
    ///
    /// As of [`Env::snapshot`].
    pub fn snapshot(&self, state: &mut EnvState) -> Result<(), EnvError> {
        self.env.snapshot(state)
    }
}

/// The actions of all rows, to be written: `[N, …action shape]` of the action space's type.
pub struct Actions<'a> {
    pub(crate) space: &'a Space,
    pub(crate) column: &'a mut Column,
    pub(crate) report: &'a mut Batch,
}

impl Actions<'_> {
    /// The space of one action.
    pub fn space(&self) -> &Space {
        self.space
    }

    /// The action of one row.
    pub fn row(&mut self, row: usize) -> SliceMut<'_> {
        let dim = self.space.dim();
        let (_, rest) = self.column.as_slice_mut().split_at(row * dim);
        rest.split_at(dim).0
    }

    /// Writes field `field` of [`Policy::fields`] for one row. What is not written at a step is missing in it: NaN, or
    /// -1 for integers.
    ///
    /// # Panics
    /// If the policy has no such field, or one of another type or dim: both are its own.
    pub fn report<T: Element>(&mut self, row: usize, field: usize, values: &[T]) {
        self.report.rows_mut().select(row).write(field, values);
    }
}

/// Writes numbers as an action of any type: rounded to the nearest number that the type holds.
///
/// # Panics
///
/// If there are more or fewer `values` than the environment's action has. A policy that is also used with other environments compares
/// with `view.spec.action` first, and returns a [`PolicyError`].
pub fn write_action(action: &mut SliceMut<'_>, values: &[f32]) {
    assert!(
        action.len() == values.len(),
        "the environment's action has {} value(s), and the policy writes {}: write one for each value of the shape that \
         `view.spec.action` has, or return a `PolicyError` where the policy is of another environment",
        action.len(),
        values.len()
    );
    match action {
        SliceMut::F32(out) => out.copy_from_slice(values),
        SliceMut::F64(out) => out.iter_mut().zip(values).for_each(|(out, &v)| *out = f64::from(v)),
        SliceMut::I64(out) => out.iter_mut().zip(values).for_each(|(out, &v)| *out = v.round() as i64),
        _ => unreachable!("action spaces are boxes or integers"),
    }
}

/// Adds normal noise of this std to the values of an action. 0: none is sampled. `purpose` names the random stream of the
/// episode; every step has its own part of it.
pub fn add_noise(view: &SlotView<'_>, purpose: &str, std: f64, values: &mut [f64]) {
    if std > 0.0 {
        let mut stream = view.episode.seed.indexed(purpose, [view.episode.step, 0]);
        for value in values {
            let normal: f64 = StandardNormal.sample(&mut stream);
            *value += std * normal;
        }
    }
}

/// Chooses actions for one environment during one episode. Its state belongs to that episode.
pub trait Actor: Send {
    /// Writes the action for the current step.
    ///
    /// # Errors
    ///
    /// As of [`Policy::act`].
    fn act(&mut self, view: &SlotView<'_>, action: SliceMut<'_>) -> Result<(), PolicyError>;
}

/// A policy of independent actors, one made for each episode, which act in parallel.
pub struct PerEpisode<F> {
    description: String,
    make: Arc<F>,
    actors: Vec<Option<(u64, Box<dyn Actor>)>>,
    pace: Pace,
}

impl<F> PerEpisode<F>
where
    F: Fn(&SlotView<'_>) -> Result<Box<dyn Actor>, PolicyError> + Send + Sync,
{
    /// `make` is called at the first step of every episode.
    pub fn new(description: impl Into<String>, make: F) -> Self {
        let (description, make) = (description.into(), Arc::new(make));
        Self { description, make, actors: Vec::new(), pace: Pace::default() }
    }
}

impl<F> Policy for PerEpisode<F>
where
    F: Fn(&SlotView<'_>) -> Result<Box<dyn Actor>, PolicyError> + Send + Sync + 'static,
{
    fn describe(&self) -> String {
        self.description.clone()
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        self.actors.resize_with(view.rows(), || None);
        let Self { make, actors, pace, .. } = self;
        let actions = actions.column.as_slice_mut();
        pace.learn(actors.len(), view.threads, |part| act_all(actors, actions, 0, part, view, &**make))
    }

    fn is_parallel(&self) -> bool {
        false
    }

    fn divide(&mut self, rows: usize) -> Option<Vec<Box<dyn Policy>>> {
        self.actors.resize_with(rows, || None);
        let Self { description, make, actors, .. } = self;
        let part = |actor| Self {
            description: description.clone(),
            make: Arc::clone(make),
            actors: vec![actor],
            pace: Pace::default(),
        };
        Some(actors.drain(..).map(|actor| Box::new(part(actor)) as Box<dyn Policy>).collect())
    }
}

/// Halves the slots until at most `part` are left, in parallel where threads are free: no allocation, no locks.
fn act_all<F>(
    actors: &mut [Option<(u64, Box<dyn Actor>)>],
    mut actions: SliceMut<'_>,
    first: usize,
    part: usize,
    view: &View<'_>,
    make: &F,
) -> Result<(), PolicyError>
where
    F: Fn(&SlotView<'_>) -> Result<Box<dyn Actor>, PolicyError> + Send + Sync,
{
    let dim = view.spec.action.dim();
    if actors.len() <= part.max(1) {
        for (offset, slot) in actors.iter_mut().enumerate() {
            let Some(row) = view.row(first + offset) else { continue };
            if view.cancel.is_some_and(Cancel::is_cancelled) {
                return Err(PolicyError::Cancelled);
            }
            if row.episode.step == 0 || slot.as_ref().is_none_or(|(index, _)| *index != row.episode.index) {
                *slot = Some((row.episode.index, make(&row)?));
            }
            let (_, actor) = slot.as_mut().expect("filled above");
            let (_, rest) = actions.reborrow().split_at(offset * dim);
            actor.act(&row, rest.split_at(dim).0)?;
        }
        return Ok(());
    }
    let middle = actors.len() / 2;
    let (left, right) = actors.split_at_mut(middle);
    let (left_actions, right_actions) = actions.split_at(middle * dim);
    let (a, b) = rayon::join(
        || act_all(left, left_actions, first, part, view, make),
        || act_all(right, right_actions, first + middle, part, view, make),
    );
    a.and(b)
}

/// A policy from a function of one environment's view: for scripts and tests.
pub fn scripted<F>(description: impl Into<String>, act: F) -> impl Policy
where
    F: Fn(&SlotView<'_>, &mut SliceMut<'_>) -> Result<(), PolicyError> + Send + Sync + Clone + 'static,
{
    PerEpisode::new(
        description,
        move |_: &SlotView<'_>| Ok(Box::new(Scripted(act.clone())) as Box<dyn Actor>),
    )
}

struct Scripted<F>(F);

impl<F> Actor for Scripted<F>
where
    F: Fn(&SlotView<'_>, &mut SliceMut<'_>) -> Result<(), PolicyError> + Send,
{
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        (self.0)(view, &mut action)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_action_of_another_size_names_both_sizes() {
        let mut actions = [Column::F32(vec![0.0; 2]), Column::F64(vec![0.0; 2]), Column::I64(vec![0; 2])];
        for action in &mut actions {
            write_action(&mut action.as_slice_mut(), &[1.0, 2.0]);
            for values in [&[1.0][..], &[1.0, 2.0, 3.0]] {
                let written =
                    std::panic::AssertUnwindSafe(|| write_action(&mut action.as_slice_mut(), values));
                let panic = std::panic::catch_unwind(written).unwrap_err();
                let message = panic.downcast_ref::<String>().unwrap();
                let sizes = format!("has 2 value(s), and the policy writes {}", values.len());
                assert!(message.contains(&sizes) && message.contains("view.spec.action"), "{message}");
            }
            assert_eq!(action.as_slice().as_f64(1), Some(2.0));
        }
    }
}
