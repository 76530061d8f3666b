//! GCBC, GCIVL and GCIQL: losses and gradients of each phase, with teachers and rewards, and the actions chosen.

use serde_json::json;

use super::Fixture;
use crate::data::{ClipBatch, Facts, Images, Inputs, Numbers, Scenes};
use crate::models::goal::GoalConfig;
use crate::models::{gcbc, gciql, gcivl};
use crate::network::{Network, Parts};
use crate::params;
use crate::pass::Pass;

const FACTS: Facts = Facts { action_width: 4, proprio_width: 3 };
const HISTORY: usize = 2;
const CLIPS: usize = 5;

fn config() -> GoalConfig {
    let tiny = json!({
        "image": 8, "train_encoder": true, "proprio": 2, "history": HISTORY, "frameskip": 1, "batch": CLIPS,
        "encoder": {"kind": "vit", "width": 12, "depth": 2, "heads": 3, "hidden": 24, "patch": 4, "positions_for": 8},
        "predictor": {"depth": 3, "heads": 2, "head_width": 5, "hidden": 20, "dropout": 0.0},
    });
    serde_json::from_value(tiny).unwrap()
}

/// Loss and gradients of a phase, and the actions for the first frames.
fn compare(name: &str, parts: &Parts<impl Network>, phase: usize) {
    let fixture = Fixture::open(name);
    let network = fixture.load(&parts.network, "weights");
    let [pixels, goals] = ["inputs.pixels", "inputs.goal_pixels"]
        .map(|name| fixture.values(name).iter().map(|value| *value as u8).collect::<Vec<u8>>());
    let images =
        |values, steps| Images { values, rows: CLIPS, steps, height: 8, width: 8, channels_last: false };
    let numbers = |values, steps, width| Numbers { values, rows: CLIPS, steps, width };
    let steps = parts.needs.num_steps;
    let batch = ClipBatch {
        pixels: images(&pixels, steps),
        action: numbers(fixture.values("inputs.action"), steps, 4),
        proprio: Some(numbers(fixture.values("inputs.proprio"), steps, 3)),
        goal_pixels: Some(images(&goals, 1)),
        goal_proprio: Some(numbers(fixture.values("inputs.goal_proprio"), 1, 3)),
    };
    let inputs = Inputs::new(&batch, &parts.form, &fixture.device).unwrap();
    let tracked = params::track(&network, parts.phases[phase].trains);
    let terms = tracked.loss(phase, &inputs, &mut Pass::train(0, 0)).unwrap();
    fixture.check_loss("total", &terms.total);
    assert!(fixture.check_gradients(&tracked, &terms.total) > 20);

    let first = |values: &[u8]| -> Vec<u8> {
        let size = 3 * 8 * 8;
        values.chunks(steps * size).flat_map(|clip| &clip[..HISTORY * size]).copied().collect()
    };
    let states = fixture.values("inputs.proprio");
    let states: Vec<f32> = states.chunks(steps * 3).flat_map(|clip| &clip[..HISTORY * 3]).copied().collect();
    let shown = first(&pixels);
    let scenes = Scenes {
        pixels: images(&shown, HISTORY),
        action: numbers(&[0.0; CLIPS * 4], HISTORY - 1, 4),
        proprio: Some(numbers(&states, HISTORY, 3)),
        goal_pixels: images(&goals, 1),
        goal_proprio: Some(numbers(fixture.values("inputs.goal_proprio"), 1, 3)),
    };
    let mut policy = network.policy().unwrap();
    let mut actions = vec![0.0; CLIPS * 4];
    policy.act(&scenes, &mut actions).unwrap();
    assert!(super::worst(&actions, fixture.values("outputs.act")) < super::OUTPUT);
}

#[test]
fn gcbc_trains_and_acts_as_the_reference() {
    let config = gcbc::GcbcConfig { model: config(), ..gcbc::GcbcConfig::paper() };
    compare("gcbc", &gcbc::make(&config, &FACTS, &burn::tensor::Device::flex()).unwrap(), 0);
}

#[test]
fn gcivl_trains_and_acts_as_the_reference() {
    let config = gcivl::GcivlConfig { model: config(), ..gcivl::GcivlConfig::paper() };
    let parts = gcivl::make(&config, &FACTS, &burn::tensor::Device::flex()).unwrap();
    compare("gcivl_value", &parts, 0);
    compare("gcivl_policy", &parts, 1);
}

#[test]
fn gciql_trains_and_acts_as_the_reference() {
    let model = config();
    let config = gciql::GciqlConfig { model, critic_hidden: 9, ..gciql::GciqlConfig::paper() };
    let parts = gciql::make(&config, &FACTS, &burn::tensor::Device::flex()).unwrap();
    compare("gciql_value", &parts, 0);
    compare("gciql_policy", &parts, 1);
}
