//! From recorded episodes to plans and actions: tiny models are trained, interrupted, stored, named as policies, and act in
//! an environment that renders images. How well is not the question here.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

mod agents;
mod canonical;
mod dot;
mod foreign;
mod grasp;
mod idm;
mod keypoints;
mod refusals;
mod reproduce;
mod tuned;

use std::path::Path;

use serde_json::json;
use swm_baselines::acting::LatentModel;
use swm_baselines::train::{
    DataConfig, Diagnosis, FitSettings, ImageLooks, MetricSink, NewRun, Record, RunFolder, Split, State,
    Training,
};
use swm_baselines::{Baseline, BaselineError, Device};
use swm_checkpoints::{MODELS, POLICIES, latent_model};
use swm_core::evaluate::quality::{WorldModel, latents, open_loop_error};
use swm_core::evaluate::random_episodes;
use swm_core::policies;
use swm_core::{
    Batch, Cancel, Dtype, EnvConfig, EnvEntry, Field, ImageSize, LiveStep, Policy, PolicyArgs, PolicyContext,
    Recorder, Registry, Rollout, Schema, World, WorldOptions,
};
use swm_core::{BoxError, EpisodeEnd};
use swm_data::ReplayBuffer;
use swm_data::format::built_in;
use swm_data::{Dataset, OpenOptions, WriteMode, open_with};
use swm_solvers::MpcPolicy;

use dot::{DOT, IMAGE, SHADED, SIDE, TWIN, WIDE};

fn world(env: &EnvEntry, num_envs: usize, image: Option<ImageSize>) -> World {
    let config = EnvConfig { image, ..EnvConfig::default() };
    let options = WorldOptions::new(num_envs).env(config).max_episode_steps(24).threads(1);
    World::new(env, options).expect("sound in this test")
}

/// Records random episodes into the file `data.h5` of a folder.
fn record(folder: &Path) -> Box<dyn Dataset> {
    record_as(&folder.join("data.h5"), Some(IMAGE), 1)
}

/// Records random episodes with such images and of this seed.
fn record_as(path: &Path, image: Option<ImageSize>, seed: u64) -> Box<dyn Dataset> {
    record_in(&DOT, path, image, seed)
}

fn record_in(env: &EnvEntry, path: &Path, image: Option<ImageSize>, seed: u64) -> Box<dyn Dataset> {
    let mut world = world(env, 1, image);
    world.set_policy(policies::random()).expect("it begins");
    let rollout = Rollout::new(0..12).seed(seed);
    let mut buffer = ReplayBuffer::new(1000);
    world.record_dataset(&rollout, &mut buffer).expect("sound in this test");
    buffer.dump(path, WriteMode::Error, None).expect("sound in this test");
    swm_data::open(path).expect("sound in this test")
}

fn new_run(baseline: &str) -> NewRun<'_> {
    let encoder = json!({ "kind": "cnn", "channels": [8, 8] });
    let model = match baseline {
        "gcbc" => json!({ "image": SIDE, "encoder": encoder, "frameskip": 2,
            "predictor": { "depth": 1, "heads": 2, "head_dim": 4, "hidden": 8 } }),
        _ => json!({ "image": SIDE, "encoder": encoder, "latent_dim": 8, "projector": 16, "frameskip": 2,
            "predictor": { "depth": 1, "heads": 2, "head_dim": 4, "hidden": 16 } }),
    };
    let fit =
        FitSettings { steps: Some(9), batch: 8, log_every: 2, checkpoint_every: 3, ..FitSettings::default() };
    let changes = json!({ "model": model });
    NewRun {
        baseline,
        preset: "small",
        changes,
        from: None,
        encoder: None,
        looks: ImageLooks::default(),
        split: Split::default(),
        fit,
        device: Device::Cpu,
    }
}

/// Trains in the folder `name`.
fn trained(folder: &Path, baseline: &str, name: &str) -> State {
    let dataset = swm_data::open(&folder.join("data.h5")).expect("sound in this test");
    let mut training = Training::create(built_in(), &folder.join(name), dataset.as_ref(), &new_run(baseline))
        .expect("sound in this test");
    training.run(Vec::new()).expect("sound in this test")
}

fn made(text: &str) -> Result<Box<dyn Policy>, String> {
    made_for(&DOT, text)
}

