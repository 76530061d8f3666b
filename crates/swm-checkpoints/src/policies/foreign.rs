//! Published checkpoints used directly: `lewm:FOLDER`, as an import that writes no run.
//!
//! What no file of a checkpoint contains is a setting of the policy, by the name that an import has for it.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json};
use swm_baselines::train::{TrainedModel, is_foreign};
use swm_core::registry::{Setting, TrainedIn};
use swm_core::settings::text;
use swm_core::{PolicyArgs, PolicyError, Registry};
use swm_tasks::request::{List, TaskError, Words, value_text};

use crate::import::{Description, Import, Loaded};

/// Models that are named by themselves, whose checkpoints others publish.
pub(super) const FAMILIES: [&str; 3] = ["lewm", "pldm", "dino-wm"];

/// What an import asks for.
pub(super) const SETTINGS: &[Setting] = &[
    Setting::new(
        "dataset",
        "Of a published checkpoint: the dataset that it was trained on, for how vectors were scaled",
        "none",
    ),
    Setting::new("stats", "The same from a file of statistics, such as `swm stats` writes", "none"),
    Setting::new("action_mean", "The same as numbers with colons: means of actions", "none"),
    Setting::new("action_std", "Stds of actions, with colons", "none"),
    Setting::new("proprio_mean", "Means of proprio, with colons", "none"),
    Setting::new("proprio_std", "Stds of proprio, with colons", "none"),
    Setting::new("weights", "Of several files of weights in the folder, this one", "the only one"),
    Setting::new(
        "encoder",
        "A file with the weights of its frozen encoder, where it has them not itself",
        "none",
    ),
    Setting::new("image", "Side of its images in pixels", "as its files say"),
];

/// A published checkpoint and what was said of it.
#[derive(Clone, Debug)]
pub(super) struct Foreign {
    request: Import,
}

impl Foreign {
    /// The checkpoint that `run` is, if it is one and the policy takes such; its settings are taken out of `rest`. Of a run of this
    /// program they are refused.
    pub(super) fn of(
        args: &PolicyArgs,
        run: &Path,
        rest: &mut Map<String, Json>,
    ) -> Result<Option<Self>, PolicyError> {
        if !FAMILIES.contains(&args.name.as_str()) {
            return Ok(None);
        }
        let is_setting = |name: &String| {
            SETTINGS.iter().any(|setting| setting.name == name)
                || ["model.", "encoder.", "predictor."].iter().any(|part| name.starts_with(part))
        };
        let name = run.to_string_lossy();
        if !(name.starts_with("hf:") || is_foreign(run)) {
            return match rest.keys().find(|name| run.exists() && is_setting(name)) {
                Some(name) => Err(args.wrong(format!(
                    "setting `{name}`: {} is a run, which says this itself; leave it out",
                    run.display()
                ))),
                None => Ok(None),
            };
        }
        let (mut given, others): (Map<_, _>, _) =
            std::mem::take(rest).into_iter().partition(|(name, _)| is_setting(name));
        *rest = others;
        let mut request =
            Import { from: name.into_owned(), kind: Some(args.name.clone()), ..Import::default() };
        let mut take = |name: &str| given.shift_remove(name);
        let path = |value: Json| PathBuf::from(text(&value));
        request.dataset = take("dataset").map(path);
        request.stats = take("stats").map(path);
        request.encoder = take("encoder").map(path);
        request.file = take("weights").map(|value| text(&value));
        request.action_mean = numbers(args, "action_mean", take("action_mean"))?;
        request.action_std = numbers(args, "action_std", take("action_std"))?;
        request.proprio_mean = numbers(args, "proprio_mean", take("proprio_mean"))?;
        request.proprio_std = numbers(args, "proprio_std", take("proprio_std"))?;
        request.image = take("image").map(|value| size(args, &value)).transpose()?;
        request.set = given;
        Ok(Some(Self { request }))
    }

    /// The model, for use in the environment `env`.
    pub(super) fn load(
        &self,
        args: &PolicyArgs,
        registry: &Registry,
        env: &str,
    ) -> Result<TrainedModel, PolicyError> {
        let request = Import { env: Some(env.to_owned()), ..self.request.clone() };
        match request.load(registry).map_err(|error| wrong(args, error))? {
            Loaded::Model(model) => Ok(*model),
            Loaded::Agent { .. } => unreachable!("no family of agents is taken"),
        }
    }

