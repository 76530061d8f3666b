//! Requests that the page runs: a recording, an evaluation, a sweep or a training, with its result in the folder for recordings.
//!
//! What is asked for is the value that the command, Python and jobs run ([`Divided`]), so that the files are equal. The page gives
//! its settings as JSON; where the result goes is a name in that folder, and what is read lies below the paths of the server.

mod running;
mod words;

use std::path::PathBuf;
use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::State;
use serde::Deserialize;
use serde_json::{Map, Value as Json, json};
use swm_core::Registry;
use swm_tasks::request::{Divided, policy_args};

use crate::data::blocking;
use crate::error::{Answer, Refusal, json};
use crate::play::catalog::settings;
use crate::roots::Roots;
use crate::server::App;

pub(crate) use running::Requests;
pub(crate) use words::{command_line, option_words};

/// Settings whose texts are policies with arguments.
const POLICIES: &[&str] = &["policy", "reference", "oracle"];
/// Settings whose texts are names, with a slash in some.
const NAMES: &[&str] = &["env", "baseline"];

/// The kinds of requests, each with the settings that the page may give.
pub(crate) async fn kinds() -> Answer {
    let kinds = Divided::KINDS.iter().map(|kind| {
        let given = kind.settings.iter().filter(|setting| !kind.placed.contains(&setting.name));
        json!({ "name": kind.name, "settings": settings(given) })
    });
    json(&json!({ "kinds": kinds.collect::<Vec<_>>() }))
}

/// What the page sends.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    /// `{"evaluate": {…}}`, as a job has it; of a training one, not a list.
    request: Map<String, Json>,
    /// The result's name in the folder for recordings.
    name: String,
}

/// Begins a request, or checks it and names the command that makes the same.
async fn ask(app: Arc<App>, body: Bytes, begins: bool) -> Answer {
    blocking(move || {
        let Asked { request, name } = serde_json::from_slice(&body)
            .map_err(|error| Refusal::bad(format!("the page sent `{error}`")))?;
        let out = app.roots.writable(&name)?;
        // Before a file is looked at that another request writes.
        app.requests.check_name(&name)?;
        let request = read(&app.registry, &app.roots, request)?.at(out.clone());
        let needs = request.needs(&app.registry, &mut ())?;
        needs.inputs.iter().try_for_each(|input| app.roots.check_path(input))?;
        let words = command_line(&request);
        let number = match begins {
            true => Some(app.requests.begin(&app, request, words.clone(), name)?),
            false => None,
        };
        json(&json!({ "number": number, "words": words, "path": out }))
    })
    .await
}

/// Begins a request; the answer has its number and the words of the command that makes the same.
pub(crate) async fn begin(State(app): State<Arc<App>>, body: Bytes) -> Answer {
    ask(app, body, true).await
}

/// Checks a request, as [`begin`] does.
pub(crate) async fn check(State(app): State<Arc<App>>, body: Bytes) -> Answer {
    ask(app, body, false).await
}

/// The requests of this server, the newest first.
pub(crate) async fn list(State(app): State<Arc<App>>) -> Answer {
    json(&json!({ "requests": app.requests.list(&app.roots) }))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Stopped {
    number: usize,
}

/// Asks a request to end early.
pub(crate) async fn stop(State(app): State<Arc<App>>, body: Bytes) -> Answer {
    let Stopped { number } =
        serde_json::from_slice(&body).map_err(|error| Refusal::bad(format!("the page sent `{error}`")))?;
    app.requests.stop(number)?;
    json(&json!({}))
}

/// The request, once nothing in it names a file outside of the server's paths.
fn read(registry: &Registry, roots: &Roots, mut given: Map<String, Json>) -> Result<Divided, Refusal> {
    for kind in Divided::KINDS {
        let Some(Json::Object(changed)) = given.get_mut(kind.name) else { continue };
        if let Some(name) = kind.placed.iter().find(|name| changed.contains_key(**name)) {
            return Err(Refusal::bad(format!(
                "{name}: the page gives it by the result's name; leave it out"
            )));
        }
        for (name, value) in &*changed {
            check_setting(registry, roots, name, value)?;
        }
        if kind.name == "train" {
            let run = std::mem::take(changed);
            given.insert("train".to_owned(), json!([run]));
        }
    }
    Ok(Divided::try_from(given)?)
}

/// Refuses a setting that names a file elsewhere. It does so before anything is read.
fn check_setting(registry: &Registry, roots: &Roots, name: &str, value: &Json) -> Result<(), Refusal> {
    match value {
        Json::String(_) if NAMES.contains(&name) => Ok(()),
        Json::String(text) if POLICIES.contains(&name) => {
            if let Some((_, rest)) = text.split_once(":@") {
                roots.check_path(&PathBuf::from(rest.split(',').next().unwrap_or_default()))?;
            }
            // `all` and `none` are no policies.
            policy_args(registry, text).map_or(Ok(()), |args| roots.check_policy(&args))
        }
        Json::Array(items) if POLICIES.contains(&name) => {
            items.iter().try_for_each(|item| check_setting(registry, roots, name, item))
        }
        value => roots.check_json(value),
    }
}
