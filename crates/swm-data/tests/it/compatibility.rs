//! Sources of a copy that do not belong into one dataset: refused before anything is written or replaced.

use std::fs;
use std::path::Path;

use serde_json::json;
use swm_core::Metadata;
use swm_data::tools::copy::{all, copy};
use swm_data::{DataError, WriteMode, WriteOptions, create, open};

use crate::support::{episode, metadata, record, schema};

fn write(path: &Path, metadata: &Metadata) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let mut writer = create(path, WriteMode::Append, None)?;
    writer.begin(&schema(), metadata)?;
    writer.write_episode(&episode(&schema(), 0, 3))?;
    writer.finish()
}

fn merge(sources: &[&Path], to: &Path, options: &WriteOptions) -> Result<usize, DataError> {
    let mut sources: Vec<_> = sources.iter().map(|path| open(path).unwrap()).collect();
    let pieces = all(&sources);
    Ok(copy(&mut sources, &pieces, to, (None, options), &mut |_| {})?.episodes)
}

#[test]
fn recordings_of_other_settings_are_refused_before_anything_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (first, target) = (path("first.h5"), path("target.h5"));
    write(&first, &metadata()).unwrap();
    let mut damped = metadata();
    damped.settings.insert("damping".to_owned(), json!(0.5));
    damped.settings.insert("mode".to_owned(), json!("soft"));
    let others = [
        (
            damped.clone(),
            "it was recorded with damping=0.5, mode=soft",
            "first.h5 was recorded with the default settings",
        ),
        (
            Metadata { env: "swm/Other-v1".into(), ..metadata() },
            "it was recorded in swm/Other-v1",
            "first.h5 was recorded in swm/Test-v1",
        ),
        (
            Metadata { frame_skip: 4, ..metadata() },
            "it was recorded with frame skip 4",
            "first.h5 was recorded with frame skip ",
        ),
        (Metadata::unknown(), "it does not say how it was recorded", "first.h5 was recorded in swm/Test-v1"),
    ];
    for (index, (other, here, there)) in others.iter().enumerate() {
        let second = path(&format!("second{index}.h5"));
        write(&second, other).unwrap();
        for mode in [WriteMode::Append, WriteMode::Overwrite] {
            let message = merge(&[&first, &second], &target, &mode.into()).unwrap_err().to_string();
            for part in
                [&format!("second{index}.h5: {here}"), *there, "merge only datasets of the same environment"]
            {
                assert!(message.contains(part), "no `{part}` in {message}");
            }
            assert!(!target.exists());
        }
        // A target that is there stays.
        let held = path(&format!("held{index}.h5"));
        record(&held, WriteMode::Append, 5..7).unwrap();
        let before = fs::read(&held).unwrap();
        merge(&[&first, &second], &held, &WriteMode::Overwrite.into()).unwrap_err();
        assert!(fs::read(&held).unwrap() == before);
    }
    let message = write(&first, &damped).unwrap_err().to_string();
    let part =
        "it was recorded with the default settings, what is added was recorded with damping=0.5, mode=soft";
    assert!(message.contains(part), "{message}");
}

#[test]
fn another_rate_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let at = |name: &str, rows_per_second| {
        write(&path(name), &Metadata { rows_per_second, ..metadata() }).unwrap();
        path(name)
    };
    let (slow, fast, target) = (at("slow.h5", Some(10.0)), at("fast.h5", Some(30.0)), path("target.mcap"));
    let append = WriteOptions::default();
    for (sources, told) in [
        ([&*slow, &*fast], "fast.h5: it has 30 rows per second, "),
        ([&*fast, &*slow], "slow.h5: it has 10 rows per second, "),
    ] {
        for mode in [WriteMode::Append, WriteMode::Overwrite] {
            let message = merge(&sources, &target, &mode.into()).unwrap_err().to_string();
            assert!(message.contains(told) && message.contains("`fps` decides"), "{message}");
            assert!(!target.exists());
        }
    }
    // One computed in another way, and one of which nothing is known, are not others.
    let (near, unknown) = (at("near.h5", Some(1.0 / (0.02 * 5.0))), at("unknown.h5", None));
    assert_eq!(merge(&[&slow, &near, &unknown], &path("near.mcap"), &append).unwrap(), 3);
    for to in [target, path("target.h5")] {
        assert_eq!(merge(&[&slow, &fast], &to, &append.clone().frames_per_second(Some(20.0))).unwrap(), 2);
        assert_eq!(open(&to).unwrap().metadata().unwrap().rows_per_second, Some(20.0));
    }
}

#[test]
fn a_file_of_messages_says_the_rate_of_its_messages() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (source, target) = (path("source.h5"), path("target.mcap"));
    write(&source, &Metadata { rows_per_second: Some(10.0), ..metadata() }).unwrap();
    let said = |path: &Path| -> Vec<_> {
        open(path).unwrap().info().runs.iter().map(|(_, run)| run.rows_per_second).collect()
    };
    let at = |rate| WriteOptions::default().frames_per_second(rate);
    assert_eq!(merge(&[&source], &target, &at(Some(30.0))).unwrap(), 1);
    assert_eq!(said(&target), [Some(30.0)]);
    let text = |path: &Path| String::from_utf8_lossy(&fs::read(path).unwrap()).into_owned();
    let written = text(&target);
    assert!(written.contains("\"rows_per_second\":30") && !written.contains("\"rows_per_second\":10"));
    // Times go on at the rate of the file, whatever the record of new episodes says.
    write(&target, &Metadata { rows_per_second: Some(10.0), ..metadata() }).unwrap();
    assert_eq!((open(&target).unwrap().num_episodes(), said(&target)), (2, vec![Some(30.0)]));
    // Without the option, the rate of the source stays.
    assert_eq!(merge(&[&source], &path("same.mcap"), &at(None)).unwrap(), 1);
    assert_eq!(said(&path("same.mcap")), [Some(10.0)]);
    // Formats without time stamps say it in their record.
    for (name, rate) in [("copy.h5", Some(30.0)), ("copy.folder", Some(30.0)), ("same.h5", None)] {
        assert_eq!(merge(&[&source], &path(name), &at(rate)).unwrap(), 1);
        let copy = open(&path(name)).unwrap();
        assert_eq!(copy.metadata().unwrap().rows_per_second, rate.or(Some(10.0)), "{name}");
    }
}
