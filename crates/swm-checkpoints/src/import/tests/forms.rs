//! Forms of checkpoints beside those that the reference stores: golden ones whose config or names of tensors are changed as trainers leave them.

use std::path::Path;

use serde_json::{Value as Json, json};
use swm_baselines::Device;
use swm_baselines::online::TrainedAgent;
use swm_baselines::train::{RunFolder, TrainedModel, Which};
use swm_tasks::request::Request as _;
use swm_weights::{Of, Saved, Stored, Values};
use tempfile::TempDir;

use super::super::{Description, Import};
use super::{Case, check_agent, check_model, check_policy, golden, registry, request};

const LEWM: [&str; 2] = ["lewm_transformers4", "weights.pt"];
const PREJEPA: [&str; 2] = ["prejepa", "weights.pt"];
const GCBC: [&str; 2] = ["gcbc", "weights_epoch_3.pt"];
const TDMPC2: [&str; 2] = ["tdmpc2_state", "weights_epoch_1.pt"];

/// A checkpoint of one file of weights, and of a config where it is none.
struct Form {
    folder: TempDir,
    case: &'static str,
    request: Import,
}

impl Form {
    /// A golden checkpoint with its config changed; null leaves it out.
    fn of([case, weights]: [&'static str; 2], change: impl FnOnce(&mut Json)) -> Self {
        Self::with([case, weights], change, |name, stored| Some((name, stored)))
    }

    /// The same, with tensors changed, too.
    fn with(
        [case, weights]: [&'static str; 2],
        change: impl FnOnce(&mut Json),
        tensor: impl Fn(String, Stored) -> Option<(String, Stored)>,
    ) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let stored = swm_weights::contents(&golden().join(case).join(weights), Of::Values).unwrap().tensors;
        let floats = stored.into_iter().filter(|(_, stored)| !stored.is_whole);
        let tensors: Vec<Saved> = floats
            .filter_map(|(name, stored)| tensor(name, stored))
            .map(|(name, stored)| (name, stored.shape, Values::Floats(stored.values)))
            .collect();
        swm_weights::save(&folder.path().join("weights.pt"), &tensors).unwrap();
        Self::config(folder, case, change)
    }

    /// A golden config, changed, without weights.
    fn bare(case: &'static str, change: impl FnOnce(&mut Json)) -> Self {
        Self::config(tempfile::tempdir().unwrap(), case, change)
    }

    fn config(folder: TempDir, case: &'static str, change: impl FnOnce(&mut Json)) -> Self {
        let file = std::fs::read(golden().join(case).join("config.json")).unwrap();
        let mut config: Json = serde_json::from_slice(&file).unwrap();
        change(&mut config);
        if !config.is_null() {
            std::fs::write(folder.path().join("config.json"), config.to_string()).unwrap();
        }
        let beside = golden().join(case).join("backbone");
        if beside.is_dir() {
            std::fs::create_dir(folder.path().join("backbone")).unwrap();
            let name = "backbone/config.json";
            std::fs::copy(golden().join(case).join(name), folder.path().join(name)).unwrap();
        }
        let mut request = request(folder.path(), None);
        let vector = match case {
            "prejepa" => 3,
            "tdmpc2_state" => 6,
            _ => 0,
        };
        if vector > 0 {
            (request.proprio_mean, request.proprio_std) = (Some(vec![0.0; vector]), Some(vec![1.0; vector]));
        }
        request.out = folder.path().join("run");
        Self { folder, case, request }
    }

    fn kind(mut self, kind: &str) -> Self {
        self.request.kind = Some(kind.to_owned());
        self
    }

    fn set(mut self, set: Json) -> Self {
        let Json::Object(set) = set else { panic!("an object") };
        self.request.set = set;
        self
    }

    /// What it is.
    fn described(&self) -> Description {
        let request = Import { check_only: true, ..self.request.clone() };
        request.run(&registry(), &mut ()).unwrap_or_else(|error| panic!("{}: {error}", self.case))
    }

    /// Why it is refused.
    fn refused(&self) -> String {
        let refused = self.request.run(&registry(), &mut ()).expect_err("it is refused").to_string();
        assert!(!self.request.out.exists(), "{refused}");
        refused
    }

    /// It computes what the golden checkpoint computes.
    fn check(&self) {
        let described = self.request.run(&registry(), &mut ());
        let described = described.unwrap_or_else(|error| panic!("{}: {error}", self.case));
        let file = golden().join(self.case).join("expected.safetensors");
        let case = Case { expected: swm_weights::read(&file).unwrap(), name: self.case.to_owned() };
        if described.model == "tdmpc2" {
            let options = serde_json::Map::new();
            let agent = TrainedAgent::open(&self.request.out, Which::Last, options, Device::Cpu).unwrap();
            let weights = RunFolder::open(&self.request.out).unwrap().weights(0);
            check_agent(&case, &agent.config, &weights);
            return;
        }
        let model = TrainedModel::open(&self.request.out, Which::Last, Device::Cpu).unwrap();
        match case.expected.contains_key("action") {
            true => check_policy(&case, &model),
            false => check_model(&case, &model, 1e-4),
        }
    }
}

fn no_config(config: &mut Json) {
    *config = Json::Null;
}

fn vit(settings: &Json) -> Json {
    let mut node = json!({ "_target_": "stable_pretraining.backbone.utils.vit_hf", "size": "tiny", "patch_size": 16,
        "image_size": 64, "num_hidden_layers": 1, "intermediate_size": 50 });
    node.as_object_mut().unwrap().extend(settings.as_object().unwrap().clone());
    node
}

#[test]
fn what_an_agent_of_no_config_computes_with_is_asked_for() {
    let bare = || {
        Form::with(TDMPC2, no_config, |name, stored| Some((format!("model.{name}"), stored))).kind("tdmpc2")
    };
    let message = bare().refused();
    for setting in ["simnorm_dim", "vmin", "vmax", "discount", "plan.uncertainty_penalty"] {
        assert!(message.contains(setting), "{message}");
    }
    let message = bare().set(json!({ "simnorm_dim": 8, "vmin": -6, "vmax": 2 })).refused();
    assert!(message.contains("discount") && !message.contains("vmin"), "{message}");
    let all =
        json!({ "simnorm_dim": 8, "vmin": -6, "vmax": 2, "discount": 0.99, "plan.uncertainty_penalty": 0.5 });
    let tensors = bare().set(all.clone()).described().tensors;
    assert!(tensors[0] > 50 && tensors[0] == tensors[1], "{tensors:?}");
    bare().set(all).check();
}

/// What a training script leaves in its folder: the checkpoint of its trainer, and a config of all that it did.
#[test]
fn configs_of_whole_trainings_have_the_model_in_them() {
    for [case, weights] in [["lewm_trainer", "last.ckpt"], TDMPC2] {
        let mut form = Form::with([case, weights], no_config, |name, stored| {
            // Of the training, not of the model.
            (!name.starts_with("sigreg.")).then_some((name, stored))
        });
        std::fs::copy(golden().join(case).join("config.yaml"), form.folder.path().join("config.yaml"))
            .unwrap();
        form.check();
        // The config alone names the same files.
        form.request.from = form.folder.path().join("config.yaml").display().to_string();
        let alone = form.described().missing;
        assert!(alone[0].to_string().contains("config.yaml: no file of weights is beside it"), "{alone:?}");
    }
    let form = Form::bare("lewm_trainer", no_config);
    let text = std::fs::read_to_string(golden().join("lewm_trainer/config.yaml")).unwrap();
    std::fs::write(form.folder.path().join("config.yaml"), text.replace("embed_dim: 12", "other: 12"))
        .unwrap();
    let refused = form.refused();
    assert!(
        refused
            .contains("config.yaml: model.encoder.hidden_size is ${embed_dim}: an unfinished Hydra config"),
        "{refused}"
    );
}

#[test]
fn agents_that_observe_nothing_are_refused() {
    let changed = |place: &'static str, value: Json| {
        Form::of(TDMPC2, move |config| *config.pointer_mut(place).unwrap() = value).refused()
    };
    let none = changed("/cfg/wm/encoding", json!({}));
    assert!(none.contains("neither images nor a vector"), "{none}");
    for (place, name) in
        [("/cfg/action_dim", "cfg.action_dim"), ("/cfg/extra_dims/state", "cfg.extra_dims.state")]
    {
        let message = changed(place, json!(0));
        assert!(message.contains(&format!("{name} is 0; a whole number from 1 on is wanted")), "{message}");
    }
}

