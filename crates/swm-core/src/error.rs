//! What can go wrong. Every message names the object, the reason and the fix.

use thiserror::Error;

/// An error of any kind, where the concrete type belongs to another crate.
pub type BoxError = Box<dyn std::error::Error + Send + Sync>;

/// Something is wrong with a table, a field or a value.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BatchError {
    /// Two fields of one schema share a name.
    #[error("two fields are named `{name}`; field names must be unique")]
    DuplicateField {
        /// The name.
        name: String,
    },
    /// A field of an environment or a policy has a name that worlds or datasets use.
    #[error(
        "the field `{name}` has the name of a column that worlds and datasets write themselves; give it another name"
    )]
    ReservedField {
        /// The name.
        name: String,
    },
    /// No field has this name.
    #[error("unknown field `{name}`{}; there are{}", did_you_mean(.nearest.as_deref()), or_none(.known))]
    UnknownField {
        /// The name asked for.
        name: String,
        /// The nearest existing one.
        nearest: Option<String>,
        /// Those that there are.
        known: String,
    },
    /// Type, shape or range do not fit.
    #[error("`{name}` must be {expected}, found {found}")]
    WrongValue {
        /// Field, factor or option.
        name: String,
        /// What it must be.
        expected: String,
        /// What it is.
        found: String,
    },
}

