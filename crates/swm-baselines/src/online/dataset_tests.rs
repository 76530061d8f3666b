//! Agents that learn from datasets, in the toy environment: every line of [`AGENTS`] that does.

use std::path::Path;
use std::sync::Arc;

use serde_json::{Map, Value as Json, json};
use swm_core::env::PIXELS;
use swm_core::testing::TOY;
use swm_core::{Batch, Cancel, Dtype, EnvConfig, Field, ImageSize, Rollout, Schema, World, WorldOptions};
use swm_data::{Dataset, MemoryDataset, WriteMode};

use super::*;
use crate::acting::AgentPolicy;
use crate::train::{End, Which};
use crate::{BaselineError, Device};

/// Writes 8 episodes of random actions, with images of this side.
fn record(path: &Path, image: Option<usize>) -> Box<dyn Dataset> {
    let image = image.map(|side| ImageSize { height: side, width: side });
    let options = WorldOptions::new(2).max_episode_steps(20).threads(1);
    let mut world = World::new(&TOY, options.env(EnvConfig { image, ..EnvConfig::default() })).unwrap();
    world.set_policy(swm_core::policies::random()).unwrap();
    let mut writer = swm_data::create(path, WriteMode::Append, None).unwrap();
    world.record_dataset(&Rollout::new(0..8).seed(3), writer.as_mut()).unwrap();
    swm_data::open(path).unwrap()
}

fn begin(
    folder: &Path,
    dataset: &dyn Dataset,
    agent: &str,
    observe: &[&str],
) -> Result<OnlineTraining, BaselineError> {
    let observe: Vec<String> = observe.iter().map(|&name| name.to_owned()).collect();
    let plan =
        json!({ "samples": 12, "collect_samples": 12, "elites": 4, "policy_samples": 3, "iterations": 2 });
    let changes = json!({ "latent_dim": 8, "encoder_dim": 8, "mlp_dim": 8, "num_bins": 11, "batch": 8, "plan": plan,
        "image": { "size": 40, "channels": 4 } });
    let new = NewOnlineRun {
        agent,
        preset: "small",
        changes: if agent == "tdmpc2" { changes } else { Json::Null },
        env_settings: Map::new(),
        observe: &observe,
        fit: OnlineSettings { steps: 30, log_every: 5, eval_every: 10, ..OnlineSettings::default() },
        device: Device::Cpu,
    };
    OnlineTraining::create_on(folder, dataset, &new)
}

#[test]
fn a_run_on_a_dataset_goes_on_to_the_same_bits_and_acts() {
    for (observe, image) in [(&[][..], None), (&["pixels"][..], Some(40))] {
        let folder = tempfile::tempdir().unwrap();
        let [whole, cut, data] = ["whole", "cut", "data.h5"].map(|name| folder.path().join(name));
        let dataset = record(&data, image);
        let state = begin(&whole, dataset.as_ref(), "tdmpc2", observe)
            .unwrap()
            .run(Vec::new(), &Cancel::new())
            .unwrap();
        assert_eq!((state.step, state.end, state.best), (30, Some(End::Complete), None));
        let mut half = begin(&cut, dataset.as_ref(), "tdmpc2", observe).unwrap();
        let cancel = Cancel::new();
        half.run(vec![Box::new(tests::At(17, Some(cancel.clone())))], &cancel).unwrap();
        drop(half);
        let moved = folder.path().join("moved.h5");
        std::fs::rename(&data, &moved).unwrap();
        let resume =
            |path: Option<&Path>| OnlineTraining::resume(&tests::registry(), &cut, Device::Cpu, path, |_| {});
        let gone = resume(None).err().unwrap().to_string();
        assert!(gone.contains("name its place as `dataset`"), "{gone}");
        resume(Some(&moved)).unwrap().run(Vec::new(), &Cancel::new()).unwrap();
        let [whole_left, cut_left] = [&whole, &cut].map(|run| tests::left_of_run(run));
        assert_eq!(whole_left, cut_left);

        let open = |which| TrainedAgent::open(&whole, which, Map::new(), Device::Cpu);
        let image = image.map(|side| ImageSize { height: side, width: side });
        let options = WorldOptions::new(2).max_episode_steps(20).threads(1);
        let mut world = World::new(&TOY, options.env(EnvConfig { image, ..EnvConfig::default() })).unwrap();
        world.set_policy(AgentPolicy::new(open(Which::Last).unwrap())).unwrap();
        assert_eq!(world.evaluate(&Rollout::new(0..4).seed(3)).unwrap().episode_returns.len(), 4);
        assert!(open(Which::Best).err().unwrap().to_string().contains("checkpoint=last"));
    }
}