#[test]
fn numbers_beside_the_parts_of_a_model_are_passed_over() {
    let form = Form::of(LEWM, |config| {
        config["_target_"] = "jepa.JEPA".into();
        (config["embed_dim"], config["history_size"]) = (24.into(), 3.into());
        for (part, class) in [
            ("predictor", "module.ARPredictor"),
            ("action_encoder", "module.Embedder"),
            ("projector", "module.MLP"),
            ("pred_proj", "module.MLP"),
        ] {
            config[part]["_target_"] = class.into();
        }
    });
    form.check();
    let other = Form::of(LEWM, |config| config["decoder"] = json!({ "_target_": "module.MLP" })).refused();
    assert!(other.contains("decoder is a part that this program's model does not have"), "{other}");
}

#[test]
fn the_encoder_of_a_policy_has_the_settings_of_its_config() {
    let encoder = |case: &'static str, node: Json| Form::bare(case, |config| config["encoder"] = node);
    for (case, place) in [("gcbc", "/model/encoder"), ("prejepa", "/encoder")] {
        let settings = encoder(case, vit(&json!({ "num_attention_heads": 6 }))).described().settings;
        let found = settings.pointer(place).unwrap();
        assert_eq!(
            (&found["dim"], &found["heads"], &found["patch"]),
            (&json!(192), &json!(6), &json!(16)),
            "{case}"
        );
        assert_eq!((&found["dinov2"], &found["depth"]), (&json!(false), &json!(1)), "{case}");
        let frozen =
            json!({ "_target_": "stable_pretraining.backbone.EvalOnly", "backbone": vit(&json!({})) });
        let settings = encoder(case, frozen).described().settings;
        assert_eq!(settings.pointer(place).unwrap()["heads"], 3, "{case}");
        for (node, reason) in [
            (vit(&json!({ "hidden_act": "relu" })), "encoder.hidden_act is relu, and this program has gelu"),
            (
                vit(&json!({ "layer_norm_eps": 0.1 })),
                "encoder.layer_norm_eps is 0.1, and this program has 1e-12",
            ),
            (vit(&json!({ "qkv_bias": false })), "encoder.qkv_bias is false, and this program has true"),
            (
                vit(&json!({ "num_attention_heads": 5 })),
                "encoder.num_attention_heads is 5, which does not divide",
            ),
            (json!({ "_target_": "timm.create_model" }), "timm.create_model is no module of a known model"),
            (
                json!({ "_target_": "stable_pretraining.backbone.vit_big" }),
                "is a stable_pretraining.backbone.vit_big, and this program has create_backbone or vit_hf",
            ),
        ] {
            let message = encoder(case, node).refused();
            assert!(message.contains(reason), "{case}: {message}");
        }
    }
    // In the wrapper of frozen modules that trainers store.
    let wrapped = |config: &mut Json| {
        let backbone = config["encoder"].take();
        config["encoder"] =
            json!({ "_target_": "stable_pretraining.backbone.EvalOnly", "backbone": backbone });
    };
    Form::of(GCBC, wrapped).check();
    let below = |name: String| match name.strip_prefix("backbone.") {
        Some(rest) => format!("backbone.backbone.{rest}"),
        None => name,
    };
    Form::with(PREJEPA, wrapped, |name, stored| Some((below(name), stored))).check();
}

