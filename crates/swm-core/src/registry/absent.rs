//! Names that exist, but not in every build.

use super::Entry;

/// Something that a build lacks because it was made without a feature, so that a message can say which.
///
/// ```
/// use swm_core::registry::{Absent, Registry};
/// use swm_core::{EnvEntry, testing::TOY};
///
/// const ABSENT: &[Absent] = &[Absent::of::<EnvEntry>("demo/Rocket-v0", "rockets", "cargo add demo --features rockets")];
/// let error = Registry::new().with(&[TOY]).with(ABSENT).env("demo/Rocket-v0").unwrap_err().to_string();
/// assert!(error.contains("the feature `rockets`") && error.contains("cargo add"), "{error}");
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Absent {
    /// What it would be: [`Entry::KIND`].
    pub(super) kind: &'static str,
    pub(super) name: &'static str,
    pub(super) feature: &'static str,
    pub(super) command: &'static str,
}

impl Absent {
    /// The entry `name` of a kind, the feature that brings it, and a command that builds with it.
    pub const fn of<T: Entry>(name: &'static str, feature: &'static str, command: &'static str) -> Self {
        Self { kind: T::KIND, name, feature, command }
    }
}

impl Entry for Absent {
    const KIND: &'static str = "absent name";
    const COMMAND: &'static str = "--version";

    fn name(&self) -> &'static str {
        self.name
    }

    /// A policy and a model may share a name.
    fn is_taken_by(&self, other: &Self) -> bool {
        self.kind == other.kind
    }
}
