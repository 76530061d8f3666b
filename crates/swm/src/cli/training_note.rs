//! Notes where a policy's model was trained with other settings of the environment than it is used with, or on the episodes of the pairs.

use swm_core::evaluate::PairSource;
use swm_core::registry::{FRAME_SKIP, TrainedIn, TrainedOn, TrainingDifference};
use swm_core::{EnvConfig, EnvEntry, Manifest, PolicyArgs, PolicyContext, Registry};

use super::Output;
use crate::evaluation::file_hash;
use crate::jobs::files::bytes;

/// Datasets up to this size are recognized by their content, larger ones by their name.
const MOST_HASHED: u64 = 1 << 30;

/// How the settings of training are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ask {
    /// By options of the command at work.
    Here,
    /// By options of the command at work, but for the frame skip, which is that of the command's dataset.
    Dataset,
    /// By options of the command that makes the manifest.
    Manifest,
    /// The same, but for the frame skip, which is that of the dataset of the manifest.
    ManifestOfDataset,
}

/// A note where the model behind a policy was trained with other settings than those of `context`.
pub(super) fn of_policy(
    registry: &Registry,
    args: &PolicyArgs,
    context: &PolicyContext<'_>,
    ask: Ask,
    output: &Output,
) {
    let entry = registry.policy_entry(context.env, &args.name);
    of_model(args, entry.ok().and_then(|entry| entry.trained_in(args)).as_ref(), context, ask, output);
}

/// The same of an evaluation on a manifest.
pub(super) fn of_policy_on(
    registry: &Registry,
    env: &EnvEntry,
    manifest: &Manifest,
    args: &PolicyArgs,
    output: &Output,
) {
    let config = EnvConfig { image: None, settings: manifest.settings.clone() };
    let context = PolicyContext::new(env, &config).frame_skip(manifest.frame_skip);
    let ask = match manifest.source {
        PairSource::Online => Ask::Manifest,
        _ => Ask::ManifestOfDataset,
    };
    let trained = registry.policy_entry(env, &args.name).ok().and_then(|entry| entry.trained_in(args));
    of_model(args, trained.as_ref(), &context, ask, output);
    let dataset = trained.and_then(|trained| trained.dataset);
    if let Some(note) = dataset.and_then(|dataset| seen_pairs(&args.to_string(), &dataset, &manifest.source))
    {
        output.note(note);
    }
}

/// A note where the model of `policy` was trained on episodes that the pairs' source holds out from training.
fn seen_pairs(policy: &str, trained: &TrainedOn, source: &PairSource) -> Option<String> {
    let PairSource::Dataset { name, hash, episodes, rows, held_out, .. } = source else { return None };
    let is_as_large = (trained.episodes, trained.rows) == (*episodes, *rows);
    if !is_as_large || !trained.has_seen(*held_out) || !is_same(trained, name, hash) {
        return None;
    }
    Some(format!(
        "note: {policy} was trained on episodes of {name} that this manifest holds out from training; its results say little of new \
         episodes: a model trained with --held-out {held_out} can claim them, and this one was with {}",
        trained.held_out
    ))
}

/// Whether a model was trained on the dataset of this file name and hash, as far as is known: by content, where it is still there and
/// not large; else by name.
fn is_same(trained: &TrainedOn, name: &str, hash: &str) -> bool {
    match bytes(&trained.path) {
        Ok(size) if size <= MOST_HASHED => file_hash(&trained.path).is_ok_and(|found| found == hash),
        _ => trained.path.file_name().is_some_and(|of| of == name),
    }
}

/// A note where a model was `trained` with other settings than those of `context`.
pub(super) fn of_model(
    args: &PolicyArgs,
    trained: Option<&TrainedIn>,
    context: &PolicyContext<'_>,
    ask: Ask,
    output: &Output,
) {
    let differences = trained.map_or(Vec::new(), |trained| trained.differences(context));
    if !differences.is_empty() {
        output.note(text(&args.to_string(), &differences, ask));
    }
}

