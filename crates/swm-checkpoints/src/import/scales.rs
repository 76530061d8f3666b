//! How vectors were scaled, which no file of weights says: from a dataset, a file of statistics, or numbers.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::{Map, Value as Json};
use swm_baselines::train::{ACTION, Scale};
use swm_core::{Metadata, Registry};
use swm_data::Dataset;
use swm_data::stats::{Statistics, StatisticsOptions};
use swm_tasks::request::{Assignment, Fix, Message, TaskError, open_dataset_with};

use super::Import;
use super::source::give;

/// Scales by column, and where they are from.
pub(super) struct Scales {
    pub(super) of: BTreeMap<String, (Scale, String)>,
    /// The dataset that they are from.
    pub(super) dataset: Option<Known>,
}

/// What is known of a dataset.
pub(super) struct Known {
    pub(super) episodes: usize,
    pub(super) rows: usize,
    pub(super) env: Option<String>,
    pub(super) env_settings: Option<Map<String, Json>>,
    pub(super) frame_skip: Option<u32>,
    /// Values of an action.
    pub(super) action: usize,
}

/// All that a request says about the columns `columns`.
pub(super) fn find(request: &Import, registry: &Registry, columns: &[&str]) -> Result<Scales, TaskError> {
    let mut of = BTreeMap::new();
    let mut dataset = None;
    if let Some(path) = &request.dataset {
        let mut opened = open_dataset_with(registry, path, &request.opening)?;
        dataset = Some(known(opened.as_ref()));
        let has = |name: &&str| opened.schema().index(name).is_some();
        let keys: Vec<String> =
            columns.iter().filter(|name| has(name)).map(|&name| name.to_owned()).collect();
        let options = StatisticsOptions { keys: Some(keys), quantiles: Vec::new(), sample: 1 };
        let statistics = Statistics::compute(opened.as_mut(), &options)?;
        for (name, column) in &statistics.columns {
            if let Some(scale) = Scale::of(column) {
                of.insert(name.clone(), (scale, path.display().to_string()));
            }
        }
    }
    if let Some(path) = &request.stats {
        for name in columns {
            if let Some(scale) = stored(path, name)? {
                of.insert((*name).to_owned(), (scale, path.display().to_string()));
            }
        }
    }
    for name in columns {
        let [mean, std] = match *name == ACTION {
            true => [&request.action_mean, &request.action_std],
            false => [&request.proprio_mean, &request.proprio_std],
        };
        if let (Some(mean), Some(std)) = (mean, std) {
            of.insert(
                (*name).to_owned(),
                (Scale { mean: mean.clone(), std: std.clone() }, "given".to_owned()),
            );
        }
    }
    Ok(Scales { of, dataset })
}

fn known(dataset: &dyn Dataset) -> Known {
    let recorded = dataset.metadata().and_then(Metadata::of_known_env);
    let episodes = dataset.num_episodes();
    let schema = dataset.schema();
    Known {
        episodes,
        rows: (0..episodes).map(|episode| dataset.episode_len(episode)).sum(),
        env: recorded.map(|recorded| recorded.env.clone()),
        env_settings: recorded.map(|recorded| recorded.settings.clone()),
        frame_skip: recorded.map(|recorded| recorded.frame_skip),
        action: schema.index(ACTION).map_or(0, |index| schema.fields()[index].dim()),
    }
}

/// The scale of a column in a file of statistics: `{"columns": {"action": {"mean": […], "std": […]}}}`, or without `columns`.
fn stored(path: &Path, name: &str) -> Result<Option<Scale>, TaskError> {
    let wrong = |reason: &str| Message::about("stats", path.display().to_string(), reason);
    let bytes = fs::read(path).map_err(|error| wrong(&error.to_string()))?;
    let json: Json = serde_json::from_slice(&bytes).map_err(|error| wrong(&error.to_string()))?;
    let Some(column) = json.get("columns").unwrap_or(&json).get(name) else { return Ok(None) };
    let numbers =
        |key: &str| -> Option<Vec<f64>> { column.get(key)?.as_array()?.iter().map(Json::as_f64).collect() };
    let (Some(mean), Some(std)) = (numbers("mean"), numbers("std")) else {
        return Err(wrong(&format!("its `{name}` has no lists of numbers `mean` and `std`")).into());
    };
    let std = mean.iter().zip(std).map(|(&mean, std)| swm_core::moments::divisor(mean, std)).collect();
    Ok(Some(Scale { mean, std }))
}

/// Refuses a scale of another dim than `dim`, or with numbers that scale nothing.
pub(super) fn check(name: &str, scale: &Scale, dim: usize) -> Result<(), TaskError> {
    let sound = |std: &f64| std.is_finite() && *std > 0.0;
    if scale.mean.len() == dim
        && scale.std.len() == dim
        && scale.std.iter().all(sound)
        && scale.mean.iter().all(|mean| mean.is_finite())
    {
        return Ok(());
    }
    let text = format!(
        "mean {:?} and std {:?} of {name} are not {dim} finite numbers each, with stds above 0",
        scale.mean, scale.std
    );
    Err(Message::new(text).into())
}

/// What must be given where no file says how a column was scaled.
pub(super) fn unsaid(column: &str) -> Message {
    let [mean, std] = match column == ACTION {
        true => ["action_mean", "action_std"],
        false => ["proprio_mean", "proprio_std"],
    };
    let text = format!("the file does not say how the column `{column}` was scaled");
    let settings = [mean, std].map(Assignment::name).to_vec();
    let numbers = Fix::SetAll { settings, instead_of: None, to: String::new() };
    let dataset = give("dataset", "that it was trained on");
    Message::new(text).fix(Fix::Any(vec![dataset, give("stats", ""), numbers]))
}
