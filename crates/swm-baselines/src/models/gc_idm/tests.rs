//! GC-IDM over latents of bodies that move at a constant pace, and over images that a tiny LeWM encodes.

use rand::RngExt as _;
use serde_json::{Value as Json, json};
use swm_core::seed::keyed;

use crate::data::{ClipBatch, Images, Observations, PlanningBatch, Vectors};
use crate::{Baseline, BaselineError, DataDims, Device, MakeOptions, Step, make, restore};

const HORIZON: usize = 3;
const FRAMES: usize = HORIZON + 1;
const CLIPS: usize = 64;
/// Values of a latent.
const DIM: usize = 8;
const SIDE: usize = 16;

/// Clips of latents whose first two values are a place, which moves by the same pace in each step; the others are constant.
struct Paces {
    latents: Vec<f32>,
    paces: Vec<f32>,
}

impl Paces {
    fn new(seed: u64) -> Self {
        let mut stream = keyed(seed, "test paces", [0, 0]);
        let (mut latents, mut paces) = (Vec::new(), Vec::new());
        for _ in 0..CLIPS {
            let mut sample = || [(); 2].map(|()| stream.random_range(-1.0_f32..1.0));
            let (start, pace) = (sample(), sample());
            for step in 0..FRAMES {
                let place = [0, 1].map(|axis| 5.0 + 3.0 * (start[axis] + step as f32 * pace[axis]));
                latents.extend(place);
                latents.extend([1.0; DIM - 2]);
                paces.extend(pace);
            }
        }
        Self { latents, paces }
    }

    fn batch(&self) -> ClipBatch<'_> {
        let (rows, steps) = (CLIPS, FRAMES);
        ClipBatch {
            pixels: Images { values: &[], rows, steps, height: 0, width: 0, channels_last: false },
            latents: Some(Vectors { values: &self.latents, rows, steps, dim: DIM }),
            canonical: None,
            action: Vectors { values: &self.paces, rows, steps, dim: 2 },
            proprio: None,
            goal_pixels: None,
            goal_proprio: None,
        }
    }

    /// The latents of one step of all clips.
    fn step(&self, step: usize) -> Vec<f32> {
        self.latents.chunks(FRAMES * DIM).flat_map(|clip| clip[step * DIM..][..DIM].to_vec()).collect()
    }
}

/// A tiny LeWM in blocks of `frameskip` actions of `dims`.
fn world(frameskip: usize, dims: DataDims) -> Box<dyn Baseline> {
    let predictor = json!({ "depth": 1, "heads": 2, "head_dim": 4, "hidden": 8 });
    let encoder = json!({ "kind": "cnn", "channels": [4, 8] });
    let model = json!({ "image": SIDE, "encoder": encoder, "latent_dim": DIM, "projector": 12, "predictor": predictor,
        "frameskip": frameskip });
    make(
        "lewm",
        &MakeOptions { changes: json!({ "model": model }), seed: 5, ..MakeOptions::new("small", dims) },
    )
    .unwrap()
}

const DIMS: DataDims = DataDims { action_dim: 2, proprio_dim: 0 };

fn over(world: &dyn Baseline, model: &Json, dims: DataDims) -> Result<Box<dyn Baseline>, BaselineError> {
    let mut model = model.clone();
    model["world"] = json!({ "model_config": world.model_config(), "weights": "abc" });
    model["hidden"] = json!(32);
    model["horizon"] = json!(HORIZON);
    let optim = json!({ "lr": 0.003, "schedule": "constant", "ema": 0.9 });
    let changes = json!({ "model": model, "optim": optim });
    make("gc-idm", &MakeOptions { changes, seed: 1, ..MakeOptions::new("small", dims) })
}

fn train(model: &mut dyn Baseline, steps: u64) -> Vec<f32> {
    let each = |step| {
        let at = Step { seed: 2, phase: 0, step, total: steps };
        model.train_step(&Paces::new(step).batch(), &at).unwrap().total
    };
    (0..steps).map(each).collect()
}

#[test]
fn it_learns_to_divide_the_way_by_the_decisions_that_are_left() {
    let mut model = over(world(1, DIMS).as_ref(), &json!({}), DIMS).unwrap();
    let losses = train(model.as_mut(), 400);
    let mean = |losses: &[f32]| losses.iter().sum::<f32>() / losses.len() as f32;
    let [first, last] = [mean(&losses[..10]), mean(&losses[390..])];
    assert!(last < 0.05 * first, "{first} to {last}");
    let mut policy = model.latent_policy().unwrap();
    assert_eq!((policy.latent_dim(), policy.block_dim(), policy.horizon()), (DIM, 2, HORIZON));
    let fresh = Paces::new(1000);
    let (from, to) = (fresh.step(0), fresh.step(2));
    let mut act = |left: usize| {
        let mut actions = vec![0.0; CLIPS * 2];
        policy.act(&from, &to, &[left; CLIPS], &mut actions).unwrap();
        actions
    };
    let wanted: Vec<f32> = fresh.paces.chunks(FRAMES * 2).flat_map(|clip| clip[..2].to_vec()).collect();
    let apart = |actions: &[f32], factor: f32| {
        let squares = actions.iter().zip(&wanted).map(|(found, wanted)| (found - factor * wanted).powi(2));
        squares.sum::<f32>() / wanted.len() as f32
    };
    // A third of the way in each of three decisions, half of it in two.
    let (two, three) = (act(2), act(3));
    assert!(apart(&two, 1.0) < 0.02, "{}", apart(&two, 1.0));
    assert!(apart(&three, 2.0 / 3.0) < 0.02, "{}", apart(&three, 2.0 / 3.0));
    assert!(apart(&two, 2.0 / 3.0) > 0.03);
    let mut short = vec![0.0; 3];
    let refused = policy.act(&from, &to, &[1; CLIPS], &mut short).unwrap_err().to_string();
    assert!(refused.contains("room for 3"), "{refused}");
}

