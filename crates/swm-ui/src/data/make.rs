//! Steps that were picked as starts and goals, as a manifest in the folder for recordings.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::State;
use serde::Deserialize;
use serde_json::json;
use swm_core::evaluate::{ChosenPair, Tier};

use super::blocking;
use crate::error::{Answer, Refusal, json};
use crate::server::App;

/// What the page sends.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    /// The dataset.
    id: String,
    /// As `swm manifest make --pairs` takes them: `3:10-35`.
    pairs: Vec<String>,
    tier: Tier,
    /// Actions allowed.
    budget: u64,
    /// A name in the folder for recordings.
    file: String,
}

/// Makes a manifest by the command that it names in its answer.
pub(crate) async fn make_manifest(State(app): State<Arc<App>>, body: Bytes) -> Answer {
    blocking(move || {
        let Asked { id, pairs, tier, budget, file } = serde_json::from_slice(&body)
            .map_err(|error| Refusal::bad(format!("the page sent `{error}`")))?;
        let commands = app.commands()?;
        let pairs: Vec<String> = pairs
            .iter()
            .map(|text| text.parse::<ChosenPair>().map(|pair| pair.to_string()))
            .collect::<Result<_, _>>()
            .map_err(Refusal::bad)?;
        let out = app.roots.writable(&file)?;
        if !file.ends_with(".json") && !file.ends_with(".toml") {
            return Err(Refusal::bad(format!("`{file}` is no name of a manifest; end it in .json or .toml")));
        }
        let dataset = app.roots.resolve(&id)?;
        let opened = app.store.open(&dataset)?;
        let env = opened.info().runs.first().map(|(_, run)| run.env.as_str()).unwrap_or_default();
        let env = app.registry.env(env).map_err(|error| {
            Refusal::bad(format!("the dataset does not say in which environment it was recorded: {error}"))
        })?;
        let path = |path: &std::path::Path| path.display().to_string();
        let mut words = vec![env.id.to_owned(), "--dataset".to_owned(), path(&dataset)];
        words.extend(["--pairs".to_owned(), pairs.join(",")]);
        words.extend(["--tier", tier.name(), "--budget"].map(str::to_owned));
        words.extend([budget.to_string(), "--out".to_owned(), path(&out)]);
        let manifest = commands.make_manifest(&app.registry, &words)?;
        json(&json!({
            "id": app.roots.saved_id(&file),
            "path": out,
            "pairs": manifest.pairs.len(),
            "hash": manifest.hash(),
            "words": words,
        }))
    })
    .await
}