#[test]
fn sizes_of_a_config_are_compared_with_the_weights() {
    for (checkpoint, place, value, reason) in [
        (TDMPC2, "/cfg/wm/mlp_dim", 640, "cfg.wm.mlp_dim is 640, and the weights have 16"),
        (TDMPC2, "/cfg/wm/num_q", 64, "cfg.wm.num_q is 64, and the weights have 3"),
        (TDMPC2, "/cfg/wm/num_bins", 640, "cfg.wm.num_bins is 640, and the weights have 51"),
        (
            GCBC,
            "/action_predictor/dim_head",
            640,
            "2 heads of 640 values, and the weights have 12 values in all",
        ),
        (GCBC, "/action_predictor/mlp_dim", 640, "action_predictor.mlp_dim is 640, and the weights have 24"),
        (PREJEPA, "/predictor/depth", 64, "predictor.depth is 64, and the weights have 2"),
        (PREJEPA, "/predictor/num_patches", 64, "predictor.num_patches is 64, and the weights have 16"),
        (
            GCBC,
            "/action_predictor/num_patches",
            64,
            "action_predictor.num_patches is 64, and the weights have 16",
        ),
        (LEWM, "/encoder/intermediate_size", 640, "encoder.intermediate_size is 640, and the weights have"),
        (LEWM, "/predictor/mlp_dim", 640, "predictor.mlp_dim is 640, and the weights have"),
    ] {
        let form = Form::of(checkpoint, |config| *config.pointer_mut(place).unwrap() = value.into());
        let message = form.refused();
        assert!(message.contains("config.json: ") && message.contains(reason), "{place}: {message}");
    }
}

