//! Recordings without images in other looks: equal to rendering anew, chosen per clip and epoch, and never other than visual.

#![expect(clippy::unwrap_used, reason = "what a helper cannot do ends its test")]

use std::collections::BTreeMap;

use serde_json::Value as Json;
use swm::core::env::PIXELS;
use swm::core::{Batch, EnvConfig, ImageSize, ResetOptions, Rollout, SliceMut, Value, World, WorldOptions};
use swm::data::loader::{BatchOptions, ClipOptions, Loader};
use swm::data::rendered::CANONICAL;
use swm::data::{Dataset, Looks, MemoryDataset, RenderOptions, Rendered, ReplayBuffer, Steps};

use crate::replayable::record;
use crate::support::{Folder, PUSHT, swm_fails, swm_json, swm_ok};

const IMAGE: ImageSize = ImageSize { height: 32, width: 40 };
const VISUAL: [&str; 7] = [
    "background.color",
    "goal.angle",
    "goal.color",
    "goal.position",
    "goal.scale",
    "block.color",
    "agent.color",
];

fn small() -> MemoryDataset {
    record(swm::registry().env(PUSHT).unwrap(), false, 1).unwrap()
}

fn options() -> RenderOptions {
    RenderOptions::default().image(IMAGE)
}

fn rendered(dataset: &dyn Dataset, options: &RenderOptions) -> Rendered {
    Rendered::new(dataset.share(), &swm::registry(), options).expect("it has such looks")
}

fn visual() -> Looks {
    Looks::default().vary(["visual"].map(str::to_owned).to_vec()).seed(3)
}

fn dark() -> BTreeMap<String, Value> {
    let color = |name: &str, values: [u8; 3]| (name.to_owned(), Value::vector(&values));
    BTreeMap::from([color("background.color", [0, 0, 0]), color("agent.color", [255, 0, 0])])
}

fn clips(dataset: Rendered, threads: usize) -> Loader {
    let keys = [PIXELS, CANONICAL, "state", "variation.agent.color"];
    let options = ClipOptions::default().num_steps(3).frameskip(4).threads(Some(threads));
    Loader::new(Box::new(dataset), &options.keys(Some(keys.map(str::to_owned).to_vec()))).unwrap()
}

/// All batches of two epochs.
fn epochs(loader: &Loader) -> Vec<Batch> {
    let mut batches =
        loader.batches(&BatchOptions::default().size(5).shuffle(Some(1)).epochs(Some(2))).unwrap();
    let mut all = Vec::new();
    for _ in 0..2 {
        all.extend(batches.by_ref().map(Result::unwrap));
    }
    all
}

/// The images of an episode that is recorded anew with these factors.
fn anew(values: &BTreeMap<String, Value>) -> MemoryDataset {
    let env = EnvConfig { image: Some(IMAGE), ..EnvConfig::default() };
    let options = WorldOptions::new(2).env(env).max_episode_steps(28).threads(1);
    let mut world = World::new(swm::registry().env(PUSHT).unwrap(), options).unwrap();
    world.set_policy(swm::core::policies::random()).unwrap();
    let reset = ResetOptions { variation_values: values.clone(), ..ResetOptions::default() };
    let mut buffer = ReplayBuffer::new(1000);
    world.record_dataset(&Rollout::new(0..2).seed(5).options(reset), &mut buffer).unwrap();
    buffer.dataset().unwrap()
}

fn images(dataset: &mut dyn Dataset, name: &str, episode: usize, steps: Steps) -> Vec<u8> {
    let column = dataset.schema().require(name).unwrap();
    let mut out = vec![0; steps.count * dataset.schema().dim(column)];
    dataset.read_column(column, episode, steps, SliceMut::U8(&mut out)).unwrap();
    out
}

#[test]
fn a_look_is_what_an_episode_with_such_factors_shows() {
    let small = small();
    let mut look = dark();
    look.insert("goal.scale".to_owned(), Value::scalar(55.0));
    look.insert("goal.position".to_owned(), Value::vector(&[120.0, 330.0]));
    let mut set = rendered(&small, &options().factors(look.clone()));
    let mut paired = rendered(&small, &options().canonical(Some(look.clone())));
    let mut plain = rendered(&small, &options());
    let mut other = anew(&look);
    for (episode, first) in [(1, 20), (0, 3), (1, 5)] {
        let steps = Steps { first, count: 2, stride: 3 };
        let wanted = images(&mut other, PIXELS, episode, steps);
        assert_eq!(images(&mut set, PIXELS, episode, steps), wanted);
        assert_eq!(images(&mut paired, CANONICAL, episode, steps), wanted);
        let usual = images(&mut plain, PIXELS, episode, steps);
        assert_eq!(images(&mut paired, PIXELS, episode, steps), usual);
        assert_ne!(usual, wanted);
    }
    // The image of the goal, too, and the column of the factor.
    let first = Steps { first: 0, count: 1, stride: 1 };
    assert_eq!(images(&mut set, "goal", 0, first), images(&mut other, "goal", 0, first));
    assert_eq!(images(&mut set, "variation.agent.color", 0, first), [255, 0, 0]);
    assert_eq!(set.metadata().unwrap().variation_values["agent.color"], serde_json::json!([255, 0, 0]));
}