fn made_for(env: &EnvEntry, text: &str) -> Result<Box<dyn Policy>, String> {
    let (registry, config) =
        (Registry::new().with(POLICIES).with(&[DOT, SHADED, TWIN, WIDE]), EnvConfig::default());
    registry.policy(text, PolicyContext::new(env, &config)).map_err(|error| error.to_string())
}

/// Every state that four episodes went through.
#[derive(Default)]
struct States(std::collections::BTreeMap<(u64, u64), Vec<f32>>);

impl Recorder for States {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        let state: &[f32] = row.values.get("state")?;
        self.0.insert((row.episode.index, row.episode.step), state.to_vec());
        Ok(())
    }

    fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}

fn paths(policy: &str, num_envs: usize, image: Option<ImageSize>) -> Result<States, String> {
    paths_in(&DOT, policy, num_envs, image)
}

fn paths_in(
    env: &EnvEntry,
    policy: &str,
    num_envs: usize,
    image: Option<ImageSize>,
) -> Result<States, String> {
    let mut world = world(env, num_envs, image);
    world.set_policy(made_for(env, policy)?).map_err(|error| chain(&error))?;
    let rollout = Rollout::new(0..4).seed(9);
    let mut states = States::default();
    world.run(&rollout, &mut states).map_err(|error| chain(&error))?;
    Ok(states)
}

/// An error with all its causes.
fn chain(mut error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    while let Some(source) = error.source() {
        error = source;
        text = format!("{text}: {error}");
    }
    text
}

/// Breaks a training off.
struct BreakAt(u64);

impl MetricSink for BreakAt {
    fn record(&mut self, record: &Record) -> Result<(), BaselineError> {
        match record.step < self.0 {
            true => Ok(()),
            false => {
                Err(BaselineError::Training { setting: "test".to_owned(), reason: "broken off".to_owned() })
            }
        }
    }
}

#[test]
fn averages_and_estimated_statistics_go_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = record(folder.path());
    let train = |name: &str, ema: f64, norm_batches: usize, break_at: Option<u64>| {
        let mut new = new_run("lewm");
        new.changes["optim"] = json!({ "ema": ema });
        new.fit.norm_batches = norm_batches;
        let path = folder.path().join(name);
        let mut training = Training::create(built_in(), &path, dataset.as_ref(), &new).unwrap();
        if let Some(step) = break_at {
            training.run(vec![Box::new(BreakAt(step))]).unwrap_err();
            drop(training);
            training = Training::resume(built_in(), &path, Device::Cpu, None, |_| ()).unwrap();
        }
        let state = training.run(Vec::new()).unwrap();
        (state, std::fs::read(RunFolder::open(&path).unwrap().weights(9)).unwrap())
    };
    let whole = train("whole", 0.9, 2, None);
    assert!(train("broken", 0.9, 2, Some(4)) == whole, "the weights or the losses differ");
    let (plain, estimated) = (train("plain", 0.0, 0, None), train("estimated", 0.0, 2, None));
    assert_eq!(plain.0.train, estimated.0.train, "training does not depend on what is saved");
    assert_eq!(plain.0.train, whole.0.train);
    assert!(plain.1 != estimated.1 && estimated.1 != whole.1 && plain.0.validation != whole.0.validation);
}

#[test]
fn an_interrupted_training_goes_on_to_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = record(folder.path());
    let whole = trained(folder.path(), "lewm", "whole");
    let path = folder.path().join("broken");
    let mut training = Training::create(built_in(), &path, dataset.as_ref(), &new_run("lewm")).unwrap();
    let second = Training::resume(built_in(), &path, Device::Cpu, None, |_| ()).err().unwrap().to_string();
    assert!(second.contains(&format!("is being written by process {}", std::process::id())), "{second}");
    let error = training.run(vec![Box::new(BreakAt(4))]).unwrap_err().to_string();
    assert!(error.contains("broken off"), "{error}");
    drop(training);

    let state =
        Training::resume(built_in(), &path, Device::Cpu, None, |_| ()).unwrap().run(Vec::new()).unwrap();
    assert_eq!(state, whole);
    let weights = |name: &str| {
        let run = RunFolder::open(&folder.path().join(name)).unwrap();
        assert_eq!(run.steps().unwrap(), [3, 6, 9]);
        std::fs::read(run.weights(9)).unwrap()
    };
    assert!(weights("whole") == weights("broken"), "the weights differ");
    let error =
        Training::create(built_in(), &path, dataset.as_ref(), &new_run("lewm")).err().unwrap().to_string();
    assert!(error.contains("resume it"), "{error}");
    let error =
        Training::resume(built_in(), &path, Device::Cpu, None, |fit| fit.seed = 1).err().unwrap().to_string();
    assert!(error.contains("make a new run"), "{error}");

    // Receipts hash it: a request for less than was done must not change it.
    let config = std::fs::read(path.join("config.json")).unwrap();
    let resume =
        |steps| Training::resume(built_in(), &path, Device::Cpu, None, |fit| fit.steps = Some(steps));
    let error = resume(2).err().unwrap().to_string();
    assert!(error.contains("it has learned for 9 steps, and 2 were asked for"), "{error}");
    assert!(std::fs::read(path.join("config.json")).unwrap() == config);
    let event_files = || {
        let names = std::fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().file_name());
        names.filter(|name| name.to_string_lossy().starts_with("events.")).count()
    };
    let before = event_files();
    resume(9).unwrap().run(Vec::new()).unwrap();
    assert!(before > 0 && before == event_files(), "a finished run gets no file for TensorBoard");
}

