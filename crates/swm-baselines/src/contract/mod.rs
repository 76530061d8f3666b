//! What every line of the table keeps to: it trains, resumes with the same bits, saves, says what is wrong with its input,
//! and plans or acts the same whatever else is asked. Tiny networks; another one is tested by its line in [`TINY`].

mod averages;
mod costs;
mod device;
mod precision;

use std::path::Path;

use serde_json::{Value as Json, json};
use swm_solvers::{Candidates, Outputs};

use crate::{
    BASELINES, Baseline, BaselineError, ClipBatch, DataDims, Device, Images, Losses, MakeOptions,
    Observations, PlanningBatch, Step, Vectors, make, restore,
};

const DIMS: DataDims = DataDims { action_dim: 2, proprio_dim: 0 };
const CLIPS: usize = 4;

/// Settings that differ from the preset's.
type Changes = fn() -> Json;

/// Settings that make each baseline tiny.
const TINY: &[(&str, Changes)] = &[
    ("canonical", || json!({"model": {"image": 16, "channels": [4, 4, 4], "clip": 2, "frameskip": 1}})),
    ("conv-jepa", maps),
    ("dino-wm", || {
        let encoder = json!({"kind": "vit", "dim": 8, "depth": 1, "heads": 2, "hidden": 8, "patch": 8, "positions_for": 16});
        json!({"image": 16, "encoder": encoder, "action": 2, "predictor": {"depth": 1, "heads": 2, "head_dim": 4, "hidden": 8}})
    }),
    ("gc-idm", || {
        let world = tiny("lewm").model_config().clone();
        json!({"model": {"world": {"model_config": world, "weights": ""}, "hidden": 8, "horizon": 3}})
    }),
    ("gcbc", goal),
    ("gciql", goal),
    ("gcivl", goal),
    (
        "gcsl",
        || json!({"model": {"image": 16, "encoder": {"channels": [4, 8], "count": 4}, "hidden": 8, "horizon": 3}}),
    ),
    ("hilp", goal),
    ("keypoint-wm", || {
        let encoder = json!({"channels": [4, 8], "count": 4});
        json!({"model": {"image": 16, "encoder": encoder, "hidden": 8}, "optim": {"lr": 1e-4}})
    }),
    ("keypoints", || json!({"model": {"image": 32, "encoder": {"channels": [4, 8], "count": 4}}})),
    ("lewm", joint),
    ("pldm", joint),
];

fn joint() -> Json {
    let predictor = json!({"depth": 1, "heads": 2, "head_dim": 4, "hidden": 8});
    let encoder = json!({"kind": "cnn", "channels": [4, 8]});
    json!({"model": {"image": 16, "encoder": encoder, "latent_dim": 8, "projector": 12, "predictor": predictor}})
}

fn maps() -> Json {
    let predictor = json!({"depth": 2, "channels": 8, "action": 8});
    json!({"model": {"image": 16, "channels": [4, 8], "projector": 8, "token_dim": 2, "predictor": predictor}})
}

/// Places instead of maps.
fn places() -> Json {
    let mut changes = maps();
    changes["model"]["encoder"] = json!({"kind": "keypoints", "channels": [4, 8], "count": 4});
    changes
}

fn goal() -> Json {
    let predictor = json!({"depth": 2, "heads": 2, "head_dim": 4, "hidden": 8, "dropout": 0.2});
    let encoder = json!({"kind": "cnn", "channels": [4, 8]});
    json!({"model": {"image": 16, "encoder": encoder, "history": 2, "predictor": predictor}})
}

fn options(preset: &str, changes: Json) -> MakeOptions<'_> {
    MakeOptions { changes, ..MakeOptions::new(preset, DIMS) }
}

fn tiny(name: &str) -> Box<dyn Baseline> {
    let changes = TINY.iter().find(|(of, _)| *of == name).expect("a line in TINY").1();
    make(name, &MakeOptions { seed: 3, ..options("small", changes) }).unwrap()
}

/// Made-up clips: `[CLIPS, T]` images, actions with a gap, a goal per clip.
struct Clips {
    pixels: Vec<u8>,
    goals: Vec<u8>,
    action: Vec<f32>,
    steps: usize,
    dim: usize,
}

impl Clips {
    fn of(model: &dyn Baseline) -> Self {
        let input_spec = model.input_spec();
        let (steps, dim) = (input_spec.num_steps, input_spec.frameskip * DIMS.action_dim);
        let bytes = |count: usize| (0..count).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
        let mut action: Vec<f32> = (0..CLIPS * steps * dim).map(|i| (i as f32).sin()).collect();
        *action.last_mut().unwrap() = f32::NAN;
        Self { pixels: bytes(CLIPS * steps * 768), goals: bytes(CLIPS * 768), action, steps, dim }
    }

