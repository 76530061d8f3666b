//! Models whose outputs have many shapes and types, which `tests/onnx/make_outputs.py` wrote: what is a cost per candidate plans
//! alike, and everything else is refused by name. Needs ONNX Runtime, as `point.rs`.

mod point_env;

use std::path::PathBuf;

use point_env::{is_there, world};
use swm_core::{Evaluation, Registry, Rollout};
use swm_onnx::POLICIES;

/// A folder of a model of these files in `tests/outputs`.
fn model(encode: &str, cost: &str, gradient: Option<&str>) -> PathBuf {
    let files = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/outputs");
    let name = format!("{encode}-{cost}-{}", gradient.unwrap_or("none"));
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::create_dir_all(&folder).expect("a folder is made");
    let named = [Some((encode, "encode")), Some((cost, "cost")), gradient.map(|file| (file, "cost_grad"))];
    for (file, name) in named.into_iter().flatten() {
        std::fs::copy(files.join(format!("{file}.onnx")), folder.join(format!("{name}.onnx")))
            .expect("a file is copied");
    }
    std::fs::write(folder.join("model.json"), r#"{"name": "by-hand", "action_block": 5}"#)
        .expect("a file is written");
    folder
}

/// Plans with a model, or the whole message of why not.
fn evaluate(model: &std::path::Path, settings: &str) -> Result<Evaluation, String> {
    let mut world = world(1);
    let policy =
        Registry::new().with(POLICIES).policy(&format!("onnx:{},{settings}", model.display()), &world);
    let policy = policy.map_err(|error| format!("at load: {error}"))?;
    world.set_policy(policy).map_err(|error| error.to_string())?;
    world.evaluate(&Rollout::new(0..2).seed(1)).map_err(|error| {
        let mut error: &dyn std::error::Error = &error;
        let mut text = format!("at run: {error}");
        while let Some(source) = error.source() {
            error = source;
            text = format!("{text}: {error}");
        }
        text
    })
}

const SAMPLING: &str = "samples=200,iterations=20,elites=20";
const ADAM: &str = "solver=adam,samples=1,iterations=60";

#[test]
fn a_cost_per_candidate_plans_alike_in_every_shape_and_type() {
    if !is_there() {
        return;
    }
    let right = evaluate(&model("encode", "s", None), SAMPLING).unwrap();
    assert_eq!(right.success_rate, 100.0);
    for cost in ["s_1", "f64", "open"] {
        let found = evaluate(&model("encode", cost, None), SAMPLING).unwrap();
        assert_eq!(found.episode_lengths, right.episode_lengths, "{cost}");
        assert_eq!(found.success_rate, 100.0, "{cost}");
    }
    let lengths = ["grad", "grad_f64"].map(|gradient| {
        let found = evaluate(&model("encode", "s", Some(gradient)), ADAM).unwrap();
        assert_eq!(found.success_rate, 100.0, "{gradient}");
        found.episode_lengths
    });
    assert_eq!(lengths[0], lengths[1]);
}

#[test]
fn other_costs_are_refused_by_name() {
    if !is_there() {
        return;
    }
    let cases = [
        ("one", "at load", "`cost` is [1], and [32] or [32, 1] is expected"),
        ("s_h", "at load", "`cost` is [32, 5], and [32] or [32, 1] is expected"),
        ("i32", "at load", "`cost` is i32; export it as float32 or float64"),
        ("nan", "at load", "weight `weight` has NaN"),
        // ONNX Runtime infers its size.
        ("unstated", "at load", "`cost` is [1], and [128] or [128, 1] is expected"),
        // A file that states no shape looks like one with a scalar.
        ("scalar", "at run", "`cost` is [], and [32] or [32, 1] is expected"),
    ];
    for (cost, when, what) in cases {
        let message = evaluate(&model("encode", cost, None), SAMPLING).unwrap_err();
        assert!(message.starts_with(when) && message.contains(what), "{cost}: {message}");
    }
    let message = evaluate(&model("encode", "s", Some("grad_flat")), ADAM).unwrap_err();
    let what = "cost_grad.onnx: its output `gradient` is [32, 50], and [32, 5, 10] is expected";
    assert!(message.starts_with("at load") && message.contains(what), "{message}");
    let message = evaluate(&model("encode", "s", Some("s")), ADAM).unwrap_err();
    assert!(message.contains("no output `gradient`"), "{message}");
}

#[test]
fn what_the_encoder_gives_is_checked() {
    if !is_there() {
        return;
    }
    let message = evaluate(&model("encode_nan", "s", None), SAMPLING).unwrap_err();
    assert!(message.contains("encode.onnx gives NaN in `start`"), "{message}");
    let message = evaluate(&model("encode_start", "s", None), SAMPLING).unwrap_err();
    let what = "its input `target` is no output of encode.onnx, which are `start`";
    assert!(message.starts_with("at load") && message.contains(what), "{message}");
}
