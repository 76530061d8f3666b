//! Exports of the golden checkpoints: imported, exported and imported again, they are the same models.

mod refused;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json, json};
use swm_baselines::online::TrainedAgent;
use swm_baselines::train::{RunFolder, TrainedModel, Which};
use swm_baselines::{Device, Images, PlanningBatch, Vectors};
use swm_solvers::{Candidates, Outputs};
use swm_tasks::request::Request as _;
use swm_weights::{Of, Saved, Stored, Values};

use super::{Export, Exported};
use crate::import::{Description, Import};
use crate::plane::{PLANE, registry};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/checkpoints").join(name)
}

/// The run of a golden checkpoint.
fn imported(name: &str, file: &str, kind: Option<&str>, out: &Path) -> Description {
    imported_from(&golden(name).join(file), name, kind, out)
}

/// The run of the checkpoint at `from`, whose inputs are those of a golden one.
fn imported_from(from: &Path, name: &str, kind: Option<&str>, out: &Path) -> Description {
    let set = match (kind, name) {
        (_, "dino_wm") => json!({ "encoder.heads": 3, "predictor.heads": 2 }),
        (Some(_), _) => json!({ "model.encoder.heads": 3 }),
        _ => json!({}),
    };
    let Json::Object(set) = set else { unreachable!("an object") };
    let vector = vector_of(name);
    let request = Import {
        from: from.display().to_string(),
        kind: kind.map(str::to_owned),
        env: Some(PLANE.id.to_owned()),
        action_mean: Some(vec![0.25, 0.0]),
        action_std: Some(vec![0.5, 2.0]),
        proprio_mean: vector.map(|dim| vec![0.125; dim]),
        proprio_std: vector.map(|dim| vec![0.5; dim]),
        encoder: (name == "dino_wm").then(|| golden(name).join("backbone.pth")),
        set,
        out: out.to_owned(),
        ..Import::default()
    };
    request.run(&registry(), &mut ()).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Values of the vector that a model observes.
fn vector_of(name: &str) -> Option<usize> {
    let expected = swm_weights::read(&golden(name).join("expected.safetensors")).unwrap();
    let vector = expected.get("proprio").or(expected.get("state"))?;
    vector.shape.last().copied()
}

fn export(run: &Path, out: &Path, transformers: Option<usize>) -> Exported {
    let request = Export { run: run.to_owned(), out: out.to_owned(), transformers, ..Export::default() };
    request.run(&registry(), &mut ()).unwrap_or_else(|error| panic!("{}: {error}", run.display()))
}

fn stored(run: &Path) -> BTreeMap<String, Stored> {
    swm_weights::read(&RunFolder::open(run).unwrap().weights(0)).unwrap()
}

/// Costs of some candidates for the golden images.
fn costs(name: &str, run: &Path) -> Vec<u64> {
    let model = TrainedModel::open(run, Which::Last, Device::Cpu).unwrap();
    let expected = swm_weights::read(&golden(name).join("expected.safetensors")).unwrap();
    let pixels: Vec<u8> = expected["pixels"].values.iter().map(|value| *value as u8).collect();
    let half = pixels.len() / 2;
    let side = (half / 3).isqrt();
    let images =
        |values| Images { values, rows: 1, steps: 1, height: side, width: side, channels_last: true };
    let vectors = |values: &'static [f32]| Vectors { values, rows: 1, steps: 1, dim: values.len() };
    let proprio: &'static [f32] = &[0.5, -1.0, 0.25];
    let proprio = expected.contains_key("proprio").then(|| vectors(proprio));
    let mut planner = model.baseline.planner().unwrap();
    let batch = PlanningBatch {
        pixels: images(&pixels[..half]),
        action: Vectors { values: &[], rows: 1, steps: 0, dim: 0 },
        proprio,
        goal_pixels: images(&pixels[half..]),
        goal_proprio: proprio,
    };
    planner.prepare(&batch).unwrap();
    let actions = &expected["candidates"];
    let [samples, horizon, dim] = actions.shape[..] else { panic!("three axes") };
    let mut costs = vec![0.0; samples];
    let candidates = Candidates { actions: &actions.values, episodes: 1, samples, horizon, dim };
    planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
    costs.into_iter().map(f64::to_bits).collect()
}

#[test]
fn what_is_exported_is_imported_again() {
    let cases = [
        ("lewm_transformers4", "weights.pt", None),
        ("lewm_trainer", "last.ckpt", None),
        ("pldm", "weights_epoch_1.pt", None),
        ("prejepa", "weights.pt", None),
        ("dino_wm", "checkpoints/model_latest.pth", None),
        ("gcbc", "weights_epoch_3.pt", None),
        ("gcivl_policy", "weights_epoch_3.pt", Some("gcivl")),
        ("hilp_policy", "weights_epoch_3.pt", Some("hilp")),
        ("tdmpc2_state", "weights_epoch_1.pt", None),
    ];
    for (name, file, kind) in cases {
        let folder = tempfile::tempdir().unwrap();
        let at = |part: &str| folder.path().join(part);
        let first = imported(name, file, kind, &at("run"));
        for version in [4, 5] {
            let out = at(&format!("export-{version}"));
            let exported = export(&at("run"), &out, Some(version));
            assert_eq!(exported.transformers.is_some(), name != "tdmpc2_state", "{name}");
            let again = at(&format!("again-{version}"));
            // Nothing has to be given: the export's own notes have it.
            let request = Import { from: out.display().to_string(), out: again.clone(), ..Import::default() };
            let second = request.run(&registry(), &mut ()).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!((&second.model, &second.missing), (&first.model, &Vec::new()), "{name}");
            assert_eq!(
                (second.image, second.frameskip, &second.env),
                (first.image, first.frameskip, &first.env)
            );
            let (one, mut other) = (stored(&at("run")), stored(&again));
            other.retain(|name, _| !second.lacks.contains(name));
            let kept: BTreeMap<_, _> =
                one.into_iter().filter(|(name, _)| !second.lacks.contains(name)).collect();
            assert_eq!(kept, other, "{name}");
            assert!(kept.len() > 20, "{name}");
            if first.model == "tdmpc2" {
                let open =
                    |run: &Path| TrainedAgent::open(run, Which::Last, Map::new(), Device::Cpu).unwrap();
                let (one, other) = (open(&at("run")).config, open(&again).config);
                assert_eq!((one.agent, one.interface, one.env), (other.agent, other.interface, other.env));
                continue;
            }
            let open = |run: &Path| TrainedModel::open(run, Which::Last, Device::Cpu).unwrap();
            let (one, other) = (open(&at("run")), open(&again));
            assert_eq!(one.config.model_config, other.config.model_config, "{name}");
            assert_eq!(one.config.data.scales, other.config.data.scales, "{name}");
            if one.baseline.planner().is_some() {
                assert_eq!(costs(name, &at("run")), costs(name, &again), "{name}");
            }
        }
    }
}

/// Attention of one head as wide as a token has no output layer, in the reference and here.
#[test]
fn one_head_as_wide_as_a_token_is_imported_and_exported() {
    for (name, dim) in [("lewm_transformers4", 24), ("prejepa", 22)] {
        let folder = tempfile::tempdir().unwrap();
        let at = |part: &str| folder.path().join(part);
        let config = std::fs::read(golden(name).join("config.json")).unwrap();
        let mut config: Json = serde_json::from_slice(&config).unwrap();
        (config["predictor"]["heads"], config["predictor"]["dim_head"]) = (1.into(), dim.into());
        std::fs::create_dir_all(at("published/backbone")).unwrap();
        std::fs::write(at("published/config.json"), config.to_string()).unwrap();
        let backbone = golden(name).join("backbone/config.json");
        if backbone.exists() {
            std::fs::copy(backbone, at("published/backbone/config.json")).unwrap();
        }
        let tensors = swm_weights::contents(&golden(name).join("weights.pt"), Of::Values).unwrap().tensors;
        let tensors = tensors.into_iter().filter(|(tensor, _)| !tensor.contains(".to_out."));
        let tensors: Vec<Saved> = tensors
            .map(|(tensor, Stored { mut shape, mut values, is_whole })| {
                if tensor.ends_with(".to_qkv.weight") {
                    shape[0] = 3 * dim;
                    values = values.into_iter().cycle().take(3 * dim * shape[1]).collect();
                }
                let whole = |values: Vec<f32>| {
                    Values::Integers(values.into_iter().map(|value| value as i64).collect())
                };
                (tensor, shape, if is_whole { whole(values) } else { Values::Floats(values) })
            })
            .collect();
        swm_weights::save(&at("published/weights.pt"), &tensors).unwrap();
        let first = imported_from(&at("published/weights.pt"), name, None, &at("run"));
        assert_eq!(first.missing, Vec::new(), "{name}");
        export(&at("run"), &at("out"), None);
        let again = Import { from: at("out").display().to_string(), out: at("again"), ..Import::default() };
        again.run(&registry(), &mut ()).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(stored(&at("run")), stored(&at("again")), "{name}");
        assert_eq!(costs(name, &at("run")), costs(name, &at("again")), "{name}");
    }
}

/// The reference's `create_backbone` makes ViTs, too, and its training of values can have one.
#[test]
fn a_frozen_vit_is_imported_and_exported() {
    for (name, file, prefix) in
        [("gcbc", "weights_epoch_3.pt", "encoder."), ("prejepa", "weights.pt", "backbone.")]
    {
        let folder = tempfile::tempdir().unwrap();
        let at = |part: &str| folder.path().join(part);
        std::fs::create_dir_all(at("published")).unwrap();
        std::fs::copy(golden(name).join("config.json"), at("published/config.json")).unwrap();
        // A DINOv2 without its scales is a ViT but for an epsilon.
        let tensors = swm_weights::contents(&golden(name).join(file), Of::Values).unwrap().tensors;
        let tensors = tensors.into_iter().filter(|(_, stored)| !stored.is_whole);
        let tensors = tensors.filter(|(tensor, _)| !tensor.contains(".layer_scale"));
        let tensors: Vec<Saved> =
            tensors.map(|(tensor, stored)| (tensor, stored.shape, Values::Floats(stored.values))).collect();
        swm_weights::save(&at("published/weights.pt"), &tensors).unwrap();
        let place = if name == "gcbc" { "model.encoder.heads" } else { "encoder.heads" };
        let request = Import {
            from: at("published").display().to_string(),
            env: Some(PLANE.id.to_owned()),
            action_mean: Some(vec![0.0; 2]),
            action_std: Some(vec![1.0; 2]),
            proprio_mean: vector_of(name).map(|dim| vec![0.0; dim]),
            proprio_std: vector_of(name).map(|dim| vec![1.0; dim]),
            set: Map::from_iter([(place.to_owned(), json!(3))]),
            out: at("run"),
            ..Import::default()
        };
        request.run(&registry(), &mut ()).unwrap_or_else(|error| panic!("{name}: {error}"));
        for version in [4, 5] {
            let out = at(&format!("export-{version}"));
            export(&at("run"), &out, Some(version));
            let backbone = std::fs::read(out.join("backbone/config.json")).unwrap();
            let backbone: Json = serde_json::from_slice(&backbone).unwrap();
            let wanted = json!({ "model_type": "vit", "intermediate_size": 36, "num_attention_heads": 3 });
            check_within(&wanted, &backbone, name);
            let written = swm_weights::contents(&out.join("weights.pt"), Of::Shapes).unwrap().tensors;
            assert_eq!(written[&format!("{prefix}pooler.dense.weight")].shape, [18, 18], "{name}");
            assert!(!written.contains_key(&format!("{prefix}embeddings.mask_token")), "{name}");
            let again = at(&format!("again-{version}"));
            let request = Import { from: out.display().to_string(), out: again.clone(), ..Import::default() };
            request.run(&registry(), &mut ()).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(stored(&at("run")), stored(&again), "{name}");
        }
    }
}

/// Names, shapes and kinds of a published file, and those of an export: the reference loads all or none.
#[test]
fn files_have_the_tensors_and_settings_that_the_reference_wrote() {
    for (name, file, kind, version) in [
        ("lewm_transformers4", "weights.pt", None, 4),
        ("pldm", "weights_epoch_1.pt", None, 5),
        ("prejepa", "weights.pt", None, 5),
        ("gcbc", "weights_epoch_3.pt", None, 5),
        ("tdmpc2_state", "weights_epoch_1.pt", None, 5),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (run, out) = (folder.path().join("run"), folder.path().join("out"));
        imported(name, file, kind, &run);
        export(&run, &out, Some(version));
        let theirs = swm_weights::contents(&golden(name).join(file), Of::Values).unwrap().tensors;
        let mut ours = swm_weights::contents(&out.join("weights.pt"), Of::Values).unwrap().tensors;
        assert_eq!(theirs.keys().collect::<Vec<_>>(), ours.keys().collect::<Vec<_>>(), "{name}");
        for (tensor, value) in &theirs {
            let own = ours.remove(tensor).unwrap();
            // What nobody reads is new.
            let is_idle = tensor.ends_with("num_batches_tracked") || tensor.ends_with("mask_token");
            let wanted =
                if is_idle { Stored { values: own.values.clone(), ..value.clone() } } else { value.clone() };
            assert_eq!(own, wanted, "{name} {tensor}");
        }
        let config =
            |path: PathBuf| -> Json { serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap() };
        let (theirs, ours) = (config(golden(name).join("config.json")), config(out.join("config.json")));
        check_within(&theirs, &ours, name);
        let backbone = golden(name).join("backbone/config.json");
        if backbone.exists() {
            check_within(&config(out.join("backbone/config.json")), &config(backbone), name);
        }
    }
}

/// All that a config contains is in the other, which may contain more, as what is a default. Integers are no floats: transformers 5 takes
/// one or the other.
fn check_within(theirs: &Json, ours: &Json, place: &str) {
    match theirs {
        Json::Object(fields) => {
            fields
                .iter()
                .for_each(|(name, value)| check_within(value, &ours[name], &format!("{place}.{name}")));
        }
        _ => assert_eq!(theirs, ours, "{place}"),
    }
}

#[test]
fn names_are_those_of_the_imported_checkpoint_where_none_are_given() {
    let folder = tempfile::tempdir().unwrap();
    let at = |part: &str| folder.path().join(part);
    imported("lewm_transformers4", "weights.pt", None, &at("four"));
    imported("lewm_trainer", "last.ckpt", None, &at("five"));
    assert_eq!(export(&at("four"), &at("out-four"), None).transformers, Some(4));
    assert_eq!(export(&at("five"), &at("out-five"), None).transformers, Some(5));
}

#[test]
fn the_card_has_metadata_scales_and_hashes() {
    let folder = tempfile::tempdir().unwrap();
    let (run, out) = (folder.path().join("run"), folder.path().join("out"));
    imported("pldm", "weights_epoch_1.pt", None, &run);
    let exported = export(&run, &out, None);
    let card = std::fs::read_to_string(out.join("README.md")).unwrap();
    let metadata = card.strip_prefix("---\n").unwrap().split_once("\n---\n").unwrap().0;
    let lines = [
        "library_name: stable-worldmodel",
        "tags:",
        "- world-model",
        "- pldm",
        "environment: \"swm/Plane-v0\"",
    ];
    assert_eq!(metadata.lines().collect::<Vec<_>>(), lines);
    for part in
        ["| `action` | [0.25, 0.0] | [0.5, 2.0] |", &exported.sha256, "`idm` of the training is left out"]
    {
        assert!(card.contains(part), "{part}: {card}");
    }
    assert!(card.contains("from an imported checkpoint.") && !card.contains("## Evaluation"), "{card}");
    let mut files: Vec<String> = std::fs::read_dir(&out)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    files.sort();
    assert_eq!(files, ["README.md", "config.json", "swm.json", "weights.pt"]);

    // A receipt must be of these weights.
    let old = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/integration/receipt-v1.json");
    let mut receipt: Json = serde_json::from_slice(&std::fs::read(old).unwrap()).unwrap();
    let file = folder.path().join("receipt.json");
    let with = |receipt: &Json, out: &str| {
        std::fs::write(&file, receipt.to_string()).unwrap();
        let (run, out) = (run.clone(), folder.path().join(out));
        Export { run, receipt: Some(file.clone()), out, ..Export::default() }.run(&registry(), &mut ())
    };
    let refused = with(&receipt, "refused").unwrap_err().to_string();
    assert!(refused.contains("whose files are not the weights of this checkpoint"), "{refused}");
    assert!(!folder.path().join("refused").exists());
    let weights = RunFolder::open(&run).unwrap().weights(0);
    receipt["files"] = json!({ "step-0.safetensors": swm_tasks::evaluation::file_hash(&weights).unwrap() });
    with(&receipt, "with").unwrap();
    let card = std::fs::read_to_string(folder.path().join("with/README.md")).unwrap();
    let hash = receipt["manifest_hash"].as_str().unwrap();
    for part in [
        "## Evaluation",
        "pairs of start and goal in `",
        &format!("| manifest | {hash} |"),
        "SHA-256 of the receipt",
    ] {
        assert!(card.contains(part), "{part}: {card}");
    }
}
