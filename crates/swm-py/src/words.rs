//! Messages of the core name commands and their options; a Python user is told the functions and arguments that do the same.

use serde_json::Value as Json;
use swm::tasks::request::{List, Words};

/// Settings of a request as keyword arguments: `image_shape=(64, 64)`.
#[derive(Default)]
pub(crate) struct Arguments {
    /// The request, where it has names of its own.
    pub(crate) request: &'static str,
}

/// Settings that have a name of their own in a request, whatever the others call them.
const OF_REQUEST: &[(&str, &str, &str)] = &[
    ("board", "out", "out"),
    ("bundle", "out", "out"),
    ("canonical", "set", "canonical"),
    ("convert", "image_size", "image_size"),
    ("convert", "target", "dest"),
    ("evaluate", "out", "out"),
    ("look", "set", "look"),
    ("merge", "image_size", "image_size"),
    ("merge", "out", "dest"),
    ("preview", "dataset", "source"),
    ("preview", "image_size", "image_size"),
    ("preview", "out", "out"),
    ("replay", "dataset", "path"),
    ("reproduce", "figure", "figures"),
    ("reproduce", "out", "out"),
    ("split", "image_size", "image_size"),
    ("split", "out", "out"),
    ("render", "out", "out"),
    ("sweep", "out", "out"),
    ("train", "env", "env"),
    ("train", "env_option", "env_options"),
    ("train", "max_steps", "max_steps"),
    ("train", "out", "out"),
    ("train", "set", "settings"),
    ("train", "vary", "vary"),
    ("verify", "dataset", "source"),
];

/// Requests whose `overwrite` is a mode of writing here.
const COPIES: &[&str] = &["convert", "merge", "split"];

/// Settings that have another name here.
const NAMES: &[(&str, &str)] = &[
    ("distractor", "distractors"),
    ("env", "env_name"),
    ("image_size", "image_shape"),
    ("key_frames", "key_frame_period"),
    ("max_steps", "max_episode_steps"),
    ("out", "path"),
    ("reference", "references"),
    ("set", "variation_values"),
    ("vary", "variation"),
];

impl Words for Arguments {
    fn setting(&self, name: &str, value: Option<&Json>) -> String {
        let own = OF_REQUEST.iter().find(|(request, core, _)| (*request, *core) == (self.request, name));
        let other = || NAMES.iter().find(|(core, _)| *core == name).map_or(name, |(_, here)| *here);
        let here = own.map_or_else(other, |(.., here)| *here);
        match (name, value) {
            ("overwrite", Some(Json::Bool(true))) if COPIES.contains(&self.request) => {
                "mode=\"overwrite\"".to_owned()
            }
            // Settings of the environment are arguments of their own.
            ("env_option", Some(Json::Object(settings))) if own.is_none() => {
                let each = settings.iter().map(|(name, value)| format!("{name}={}", literal(value)));
                each.collect::<Vec<_>>().join(", ")
            }
            ("shard", Some(Json::String(part))) => format!("{here}=({})", part.replace('/', ", ")),
            (_, Some(value)) => format!("{here}={}", literal(value)),
            (_, None) => here.to_owned(),
        }
    }

    fn list(&self, list: &List) -> String {
        match list {
            List::Factors(_) => "`variation_space` of the environment".to_owned(),
            List::Solvers => "`swm.planning`".to_owned(),
            _ => "the documentation".to_owned(),
        }
    }
}

/// A value as Python writes it.
fn literal(value: &Json) -> String {
    let joined = |items: Vec<String>| items.join(", ");
    match value {
        Json::Null => "None".to_owned(),
        Json::Bool(true) => "True".to_owned(),
        Json::Bool(false) => "False".to_owned(),
        Json::Number(number) => number.to_string(),
        Json::String(text) => format!("{text:?}"),
        Json::Array(items) => format!("[{}]", joined(items.iter().map(literal).collect())),
        Json::Object(map) => match (map.get("height"), map.get("width")) {
            (Some(height), Some(width)) => format!("({height}, {width})"),
            _ => {
                let items = map.iter().map(|(name, value)| format!("{name:?}: {}", literal(value)));
                format!("{{{}}}", joined(items.collect()))
            }
        },
    }
}

/// What the core says, and what it is here.
const WORDS: &[(&str, &str)] = &[
    ("`swm envs` lists", "`swm.envs.WORLDS` lists"),
    ("`swm fovs ENV` lists", "`variation_space` of the environment lists"),
    ("`swm convert --help` lists", "`swm.data.list_formats()` lists"),
    ("`swm manifest make`", "`swm.make_manifest`"),
    ("`swm bundle`", "`swm.bundle`"),
    ("`swm merge`", "`swm.data.merge`"),
    ("`swm verify`", "`swm.data.verify`"),
    ("this program was built without the feature", "this package is built without the feature"),
];

/// A message of the core in words of Python. The package brings the command as `swm-rs`, for what has no function.
pub(crate) fn in_python(message: &str) -> String {
    const OF_ENV: &str = "`swm envs ";
    let mut told = message.to_owned();
    while let Some((before, rest)) = told.split_once(OF_ENV)
        && let Some((id, after)) = rest.split_once('`')
    {
        // Ids of the core are this package's own numbering.
        told = format!("{before}`swm.envs.info(\"{}\")`{after}", id.replacen("swm/", "swm_rs/", 1));
    }
    for (command, python) in WORDS {
        told = told.replace(command, python);
    }
    with_feature(&told.replace("`swm ", "`swm-rs "))
}

/// Where a message names the build of the command that has a feature: the wheel that has it, or that only the command can.
fn with_feature(told: &str) -> String {
    let Some((before, build)) = told.split_once(": in a checkout, cargo install") else {
        return told.to_owned();
    };
    // No one has a crate of their own here.
    let build = build.split("; in a crate of your own").next().unwrap_or(build);
    if before.contains("the feature `lance`") {
        return format!("{before}; in a checkout, `cargo xtask wheel --lance` builds a wheel that has it");
    }
    if before.contains("the feature `baselines`") {
        return format!(
            "{before}, which every wheel has; install one, or build it in a checkout by `cargo xtask wheel`"
        );
    }
    format!(
        "{before}, and no wheel has it; use the command `swm` in place of Python, built in a checkout by `cargo install{build}`"
    )
}