fn text(policy: &str, differences: &[TrainingDifference], ask: Ask) -> String {
    let all = |value: fn(&TrainingDifference) -> &str| {
        let one = |found: &TrainingDifference| match found.name.as_str() {
            FRAME_SKIP => format!("{FRAME_SKIP} {}", value(found)),
            name => format!("{name}={}", value(found)),
        };
        differences.iter().map(one).collect::<Vec<_>>().join(", ")
    };
    let option = |found: &TrainingDifference| match found.name.as_str() {
        FRAME_SKIP => format!("--frame-skip {}", found.trained),
        name => format!("--env-option {name}={}", found.trained),
    };
    let options = differences.iter().map(option).collect::<Vec<_>>().join(" ");
    let skips = differences.iter().any(|found| found.name == FRAME_SKIP);
    let fix = match ask {
        // A dataset is evaluated with its own frame skip: only another dataset has another.
        Ask::Dataset if skips => {
            format!("a dataset that is recorded with {options} evaluates it as it was trained")
        }
        Ask::ManifestOfDataset if skips => {
            format!("a manifest of a dataset that is recorded with {options} evaluates it as it was trained")
        }
        Ask::Here | Ask::Dataset => format!("{options} uses it as it was trained"),
        Ask::Manifest | Ask::ManifestOfDataset => {
            format!("a manifest made with {options} evaluates it as it was trained")
        }
    };
    format!(
        "note: {policy} was trained with {}, and is used with {}; its results may be far worse: {fix}",
        all(|found| &found.trained),
        all(|found| &found.used)
    )
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
    fn a_model_that_has_seen_the_pairs_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.h5");
        std::fs::write(&path, "a dataset").unwrap();
        let source = |hash: &str, held_out| PairSource::Dataset {
            name: "a.h5".to_owned(),
            hash: hash.to_owned(),
            episodes: 20,
            rows: 300,
            goal_offset: 25,
            held_out,
        };
        let note = |path: &std::path::Path, rows, share, source: &PairSource| {
            seen_pairs("mpc:runs/a", &TrainedOn::new(path, (20, rows), share), source)
        };
        let hash = file_hash(&path).unwrap();
        let told = note(&path, 300, 0.0, &source(&hash, 0.2)).unwrap();
        assert!(
            told.contains("mpc:runs/a was trained on episodes of a.h5 that this manifest holds out"),
            "{told}"
        );
        assert!(
            told.contains("trained with --held-out 0.2 can claim them, and this one was with 0"),
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
    fn both_values_and_the_fix_are_told() {
        let told = text("agent:runs/a", &differences("walk", 1), Ask::Here);
        assert!(
            told.contains("agent:runs/a was trained with task=run, frame skip 4, and is used with task=walk, frame skip 1"),
            "{told}"
        );
        assert!(told.ends_with(": --env-option task=run --frame-skip 4 uses it as it was trained"), "{told}");
        let told = text("agent:runs/a", &differences("walk", 4), Ask::Manifest);
        assert!(
            told.ends_with("a manifest made with --env-option task=run evaluates it as it was trained"),
            "{told}"
        );
        assert_eq!(differences("run", 4), []);
        // With a dataset, `--frame-skip` is refused.
        for (ask, of) in [(Ask::Dataset, "a dataset"), (Ask::ManifestOfDataset, "a manifest of a dataset")] {
            let told = text("agent:runs/a", &differences("run", 1), ask);
            let fix = format!(": {of} that is recorded with --frame-skip 4 evaluates it as it was trained");
            assert!(told.ends_with(&fix), "{told}");
        }
        let told = text("agent:runs/a", &differences("walk", 4), Ask::Dataset);
        assert!(told.ends_with(": --env-option task=run uses it as it was trained"), "{told}");
    }
}
