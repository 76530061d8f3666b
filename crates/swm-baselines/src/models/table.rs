//! All baselines. A new one is a folder beside this file and one line here.

use burn::tensor::Device;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;

use super::settings::with_changes;
use super::{dino_wm, gcbc, gciql, gcivl, lewm, pldm};
use crate::baseline::{Baseline, Recipe};
use crate::data::Facts;
use crate::error::BaselineError;
use crate::learner::Learner;
use crate::network::{Network, Parts};
use crate::processor::Processor;

/// From the name of a preset, and changes to it, to all settings.
type SettingsOf = fn(&str, &Json) -> Result<Json, BaselineError>;
/// From a recipe to a model.
type Make = fn(Recipe, &Device) -> Result<Box<dyn Baseline>, BaselineError>;

/// A line of the table.
#[derive(Clone, Copy)]
pub struct BaselineEntry {
    /// Its name.
    pub name: &'static str,
    /// One line about it.
    pub about: &'static str,
    /// Its presets, the paper's first.
    pub presets: &'static [&'static str],
    /// Settings of a preset.
    settings: SettingsOf,
    /// Makes it.
    make: Make,
}

/// A line for the folder `$folder`, whose settings are a `$config` and whose `make` gives network and training.
macro_rules! entry {
    ($folder:ident, $config:ident, $about:literal) => {
        BaselineEntry {
            name: $folder::NAME,
            about: $about,
            presets: PRESETS,
            settings: |preset, changes| {
                let preset =
                    if preset == "small" { $folder::$config::small() } else { $folder::$config::paper() };
                changed($folder::NAME, &preset, changes)
            },
            make: |recipe, device| {
                let config: $folder::$config = parse($folder::NAME, &recipe.settings)?;
                let parts = $folder::make(&config, &recipe.facts, device)?;
                learner($folder::NAME, recipe, parts, device)
            },
        }
    };
}

/// Presets that every baseline has: the paper's, and one for two processor cores.
const PRESETS: &[&str] = &["paper", "small"];

/// All baselines.
pub const BASELINES: &[BaselineEntry] = &[
    entry!(dino_wm, DinoWmConfig, "tokens of a frozen DINOv2, predicted frame by frame; plans"),
    entry!(gcbc, GcbcConfig, "goal-conditioned behavioural cloning; acts"),
    entry!(gciql, GciqlConfig, "goal-conditioned implicit Q-learning; acts"),
    entry!(gcivl, GcivlConfig, "goal-conditioned implicit value learning; acts"),
    entry!(lewm, LewmConfig, "joint embedding, kept normal by SIGReg; plans"),
    entry!(pldm, PldmConfig, "joint embedding, kept apart by VICReg; plans"),
];

/// What a model is made from.
#[derive(Clone, Debug)]
pub struct MakeOptions<'a> {
    /// `paper`, `small`.
    pub preset: &'a str,
    /// Settings that differ from the preset's, as nested objects; `null` for none.
    pub changes: Json,
    /// The data that it is made for.
    pub facts: Facts,
    /// The seed of its first weights.
    pub seed: u64,
    /// What it is computed on.
    pub processor: Processor,
}

/// A new model with fresh weights.
///
/// # Errors
///
/// No such baseline or preset, or an unknown or misfit setting.
pub fn make(name: &str, options: &MakeOptions<'_>) -> Result<Box<dyn Baseline>, BaselineError> {
    let entry = find(name)?;
    if !entry.presets.contains(&options.preset) {
        return Err(BaselineError::UnknownPreset {
            baseline: entry.name,
            preset: options.preset.to_owned(),
            known: entry.presets.join(", "),
        });
    }
    let recipe = Recipe {
        baseline: entry.name.to_owned(),
        preset: options.preset.to_owned(),
        settings: (entry.settings)(options.preset, &options.changes)?,
        facts: options.facts,
        seed: options.seed,
    };
    (entry.make)(recipe, &options.processor.device()?)
}

/// The model of a recipe, with its first weights.
///
/// # Errors
///
/// No such baseline, or settings that it does not take.
pub fn restore(recipe: &Recipe, processor: Processor) -> Result<Box<dyn Baseline>, BaselineError> {
    (find(&recipe.baseline)?.make)(recipe.clone(), &processor.device()?)
}

fn learner<N: Network>(
    name: &'static str,
    recipe: Recipe,
    parts: Parts<N>,
    device: &Device,
) -> Result<Box<dyn Baseline>, BaselineError> {
    Ok(Box::new(Learner::new(name, recipe, parts, device.clone())?))
}

fn parse<C: DeserializeOwned>(baseline: &'static str, settings: &Json) -> Result<C, BaselineError> {
    C::deserialize(settings).map_err(|error| BaselineError::Settings { baseline, reason: error.to_string() })
}

fn changed<C: Serialize + DeserializeOwned>(
    baseline: &'static str,
    preset: &C,
    changes: &Json,
) -> Result<Json, BaselineError> {
    let config = with_changes(baseline, preset, changes)?;
    serde_json::to_value(config)
        .map_err(|error| BaselineError::Settings { baseline, reason: error.to_string() })
}

fn find(name: &str) -> Result<&'static BaselineEntry, BaselineError> {
    BASELINES.iter().find(|entry| entry.name == name).ok_or_else(|| {
        let names = BASELINES.iter().map(|entry| entry.name);
        let near = names
            .clone()
            .max_by(|a, b| strsim::jaro_winkler(a, name).total_cmp(&strsim::jaro_winkler(b, name)));
        let near = near.filter(|near| strsim::jaro_winkler(near, name) > 0.8);
        let all = names.collect::<Vec<_>>().join(", ");
        let hint = near
            .map_or(format!("there are: {all}"), |near| format!("did you mean `{near}`? There are: {all}"));
        BaselineError::UnknownBaseline { name: name.to_owned(), hint }
    })
}
