//! What is refused, and with which words: datasets, settings, weights and environments that do not fit, through the entries that
//! the command uses.

use std::fs;
use std::path::Path;

use serde_json::{Value as Json, json};
use swm_baselines::train::{NewRun, RunFolder, Training};
use swm_baselines::{BaselineError, Device};
use swm_checkpoints::{MODELS, POLICIES, latent_model};
use swm_core::{EnvConfig, ImageSize, PolicyArgs, PolicyContext};
use swm_data::format::built_in;

use super::dot::{DOT, IMAGE, TWIN, WIDE};
use super::{made, made_for, new_run, paths_in, record, record_as, trained};

/// Why a training cannot be made.
fn refused(folder: &Path, dataset: &dyn swm_data::Dataset, new: &NewRun<'_>) -> String {
    let run = folder.join("refused");
    let error = Training::create(built_in(), &run, dataset, new).err().expect("it is refused").to_string();
    assert!(!run.exists(), "nothing is left behind");
    error
}

fn resumed(run: &Path) -> Result<Training, BaselineError> {
    Training::resume(built_in(), run, Device::Cpu, None, |_| ())
}

fn says(message: &str, parts: &[&str]) {
    assert!(parts.iter().all(|part| message.contains(part)), "{message}");
}

#[test]
fn a_run_of_another_environment_is_taken_where_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "world");
    trained(folder.path(), "gcbc", "policy");
    let [world, policy] = ["world", "policy"].map(|name| folder.path().join(name).display().to_string());
    let refusal = ["was trained in swm/Dot-v0, and this is swm/Dot-v1", "transfer=true"];
    for name in [format!("mpc:{world}"), format!("policy:{policy}"), format!("gcbc:{policy}")] {
        says(&made_for(&TWIN, &name).err().unwrap(), &refusal);
        assert!(made_for(&TWIN, &format!("{name},transfer=true")).is_ok());
        assert!(made(&format!("{name},transfer=false")).is_ok(), "its own environment");
        says(&made(&format!("{name},transfer=1")).err().unwrap(), &["`transfer`: `1`; use true or false"]);
    }
    let measured = |text: String| {
        latent_model(&PolicyArgs::parse(&text).unwrap(), TWIN.id, None).map(drop).map_err(|e| e.to_string())
    };
    says(&measured(format!("lewm:{world}")).unwrap_err(), &refusal);
    assert_eq!(measured(format!("lewm:{world},transfer=true")), Ok(()));

    // What earlier versions wrote where the dataset does not say its environment is none.
    for (run, name) in [(&world, format!("mpc:{world}")), (&policy, format!("gcbc:{policy}"))] {
        let file = Path::new(run).join("config.json");
        let said = fs::read_to_string(&file).unwrap();
        let unknown = said.replace("\"swm/Dot-v0\"", "\"unknown\"");
        assert_ne!(said, unknown);
        fs::write(&file, unknown).unwrap();
        assert!(made_for(&TWIN, &name).is_ok() && made(&name).is_ok());
        fs::write(&file, said).unwrap();
    }

    // What does not fit at all stays an error.
    for name in [format!("mpc:{world}"), format!("gcbc:{policy}")] {
        let error = paths_in(&WIDE, &format!("{name},transfer=true"), 1, Some(IMAGE)).err().unwrap();
        says(&error, &["2", "3", "action"]);
    }
}