#[test]
fn plans_do_not_depend_on_what_else_is_planned() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let run = folder.path().join("run").display().to_string();
    for settings in [
        "samples=40,iterations=2,elites=4,horizon=2,receding_horizon=1,history_len=3",
        "solver=adam,samples=2,iterations=2,horizon=2,receding_horizon=2",
        "samples=20,iterations=2,elites=4,horizon=3,receding_horizon=1,shrinking_horizon=true,aggregate=mean",
    ] {
        let policy = format!("mpc:{run},{settings}");
        let alone = paths(&policy, 1, Some(IMAGE)).unwrap();
        assert_eq!(alone.0.len(), 4 * 25);
        assert!(alone.0 == paths(&policy, 3, Some(IMAGE)).unwrap().0, "{settings}");
    }
    let fails = |arguments: &str| made(&format!("mpc:{run}{arguments}")).err().unwrap();
    assert!(fails(",solver=cen").contains("did you mean `cem`"));
    assert!(fails(",sample=3").contains("did you mean `samples`"));
    assert!(fails(",checkpont=4").contains("did you mean `checkpoint`"));
    assert!(fails(",aggregate=worst").contains("setting `aggregate`: \"worst\"; use last, mean or best"));
    assert!(fails(",action_block=5").contains("blocks of 2"));
    assert!(fails(",history_len=4").contains("setting `history_len`: 4; the model sees at most 3"));
    assert!(made(&format!("mpc:{run},history_len=3")).is_ok());
    assert!(fails(",checkpoint=4").contains("[3, 6, 9]"));
    assert!(fails(",device=gpu").contains("use cpu, cuda"));
    assert!(fails(",device=cuda:999").contains("device `cuda:999`"));
    assert!(made(&format!("mpc:{run},device=cpu")).is_ok());
    assert!(fails(",precision=fp16").contains("use fp32 or bf16"));
    assert!(made(&format!("mpc:{run},precision=bf16")).is_ok());
    assert!(made(&format!("policy:{run}")).err().unwrap().contains("mpc:RUN"));
    assert!(
        paths(&format!("mpc:{run}"), 1, None)
            .err()
            .unwrap()
            .contains("set the size of images, such as 64x64")
    );

    let args = |text: &str| PolicyArgs::parse(text).unwrap();
    let (mpc, config) = (&POLICIES[0], EnvConfig::default());
    assert_eq!(mpc.image_size(&args(&format!("mpc:{run}"))), Some(IMAGE));
    let named = args(&format!("mpc:{run},solver=icem,samples=7,checkpoint=best,aggregate=mean"));
    let oracle = mpc.oracle_args(&PolicyContext::new(&DOT, &config), &named);
    assert_eq!(oracle, Some(args("icem:samples=7,aggregate=mean,action_block=2")));
    let files = mpc.model_files(&named).unwrap();
    assert_eq!(files[0], Path::new(&run).join("config.json"));
    // A copy of these files and of no others acts alike.
    for checkpoint in ["best", "last", "3"] {
        let copy = folder.path().join(format!("copy-{checkpoint}"));
        std::fs::create_dir_all(copy.join("checkpoints")).unwrap();
        let text = format!("mpc:{run},checkpoint={checkpoint}");
        let files =
            [mpc.model_files(&args(&text)).unwrap(), mpc.companion_files(&args(&text)).unwrap()].concat();
        for file in &files {
            std::fs::copy(file, copy.join(file.strip_prefix(&run).unwrap())).unwrap();
        }
        assert!(files.len() <= 4, "{files:?}");
        let described = made(&format!("mpc:{},checkpoint={checkpoint}", copy.display())).unwrap().describe();
        assert_eq!(described, made(&text).unwrap().describe());
    }
    assert!(made(&format!("mpc:{run}")).unwrap().as_any().is_some_and(|policy| policy.is::<MpcPolicy>()));
}