#[test]
fn settings_of_encoders_that_have_one_value_here_are_taken_with_it() {
    let encoder = |settings: Json| {
        Form::of(LEWM, |config| {
            config["encoder"].as_object_mut().unwrap().extend(settings.as_object().unwrap().clone());
        })
    };
    let usual = json!({ "hidden_act": "gelu", "qkv_bias": true, "num_channels": 3, "layer_norm_eps": 1e-12,
        "hidden_dropout_prob": 0.1, "attention_probs_dropout_prob": 0.2, "drop_path_rate": 0.1, "use_swiglu_ffn": false });
    encoder(usual).check();
    let relu = encoder(json!({ "hidden_act": "relu" })).refused();
    assert!(relu.contains("encoder.hidden_act is relu, and this program has gelu"), "{relu}");
}

/// The settings of a whole training, as the trainer of this name stores them.
fn training(name: &str, settings: Json) -> impl Fn(&mut Json) {
    let mut whole = json!({ "seed": 42, "loss": { "sigreg": { "weight": 0.09 } }, "data": { "dataset": { "name": "pusht" } } });
    whole["output_model_name"] = name.into();
    let Json::Object(settings) = settings else { panic!("an object") };
    whole.as_object_mut().unwrap().extend(settings);
    move |config| *config = whole.clone()
}

#[test]
fn world_models_beside_the_config_of_their_training_are_read() {
    let settings = json!({ "wm": { "history_size": 3, "embed_dim": 24 },
        "predictor": { "heads": 2, "dim_head": 8, "dropout": 0.1 } });
    let whole = training("lewm", settings);
    let form = Form::of(LEWM, whole).set(json!({ "model.encoder.heads": 3 }));
    let unnamed = form.refused();
    assert!(unnamed.contains("is a training config (lewm), not a model's; give kind=lewm"), "{unnamed}");
    form.kind("lewm").check();

    let whole = training(
        "dinowm",
        json!({ "wm": { "history_size": 3 }, "predictor": { "heads": 2, "dim_head": 6 } }),
    );
    let below = |name: String| match name.strip_prefix("backbone.") {
        Some(rest) => format!("backbone.backbone.{rest}"),
        None => name,
    };
    let form = Form::with(PREJEPA, whole, |name, stored| Some((below(name), stored)))
        .set(json!({ "encoder.heads": 3 }));
    let unnamed = form.refused();
    assert!(unnamed.contains("is a training config (dinowm), not a model's; give kind=dino-wm"), "{unnamed}");
    form.kind("dino-wm").check();

    let other = Form::of(LEWM, training("mine", json!({}))).refused();
    assert!(
        other.contains(
            "is a training config (mine), not a model's; give kind=lewm, or kind=pldm, or kind=dino-wm"
        ),
        "{other}"
    );
}

/// Tensors whose positions are those of the first two of three frames.
fn two_frames(name: String, mut stored: Stored) -> Option<(String, Stored)> {
    if name.ends_with("predictor.pos_embedding") || name.ends_with("frame_tokens") {
        stored.shape[1] = stored.shape[1] * 2 / 3;
        stored.values.truncate(stored.shape.iter().product());
    }
    Some((name, stored))
}

