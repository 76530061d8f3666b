//! What is asked for, and what is refused with which words.

use std::path::{Path, PathBuf};

use serde_json::{Value as Json, json};
use swm_baselines::Device;
use swm_baselines::train::{TrainedModel, Which};
use swm_tasks::request::Request as _;
use swm_weights::{Of, Saved, Values, WeightsError};

use super::super::{Description, Import, Loaded};
use super::{PLANE, golden, registry, request};

#[test]
fn what_no_file_says_is_asked_for() {
    let wrong = |change: &dyn Fn(&mut Import)| {
        let mut request = request(&golden().join("lewm_transformers4"), None);
        request.out = PathBuf::from("nowhere");
        change(&mut request);
        request.run(&registry(), &mut ()).unwrap_err().to_string()
    };
    let no_scale = wrong(&|request| (request.action_mean, request.action_std) = (None, None));
    assert!(
        no_scale
            .contains("does not say how the column `action` was scaled; give dataset that it was trained on"),
        "{no_scale}"
    );
    assert!(no_scale.contains("action_mean"), "{no_scale}");
    let no_env = wrong(&|request| request.env = None);
    assert!(no_env.contains("which environment") && no_env.contains("give env"), "{no_env}");
    let half = wrong(&|request| request.action_std = None);
    assert!(half.contains("action_mean alone scales nothing; give action_std"), "{half}");
    let other = wrong(&|request| {
        (request.action_mean, request.action_std) = (Some(vec![0.0; 3]), Some(vec![1.0; 3]));
    });
    assert!(other.contains("are not 2 finite numbers each"), "{other}");
    let unknown = wrong(&|request| request.kind = Some("dreamer".to_owned()));
    assert!(unknown.contains("no model that this program has; use lewm or pldm"), "{unknown}");
    let nowhere = wrong(&|request| request.out = PathBuf::new());
    assert!(nowhere.contains("give out, or check_only=true"), "{nowhere}");
    let heads = wrong(&|request| {
        request.from = golden().join("gcivl_policy").display().to_string();
        request.kind = Some("gcivl".to_owned());
    });
    assert!(heads.contains("heads of attention the encoder has; give set=model.encoder.heads=N"), "{heads}");
    let training = wrong(&|request| request.from = golden().join("gcivl_policy").display().to_string());
    assert!(
        training.contains("is a training config (dinogcivl), not a model's; give kind=gcivl"),
        "{training}"
    );
    let encoder = wrong(&|request| request.from = golden().join("dino_wm").display().to_string());
    assert!(encoder.contains("a frozen DINOv2, are not in the file; give encoder"), "{encoder}");
    let gone = wrong(&|request| request.from = "quentinll/lewm-pusht".to_owned());
    assert!(gone.contains("no such file or folder; give from=hf:quentinll/lewm-pusht"), "{gone}");
    assert!(!Path::new("nowhere").exists());
}

#[test]
fn configs_that_are_no_models_are_refused_by_name() {
    for (name, reason) in [
        (
            "unknown_class",
            "_target_ my_lab.models.Dreamer is no model that this program has; known are lewm, pldm",
        ),
        ("call", "encoder: builtins.print is no module of a known model; nothing of a config is executed"),
        ("unfilled", "action_encoder.input_dim is ???: an unfinished Hydra config"),
        ("no_target", "has no _target_"),
        ("layernorm", "projector.norm_fn is a torch.nn.LayerNorm, and this program has BatchNorm1d"),
    ] {
        let request = Import { check_only: true, ..request(&golden().join("bad").join(name), None) };
        let message = request.run(&registry(), &mut ()).unwrap_err().to_string();
        assert!(message.contains("config.json: ") && message.contains(reason), "{name}: {message}");
    }
}