#[test]
fn checkpoints_serve_every_look() {
    // A recording that says it has checkpoints and has one wrong action before the last of them: with the checkpoint nobody steps there.
    let small = small();
    let mut rows = Batch::new(small.schema().clone(), 0);
    small.clone().read(0, 0..small.episode_len(0), &mut rows).unwrap();
    let action = rows.schema().require("action").unwrap();
    let SliceMut::F32(actions) = rows.column_mut(action) else { panic!("actions are f32") };
    actions[2] = -actions[2] + 0.5;
    let metadata = small.metadata().cloned();
    let forged =
        MemoryDataset::new("forged", small.schema().clone(), metadata, [std::sync::Arc::new(rows)]).unwrap();
    let steps = Steps { first: 17, count: 1, stride: 1 };
    let look = options().factors(dark());
    let found = images(&mut rendered(&forged, &look), PIXELS, 0, steps);
    assert_eq!(found, images(&mut rendered(&small, &look), PIXELS, 0, steps));
}

#[test]
fn looks_depend_on_epoch_and_clip_alone() {
    let small = small();
    let options = options().looks(Some(visual())).canonical(Some(dark()));
    let one = epochs(&clips(rendered(&small, &options), 1));
    let three = epochs(&clips(rendered(&small, &options), 3));
    assert_eq!(one, three, "threads");
    let all =
        |name: &str| one.iter().flat_map(|batch| batch.get::<u8>(name).unwrap().to_vec()).collect::<Vec<_>>();
    let colors = all("variation.agent.color");
    let per_clip: Vec<&[u8]> = colors.chunks(9).collect();
    assert!(per_clip.iter().all(|clip| clip[..3] == clip[3..6] && clip[..3] == clip[6..]), "one look a clip");
    let mut distinct: Vec<&[u8]> = per_clip.iter().map(|clip| &clip[..3]).collect();
    distinct.sort_unstable();
    distinct.dedup();
    assert!(distinct.len() > per_clip.len() * 9 / 10, "{} looks of {} clips", distinct.len(), per_clip.len());
    // One more factor moves no other, and another seed moves all.
    let of = |looks: Looks| {
        let dataset = rendered(&small, &options.clone().looks(Some(looks)));
        let loader = clips(dataset, 1);
        let mut batch = loader.new_batch();
        loader.read_in(4, &[7, 2], &mut batch).unwrap();
        batch
    };
    let alone = of(visual().vary(vec!["agent.color".to_owned()]));
    let (together, reseeded) = (of(visual()), of(visual().seed(4)));
    let color = |batch: &Batch| batch.get::<u8>("variation.agent.color").unwrap().to_vec();
    assert_eq!(color(&alone), color(&together));
    assert_ne!(color(&alone), color(&reseeded));
    for batch in [&together, &reseeded] {
        assert_eq!(batch.get::<u8>(CANONICAL).unwrap(), alone.get::<u8>(CANONICAL).unwrap());
        assert_eq!(batch.get::<f64>("state").unwrap(), alone.get::<f64>("state").unwrap());
    }
}

#[test]
fn shares_of_looks_are_kept() {
    let small = small();
    let share = |looks: Looks| {
        let batches =
            epochs(&clips(rendered(&small, &options().looks(Some(looks)).canonical(Some(dark()))), 2));
        let colors =
            batches.iter().flat_map(|batch| batch.get::<u8>("variation.agent.color").unwrap().to_vec());
        let colors: Vec<u8> = colors.collect();
        let usual = colors.chunks(9).filter(|clip| clip[..3] == [65, 105, 225]).count();
        1.0 - usual as f64 / (colors.len() / 9) as f64
    };
    assert!((share(visual()) - 1.0).abs() < 0.02);
    assert!((share(visual().share(0.6)) - 0.6).abs() < 0.17);
    assert!((share(visual().share(0.6).usual(0.5)) - 0.3).abs() < 0.17);
    assert!(share(visual().usual(1.0)).abs() < 1e-9);
}