/// Counts its measurements, and gives the size of a latent.
struct LatentSize(u64);

impl Diagnosis for LatentSize {
    fn measure(&mut self, model: &dyn Baseline, data: &DataConfig) -> Result<Vec<(String, f64)>, BoxError> {
        self.0 += 1;
        let model = LatentModel::of(model, data).ok_or("it predicts nothing")?;
        Ok(vec![("latent_dim".to_owned(), model.latent_dim() as f64)])
    }
}

#[test]
fn models_are_measured_while_they_train() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = record(folder.path());
    let whole = trained(folder.path(), "lewm", "whole");
    let run_measured = |baseline| {
        let run = new_run(baseline);
        NewRun { fit: FitSettings { quality_every: 4, ..run.fit.clone() }, ..run }
    };
    let path = folder.path().join("measured");
    let mut training = Training::create(built_in(), &path, dataset.as_ref(), &run_measured("lewm")).unwrap();
    let mut diagnosis = LatentSize(0);
    assert_eq!(
        training.run_with(Vec::new(), Some(&mut diagnosis), &Cancel::new()).unwrap(),
        whole,
        "training does not see it"
    );
    assert_eq!(diagnosis.0, 3, "after 4, 8 and 9 steps");
    let metrics = std::fs::read_to_string(path.join("metrics.jsonl")).unwrap();
    let lines = metrics.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
    let measured: Vec<u64> = lines
        .filter(|line| line["part"] == "quality" && line["latent_dim"] == 8.0)
        .filter_map(|line| line["step"].as_u64())
        .collect();
    assert_eq!(measured, [4, 8, 9]);

    let mut training =
        Training::create(built_in(), &folder.path().join("policy"), dataset.as_ref(), &run_measured("gcbc"))
            .unwrap();
    let error =
        training.run_with(Vec::new(), Some(&mut LatentSize(0)), &Cancel::new()).unwrap_err().to_string();
    assert!(error.contains("cannot measure the model at step 4: it predicts nothing"), "{error}");
}

#[test]
fn a_policy_acts_by_itself() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "gcbc", "run");
    let run = folder.path().join("run").display().to_string();
    let alone = paths(&format!("gcbc:{run}"), 1, Some(IMAGE)).unwrap();
    assert_eq!(alone.0.len(), 4 * 25);
    assert!(alone.0 == paths(&format!("policy:{run}"), 3, Some(IMAGE)).unwrap().0);
    let fails = |text: String| made(&text).err().unwrap();
    assert!(fails(format!("gcivl:{run}")).contains("trained gcbc, not gcivl; use `gcbc:RUN`"));
    assert!(
        fails(format!("gcbc:{run},devise=cpu")).contains("did you mean `device`?); known are checkpoint")
    );
    let message = fails(format!("mpc:{run}"));
    assert!(message.contains(&format!("run {run}: gcbc is no world model")), "{message}");
    assert!(message.contains("policy:RUN"), "{message}");
}