#[test]
fn settings_of_the_reference_that_change_nothing_are_taken() {
    let described = |[case, weights, heads]: [&str; 3], [part, setting]: [&str; 2], value: Json| {
        let (from, folder) = (golden().join(case), tempfile::tempdir().unwrap());
        let mut config: Json =
            serde_json::from_slice(&std::fs::read(from.join("config.json")).unwrap()).unwrap();
        config[part][setting] = value;
        std::fs::write(folder.path().join("config.json"), config.to_string()).unwrap();
        std::fs::copy(from.join(weights), folder.path().join(weights)).unwrap();
        let mut request = Import { check_only: true, ..request(folder.path(), None) };
        request.set.insert(heads.to_owned(), 3.into());
        request
            .run(&registry(), &mut ())
            .map(|description| description.model)
            .map_err(|error| error.to_string())
    };
    let gcbc = |value| {
        described(
            ["gcbc", "weights_epoch_3.pt", "model.encoder.heads"],
            ["action_predictor", "causal"],
            value,
        )
    };
    assert_eq!(gcbc(json!(true)), Ok("gcbc".to_owned()));
    let acausal = gcbc(json!(false)).unwrap_err();
    assert!(acausal.contains("action_predictor.causal is false, and this program has true"), "{acausal}");
    let prejepa = described(["prejepa", "weights.pt", "encoder.heads"], ["predictor", "pool"], json!("mean"));
    assert_eq!(prejepa, Ok("dino-wm".to_owned()));
}

#[test]
fn folders_that_are_not_whole_are_refused_with_what_they_lack() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(golden().join("pldm/config.json"), folder.path().join("config.json")).unwrap();
    let refused = |change: &dyn Fn(&mut Import)| {
        let mut request = request(folder.path(), None);
        request.out = folder.path().join("run");
        change(&mut request);
        request.run(&registry(), &mut ()).unwrap_err().to_string()
    };
    // Before what else is missing.
    let bare = refused(&|request| (request.action_mean, request.action_std) = (None, None));
    assert!(
        bare.contains("config.json: no file of weights is beside it; put the published one there"),
        "{bare}"
    );
    let other = refused(&|request| request.kind = Some("lewm".to_owned()));
    assert!(other.contains("its config.json names, which is pldm"), "{other}");
    for part in [
        "model-00001-of-00002.safetensors",
        "model-00002-of-00002.safetensors",
        "model.safetensors.index.json",
    ] {
        std::fs::write(folder.path().join(part), "{}").unwrap();
    }
    let parts = refused(&|_| ());
    assert!(
        parts.contains("in 2 parts (model.safetensors.index.json)") && parts.contains("save_file("),
        "{parts}"
    );
}

#[test]
fn values_that_pool_by_attention_are_refused_by_name() {
    let (from, folder) = (golden().join("gcivl_policy"), tempfile::tempdir().unwrap());
    std::fs::copy(from.join("config.json"), folder.path().join("config.json")).unwrap();
    let tensors = swm_weights::contents(&from.join("weights_epoch_3.pt"), Of::Values).unwrap().tensors;
    let floats = tensors.into_iter().filter(|(_, stored)| !stored.is_whole);
    let mut tensors: Vec<Saved> =
        floats.map(|(name, stored)| (name, stored.shape, Values::Floats(stored.values))).collect();
    let added = "value_predictor.backbone.transformer.layers.2.0.frame_tokens".to_owned();
    tensors.push((added, vec![1, 2, 3], Values::Floats(vec![0.5; 6])));
    swm_weights::save(&folder.path().join("weights.pt"), &tensors).unwrap();
    let mut request = Import { check_only: true, ..request(folder.path(), Some("gcivl")) };
    request.out = folder.path().join("run");
    let message = request.run(&registry(), &mut ()).unwrap_err().to_string();
    assert!(message.contains("by attention (`frame_tokens`)"), "{message}");
}

/// The configs of the four published repositories, whose weights are not here.
#[test]
fn published_configs_are_models_of_303_tensors() {
    let mlp = || {
        json!({ "_target_": "stable_worldmodel.wm.lewm.module.MLP", "input_dim": 192, "output_dim": 192, "hidden_dim": 2048,
        "norm_fn": { "_target_": "torch.nn.BatchNorm1d", "_partial_": true } })
    };
    for actions in [10, 25] {
        let config = json!({
            "_target_": "stable_worldmodel.wm.lewm.LeWM",
            "encoder": { "_target_": "stable_pretraining.backbone.utils.vit_hf", "size": "tiny", "patch_size": 14,
                "image_size": 224, "pretrained": false, "use_mask_token": false },
            "predictor": { "_target_": "stable_worldmodel.wm.lewm.module.Predictor", "num_frames": 3, "input_dim": 192,
                "hidden_dim": 192, "output_dim": 192, "depth": 6, "heads": 16, "mlp_dim": 2048, "dim_head": 64, "dropout": 0.1,
                "emb_dropout": 0.0 },
            "action_encoder": { "_target_": "stable_worldmodel.wm.lewm.module.Embedder", "input_dim": actions, "emb_dim": 192 },
            "projector": mlp(), "pred_proj": mlp(),
        });
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("config.json"), config.to_string()).unwrap();
        let request =
            Import { from: folder.path().display().to_string(), check_only: true, ..Import::default() };
        let Description { model, tensors, block, image, history, missing, .. } =
            request.run(&registry(), &mut ()).unwrap();
        assert_eq!((model.as_str(), tensors, block, image, history), ("lewm", [0, 301], actions, 224, 3));
        assert_eq!(missing.len(), 3, "{missing:?}");
    }
}