/// An environment cannot be made, reset, stepped, saved or restored.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum EnvError {
    /// A constructor setting is unknown or has a wrong value.
    #[error("environment `{env}`: {reason}")]
    Setting {
        /// Environment id.
        env: String,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// A reset option (factor name, factor value, start or goal) is unusable.
    #[error("cannot reset `{env}`: {reason}")]
    Reset {
        /// Environment id.
        env: String,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// The values that factors have or were given violate a constraint.
    #[error("cannot reset `{env}`: {reason}")]
    Constraint {
        /// Environment id.
        env: String,
        /// The constraint, and the factors involved.
        reason: String,
    },
    /// The simulation left the range in which it means something.
    #[error("`{env}` diverged: {reason}")]
    Diverged {
        /// Environment id.
        env: String,
        /// The quantity that is not finite, and when.
        reason: String,
    },
    /// A saved state belongs to another environment or version, or is damaged.
    #[error("cannot restore a state of `{env}`: {reason}")]
    State {
        /// Environment id.
        env: String,
        /// What is wrong.
        reason: String,
    },
    /// A field or value is wrong.
    #[error(transparent)]
    Batch(#[from] BatchError),
    /// Anything else, such as what a renderer or a library meets. [`EnvError::other`] makes it.
    #[error(transparent)]
    Other(BoxError),
}

impl EnvError {
    /// An error of another type, or a message: `std::fs::read(path).map_err(EnvError::other)?`.
    pub fn other(error: impl Into<BoxError>) -> Self {
        Self::Other(error.into())
    }
}

/// A policy cannot be made or cannot act.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum PolicyError {
    /// An argument is unknown or has a wrong value.
    #[error("policy `{policy}`: {reason}")]
    Argument {
        /// Policy name.
        policy: String,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// The policy needs something that this environment or view does not offer.
    #[error("policy `{policy}` cannot act: {reason}")]
    Unsupported {
        /// Policy name.
        policy: String,
        /// What is missing.
        reason: String,
    },
    /// The run was asked to stop.
    #[error("cancelled")]
    Cancelled,
    /// An environment failed while the policy simulated it.
    #[error(transparent)]
    Env(#[from] EnvError),
    /// A field or value is wrong.
    #[error(transparent)]
    Batch(#[from] BatchError),
    /// Anything else, such as a model.
    #[error(transparent)]
    Other(BoxError),
}

/// A `World` cannot be built or run.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum WorldError {
    /// An option is out of range.
    #[error("`{option}`: {reason}")]
    Option {
        /// Its name.
        option: &'static str,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// A policy is needed and none is set.
    #[error("the world has no policy; call `set_policy` first")]
    NoPolicy,
    /// A step of a run has no actions yet.
    #[error("this step has no actions; call `act` or `set_actions` before `advance`")]
    NoActions,
    /// A step, and no environment that it would step is in an episode.
    #[error("{reason}; call `reset` before the next step")]
    NoEpisode {
        /// Whether none has begun, or all are over.
        reason: &'static str,
    },
    /// The run was asked to stop. Committed episodes stay.
    #[error("cancelled")]
    Cancelled,
    /// Actions of another number or type than the environments take.
    #[error("{reason}")]
    Actions {
        /// What was needed and what was found.
        reason: String,
    },
    /// An action has a wrong value.
    #[error("environment {slot} (episode {episode}, step {step}): {reason}")]
    Action {
        /// Slot of the world.
        slot: usize,
        /// Episode index.
        episode: u64,
        /// Step of the episode.
        step: u64,
        /// What is wrong with the action.
        reason: String,
    },
    /// An environment failed.
    #[error("environment {slot}, episode {episode}: {source}")]
    Env {
        /// Slot of the world.
        slot: usize,
        /// Episode index.
        episode: u64,
        /// The failure.
        source: EnvError,
    },
    /// An environment could not be made.
    #[error(transparent)]
    Make(#[from] EnvError),
    /// The policy failed.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// A recorder failed: writing a dataset, a video or a log.
    #[error("recording failed: {0}")]
    Record(BoxError),
    /// A dataset cannot be read or does not fit the request.
    #[error("dataset: {0}")]
    Dataset(BoxError),
    /// A field or value is wrong.
    #[error(transparent)]
    Batch(#[from] BatchError),
}

impl WorldError {
    /// The error of a policy, recorder or dataset, whole: `source` skips it, because the message is passed on as it is.
    /// A driver finds its own error again by `downcast_ref`.
    pub fn foreign(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Record(error) | Self::Dataset(error) | Self::Policy(PolicyError::Other(error)) => {
                Some(&**error)
            }
            _ => None,
        }
    }
}

/// A name that no table has.
#[derive(Debug, Error)]
#[error("unknown {kind} `{name}`{}", self.hint())]
#[non_exhaustive]
pub struct UnknownName {
    /// What was looked up: environment, policy, format.
    pub kind: &'static str,
    /// The name asked for.
    pub name: String,
    /// The nearest existing one.
    pub nearest: Option<String>,
    /// For a name that other builds know: what brings it.
    pub fix: Option<String>,
    /// The command that lists what exists.
    pub command: String,
}

impl UnknownName {
    fn hint(&self) -> String {
        match &self.fix {
            Some(fix) => format!("; {fix}"),
            None => {
                let meant = did_you_mean(self.nearest.as_deref());
                format!("{meant}; `swm {}` lists them", self.command)
            }
        }
    }
}

/// The closest of `names` to `name`, if it is close enough to be a typing error; else the shortest that `name`, in full
/// or behind its `/`, is a part of.
pub fn nearest<'a>(name: &str, names: impl IntoIterator<Item = &'a str>) -> Option<String> {
    /// Shorter parts are in too many names.
    const PART: usize = 4;
    let fold = |text: &str| text.to_lowercase();
    let wanted = fold(name);
    let names: Vec<&str> = names.into_iter().collect();
    let typed = names
        .iter()
        .map(|candidate| (strsim::damerau_levenshtein(&wanted, &fold(candidate)), candidate))
        .min_by_key(|&(distance, _)| distance)
        .filter(|&(distance, candidate)| {
            let longer = candidate.len().max(wanted.len());
            distance < longer && distance <= 1 + longer / 3
        })
        .map(|(_, candidate)| candidate);
    let part = wanted.rsplit('/').next().filter(|part| part.len() >= PART);
    let whole = || {
        let holds = |candidate: &&&str| part.is_some_and(|part| fold(candidate).contains(part));
        names.iter().filter(holds).min_by_key(|candidate| candidate.len())
    };
    typed.or_else(whole).map(|&candidate| candidate.to_owned())
}

/// ` (did you mean …?)`, or nothing.
pub fn did_you_mean(nearest: Option<&str>) -> String {
    nearest.map(|name| format!(" (did you mean `{name}`?)")).unwrap_or_default()
}

/// Names behind "there are".
fn or_none(names: &str) -> String {
    if names.is_empty() { " none".to_owned() } else { format!(": {names}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_offered_and_far_ones_are_not() {
        let names = ["swm/PushT-v1", "swm/TwoRoom-v1"];
        assert_eq!(nearest("swm/PushTT-v1", names).as_deref(), Some("swm/PushT-v1"));
        assert_eq!(nearest("swm/pusht-v1", names).as_deref(), Some("swm/PushT-v1"));
        assert_eq!(nearest("completely different", names), None);
        assert_eq!(nearest("loud", ["off", "plan", "timed"]), None);
        let long = ["swm/PushT-v1", "swm/CheetahDMControl-v0"];
        assert_eq!(nearest("cheetah", long).as_deref(), Some("swm/CheetahDMControl-v0"));
        assert_eq!(nearest("swm/Cheetah", long).as_deref(), Some("swm/CheetahDMControl-v0"));
    }
}
