//! Notes where a policy's model was trained with other settings of the environment than it is used with, or on the episodes of the pairs.

use std::fs;
use std::path::Path;

use serde_json::{Map, json};
use swm_core::evaluate::PairSource;
use swm_core::registry::{FRAME_SKIP, TrainedIn, TrainedOn, TrainingDifference};
use swm_core::{EnvConfig, EnvEntry, Manifest, PolicyArgs, PolicyContext, Registry};

use super::{Assignment, Fix, Message, Report};
use crate::evaluation::file_hash;

/// Datasets up to this size are recognized by their content, larger ones by their name.
const MOST_HASHED: u64 = 1 << 30;

/// How the settings of training are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ask {
    /// By settings of the request.
    Here,
    /// By settings of the request, but for the frame skip, which is that of its dataset.
    Dataset,
    /// By settings of the request that makes the manifest.
    Manifest,
    /// The same, but for the frame skip, which is that of the dataset of the manifest.
    ManifestOfDataset,
}

/// Notes where the model behind a policy was trained with other settings than those of `context`.
pub fn note_training(
    registry: &Registry,
    args: &PolicyArgs,
    context: &PolicyContext<'_>,
    ask: Ask,
    report: &mut dyn Report,
) {
    let entry = registry.policy_entry(context.env, &args.name);
    note_training_of(
        args,
        entry.ok().and_then(|entry| entry.trained_in(args)).as_ref(),
        context,
        ask,
        report,
    );
}

/// As [`note_training`], of an evaluation on a manifest; notes where the model was trained on the episodes of its pairs, too.
pub fn note_training_on(
    registry: &Registry,
    env: &EnvEntry,
    manifest: &Manifest,
    args: &PolicyArgs,
    report: &mut dyn Report,
) {
    let config = EnvConfig { image: None, settings: manifest.settings.clone() };
    let context = PolicyContext::new(env, &config).frame_skip(manifest.frame_skip);
    let ask = match manifest.source {
        PairSource::Online => Ask::Manifest,
        _ => Ask::ManifestOfDataset,
    };
    let trained = registry.policy_entry(env, &args.name).ok().and_then(|entry| entry.trained_in(args));
    note_training_of(args, trained.as_ref(), &context, ask, report);
    let dataset = trained.and_then(|trained| trained.dataset);
    if let Some(note) = dataset.and_then(|dataset| seen_pairs(&args.to_string(), &dataset, &manifest.source))
    {
        report.note(&note);
    }
}

/// A note where the model of `policy` was trained on episodes that the pairs' source holds out from training.
fn seen_pairs(policy: &str, trained: &TrainedOn, source: &PairSource) -> Option<Message> {
    let PairSource::Dataset { name, hash, episodes, rows, held_out, .. } = source else { return None };
    let is_as_large = (trained.episodes, trained.rows) == (*episodes, *rows);
    if !is_as_large || !trained.has_seen(*held_out) || !is_same(trained, name, hash) {
        return None;
    }
    let text = format!(
        "{policy} was trained on episodes of {name} that this manifest holds out from training (it held out the share {}); its \
         results say little of new episodes",
        trained.held_out
    );
    let settings = vec![Assignment::of("held_out", *held_out)];
    Some(Message::new(text).fix(Fix::With { how: "train a model with", settings, to: "to claim them" }))
}

/// Whether a model was trained on the dataset of this file name and hash, as far as is known: by content, where it is still there and
/// not large; else by name.
fn is_same(trained: &TrainedOn, name: &str, hash: &str) -> bool {
    match bytes(&trained.path) {
        Some(size) if size <= MOST_HASHED => file_hash(&trained.path).is_ok_and(|found| found == hash),
        _ => trained.path.file_name().is_some_and(|of| of == name),
    }
}

/// Notes where a model was `trained` with other settings than those of `context`.
pub fn note_training_of(
    args: &PolicyArgs,
    trained: Option<&TrainedIn>,
    context: &PolicyContext<'_>,
    ask: Ask,
    report: &mut dyn Report,
) {
    let differences = trained.map_or(Vec::new(), |trained| trained.differences(context));
    if !differences.is_empty() {
        report.note(&message(&args.to_string(), &differences, ask));
    }
}