    fn batch(&self) -> ClipBatch<'_> {
        let images =
            |values, steps| Images { values, rows: CLIPS, steps, height: 16, width: 16, channels_last: true };
        ClipBatch {
            pixels: images(&self.pixels, self.steps),
            latents: None,
            canonical: Some(images(&self.pixels, self.steps)),
            action: Vectors { values: &self.action, rows: CLIPS, steps: self.steps, dim: self.dim },
            proprio: None,
            goal_pixels: Some(images(&self.goals, 1)),
            goal_proprio: None,
        }
    }

    fn observations(&self, count: usize) -> Observations<'_> {
        let PlanningBatch { pixels, proprio, .. } = self.planning_batch(0..count);
        Observations { pixels, proprio }
    }

    fn planning_batch(&self, rows: std::ops::Range<usize>) -> PlanningBatch<'_> {
        let images = Images {
            values: &self.goals[rows.start * 768..rows.end * 768],
            rows: rows.len(),
            steps: 1,
            height: 16,
            width: 16,
            channels_last: true,
        };
        let goal = Images { values: &self.pixels[..rows.len() * 768], ..images };
        let action = Vectors { values: &[], rows: rows.len(), steps: 0, dim: self.dim };
        PlanningBatch { pixels: images, action, proprio: None, goal_pixels: goal, goal_proprio: None }
    }
}

fn step(model: &mut dyn Baseline, phase: usize, step: u64) -> Losses {
    let clips = Clips::of(model);
    model.train_step(&clips.batch(), &Step { seed: 9, phase, step, total: 10 }).unwrap()
}

fn for_each(test: impl Fn(Box<dyn Baseline>)) {
    for entry in BASELINES {
        test(tiny(entry.name));
    }
}

#[test]
fn names_and_presets_are_tested() {
    let named: Vec<&str> = TINY.iter().map(|(name, _)| *name).collect();
    assert_eq!(BASELINES.iter().map(|entry| entry.name).collect::<Vec<_>>(), named);
    for entry in BASELINES {
        let model = make(entry.name, &options("small", Json::Null)).unwrap();
        assert!((10_000..5_000_000).contains(&model.parameters()), "{}: {}", entry.name, model.parameters());
    }
}

#[test]
fn the_documentation_lists_all() {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/baselines.md");
    let page = std::fs::read_to_string(page).unwrap();
    let (_, rest) = page.split_once("<!-- baselines -->\n").unwrap();
    let (listed, _) = rest.split_once("<!-- /baselines -->").unwrap();
    let mut table = "| name | what it is | trainable parameters of `small` |\n|---|---|---|\n".to_owned();
    for entry in BASELINES {
        let millions = make(entry.name, &options("small", Json::Null)).unwrap().parameters() as f64 / 1e6;
        table += &format!("| `{}` | {} | {millions:.2} million |\n", entry.name, entry.about);
    }
    assert_eq!(listed, table, "put this into docs/baselines.md:\n{table}");
}

#[test]
fn training_gives_finite_losses() {
    for_each(|mut model| {
        let clips = Clips::of(model.as_ref());
        for phase in 0..model.phases().len() {
            let losses: Vec<f32> = (0..8).map(|index| step(model.as_mut(), phase, index).total).collect();
            assert!(losses.iter().all(|loss| loss.is_finite()), "{}: {losses:?}", model.name());
            let check = model.validate(&clips.batch(), phase).unwrap();
            assert!(check.total.is_finite());
        }
    });
}

#[test]
fn other_models_can_see_places() {
    for name in ["conv-jepa", "gcbc", "gciql", "gcivl", "hilp", "lewm", "pldm"] {
        let mut changes = TINY.iter().find(|(of, _)| *of == name).expect("a line in TINY").1();
        changes["model"]["encoder"] = json!({"kind": "keypoints", "channels": [4, 8], "count": 4});
        let mut model = make(name, &options("small", changes)).unwrap();
        for phase in 0..model.phases().len() {
            assert!((0..3).all(|index| step(model.as_mut(), phase, index).total.is_finite()), "{name}");
        }
    }
    let none = json!({"model": {"encoder": {"count": 0}}});
    let refused = make("gcsl", &options("small", none)).err().unwrap().to_string();
    assert!(refused.contains("`count` at least 1"), "{refused}");
}

