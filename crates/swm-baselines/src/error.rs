//! What can go wrong with a baseline.

use std::path::{Path, PathBuf};

use swm_core::error::did_you_mean;
use swm_core::{BoxError, WorldError};
use swm_data::DataError;
use swm_solvers::PlanError;
use swm_tasks::request::TaskError;
use swm_weights::WeightsError;
use thiserror::Error;

/// A baseline cannot be made, trained, saved, or asked.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BaselineError {
    /// No baseline has this name.
    #[error("unknown baseline `{name}`{}; there are {known}", did_you_mean(.nearest.as_deref()))]
    UnknownBaseline {
        /// The name.
        name: String,
        /// The most similar of those that there are.
        nearest: Option<String>,
        /// Those that there are.
        known: String,
    },
    /// The baseline has no such preset.
    #[error("baseline `{baseline}` has no preset `{preset}`; it has: {known}")]
    UnknownPreset {
        /// The baseline.
        baseline: &'static str,
        /// The preset.
        preset: String,
        /// Its presets.
        known: String,
    },
    /// Settings of a model that do not fit together, or that are unknown.
    #[error("settings of `{baseline}`: {reason}")]
    Settings {
        /// The baseline.
        baseline: &'static str,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// A model is asked for what it is not.
    #[error("{baseline} {reason}")]
    Unfit {
        /// The baseline.
        baseline: &'static str,
        /// What it is not, and what it is.
        reason: &'static str,
    },
    /// Data that the model was not made for.
    #[error("`{column}`: {reason}")]
    Data {
        /// The column.
        column: &'static str,
        /// What is wrong, and what is expected.
        reason: String,
    },
    /// A file of weights cannot be read or written.
    #[error("weights in `{}`: {reason}", path.display())]
    Weights {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Weights of another model.
    #[error("weights in `{}` are not those of this model: {} of {} tensors fit; {}", path.display(), fits[0], fits[1],
        mismatch(missing, unused, wrong, found))]
    Mismatch {
        /// The file.
        path: PathBuf,
        /// How many of the model's tensors it has in their shapes, and how many the model has.
        fits: [usize; 2],
        /// What the model has and the file lacks.
        missing: Vec<String>,
        /// What the file has and the model lacks.
        unused: Vec<String>,
        /// Tensors of another shape: name, and both shapes.
        wrong: Box<[String]>,
        /// What the names in the file begin with.
        found: Box<[String]>,
    },
    /// A loss is not finite.
    #[error(
        "step {step}: the loss is {value}; the weights are those before the step. Lower the learning rate, or look \
         for NaN or infinite values in the data"
    )]
    NotFinite {
        /// The step.
        step: u64,
        /// The loss.
        value: f32,
    },
    /// A validation loss is not finite.
    #[error(
        "step {step}: the validation's {name} is {value}. Lower the learning rate, or look for values that are not \
         finite in the data"
    )]
    NotFiniteValidation {
        /// The step.
        step: u64,
        /// The loss, or a part of it.
        name: String,
        /// What it is.
        value: f64,
    },
    /// A training has stopped because of a loss that is not finite.
    #[error("{source}. Training has stopped; {}", last_good(.kept.as_deref()))]
    Stopped {
        /// The weights of the last good checkpoint, if there is one.
        kept: Option<PathBuf>,
        /// Why.
        source: Box<BaselineError>,
    },
    /// The operating system refused.
    #[error("cannot {action} {}: {source}{}", path.display(), fix(source))]
    Io {
        /// What was tried.
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A folder is no training run, or not one that can be used so.
    #[error("run {}: {reason}", path.display())]
    Run {
        /// The folder.
        path: PathBuf,
        /// What is wrong, and the fix.
        reason: String,
    },
    /// Settings of a training that are unusable.
    #[error("setting `{setting}`: {reason}")]
    Training {
        /// Its name.
        setting: String,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// A model could not be measured while it was trained.
    #[error("cannot measure the model at step {step}: {source}")]
    Diagnosis {
        /// The step.
        step: u64,
        /// Why.
        source: BoxError,
    },
    /// A dataset cannot be read.
    #[error(transparent)]
    Dataset(#[from] DataError),
    /// An environment that an agent learns in fails.
    #[error(transparent)]
    World(#[from] WorldError),
    /// A dataset lacks what the baseline learns from.
    #[error("{} cannot train {baseline}: {reason}", path.display())]
    Columns {
        /// The dataset.
        path: PathBuf,
        /// The baseline.
        baseline: String,
        /// What is missing, what is there, and the fix.
        reason: String,
    },
    /// The machine has no such device, or this build no support for it.
    #[error("device `{name}`: {reason}")]
    Device {
        /// Its name.
        name: String,
        /// What is wrong, and what there is.
        reason: String,
    },
}

impl BaselineError {
    /// Data of the wrong form.
    pub(crate) fn data(column: &'static str, reason: impl Into<String>) -> Self {
        Self::Data { column, reason: reason.into() }
    }

    /// A file of weights that cannot be used.
    pub(crate) fn weights(path: &Path, reason: impl Into<String>) -> Self {
        Self::Weights { path: path.to_owned(), reason: reason.into() }
    }
}

impl From<WeightsError> for BaselineError {
    fn from(error: WeightsError) -> Self {
        match error {
            WeightsError::Unusable { path, reason } => Self::Weights { path, reason },
            WeightsError::Write { path, source } => Self::Io { action: "write", path, source },
        }
    }
}

impl From<BaselineError> for TaskError {
    fn from(error: BaselineError) -> Self {
        Self::Failed(error.into())
    }
}

impl From<BaselineError> for PlanError {
    fn from(error: BaselineError) -> Self {
        PlanError::Cost(BoxError::from(error))
    }
}

fn last_good(kept: Option<&Path>) -> String {
    match kept {
        Some(weights) => format!("the last good checkpoint is {}", weights.display()),
        None => "there was no checkpoint yet".to_owned(),
    }
}

/// What helps against the system's commonest reasons.
fn fix(error: &std::io::Error) -> &'static str {
    use std::io::ErrorKind as Kind;
    match error.kind() {
        Kind::StorageFull | Kind::QuotaExceeded => "; make room, and resume it from the last checkpoint",
        Kind::PermissionDenied | Kind::ReadOnlyFilesystem => "; allow it, or choose another folder",
        Kind::NotADirectory | Kind::AlreadyExists => "; choose another folder",
        _ => "",
    }
}

/// How many names an error lists of each kind.
const LISTED: usize = 8;
/// Parts of models that files of weights can lack.
const ENCODERS: [&str; 2] = ["encoder", "backbone"];

fn mismatch(missing: &[String], unused: &[String], wrong: &[String], found: &[String]) -> String {
    let prefix = prefix(missing, unused);
    let encoder = ENCODERS.iter().find(|part| prefix.is_none() && is_absent(part, missing, found));
    let kinds = [("missing", missing), ("unused", unused), ("of another shape", wrong)];
    let listed =
        kinds.iter().filter(|(kind, names)| !names.is_empty() && (encoder.is_none() || *kind != "missing"));
    let absent = encoder.map(|part| {
        let (shown, more) = shown(found);
        format!(
            "the encoder is missing ({} tensors below `{part}.`), and the file has {shown}{more}",
            missing.len()
        )
    });
    let parts: Vec<String> =
        absent.into_iter().chain(listed.map(|(kind, names)| list(kind, names))).collect();
    let fix = match prefix {
        _ if encoder.is_some() => "Use a file of the whole model".to_owned(),
        Some(prefix) => format!(
            "The model is below `{prefix}` in the file; store it alone, in Python: `torch.save({{k.removeprefix(\"{prefix}\"): v for k, v \
             in weights.items() if k.startswith(\"{prefix}\")}}, FILE)`"
        ),
        None => "Use the settings that the weights were trained with".to_owned(),
    };
    format!("{}. {fix}", parts.join("; "))
}

/// What most of the missing names have before them in the file.
fn prefix<'a>(missing: &[String], unused: &'a [String]) -> Option<&'a str> {
    let before = |name: &String| {
        unused
            .iter()
            .find_map(|unused| unused.strip_suffix(name.as_str()).filter(|prefix| prefix.ends_with('.')))
    };
    let prefix = missing.iter().find_map(before)?;
    let below = missing.iter().filter(|name| unused.contains(&format!("{prefix}{name}"))).count();
    (2 * below > missing.len()).then_some(prefix)
}