fn message(policy: &str, differences: &[TrainingDifference], ask: Ask) -> Message {
    let all = |value: fn(&TrainingDifference) -> &str| {
        let one = |found: &TrainingDifference| match found.name.as_str() {
            FRAME_SKIP => format!("{FRAME_SKIP} {}", value(found)),
            name => format!("{name}={}", value(found)),
        };
        differences.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let (skips, options): (Vec<_>, Vec<_>) = differences.iter().partition(|found| found.name == FRAME_SKIP);
    let value = |text: &str| serde_json::from_str(text).unwrap_or_else(|_| json!(text));
    let options: Map<_, _> =
        options.into_iter().map(|found| (found.name.clone(), value(&found.trained))).collect();
    let mut settings = Vec::new();
    if !options.is_empty() {
        settings.push(Assignment::of("env_option", options));
    }
    settings.extend(skips.iter().map(|found| Assignment::of("frame_skip", value(&found.trained))));
    let how = match ask {
        // A dataset is evaluated with its own frame skip: only another dataset has another.
        Ask::Dataset if !skips.is_empty() => "use a dataset that is recorded with",
        Ask::ManifestOfDataset if !skips.is_empty() => "make the manifest of a dataset that is recorded with",
        Ask::Here | Ask::Dataset => "give",
        Ask::Manifest | Ask::ManifestOfDataset => "make the manifest with",
    };
    let text = format!(
        "{policy} was trained with {}, and is used with {}; its results may be far worse",
        all(|found| &found.trained),
        all(|found| &found.used)
    );
    Message::new(text).fix(Fix::With { how, settings, to: "to use it as it was trained" })
}

/// The bytes of a file, or of all files of a folder; `None`: not there.
fn bytes(path: &Path) -> Option<u64> {
    let metadata = fs::metadata(path).ok()?;
    if !metadata.is_dir() {
        return Some(metadata.len());
    }
    fs::read_dir(path).ok()?.map(|entry| bytes(&entry.ok()?.path())).sum()
}

#[cfg(test)]
mod tests {
    use swm_core::testing::TOY;
    use swm_core::{PolicyEntry, Setting, policies};

    use super::*;

    const WALKER: EnvEntry = EnvEntry::new("demo/Walker-v0", "it walks or runs", |config| TOY.make(config))
        .settings(&[Setting::new("task", "what is rewarded", "walk")]);
    const AGENT: PolicyEntry =
        PolicyEntry::new("agent", "a trained agent", |_, _| Ok(Box::new(policies::random()))).trained(|_| {
            let settings = [("task".to_owned(), "run".into())].into_iter().collect();
            Some(TrainedIn::new(WALKER.id).settings(settings).frame_skip(4))
        });

    fn differences(task: &str, frame_skip: u32) -> Vec<TrainingDifference> {
        let registry = Registry::new().with(&[WALKER]).with(&[AGENT]);
        let settings = [("task".to_owned(), task.into())].into_iter().collect();
        let config = EnvConfig { settings, ..EnvConfig::default() };
        let args = PolicyArgs::parse("agent:runs/a").unwrap();
        let trained = registry.policy_entry(&WALKER, "agent").unwrap().trained_in(&args).unwrap();
        trained.differences(&PolicyContext::new(&WALKER, &config).frame_skip(frame_skip))
    }

    #[test]
    fn a_model_that_has_seen_the_pairs_is_noted() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        fs::write(&path, "a dataset").unwrap();
        let source = |hash: &str, held_out| PairSource::Dataset {
            name: "a.h5".to_owned(),
            hash: hash.to_owned(),
            episodes: 20,
            rows: 300,
            goal_offset: 25,
            held_out,
        };
        let note = |path: &Path, rows, share, source: &PairSource| {
            seen_pairs("mpc:runs/a", &TrainedOn::new(path, (20, rows), share), source)
        };
        let hash = file_hash(&path).unwrap();
        let told = note(&path, 300, 0.0, &source(&hash, 0.2)).unwrap().to_string();
        assert!(
            told.contains("mpc:runs/a was trained on episodes of a.h5 that this manifest holds out"),
            "{told}"
        );
        assert!(
            told.ends_with("(it held out the share 0); its results say little of new episodes; train a model with held_out=0.2 to claim them"),
            "{told}"
        );
        assert_eq!(note(&path, 300, 0.2, &source(&hash, 0.2)), None);
        assert_eq!(note(&path, 300, 0.0, &source(&hash, 1.0)), None);
        assert_eq!(note(&path, 301, 0.0, &source(&hash, 0.2)), None);
        assert_eq!(note(&path, 300, 0.0, &source("another", 0.2)), None);
        assert_eq!(note(&path, 300, 0.0, &PairSource::Online), None);
        // What is gone is known by its name alone.
        let gone = folder.path().join("gone/a.h5");
        assert!(note(&gone, 300, 0.1, &source("another", 0.2)).is_some());
        assert_eq!(note(&folder.path().join("gone/b.h5"), 300, 0.1, &source(&hash, 0.2)), None);
    }

    #[test]
    fn both_values_and_the_fix_are_noted() {
        let told =
            |differences: &[TrainingDifference], ask| message("agent:runs/a", differences, ask).to_string();
        let here = told(&differences("walk", 1), Ask::Here);
        let both =
            "agent:runs/a was trained with task=run, frame skip 4, and is used with task=walk, frame skip 1";
        assert!(here.contains(both), "{here}");
        assert!(
            here.ends_with("; give env_option=task=run and frame_skip=4 to use it as it was trained"),
            "{here}"
        );
        let made = told(&differences("walk", 4), Ask::Manifest);
        assert!(
            made.ends_with("; make the manifest with env_option=task=run to use it as it was trained"),
            "{made}"
        );
        assert_eq!(differences("run", 4), []);
        // The frame skip of a dataset is fixed.
        for (ask, how) in
            [(Ask::Dataset, "use a dataset"), (Ask::ManifestOfDataset, "make the manifest of a dataset")]
        {
            let told = told(&differences("run", 1), ask);
            let fix = format!("; {how} that is recorded with frame_skip=4 to use it as it was trained");
            assert!(told.ends_with(&fix), "{told}");
        }
        let dataset = told(&differences("walk", 4), Ask::Dataset);
        assert!(dataset.ends_with("; give env_option=task=run to use it as it was trained"), "{dataset}");
    }
}
