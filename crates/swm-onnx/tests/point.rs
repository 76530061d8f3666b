//! A model that `tests/onnx/make_model.py` exported from PyTorch: its costs and gradients are PyTorch's, and plans on it
//! lead to the goal. Needs ONNX Runtime, which `cargo xtask test` fetches; without it, says so and tests nothing.

mod point_env;

use std::path::{Path, PathBuf};

use point_env::{POINT, is_there, world};
use serde_json::Value as Json;
use swm_core::{EnvConfig, PolicyArgs, PolicyContext, Registry, Rollout};
use swm_onnx::{OnnxCost, POLICIES};
use swm_solvers::testing::Probe;
use swm_solvers::{MpcPolicy, PlanConfig};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/point")
}

#[test]
fn costs_and_gradients_are_those_of_pytorch() {
    if !is_there() {
        return;
    }
    let text = std::fs::read_to_string(folder().join("expected.json")).unwrap();
    let expected: Json = serde_json::from_str(&text).unwrap();
    let numbers = |name: &str| -> Vec<f64> {
        expected[name].as_array().unwrap().iter().map(|value| value.as_f64().unwrap()).collect()
    };
    let wanted = [numbers("costs"), numbers("costs"), numbers("gradient")].concat();
    // The plans of `make_model.py`.
    let plans = (0..100).map(|index| -1.0 + 2.0 * index as f32 / 99.0).collect();
    let (probe, heard) = Probe::new(plans, 2);
    let cost = Box::new(OnnxCost::load(&folder()).unwrap());
    let mut world = world(1);
    world.set_policy(MpcPolicy::new(Box::new(probe), cost, PlanConfig::default()).unwrap()).unwrap();
    let rollout = Rollout::new(0..1).seed(1);
    world.evaluate(&rollout).unwrap();
    let heard = heard.lock().unwrap();
    let gradient = heard.gradient.iter().copied().map(f64::from).collect();
    let found = [heard.costs.clone(), heard.costs_with_gradient.clone(), gradient].concat();
    assert_eq!(found.len(), wanted.len());
    for (found, wanted) in found.iter().zip(&wanted) {
        assert!((found - wanted).abs() < 1e-5 * wanted.abs().max(1.0), "{found} is not {wanted}");
    }
}

#[test]
fn plans_on_an_exported_model_lead_to_the_goal() {
    if !is_there() {
        return;
    }
    let run = |settings: &str, num_envs| {
        let text = format!("onnx:{},{settings}", folder().display());
        let mut world = world(num_envs);
        world.set_policy(Registry::new().with(POLICIES).policy(&text, &world).unwrap()).unwrap();
        let rollout = Rollout::new(0..3).seed(1);
        world.evaluate(&rollout).unwrap()
    };
    for settings in ["samples=200,iterations=20,elites=20", "solver=adam,samples=1,iterations=60"] {
        let one = run(settings, 1);
        assert_eq!(one.success_rate, 100.0, "{settings}");
        assert_eq!(one.episode_lengths, run(settings, 3).episode_lengths, "{settings}");
    }
}

#[test]
fn what_does_not_fit_is_said() {
    if !is_there() {
        return;
    }
    let registry = Registry::new().with(POLICIES);
    let fails = |text: &str| registry.policy(text, &world(1)).err().unwrap().to_string();
    let missing = fails("onnx:nowhere");
    assert!(
        missing.contains("nowhere/model.json: ") && missing.contains("`stable_worldmodel_rs.export`"),
        "{missing}"
    );
    assert!(fails("onnx").contains("onnx:DIR"));
    assert!(fails(&format!("onnx:{},action_block=3", folder().display())).contains("blocks of 5"));
    let text = format!("onnx:{},horizon=2,receding_horizon=2", folder().display());
    let mut world = world(1);
    world.set_policy(registry.policy(&text, &world).unwrap()).unwrap();
    let rollout = Rollout::new(0..1).seed(1);
    let mut error: &dyn std::error::Error = &world.evaluate(&rollout).unwrap_err();
    let mut text = error.to_string();
    while let Some(source) = error.source() {
        error = source;
        text = format!("{text}: {error}");
    }
    assert!(text.contains("horizon=5"), "{text}");
}

/// What commands ask of a model: the oracle is its own planner on the true dynamics, and it can be traced.
#[test]
fn it_names_its_oracle_and_its_files_and_shows_its_planner() {
    let args = |text: &str| PolicyArgs::parse(text).unwrap();
    let (entry, config) = (&POLICIES[0], EnvConfig::default());
    let context = PolicyContext::new(&POINT, &config);
    let model = format!("onnx:{}", folder().display());
    let named = args(&format!("{model},solver=icem,samples=7"));
    assert_eq!(entry.oracle_args(&context, &named), Some(args("icem:samples=7,action_block=5")));
    assert_eq!(entry.oracle_args(&context, &args("onnx:nowhere")), None);
    assert_eq!(entry.model_files(&named).unwrap(), [folder()]);
    if is_there() {
        let mut policy = entry.make(&context, &args(&model)).unwrap();
        assert!(policy.as_any().is_some_and(|policy| policy.is::<MpcPolicy>()));
    }
}