#[test]
fn what_is_no_look_is_refused_by_name() {
    let small = small();
    let refused = |options: &RenderOptions| {
        Rendered::new(small.share(), &swm::registry(), options).err().expect("it is refused").to_string()
    };
    let vary = |name: &str| options().looks(Some(visual().vary(vec![name.to_owned()])));
    for name in ["agent.scale", "block", "all", "default"] {
        let message = refused(&vary(name));
        assert!(
            message.contains("does not change images alone") && message.contains("goal.scale"),
            "{message}"
        );
    }
    assert!(refused(&vary("goal.colour")).contains("did you mean `goal.color`?"));
    let message = refused(&options().looks(Some(visual().share(1.5))));
    assert!(message.contains("looks.share is 1.5"), "{message}");
    let scale = BTreeMap::from([("block.scale".to_owned(), Value::scalar(40.0))]);
    let message = refused(&options().canonical(Some(scale)));
    assert!(
        message.contains("`block.scale`") && message.contains("does not change images alone"),
        "{message}"
    );
}

#[test]
fn visual_factors_are_those_of_the_table() {
    let entry = swm::registry().env(PUSHT).unwrap();
    let env = entry.make(&EnvConfig::default()).unwrap();
    let visual: Vec<&str> =
        env.spec().factors.iter().filter(|factor| factor.visual).map(|factor| factor.name.as_str()).collect();
    assert_eq!(visual, VISUAL);
}

/// The documented trick: two recordings of one seed, with and without other visual factors, hold the same states.
#[test]
fn equal_seeds_with_other_looks_hold_equal_states() {
    let folder = Folder::new();
    let (plain, varied) = (folder.path("plain.h5"), folder.path("varied.h5"));
    let collect = [
        "collect",
        PUSHT,
        "--policy",
        "weak",
        "--episodes",
        "4",
        "--max-steps",
        "30",
        "--seed",
        "9",
        "--quiet",
    ];
    let vary = ["--vary", "+agent.color,+background.color,+block.color,+goal"];
    swm_ok(&[&collect[..], &["--image-size", "32x32", "--out", &plain]].concat());
    swm_ok(&[&collect[..], &["--image-size", "32x32", "--out", &varied], &vary].concat());
    let open = |path: &str| swm::data::open(std::path::Path::new(path)).unwrap();
    let (mut plain, mut varied) = (open(&plain), open(&varied));
    for episode in 0..4 {
        let len = plain.episode_len(episode);
        assert_eq!(len, varied.episode_len(episode));
        for name in ["state", "action", "block_pose", "goal_state", "reward", "pixels"] {
            let read = |dataset: &mut Box<dyn Dataset>| {
                let column = dataset.schema().require(name).unwrap();
                let field = dataset.schema().fields()[column].clone();
                let mut out = swm::core::Column::zeros(field.dtype, len * field.dim());
                let steps = Steps { first: 0, count: len, stride: 1 };
                dataset.read_column(column, episode, steps, out.as_slice_mut()).unwrap();
                format!("{:?}", out.as_slice())
            };
            assert_eq!(
                read(&mut plain) == read(&mut varied),
                name != "pixels",
                "{name} of episode {episode}"
            );
        }
    }
}

/// The same with whole numbers as floats: values of factors are written as they were given.
fn floats(json: &Json) -> Json {
    match json {
        Json::Number(number) => number.as_f64().into(),
        Json::Array(values) => values.iter().map(floats).collect(),
        Json::Object(members) => members.iter().map(|(name, value)| (name.clone(), floats(value))).collect(),
        other => other.clone(),
    }
}

#[test]
fn the_command_draws_a_recording_in_another_look() {
    let folder = Folder::new();
    let (small, dark, anew) = (folder.path("small.h5"), folder.path("dark.h5"), folder.path("anew.h5"));
    let collect = ["collect", PUSHT, "--policy", "weak", "--episodes", "2", "--max-steps", "20", "--quiet"];
    let set = ["--set", "background.color=black", "--set", "agent.color=255,0,0"];
    // A replayable recording has no images, so that leaving one out changes nothing.
    swm_ok(&[&collect[..], &["--replayable", "--without", "goal", "--out", &small]].concat());
    swm_ok(&[&collect[..], &["--image-size", "32x32", "--out", &anew], &set].concat());
    swm_ok(&[&["convert", &small, &dark, "--image-size", "32x32", "--quiet"], &set[..]].concat());
    swm_ok(&["diff", &dark, &anew]);
    let metadata = |path: &str| floats(&swm_json(&["inspect", path])["metadata"]);
    assert_eq!(metadata(&dark), metadata(&anew));
    let again = folder.path("again.h5");
    swm_ok(&["convert", &anew, &again, "--set", "background.color=#00ff00", "--quiet"]);
    assert_eq!(swm_json(&["inspect", &again])["metadata"]["image"]["width"], 32);
    let none = folder.path("none.h5");
    let fails =
        |set: &str, size: &str| swm_fails(2, &["convert", &small, &none, "--image-size", size, "--set", set]);
    assert!(fails("block.colour=red", "32x32").contains("did you mean `block.color`?"));
    assert!(fails("background.color=black", "none").contains("--image-size 64x64"));
    assert!(!std::path::Path::new(&none).exists());
}
