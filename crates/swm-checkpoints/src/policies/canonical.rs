//! The setting `canonical` of policies: a run of the baseline `canonical`, which draws what the model sees.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json};
use swm_baselines::train::{RunConfig, RunFolder, TrainedModel, Which};
use swm_baselines::{BaselineError, Device, acting};
use swm_core::registry::Setting;
use swm_core::settings::text;
use swm_core::{ImageSize, PolicyArgs, PolicyError};

pub(super) const CANONICAL: Setting = Setting::new(
    acting::CANONICAL,
    "Run of canonical, which draws observations and goals in its look before the model sees them",
    "none",
);

/// The run that is named, if one is.
fn run(given: &Map<String, Json>) -> Option<PathBuf> {
    given.get(CANONICAL.name).map(|run| PathBuf::from(text(run)))
}

/// Takes the setting out of what is `given`, and opens its run for the environment `env`.
pub(super) fn take(
    args: &PolicyArgs,
    given: &mut Map<String, Json>,
    device: Device,
    env: &str,
) -> Result<Option<TrainedModel>, PolicyError> {
    let Some(run) = run(given) else { return Ok(None) };
    given.shift_remove(CANONICAL.name);
    let model = TrainedModel::open(&run, Which::default(), device).map_err(|error| wrong(args, error))?;
    match model.config.data.env.as_deref().filter(|of| *of != env) {
        Some(of) => {
            Err(wrong(args, format!("run {}: it was trained in {of}, and this is {env}", run.display())))
        }
        None => Ok(Some(model)),
    }
}

/// An error about the setting.
pub(super) fn wrong(args: &PolicyArgs, reason: impl std::fmt::Display) -> PolicyError {
    args.wrong(format!("setting `{}`: {reason}", CANONICAL.name))
}

/// The size of the images that its run was trained on.
pub(super) fn image_size(given: &Map<String, Json>) -> Option<ImageSize> {
    let side = RunConfig::read(&RunFolder::open(&run(given)?).ok()?).ok()?.data.image;
    Some(ImageSize { height: side, width: side })
}

/// Adds what `list` lists of its run, if one is named.
pub(super) fn add_files(
    args: &PolicyArgs,
    given: &Map<String, Json>,
    files: &mut Vec<PathBuf>,
    list: fn(&Path, Which) -> Result<Vec<PathBuf>, BaselineError>,
) -> Result<(), PolicyError> {
    if let Some(run) = run(given) {
        files.extend(list(&run, Which::default()).map_err(|error| wrong(args, error))?);
    }
    Ok(())
}