#[test]
fn a_run_tells_with_which_settings_it_was_trained() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let run = folder.path().join("run");
    let config = EnvConfig::default();
    let trained_in = |name: &str| {
        let args = PolicyArgs::parse(&format!("{name}:{}", run.display())).unwrap();
        let policy = POLICIES.iter().find(|entry| entry.name == name).map(|entry| entry.trained_in(&args));
        let model = || MODELS.iter().find(|entry| entry.name == name).unwrap().trained_in(&args);
        policy.unwrap_or_else(model).expect("the run says so")
    };
    let told = |name: &str, frame_skip: u32| {
        trained_in(name).differences(&PolicyContext::new(&DOT, &config).frame_skip(frame_skip))
    };
    for name in ["mpc", "lewm"] {
        assert_eq!(told(name, 1), []);
        let [skip] = &told(name, 3)[..] else { panic!("one difference") };
        assert_eq!([&skip.name, &skip.trained, &skip.used], ["frame skip", "1", "3"]);
        let dataset = trained_in(name).dataset.expect("the run says so");
        assert!(dataset.path.is_file() && dataset.episodes > 0 && dataset.rows > dataset.episodes);
        assert!(dataset.has_seen(0.2) && !dataset.has_seen(1.0));
    }

    // A run of an earlier version does not say, and does once it is resumed.
    let path = run.join("config.json");
    let mut json: Json = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    let data = json["data"].as_object_mut().unwrap();
    assert!(data.remove("env_settings").is_some() && data.remove("frame_skip").is_some());
    fs::write(&path, json.to_string()).unwrap();
    assert_eq!(told("mpc", 3), []);
    resumed(&run).unwrap();
    assert_eq!(told("mpc", 3).len(), 1);
}

#[test]
fn datasets_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let blind = record_as(&folder.path().join("blind.h5"), None, 1);
    let message = refused(folder.path(), blind.as_ref(), &new_run("lewm"));
    says(
        &message,
        &[
            "blind.h5 cannot train lewm: it has no column `pixels`",
            "cannot be rendered",
            "it was recorded in `swm/Dot-v0`, an environment of another program",
            "record it with images of",
        ],
    );
    let oblong = record_as(&folder.path().join("oblong.h5"), Some(ImageSize { height: 16, width: 8 }), 1);
    let message = refused(folder.path(), oblong.as_ref(), &new_run("lewm"));
    says(&message, &["oblong.h5 cannot train lewm: its images are 16 × 8", "record such, as of 64x64"]);
    let seeing = record(folder.path());
    let feeling = NewRun { changes: json!({ "proprio": 10 }), encoder: None, ..new_run("dino-wm") };
    says(&refused(folder.path(), seeing.as_ref(), &feeling), &["`proprio` is on and the data has none"]);
}

/// A policy on a frozen encoder of the form that the fixtures have.
fn on_frozen_encoder(dim: usize) -> NewRun<'static> {
    let encoder = json!({ "kind": "vit", "dim": dim, "depth": 2, "heads": 3, "hidden": 24, "patch": 4,
        "positions_for": 16 });
    let predictor = json!({ "depth": 1, "heads": 2, "head_dim": 4, "hidden": 8 });
    let model = json!({ "image": 16, "encoder": encoder, "train_encoder": false, "predictor": predictor });
    NewRun { changes: json!({ "model": model }), ..new_run("gcbc") }
}

#[test]
fn encoders_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = record(folder.path());
    let fixture =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../swm-baselines/tests/parity/vit_generation4.pt");
    let fails = |new: NewRun<'_>| refused(folder.path(), dataset.as_ref(), &new);
    says(
        &fails(on_frozen_encoder(12)),
        &["settings of `gcbc`: its encoder is not trained", "name its weights as `encoder`"],
    );
    let frozen = |dim| NewRun { encoder: Some(&fixture), ..on_frozen_encoder(dim) };
    says(&fails(frozen(15)), &["vit_generation4.pt", "of another shape", "cls_token", "Use the settings"]);
    let convolutions = NewRun { encoder: Some(&fixture), ..new_run("gcbc") };
    says(&fails(convolutions), &["missing: ", "unused: "]);
    let bytes = fs::read(&fixture).unwrap();
    let cut = folder.path().join("cut.pt");
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    says(&fails(NewRun { encoder: Some(&cut), ..on_frozen_encoder(12) }), &["cut.pt", "cut off"]);
    assert!(Training::create(built_in(), &folder.path().join("run"), dataset.as_ref(), &frozen(12)).is_ok());
}