#[test]
fn how_many_frames_a_model_sees_follows_from_its_tensors() {
    let heads = json!({ "model.encoder.heads": 3, "model.predictor.heads": 2 });
    let described = Form::with(GCBC, no_config, two_frames).kind("gcbc").set(heads).described();
    assert_eq!((described.history, described.image), (2, 16));
    let heads = |history: usize| json!({ "encoder.heads": 3, "predictor.heads": 2, "history": history });
    let form = || Form::with(PREJEPA, no_config, two_frames).kind("dino-wm");
    let described = form().set(heads(2)).described();
    assert_eq!((described.history, described.image), (2, 16));
    let message = form().set(heads(3)).refused();
    assert!(
        message.contains("are not those of 3 square images") && message.contains("history=N"),
        "{message}"
    );
    let more = |config: &mut Json| config["action_predictor"]["num_frames"] = 4.into();
    let message = Form::bare("gcbc", more).refused();
    assert!(
        message.contains("action_predictor.num_frames is 4, and its history_size is 3")
            && message.contains("set=model.history=4"),
        "{message}"
    );
    assert_eq!(Form::bare("gcbc", more).set(json!({ "model.history": 4 })).described().history, 4);
}

#[test]
fn the_heads_of_an_archive_are_those_of_its_settings() {
    let (from, folder) = (golden().join("dino_wm"), tempfile::tempdir().unwrap());
    std::fs::create_dir(folder.path().join("checkpoints")).unwrap();
    let weights = "checkpoints/model_latest.pth";
    std::fs::copy(from.join(weights), folder.path().join(weights)).unwrap();
    let mut text = std::fs::read_to_string(from.join("hydra.yaml")).unwrap();
    text += "predictor:\n  _target_: models.vit.ViTPredictor\n  depth: 2\n  heads: 2\n";
    std::fs::write(folder.path().join("hydra.yaml"), text).unwrap();
    let mut request = request(folder.path(), None);
    request.encoder = Some(from.join("backbone.pth"));
    request.set.insert("encoder.heads".to_owned(), 3.into());
    request.check_only = true;
    let settings = request.run(&registry(), &mut ()).unwrap().settings;
    let by_hand = Import { set: super::request(&from, Some("dino-wm")).set, ..request };
    assert_eq!(settings["predictor"], by_hand.run(&registry(), &mut ()).unwrap().settings["predictor"]);
}

#[test]
fn vectors_of_another_dim_than_the_environments_are_refused() {
    let narrow = |name: String, mut stored: Stored| {
        if name == "extra_encoders.state.0.weight" {
            let rows: Vec<f32> = stored.values.chunks(6).flat_map(|row| row[..5].to_vec()).collect();
            stored = Stored { shape: vec![stored.shape[0], 5], values: rows, ..stored };
        }
        Some((name, stored))
    };
    let mut form = Form::with(TDMPC2, |config| config["cfg"]["extra_dims"]["state"] = 5.into(), narrow);
    (form.request.proprio_mean, form.request.proprio_std) = (Some(vec![0.0; 5]), Some(vec![1.0; 5]));
    let message = form.refused();
    assert!(message.contains("the model takes 5 values of `state`, and swm/Plane-v0 has 6"), "{message}");
}

