//! Datasets: what they hold, their episodes by filter, images, values of an episode, samples of columns.

mod image;
mod make;
mod opened;
mod query;
mod sample;

use std::sync::Arc;

use axum::extract::{Query, State};
use axum::http::header;
use axum::response::{IntoResponse as _, Response};
use serde::Deserialize;
use serde_json::{Map, Value as Json, json};
use swm_core::settings;
use swm_data::OpenOptions;
use swm_media::Format;

use crate::error::{Answer, Refusal, json};
use crate::play::catalog::column;
use crate::server::App;

pub(crate) use image::{MAX_VIDEO, encode};
pub(crate) use make::make_manifest;
use opened::Opened;
pub(crate) use opened::Store;
use query::Filter;

/// Does work that takes its time on a thread for it.
pub(crate) async fn blocking(work: impl FnOnce() -> Answer + Send + 'static) -> Answer {
    match tokio::task::spawn_blocking(work).await {
        Ok(answer) => answer,
        Err(_) => Err(Refusal::new(
            axum::http::StatusCode::INTERNAL_SERVER_ERROR,
            "the request failed within the server, which is a bug",
        )),
    }
}

/// Opens the dataset, and works on it.
async fn with(
    app: Arc<App>,
    Named { id, opening }: Named,
    work: impl FnOnce(&Opened) -> Answer + Send + 'static,
) -> Answer {
    blocking(move || {
        let path = app.roots.resolve(&id)?;
        let opening = opening_of(opening.as_deref())?;
        work(app.store.open(&app.roots, &path, &opening)?.as_ref())
    })
    .await
}

/// A dataset: its id, and how one of another program is opened, as the JSON of `OpenOptions`.
#[derive(Clone, Deserialize)]
pub(crate) struct Named {
    id: String,
    #[serde(default)]
    opening: Option<String>,
}

/// The options of opening that a page may ask for: nothing is written for it.
pub(super) fn opening_of(json: Option<&str>) -> Result<OpenOptions, Refusal> {
    let Some(json) = json else { return Ok(OpenOptions::default()) };
    let given: Map<String, Json> = serde_json::from_str(json)
        .map_err(|error| Refusal::bad(format!("the options of opening: {error}")))?;
    if given.contains_key("storage") {
        return Err(Refusal::bad(
            "storage: the page decodes nothing into a folder; use the command, or convert the dataset first",
        ));
    }
    let options: OpenOptions = settings::read(&given).map_err(|wrong| Refusal::bad(wrong.to_string()))?;
    options.check().map_err(|error| Refusal::bad(error.to_string()))?;
    Ok(options)
}

/// Columns, runs and sizes.
pub(crate) async fn about(State(app): State<Arc<App>>, Query(named): Query<Named>) -> Answer {
    with(app, named, |opened| {
        let info = opened.info();
        let steps: usize = info.lengths.iter().sum();
        let runs = info.runs.iter().map(|(first, run)| json!({ "first_episode": first, "run": run }));
        let skipped = info.skipped.iter().map(|(name, reason)| json!({ "name": name, "reason": reason }));
        json(&json!({
            "path": info.path.display().to_string(),
            "format": info.format,
            "episodes": info.lengths.len(),
            "steps": steps,
            "shortest": info.lengths.iter().min(),
            "longest": info.lengths.iter().max(),
            "columns": info.schema.fields().iter().map(column).collect::<Vec<_>>(),
            "images": opened.image_columns(),
            "can_render": opened.can_render(),
            "runs": runs.collect::<Vec<_>>(),
            "skipped": skipped.collect::<Vec<_>>(),
            "mapping": *info.mapping,
            "notes": *info.notes,
            "opening": *info.opening,
        }))
    })
    .await
}

#[derive(Deserialize)]
pub(crate) struct Episodes {
    id: String,
    #[serde(default)]
    opening: Option<String>,
    #[serde(default)]
    first: usize,
    #[serde(default = "page")]
    count: usize,
    #[serde(flatten)]
    filter: Filter,
}

fn page() -> usize {
    48
}

/// Episodes that pass a filter, with length, return and success, a page at a time.
pub(crate) async fn episodes(State(app): State<Arc<App>>, Query(asked): Query<Episodes>) -> Answer {
    let Episodes { id, opening, first, count, filter } = asked;
    with(app, Named { id, opening }, move |opened| {
        let (matching, known) = query::matching(opened, &filter)?;
        let shown = matching.iter().skip(first).take(count.min(500));
        let shown = shown.map(|&episode| query::summary(opened, episode)).collect::<Result<Vec<_>, _>>()?;
        json(&json!({ "matching": matching.len(), "known": known, "of": opened.info().lengths.len(), "episodes": shown }))
    })
    .await
}

#[derive(Deserialize)]
pub(crate) struct Image {
    id: String,
    #[serde(default)]
    opening: Option<String>,
    episode: usize,
    /// Of a video: nothing.
    #[serde(default)]
    step: usize,
    /// No column: that of the observation.
    #[serde(default)]
    column: Option<String>,
    /// Side of an image that is rendered, because the recording has none or with other factors.
    #[serde(default)]
    render: Option<usize>,
    /// Factors in place of the recorded ones, as a JSON object.
    #[serde(default)]
    set: Option<String>,
}

/// One image as PNG.
pub(crate) async fn image(State(app): State<Arc<App>>, Query(asked): Query<Image>) -> Answer {
    let registry = app.registry.clone();
    let named = Named { id: asked.id.clone(), opening: asked.opening.clone() };
    let still = move |opened: &Opened| Ok(file("image/png", image::still(opened, &registry, &asked)?));
    with(app, named, still).await
}

/// An episode as a video.
pub(crate) async fn video(State(app): State<Arc<App>>, Query(asked): Query<Image>) -> Answer {
    let registry = app.registry.clone();
    let named = Named { id: asked.id.clone(), opening: asked.opening.clone() };
    with(app, named, move |opened| {
        let (format, bytes) = image::video(opened, &registry, &asked)?;
        Ok(file(if format == Format::Gif { "image/gif" } else { "video/mp4" }, bytes))
    })
    .await
}

fn file(kind: &'static str, bytes: Vec<u8>) -> Response {
    ([(header::CONTENT_TYPE, kind)], bytes).into_response()
}

#[derive(Deserialize)]
pub(crate) struct Values {
    id: String,
    #[serde(default)]
    opening: Option<String>,
    episode: usize,
}

/// The values of all columns of an episode, images apart.
pub(crate) async fn values(
    State(app): State<Arc<App>>,
    Query(Values { id, opening, episode }): Query<Values>,
) -> Answer {
    with(app, Named { id, opening }, move |opened| json(&sample::episode(opened, episode)?)).await
}

#[derive(Deserialize)]
pub(crate) struct Sample {
    id: String,
    #[serde(default)]
    opening: Option<String>,
    column: String,
}

/// Values of a column from all over the dataset, for histograms and coverage.
pub(crate) async fn sample(
    State(app): State<Arc<App>>,
    Query(Sample { id, opening, column }): Query<Sample>,
) -> Answer {
    with(app, Named { id, opening }, move |opened| json(&sample::column(opened, &column)?)).await
}
