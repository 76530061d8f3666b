//! What is not exported.

use std::path::Path;

use serde_json::{Value as Json, json};
use swm_baselines::train::RunFolder;
use swm_core::evaluate::sha256_of;
use swm_tasks::request::Request as _;

use super::super::Export;
use super::{export, imported, registry};

fn message(request: &Export) -> String {
    request.run(&registry(), &mut ()).expect_err("a refusal").to_string()
}

/// Changes a setting of a run's `config.json`.
fn change(run: &Path, place: &str, value: Json) {
    let file = RunFolder::open(run).unwrap().config_file();
    let mut config: Json = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    *config.pointer_mut(place).unwrap_or_else(|| panic!("{place}")) = value;
    std::fs::write(&file, serde_json::to_vec(&config).unwrap()).unwrap();
}

#[test]
fn requests_that_cannot_be_met_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |part: &str| folder.path().join(part);
    imported("lewm_trainer", "last.ckpt", None, &at("run"));
    let request = Export { run: at("run"), out: at("out"), ..Export::default() };
    for (request, part) in [
        (Export { run: "".into(), ..request.clone() }, "a run to export must be named"),
        (Export { out: "".into(), ..request.clone() }, "a folder for the checkpoint must be named"),
        (Export { transformers: Some(3), ..request.clone() }, "transformers=3: is no version"),
        (Export { checkpoint: "first".to_owned(), ..request.clone() }, "use last, best or a step"),
        (Export { checkpoint: "7".to_owned(), ..request.clone() }, "no checkpoint at step 7"),
        (Export { run: at("nothing"), ..request.clone() }, "there is no such folder"),
        (Export { out: at("run"), ..request.clone() }, "which an export does not replace"),
    ] {
        let message = message(&request);
        assert!(message.contains(part), "{message}");
    }
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "{left:?}");
    export(&at("run"), &at("out"), None);
    let before = std::fs::read(at("out/config.json")).unwrap();
    assert!(message(&request).contains("out="), "{}", message(&request));
    assert_eq!(std::fs::read(at("out/config.json")).unwrap(), before);
}

#[test]
fn networks_that_the_reference_lacks_are_named() {
    for (name, file, kind, place, value, part) in [
        (
            "lewm_trainer",
            "last.ckpt",
            None,
            "/model_config/settings/model/encoder/dinov2",
            json!(true),
            "its encoder is a DINOv2",
        ),
        (
            "gcbc",
            "weights_epoch_3.pt",
            None,
            "/model_config/settings/model/predictor/compare",
            json!(true),
            "model.predictor.compare",
        ),
        (
            "gcbc",
            "weights_epoch_3.pt",
            None,
            "/model_config/baseline",
            json!("gcsl"),
            "a gcsl is no model of stable-worldmodel",
        ),
        (
            "tdmpc2_state",
            "weights_epoch_1.pt",
            None,
            "/interface/columns",
            json!(["state", "velocity"]),
            "state and velocity as one vector",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let (run, out) = (folder.path().join("run"), folder.path().join("out"));
        imported(name, file, kind, &run);
        change(&run, place, value);
        let message = message(&Export { run: run.clone(), out: out.clone(), ..Export::default() });
        assert!(message.contains(part) && message.contains(&run.display().to_string()), "{message}");
        assert!(!out.exists());
    }
}

#[test]
fn weights_that_are_not_those_of_the_run_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (run, out) = (folder.path().join("run"), folder.path().join("out"));
    imported("lewm_trainer", "last.ckpt", None, &run);
    let weights = RunFolder::open(&run).unwrap().weights(0);
    let hash = sha256_of(std::fs::File::open(&weights).unwrap()).unwrap();
    let mut bytes = std::fs::read(&weights).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&weights, bytes).unwrap();
    assert_ne!(sha256_of(std::fs::File::open(&weights).unwrap()).unwrap(), hash);
    let message = message(&Export { run, out: out.clone(), ..Export::default() });
    assert!(message.contains("step-"), "{message}");
    assert!(!out.exists());
}