#[test]
fn a_resumed_training_gives_the_bits_of_one_that_never_stopped() {
    for_each(|mut model| {
        let last = model.phases().len() - 1;
        let folder = tempfile::tempdir().unwrap();
        let [weights, training] =
            ["weights.safetensors", "training.safetensors"].map(|name| folder.path().join(name));
        (0..2).for_each(|index| drop(step(model.as_mut(), 0, index)));
        model.save_weights(&weights).unwrap();
        model.save_training(&training).unwrap();
        let mut resumed = restore(model.model_config(), Device::Cpu).unwrap();
        resumed.load_weights(&weights).unwrap();
        resumed.load_training(&training).unwrap();
        for (phase, index) in [(0, 2), (0, 3), (last, 4)] {
            let [a, b] = [model.as_mut(), resumed.as_mut()].map(|model| step(model, phase, index));
            assert_eq!(a, b, "{}", model.name());
        }
    });
}

/// The weights that a model saves.
fn weights(model: &dyn Baseline) -> std::collections::BTreeMap<String, swm_weights::Stored> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("weights.safetensors");
    model.save_weights(&path).unwrap();
    swm_weights::read(&path).unwrap()
}

#[test]
fn target_networks_are_moving_averages() {
    for name in ["gcivl", "gciql", "hilp"] {
        let mut model = tiny(name);
        let before = weights(model.as_ref());
        step(model.as_mut(), 0, 0);
        let after = weights(model.as_ref());
        let (mut targets, mut moved) = (0, 0);
        for (target, now) in after.iter().filter(|(name, _)| name.contains(".teacher.")) {
            let online = &after[&target.replace(".teacher.", ".student.")];
            targets += 1;
            for ((old, now), online) in before[target].values.iter().zip(&now.values).zip(&online.values) {
                // The small presets' momentum; before the first step target networks equal the online ones.
                let wanted = 0.95 * old + 0.05 * online;
                assert!((now - wanted).abs() < 1e-6, "{name}, {target}: {now} is not {wanted}");
                moved += usize::from(online != old);
            }
        }
        assert!(targets > 10 && moved > 100, "{name}: {targets} tensors, {moved} values");
    }
}

#[test]
fn weights_keep_the_names_that_runs_have_written() {
    let names = |name: &str| -> Vec<String> { weights(tiny(name).as_ref()).into_keys().collect() };
    assert!(names("lewm").iter().any(|name| name == "encoder.background.deviation"));
    assert!(names("gciql").iter().any(|name| name.starts_with("critic_predictor.teacher.")));
}

#[test]
fn weights_of_another_model_and_cut_files_are_refused() {
    for_each(|mut model| {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("weights.safetensors");
        let other = if ["lewm", "pldm"].contains(&model.name()) { "gcbc" } else { "lewm" };
        tiny(other).save_weights(&path).unwrap();
        let before = step(model.as_mut(), 0, 0);
        let error = model.load_weights(&path).unwrap_err();
        let BaselineError::Mismatch { missing, unused, .. } = &error else { panic!("{error}") };
        assert!(!missing.is_empty() && !unused.is_empty(), "{error}");
        model.save_weights(&path).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
        assert!(matches!(model.load_weights(&path), Err(BaselineError::Weights { .. })));
        assert!(model.load_weights(Path::new("no/such/file")).is_err());
        assert!(before.total.is_finite());
    });
}

#[test]
fn data_of_another_form_is_refused_by_name() {
    for_each(|mut model| {
        let clips = Clips::of(model.as_ref());
        let good = clips.batch();
        let narrow = Vectors { dim: 1, ..good.action };
        let oblong = Images { height: 8, width: 32, ..good.pixels };
        let short = Images { values: &good.pixels.values[1..], ..good.pixels };
        let cases = [
            ("action", ClipBatch { action: narrow, ..good }),
            ("pixels", ClipBatch { pixels: oblong, ..good }),
            ("pixels", ClipBatch { pixels: short, ..good }),
        ];
        let at = Step { seed: 9, phase: 0, step: 0, total: 10 };
        for (column, batch) in cases {
            let error = model.train_step(&batch, &at).unwrap_err();
            assert!(matches!(error, BaselineError::Data { column: found, .. } if found == column), "{error}");
        }
        if model.phases()[0].goals.is_some() {
            let error = model.train_step(&ClipBatch { goal_pixels: None, ..good }, &at).unwrap_err();
            assert!(error.to_string().contains("`goal_pixels`"), "{error}");
        }
        assert!(model.train_step(&good, &Step { phase: 7, ..at }).is_err());
    });
}

