//! Which episodes to run, how each is reset, and how to stop early.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::batch::Value;
use crate::env::ResetOptions;
use crate::error::WorldError;

/// Which episodes to run, and how each is reset.
///
/// ```
/// use swm_core::Rollout;
///
/// let rollout = Rollout::new(0..16).seed(42).vary(["agent", "block.color"]).set("agent.color", [255, 0, 0]);
/// assert_eq!((rollout.episodes, rollout.seed), (0..16, 42));
/// ```
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Rollout {
    /// Episode indices. Running `0..10` and then `10..20` gives what `0..20` gives.
    pub episodes: Range<u64>,
    /// The run's seed.
    pub seed: u64,
    resets: Resets,
    cancel: Option<Cancel>,
}

#[derive(Clone, Debug)]
enum Resets {
    /// The same for all episodes.
    Same(ResetOptions),
    /// One per episode, by episode index.
    Each(Vec<ResetOptions>),
}

impl Rollout {
    /// These episodes of the run with seed 0, reset by the environment's defaults.
    pub fn new(episodes: Range<u64>) -> Self {
        let resets = Resets::Same(ResetOptions::default());
        Self { episodes, seed: 0, resets, cancel: None }
    }

    /// Sets the run's seed.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = seed;
        self
    }

    /// Samples these factors of variation in every episode: as [`ResetOptions::vary`].
    #[must_use]
    pub fn vary<S: AsRef<str>>(mut self, names: impl IntoIterator<Item = S>) -> Self {
        let names: Vec<S> = names.into_iter().collect();
        for options in self.resets.all_mut() {
            *options = std::mem::take(options).vary(&names);
        }
        self
    }

    /// Sets one factor of variation in every episode: as [`ResetOptions::set`].
    #[must_use]
    pub fn set(mut self, factor: &str, value: impl Into<Value>) -> Self {
        let value = value.into();
        for options in self.resets.all_mut() {
            options.variation_values.insert(factor.to_owned(), value.clone());
        }
        self
    }

    /// Resets every episode by `options`, in place of what was asked before.
    #[must_use]
    pub fn options(mut self, options: ResetOptions) -> Self {
        self.resets = Resets::Same(options);
        self
    }

    /// Resets each episode by its own options, by episode index: `[episodes.end]` of them or more.
    #[must_use]
    pub fn each(mut self, options: impl Into<Vec<ResetOptions>>) -> Self {
        self.resets = Resets::Each(options.into());
        self
    }

    /// Ends the run with [`WorldError::Cancelled`] once `cancel` says so. What was committed until then stays.
    #[must_use]
    pub fn cancel(mut self, cancel: impl Into<Cancel>) -> Self {
        self.cancel = Some(cancel.into());
        self
    }

    /// The reset options, if all episodes share them.
    pub fn shared_options(&self) -> Option<&ResetOptions> {
        match &self.resets {
            Resets::Same(options) => Some(options),
            Resets::Each(_) => None,
        }
    }

    /// All reset options: one, or one per episode by index.
    pub fn all_options(&self) -> &[ResetOptions] {
        match &self.resets {
            Resets::Same(options) => std::slice::from_ref(options),
            Resets::Each(all) => all,
        }
    }

    pub(crate) fn options_of(&self, episode: u64) -> &ResetOptions {
        match &self.resets {
            Resets::Same(options) => options,
            Resets::Each(all) => &all[episode as usize],
        }
    }

    pub(crate) fn cancelled_by(&self) -> Option<&Cancel> {
        self.cancel.as_ref()
    }

    /// Refuses fewer reset options than episodes.
    pub(crate) fn check(&self) -> Result<(), WorldError> {
        match &self.resets {
            Resets::Each(all) if (all.len() as u64) < self.episodes.end => Err(WorldError::Option {
                option: "each",
                reason: format!("{} reset options for episodes {:?}", all.len(), self.episodes),
            }),
            _ => Ok(()),
        }
    }
}

impl Resets {
    fn all_mut(&mut self) -> &mut [ResetOptions] {
        match self {
            Resets::Same(options) => std::slice::from_mut(options),
            Resets::Each(all) => all,
        }
    }
}

/// Asks a run to stop, from another thread or a signal handler. Clones share one flag.
#[derive(Clone, Debug, Default)]
pub struct Cancel(Arc<AtomicBool>);

impl Cancel {
    /// A flag that is not set.
    pub fn new() -> Self {
        Self::default()
    }

    /// Asks to stop.
    pub fn cancel(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether somebody asked to stop.
    pub fn is_cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

impl From<Arc<AtomicBool>> for Cancel {
    fn from(flag: Arc<AtomicBool>) -> Self {
        Self(flag)
    }
}

impl From<&Cancel> for Cancel {
    fn from(cancel: &Cancel) -> Self {
        cancel.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::TOY;
    use crate::{World, WorldOptions, policies};

    #[test]
    fn factors_are_asked_for_in_all_episodes() {
        let rollout = Rollout::new(0..2).each(vec![ResetOptions::default(); 2]).vary(["agent"]).set("x", 0.5);
        assert!(rollout.shared_options().is_none());
        for options in rollout.all_options() {
            assert_eq!(options.variation.as_deref(), Some(&["agent".to_owned()][..]));
            assert_eq!(options.variation_values["x"], Value::scalar(0.5));
        }
        assert!(rollout.check().is_ok());
    }

    #[test]
    fn missing_options_are_refused() {
        let message = |rollout: Rollout| rollout.check().unwrap_err().to_string();
        assert!(message(Rollout::new(0..3).each(vec![ResetOptions::default()])).contains("1 reset options"));
    }

    #[test]
    fn none_stands_alone() {
        let mut world = World::new(&TOY, WorldOptions::new(1)).unwrap();
        let mixed = ResetOptions::default().vary(["none", "point.gain"]);
        let message = world.reset(1, &mixed).unwrap_err().to_string();
        assert!(message.contains("swm/Toy-v0") && message.contains("leave out `none`"), "{message}");
        world.set_policy(policies::random()).unwrap();
        let mixed = Rollout::new(0..1).vary(["point.gain"]).vary(["all", "none"]);
        let message = world.evaluate(&mixed).unwrap_err().to_string();
        assert!(message.contains("(point.gain, all, none)"), "{message}");
        for alone in [vec!["none"], vec!["point.gain"], vec![]] {
            assert!(world.reset(1, &ResetOptions::default().vary(&alone)).is_ok(), "{alone:?}");
        }
    }

    #[test]
    fn rollouts_ask_as_single_resets_do() {
        for names in [vec!["none"], vec!["agent", "+block.color"], vec!["none", "agent"], vec![]] {
            let options = ResetOptions::default().vary(&names).set("x", [1, 2]).set("shape", "square");
            let rollout = Rollout::new(0..1).vary(&names).set("x", [1, 2]).set("shape", "square");
            assert_eq!(rollout.shared_options(), Some(&options), "{names:?}");
        }
    }
}
