//! GCSL on a dot that moves at a constant pace: its loss is that of what it does, and it learns what the decisions left mean.

use rand::RngExt as _;
use serde_json::{Value as Json, json};
use swm_core::seed::keyed;

use crate::models::dots::{CLIPS, SIDE, clips, image, images, of_step};
use crate::{
    Baseline, BaselineError, ClipBatch, DataDims, GoalPolicy, MakeOptions, PlanningBatch, Step, Vectors, make,
};

const HORIZON: usize = 3;
const FRAMES: usize = HORIZON + 1;

/// Clips of a dot of 3 × 3 pixels, which moves by the same -2 to 2 pixels along each axis in each step.
struct Dots {
    pixels: Vec<u8>,
    paces: Vec<f32>,
}

impl Dots {
    fn new(seed: u64) -> Self {
        let mut stream = keyed(seed, "test dots", [0, 0]);
        let (mut pixels, mut paces) = (Vec::new(), Vec::new());
        for _ in 0..CLIPS {
            let pace: [i32; 2] = [(); 2].map(|()| stream.random_range(-2..=2));
            // Far enough from the edge to go there.
            let start = pace.map(|pace| 7 - 3 * pace.signum() + stream.random_range(-1..=1));
            for step in 0..FRAMES as i32 {
                pixels.extend(image([0, 1].map(|axis| start[axis] + step * pace[axis])));
                paces.extend(pace.map(|pace| pace as f32));
            }
        }
        Self { pixels, paces }
    }

    fn batch(&self) -> ClipBatch<'_> {
        clips(&self.pixels, &self.paces, FRAMES)
    }

    /// The images of one step of all clips.
    fn step(&self, step: usize) -> Vec<u8> {
        of_step(&self.pixels, FRAMES, step)
    }

    /// The mean squared error of what a policy does in step `from`, for the goal of step `to`, told that `left` decisions are left.
    fn error(&self, policy: &mut dyn GoalPolicy, from: usize, to: usize, left: usize) -> f32 {
        let (now, goal) = (self.step(from), self.step(to));
        let batch = PlanningBatch {
            pixels: images(&now, 1),
            action: Vectors { values: &[], rows: CLIPS, steps: 0, dim: 2 },
            proprio: None,
            goal_pixels: images(&goal, 1),
            goal_proprio: None,
        };
        let mut actions = vec![0.0; CLIPS * 2];
        policy.act_within(&batch, &[left; CLIPS], &mut actions).unwrap();
        let wanted = self.paces.chunks(FRAMES * 2).flat_map(|clip| &clip[from * 2..][..2]);
        let squared = actions.iter().zip(wanted).map(|(found, wanted)| (found - wanted).powi(2));
        squared.sum::<f32>() / actions.len() as f32
    }
}

fn tiny() -> Box<dyn Baseline> {
    tiny_with(SIDE, &json!({"kind": "cnn", "channels": [8, 16]}), 0.0).unwrap()
}

fn tiny_with(image: usize, encoder: &Json, drawing: f64) -> Result<Box<dyn Baseline>, BaselineError> {
    let model = json!({"image": image, "encoder": encoder, "hidden": 32, "depth": 2, "horizon": HORIZON, "frameskip": 1});
    let optim = json!({"lr": 0.003, "schedule": "constant", "ema": 0.9});
    let dims = DataDims { action_dim: 2, proprio_dim: 0 };
    let changes = json!({"model": model, "weights": {"drawing": drawing}, "optim": optim});
    make("gcsl", &MakeOptions { changes, seed: 1, ..MakeOptions::new("small", dims) })
}

fn train(model: &mut dyn Baseline, steps: u64) {
    for step in 0..steps {
        let dots = Dots::new(step);
        model.train_step(&dots.batch(), &Step { seed: 2, phase: 0, step, total: steps }).unwrap();
    }
}

