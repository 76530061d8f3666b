//! Checkpoints that the reference wrote, compared with what it computes with them; and files that are refused.
//!
//! `tests/golden/checkpoints` holds some; SWM_CHECKPOINTS may name a folder with more, of the same form.

mod forms;
mod refused;

use std::path::{Path, PathBuf};

use serde_json::{Map, Value as Json, json};
use swm_baselines::online::{OnlineConfig, TrainedAgent};
use swm_baselines::testing::tdmpc2_values;
use swm_baselines::train::{RunFolder, TrainedModel, Training, Which};
use swm_baselines::{Device, Images, Observations, PlanningBatch, Vectors};
use swm_solvers::{Candidates, Outputs};
use swm_tasks::request::Request as _;
use swm_weights::Stored;

use super::Import;
use crate::plane::{PLANE, registry};

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/checkpoints")
}

/// Folders with expected values.
fn cases() -> Vec<PathBuf> {
    let more = std::env::var_os("SWM_CHECKPOINTS").map(PathBuf::from);
    let roots = [Some(golden()), more].into_iter().flatten();
    let folders = roots.flat_map(|root| std::fs::read_dir(root).unwrap().map(|entry| entry.unwrap().path()));
    let mut folders: Vec<PathBuf> =
        folders.filter(|folder| folder.join("expected.safetensors").is_file()).collect();
    folders.sort();
    folders
}

/// A request for a file, with the scales of vectors that are scaled already.
fn request(from: &Path, kind: Option<&str>) -> Import {
    let set = match kind {
        Some("dino-wm") => json!({ "encoder.heads": 3, "predictor.heads": 2 }),
        Some("gciql" | "gcivl" | "hilp") => json!({ "model.encoder.heads": 3 }),
        _ => json!({}),
    };
    let Json::Object(set) = set else { unreachable!("an object") };
    Import {
        from: from.display().to_string(),
        kind: kind.filter(|kind| *kind != "dino-wm").map(str::to_owned),
        env: Some(PLANE.id.to_owned()),
        action_mean: Some(vec![0.0; 2]),
        action_std: Some(vec![1.0; 2]),
        set,
        ..Import::default()
    }
}

struct Case {
    expected: std::collections::BTreeMap<String, Stored>,
    name: String,
}

impl Case {
    fn values(&self, name: &str) -> &[f32] {
        &self.expected[name].values
    }

    fn shape(&self, name: &str) -> &[usize] {
        &self.expected[name].shape
    }

    fn bytes(&self, name: &str) -> Vec<u8> {
        self.values(name).iter().map(|value| *value as u8).collect()
    }

    /// |Δ| ≤ bound · (1 + |x|).
    fn check(&self, name: &str, found: &[f32], bound: f32) {
        let wanted = self.values(name);
        assert_eq!(found.len(), wanted.len(), "{} {name}", self.name);
        for (found, wanted) in found.iter().zip(wanted) {
            let near = (found - wanted).abs() <= bound * (1.0 + wanted.abs());
            assert!(near, "{} {name}: {found} instead of {wanted}", self.name);
        }
    }

    fn check_costs(&self, name: &str, found: &[f64], bound: f32) {
        let found: Vec<f32> = found.iter().map(|cost| *cost as f32).collect();
        self.check(name, &found, bound);
        let least = |costs: &[f32]| (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        assert_eq!(least(&found), least(self.values(name)), "{} {name}", self.name);
    }
}

fn images(values: &[u8], rows: usize, steps: usize) -> Images<'_> {
    let side = (values.len() / (rows * steps * 3)).isqrt();
    Images { values, rows, steps, height: side, width: side, channels_last: true }
}

fn vectors(values: &[f32], rows: usize, steps: usize) -> Vectors<'_> {
    Vectors { values, rows, steps, dim: values.len() / (rows * steps).max(1) }
}