#[test]
fn a_trained_model_is_measured_without_control() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "run");
    let run = folder.path().join("run").display().to_string();
    let args = |text: String| PolicyArgs::parse(&text).unwrap();
    let lewm = MODELS.iter().find(|entry| entry.name == "lewm").unwrap();
    assert_eq!(lewm.image_size(&args(format!("lewm:{run}"))), Some(IMAGE));
    let mut model = latent_model(&args(format!("lewm:{run}")), DOT.id, None).unwrap();
    assert_eq!((model.latent_dim(), model.stride()), (8, 2));

    let config = EnvConfig { image: Some(IMAGE), ..EnvConfig::default() };
    let mut env = DOT.make(&config).unwrap();
    let episodes = random_episodes(env.as_mut(), 3, 12, 5, &Cancel::new()).unwrap();
    let errors = open_loop_error(&mut model, &episodes, 6).unwrap().unwrap();
    assert!(errors.len() == 3 && errors.iter().all(|error| error.is_finite() && *error > 0.0), "{errors:?}");

    // A row has the same latent by itself and among others, and so has what follows it.
    let rows = &episodes[0];
    let together = latents(&mut model, rows).unwrap();
    assert!(together[..8] != together[8..16], "images differ");
    let mut alone = vec![0.0; 8];
    model.encode(rows.row(1), &mut alone).unwrap();
    assert_eq!(alone, together[8..16]);
    let (mut many, taken) = (together[..24].to_vec(), [0.5, -1.0, 0.25, 1.0].repeat(3));
    model.predict_rows(&mut many, &taken).unwrap();
    model.predict(&mut alone, &taken[..4]).unwrap();
    assert_eq!(alone, many[8..16]);
    let mut other = together[8..16].to_vec();
    model.predict(&mut other, &[-0.5, 1.0, 0.0, 0.0]).unwrap();
    assert!(other != alone, "actions count");

    let fails = |text: String| latent_model(&args(text), DOT.id, None).err().unwrap().to_string();
    assert!(fails(format!("pldm:{run}")).contains("trained lewm, not pldm"));
    assert!(fails(format!("lewm:{run},horizon=3")).contains("horizon"));
    trained(folder.path(), "gcbc", "policy");
    assert!(fails(format!("model:{}", folder.path().join("policy").display())).contains("no world model"));
    assert!(model.encode(Batch::new(rows_without_images(), 1).row(0), &mut alone).is_err());
}

fn rows_without_images() -> std::sync::Arc<Schema> {
    Schema::new(vec![Field::step("state", Dtype::F32, &[2])]).expect("one name")
}

/// With what reads datasets of other programs.
fn with_layouts() -> Registry {
    Registry::new().with(swm_data::FORMATS).with(swm_data_foreign::LAYOUTS)
}

/// The mapping is in the run: opened otherwise, the dataset would be another one.
#[test]
fn a_run_is_resumed_on_its_dataset_as_it_was_opened() {
    let folder = tempfile::tempdir().unwrap();
    let golden =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field/pusht_cchi_v7_replay.zarr");
    let map =
        [("action", "n_contacts"), ("target", "action")].map(|(new, old)| (new.to_owned(), old.to_owned()));
    let options = OpenOptions::default().map(map.into()).fps(Some(10.0));
    let dataset = open_with(&with_layouts(), &golden, &options).unwrap();
    let mut new = new_run("lewm");
    new.changes["model"]["frameskip"] = json!(1);
    let path = folder.path().join("run");
    let mut training = Training::create(&with_layouts(), &path, dataset.as_ref(), &new).unwrap();
    assert_eq!((&training.config().data.opening, training.config().data.action), (&options, 1));
    training.run(vec![Box::new(BreakAt(4))]).unwrap_err();
    drop(training);
    let config: serde_json::Value =
        serde_json::from_slice(&std::fs::read(path.join("config.json")).unwrap()).unwrap();
    assert_eq!(config["data"]["opening"]["map"]["action"], "n_contacts");
    let mut resumed = Training::resume(&with_layouts(), &path, Device::Cpu, None, |_| ()).unwrap();
    assert_eq!(resumed.run(Vec::new()).unwrap().step, 9);
}

/// An option of one machine is in the run, too, and not in the record of the data.
#[test]
fn a_run_on_decoded_values_is_resumed_with_the_folder_for_them() {
    let folder = tempfile::tempdir().unwrap();
    let golden =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field/visual-cube-single-play-v0.npz");
    let storage = folder.path().join("decoded");
    std::fs::create_dir(&storage).unwrap();
    let options = OpenOptions::default().storage(Some(storage.clone()));
    let dataset = open_with(&with_layouts(), &golden, &options).unwrap();
    assert_eq!(dataset.metadata().unwrap().source.as_ref().unwrap()["options"], json!({}));
    let mut new = new_run("lewm");
    new.split.train = 0.5;
    new.changes["model"]["frameskip"] = json!(1);
    let path = folder.path().join("run");
    let mut training = Training::create(&with_layouts(), &path, dataset.as_ref(), &new).unwrap();
    assert_eq!(training.config().data.opening.storage, Some(storage.clone()));
    training.run(vec![Box::new(BreakAt(4))]).unwrap_err();
    drop((training, dataset));
    let mut resumed = Training::resume(&with_layouts(), &path, Device::Cpu, None, |_| ()).unwrap();
    assert_eq!(resumed.config().data.opening.storage, Some(storage));
    assert!(resumed.run(Vec::new()).unwrap().step > 4);
}
