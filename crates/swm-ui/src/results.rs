//! Results: what lies below the given paths, files of results as they are, curves of training runs, the progress of jobs.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::sync::Arc;

use axum::extract::{Query, State};
use serde::Deserialize;
use serde_json::{Map, Value as Json, json};

use crate::data::blocking;
use crate::error::{Answer, Refusal, json};
use crate::roots::Kind;
use crate::server::App;

/// Datasets, manifests, receipts, sweeps and training runs below the paths.
pub(crate) async fn files(State(app): State<Arc<App>>) -> Answer {
    blocking(move || json(&json!({ "files": app.roots.list(&app.registry) }))).await
}

#[derive(Deserialize)]
pub(crate) struct Named {
    id: String,
}

/// A file of results, as JSON.
pub(crate) async fn result(State(app): State<Arc<App>>, Query(Named { id }): Query<Named>) -> Answer {
    blocking(move || {
        let path = app.roots.resolve(&id)?;
        match app.roots.kind_of(&app.registry, &path) {
            Some((Kind::Dataset | Kind::Training | Kind::Job, _)) | None => Err(Refusal::bad(format!("`{id}` is no file of results"))),
            Some((kind, _)) => json(&json!({ "kind": kind, "path": path.display().to_string(), "content": app.roots.read_result(&path)? })),
        }
    })
    .await
}

/// The metrics of a training run: `{config, series: {part: {name: [[step, value], …]}}}`.
pub(crate) async fn training(State(app): State<Arc<App>>, Query(Named { id }): Query<Named>) -> Answer {
    blocking(move || {
        let path = app.roots.resolve(&id)?;
        let file = app.roots.resolve(&format!("{}/metrics.jsonl", id.trim_end_matches('/')))?;
        let config = path.join("config.json");
        let config = if config.exists() { app.roots.read_result(&config)? } else { Json::Null };
        json(&json!({ "path": path.display().to_string(), "config": config, "series": curves(app.roots.open(&file)?)? }))
    })
    .await
}

/// The progress of a job, as `swm jobs` has it.
pub(crate) async fn job(State(app): State<Arc<App>>, Query(Named { id }): Query<Named>) -> Answer {
    blocking(move || {
        let dir = app.roots.resolve_job(&id)?;
        json(&app.commands()?.job(&app.registry, &dir)?)
    })
    .await
}

/// Of a longer file, so many bytes at its end are read.
const MAX_METRICS_BYTES: u64 = 32 << 20;
/// Points of a curve; longer ones are thinned.
const MAX_POINTS: usize = 2000;

type Curves = BTreeMap<String, BTreeMap<String, Vec<(f64, f64)>>>;

/// Every number of every record, by its part (`train`, `val`) and name.
fn curves(mut file: File) -> Result<Curves, Refusal> {
    let start = file.metadata()?.len().saturating_sub(MAX_METRICS_BYTES);
    file.seek(SeekFrom::Start(start))?;
    let mut bytes = Vec::new();
    file.take(MAX_METRICS_BYTES).read_to_end(&mut bytes)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut curves = Curves::new();
    // A line that is being written is no JSON yet, and the first of a cut file none any more.
    for record in text.lines().filter_map(|line| serde_json::from_str::<Map<String, Json>>(line).ok()) {
        let Some(step) = record.get("step").and_then(Json::as_f64) else { continue };
        let part = record.get("part").and_then(Json::as_str).unwrap_or("train");
        let into = curves.entry(part.to_owned()).or_default();
        flatten("", &Json::Object(record.clone()), &mut |name, value| {
            if name != "step" {
                into.entry(name.to_owned()).or_default().push((step, value));
            }
        });
    }
    for curve in curves.values_mut().flat_map(BTreeMap::values_mut) {
        let every = curve.len().div_ceil(MAX_POINTS).max(1);
        let mut index = 0;
        curve.retain(|_| {
            index += 1;
            (index - 1) % every == 0
        });
    }
    Ok(curves)
}

/// All numbers of a record, those in objects by dotted names.
fn flatten(prefix: &str, value: &Json, each: &mut impl FnMut(&str, f64)) {
    match value {
        Json::Number(number) => each(prefix, number.as_f64().unwrap_or(f64::NAN)),
        Json::Object(map) => {
            for (name, value) in map {
                let name = if prefix.is_empty() { name.clone() } else { format!("{prefix}.{name}") };
                flatten(&name, value, each);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_survive_a_line_that_is_being_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.jsonl");
        let text = "{\"step\":1,\"part\":\"train\",\"loss\":2.0,\"parts\":{\"mse\":1.5}}\n{\"step\":2,\"part\":\"val\",\"loss\":1.0}\n{\"step\":3,\"lo";
        std::fs::write(&path, text).unwrap();
        let curves = curves(File::open(&path).unwrap()).unwrap();
        assert_eq!(curves["train"]["loss"], [(1.0, 2.0)]);
        assert_eq!(curves["train"]["parts.mse"], [(1.0, 1.5)]);
        assert_eq!(curves["val"]["loss"], [(2.0, 1.0)]);
    }
}
