//! Recordings without images give the images that a recording with them holds, for every environment.

use std::collections::BTreeMap;

use swm::core::env::PIXELS;
use swm::core::{
    Batch, EnvConfig, EnvEntry, ImageSize, Rollout, Schema, SliceMut, Value, World, WorldError, WorldOptions,
    policies,
};
use swm::data::loader::{BatchOptions, ClipOptions, Loader};
use swm::data::{Dataset, MemoryDataset, RenderOptions, Rendered, ReplayBuffer, Steps};

use crate::support::{Folder, PUSHT, swm, swm_fails, swm_json, swm_ok};

const IMAGE: ImageSize = ImageSize { height: 32, width: 40 };
const EVERY: u32 = 8;

/// Two episodes of random actions under the default factors drawn; with images, or with checkpoints.
pub(crate) fn record(entry: &EnvEntry, images: bool, frame_skip: u32) -> Result<MemoryDataset, WorldError> {
    let options = WorldOptions::new(2)
        .env(EnvConfig { image: images.then_some(IMAGE), ..EnvConfig::default() })
        .max_episode_steps(28)
        .frame_skip(frame_skip)
        .threads(1)
        .checkpoints((!images).then_some(EVERY));
    let mut world = World::new(entry, options)?;
    world.set_policy(policies::random())?;
    let rollout = Rollout::new(0..2).seed(5);
    let mut buffer = ReplayBuffer::new(1000);
    world.record_dataset(&rollout, &mut buffer)?;
    Ok(buffer.dataset().expect("it was recorded"))
}

fn rendered(dataset: &MemoryDataset, options: &RenderOptions) -> Rendered {
    Rendered::new(dataset.share(), &swm::registry(), options).expect("it says how it was recorded")
}

fn options() -> RenderOptions {
    RenderOptions::default().image(IMAGE)
}

fn frames(dataset: &mut dyn Dataset, name: &str, episode: usize, steps: Steps) -> Vec<u8> {
    let column = dataset.schema().require(name).expect("the column is there");
    let mut out = vec![1; steps.count * dataset.schema().dim(column)];
    dataset.read_column(column, episode, steps, SliceMut::U8(&mut out)).expect("the frames can be drawn");
    out
}

/// Compares every drawn column, read in an order that jumps about, with the recorded one.
fn compare(entry: &EnvEntry, frame_skip: u32) {
    let (mut recorded, small) = match (record(entry, true, frame_skip), record(entry, false, frame_skip)) {
        (Ok(recorded), Ok(small)) => (recorded, small),
        (Err(error), _) | (_, Err(error)) => {
            println!("skipped {}: {error}", entry.id);
            return;
        }
    };
    let mut drawn = rendered(&small, &options());
    assert_eq!(drawn.checkpoint_rows(), Some(EVERY as usize));
    let names: Vec<String> = drawn.schema().fields().iter().map(|field| field.name.clone()).collect();
    for name in recorded.schema().fields().iter().map(|field| &field.name) {
        assert!(names.contains(name), "{}: `{name}` is missing", entry.id);
    }
    let images = [PIXELS, "goal"].into_iter().filter(|name| recorded.schema().index(name).is_some());
    for name in images.collect::<Vec<_>>() {
        for (episode, first, count, stride) in
            [(1, 17, 3, 2), (0, 0, 9, 3), (1, 3, 1, 1), (0, 25, 2, 1), (0, 9, 8, 1), (0, 2, 1, 1)]
        {
            let len = recorded.episode_len(episode);
            let count = count.min((len.saturating_sub(first)).div_ceil(stride));
            if count == 0 {
                continue;
            }
            let steps = Steps { first, count, stride };
            assert!(
                frames(&mut recorded, name, episode, steps) == frames(&mut drawn, name, episode, steps),
                "{}: `{name}` of episode {episode}, {steps:?} differs",
                entry.id
            );
        }
    }
    for episode in 0..2 {
        let whole = recorded.episode_len(episode) / EVERY as usize;
        assert_eq!(drawn.verify(episode).expect("nothing has changed"), whole, "{}", entry.id);
    }
}

#[test]
fn every_environment_is_drawn_as_it_was_recorded() {
    for entry in swm::registry().envs() {
        compare(entry, 1);
    }
}