    /// The arguments with the dataset that it is evaluated on, where nothing says how vectors were scaled: the reference takes the
    /// statistics of that dataset, too.
    pub(super) fn on_dataset(&self, args: &PolicyArgs, dataset: &Path) -> Option<PolicyArgs> {
        let Import { dataset: named, stats, action_mean, .. } = &self.request;
        if named.is_some() || stats.is_some() || action_mean.is_some() || self.request.noted().is_some() {
            return None;
        }
        let mut args = args.clone();
        args.named.insert("dataset".to_owned(), dataset.display().to_string().into());
        Some(args)
    }

    /// What it is, as far as its own files say, and `env` where it is known.
    pub(super) fn describe(&self, registry: &Registry, env: Option<&str>) -> Option<Description> {
        let request = Import {
            env: env.map(str::to_owned),
            dataset: None,
            stats: None,
            check_only: true,
            ..self.request.clone()
        };
        request.describe(registry).ok()
    }

    /// What its notes say: an export of this program has them.
    pub(super) fn trained_in(&self) -> Option<TrainedIn> {
        let noted = self.request.noted()?;
        let skip = noted["frame_skip"].as_u64().and_then(|skip| u32::try_from(skip).ok());
        let trained = TrainedIn::new(noted["env"].as_str()?).frame_skip(skip);
        Some(match noted["env_settings"].as_object() {
            Some(settings) => trained.settings(settings.clone()),
            None => trained,
        })
    }

    /// The files that it is made of, and those that say how vectors were scaled.
    pub(super) fn files(&self, args: &PolicyArgs) -> Result<Vec<PathBuf>, PolicyError> {
        let mut files = self.request.files().map_err(|error| wrong(args, error))?;
        let given = [&self.request.encoder, &self.request.dataset, &self.request.stats];
        files.extend(given.into_iter().flatten().cloned());
        Ok(files)
    }
}

/// `0.1:0.2`, a number, or a list.
fn numbers(args: &PolicyArgs, name: &str, value: Option<Json>) -> Result<Option<Vec<f64>>, PolicyError> {
    let Some(value) = value else { return Ok(None) };
    let all: Option<Vec<f64>> = match &value {
        Json::Array(items) => items.iter().map(Json::as_f64).collect(),
        value => text(value).split(':').map(|part| part.trim().parse().ok()).collect(),
    };
    match all {
        Some(all) => Ok(Some(all)),
        None => Err(args.wrong(format!(
            "setting `{name}`: `{}`; use numbers with colons, such as 0.1:-0.2",
            text(&value)
        ))),
    }
}

fn size(args: &PolicyArgs, value: &Json) -> Result<usize, PolicyError> {
    let size = value.as_u64().filter(|size| *size > 0);
    let wrong = || args.wrong(format!("setting `image`: `{}`; use a whole number of pixels", text(value)));
    size.map(|size| size as usize).ok_or_else(wrong)
}

/// An import's error, with its settings as those of the policy.
fn wrong(args: &PolicyArgs, error: TaskError) -> PolicyError {
    args.wrong(match error {
        TaskError::Request(message) => message.in_words(&Settings),
        error => error.to_string(),
    })
}

/// Settings of an import as those of a policy.
struct Settings;

impl Words for Settings {
    fn setting(&self, name: &str, value: Option<&Json>) -> String {
        let name = match (name, value) {
            ("file", _) => "weights",
            ("from", None) => return "its folder or file".to_owned(),
            ("from" | "set", Some(value)) => return value_text(value),
            ("kind", Some(value)) => return format!("{}:FOLDER", value_text(value)),
            (name, _) => name,
        };
        match value {
            Some(Json::Array(items)) => {
                format!("{name}={}", items.iter().map(value_text).collect::<Vec<_>>().join(":"))
            }
            Some(value) => format!("{name}={}", value_text(value)),
            None => format!("{name}=…"),
        }
    }

    fn list(&self, _list: &List) -> String {
        "the documentation".to_owned()
    }
}