#[test]
fn images_of_a_batch_give_the_loss_of_their_latents() {
    let model = over(world(2, DIMS).as_ref(), &json!({}), DIMS).unwrap();
    assert_eq!((model.input_spec().frameskip, model.input_spec().image), (2, SIDE));
    assert!(model.trains_on_latents() && model.has_frozen_encoder() && model.planner().is_none());
    let (rows, steps) = (3, FRAMES);
    let values: Vec<u8> = (0..rows * steps * SIDE * SIDE * 3).map(|at| (at * 7919 % 251) as u8).collect();
    let pixels = Images { values: &values, rows, steps, height: SIDE, width: SIDE, channels_last: true };
    let actions: Vec<f32> = (0..rows * steps * 4).map(|at| (at as f32).sin()).collect();
    let action = Vectors { values: &actions, rows, steps, dim: 4 };
    let batch = ClipBatch {
        pixels,
        latents: None,
        canonical: None,
        action,
        proprio: None,
        goal_pixels: None,
        goal_proprio: None,
    };
    let mut latents = vec![0.0; rows * steps * DIM];
    let seen = Observations { pixels: Images { rows: rows * steps, steps: 1, ..pixels }, proprio: None };
    model.latent_encoder().unwrap().encode(&seen, &mut latents).unwrap();
    let encoded = ClipBatch { latents: Some(Vectors { values: &latents, rows, steps, dim: DIM }), ..batch };
    assert_eq!(model.validate(&batch, 0).unwrap(), model.validate(&encoded, 0).unwrap());
}

#[test]
fn a_run_has_the_weights_of_its_world_model() {
    let world = world(1, DIMS);
    let folder = tempfile::tempdir().unwrap();
    let [of_world, all] = ["world.safetensors", "all.safetensors"].map(|name| folder.path().join(name));
    world.save_weights(&of_world).unwrap();
    let mut model = over(world.as_ref(), &json!({}), DIMS).unwrap();
    model.load_encoder(&of_world).unwrap();
    train(model.as_mut(), 3);
    model.save_weights(&all).unwrap();
    // Training leaves them alone.
    let stored = swm_weights::read(&all).unwrap();
    for (name, tensor) in swm_weights::read(&of_world).unwrap() {
        assert_eq!(stored[&format!("world.{name}")], tensor, "{name}");
    }
    assert_eq!(stored.len(), model.tensors().len());
    let mut again = restore(model.model_config(), Device::Cpu).unwrap();
    again.load_weights(&all).unwrap();
    let image: Vec<u8> = (0..SIDE * SIDE * 3).map(|at| (at % 255) as u8).collect();
    let goal: Vec<u8> = image.iter().map(|value| 255 - value).collect();
    let images =
        |values| Images { values, rows: 1, steps: 1, height: SIDE, width: SIDE, channels_last: true };
    let batch = PlanningBatch {
        pixels: images(&image),
        action: Vectors { values: &[], rows: 1, steps: 0, dim: 2 },
        proprio: None,
        goal_pixels: images(&goal),
        goal_proprio: None,
    };
    let act = |model: &dyn Baseline| {
        let mut actions = vec![0.0; 2];
        model.policy().unwrap().act_within(&batch, &[2], &mut actions).unwrap();
        actions
    };
    assert_eq!(act(model.as_ref()), act(again.as_ref()));
    // A file without them is none of its own.
    let refused = again.load_weights(&of_world).unwrap_err();
    assert!(matches!(refused, BaselineError::Mismatch { .. }), "{refused}");
}

#[test]
fn what_is_no_world_model_of_the_data_is_refused() {
    let refused = |world: &dyn Baseline, dims| over(world, &json!({}), dims).err().unwrap().to_string();
    let wide = DataDims { action_dim: 3, ..DIMS };
    let message = refused(world(1, DIMS).as_ref(), wide);
    assert!(message.contains("have 2 values, and those of the data 3"), "{message}");
    let policy = make("gcbc", &MakeOptions::new("small", DIMS)).unwrap();
    let message = refused(policy.as_ref(), DIMS);
    assert!(message.contains("gcbc is no world model"), "{message}");
    let message = make(
        "gc-idm",
        &MakeOptions { changes: json!({ "model": { "horizon": 0 } }), ..MakeOptions::new("small", DIMS) },
    );
    assert!(message.err().unwrap().to_string().contains("`model.horizon` is 0"));
}