#[test]
fn frame_skip_is_replayed() {
    compare(swm::registry().env(PUSHT).unwrap(), 3);
}

#[test]
fn colors_can_be_changed_and_physics_cannot() {
    let entry = swm::registry().env(PUSHT).unwrap();
    let small = record(entry, false, 1).unwrap();
    let with = |name: &str, value: Value| options().factors(BTreeMap::from([(name.to_owned(), value)]));
    let green = with("background.color", Value::vector(&[0.0, 255.0, 0.0]));
    let (mut plain, mut recolored) = (rendered(&small, &options()), rendered(&small, &green));
    let steps = Steps { first: 10, count: 2, stride: 4 };
    let (a, b) = (frames(&mut plain, PIXELS, 1, steps), frames(&mut recolored, PIXELS, 1, steps));
    let greens = b.chunks(3).filter(|pixel| *pixel == [0, 255, 0]).count();
    assert!(greens > b.len() / 6, "most of the image is background");
    // What is not background stays as it is, edges aside.
    let same = a.chunks(3).zip(b.chunks(3)).filter(|(a, b)| a == b).count();
    assert!(same > 0 && same + greens <= b.len() / 3);

    let refused = |options: &RenderOptions| {
        Rendered::new(small.share(), &swm::registry(), options).err().unwrap().to_string()
    };
    for (name, value) in
        [("agent.scale", Value::scalar(20.0)), ("agent.start_position", Value::vector(&[100.0, 100.0]))]
    {
        let error = refused(&with(name, value));
        assert!(error.contains(name) && error.contains("does not change images alone"), "{error}");
    }
    let error = refused(&with("background.colour", Value::scalar(1.0)));
    assert!(error.contains("did you mean `background.color`"), "{error}");
}

#[test]
fn a_damaged_recording_is_found_by_its_checkpoints() {
    let entry = swm::registry().env(PUSHT).unwrap();
    let small = record(entry, false, 1).unwrap();
    let mut source = small.clone();
    let mut rows = Batch::new(small.schema().clone(), 0);
    source.read(0, 0..small.episode_len(0), &mut rows).unwrap();
    let action = rows.schema().require("action").unwrap();
    let SliceMut::F32(actions) = rows.column_mut(action) else { panic!("actions are f32") };
    actions[6] += 0.01;
    let metadata = small.metadata().cloned();
    let forged =
        MemoryDataset::new("forged", small.schema().clone(), metadata, [std::sync::Arc::new(rows)]).unwrap();
    let error = rendered(&forged, &options()).verify(0).unwrap_err().to_string();
    assert!(error.contains("forged") && error.contains("episode 0, row 8"), "{error}");
}

#[test]
fn the_command_records_and_the_loader_draws() {
    let folder = Folder::new();
    let (small, large) = (folder.path("small.h5"), folder.path("large.h5"));
    let collect = ["collect", PUSHT, "--policy", "weak", "--episodes", "3", "--max-steps", "40", "--quiet"];
    swm_ok(&[&collect[..], &["--replayable", "--out", &small]].concat());
    swm_ok(&[&collect[..], &["--image-size", "48x48", "--out", &large]].concat());
    assert_eq!(swm_json(&["inspect", &small])["checkpoint_rows"], 16);
    assert!(swm_ok(&["inspect", &small]).contains("replayable: states every 16 rows"));
    let replay = swm_json(&["replay", &small, "--tolerance", "0"]);
    assert_eq!((&replay["ok"], &replay["checkpoints_differ"]), (&true.into(), &0.into()));
    assert!(replay["checkpoints"].as_u64().unwrap() >= 2, "{replay}");
    let size = |path: &str| std::fs::metadata(path).unwrap().len();
    assert!(size(&small) < size(&large), "{} and {} bytes", size(&small), size(&large));
    let both = [&collect[..], &["--replayable", "--image-size", "64", "--out", &large]].concat();
    assert!(swm_fails(2, &both).contains("--image-size"));

    let open = |path: &str| swm::data::open(std::path::Path::new(path)).unwrap();
    let image = ImageSize { height: 48, width: 48 };
    let options = RenderOptions::default().image(image);
    let drawn = Rendered::new(open(&small), &swm::registry(), &options).unwrap();
    let keys = ["pixels", "state", "action"].map(str::to_owned).to_vec();
    let clips = ClipOptions::default().num_steps(3).frameskip(2).keys(Some(keys)).threads(Some(2));
    let stream = BatchOptions::default().size(7).shuffle(Some(1));
    let batches = |dataset| Loader::new(dataset, &clips).unwrap().batches(&stream).unwrap();
    let (drawn, stored) = (batches(Box::new(drawn)), batches(open(&large)));
    for (drawn, stored) in drawn.zip(stored) {
        let (drawn, stored) = (drawn.unwrap(), stored.unwrap());
        assert!(drawn.get::<u8>("pixels").unwrap() == stored.get::<u8>("pixels").unwrap());
        assert_eq!(drawn.get::<f64>("state").unwrap(), stored.get::<f64>("state").unwrap());
    }
}

