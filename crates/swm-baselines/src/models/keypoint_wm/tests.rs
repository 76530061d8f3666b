//! The model on dots that a made-up encoder sees: what its loss is, and what its planner tells apart.

use rand::RngExt as _;
use serde_json::json;
use swm_core::seed::keyed;
use swm_solvers::{Candidates, Outputs};

use crate::models::dots::{CLIPS, SIDE, clips, image, images, of_step};
use crate::{Baseline, ClipBatch, DataDims, MakeOptions, Observations, PlanningBatch, Step, Vectors, make};

const STEPS: usize = 4;
const AT: Step = Step { seed: 1, phase: 0, step: 0, total: 300 };

/// Clips of a dot that moves by the mean of the last two actions.
struct Dots {
    pixels: Vec<u8>,
    actions: Vec<f32>,
}

impl Dots {
    fn new(seed: u64) -> Self {
        let mut stream = keyed(seed, "test dots", [0, 0]);
        let (mut pixels, mut actions) = (Vec::new(), Vec::new());
        for _ in 0..CLIPS {
            let mut at: [i32; 2] = [(); 2].map(|()| stream.random_range(6..=9));
            let mut before = [0, 0];
            for _ in 0..STEPS {
                let action = [(); 2].map(|()| 2 * stream.random_range(-1..=1));
                pixels.extend(image(at));
                actions.extend(action.map(|action| action as f32));
                at = [0, 1].map(|axis| at[axis] + (before[axis] + action[axis]) / 2);
                before = action;
            }
        }
        Self { pixels, actions }
    }

    fn batch(&self) -> ClipBatch<'_> {
        clips(&self.pixels, &self.actions, STEPS)
    }

    /// `[CLIPS, STEPS, Z]`.
    fn latents(&self, model: &dyn Baseline) -> Vec<f32> {
        let mut planner = model.planner().unwrap();
        let mut of_steps = Vec::new();
        for step in 0..STEPS {
            let pixels = of_step(&self.pixels, STEPS, step);
            let mut latents = vec![0.0; CLIPS * planner.latent_dim()];
            planner
                .encode(&Observations { pixels: images(&pixels, 1), proprio: None }, &mut latents)
                .unwrap();
            of_steps.push(latents);
        }
        let dim = planner.latent_dim();
        let of_clip = |clip: usize| of_steps.iter().flat_map(move |of_step| &of_step[clip * dim..][..dim]);
        (0..CLIPS).flat_map(of_clip).copied().collect()
    }
}

fn tiny() -> Box<dyn Baseline> {
    tiny_with(false)
}

fn tiny_with(velocity: bool) -> Box<dyn Baseline> {
    let encoder = json!({"channels": [4, 8], "count": 4});
    let model = json!({
        "image": SIDE, "encoder": encoder, "hidden": 32, "depth": 2, "velocity": velocity, "rollout_steps": STEPS - 2
    });
    let changes = json!({"model": model, "optim": {"lr": 0.003, "schedule": "constant"}});
    let dims = DataDims { action_dim: 2, proprio_dim: 0 };
    make("keypoint-wm", &MakeOptions { changes, seed: 1, ..MakeOptions::new("small", dims) }).unwrap()
}

#[test]
fn latents_stand_for_images() {
    let dots = Dots::new(1);
    let [mut seeing, mut told] = [(); 2].map(|()| tiny());
    assert!(seeing.trains_on_latents() && seeing.has_frozen_encoder());
    let latents = dots.latents(told.as_ref());
    let dim = latents.len() / CLIPS / STEPS;
    let none = crate::Images { values: &[], height: 0, width: 0, ..dots.batch().pixels };
    let latents = Vectors { values: &latents, rows: CLIPS, steps: STEPS, dim };
    let batch = ClipBatch { pixels: none, latents: Some(latents), ..dots.batch() };
    for step in 0..5 {
        let at = Step { step, ..AT };
        let [seen, known] = [
            seeing.train_step(&dots.batch(), &at).unwrap().total,
            told.train_step(&batch, &at).unwrap().total,
        ];
        assert!((seen - known).abs() < 1e-4 * seen, "{seen} {known}");
    }
    assert!(told.train_step(&ClipBatch { pixels: none, ..dots.batch() }, &AT).is_err(), "neither");
}