#[test]
fn goals_are_what_episodes_reach_and_vectors_are_standardized() {
    let folder = tempfile::tempdir().unwrap();
    let mut data = record(&folder.path().join("data.h5"), None);
    let run = begin(&folder.path().join("run"), data.as_ref(), "tdmpc2", &[]).unwrap();
    let interface = &run.config().interface;
    assert_eq!(interface.columns, ["state", "goal_state"]);
    let scale = interface.scale.clone().unwrap();
    let mut rows = Batch::new(data.schema().clone(), 0);
    data.read(0, 0..data.episode_len(0), &mut rows).unwrap();
    let states = rows.column(rows.schema().require("state").unwrap());
    let last = states.as_f64(states.len() - 1).unwrap();
    let transitions = interface.transitions(&rows, interface::Goals::Reached).unwrap();
    let vectors = transitions.column(transitions.schema().require("observation").unwrap());
    for row in 0..states.len() {
        for (at, value) in [(0, states.as_f64(row).unwrap()), (1, last)] {
            let wanted = (value - scale.mean[at]) / scale.std[at];
            assert!((vectors.as_f64(row * 2 + at).unwrap() - wanted).abs() < 1e-5);
        }
    }
    let rest = (0..vectors.len()).map(|at| vectors.as_f64(at).unwrap().abs()).fold(0.0, f64::max);
    assert!(rest < 10.0, "{rest}");
}

/// An episode of so many rows with these columns, whose real numbers are all `value`.
fn in_memory(fields: &[(&str, Dtype, &[usize])], value: f64, rows: usize) -> MemoryDataset {
    let fields = fields.iter().map(|&(name, dtype, shape)| Field::step(name, dtype, shape)).collect();
    let schema: Arc<Schema> = Schema::new(fields).unwrap();
    let mut rows = Batch::new(schema.clone(), rows);
    for column in 0..schema.fields().len() {
        if let swm_core::SliceMut::F32(values) = rows.column_mut(column) {
            values.fill(value as f32);
        }
    }
    MemoryDataset::new("data.h5", schema, None, [Arc::new(rows)]).unwrap()
}

#[test]
fn datasets_that_an_agent_cannot_learn_from_are_refused() {
    const STATE: (&str, Dtype, &[usize]) = ("state", Dtype::F32, &[2]);
    const ACTION: (&str, Dtype, &[usize]) = ("action", Dtype::F32, &[1]);
    const REWARD: (&str, Dtype, &[usize]) = ("reward", Dtype::F32, &[]);
    let images = |side: usize| {
        [STATE, ACTION, REWARD, (PIXELS, Dtype::U8, if side == 40 { &[40, 40, 3] } else { &[64, 64, 3] })]
    };
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let refused = |dataset: &dyn Dataset, agent: &str, observe: &[&str]| {
        begin(&run, dataset, agent, observe).err().unwrap().to_string()
    };
    for (fields, value, observe, reason) in [
        (
            &[STATE, ACTION][..],
            0.5,
            &[][..],
            "it has no column `reward`, only `state`, `action`; record it with `swm collect`",
        ),
        (&[STATE, ACTION, REWARD], f64::NAN, &[], "no row of its column `reward` is finite"),
        (&[STATE, ACTION, REWARD], 3.0, &[], "its actions reach 3.000, and it learns actions within [-1, 1]"),
        (
            &[STATE, ACTION, REWARD],
            0.5,
            &["stat"],
            "it has no vector `stat`, only `state`, `action`, `reward`",
        ),
        (&[ACTION, REWARD], 0.5, &[], "it has none of `observation`, `state`, `proprio`"),
        (
            &[STATE, ACTION, REWARD],
            0.5,
            &["pixels"],
            "it has no column `pixels`; record it with images of 40x40",
        ),
        (
            &images(64),
            0.5,
            &["pixels"],
            "its images are [64, 64, 3], and the agent's [40, 40, 3]; learn from them with the setting image.size=64",
        ),
    ] {
        let message = refused(&in_memory(fields, value, 10), "tdmpc2", observe);
        assert!(
            message.starts_with("data.h5 cannot train tdmpc2: ") && message.contains(reason),
            "{message}"
        );
    }
    let whole = in_memory(&[STATE, ACTION, REWARD], 0.5, 10);
    let message = refused(&in_memory(&[STATE, ACTION, REWARD], 0.5, 3), "tdmpc2", &[]);
    assert!(message.contains("a clip has 4 steps, and the longest episode 3"), "{message}");
    let message = refused(&whole, "sac", &[]);
    assert!(message.contains("setting `data`: sac learns online alone; name an environment"), "{message}");
    let foreign = begin(&run, &in_memory(&images(40), 0.5, 10), "tdmpc2", &["state", "pixels"]).unwrap();
    assert_eq!((foreign.config().env.as_str(), foreign.buffer_size()), ("", [10, 10 * (4_800 + 5 * 4)]));
}