#[test]
fn commands_render_recordings_without_images() {
    let folder = Folder::new();
    let (small, large) = (folder.path("small.h5"), folder.path("large.h5"));
    let collect = ["collect", PUSHT, "--policy", "weak", "--episodes", "3", "--max-steps", "20", "--quiet"];
    swm_ok(&[&collect[..], &["--replayable", "--out", &small]].concat());
    swm_ok(&[&collect[..], &["--image-size", "48x48", "--out", &large]].concat());

    let (sheet, plain) = (folder.path("sheet.png"), folder.path("plain.png"));
    let preview = |file: &str, out: &str, extra: &[&str]| {
        swm(&[&["preview", file, "--frames", "4", "--out", out], extra].concat()).output().unwrap()
    };
    let shown = preview(&small, &sheet, &["--image-size", "48x48"]);
    assert!(shown.status.success(), "{}", String::from_utf8_lossy(&shown.stderr));
    preview(&large, &plain, &[]);
    assert_eq!(std::fs::read(&sheet).unwrap(), std::fs::read(&plain).unwrap());
    let unasked = preview(&small, &sheet, &[]);
    let said = String::from_utf8_lossy(&unasked.stderr);
    assert!(
        unasked.status.success() && said.contains("holds no images; they are rendered at 128x128"),
        "{said}"
    );

    let copy = folder.path("copy.h5");
    swm_ok(&["convert", &small, &copy, "--image-size", "48x48", "--quiet"]);
    swm_ok(&["diff", &copy, &large]);
    assert_eq!(swm_json(&["inspect", &copy])["metadata"], swm_json(&["inspect", &large])["metadata"]);
    assert_eq!(swm_json(&["replay", &copy, "--tolerance", "0"])["ok"], true);
    swm_ok(&["split", &small, "--image-size", "48x48", "--parts", "a=2,b=1", "--out", &folder.path("{}.h5")]);
    assert!(swm_json(&["inspect", &folder.path("a.h5")])["columns"]["pixels"].is_object());
    swm_ok(&["convert", &small, &folder.path("plain.h5"), "--quiet"]);
    assert!(swm_json(&["inspect", &folder.path("plain.h5")])["columns"]["pixels"].is_null());

    if cfg!(feature = "mp4") {
        let video = folder.path("copy.video");
        let output = swm(&["convert", &small, &video]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && said.contains("rendered at 64x64"), "{said}");
        assert_eq!(
            swm_json(&["inspect", &video])["columns"]["pixels"]["shape"],
            serde_json::json!([64, 64, 3])
        );
        swm_ok(&["convert", &small, &folder.path("none.video"), "--image-size", "none", "--quiet"]);
        assert!(swm_json(&["inspect", &folder.path("none.video")])["columns"]["pixels"].is_null());
    }
}

#[test]
fn datasets_that_do_not_say_how_they_were_made_are_refused() {
    let schema = Schema::new(vec![swm::core::Field::step("action", swm::core::Dtype::F32, &[2])]).unwrap();
    let foreign = MemoryDataset::new("foreign", schema, None, []).unwrap();
    let error = Rendered::new(foreign.share(), &swm::registry(), &options()).err().unwrap().to_string();
    assert!(error.contains("does not say how it was recorded"), "{error}");
}