/// Latents, predictions and costs of a world model.
fn check_model(case: &Case, model: &TrainedModel, bound: f32) {
    let mut planner = model.baseline.planner().expect("a world model");
    let pixels = case.bytes("pixels");
    let half = pixels.len() / 2;
    let proprio = case.expected.get("proprio").map(|stored| &stored.values[..]);
    let seen =
        Observations { pixels: images(&pixels, 2, 1), proprio: proprio.map(|values| vectors(values, 2, 1)) };
    let latent = planner.latent_dim();
    let mut latents = vec![0.0; 2 * latent];
    planner.encode(&seen, &mut latents).unwrap();
    if case.expected.contains_key("embeddings") {
        case.check("embeddings", &latents, bound);
    } else {
        // Tokens without proprioception.
        let dim = case.shape("tokens")[2];
        let tokens = latents.chunks(latent / case.shape("tokens")[1]).flat_map(|token| &token[..dim]);
        case.check("tokens", &tokens.copied().collect::<Vec<_>>(), bound);
    }
    let actions = case.values("candidates");
    let [samples, horizon, dim] = case.shape("candidates")[..] else { panic!("three axes") };
    let candidates = Candidates { actions, episodes: 1, samples, horizon, dim };
    let mut costs = vec![0.0; samples];
    let mut states = vec![0.0; samples * horizon * latent];
    let halves = proprio.map(|values| values.split_at(values.len() / 2));
    let batch = PlanningBatch {
        pixels: images(&pixels[..half], 1, 1),
        action: vectors(&[], 1, 0),
        proprio: halves.map(|(now, _)| vectors(now, 1, 1)),
        goal_pixels: images(&pixels[half..], 1, 1),
        goal_proprio: halves.map(|(_, goal)| vectors(goal, 1, 1)),
    };
    planner.prepare(&batch).unwrap();
    planner.rollout(&candidates, &mut states).unwrap();
    planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
    match case.shape("rollout")[..] {
        [_, _, _] => case.check("rollout", &states, bound),
        // The reference keeps the actions' part of tokens.
        [_, _, patches, all] => {
            let dim = latent / patches;
            let parts = case.values("rollout").chunks(all).flat_map(|token| token[..dim].to_vec());
            let near = states.iter().zip(parts).all(|(a, b)| (a - b).abs() <= bound * (1.0 + b.abs()));
            assert!(near, "{} rollout", case.name);
        }
        _ => panic!("{} rollout", case.name),
    }
    case.check_costs("cost", &costs, bound);
    if case.expected.contains_key("past_cost") {
        let (past, goal) = (case.bytes("past_pixels"), images(&pixels[half..], 1, 1));
        let steps = case.shape("past_pixels")[0];
        let action = vectors(case.values("past_actions"), 1, steps - 1);
        let pixels = images(&past, 1, steps);
        planner.prepare(&PlanningBatch { pixels, action, goal_pixels: goal, ..batch }).unwrap();
        planner.rollout(&candidates, &mut states).unwrap();
        planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
        case.check("past_rollout", &states, bound);
        case.check_costs("past_cost", &costs, bound);
    }
}

/// The actions of a goal-conditioned policy.
fn check_policy(case: &Case, model: &TrainedModel) {
    let mut policy = model.baseline.policy().expect("a policy");
    let (pixels, goal) = (case.bytes("pixels"), case.bytes("goal"));
    let steps = case.shape("pixels")[1];
    let state = |name: &str, steps| case.expected.get(name).map(|stored| vectors(&stored.values, 2, steps));
    let past = vec![0.0; 2 * (steps - 1) * policy.block_dim()];
    let batch = PlanningBatch {
        pixels: images(&pixels, 2, steps),
        action: Vectors { values: &past, rows: 2, steps: steps - 1, dim: policy.block_dim() },
        proprio: state("proprio", steps),
        goal_pixels: images(&goal, 2, 1),
        goal_proprio: state("goal_proprio", 1),
    };
    let mut actions = vec![0.0; 2 * policy.block_dim()];
    policy.act(&batch, &mut actions).unwrap();
    case.check("action", &actions, 1e-4);
}