/// Whether all that is missing is a part of the model, of which the file has nothing.
fn is_absent(part: &str, missing: &[String], found: &[String]) -> bool {
    let is_below = |name: &String| name.split('.').next() == Some(part);
    !missing.is_empty() && missing.iter().all(is_below) && !found.iter().any(|name| name == part)
}

fn list(kind: &str, names: &[String]) -> String {
    let (shown, more) = shown(names);
    format!("{} {kind}: {shown}{more}", names.len())
}

/// The first names, and how many more there are.
fn shown(names: &[String]) -> (String, String) {
    let more = names.len().saturating_sub(LISTED);
    let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
    (names[..names.len() - more].join(", "), rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_system_refuses_has_a_fix() {
        let message = |kind: std::io::ErrorKind| {
            BaselineError::Io { action: "write", path: "run/a".into(), source: kind.into() }.to_string()
        };
        let full = message(std::io::ErrorKind::StorageFull);
        assert!(full.starts_with("cannot write run/a: ") && full.contains("resume it"), "{full}");
        assert!(message(std::io::ErrorKind::ReadOnlyFilesystem).ends_with("another folder"));
    }

    #[test]
    fn a_mismatch_lists_both_sides_and_cuts_long_lists() {
        let missing = (0..10).map(|i| format!("layer.{i}")).collect();
        let error = BaselineError::Mismatch {
            path: "a.pt".into(),
            fits: [3, 13],
            missing,
            unused: vec!["head".to_owned()],
            wrong: Box::default(),
            found: Box::new(["head".to_owned(), "layer".to_owned()]),
        };
        let text = error.to_string();
        assert!(text.contains("10 missing: layer.0, "), "{text}");
        assert!(text.contains("layer.7, and 2 more; 1 unused: head."), "{text}");
        assert!(text.ends_with("Use the settings that the weights were trained with"), "{text}");
    }

    #[test]
    fn an_encoder_that_a_file_lacks_is_named_and_not_listed() {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<String>>();
        let missing = names(&["encoder.layers.0.weight", "encoder.layers.1.weight"]);
        let text = mismatch(&missing, &names(&["head.a"]), &[], &names(&["head", "predictor"]));
        assert_eq!(
            text,
            "the encoder is missing (2 tensors below `encoder.`), and the file has head, predictor; 1 unused: head.a. Use a file of the whole model"
        );
        // It has one, and lacks a part of it; or more than it is missing.
        let text = mismatch(&missing, &[], &[], &names(&["encoder", "predictor"]));
        assert!(text.contains("2 missing: encoder.layers.0.weight, "), "{text}");
        let text = mismatch(&[missing, names(&["head.b"])].concat(), &[], &[], &names(&["predictor"]));
        assert!(text.contains("3 missing: encoder.layers.0.weight, "), "{text}");
    }

    #[test]
    fn a_mismatch_names_what_is_before_all_names() {
        let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<String>>();
        let text = mismatch(&names(&["a.b", "c"]), &names(&["net.a.b", "net.c", "probe.d"]), &[], &[]);
        assert!(text.contains("The model is below `net.` in the file; store it alone"), "{text}");
        let text = mismatch(&names(&["a.b", "c", "e"]), &names(&["net.a.b", "probe.d"]), &[], &[]);
        assert!(text.ends_with("Use the settings that the weights were trained with"), "{text}");
    }
}
