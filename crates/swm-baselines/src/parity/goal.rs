//! GCBC, GCIVL, GCIQL and HILP: losses and gradients of each phase, with target networks and rewards, and the actions chosen.

use serde_json::json;

use super::Fixture;
use crate::data::{ClipBatch, DataDims, Images, Inputs, PlanningBatch, Vectors};
use crate::models::goal::GoalConfig;
use crate::models::{gcbc, gciql, gcivl, hilp};
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::params;
use swm_nn::{MetricValue, TokenForm, ValueNetwork as _};

const DIMS: DataDims = DataDims { action_dim: 4, proprio_dim: 3 };
const CLIPS: usize = 5;

fn config() -> GoalConfig {
    sized(2, 12)
}

/// With a history of so many frames, and so many values of the encoder's tokens.
fn sized(history: usize, dim: usize) -> GoalConfig {
    let tiny = json!({
        "image": 8, "train_encoder": true, "proprio": 2, "history": history, "frameskip": 1, "batch": CLIPS,
        "encoder": {"kind": "vit", "dim": dim, "depth": 2, "heads": 3, "hidden": 24, "patch": 4, "positions_for": 8},
        "predictor": {"depth": 3, "heads": 2, "head_dim": 5, "hidden": 20, "dropout": 0.0},
    });
    serde_json::from_value(tiny).unwrap()
}

/// Loss and gradients of a phase, and the actions for the frames of a history.
fn compare(name: &str, parts: &Parts<impl Network>, history: usize, phase: usize) {
    let fixture = Fixture::open(name);
    let network = fixture.load(&parts.network, "weights");
    let [pixels, goals] = ["inputs.pixels", "inputs.goal_pixels"]
        .map(|name| fixture.values(name).iter().map(|value| *value as u8).collect::<Vec<u8>>());
    let images =
        |values, steps| Images { values, rows: CLIPS, steps, height: 8, width: 8, channels_last: false };
    let vectors = |values, steps, dim| Vectors { values, rows: CLIPS, steps, dim };
    let steps = parts.input_spec.num_steps;
    let batch = ClipBatch {
        pixels: images(&pixels, steps),
        latents: None,
        canonical: None,
        action: vectors(fixture.values("inputs.action"), steps, 4),
        proprio: Some(vectors(fixture.values("inputs.proprio"), steps, 3)),
        goal_pixels: Some(images(&goals, 1)),
        goal_proprio: Some(vectors(fixture.values("inputs.goal_proprio"), 1, 3)),
    };
    let inputs = Inputs::new(&batch, &parts.form, &fixture.device).unwrap();
    let tracked = params::track(&network, parts.phases[phase].trains);
    let terms = tracked.loss(phase, &inputs, &mut Pass::train(0, 0)).unwrap();
    fixture.check_loss("total", &terms.total);
    for (part, value) in &terms.parts {
        if fixture.tensors.contains_key(&format!("outputs.{part}")) {
            fixture.check_loss(part, value);
        }
    }
    assert!(fixture.check_gradients(&tracked, &terms.total) > 20);

    let first = |values: &[u8]| -> Vec<u8> {
        let size = 3 * 8 * 8;
        values.chunks(steps * size).flat_map(|clip| &clip[..history * size]).copied().collect()
    };
    let states = fixture.values("inputs.proprio");
    let states: Vec<f32> = states.chunks(steps * 3).flat_map(|clip| &clip[..history * 3]).copied().collect();
    let shown = first(&pixels);
    let past = vec![0.0; CLIPS * (history - 1) * 4];
    let planning_batch = PlanningBatch {
        pixels: images(&shown, history),
        action: vectors(&past, history - 1, 4),
        proprio: Some(vectors(&states, history, 3)),
        goal_pixels: images(&goals, 1),
        goal_proprio: Some(vectors(fixture.values("inputs.goal_proprio"), 1, 3)),
    };
    let mut policy = network.policy().unwrap();
    let mut actions = vec![0.0; CLIPS * 4];
    policy.act(&planning_batch, &mut actions).unwrap();
    assert!(super::worst(&actions, fixture.values("outputs.act")) < super::OUTPUT);
}

#[test]
fn gcbc_trains_and_acts_as_the_reference() {
    let config = gcbc::GcbcConfig { model: config(), ..gcbc::GcbcConfig::paper() };
    compare("gcbc", &gcbc::make(&config, &DIMS, &burn::tensor::Device::flex()).unwrap(), 2, 0);
}

#[test]
fn gcivl_trains_and_acts_as_the_reference() {
    let config = gcivl::GcivlConfig { model: config(), ..gcivl::GcivlConfig::paper() };
    let parts = gcivl::make(&config, &DIMS, &burn::tensor::Device::flex()).unwrap();
    compare("gcivl_value", &parts, 2, 0);
    compare("gcivl_policy", &parts, 2, 1);
}

#[test]
fn gciql_trains_and_acts_as_the_reference() {
    let model = config();
    let config = gciql::GciqlConfig { model, critic_hidden: 9, ..gciql::GciqlConfig::paper() };
    let parts = gciql::make(&config, &DIMS, &burn::tensor::Device::flex()).unwrap();
    compare("gciql_value", &parts, 2, 0);
    compare("gciql_policy", &parts, 2, 1);
}

#[test]
fn hilp_trains_and_acts_as_the_reference() {
    let config = hilp::HilpConfig { model: sized(3, 6), embed_dim: 5, ..hilp::HilpConfig::paper() };
    let parts = hilp::make(&config, &DIMS, &burn::tensor::Device::flex()).unwrap();
    compare("hilp_value", &parts, 3, 0);
    compare("hilp_policy", &parts, 3, 1);
}

#[test]
fn hilps_values_are_the_references() {
    let fixture = Fixture::open("hilp_value");
    let network = MetricValue::new(
        &sized(3, 6).predictor,
        &TokenForm { patches: 4, frames: 3, dim: 8 },
        5,
        &fixture.device,
    );
    let network = fixture.load(&network, "weights.value_predictor.student");
    let value =
        network.value(fixture.tensor("inputs.frames"), fixture.tensor("inputs.goal"), &mut Pass::evaluate());
    fixture.check("outputs.values", value);
}