/// Name, shape and values of a tensor.
type Named = (String, Vec<usize>, Vec<f32>);

#[test]
fn files_that_are_no_weights_are_told_what_they_are() {
    let folder = tempfile::tempdir().unwrap();
    let good = golden().join("lewm_transformers4");
    std::fs::copy(good.join("config.json"), folder.path().join("config.json")).unwrap();
    let whole = std::fs::read(good.join("weights.pt")).unwrap();
    let tensors = || -> Vec<Named> {
        let read = swm_weights::contents(&good.join("weights.pt"), Of::Values).unwrap().tensors;
        let floats = read.into_iter().filter(|(_, stored)| !stored.is_whole);
        floats.map(|(name, stored)| (name, stored.shape, stored.values)).collect()
    };
    let told = |name: &str, write: &dyn Fn(&Path) -> Result<(), WeightsError>| {
        let file = folder.path().join(name);
        write(&file).unwrap();
        let mut request = request(&file, None);
        request.out = folder.path().join("run");
        let message = request.run(&registry(), &mut ()).unwrap_err().to_string();
        assert!(!request.out.exists() && message.contains(name), "{message}");
        message
    };
    let bytes = |bytes: Vec<u8>| {
        move |file: &Path| {
            std::fs::write(file, &bytes).unwrap();
            Ok(())
        }
    };
    let copied = |name: &'static str| {
        move |file: &Path| {
            std::fs::copy(golden().join("bad").join(name), file).unwrap();
            Ok(())
        }
    };
    let cut = told("cut.pt", &bytes(whole[..whole.len() / 2].to_vec()));
    assert!(cut.contains("is cut off (87,657 bytes; its archive has no end): fetch it again"), "{cut}");
    assert!(told("nothing.pt", &bytes(Vec::new())).contains("is empty: the download failed"));
    assert!(
        told("pointer.pt", &copied("pointer.pt"))
            .contains("is a pointer of Git LFS, not the weights (72 MB)")
    );
    assert!(told("page.pt", &copied("page.pt")).contains("is a web page"));
    assert!(told("sparse.pt", &copied("sparse.pt")).contains("`a.weight` is sparse"));
    assert!(told("complex.pt", &copied("complex.pt")).contains("is complex"));
    assert!(told("empty.pt", &copied("empty.pt")).contains("the file holds no tensors; save the model's"));
    let changed = |change: &dyn Fn(&mut Vec<Named>), name: &str| {
        told(name, &|file: &Path| {
            let mut all = tensors();
            change(&mut all);
            swm_weights::write(file, all)
        })
    };
    let missing = changed(&|all| drop(all.pop()), "missing.safetensors");
    assert!(missing.contains("tensors fit; 1 missing: "), "{missing}");
    let headless =
        changed(&|all| all.retain(|(name, ..)| !name.starts_with("encoder.")), "headless.safetensors");
    assert!(
        headless.contains("the encoder is missing (")
            && headless.contains("and the file has action_encoder, pred_proj, predictor, projector"),
        "{headless}"
    );
    let unused =
        changed(&|all| all.push(("extra.weight".to_owned(), vec![1], vec![0.0])), "unused.safetensors");
    assert!(unused.contains("1 unused: extra.weight"), "{unused}");
    let shape = changed(
        &|all| {
            let (_, shape, values) = all.iter_mut().find(|(name, ..)| name.ends_with("cls_token")).unwrap();
            (*shape, _) = (vec![1, 1, 23], values.truncate(23));
        },
        "shape.safetensors",
    );
    assert!(shape.contains("1 of another shape: encoder.embeddings.cls_token"), "{shape}");
    let nan = changed(
        &|all| all.iter_mut().find(|(name, ..)| name.ends_with("cls_token")).unwrap().2[0] = f32::NAN,
        "nan.safetensors",
    );
    assert!(
        nan.contains(
            "`encoder.embeddings.cls_token` holds values that are not finite; the file is of no use"
        ),
        "{nan}"
    );
    let var = changed(
        &|all| all.iter_mut().find(|(name, ..)| name.ends_with("running_var")).unwrap().2[0] = -1.0,
        "var.safetensors",
    );
    assert!(var.contains("a variance below 0"), "{var}");
    let several = request(folder.path(), None).run(&registry(), &mut ()).unwrap_err().to_string();
    let several_run = Import { out: folder.path().join("run"), ..request(folder.path(), None) };
    let listed = several_run.run(&registry(), &mut ()).unwrap_err().to_string();
    assert!(
        several.contains("give out")
            && listed.contains("files of weights: ")
            && listed.ends_with("; give file"),
        "{listed}"
    );
}

