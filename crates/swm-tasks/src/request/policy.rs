//! The policy that a request names, `NAME:ARGS`: read, made, and what should be known of it before it acts.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json};
use swm_core::{EnvEntry, ImageSize, Policy, PolicyArgs, Registry, World};
use swm_solvers::registered_model;

use super::training_note::{Ask, note_training};
use super::{Message, Report, TaskError, wrong};
use crate::text_file::{json_error, read_text, toml_error};

/// Reads `NAME:ARGS`; `NAME:@FILE` takes the arguments from a TOML or JSON file, and further `key=value` after it override the file's.
/// `mpc:NAME` is the policy of the registry's world model of that name ([`registered_model`]).
///
/// # Errors
///
/// It is no policy with arguments, or the file cannot be read.
pub fn policy_args(registry: &Registry, text: &str) -> Result<PolicyArgs, TaskError> {
    let text = &*registered_model(registry, text)?;
    let parse = PolicyArgs::parse;
    let Some((name, rest)) = text.split_once(":@") else { return Ok(named(parse(text)?)) };
    let (path, overrides) = rest.split_once(',').unwrap_or((rest, ""));
    let mut args = parse(&format!("{name}:{overrides}"))?;
    let mut named = settings_file(Path::new(path))?;
    named.extend(args.named);
    args.named = named;
    Ok(args)
}

/// What results call the reference policy no-op is the policy `constant` without values.
fn named(mut args: PolicyArgs) -> PolicyArgs {
    if ["no-op", "no_op"].contains(&args.name.as_str()) {
        args.name = "constant".to_owned();
    }
    args
}

fn settings_file(path: &Path) -> Result<Map<String, Json>, TaskError> {
    let refused = |reason: String| wrong(format!("settings file {}: {reason}", path.display()));
    let text = read_text(path).map_err(|error| refused(error.to_string()))?;
    if path.extension().is_some_and(|extension| extension == "json") {
        serde_json::from_str(&text).map_err(|error| refused(json_error(&text, &error)))
    } else {
        toml::from_str(&text).map_err(|error| refused(toml_error(&text, &error)))
    }
}

/// The files that a policy's text names: its settings and its models.
///
/// # Errors
///
/// There is no such policy, or its arguments cannot be read.
pub fn policy_files(registry: &Registry, env: &EnvEntry, text: &str) -> Result<Vec<PathBuf>, TaskError> {
    let args = policy_args(registry, text)?;
    let mut files = registry.policy_entry(env, &args.name)?.model_files(&args)?;
    files.extend(text.split_once(":@").map(|(_, rest)| rest.split(',').next().unwrap_or_default().into()));
    Ok(files)
}

/// The image size that the model behind a policy was trained on, for worlds that no image size is asked for.
pub fn model_image(registry: &Registry, env: &EnvEntry, text: &str) -> Option<ImageSize> {
    let args = policy_args(registry, text).ok()?;
    registry.policy_entry(env, &args.name).ok()?.image_size(&args)
}

/// The same of a policy that is evaluated on a dataset, from which it may take what nothing else says: then this is noted.
///
/// # Errors
///
/// As of [`policy_args`]; or there is no such policy.
pub(super) fn policy_args_on(
    registry: &Registry,
    env: &EnvEntry,
    text: &str,
    dataset: Option<&Path>,
    report: &mut dyn Report,
) -> Result<PolicyArgs, TaskError> {
    let args = policy_args(registry, text)?;
    let entry = registry.policy_entry(env, &args.name)?;
    let on = |path| Some((path, entry.args_on_dataset(&args, path)?));
    let Some((path, with)) = dataset.and_then(on) else { return Ok(args) };
    let text = format!(
        "no file of {text} says how vectors were scaled; the statistics of {} are taken",
        path.display()
    );
    report.note(&Message::new(text));
    Ok(with)
}

/// The policy for a world; notes settings with which it can hardly search, and those that its model was trained with where they are
/// others.
///
/// # Errors
///
/// There is no such policy, or its arguments do not go with the world.
pub fn make_policy(
    registry: &Registry,
    args: &PolicyArgs,
    world: &World,
    ask: Ask,
    report: &mut dyn Report,
) -> Result<Box<dyn Policy>, TaskError> {
    let policy = registry.policy_from(args, world)?;
    note_elites(registry, world.entry(), args, report);
    note_training(registry, args, &world.into(), ask, report);
    Ok(policy)
}

/// Notes a search that keeps most of its samples as elites. It stays where it began, which looks like a model or a task that is too
/// hard.
pub fn note_elites(registry: &Registry, env: &EnvEntry, args: &PolicyArgs, report: &mut dyn Report) {
    let Ok(entry) = registry.policy_entry(env, &args.name) else { return };
    let default =
        |name: &str| entry.settings.iter().find(|setting| setting.name == name)?.default.parse().ok();
    let value = |name: &str| args.named.get(name).map_or_else(|| default(name), Json::as_u64);
    // Half of few samples are elites by default.
    let is_fitted = |samples, elites| !args.named.contains_key("elites") && samples < elites;
    if let (Some(samples), Some(elites)) = (value("samples"), value("elites"))
        && !is_fitted(samples, elites)
        && 2 * elites > samples
    {
        let fewer = (samples / 10).max(2);
        report.note(&Message::new(format!(
            "{} keeps {elites} of {samples} samples as elites, so that the search hardly improves; a tenth is usual: elites={fewer}",
            args.name
        )));
    }
}

/// Notes where a policy's model, which was `trained` on images of a size, sees none, or others than those. A model that needs images
/// refuses to act without them.
pub fn note_images(
    policy: &str,
    trained: Option<ImageSize>,
    shown: Option<ImageSize>,
    report: &mut dyn Report,
) {
    let Some(trained) = trained.filter(|_| trained != shown) else { return };
    let seen =
        shown.map_or("none".to_owned(), |size| format!("images of {size}; its results may be far worse"));
    report.note(&Message::new(format!("{policy} was trained on images of {trained}, and sees {seen}")));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_of_another_size_than_the_models_are_noted() {
        let size = |side| Some(ImageSize { height: side, width: side });
        let notes = |trained, shown| {
            let mut notes: Vec<Message> = Vec::new();
            note_images("mpc:lewm", trained, shown, &mut notes);
            notes.first().map(ToString::to_string)
        };
        let note = notes(size(64), size(32)).unwrap();
        assert!(note.contains("mpc:lewm was trained on images of 64x64, and sees images of 32x32"), "{note}");
        assert!(notes(size(64), None).unwrap().ends_with("and sees none"));
        for (trained, shown) in [(size(64), size(64)), (None, size(32)), (None, None)] {
            assert_eq!(notes(trained, shown), None);
        }
    }
}
