//! What costs of plans and additional losses are made of, against each other.

use serde_json::{Value as Json, json};
use swm_solvers::{Aggregate, Candidates, Outputs};

use super::{CLIPS, Clips, joint, maps, options, places, step, tiny};
use crate::{Images, Losses, MakeOptions, PlanningBatch, Vectors, make};

#[test]
fn additional_losses_are_what_they_say() {
    // Costs of LeWM and PLDM are sums over the 8 values of a latent, those of Conv-JEPA means.
    for (name, settings, summed) in [
        ("conv-jepa", maps as fn() -> _, 1.0),
        ("conv-jepa", places, 1.0),
        ("lewm", joint, 8.0),
        ("pldm", joint, 8.0),
    ] {
        let mut changes = settings();
        // More predictions on end than the model sees states: the window slides.
        changes["rollout_steps"] = json!(4);
        changes["weights"] = json!({ "inverse": 0.5, "straightening": 0.25, "rollout": 2.0 });
        let mut model = make(name, &MakeOptions { seed: 3, ..options("small", changes) }).unwrap();
        assert_eq!(model.input_spec().num_steps, 5);
        (0..3).for_each(|index| drop(step(model.as_mut(), 0, index)));
        let clips = Clips::of(model.as_ref());
        let losses = model.validate(&clips.batch(), 0).unwrap();
        let part =
            |name: &str| f64::from(losses.parts.iter().find(|(part, _)| *part == name).expect("a part").1);
        if name != "pldm" {
            let sigreg = model.model_config().settings["sigreg"]["weight"].as_f64().unwrap();
            let added = 0.5 * part("inverse") + 0.25 * part("straightening") + 2.0 * part("rollout");
            let total = part("prediction") + sigreg * part("sigreg") + added;
            assert!((f64::from(losses.total) - total).abs() < 1e-5 * total.abs(), "{losses:?}");
        }
        assert!(part("inverse") > 0.0 && (-1.0..=1.0).contains(&part("straightening")));

        // A plan's cost is the squared distance of what it leads to from a goal, here the true state.
        let mut planner = model.planner().unwrap();
        let dim = clips.dim;
        let mut sum = 0.0;
        for clip in 0..CLIPS {
            for steps in 1..=4 {
                let frame = |step: usize| Images {
                    values: &clips.pixels[(clip * 5 + step) * 768..][..768],
                    rows: 1,
                    steps: 1,
                    height: 16,
                    width: 16,
                    channels_last: true,
                };
                let action = Vectors { values: &[], rows: 1, steps: 0, dim };
                let (pixels, goal_pixels) = (frame(0), frame(steps));
                planner
                    .prepare(&PlanningBatch {
                        pixels,
                        action,
                        proprio: None,
                        goal_pixels,
                        goal_proprio: None,
                    })
                    .unwrap();
                let actions = &clips.action[clip * 5 * dim..][..steps * dim];
                let candidates = Candidates { actions, episodes: 1, samples: 1, horizon: steps, dim };
                let mut cost = [0.0];
                planner.evaluate(&candidates, &mut Outputs::new(&mut cost)).unwrap();
                sum += cost[0] / summed;
            }
        }
        let (rollout, wanted) = (part("rollout"), sum / (CLIPS * 4) as f64);
        assert!((rollout - wanted).abs() < 1e-4 * wanted, "{name}: {rollout} is not {wanted}");
    }
    let none = json!({ "rollout_steps": 0, "weights": { "rollout": 1.0 } });
    let refused = make("lewm", &options("small", none)).err().unwrap().to_string();
    assert!(refused.contains("`rollout_steps` 0"), "{refused}");
}

#[test]
fn drawings_are_a_term_of_models_that_find_places() {
    let keypoints = json!({"kind": "keypoints", "channels": [4, 8], "count": 4});
    for (name, settings, other) in [
        ("conv-jepa", maps as fn() -> _, json!({"kind": "map"})),
        ("lewm", joint, json!({"kind": "cnn"})),
        ("pldm", joint, json!({"kind": "cnn"})),
    ] {
        let with = |encoder: &Json, drawing: f64| {
            let mut changes = settings();
            changes["model"]["encoder"] = encoder.clone();
            changes["model"]["image"] = json!(32);
            changes["weights"] = json!({ "drawing": drawing });
            make(name, &MakeOptions { seed: 3, ..options("small", changes) })
        };
        let [mut drawn, mut other_weight, mut plain] =
            [0.5, 2.0, 0.0].map(|drawing| with(&keypoints, drawing).unwrap());
        let losses = [&mut drawn, &mut other_weight, &mut plain].map(|model| step(model.as_mut(), 0, 0));
        let part =
            |losses: &Losses| losses.parts.iter().find(|(part, _)| *part == "drawing").map(|part| part.1);
        let found = part(&losses[0]).expect("a part");
        // The same first weights, so that totals differ by the term alone. What is drawn from first weights explains hardly anything.
        assert!(
            found > 0.5 && part(&losses[1]) == Some(found) && part(&losses[2]).is_none(),
            "{name}: {losses:?}"
        );
        for (drawn, weight) in losses.iter().zip([0.5, 2.0]) {
            let wanted = losses[2].total + weight * found;
            assert!((drawn.total - wanted).abs() < 1e-5 * wanted.abs(), "{name}: {losses:?}");
        }
        let refused = with(&other, 1.0).err().expect("a refusal").to_string();
        assert!(refused.contains("take `keypoints`"), "{name}: {refused}");
    }
}

#[test]
fn costs_are_aggregated_over_predicted_states() {
    for name in ["conv-jepa", "lewm", "dino-wm"] {
        let mut model = tiny(name);
        let clips = Clips::of(model.as_ref());
        (0..3).for_each(|index| drop(step(model.as_mut(), 0, index)));
        let mut planner = model.planner().unwrap();
        planner.prepare(&clips.planning_batch(0..1)).unwrap();
        let dim = planner.block_dim();
        let plans: Vec<f32> = (0..5 * 3 * dim).map(|i| (i as f32).cos()).collect();
        let mut costs = |how, horizon: usize| {
            planner.set_aggregate(how);
            let actions: Vec<f32> =
                plans.chunks(3 * dim).flat_map(|plan| &plan[..horizon * dim]).copied().collect();
            let (mut costs, mut gradient) = (vec![0.0; 5], vec![0.0; actions.len()]);
            let candidates = Candidates { actions: &actions, episodes: 1, samples: 5, horizon, dim };
            planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
            let mut again = [0.0; 5];
            let outputs = &mut Outputs { gradient: Some(&mut gradient), ..Outputs::new(&mut again) };
            planner.evaluate(&candidates, outputs).unwrap();
            assert!(gradient.iter().any(|slope| *slope != 0.0));
            costs
        };
        // The last state of a plan's beginning is a state on the way.
        let states = [1, 2, 3].map(|horizon| costs(Aggregate::Last, horizon));
        let (mean, best) = (costs(Aggregate::Mean, 3), costs(Aggregate::Best, 3));
        for plan in 0..5 {
            let each = [0, 1, 2].map(|step| states[step][plan]);
            let close = |found: f64, wanted: f64| (found - wanted).abs() < 1e-5 * wanted.abs();
            assert!(close(mean[plan], each.iter().sum::<f64>() / 3.0), "{name}: {} of {each:?}", mean[plan]);
            assert!(close(best[plan], each.into_iter().fold(f64::INFINITY, f64::min)), "{name}: {each:?}");
        }
    }
}