#[test]
fn plans_and_decisions_do_not_depend_on_their_neighbors() {
    for_each(|mut model| {
        let clips = Clips::of(model.as_ref());
        // Predictors that begin with zeros ask nothing of the actions until they are trained.
        (0..3).for_each(|index| drop(step(model.as_mut(), 0, index)));
        if let Some(mut policy) = model.policy() {
            let dim = policy.block_dim();
            let mut all = vec![0.0; 3 * dim];
            policy.act(&clips.planning_batch(0..3), &mut all).unwrap();
            let mut one = vec![0.0; dim];
            policy.act(&clips.planning_batch(0..1), &mut one).unwrap();
            assert_eq!(all[..dim], one, "{}", model.name());
        }
        if let Some(mut planner) = model.planner() {
            let dim = planner.block_dim();
            let plans: Vec<f32> = (0..40 * 3 * dim).map(|i| (i as f32).cos()).collect();
            let actions = [plans.clone(), plans.clone()].concat();
            let candidates = Candidates { actions: &actions, episodes: 2, samples: 40, horizon: 3, dim };
            let mut costs = vec![0.0; 80];
            planner.prepare(&clips.planning_batch(0..2)).unwrap();
            planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
            planner.prepare(&clips.planning_batch(0..1)).unwrap();
            let few = Candidates { actions: &plans[..5 * 3 * dim], episodes: 1, samples: 5, ..candidates };
            let mut some = vec![0.0; 5];
            planner.evaluate(&few, &mut Outputs::new(&mut some)).unwrap();
            assert_eq!(costs[..5], some, "{}", model.name());
            assert!(some.iter().any(|cost| *cost != some[0]), "plans make a difference: {some:?}");
            let wide = Candidates { dim: dim + 1, ..few };
            assert!(planner.evaluate(&wide, &mut Outputs::new(&mut some)).is_err());
        }
    });
}

#[test]
fn what_cannot_be_made_is_an_error_with_a_reason() {
    let error = |name, options: &MakeOptions<'_>| match make(name, options) {
        Ok(_) => panic!("{name} was made"),
        Err(error) => error.to_string(),
    };
    assert!(
        error("lewn", &options("small", Json::Null))
            .contains("did you mean `lewm`?); there are canonical, conv-jepa, dino-wm, ")
    );
    assert!(error("lewm", &options("huge", Json::Null)).contains("it has: paper, small"));
    assert!(
        error("lewm", &options("small", json!({"model": {"depth": 3}}))).contains("`model.depth`: unknown")
    );
    assert!(error("lewm", &options("small", json!({"model": {"history": 0}}))).contains("`history` is 0"));
    assert!(error("gcbc", &options("small", json!({"model": {"proprio": 10}}))).contains("`proprio` is on"));
    for (name, changes, reason) in [
        ("lewm", json!({"model": {"image": 0}}), "`image` is 0"),
        ("lewm", json!({"sigreg": {"projections": 0}}), "1 projection"),
        ("lewm", json!({"sigreg": {"knots": 1}}), "2 knots"),
        ("lewm", json!({"optim": {"lr": -1.0}}), "`optim.lr` is -1"),
        ("gcbc", json!({"optim": {"betas": [0.9, 1.0]}}), "`optim.betas` holds 1"),
        ("pldm", json!({"inverse_hidden": 0}), "some size is 0"),
        ("gciql", json!({"critic_hidden": 0}), "some size is 0"),
        ("gcivl", json!({"value": {"expectile": 2.0}}), "`value.expectile` is 2"),
        ("hilp", json!({"embed_dim": 0}), "some size is 0"),
    ] {
        let message = error(name, &options("small", changes));
        assert!(
            message.starts_with(&format!("settings of `{name}`: ")) && message.contains(reason),
            "{message}"
        );
    }
}

#[test]
fn a_frozen_encoder_keeps_its_background() {
    let std = |train_encoder: bool| {
        let mut changes = goal();
        changes["model"]["train_encoder"] = train_encoder.into();
        let mut model = make("gcbc", &options("small", changes)).unwrap();
        step(model.as_mut(), 0, 0);
        weights(model.as_ref())["encoder.background.deviation"].values[0]
    };
    assert_eq!(std(false), 1.0);
    assert_ne!(std(true), 1.0);
}

#[test]
fn a_frozen_encoder_is_known() {
    let frozen = |name, changes| make(name, &options("small", changes)).unwrap().has_frozen_encoder();
    assert!(frozen("dino-wm", Json::Null) && frozen("gcbc", json!({"model": {"train_encoder": false}})));
    assert!(!frozen("lewm", Json::Null) && !frozen("gcbc", Json::Null));
}