/// Latents and costs of TD-MPC2.
fn check_agent(case: &Case, config: &OnlineConfig, weights: &Path) {
    let bytes = case.expected.get("pixels").map(|_| case.bytes("pixels"));
    let pixels = bytes.as_ref().map(|bytes| images(bytes, 2, 1));
    let vector = vectors(case.values("state"), case.shape("state")[0], 1);
    let shape = case.shape("candidates").try_into().expect("three axes");
    let candidates = (case.values("candidates"), shape);
    let (latents, returns) =
        tdmpc2_values(&config.agent, weights, pixels.as_ref(), vector, candidates).unwrap();
    case.check("latents", &latents, 1e-4);
    case.check_costs("cost", &returns.iter().map(|value| -f64::from(*value)).collect::<Vec<_>>(), 1e-4);
}

#[test]
fn models_compute_what_the_reference_computes() {
    let mut compared = 0;
    for folder in cases() {
        let name = folder.file_name().unwrap().to_string_lossy().into_owned();
        let case = Case { expected: swm_weights::read(&folder.join("expected.safetensors")).unwrap(), name };
        let mut files: Vec<PathBuf> =
            std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        files.push(folder.join("checkpoints/model_latest.pth"));
        let is_weights = |file: &PathBuf| {
            let ending = file.extension().and_then(|ending| ending.to_str()).unwrap_or_default().to_owned();
            let name = file.file_name().unwrap().to_string_lossy().into_owned();
            file.is_file()
                && ["pt", "pth", "ckpt", "safetensors"].contains(&ending.as_str())
                && !["expected.safetensors", "backbone.pth"].contains(&name.as_str())
        };
        for file in files.into_iter().filter(is_weights) {
            let kind = ["gciql", "gcivl", "hilp"].into_iter().find(|kind| case.name.starts_with(kind));
            let kind = if case.name == "dino_wm" { Some("dino-wm") } else { kind };
            let mut request = request(&file, kind);
            let vector = case.expected.get("proprio").or(case.expected.get("state"));
            if let Some(vector) = vector {
                let dim = *vector.shape.last().unwrap();
                (request.proprio_mean, request.proprio_std) = (Some(vec![0.0; dim]), Some(vec![1.0; dim]));
            }
            if case.name == "dino_wm" {
                request.encoder = Some(folder.join("backbone.pth"));
            }
            let out = tempfile::tempdir().unwrap();
            request.out = out.path().join("run");
            let described = request
                .run(&registry(), &mut ())
                .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
            let half = ["half.pt", "bfloat16.pt"].into_iter().position(|name| file.ends_with(name));
            let bound = [1e-2, 8e-2].get(half.unwrap_or(2)).copied().unwrap_or(1e-4);
            // A run like any other.
            if described.model == "tdmpc2" {
                let agent = TrainedAgent::open(&request.out, Which::Last, Map::new(), Device::Cpu).unwrap();
                let weights = RunFolder::open(&request.out).unwrap().weights(0);
                check_agent(&case, &agent.config, &weights);
            } else {
                let model = TrainedModel::open(&request.out, Which::Last, Device::Cpu).unwrap();
                assert_eq!(described.tensors[0] + described.lacks.len(), described.tensors[1]);
                // Those of training alone: an encoder of a file of its own is not among them.
                assert!(
                    described.lacks.iter().all(|name| !name.contains("encoder")),
                    "{:?}",
                    described.lacks
                );
                if case.expected.contains_key("action") {
                    check_policy(&case, &model);
                } else if half.is_none() {
                    check_model(&case, &model, bound);
                }
                let resumed = Training::resume(&registry(), &request.out, Device::Cpu, None, |_| ());
                assert!(resumed.err().unwrap().to_string().contains("it was imported"));
            }
            compared += 1;
        }
    }
    assert!(compared >= 10, "{compared}");
}