#[test]
fn the_loss_is_the_error_of_decisions_averaged_over_what_is_left() {
    let mut model = tiny();
    assert_eq!(model.input_spec().num_steps, FRAMES);
    train(model.as_mut(), 3);
    let dots = Dots::new(1000);
    let mut policy = model.policy().unwrap();
    assert_eq!(policy.horizon(), HORIZON);
    let of_left = |left: usize| {
        let frames = FRAMES - left;
        let errors = (0..frames).map(|from| dots.error(policy.as_mut(), from, from + left, left));
        errors.sum::<f32>() / frames as f32
    };
    let errors = [1, 2, 3].map(of_left);
    let losses = model.validate(&dots.batch(), 0).unwrap();
    let near = |found: f32, wanted: f32| (found - wanted).abs() < 1e-5 * wanted;
    assert!(near(losses.total, errors.iter().sum::<f32>() / 3.0), "{losses:?} and {errors:?}");
    let part = |name: &str| losses.parts.iter().find(|(part, _)| *part == name).expect("a part").1;
    assert!(near(part("near"), errors[0]) && near(part("far"), errors[2]), "{losses:?} and {errors:?}");
}

#[test]
fn it_learns_what_the_decisions_left_mean() {
    let mut model = tiny();
    train(model.as_mut(), 300);
    let mut policy = model.policy().unwrap();
    let dots = Dots::new(1000);
    // Paces have a variance of 2.
    for left in 1..=HORIZON {
        let error = dots.error(policy.as_mut(), 0, left, left);
        assert!(error < 0.3, "{left} left: {error}");
    }
    // Half the pace is wanted of one that believes to have twice the time.
    let [right, misled] = [1, 2].map(|left| dots.error(policy.as_mut(), 0, 1, left));
    assert!(misled > 0.25 && misled > 3.0 * right, "{right}, and {misled} where it is misled");
}

#[test]
fn places_are_where_drawings_need_them() {
    let keypoints = json!({"kind": "keypoints", "channels": [8], "count": 4});
    let mut model = tiny_with(32, &keypoints, 0.5).unwrap();
    train(model.as_mut(), 150);
    let losses = model.validate(&Dots::new(1000).batch(), 0).unwrap();
    let part = |name: &str| losses.parts.iter().find(|(part, _)| *part == name).expect("a part").1;
    let (actions, drawing) = (part("actions"), part("drawing"));
    assert!((losses.total - actions - 0.5 * drawing).abs() < 1e-5, "{losses:?}");
    // A dot covers 3 % of an image, and its places tell where.
    assert!(drawing < 0.6, "{losses:?}");

    for (image, encoder, weight, name) in [
        (48, &keypoints, 1.0, "`model.image` is 48"),
        (32, &keypoints, -1.0, "`weights.drawing` is -1"),
        (32, &json!({"kind": "cnn", "channels": [8, 16]}), 1.0, "take `keypoints`"),
    ] {
        let refused = tiny_with(image, encoder, weight).err().expect("a refusal").to_string();
        assert!(refused.contains(name), "{refused}");
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let mut model = tiny();
    train(model.as_mut(), 1);
    let dots = Dots::new(1);
    let now = dots.step(0);
    let batch = PlanningBatch {
        pixels: images(&now, 1),
        action: Vectors { values: &[], rows: CLIPS, steps: 0, dim: 2 },
        proprio: None,
        goal_pixels: images(&now, 1),
        goal_proprio: None,
    };
    let mut policy = model.policy().unwrap();
    let mut actions = vec![0.0; CLIPS * 2];
    let error = policy.act_within(&batch, &[1], &mut actions).unwrap_err();
    assert!(matches!(error, BaselineError::Data { column: "pixels", .. }), "{error}");
    let dims = DataDims { action_dim: 2, proprio_dim: 0 };
    let changes = json!({"model": {"horizon": 0}});
    let refused = make("gcsl", &MakeOptions { changes, ..MakeOptions::new("small", dims) }).err().unwrap();
    assert!(refused.to_string().contains("`model.horizon` is 0"), "{refused}");
}
