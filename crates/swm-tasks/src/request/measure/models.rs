//! Which model is measured, and by which impossible events.

use serde_json::json;
use swm_core::evaluate::quality::WorldModel;
use swm_core::evaluate::{ModelEntry, StateModel, Violation};
use swm_core::{Batch, EnvConfig, EnvEntry, PolicyArgs, Registry};

use crate::evaluation::ImageModel;
use crate::request::policy::policy_args;
use crate::request::{Fix, Message, TaskError};

/// Why there is no model of this name.
fn no_model(name: &str, others: &str) -> TaskError {
    Message::about(
        "model",
        name,
        format!("there are true, constant, gain=NUMBER, pixels=CELLS, and {others}"),
    )
    .into()
}

/// A model of the registry, where one is named: `lewm:RUN`.
pub(super) fn trained(
    registry: &Registry,
    name: &str,
) -> Result<Option<(&'static ModelEntry, PolicyArgs)>, TaskError> {
    if !name.contains(':') && registry.find::<ModelEntry>(name).is_err() {
        if name.starts_with("gain=") {
            gain(name)?;
        }
        if name.starts_with("pixels=") || gain(name).is_ok() {
            return Ok(None);
        }
        let known: Vec<&str> = registry.all::<ModelEntry>().map(|entry| entry.name).collect();
        let others = match known.is_empty() {
            true => "trained ones such as lewm:RUN".to_owned(),
            false => format!("models of the registry: {}", known.join(", ")),
        };
        return Err(no_model(name, &others));
    }
    let args = policy_args(registry, name)?;
    match registry.find::<ModelEntry>(&args.name) {
        Ok(entry) => Ok(Some((entry, args))),
        Err(_) if registry.all::<ModelEntry>().next().is_none() => {
            let text =
                format!("trained models such as {} need a build with the feature `baselines`", args.name);
            Err(Message::about("model", name, text).into())
        }
        Err(unknown) => Err(unknown.into()),
    }
}

/// A model that needs no training.
pub(super) fn yardstick(
    name: &str,
    entry: &EnvEntry,
    config: &EnvConfig,
    recorded: &[Batch],
) -> Result<Box<dyn WorldModel>, TaskError> {
    let cells = name.strip_prefix("pixels=").map(str::parse::<usize>);
    match cells {
        Some(Ok(cells)) if cells > 0 && config.image.is_none() => {
            let text = format!("it sees images of at least {cells}x{cells}, and there are none");
            Err(Message::about("model", name, text).fix(Fix::give("image_size")).into())
        }
        Some(Ok(cells)) if cells > 0 => Ok(Box::new(ImageModel::new(cells))),
        _ => {
            let model = StateModel::new(entry, config, gain(name)?)?;
            Ok(Box::new(model.standardized(recorded)?))
        }
    }
}

/// What actions are multiplied by in a model; none if nothing ever changes.
fn gain(model: &str) -> Result<Option<f64>, TaskError> {
    match (model, model.strip_prefix("gain=").map(str::parse::<f64>)) {
        ("true", _) => Ok(Some(1.0)),
        ("constant", _) => Ok(None),
        (_, Some(Ok(gain))) if gain.is_finite() => Ok(Some(gain)),
        (_, Some(_)) => {
            Err(Message::about("model", model, "a gain is a finite number, such as gain=0.8").into())
        }
        _ => Err(no_model(model, "trained ones such as lewm:RUN")),
    }
}

/// An impossible event by its text.
pub(super) fn violation(text: &str) -> Result<Violation, TaskError> {
    if text == "teleport" {
        return Ok(Violation::Teleport);
    }
    let Some((left, right)) = text.split_once('=') else {
        return Ok(Violation::Factor { name: text.to_owned() });
    };
    let wrong = || {
        let reason = "write COLUMN[ELEMENTS]=VALUES, such as state[2,3]=-500,-500";
        TaskError::from(Message::about("violation", json!([text]), reason))
    };
    let (column, elements) =
        left.strip_suffix(']').and_then(|left| left.split_once('[')).ok_or_else(wrong)?;
    let elements: Result<Vec<usize>, _> = elements.split(',').map(|number| number.trim().parse()).collect();
    let to: Result<Vec<f64>, _> = right.split(',').map(|number| number.trim().parse()).collect();
    match (elements, to) {
        (Ok(elements), Ok(to)) => Ok(Violation::Set { column: column.to_owned(), elements, to }),
        _ => Err(wrong()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_and_violations_are_read() {
        assert_eq!(gain("gain=0.5").ok(), Some(Some(0.5)));
        assert_eq!(gain("constant").ok(), Some(None));
        assert!(gain("gain=x").is_err() && gain("best").is_err());
        let set = Violation::Set { column: "state".to_owned(), elements: vec![2, 3], to: vec![-5.0, 1.5] };
        assert_eq!(violation("state[2,3]=-5,1.5").ok(), Some(set));
        assert_eq!(violation("block.color").ok(), Some(Violation::Factor { name: "block.color".to_owned() }));
        assert!(violation("state=3").is_err() && violation("state[a]=3").is_err());
    }
}