#[test]
fn the_loss_is_the_share_of_change_that_is_not_predicted() {
    let mut dots = Dots::new(2);
    // What a planner predicts by itself follows no action.
    dots.actions.chunks_exact_mut(STEPS * 2).for_each(|clip| clip[..2].fill(0.0));
    let mut model = tiny();
    // The first step finds the statistics of its batch.
    model.train_step(&dots.batch(), &AT).unwrap();
    let latents = dots.latents(model.as_ref());
    let dim = latents.len() / CLIPS / STEPS;
    let latent = |clip: usize, step: usize| &latents[(clip * STEPS + step) * dim..][..dim];
    let apart = |found: &[f32], from: &[f32]| -> Vec<f64> {
        found.iter().zip(from).map(|(found, from)| f64::from(found - from)).collect()
    };
    let steps = (0..CLIPS).flat_map(|clip| (1..STEPS).map(move |step| (clip, step)));
    let changes: Vec<_> =
        steps.map(|(clip, step)| apart(latent(clip, step), latent(clip, step - 1))).collect();
    let mean = |values: &mut dyn Iterator<Item = f64>| values.sum::<f64>() / changes.len() as f64;
    let square_of_std = |at: usize| {
        let middle = mean(&mut changes.iter().map(|change| change[at]));
        (mean(&mut changes.iter().map(|change| (change[at] - middle).powi(2))).sqrt() + 1e-4).powi(2)
    };
    let unit = (0..dim).map(square_of_std).sum::<f64>() / dim as f64;
    let mut planner = model.planner().unwrap();
    let mut error = 0.0;
    for clip in 0..CLIPS {
        let mut next = latent(clip, 1).to_vec();
        planner.predict(&mut next, &dots.actions[(clip * STEPS + 1) * 2..][..2]).unwrap();
        error += apart(&next, latent(clip, 2)).iter().map(|apart| apart.powi(2)).sum::<f64>();
    }
    let wanted = error / (CLIPS * dim) as f64 / unit;
    let parts = model.validate(&dots.batch(), 0).unwrap().parts;
    let found = parts.iter().find(|(name, _)| *name == "first").map_or(0.0, |&(_, value)| f64::from(value));
    assert!((found - wanted).abs() < 1e-3 * wanted, "{found}, not {wanted}");
}

#[test]
fn a_planner_knows_the_last_action_and_what_is_nearer_to_the_goal() {
    let mut model = tiny();
    let losses: Vec<f32> = (0..300)
        .map(|step| {
            let batch = Dots::new(step);
            model.train_step(&batch.batch(), &Step { step, ..AT }).unwrap().total
        })
        .collect();
    assert!(losses[299] < 0.5 * losses[0], "{} to {}", losses[0], losses[299]);
    let mut planner = model.planner().unwrap();
    assert_eq!(planner.history(), 2);
    let (still, right) = ([image([7, 7]), image([7, 7])].concat(), image([11, 7]));
    let one = |values, steps| crate::Images { rows: 1, ..images(values, steps) };
    // To the right four times, to the left four times.
    let plans: Vec<f32> = [[2.0, 0.0]; 4].into_iter().chain([[-2.0, 0.0]; 4]).flatten().collect();
    let mut costs_after = |before: [f32; 2]| {
        let batch = PlanningBatch {
            pixels: one(&still, 2),
            action: Vectors { values: &before, rows: 1, steps: 1, dim: 2 },
            proprio: None,
            goal_pixels: one(&right, 1),
            goal_proprio: None,
        };
        planner.prepare(&batch).unwrap();
        let mut costs = [0.0; 2];
        let candidates = Candidates { actions: &plans, episodes: 1, samples: 2, horizon: 4, dim: 2 };
        planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
        costs
    };
    let [nearer, farther] = costs_after([0.0, 0.0]);
    assert!(nearer < farther, "{nearer} {farther}");
    assert_ne!(costs_after([2.0, 0.0])[0], nearer, "what was done last moves it, too");
}

#[test]
fn what_keeps_moving_is_predicted_from_its_last_change_alone() {
    /// Clips of dots that keep their velocity, whatever is done.
    fn drifting(seed: u64) -> Dots {
        let mut stream = keyed(seed, "drifting dots", [0, 0]);
        let (mut pixels, mut actions) = (Vec::new(), Vec::new());
        for _ in 0..CLIPS {
            let [mut at, velocity] =
                [6..=9, -1..=1].map(|range| [(); 2].map(|()| stream.random_range(range.clone())));
            for _ in 0..STEPS {
                pixels.extend(image(at));
                actions.extend([0.0; 2]);
                at = [0, 1].map(|axis| at[axis] + velocity[axis]);
            }
        }
        Dots { pixels, actions }
    }
    let [unseen, seen] = [false, true].map(|velocity| {
        let mut model = tiny_with(velocity);
        for step in 0..300 {
            model.train_step(&drifting(step).batch(), &Step { step, ..AT }).unwrap();
        }
        model.validate(&drifting(1000).batch(), 0).unwrap().total
    });
    assert!(seen < 0.8 * unseen, "{seen} with the last change, {unseen} without");

    // A planner sees it, too: with zeros where there is no earlier image.
    let mut planner = tiny_with(true).planner().unwrap();
    let (middle, right) = (image([7, 7]), image([8, 7]));
    let mut cost_after = |images_seen: &[Vec<u8>]| {
        let pixels = images_seen.concat();
        let steps = images_seen.len();
        let one = |values, steps| crate::Images { rows: 1, ..images(values, steps) };
        let none = vec![0.0; 2 * (steps - 1)];
        let batch = PlanningBatch {
            pixels: one(&pixels, steps),
            action: Vectors { values: &none, rows: 1, steps: steps - 1, dim: 2 },
            proprio: None,
            goal_pixels: one(&right, 1),
            goal_proprio: None,
        };
        planner.prepare(&batch).unwrap();
        let mut cost = [0.0];
        let candidates = Candidates { actions: &[0.0; 4], episodes: 1, samples: 1, horizon: 2, dim: 2 };
        planner.evaluate(&candidates, &mut Outputs::new(&mut cost)).unwrap();
        cost[0]
    };
    let resting = cost_after(&[middle.clone(), middle.clone()]);
    assert_eq!(cost_after(std::slice::from_ref(&middle)), resting);
    assert_ne!(cost_after(&[right.clone(), middle.clone()]), resting);
}
