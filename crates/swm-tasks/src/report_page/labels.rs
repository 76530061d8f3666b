//! Names of results on the page: the folder first, then the policy with the settings in which it differs from the others.

use std::path::{Path, PathBuf};

use minijinja::{Value, context};
use serde_json::Value as Json;
use swm_core::settings::text;

use crate::evaluation::Candidate;

/// How a result is named.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Label {
    /// The folder.
    pub(super) name: String,
    /// The policy and its settings; empty where the folder says as much.
    pub(super) detail: String,
    /// What keeps the result from being current, if anything does.
    pub(super) warning: Option<String>,
}

impl Label {
    /// For templates, which know `name`, `detail` and `warning`.
    pub(super) fn context(&self) -> Value {
        context! { name => &self.name, detail => &self.detail, warning => self.warning.as_deref() }
    }
}

/// Labels of results by the paths that they were read from.
pub(super) fn labels(results: &[(&Path, &Candidate)]) -> Vec<Label> {
    let folders: Vec<PathBuf> = results.iter().map(|(path, _)| folder(path)).collect();
    let label = |(index, (_, candidate)): (usize, &(&Path, &Candidate))| {
        let last = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
        let own = last(&folders[index]);
        let same = folders.iter().filter(|other| last(other) == own).count();
        let name = own.filter(|_| same == 1).unwrap_or_else(|| folders[index].display().to_string());
        let settings = settings(candidate, results);
        let policy = &candidate.policy.name;
        let detail = match settings.is_empty() {
            true if *policy == name => String::new(),
            true => policy.clone(),
            false => format!("{policy}: {}", settings.join(", ")),
        };
        Label { name, detail, warning: None }
    };
    results.iter().enumerate().map(label).collect()
}

/// The folder of a result, which may be given by its file.
fn folder(path: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    match (path.extension(), whole.parent()) {
        (Some(extension), Some(parent)) if extension == "json" => parent.to_owned(),
        _ => whole,
    }
}

/// Values without a key, then settings in which results differ (all of them for a single result), then the seed.
fn settings(candidate: &Candidate, results: &[(&Path, &Candidate)]) -> Vec<String> {
    // What another policy lacks it may not have; what the same policy lacks is a default.
    let is_alike = |other: &Candidate, key: &str, value: &Json| match other.policy.named.get(key) {
        Some(known) => known == value,
        None => other.policy.name != candidate.policy.name,
    };
    let shared = |key: &str, value: &Json| {
        results.len() > 1 && results.iter().all(|(_, other)| is_alike(other, key, value))
    };
    let mut settings: Vec<String> = candidate.policy.positional.iter().map(text).collect();
    let named = candidate.policy.named.iter().filter(|(key, value)| !shared(key, value));
    settings.extend(named.map(|(key, value)| format!("{key}={}", text(value))));
    if candidate.seed != 0 {
        settings.push(format!("seed {}", candidate.seed));
    }
    settings
}

#[cfg(test)]
mod tests {
    use swm_core::PolicyArgs;

    use super::*;

    fn named(results: &[(&str, &str, u64)]) -> Vec<String> {
        let candidates: Vec<Candidate> = results
            .iter()
            .map(|(_, policy, seed)| Candidate::new(PolicyArgs::parse(policy).unwrap()).seeded(*seed))
            .collect();
        let results: Vec<_> = results
            .iter()
            .zip(&candidates)
            .map(|((path, ..), candidate)| (Path::new(*path), candidate))
            .collect();
        labels(&results).into_iter().map(|label| format!("{} | {}", label.name, label.detail)).collect()
    }

    #[test]
    fn folders_come_first_and_settings_that_differ_second() {
        let found = named(&[
            ("results/few", "cem:samples=20,horizon=5", 0),
            ("results/many/receipt.json", "cem:samples=300,horizon=5", 7),
            ("results/icem", "icem:horizon=5", 0),
            ("results/learned", "mpc:runs/lewm", 0),
        ]);
        let expected = [
            "few | cem: samples=20",
            "many | cem: samples=300, seed 7",
            "icem | ",
            "learned | mpc: runs/lewm",
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_setting_differs_from_the_default() {
        let found = named(&[("a", "cem", 0), ("b", "cem:samples=32", 0), ("c", "icem", 0)]);
        assert_eq!(found, ["a | cem", "b | cem: samples=32", "c | icem"]);
    }

    #[test]
    fn folders_of_one_name_are_told_apart_by_their_paths() {
        let found = named(&[("/a/cem", "cem:samples=2", 0), ("/b/cem", "cem:samples=2", 0)]);
        assert_eq!(found, ["/a/cem | cem", "/b/cem | cem"]);
        assert_eq!(named(&[("/a/x", "cem:samples=2", 0)]), ["x | cem: samples=2"]);
    }
}