#[test]
fn unknown_settings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = record(folder.path());
    let fails =
        |changes: Json| refused(folder.path(), dataset.as_ref(), &NewRun { changes, ..new_run("lewm") });
    says(
        &fails(json!({ "model": { "latent_din": 8 } })),
        &[
            "settings of `lewm`",
            "`model.latent_din`: unknown (did you mean `model.latent_dim`?)",
            "projector",
        ],
    );
    says(
        &fails(json!({ "model": { "encoder": { "kind": "rnn" } } })),
        &["no value `rnn`", "there are `vit`, `cnn`, `keypoints`"],
    );
    for (changes, reason) in [
        (json!({ "optim": { "lr": "fast" } }), "`optim.lr` is \"fast\"; it must be a number"),
        (json!({ "model": { "latent_dim": 8.5 } }), "`model.latent_dim` is 8.5; it must be a whole number"),
        (
            json!({ "model": { "encoder": { "channels": 4 } } }),
            "`model.encoder.channels` is 4; it must be a list",
        ),
        (json!({ "model": true }), "`model` is true; it must be a name or a group of settings"),
    ] {
        says(&fails(changes), &["settings of `lewm`: ", reason]);
    }
}

#[test]
fn a_dataset_that_moved_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let (run, data) = (folder.path().join("run"), folder.path().join("data.h5"));
    let away = folder.path().join("away.h5");
    fs::rename(&data, &away).unwrap();
    says(&resumed(&run).err().unwrap().to_string(), &["its dataset is not there", "data.h5", "`dataset`"]);
    let moved = |path: &Path| Training::resume(built_in(), &run, Device::Cpu, Some(path), |_| ());
    assert!(moved(&away).is_ok() && resumed(&run).is_ok(), "its new place is remembered");
    assert!(moved(&data).is_err());

    record_as(&data, Some(IMAGE), 2);
    says(&moved(&data).err().unwrap().to_string(), &["data.h5 is not the dataset that it was begun with"]);
    fs::remove_file(&data).unwrap();
    fs::rename(&away, &data).unwrap();
    assert!(moved(&data).is_ok());
    assert!(made(&format!("mpc:{}", run.display())).is_ok(), "plans need no dataset");
}

#[test]
fn losses_that_are_not_finite_stop_and_keep_the_last_good_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let run = RunFolder::open(&folder.path().join("run")).unwrap();
    let mut config: Json = run.config().unwrap();
    config["model_config"]["settings"]["optim"]["lr"] = json!(1e30);
    config["fit"]["steps"] = json!(40);
    fs::write(run.config_file(), config.to_string()).unwrap();
    let error = resumed(run.path()).unwrap().run(Vec::new()).unwrap_err().to_string();
    says(&error, &["Training has stopped", "step-00000009.safetensors", "learning rate"]);
    assert_eq!(run.steps().unwrap().last(), Some(&9));
    assert!(made(&format!("mpc:{}", run.path().display())).is_ok());
}

#[test]
fn truncated_weights_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let run = RunFolder::open(&folder.path().join("run")).unwrap();
    let weights = fs::read(run.weights(9)).unwrap();
    fs::write(run.weights(9), &weights[..weights.len() / 2]).unwrap();
    let name = run.path().display();
    assert!(made(&format!("mpc:{name}")).err().unwrap().contains("earlier checkpoint"));
    assert!(made(&format!("mpc:{name},checkpoint=6")).is_ok());
}

#[test]
fn runs_with_the_old_names_of_settings_open() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let run = RunFolder::open(&folder.path().join("run")).unwrap();
    let mut config: Json = run.config().unwrap();
    let dims = config["model_config"]["dims"].clone();
    let mut model = config.as_object_mut().unwrap().shift_remove("model_config").unwrap();
    model.as_object_mut().unwrap().shift_remove("dims");
    model["facts"] = json!({ "action_width": dims["action_dim"], "proprio_width": dims["proprio_dim"] });
    let settings = model["settings"]["model"].as_object_mut().unwrap();
    settings["predictor"]["head_width"] = settings["predictor"]["head_dim"].take();
    settings["predictor"].as_object_mut().unwrap().shift_remove("head_dim");
    let dim = settings.shift_remove("latent_dim").unwrap();
    settings.insert("width".to_owned(), dim);
    config["recipe"] = model;
    fs::write(run.config_file(), config.to_string()).unwrap();
    assert!(made(&format!("mpc:{}", run.path().display())).is_ok());
}
