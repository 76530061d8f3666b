//! Steps that were picked as starts and goals, as a manifest in the folder for recordings.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::State;
use serde::Deserialize;
use serde_json::json;
use swm_core::evaluate::{ChosenPair, Tier};
use swm_core::settings::Settings as _;
use swm_tasks::request::{MakeManifest, Message, Request as _};

use super::{blocking, opening_of};
use crate::error::{Answer, Refusal, json};
use crate::requests::option_words;
use crate::server::App;

/// What the page sends.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    /// The dataset.
    id: String,
    /// How it is opened, as the JSON of `OpenOptions`.
    #[serde(default)]
    opening: Option<String>,
    /// As `swm manifest make --pairs` takes them: `3:10-35`.
    pairs: Vec<String>,
    tier: Tier,
    /// Actions allowed.
    budget: u64,
    /// A name in the folder for recordings.
    file: String,
}

/// Makes a manifest, and names in its answer the command that makes the same.
pub(crate) async fn make_manifest(State(app): State<Arc<App>>, body: Bytes) -> Answer {
    blocking(move || {
        let Asked { id, opening, pairs, tier, budget, file } = serde_json::from_slice(&body)
            .map_err(|error| Refusal::bad(format!("the page sent `{error}`")))?;
        if pairs.is_empty() {
            return Err(Refusal::bad("no pairs are picked; write EPISODE:START-GOAL, such as 3:10-35"));
        }
        let pairs: Vec<ChosenPair> =
            pairs.iter().map(|text| text.parse()).collect::<Result<_, String>>().map_err(Refusal::bad)?;
        let out = app.roots.writable(&file)?;
        if !file.ends_with(".json") && !file.ends_with(".toml") {
            return Err(Refusal::bad(format!("`{file}` is no name of a manifest; end it in .json or .toml")));
        }
        let dataset = app.roots.resolve(&id)?;
        let opening = opening_of(opening.as_deref())?;
        let opened = app.store.open(&app.roots, &dataset, &opening)?;
        let env = opened.info().runs.first().map(|(_, run)| run.env.as_str()).unwrap_or_default();
        let env = app.registry.env(env).map_err(|error| {
            Refusal::bad(format!("the dataset does not say in which environment it was recorded: {error}"))
        })?;
        let request = MakeManifest {
            env: env.id.to_owned(),
            dataset: Some(dataset),
            opening,
            pairs: Some(pairs),
            tier,
            budget: Some(budget),
            out,
            ..MakeManifest::default()
        };
        let words = option_words(request.changed(), "env");
        let mut notes: Vec<Message> = Vec::new();
        let manifest = request.run(&app.registry, &mut notes)?;
        json(&json!({
            "id": app.roots.saved_id(&file),
            "path": request.out,
            "pairs": manifest.pairs.len(),
            "hash": manifest.hash(),
            "words": words,
            "notes": notes.iter().map(ToString::to_string).collect::<Vec<_>>(),
        }))
    })
    .await
}