#[test]
fn a_checkpoint_can_be_used_without_a_run() {
    let request = request(&golden().join("lewm_transformers4"), None);
    let Ok(Loaded::Model(model)) = request.load(&registry()) else { panic!("a model") };
    assert_eq!(
        (model.baseline.name(), model.step, model.config.data.env.as_deref()),
        ("lewm", 0, Some(PLANE.id))
    );
    let found = TrainedModel::open(&golden().join("lewm_transformers4"), Which::Last, Device::Cpu)
        .err()
        .unwrap()
        .to_string();
    assert!(
        found.contains("a checkpoint of others, not a run of this program; import it first (`swm import`)"),
        "{found}"
    );
}

/// Bytes that are changed here and there, and files that end early: an error, or a model, and nothing else.
#[test]
fn damaged_files_are_errors_and_no_panics() {
    let folder = tempfile::tempdir().unwrap();
    for (case, name) in
        [("lewm_transformers5", "half.pt"), ("pldm", "config.json"), ("dino_wm", "hydra.yaml")]
    {
        let from = golden().join(case);
        let here = folder.path().join(case);
        std::fs::create_dir(&here).unwrap();
        for entry in
            std::fs::read_dir(&from).unwrap().map(Result::unwrap).filter(|entry| entry.path().is_file())
        {
            std::fs::copy(entry.path(), here.join(entry.file_name())).unwrap();
        }
        let whole = std::fs::read(from.join(name)).unwrap();
        let mut refused = 0;
        for round in 0..120_usize {
            let mut bytes = whole.clone();
            for change in 0..1 + round % 4 {
                let random = (round * 31 + change * 7 + 1).wrapping_mul(2_654_435_761);
                // The pickle and the list of entries are at both ends of an archive.
                let span = bytes.len().min(6_000);
                let place =
                    if round.is_multiple_of(2) { random % span } else { bytes.len() - 1 - random % span };
                bytes[place] = (random >> 9) as u8;
            }
            if round.is_multiple_of(5) {
                bytes.truncate(whole.len() * round / 120);
            }
            std::fs::write(here.join(name), &bytes).unwrap();
            let from = if name == "half.pt" { here.join(name) } else { here.clone() };
            refused += usize::from(request(&from, None).load(&registry()).is_err());
        }
        assert!(refused > 20, "{case}: {refused}");
    }
}

#[test]
fn an_encoder_that_computes_otherwise_is_refused_by_its_own_config() {
    let folder = tempfile::tempdir().unwrap();
    let copy = |name: &str| {
        std::fs::create_dir_all(folder.path().join("backbone")).unwrap();
        std::fs::copy(golden().join("gcbc").join(name), folder.path().join(name)).unwrap();
    };
    ["config.json", "weights_epoch_3.pt", "backbone/config.json"].iter().for_each(|name| copy(name));
    let file = folder.path().join("backbone/config.json");
    let good = std::fs::read_to_string(&file).unwrap();
    let described = |config: &str| {
        std::fs::write(&file, config).unwrap();
        let mut request = request(&folder.path().join("weights_epoch_3.pt"), None);
        request.check_only = true;
        request.run(&registry(), &mut ()).map_err(|error| error.to_string())
    };
    assert!(described(&good).is_ok());
    for (ours, other, reason) in [
        (
            "\"hidden_act\": \"gelu\"",
            "\"hidden_act\": \"relu\"",
            "hidden_act is relu, and this program has gelu",
        ),
        (
            "\"layer_norm_eps\": 1e-06",
            "\"layer_norm_eps\": 0.05",
            "layer_norm_eps is 0.05, and this program has 1e-6",
        ),
    ] {
        assert!(good.contains(ours), "{good}");
        let message = described(&good.replace(ours, other)).unwrap_err();
        assert!(message.contains("backbone/config.json: ") && message.contains(reason), "{message}");
    }
}
