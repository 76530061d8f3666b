//! LeWM and PLDM: states and predictions in training and after it, losses, gradients, a step, costs of plans.

use serde_json::json;
use swm_solvers::{Candidates, Outputs};

use super::Fixture;
use crate::baseline::PlanModel;
use crate::data::{ClipBatch, DataDims, Form, Images, Inputs, PlanningBatch, Vectors};
use crate::models::joint::{Joint, JointConfig, JointPlanner, Predicted};
use crate::models::{lewm, pldm};
use crate::network::Network;
use swm_nn::Pass;
use swm_nn::params::{self, host};

const DIMS: DataDims = DataDims { action_dim: 4, proprio_dim: 0 };

fn config() -> JointConfig {
    let tiny = json!({
        "image": 16, "latent_dim": 12, "projector": 18, "history": 3, "frameskip": 1, "smoothed": 6, "batch": 5,
        "encoder": {"kind": "vit", "dim": 12, "depth": 2, "heads": 3, "hidden": 24, "patch": 4, "positions_for": 16},
        "predictor": {"depth": 2, "heads": 2, "head_dim": 5, "hidden": 20, "dropout": 0.0},
    });
    serde_json::from_value(tiny).unwrap()
}

fn bytes(fixture: &Fixture) -> Vec<u8> {
    fixture.values("inputs.pixels").iter().map(|value| *value as u8).collect()
}

fn images(values: &[u8], rows: usize, steps: usize) -> Images<'_> {
    Images { values, rows, steps, height: 16, width: 16, channels_last: false }
}

fn inputs(fixture: &Fixture, form: &Form) -> Inputs {
    let pixels = bytes(fixture);
    let action = Vectors { values: fixture.values("inputs.action"), rows: 5, steps: 4, dim: 4 };
    let batch = ClipBatch {
        pixels: images(&pixels, 5, 4),
        latents: None,
        canonical: None,
        action,
        proprio: None,
        goal_pixels: None,
        goal_proprio: None,
    };
    Inputs::new(&batch, form, &fixture.device).unwrap()
}

/// Losses, gradients and a step of a network in training.
fn train(fixture: &Fixture, network: &impl Network, form: &Form, mut pass: Pass) {
    let network = fixture.load(network, "weights");
    let tracked = params::track(&network, &[""]);
    let terms = tracked.loss(0, &inputs(fixture, form), &mut pass).unwrap();
    fixture.check_losses(&terms);
    assert!(fixture.check_gradients(&tracked, &terms.total) > 80);
    fixture.check_step(network, &pass);
}

#[test]
fn lewm_trains_as_the_reference() {
    let fixture = Fixture::open("lewm");
    let mut config = lewm::LewmConfig { model: config(), ..lewm::LewmConfig::paper() };
    config.sigreg.projections = 32;
    let parts = lewm::make(&config, &DIMS, &fixture.device).unwrap();
    let mut pass = Pass::train(0, 0);
    pass.given = vec![fixture.values("inputs.directions").to_vec()];
    train(&fixture, &parts.network, &parts.form, pass);
}

#[test]
fn pldm_trains_as_the_reference() {
    let fixture = Fixture::open("pldm");
    let weights = pldm::PldmWeights { cov_t: 0.5, inverse: 1.5, straightening: 0.3, ..Default::default() };
    let config =
        pldm::PldmConfig { model: config(), inverse_hidden: 16, weights, ..pldm::PldmConfig::paper() };
    let parts = pldm::make(&config, &DIMS, &fixture.device).unwrap();
    train(&fixture, &parts.network, &parts.form, Pass::train(0, 0));
}

fn trained() -> (Fixture, Joint) {
    let fixture = Fixture::open("lewm");
    let model = Joint::new("lewm", &config(), &DIMS, &fixture.device).unwrap();
    let model = fixture.load(&model, "weights");
    (fixture, model)
}

#[test]
fn states_and_predictions_are_the_references() {
    let (fixture, model) = trained();
    let inputs = inputs(&fixture, &config().form(&DIMS));
    for (prefix, mut pass) in [("eval_", Pass::evaluate()), ("", Pass::train(0, 0))] {
        let Predicted { states, predicted, .. } = model.predict_batch(&inputs, &mut pass);
        fixture.check(&format!("outputs.{prefix}states"), states);
        fixture.check(&format!("outputs.{prefix}predicted"), predicted);
    }
}

#[test]
fn costs_of_plans_and_their_gradients_are_the_references() {
    let (fixture, model) = trained();
    let mut planner = JointPlanner::new(model);
    let pixels = bytes(&fixture);
    let size = 3 * 16 * 16;
    for seen in [1, 3] {
        let present: Vec<u8> =
            pixels.chunks(4 * size).take(2).flat_map(|clip| &clip[..seen * size]).copied().collect();
        let goal: Vec<u8> =
            pixels.chunks(4 * size).skip(2).take(2).flat_map(|clip| &clip[..size]).copied().collect();
        let past: Vec<f32> = fixture
            .values("inputs.action")
            .chunks(16)
            .take(2)
            .flat_map(|clip| &clip[..(seen - 1) * 4])
            .copied()
            .collect();
        let planning_batch = PlanningBatch {
            pixels: images(&present, 2, seen),
            action: Vectors { values: &past, rows: 2, steps: seen - 1, dim: 4 },
            proprio: None,
            goal_pixels: images(&goal, 2, 1),
            goal_proprio: None,
        };
        planner.prepare(&planning_batch).unwrap();
        let actions = fixture.values(&format!("inputs.candidates{seen}"));
        let candidates = Candidates { actions, episodes: 2, samples: 6, horizon: 5, dim: 4 };
        fixture.check_costs(&mut planner, &candidates, &format!("outputs.costs{seen}"));
    }
}

#[test]
fn costs_depend_on_their_candidate_alone() {
    let (fixture, model) = trained();
    let mut planner = JointPlanner::new(model);
    let pixels = bytes(&fixture);
    let frames = |rows: &[usize]| {
        let clips: Vec<&[u8]> = pixels.chunks(4 * 3 * 16 * 16).collect();
        rows.iter().flat_map(|row| clips[*row][..3 * 16 * 16].iter().copied()).collect::<Vec<u8>>()
    };
    let plans: Vec<f32> = host(Pass::train(5, 0).normal([40 * 5 * 4], &fixture.device));
    let mut costs_of = |rows: &[usize], samples: usize| {
        let (now, goal) = (frames(rows), frames(&[4].repeat(rows.len())));
        let planning_batch = PlanningBatch {
            pixels: images(&now, rows.len(), 1),
            action: Vectors { values: &[], rows: rows.len(), steps: 0, dim: 4 },
            proprio: None,
            goal_pixels: images(&goal, rows.len(), 1),
            goal_proprio: None,
        };
        planner.prepare(&planning_batch).unwrap();
        let actions = plans[..samples * 20].repeat(rows.len());
        let candidates = Candidates { actions: &actions, episodes: rows.len(), samples, horizon: 5, dim: 4 };
        let mut costs = vec![0.0; rows.len() * samples];
        planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
        costs
    };
    let together = costs_of(&[0, 1, 2], 40);
    let alone = costs_of(&[1], 40);
    assert_eq!(together[40..80], alone);
    assert_eq!(costs_of(&[1], 7), alone[..7]);
    assert_ne!(together[..40], alone);
}
