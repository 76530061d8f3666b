//! Conv-JEPA on a dot that actions move: it learns to predict and to plan, and its maps neither vanish nor shrink.

use serde_json::{Value as Json, json};
use swm_core::seed::keyed;
use swm_solvers::{Candidates, Outputs};

use rand::RngExt as _;

use crate::models::dots::{CLIPS, SIDE, clips, image, images, of_step};
use crate::{Baseline, ClipBatch, DataDims, MakeOptions, Observations, PlanningBatch, Step, Vectors, make};

/// Where a dot goes: `CLIPS` clips of `steps` images, and the moves between them.
struct Dots {
    pixels: Vec<u8>,
    moves: Vec<f32>,
    steps: usize,
}

impl Dots {
    fn new(seed: u64, steps: usize) -> Self {
        let mut stream = keyed(seed, "test dots", [0, 0]);
        let (mut pixels, mut moves) = (Vec::new(), Vec::new());
        for _ in 0..CLIPS {
            let mut at: [i32; 2] = [(); 2].map(|()| stream.random_range(2..14));
            for _ in 0..steps {
                pixels.extend(image(at));
                let to: [i32; 2] = at.map(|from| (from + stream.random_range(-3..=3)).clamp(2, 13));
                moves.extend(to.iter().zip(at).map(|(to, from)| (to - from) as f32 / 2.0));
                at = to;
            }
        }
        Self { pixels, moves, steps }
    }

    fn batch(&self) -> ClipBatch<'_> {
        clips(&self.pixels, &self.moves, self.steps)
    }

    /// The images of one step of all clips.
    fn step(&self, step: usize) -> Vec<u8> {
        of_step(&self.pixels, self.steps, step)
    }
}

/// Trained for so many steps, with settings that differ from the tiny ones.
fn trained(steps: u64, sigreg: &Json) -> Box<dyn Baseline> {
    trained_with(steps, &json!({ "sigreg": sigreg }))
}

/// Trained on places that it finds, of which SIGReg asks nothing.
fn trained_on_places(steps: u64, drawing: f64) -> Box<dyn Baseline> {
    let encoder = json!({ "kind": "keypoints", "channels": [8], "count": 4 });
    let model = json!({ "image": 32, "encoder": encoder });
    trained_with(
        steps,
        &json!({ "model": model, "sigreg": { "weight": 0.0 }, "weights": { "drawing": drawing } }),
    )
}

fn trained_with(steps: u64, changes: &Json) -> Box<dyn Baseline> {
    let predictor = json!({ "depth": 2, "channels": 16, "action": 16 });
    let mut all = json!({
        "model": { "image": SIDE, "channels": [16], "projector": 32, "token_dim": 4, "predictor": predictor, "frameskip": 1 },
        "optim": { "lr": 3e-3 },
    });
    for (group, settings) in changes.as_object().unwrap() {
        for (name, value) in settings.as_object().unwrap() {
            all[group][name] = value.clone();
        }
    }
    let dims = DataDims { action_dim: 2, proprio_dim: 0 };
    let options = MakeOptions { changes: all, seed: 1, ..MakeOptions::new("small", dims) };
    let mut model = make(super::NAME, &options).unwrap();
    for step in 0..steps {
        let dots = Dots::new(step, model.input_spec().num_steps);
        model.train_step(&dots.batch(), &Step { seed: 1, phase: 0, step, total: steps }).unwrap();
    }
    model
}

/// The mean variance of the values of a map, over images that were not learned from.
fn variance(model: &dyn Baseline) -> f64 {
    let mut planner = model.planner().unwrap();
    let dim = planner.latent_dim();
    let dots = Dots::new(1_000_000, 1);
    let mut maps = vec![0.0; CLIPS * dim];
    planner.encode(&Observations { pixels: images(&dots.pixels, 1), proprio: None }, &mut maps).unwrap();
    let moment =
        |at: usize, power| maps.iter().skip(at).step_by(dim).map(|v| f64::from(*v).powi(power)).sum::<f64>();
    let count = CLIPS as f64;
    (0..dim).map(|at| moment(at, 2) / count - (moment(at, 1) / count).powi(2)).sum::<f64>() / dim as f64
}

#[test]
fn a_short_training_tells_the_true_plan_from_others() {
    let model = trained(250, &json!({ "projections": 64 }));
    let found = plans_told(model.as_ref());
    // By chance 4 of 32.
    assert!(found >= 16, "{found} of {CLIPS}");
}

#[test]
fn drawings_keep_places_apart_which_tell_the_true_plan_from_others() {
    let model = trained_on_places(250, 1.0);
    let found = plans_told(model.as_ref());
    assert!(found >= 16, "{found} of {CLIPS}");
    let [kept, shrunk] = [variance(model.as_ref()), variance(trained_on_places(250, 0.0).as_ref())];
    assert!(kept > 0.02 && shrunk < 0.1 * kept, "{kept} and without drawings {shrunk}");
}

/// Of how many clips the true plan costs less than those of seven others.
fn plans_told(model: &dyn Baseline) -> usize {
    let mut planner = model.planner().unwrap();
    let (horizon, samples) = (3, 8);
    let dots = Dots::new(1_000_001, horizon + 1);
    let (start, goal) = (dots.step(0), dots.step(horizon));
    let none = Vectors { values: &[], rows: CLIPS, steps: 0, dim: 2 };
    let (pixels, goal_pixels) = (images(&start, 1), images(&goal, 1));
    planner
        .prepare(&PlanningBatch { pixels, action: none, proprio: None, goal_pixels, goal_proprio: None })
        .unwrap();
    // The first candidate is what happened; the others are what happened in other clips.
    let plan = |clip: usize| &dots.moves[clip % CLIPS * (horizon + 1) * 2..][..horizon * 2];
    let others = |clip: usize| (0..samples).flat_map(move |other| plan(clip + other));
    let actions: Vec<f32> = (0..CLIPS).flat_map(others).copied().collect();
    let candidates = Candidates { actions: &actions, episodes: CLIPS, samples, horizon, dim: 2 };
    let mut costs = vec![0.0; CLIPS * samples];
    planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
    let is_least = |costs: &&[f64]| costs[1..].iter().all(|other| costs[0] < *other);
    costs.chunks(samples).filter(is_least).count()
}

#[test]
fn settings_that_were_written_without_an_encoder_are_those_of_maps() {
    let mut written = serde_json::to_value(crate::ConvJepaConfig::small()).unwrap();
    written["model"].as_object_mut().unwrap().remove("encoder");
    written["weights"].as_object_mut().unwrap().remove("drawing");
    let read: crate::ConvJepaConfig = serde_json::from_value(written).unwrap();
    assert_eq!(read, crate::ConvJepaConfig::small());
}

#[test]
fn sigreg_on_what_is_predicted_keeps_maps_from_shrinking() {
    let kept = variance(trained(120, &json!({ "projections": 64 })).as_ref());
    let shrunk = variance(trained(120, &json!({ "projections": 64, "weight": 0.0 })).as_ref());
    assert!((0.3..3.0).contains(&kept) && shrunk < 0.1 * kept, "{kept} and without it {shrunk}");
}
