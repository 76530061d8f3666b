//! Folders of LeRobot with several cameras, tasks and rewards: what has to be asked, and what columns are called.

use std::fs;

use swm_core::{Column, FieldKind};
use swm_data::tools::copy::all;
use swm_data::{OpenOptions, WriteOptions};

use crate::copied;
use crate::golden;
use crate::published::{check, column_of, golden as published, lengths, opened, rows};
use crate::{copy, open};

const SAMPLE: &str = "lerobot061_av1";
const NAMES: &[(&str, &str, f64)] = &[
    ("observation.state", "proprio", 1.0),
    ("action", "action", 1.0),
    ("next.reward", "reward", 1.0),
    ("next.done", "terminated", 1.0),
];

fn camera(name: &str) -> OpenOptions {
    OpenOptions::default().camera(Some(name.to_owned()))
}

fn texts(column: Column) -> Vec<String> {
    match column {
        Column::Str(texts) => texts,
        other => panic!("{}", other.dtype()),
    }
}

#[test]
fn one_of_several_cameras_is_asked_for() {
    let refused = open(&published(SAMPLE)).err().unwrap().to_string();
    for part in ["`camera`", "several cameras, `observation.images.top`, `observation.images.wrist`"] {
        assert!(refused.contains(part), "{refused}");
    }
    let expected = fs::read(published(&format!("{SAMPLE}.expected.json"))).unwrap();
    let expected: serde_json::Value = serde_json::from_slice(&expected).unwrap();
    for (name, other) in [("top", "wrist"), ("images.wrist", "top"), ("observation.images.top", "wrist")] {
        let mut dataset = check(SAMPLE, &camera(name), NAMES);
        let short = name.rsplit('.').next().unwrap();
        let whole = format!("observation.images.{short}");
        assert!(dataset.info().mapping.contains(&("pixels".to_owned(), whole.clone())));
        assert!(
            dataset.schema().index(&format!("observation.images.{other}")).is_some(),
            "the other one stays"
        );
        let pixels = column_of(dataset.as_ref(), "pixels");
        let Column::U8(bytes) = rows(dataset.as_mut(), pixels, 1, 2, 1) else { panic!() };
        let mean = bytes.iter().map(|&byte| f64::from(byte)).sum::<f64>() / bytes.len() as f64;
        assert!((mean - expected["images"][&whole]["mean"].as_f64().unwrap()).abs() < 0.5, "{name}: {mean}");
    }
    for (wrong, word) in [("left", "no camera is called `left`; there are"), ("images", "no camera")] {
        let refused = opened(&published(SAMPLE), &camera(wrong)).err().unwrap().to_string();
        assert!(refused.contains(word), "{refused}");
    }
    let map = [("pixels", "observation.images.wrist"), ("state", "observation.state")];
    let map = map.map(|(new, old)| (new.to_owned(), old.to_owned())).into();
    let mapped = opened(&published(SAMPLE), &OpenOptions::default().map(map)).unwrap();
    for pair in [("pixels", "observation.images.wrist"), ("state", "observation.state")] {
        let pair = (pair.0.to_owned(), pair.1.to_owned());
        assert!(mapped.info().mapping.contains(&pair), "{:?}", mapped.info().mapping);
    }
    assert!(
        mapped.schema().index("proprio").is_none()
            && mapped.schema().index("observation.images.top").is_some()
    );
    // A folder with one camera needs no name of it.
    assert!(open(&golden("lerobot_v3.0")).unwrap().schema().index("pixels").is_some());
    let refused = opened(&published(SAMPLE), &camera("top").shift(Some(1))).err().unwrap().to_string();
    assert!(refused.contains("`shift`") && refused.contains("no use for it"), "{refused}");
}

/// Another camera would take the place of the one whose video is gone.
#[test]
fn a_damaged_video_is_no_reason_to_take_another_camera() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    copied(&published(SAMPLE), &path);
    let video = path.join("videos/observation.images.top/chunk-000/file-000.mp4");
    for damage in [None, Some(vec![7; 2000])] {
        match &damage {
            None => fs::remove_file(&video).unwrap(),
            Some(bytes) => fs::write(&video, bytes).unwrap(),
        }
        let refused = open(&path).err().unwrap().to_string();
        assert!(
            refused.contains("observation.images.top: ") && refused.contains("file-000.mp4"),
            "{refused}"
        );
        let chosen = opened(&path, &camera("wrist")).unwrap();
        assert_eq!(chosen.info().skipped[0].0, "observation.images.top");
        assert!(
            chosen.info().mapping.contains(&("pixels".to_owned(), "observation.images.wrist".to_owned()))
        );
    }
}

#[test]
fn tasks_are_texts_of_episodes_or_of_rows() {
    let mut dataset = opened(&published(SAMPLE), &camera("top")).unwrap();
    let task = column_of(dataset.as_ref(), "task");
    assert_eq!(dataset.schema().fields()[task].kind, FieldKind::Episode);
    for (episode, text) in ["push the block", "push the T", "push the block"].into_iter().enumerate() {
        assert_eq!(texts(rows(dataset.as_mut(), task, episode, 1, 3)), [text; 3]);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("several");
    copied(&golden("lerobot_v2.1"), &path);
    let several = "{\"episode_index\": 0, \"tasks\": [\"push the block\", \"wait\"], \"length\": 4}\n\
                   {\"episode_index\": 1, \"tasks\": [\"push the block\"], \"length\": 6}\n";
    fs::write(path.join("meta/episodes.jsonl"), several).unwrap();
    let mut dataset = open(&path).unwrap();
    let task = column_of(dataset.as_ref(), "task");
    assert_eq!(dataset.schema().fields()[task].kind, FieldKind::Step);
    assert_eq!(texts(rows(dataset.as_mut(), task, 1, 2, 2)), ["push the block"; 2]);
    fs::write(path.join("meta/tasks.jsonl"), "{\"task_index\": 7, \"task\": \"another\"}\n").unwrap();
    let mut dataset = open(&path).unwrap();
    let mut out = Column::zeros(swm_core::Dtype::Str, 1);
    let steps = swm_data::Steps { first: 0, count: 1, stride: 1 };
    let refused = dataset.rows(task, 0, steps, out.as_slice_mut()).unwrap_err().to_string();
    assert!(refused.contains("there is no task 0"), "{refused}");
    fs::remove_file(path.join("meta/tasks.jsonl")).unwrap();
    let dataset = open(&path).unwrap();
    assert!(dataset.schema().index("task").is_none());
    assert!(dataset.info().skipped.iter().any(|(name, _)| name == "task"), "{:?}", dataset.info().skipped);
}

#[test]
fn copies_keep_the_camera_that_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("copy.h5");
    let mut sources = [opened(&published(SAMPLE), &camera("wrist").fps(Some(30.0))).unwrap()];
    assert_eq!(OpenOptions::of(sources[0].info()), camera("wrist").fps(Some(30.0)));
    let pieces = all(&sources);
    copy(&mut sources, &pieces, &target, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
    let written = open(&target).unwrap();
    assert_eq!(lengths(written.as_ref()), [7, 6, 8]);
    let run = written.metadata().unwrap();
    let source = run.source.as_ref().unwrap();
    assert_eq!((&source["format"], &source["options"]["camera"]), (&"lerobot".into(), &"wrist".into()));
    assert_eq!(source["columns"]["pixels"], "observation.images.wrist");
    assert_eq!(source["columns"]["reward"], "next.reward");
    assert_eq!(run.rows_per_second, Some(30.0));
}
