//! What there is to choose from: environments, their factors, settings and policies, and formats to record in.

use std::sync::Arc;

use axum::extract::{Query, State};
use serde::Deserialize;
use serde_json::{Value as Json, json};
use swm_core::{
    Dtype, Env, EnvConfig, EnvEntry, FactorSpec, Field, ImageSize, PolicyEntry, Registry, Setting, Space,
};
use swm_data::Format;

use crate::data::blocking;
use crate::error::{Answer, Refusal, json};
use crate::server::App;

/// The environments, the formats, and what may be written.
pub(crate) async fn about(State(app): State<Arc<App>>) -> Answer {
    let envs: Vec<Json> = app
        .registry
        .envs()
        .map(|entry| {
            json!({ "id": entry.id, "summary": entry.summary, "family": entry.family, "success": entry.success })
        })
        .collect();
    let formats = app.registry.all::<Format>().map(|format| {
        json!({ "name": format.name, "extension": format.extensions.first(), "about": format.about })
    });
    json(&json!({
        "version": env!("CARGO_PKG_VERSION"),
        "envs": envs,
        "formats": formats.collect::<Vec<_>>(),
        "save": app.roots.save_folder(),
    }))
}

#[derive(Deserialize)]
pub(crate) struct Id {
    id: String,
}

/// One environment: it is made once, for its description.
pub(crate) async fn env(State(app): State<Arc<App>>, Query(Id { id }): Query<Id>) -> Answer {
    let entry = app.registry.env(&id)?;
    blocking(move || {
        let image = Some(ImageSize { height: 64, width: 64 });
        let made = entry.make(&EnvConfig { image, ..EnvConfig::default() });
        let made = made.map_err(|error| Refusal::bad(crate::error::sentence(&error)))?;
        json(&describe(&app.registry, entry, made.as_ref()))
    })
    .await
}

fn describe(registry: &Registry, entry: &EnvEntry, made: &dyn Env) -> Json {
    let spec = made.spec();
    let policies = registry.policies(entry).filter(|policy| policy.suits(made)).map(policy);
    json!({
        "id": entry.id,
        "summary": entry.summary,
        "settings": settings(entry.settings),
        "policies": policies.collect::<Vec<_>>(),
        "planner": entry.planner,
        "factors": spec.factors.iter().map(factor).collect::<Vec<_>>(),
        "action": space(&spec.action),
        "columns": spec.fields.iter().map(column).collect::<Vec<_>>(),
        "time_step_s": spec.time_step_s,
    })
}

fn policy(entry: &PolicyEntry) -> Json {
    json!({
        "name": entry.name,
        "summary": entry.summary,
        "settings": settings(entry.settings),
        "is_planner": entry.on_true_dynamics,
    })
}

/// Settings of a table, for a form.
pub(crate) fn settings<'a>(settings: impl IntoIterator<Item = &'a Setting>) -> Vec<Json> {
    let one =
        |setting: &Setting| json!({ "name": setting.name, "doc": setting.doc, "default": setting.default });
    settings.into_iter().map(one).collect()
}

fn factor(factor: &FactorSpec) -> Json {
    json!({
        "name": factor.name,
        "doc": factor.doc,
        "space": space(&factor.space),
        "default": factor.default,
        "sampled": factor.sampled_by_default,
        "constraint": factor.constraint,
        "choices": factor.choices,
        "shows_with": factor.shows_with,
    })
}

fn space(space: &Space) -> Json {
    let (low, high) = space.bounds();
    let dtype = space.dtype().map(Dtype::name);
    json!({ "kind": space.kind(), "shape": space.shape(), "dtype": dtype, "low": low, "high": high })
}

/// A column of a table.
pub(crate) fn column(field: &Field) -> Json {
    json!({ "name": field.name, "dtype": field.dtype.name(), "shape": field.shape, "kind": field.kind })
}
