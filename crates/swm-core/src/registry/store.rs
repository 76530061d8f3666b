//! Tables of several crates, merged.

use std::any::Any;
use std::collections::BTreeSet;
use std::iter;

use super::{Absent, BASIC_POLICIES, Entry, EnvEntry, PolicyArgs, PolicyContext, PolicyEntry};
use crate::error::{PolicyError, UnknownName, nearest};
use crate::evaluate::ModelEntry;
use crate::policy::Policy;

/// Environments, policies and other entries of several crates, merged.
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{EnvEntry, Registry, World, WorldOptions};
///
/// static ENVS: [EnvEntry; 1] = [TOY]; // a crate of environments has such a table
/// let registry = Registry::new().with(&ENVS);
/// let env = registry.env("swm/Toy-v0")?;
/// assert!(registry.env("swm/Toi-v0").unwrap_err().to_string().contains("did you mean `swm/Toy-v0`?"));
///
/// let mut world = World::new(env, WorldOptions::default())?;
/// world.set_policy(registry.policy("ou:sigma=0.3", &world)?)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Registry {
    entries: Vec<&'static (dyn Any + Send + Sync)>,
}

impl Default for Registry {
    fn default() -> Self {
        Self::new()
    }
}

impl Registry {
    /// Knows the policies that fit every environment, and nothing else yet.
    pub fn new() -> Self {
        Self { entries: Vec::new() }.with(BASIC_POLICIES)
    }

    /// Adds a table: of environments, policies, or any other kind of entry, and [what comes with it](Entry::with_parts).
    ///
    /// # Panics
    ///
    /// Another entry of this kind has the same name: one of the two could never be found.
    #[must_use]
    pub fn with<T: Entry>(mut self, table: &'static [T]) -> Self {
        for entry in table {
            let has_name = |other: &&T| names(*other).any(|name| names(entry).any(|own| own == name));
            let taken = self.all::<T>().filter(has_name).find(|other| entry.is_taken_by(other));
            if let Some(taken) = taken {
                panic!("{} `{}`: `{}` has its name already", T::KIND, entry.name(), taken.name());
            }
            self.entries.push(entry);
            self = entry.with_parts(self);
        }
        self
    }

    /// All entries of a kind, in the order of their tables.
    pub fn all<T: Entry>(&self) -> impl Iterator<Item = &'static T> {
        self.entries.iter().filter_map(|&entry| (entry as &'static dyn Any).downcast_ref())
    }

    /// The entry of a kind with this name or alias.
    ///
    /// ```
    /// use swm_core::testing::TOY;
    /// use swm_core::{EnvEntry, Registry};
    ///
    /// const ENVS: &[EnvEntry] = &[TOY];
    /// let registry = Registry::new().with(ENVS);
    /// assert_eq!(registry.find::<EnvEntry>(TOY.id)?.id, TOY.id);
    /// # Ok::<(), swm_core::UnknownName>(())
    /// ```
    ///
    /// # Errors
    ///
    /// No table has it; the error names the nearest that one has.
    pub fn find<T: Entry>(&self, name: &str) -> Result<&'static T, UnknownName> {
        self.get(name).ok_or_else(|| self.unknown::<T>(name, self.all::<T>().flat_map(names)))
    }

