//! DINO-WM with proprioception: loss, gradients, costs of plans. Its encoder is frozen, and its positions are interpolated.

use serde_json::json;
use swm_solvers::Candidates;

use super::Fixture;
use crate::data::{ClipBatch, DataDims, Images, Inputs, PlanningBatch, Vectors};
use crate::models::dino_wm::{DinoWmConfig, make};
use crate::network::{Network, Parts};
use swm_nn::Pass;
use swm_nn::params;

const DIMS: DataDims = DataDims { action_dim: 4, proprio_dim: 3 };
/// Values of an image.
const SIZE: usize = 3 * 12 * 12;

fn parts(fixture: &Fixture) -> Parts<impl Network + use<>> {
    let tiny = json!({
        "image": 12, "proprio": 2, "action": 2, "history": 3, "frameskip": 1, "batch": 4, "optim": {},
        "encoder": {
            "kind": "vit", "dim": 12, "depth": 2, "heads": 3, "hidden": 24, "patch": 4, "positions_for": 16,
            "dinov2": true,
        },
        "predictor": {"depth": 2, "heads": 2, "head_dim": 5, "hidden": 20, "dropout": 0.0},
    });
    let config: DinoWmConfig = serde_json::from_value(tiny).unwrap();
    make(&config, &DIMS, &fixture.device).unwrap()
}

fn images(values: &[u8], steps: usize) -> Images<'_> {
    Images { values, rows: values.len() / steps / SIZE, steps, height: 12, width: 12, channels_last: false }
}

fn vectors(values: &[f32], rows: usize, dim: usize) -> Vectors<'_> {
    Vectors { values, rows, steps: values.len() / rows / dim, dim }
}

#[test]
fn dino_wm_trains_as_the_reference() {
    let fixture = Fixture::open("dino_wm");
    let parts = parts(&fixture);
    let network = fixture.load(&parts.network, "weights");
    let pixels: Vec<u8> = fixture.values("inputs.pixels").iter().map(|value| *value as u8).collect();
    let batch = ClipBatch {
        pixels: images(&pixels, 4),
        latents: None,
        canonical: None,
        action: vectors(fixture.values("inputs.action"), 4, 4),
        proprio: Some(vectors(fixture.values("inputs.proprio"), 4, 3)),
        goal_pixels: None,
        goal_proprio: None,
    };
    let inputs = Inputs::new(&batch, &parts.form, &fixture.device).unwrap();
    let tracked = params::track(&network, parts.phases[0].trains);
    let terms = tracked.loss(0, &inputs, &mut Pass::train(0, 0)).unwrap();
    fixture.check_losses(&terms);
    assert!(fixture.check_gradients(&tracked, &terms.total) > 20);
}

#[test]
fn costs_of_plans_and_their_gradients_are_the_references() {
    let fixture = Fixture::open("dino_wm");
    let mut planner = fixture.load(&parts(&fixture).network, "weights").planner().unwrap();
    let pixels: Vec<u8> = fixture.values("inputs.pixels").iter().map(|value| *value as u8).collect();
    let (action, proprio) = (fixture.values("inputs.action"), fixture.values("inputs.proprio"));
    for seen in [1, 3] {
        let frames = |skip, steps: usize| -> Vec<u8> {
            pixels
                .chunks(4 * SIZE)
                .skip(skip)
                .take(2)
                .flat_map(|clip| &clip[..steps * SIZE])
                .copied()
                .collect()
        };
        let rows = |values: &[f32], dim: usize, skip, steps: usize| -> Vec<f32> {
            values.chunks(4 * dim).skip(skip).take(2).flat_map(|clip| &clip[..steps * dim]).copied().collect()
        };
        let (now, goal) = (frames(0, seen), frames(2, 1));
        let (past, state, goal_state) =
            (rows(action, 4, 0, seen - 1), rows(proprio, 3, 0, seen), rows(proprio, 3, 2, 1));
        let planning_batch = PlanningBatch {
            pixels: images(&now, seen),
            action: vectors(&past, 2, 4),
            proprio: Some(vectors(&state, 2, 3)),
            goal_pixels: images(&goal, 1),
            goal_proprio: Some(vectors(&goal_state, 2, 3)),
        };
        planner.prepare(&planning_batch).unwrap();
        let actions = fixture.values(&format!("inputs.candidates{seen}"));
        let candidates = Candidates { actions, episodes: 2, samples: 6, horizon: 4, dim: 4 };
        fixture.check_costs(planner.as_mut(), &candidates, &format!("outputs.costs{seen}"));
    }
}
