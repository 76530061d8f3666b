//! Results of a model that has changed since.

use std::collections::BTreeMap;
use std::path::Path;

use swm_core::Registry;

use super::hash::file_hash;
use super::receipt::Receipt;

/// What has happened to the files of a result's model since it was evaluated, as a sentence; `None` where they are the same, the
/// policy has no model, or its files are not there to be compared.
pub fn changed_model(registry: &Registry, receipt: &Receipt) -> Option<String> {
    if receipt.files.is_empty() {
        return None;
    }
    let entry = registry.env(&receipt.manifest.env).ok()?;
    // A build without the policy, or a run that has moved: then what is left of the files that were hashed.
    let now = receipt.candidate.files(registry, entry).unwrap_or_else(|_| {
        let hashes =
            receipt.files.keys().filter_map(|file| Some((file.clone(), file_hash(Path::new(file)).ok()?)));
        hashes.collect()
    });
    let what = difference(&receipt.files, &now)?;
    Some(format!("{what}; evaluate again, and replace the result"))
}

/// What differs between the hashes of a model's files, by their names.
fn difference(then: &BTreeMap<String, String>, now: &BTreeMap<String, String>) -> Option<String> {
    if let Some(newer) = now.keys().find(|file| !then.contains_key(*file)) {
        return Some(format!("The model has been trained since this result, and is {newer} now"));
    }
    let changed = now.iter().find(|(file, hash)| then.get(*file) != Some(hash));
    changed.map(|(file, _)| format!("The model has changed since this result: {file} is another file now"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(all: &[(&str, &str)]) -> BTreeMap<String, String> {
        all.iter().map(|&(file, hash)| (file.to_owned(), hash.to_owned())).collect()
    }

    #[test]
    fn a_newer_checkpoint_and_other_weights_are_told_and_what_is_gone_is_not() {
        let then = files(&[("run/config.json", "a"), ("run/step-100", "b")]);
        assert_eq!(difference(&then, &then), None);
        assert_eq!(difference(&then, &files(&[])), None);
        assert_eq!(difference(&then, &files(&[("run/config.json", "a")])), None);
        let further = difference(&then, &files(&[("run/config.json", "c"), ("run/step-200", "d")])).unwrap();
        assert_eq!(further, "The model has been trained since this result, and is run/step-200 now");
        let other = difference(&then, &files(&[("run/config.json", "a"), ("run/step-100", "d")])).unwrap();
        assert_eq!(other, "The model has changed since this result: run/step-100 is another file now");
    }
}