#[test]
fn messages_name_what_helps() {
    // Two numbers that are given together.
    let mut form = Form::of(LEWM, |_| ());
    (form.request.action_mean, form.request.action_std) = (None, None);
    let scale = form.refused();
    assert!(scale.contains("or stats, or action_mean and action_std"), "{scale}");

    let text = Form::of(LEWM, |config| config["predictor"]["depth"] = "${depth}".into()).refused();
    assert!(
        text.ends_with(
            "predictor.depth is ${depth}: an unfinished Hydra config; take the one that training wrote"
        ),
        "{text}"
    );
    let none = Form::of(LEWM, |config| config["projector"] = Json::Null).refused();
    assert!(none.contains("projector is missing or null") && none.contains("load_pretrained"), "{none}");
    let kind = Form::of(LEWM, |_| ()).kind("pldm").refused();
    assert!(kind.contains("its config.json names, which is lewm; give kind=lewm"), "{kind}");

    // The last of several epochs, by its number.
    let form = Form::of(LEWM, |_| ());
    let weights = form.folder.path().join("weights.pt");
    for epoch in [1, 2, 10] {
        std::fs::copy(&weights, form.folder.path().join(format!("weights_epoch_{epoch}.pt"))).unwrap();
    }
    std::fs::remove_file(&weights).unwrap();
    let several = form.refused();
    assert!(several.ends_with("give file=weights_epoch_10.pt"), "{several}");
    // Forms of one checkpoint, whose numbers are of their types.
    for (names, fix) in [
        (["bfloat16.pt", "half.pt", "weights.pt"], "give file=weights.pt"),
        (["bfloat16.pt", "float32.pt", "half.pt"], "bfloat16.pt, float32.pt, half.pt; give file"),
    ] {
        let other = Form::bare("lewm_transformers4", |_| ());
        for name in names {
            std::fs::copy(form.folder.path().join("weights_epoch_1.pt"), other.folder.path().join(name))
                .unwrap();
        }
        let several = other.refused();
        assert!(several.ends_with(fix), "{several}");
    }
    assert!(Path::new(&form.request.from).is_dir());
}

/// The form of facebookresearch/jepa-wms: dictionaries of tensors whose parts were distributed, and no config.
#[test]
fn archives_of_distributed_parts_are_read_and_their_model_is_named() {
    let (from, folder) = (golden().join("dino_wm"), tempfile::tempdir().unwrap());
    let file = folder.path().join("dino_wm_pusht.pth.tar");
    let save = |rename: &dyn Fn(&str, &str) -> String| {
        let stored = swm_weights::contents(&from.join("checkpoints/model_latest.pth"), Of::Values).unwrap();
        let renamed = stored.tensors.into_iter().map(|(name, stored)| {
            let (part, rest) = name.split_once('.').unwrap();
            (rename(part, rest), stored.shape, Values::Floats(stored.values))
        });
        swm_weights::save(&file, &renamed.collect::<Vec<Saved>>()).unwrap();
    };
    save(&|part, rest| format!("{part}.module.{rest}"));
    let mut request = request(&file, Some("dino-wm"));
    (request.proprio_mean, request.proprio_std) = (Some(vec![0.0; 3]), Some(vec![1.0; 3]));
    request.encoder = Some(from.join("backbone.pth"));
    request.out = folder.path().join("run");
    let unnamed = request.run(&registry(), &mut ()).unwrap_err().to_string();
    assert!(unnamed.ends_with("give kind=dino-wm"), "{unnamed}");
    request.kind = Some("dino-wm".to_owned());
    let described = request.run(&registry(), &mut ()).unwrap();
    assert_eq!(
        (described.model.as_str(), described.settings["normalization"].as_str()),
        ("dino-wm", Some("half"))
    );
    let [read, all] = described.tensors;
    assert!(read > 20 && read + described.lacks.len() == all, "{read} of {all}");
    let expected = swm_weights::read(&from.join("expected.safetensors")).unwrap();
    let case = Case { expected, name: "dino_wm in parts".to_owned() };
    check_model(&case, &TrainedModel::open(&request.out, Which::Last, Device::Cpu).unwrap(), 1e-4);

    // Another predictor of the same repository.
    request.check_only = true;
    save(&|part, rest| format!("{part}.module.predictor_blocks.{rest}"));
    let other = request.run(&registry(), &mut ()).unwrap_err().to_string();
    assert!(other.contains("a predictor of facebookresearch/jepa-wms"), "{other}");
}

#[test]
fn heads_without_their_dim_are_asked_for_the_dim() {
    let other = |name: String, stored| Some((name.replace("predictor.", "forecast."), stored));
    let form = Form::with(LEWM, no_config, other).kind("lewm");
    let message = form.set(json!({ "model.encoder.heads": 3, "model.predictor.heads": 2 })).refused();
    assert!(message.ends_with("give set=model.predictor.head_dim=N"), "{message}");
}
