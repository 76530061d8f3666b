//! Tests of trainings as requests: refusals, with trainers that only note what they are asked for.

use swm_core::registry::Absent;

use super::*;

const TRAINERS: &[TrainerEntry] = &[
    TrainerEntry::new("lewm", "a world model", &["paper", "small"], Learns::FromClips, began, train),
    TrainerEntry::new("sac", "an agent", &["small"], Learns::Online, began, train),
    TrainerEntry::new("tdmpc2", "an agent", &["small"], Learns::OnlineOrFromSteps, began, train),
];

/// Runs of these tests hold the name of what began them alone.
fn began(run: &Path) -> Result<String, TaskError> {
    std::fs::read_to_string(run.join("name")).map_err(wrong)
}

fn train(request: &Train, _registry: &Registry, _report: &mut dyn Report) -> Result<Trained, TaskError> {
    Ok(Trained::new(request.folder(), Vec::new(), json!({ "step": request.steps })))
}

fn ask(given: &Json) -> Result<Trained, TaskError> {
    let given = given.as_object().unwrap();
    Train::from_json(given).and_then(|asked| asked.run(&Registry::new().with(TRAINERS), &mut ()))
}

#[test]
fn every_refusal_names_the_setting_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["lewm", "sac", "other"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
        std::fs::write(folder.path().join(name).join("name"), name).unwrap();
    }
    let run = |name: &str| folder.path().join(name);
    let with = |own: Json, more: Json| {
        let (Json::Object(mut own), Json::Object(more)) = (own, more) else { panic!("they are objects") };
        own.extend(more);
        Json::Object(own)
    };
    let new = |name: &str, more: Json| with(json!({ "baseline": name, "out": "run" }), more);
    let lewm = |more: Json| with(new("lewm", json!({ "dataset": "a.h5" })), more);
    let sac = |more: Json| with(new("sac", json!({ "env": "swm/PushT-v1" })), more);
    let steps = |more: Json| with(new("tdmpc2", json!({ "dataset": "a.h5" })), more);
    let resume = |name: &str, more: Json| with(json!({ "resume": run(name) }), more);
    let any = |fixes: Vec<Fix>| Some(Fix::Any(fixes));
    let leave = |name: &'static str| Some(Fix::Leave(name));
    let leaves = |name: &'static str| any(vec![Fix::Leave(name)]);
    let instead = |other: &'static str, name: &'static str| any(vec![Fix::give(other), Fix::Leave(name)]);
    let of_dataset = "learns from a dataset, without this setting";
    let table = [
        (json!({ "out": "run" }), "baseline: must be given", None),
        (json!({ "baseline": "lewm" }), "out: name the folder of the new run", None),
        (
            new("lewn", json!({})),
            "unknown baseline or agent `lewn` (did you mean `lewm`?); there are: lewm, sac",
            None,
        ),
        (new("lewm", json!({})), "dataset: name the dataset that lewm learns from", None),
        (
            new("sac", json!({})),
            "sac learns in an environment, and none is named",
            any(vec![Fix::set("env", "swm/CartpoleDMControl-v0")]),
        ),
        (
            new("tdmpc2", json!({})),
            "tdmpc2 learns in an environment, and none is named",
            any(vec![Fix::set("env", "swm/CartpoleDMControl-v0"), Fix::give("dataset")]),
        ),
        (lewm(json!({ "threads": 0 })), "threads=0: use 1 to 1024", None),
        (lewm(json!({ "epoch": 3 })), "did you mean `epochs`?", None),
        (lewm(json!({ "batch": 0 })), "batch=0: a step learns from 1 clip or more", None),
        (
            lewm(json!({ "epochs": 1, "steps": 2 })),
            "epochs=1: the number of steps is given",
            any(vec![Fix::Leave("epochs"), Fix::Leave("steps")]),
        ),
        (
            lewm(json!({ "observe": ["state"] })),
            "observe: lewm learns from a dataset, without",
            leaves("observe"),
        ),
        (lewm(json!({ "env": "swm/PushT-v1" })), of_dataset, leaves("env")),
        (lewm(json!({ "env_option": { "a": 1 } })), of_dataset, leaves("env_option")),
        (lewm(json!({ "max_steps": 3 })), of_dataset, leaves("max_steps")),
        (lewm(json!({ "eval_episodes": 3 })), of_dataset, leaves("eval_episodes")),
        (lewm(json!({ "eval_every": 3 })), of_dataset, instead("checkpoint_every", "eval_every")),
        (
            lewm(json!({ "vary_share": 0.5 })),
            "vary_share: is about factors that are sampled, and none are",
            instead("vary", "vary_share"),
        ),
        (lewm(json!({ "vary_usual": 0.5 })), "vary_usual: is about factors", instead("vary", "vary_usual")),
        (
            lewm(json!({ "set": { "model": 1, "model.width": 2 } })),
            "a part of `model.width` was set as a whole before",
            None,
        ),
        (lewm(json!({ "opening": { "max_steps": 0 } })), "max_steps", None),
        (
            sac(json!({ "dataset": "a.h5" })),
            "dataset: sac learns in an environment, without this setting",
            leaves("dataset"),
        ),
        (
            sac(json!({ "batch": 4 })),
            "batch: sac",
            any(vec![Fix::set("set", json!({ "batch": 4 })), Fix::Leave("batch")]),
        ),
        (
            sac(json!({ "checkpoint_every": 4 })),
            "checkpoint_every: sac",
            instead("eval_every", "checkpoint_every"),
        ),
        (sac(json!({ "epochs": 4 })), "epochs: sac", instead("steps", "epochs")),
        (sac(json!({ "encoder": "a.pt" })), "encoder: sac", leaves("encoder")),
        (sac(json!({ "norm_batches": 4 })), "norm_batches: sac", leaves("norm_batches")),
        (sac(json!({ "quality_every": 4 })), "quality_every: sac", leaves("quality_every")),
        (sac(json!({ "patience": 4 })), "patience: sac", leaves("patience")),
        (sac(json!({ "precision": "bf16" })), "precision: sac", leaves("precision")),
        (sac(json!({ "split": 0.5 })), "split: sac", leaves("split")),
        (sac(json!({ "held_out": 0.5 })), "held_out: sac", leaves("held_out")),
        (sac(json!({ "look": { "a": 1 } })), "look: sac", leaves("look")),
        (sac(json!({ "vary": ["a"] })), "vary: sac", leaves("vary")),
        (sac(json!({ "canonical": {} })), "canonical: sac", leaves("canonical")),
        (
            sac(json!({ "opening": { "camera": "a" } })),
            "camera: is about a dataset, and none is named",
            instead("dataset", "camera"),
        ),
        (
            sac(json!({ "opening": { "split": "val" } })),
            "dataset_split: is about a dataset",
            instead("dataset", "dataset_split"),
        ),
        (steps(json!({ "env": "swm/PushT-v1" })), "env: tdmpc2 learns from a dataset", leaves("env")),
        (steps(json!({ "eval_every": 5 })), of_dataset, instead("checkpoint_every", "eval_every")),
        (resume("none", json!({})), "No such file", None),
        (resume("other", json!({})), "it trained `other`, which this program cannot train", None),
        (
            resume("lewm", json!({ "baseline": "lewm" })),
            "baseline: a run is resumed with what it trains",
            leave("baseline"),
        ),
        (resume("lewm", json!({ "out": "run" })), "out: a run is resumed in its own folder", leave("out")),
        (
            resume("lewm", json!({ "seed": 42 })),
            "seed: a run is resumed with the settings that it was begun with",
            leave("seed"),
        ),
        (
            resume("lewm", json!({ "opening": { "max_steps": 9 } })),
            "dataset_max_steps: a run is resumed with the dataset as it",
            leaves("dataset_max_steps"),
        ),
        (resume("sac", json!({ "patience": 4 })), "patience: sac", leaves("patience")),
        (
            resume("lewm", json!({ "from_run": run("lewm") })),
            "from_run: a run is resumed with the settings that it was begun with",
            leave("from_run"),
        ),
        (sac(json!({ "from_run": run("sac") })), "from_run: sac", leaves("from_run")),
        (
            lewm(json!({ "from_run": run("lewm"), "preset": "small" })),
            "preset: the run that it begins with has a model",
            any(vec![Fix::Leave("preset"), Fix::Leave("from_run")]),
        ),
        (
            lewm(json!({ "from_run": run("lewm"), "encoder": "a.pt" })),
            "encoder: the run that it begins with has a model",
            any(vec![Fix::Leave("encoder"), Fix::Leave("from_run")]),
        ),
        (lewm(json!({ "from_run": run("sac") })), "trained sac, which is another model", leave("baseline")),
        (lewm(json!({ "from_run": "none" })), "No such file", None),
        (json!({ "from_run": run("lewm"), "out": "run" }), "dataset: name the dataset that lewm", None),
    ];
    for (given, text, fix) in table {
        let error = match ask(&given) {
            Err(error @ TaskError::Request(_)) => error,
            other => panic!("{given}: {other:?}"),
        };
        assert!(error.to_string().contains(text), "{text}: {error}");
        if fix.is_some() {
            assert_eq!(error.fix(), fix.as_ref(), "{error}");
        }
    }
    // What is not refused reaches the trainer.
    for (given, out) in [
        (lewm(json!({ "steps": 3, "checkpoint_every": 2, "held_out": 0.2 })), PathBuf::from("run")),
        (sac(json!({ "steps": 3, "eval_every": 2, "observe": ["state"] })), PathBuf::from("run")),
        (
            steps(json!({ "steps": 3, "checkpoint_every": 2, "opening": { "split": "val" } })),
            PathBuf::from("run"),
        ),
        (
            json!({ "from_run": run("lewm"), "dataset": "a.h5", "out": "run", "steps": 3 }),
            PathBuf::from("run"),
        ),
        (resume("lewm", json!({ "steps": 3, "patience": 4 })), run("lewm")),
        (resume("sac", json!({ "steps": 3, "dataset": "moved.h5", "out": run("sac") })), run("sac")),
    ] {
        let made = ask(&given).unwrap();
        assert_eq!((made.run, made.state), (out, json!({ "step": 3 })), "{given}");
    }
}

#[test]
fn a_build_without_training_names_its_feature() {
    const ABSENT: &[Absent] = &[Absent::of::<TrainerEntry>(
        TrainerEntry::TRAINING,
        "baselines",
        "cargo install --features baselines",
    )];
    let asked = Train { baseline: "lewm".to_owned(), ..Train::default() };
    let refused = |registry: &Registry| asked.run(registry, &mut ()).unwrap_err().to_string();
    assert_eq!(refused(&Registry::new()), "this program has nothing that trains");
    let told = refused(&Registry::new().with(ABSENT));
    assert!(told.contains("built without the feature `baselines`, which brings it: cargo install"), "{told}");
}

#[test]
fn settings_nest_at_their_dots() {
    let set = |set: Json| Train { set: set.as_object().unwrap().clone(), ..Train::default() }.changes();
    let flat =
        json!({ "model.width": 64, "model.encoder.kind": "cnn", "optim": { "lr": 1e-3 }, "optim.decay": 0 });
    let nested = json!({ "model": { "width": 64, "encoder": { "kind": "cnn" } }, "optim": { "lr": 1e-3, "decay": 0 } });
    assert_eq!(set(flat).unwrap(), nested);
    assert!(set(json!({ "model": 1, "model.width": 2 })).is_err());
}
