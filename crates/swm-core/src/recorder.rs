//! Recorders watch the rollout loop: datasets, evaluations, videos and progress bars are recorders, and tuples of
//! recorders are recorders.

use std::fmt;

use crate::batch::Row;
use crate::env::Env;
use crate::error::BoxError;
use crate::run::{EpisodeEnd, LiveEpisode, RunInfo};

/// Watches a run. Every row of the data is shown exactly once, in the order of steps within an episode: first
/// observation with its action, …, last observation without an action; then the episode's end.
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{BoxError, EpisodeEnd, LiveStep, Recorder, Rollout, World, WorldOptions, policies};
///
/// /// Counts the rows in which the point is right of the middle.
/// #[derive(Default)]
/// struct Right(usize);
///
/// impl Recorder for Right {
///     fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
///         self.0 += usize::from(row.values.get::<f64>("state")?[0] > 0.0);
///         Ok(())
///     }
///     fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
///         Ok(())
///     }
/// }
///
/// let mut world = World::new(&TOY, WorldOptions::new(1).max_episode_steps(20))?;
/// world.set_policy(policies::random())?;
/// let mut right = Right::default();
/// world.run(&Rollout::new(0..4).seed(42), &mut right)?;
/// assert!(right.0 > 0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Recorder: Send {
    /// Once the first episodes are reset and have their first actions, so that a request that cannot be met leaves no
    /// file behind.
    ///
    /// # Errors
    ///
    /// Any ends the run, as [`WorldError::Record`](crate::error::WorldError::Record).
    fn start(&mut self, _run: &RunInfo<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    /// One row of one environment.
    ///
    /// # Errors
    ///
    /// As of [`Recorder::start`].
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError>;

    /// An episode is over; its last row has been shown.
    ///
    /// # Errors
    ///
    /// As of [`Recorder::start`].
    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError>;

    /// After the last episode.
    ///
    /// # Errors
    ///
    /// As of [`Recorder::start`].
    fn finish(&mut self) -> Result<(), BoxError> {
        Ok(())
    }
}

/// One row of data, while it is true.
#[derive(Clone, Copy)]
pub struct LiveStep<'a> {
    /// Its values.
    pub values: Row<'a>,
    /// The episode it belongs to; `step` is the row's index in the episode.
    pub episode: LiveEpisode,
    /// Whether the goal is reached in this row.
    pub success: Option<bool>,
    pub(crate) env: &'a dyn Env,
}

impl LiveStep<'_> {
    /// How far the task is from done, in truth: [`Env::task_cost`].
    pub fn task_cost(&self) -> Option<f64> {
        self.env.task_cost()
    }
}

impl fmt::Debug for LiveStep<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { values, episode, success, env: _ } = self;
        f.debug_struct("LiveStep")
            .field("values", values)
            .field("episode", episode)
            .field("success", success)
            .finish_non_exhaustive()
    }
}

/// Watches nothing.
impl Recorder for () {
    fn step(&mut self, _row: &LiveStep<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}

macro_rules! forward {
    () => {
        fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
            (**self).start(run)
        }
        fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
            (**self).step(row)
        }
        fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
            (**self).episode(end)
        }
        fn finish(&mut self) -> Result<(), BoxError> {
            (**self).finish()
        }
    };
}

impl<R: Recorder + ?Sized> Recorder for &mut R {
    forward!();
}

impl<R: Recorder + ?Sized> Recorder for Box<R> {
    forward!();
}

macro_rules! tuple {
    ($($name:ident: $index:tt),*) => {
        impl<$($name: Recorder),*> Recorder for ($($name,)*) {
            fn start(&mut self, run: &RunInfo<'_>) -> Result<(), BoxError> {
                $(self.$index.start(run)?;)*
                Ok(())
            }
            fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
                $(self.$index.step(row)?;)*
                Ok(())
            }
            fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
                $(self.$index.episode(end)?;)*
                Ok(())
            }
            fn finish(&mut self) -> Result<(), BoxError> {
                $(self.$index.finish()?;)*
                Ok(())
            }
        }
    };
}

tuple!(A: 0, B: 1);
tuple!(A: 0, B: 1, C: 2);
tuple!(A: 0, B: 1, C: 2, D: 3);
