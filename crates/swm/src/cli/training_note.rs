//! Notes where a policy's model was trained with other settings of the environment than it is used with.

use swm_core::evaluate::PairSource;
use swm_core::registry::{FRAME_SKIP, TrainedIn, TrainingDifference};
use swm_core::{EnvConfig, EnvEntry, Manifest, PolicyArgs, PolicyContext, Registry};

use super::Output;

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
    of_policy(registry, args, &context, ask, output);
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
