//! The rate of rows: `fps`, timestamps, videos, and copies of folders where they do not agree.

use std::fs;
use std::path::Path;

use serde_json::{Value as Json, json};
use swm_core::Metadata;
use swm_data::tools::copy::all;
use swm_data::tools::verify::verify;
use swm_data::{DataError, WriteOptions};

use crate::copied;
use crate::golden;
use crate::support::{assert_same, contents, episode, metadata, schema};
use crate::{copy, create_with, open};

fn join(sources: &[&Path], to: &Path, fps: Option<f64>) -> Result<usize, DataError> {
    let mut sources: Vec<_> = sources.iter().map(|path| open(path).unwrap()).collect();
    let pieces = all(&sources);
    let options = WriteOptions::default().frames_per_second(fps);
    Ok(copy(&mut sources, &pieces, to, (None, &options), &mut |_| {})?.episodes)
}

fn info(path: &Path) -> Json {
    serde_json::from_slice(&fs::read(path.join("meta/info.json")).unwrap()).unwrap()
}

/// A copy of a golden folder, with another `fps`.
fn with_fps(version: &str, to: &Path, fps: Json) {
    copied(&golden(&format!("lerobot_{version}")), to);
    let mut changed = info(to);
    changed["fps"] = fps;
    fs::write(to.join("meta/info.json"), changed.to_string()).unwrap();
}

#[test]
fn a_wrong_fps_is_not_copied_silently() {
    let folder = tempfile::tempdir().unwrap();
    for version in ["v2.1", "v3.0"] {
        let path = |name: &str| folder.path().join(format!("{version}-{name}"));
        let (wrong, plain, repaired) = (path("wrong"), path("plain.h5"), path("repaired.lerobot"));
        with_fps(version, &wrong, json!(25));
        for to in [path("no.lerobot"), path("no.h5")] {
            let message = join(&[&wrong], &to, None).unwrap_err().to_string();
            for part in ["`fps` of meta/info.json is 25", "are those of 10 rows per second", "`fps` 10 takes"]
            {
                assert!(message.contains(part), "{version}: no `{part}` in {message}");
            }
            assert!(!to.exists());
        }
        let report = verify(open(&wrong).unwrap().as_mut(), &mut |_| {});
        let fix = "a copy with `fps` 10 repairs it";
        assert!(report.problems.iter().any(|problem| problem.reason.contains(fix)), "{:?}", report.problems);

        // Frames stay with their rows.
        for (a, b) in contents(&golden(&format!("lerobot_{version}"))).iter().zip(&contents(&wrong)) {
            assert_same(a, b);
        }
        assert_eq!(join(&[&wrong], &repaired, Some(10.0)).unwrap(), 2);
        assert_eq!(info(&repaired)["fps"], 10);
        assert_eq!(join(&[&repaired], &plain, None).unwrap(), 2);
        assert_eq!(open(&plain).unwrap().metadata().unwrap().rows_per_second, Some(10.0));

        // Small deviations are those of any recording.
        let near = path("near");
        with_fps(version, &near, json!(10.05));
        assert_eq!(join(&[&near], &path("near.h5"), None).unwrap(), 2);
    }
}

#[test]
fn folders_of_two_rates_are_not_joined_silently() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let [slow, fast] = [("slow.lerobot", 10.0), ("fast.lerobot", 30.0)].map(|(name, fps)| {
        let options = WriteOptions::default().frames_per_second(Some(fps));
        let mut writer = create_with(&path(name), &options, None).unwrap();
        // As recorded before copies said their rate.
        writer.begin(&schema(), &Metadata { rows_per_second: Some(10.0), ..metadata() }).unwrap();
        writer.write_episode(&episode(&schema(), 0, 3)).unwrap();
        writer.finish().unwrap();
        path(name)
    });
    for to in ["both.lerobot", "both.h5"].map(path) {
        let message = join(&[&slow, &fast], &to, None).unwrap_err().to_string();
        let (here, there) = ("fast.lerobot: it has 30 rows per second, ", "slow.lerobot 10; `fps` decides");
        assert!(message.contains(here) && message.contains(there), "{message}");
        assert!(!to.exists());
        assert_eq!(join(&[&slow, &fast], &to, Some(10.0)).unwrap(), 2);
    }
    assert_eq!(info(&path("both.lerobot"))["fps"], 10);
    assert_eq!(join(&[&fast], &path("again.lerobot"), None).unwrap(), 1);
    assert_eq!(info(&path("again.lerobot"))["fps"], 30);
}

#[test]
fn a_folder_without_its_description_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let [empty, cut] = ["empty.lerobot", "cut.lerobot"].map(|name| folder.path().join(name));
    fs::create_dir(&empty).unwrap();
    copied(&golden("lerobot_v3.0"), &cut);
    fs::remove_file(cut.join("meta/info.json")).unwrap();
    for path in [empty, cut] {
        let message = open(&path).err().expect("it is refused").to_string();
        assert!(message.contains("meta/info.json is missing"), "{message}");
    }
}

#[test]
fn a_rate_that_no_source_has_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for (source, known) in [("unknown.h5", None), ("known.h5", Some(10.0))] {
        let mut writer = create_with(&path(source), &WriteOptions::default(), None).unwrap();
        writer.begin(&schema(), &Metadata { rows_per_second: known, ..metadata() }).unwrap();
        writer.write_episode(&episode(&schema(), 0, 3)).unwrap();
        writer.finish().unwrap();
        let assumed = |to: &str, fps: Option<f64>| {
            let mut sources = vec![open(&path(source)).unwrap()];
            let options = WriteOptions::default().frames_per_second(fps);
            let to = path(&format!("{source}-{fps:?}-{to}"));
            copy(&mut sources, &[(0, 0)], &to, (None, &options), &mut |_| {}).unwrap().assumed_rate
        };
        assert_eq!(assumed("a.lerobot", None), known.is_none().then_some(25.0), "{source}");
        assert_eq!(assumed("a.mcap", None).is_some(), known.is_none(), "{source}");
        assert_eq!(assumed("a.h5", None), None, "{source}: this format needs none");
        for to in ["b.lerobot", "b.mcap", "b.h5"] {
            assert_eq!(assumed(to, Some(20.0)), None, "{source}: it is given");
        }
    }
}
