//! Looks of recordings: which visual factors are set or sampled where images are rendered when they are read.

use std::collections::BTreeMap;

use serde_json::{Map, Value as Json};
use swm_core::{Registry, Value};
use swm_data::{Dataset, Looks};
use swm_tasks::request::{Assignment, Message, Report, TaskError, Train, look_of};

use crate::train::ImageLooks;

/// How images of a dataset are rendered; `seed` is that of the looks.
pub(super) fn looks(
    request: &Train,
    dataset: &dyn Dataset,
    registry: &Registry,
    seed: u64,
    report: &mut dyn Report,
) -> Result<ImageLooks, TaskError> {
    let mut values = |setting: &'static str, given: &Map<String, Json>| {
        look_of(dataset, registry, given, report).map_err(|error| match error {
            TaskError::Request(message) => {
                Message { setting: Some(Assignment::name(setting)), ..*message }.into()
            }
            error => error,
        })
    };
    let canonical: Option<BTreeMap<String, Value>> =
        request.canonical.as_ref().map(|given| values("canonical", given)).transpose()?;
    let names: Vec<String> = request.vary.iter().map(|name| name.trim().to_owned()).collect();
    let vary = Looks::default().vary(names).share(request.vary_share).usual(request.vary_usual).seed(seed);
    let vary = (!request.vary.is_empty()).then_some(vary);
    Ok(ImageLooks::new().set(&values("look", &request.look)?).vary(vary).canonical(canonical.as_ref()))
}