    fn get<T: Entry>(&self, name: &str) -> Option<&'static T> {
        self.all::<T>().find(|entry| names(*entry).any(|known| known == name))
    }

    /// The environment with this id.
    ///
    /// # Errors
    ///
    /// As of [`Registry::find`].
    pub fn env(&self, id: &str) -> Result<&'static EnvEntry, UnknownName> {
        self.find(id)
    }

    /// All environments, in the order of their tables.
    pub fn envs(&self) -> impl Iterator<Item = &'static EnvEntry> {
        self.all()
    }

    /// The policies of an environment: its own, then those that are for environments like it, then the general ones.
    pub fn policies(&self, env: &EnvEntry) -> impl Iterator<Item = &'static PolicyEntry> {
        let like_it = self.all::<PolicyEntry>().filter(|entry| entry.fits.is_some_and(|fits| fits(env)));
        let general = self.all::<PolicyEntry>().filter(|entry| entry.fits.is_none());
        let mut seen = BTreeSet::new();
        env.policies.iter().chain(like_it).chain(general).filter(move |entry| seen.insert(entry.name))
    }

    /// The policy of an environment with this name.
    ///
    /// # Errors
    ///
    /// As of [`Registry::find`].
    pub fn policy_entry(&self, env: &EnvEntry, name: &str) -> Result<&'static PolicyEntry, UnknownName> {
        let found = self.policies(env).find(|entry| entry.name == name);
        found.ok_or_else(|| {
            let unknown = self.unknown::<PolicyEntry>(name, self.policies(env).map(|entry| entry.name));
            let planner = || self.all::<ModelEntry>().find(|entry| entry.name == name)?.planned_by;
            let plan = |policy| format!("it is a model; to plan with a trained one, use `{policy}`");
            let fix = unknown.fix.or_else(|| planner().map(plan));
            UnknownName { command: format!("{} {}", unknown.command, env.id), fix, ..unknown }
        })
    }

    fn unknown<T: Entry>(&self, name: &str, known: impl Iterator<Item = &'static str>) -> UnknownName {
        let is_absent = |absent: &&Absent| absent.kind == T::KIND && absent.name == name;
        let fix = self.all::<Absent>().find(is_absent).map(|&Absent { feature, command, .. }| {
            format!("this program was built without the feature `{feature}`, which brings it: {command}")
        });
        UnknownName {
            kind: T::KIND,
            name: name.to_owned(),
            nearest: nearest(name, known),
            fix,
            command: T::COMMAND.to_owned(),
        }
    }

    /// Makes a policy for a world, or for the environments of a [`PolicyContext`], from its name and arguments:
    /// `weak`, `cem:samples=100`.
    ///
    /// # Errors
    ///
    /// No policy has this name, an argument is unknown or out of its bounds, or the policy does not fit the environment.
    pub fn policy<'a>(
        &'a self,
        text: &str,
        context: impl Into<PolicyContext<'a>>,
    ) -> Result<Box<dyn Policy>, PolicyError> {
        self.policy_from(&PolicyArgs::parse(text)?, context)
    }

    /// As [`Registry::policy`], from arguments that have been read before.
    ///
    /// # Errors
    ///
    /// As of [`Registry::policy`].
    pub fn policy_from<'a>(
        &'a self,
        args: &PolicyArgs,
        context: impl Into<PolicyContext<'a>>,
    ) -> Result<Box<dyn Policy>, PolicyError> {
        let context = context.into().within(self);
        let entry = self.policy_entry(context.env, &args.name);
        entry.map_err(|error| PolicyError::Other(Box::new(error)))?.make(&context, args)
    }
}

fn names<T: Entry>(entry: &T) -> impl Iterator<Item = &'static str> + use<T> {
    iter::once(entry.name()).chain(entry.aliases().iter().copied())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::env::EnvConfig;
    use crate::testing::TOY;

    /// A kind of entry that another crate defines.
    #[derive(Debug)]
    struct Shape(&'static str, &'static [&'static str]);

    impl Entry for Shape {
        const KIND: &'static str = "shape";
        const COMMAND: &'static str = "shapes";

        fn name(&self) -> &'static str {
            self.0
        }

        fn aliases(&self) -> &'static [&'static str] {
            self.1
        }
    }

    #[test]
    fn entries_of_any_kind_are_found_by_name_and_alias() {
        let registry = Registry::new().with(&[TOY]).with(&[Shape("disc", &["circle"]), Shape("box", &[])]);
        assert_eq!(registry.find::<Shape>("circle").unwrap().0, "disc");
        assert_eq!(registry.all::<Shape>().map(Entry::name).collect::<Vec<_>>(), ["disc", "box"]);
        let error = registry.find::<Shape>("cirle").unwrap_err().to_string();
        assert_eq!(error, "unknown shape `cirle` (did you mean `circle`?); `swm shapes` lists them");
        assert!(registry.find::<Shape>(TOY.id).is_err(), "kinds do not share names");
    }

    #[test]
    #[should_panic(expected = "shape `box`: `disc` has its name already")]
    fn a_name_is_taken_once() {
        let _ = Registry::new().with(&[Shape("disc", &["box"]), Shape("box", &[])]);
    }

    #[test]
    fn policies_for_one_environment_come_before_the_general_ones() {
        const OWN: PolicyEntry = PolicyEntry::new("own", "", |_, args| Err(args.wrong("own")));
        const LIKE: PolicyEntry = PolicyEntry::new("own", "", |_, args| Err(args.wrong("like")))
            .only_for(|env| env.planner.is_some());
        const ENV: EnvEntry = EnvEntry::new("swm/Own-v0", "", |config| TOY.make(config)).planner("cem");
        const BOTH: EnvEntry = ENV.policies(&[OWN]);
        let registry = Registry::new().with(&[LIKE]);
        let message = |env: &EnvEntry| {
            let config = EnvConfig::default();
            registry.policy("own", PolicyContext::new(env, &config)).err().unwrap().to_string()
        };
        assert!(message(&TOY).contains("unknown policy `own`"), "{}", message(&TOY));
        assert!(message(&ENV).contains("like"), "{}", message(&ENV));
        assert!(message(&BOTH).contains("own"), "{}", message(&BOTH));
        assert_eq!(registry.policies(&BOTH).filter(|entry| entry.name == "own").count(), 1);
        assert_eq!(registry.policies(&ENV).next().map(|entry| entry.name), Some("own"));
    }
}
