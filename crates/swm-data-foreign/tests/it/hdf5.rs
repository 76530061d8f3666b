//! HDF5 files of other programs that are sound and unusual: links, blocks of the user, instructions, episodes that cannot be read.

use std::fs;
use std::path::Path;

use serde_json::json;
use swm_core::{Column, FieldKind};
use swm_data::{DataError, OpenOptions};

use crate::open;
use crate::partial::values;
use crate::published::{column_of, lengths, numbers, opened, rows};
use crate::refused::{message, split};
use crate::varied::{has_note, put, robomimic, why_skipped};

/// Demonstrations of robomimic with the joints of LIBERO: rows of each, rows that the observations are late, and how far a step moves.
fn joints(path: &Path, demos: &[(usize, usize, f64)]) {
    let file = hdf5_metno::File::create(path).unwrap();
    for (demo, &(rows, late, far)) in demos.iter().enumerate() {
        file.create_group(&format!("data/demo_{demo}/obs")).unwrap();
        let at = |row: usize| std::iter::repeat_n(row as f64 * far, 7);
        let seen: Vec<f64> = (0..rows).flat_map(|row| at(row + late)).collect();
        let states: Vec<f64> = (0..rows).flat_map(|row| std::iter::once(0.0).chain(at(row))).collect();
        let actions: Vec<f64> = (0..rows).map(|row| row as f64).collect();
        put(&file, &format!("data/demo_{demo}/obs/joint_states"), &[rows, 7], &seen);
        put(&file, &format!("data/demo_{demo}/states"), &[rows, 8], &states);
        put(&file, &format!("data/demo_{demo}/actions"), &[rows, 1], &actions);
    }
}

#[test]
fn demonstrations_that_do_not_show_the_shift_leave_it_to_others() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("demo.hdf5");
    let first = |options: &OpenOptions| {
        let mut dataset = opened(&path, options)?;
        let action = column_of(dataset.as_ref(), "action");
        let last = dataset.num_episodes() - 1;
        Ok::<_, DataError>(numbers(&rows(dataset.as_mut(), action, last, 0, 1))[0])
    };
    // Of one row, without movement, late; and the same aligned.
    joints(&path, &[(1, 1, 1.0), (4, 1, 0.0), (6, 1, 1.0)]);
    assert_eq!(first(&OpenOptions::default()).unwrap(), 1.0);
    joints(&path, &[(1, 0, 1.0), (4, 0, 0.0), (6, 0, 1.0)]);
    assert_eq!(first(&OpenOptions::default()).unwrap(), 0.0);
    joints(&path, &[(1, 1, 1.0), (4, 1, 0.0)]);
    let message = first(&OpenOptions::default()).unwrap_err().to_string();
    assert!(
        message.contains("`shift`") && message.contains("before its action (0) or after it"),
        "{message}"
    );
    assert_eq!(first(&OpenOptions::default().shift(Some(1))).unwrap(), 1.0);
}

#[test]
fn files_behind_a_block_of_the_user_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    for is_new in [false, true] {
        let mut builder = hdf5_metno::FileBuilder::new();
        builder.with_fcpl(|made| made.userblock(512));
        builder.with_fapl(|access| if is_new { access.libver_latest() } else { access.libver_earliest() });
        let file = builder.create(&path).unwrap();
        file.create_group("data/demo_0/obs").unwrap();
        put(&file, "data/demo_0/actions", &[3, 1], &[0.0, 1.0, 2.0]);
        let text = |text: &str| text.parse::<hdf5_metno::types::VarLenUnicode>().unwrap();
        put(&file, "data/demo_0/obs/text", &[3], &["a", "bc", "d"].map(text));
        let chunked =
            file.new_dataset::<i32>().shape((3, 2)).chunk((2, 2)).deflate(3).create("data/demo_0/obs/x");
        chunked.unwrap().write_raw(&[1, 2, 3, 4, 5, 6]).unwrap();
        drop(file);
        assert_eq!(fs::read(&path).unwrap()[..8], [0; 8]);
        let mut dataset = opened(&path, &OpenOptions::default()).unwrap();
        let mut read = |name: &str| {
            let column = column_of(dataset.as_ref(), name);
            rows(dataset.as_mut(), column, 0, 1, 2)
        };
        assert_eq!(numbers(&read("action")), [1.0, 2.0]);
        assert_eq!(numbers(&read("obs.x")), [3.0, 4.0, 5.0, 6.0]);
        // Addresses of texts of any length count from the end of the block.
        assert!(!why_skipped(dataset.as_ref(), "obs.text").is_empty());
        fs::remove_file(&path).unwrap();
    }
}

#[test]
fn episodes_that_are_links_are_noted_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("merged.hdf5");
    robomimic(&path, 1, |file, group, _| {
        let data = file.group("data").unwrap();
        data.link_external("other.hdf5", "/data/demo_0", "demo_10").unwrap();
        data.link_soft(&format!("/{group}"), "demo_2").unwrap();
    });
    let dataset = open(&path).unwrap();
    assert_eq!(lengths(dataset.as_ref()), [3]);
    let note = "2 of its 3 episodes are soft or external links, which are not followed; the first of them is `demo_2`";
    assert!(has_note(dataset.as_ref(), note), "{:?}", dataset.info().notes);
    for (group, name) in [("data", "demo_0"), ("/", "traj_0"), ("/", "episode_0")] {
        let path = folder.path().join(format!("{name}.hdf5"));
        let file = hdf5_metno::File::create(&path).unwrap();
        let group = if group == "/" { file.group("/").unwrap() } else { file.create_group(group).unwrap() };
        group.link_external("other.hdf5", "/data/demo_0", name).unwrap();
        drop((group, file));
        let message = open(&path).err().unwrap().to_string();
        let parts = ["cannot read", "1 of its 1 episodes are soft or external links", name, "group.copy("];
        assert!(parts.iter().all(|part| message.contains(part)), "{message}");
    }
}

#[test]
fn texts_that_are_bytes_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 2, |file, group, _| {
        let bytes = |text: &[u8]| hdf5_metno::types::FixedAscii::<4>::from_ascii(text).unwrap();
        put(file, &format!("{group}/obs/word"), &[3], &[b"abcd", b"bcde", b"cdef"].map(|text| bytes(text)));
        put(file, &format!("{group}/obs/raw"), &[3], &[b"QQQQ", b"QQQQ", b"QQQQ"].map(|text| bytes(text)));
    });
    let mut bytes = fs::read(&path).unwrap();
    while let Some(at) = bytes.windows(4).position(|part| part == b"QQQQ") {
        bytes[at..at + 4].copy_from_slice(b"\xff\xfe\0\x01");
    }
    fs::write(&path, bytes).unwrap();
    let dataset = open(&path).unwrap();
    assert!(why_skipped(dataset.as_ref(), "obs.raw").contains("are bytes and no text"));
    assert!(dataset.schema().index("obs.word").is_some());
}

#[test]
fn a_group_in_itself_is_refused_with_the_fix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 1, |file, group, _| {
        file.link_hard(group, &format!("{group}/obs/loop")).unwrap();
    });
    let error = message(&path, &OpenOptions::default());
    assert!(error.contains("obs/loop") && error.contains("`del group[name]`"), "{error}");
}

#[test]
fn arrays_that_are_links_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (format, names) in [
        ("d4rl", &["observations", "actions", "rewards", "terminals", "timeouts"][..]),
        ("aloha", &["action", "observations/qpos"]),
        ("robomimic", &["data/demo_0/actions"]),
    ] {
        let path = folder.path().join(format!("{format}.hdf5"));
        let file = hdf5_metno::File::create(&path).unwrap();
        file.create_group("real").unwrap();
        for (at, name) in names.iter().enumerate() {
            if let Some((group, _)) = name.rsplit_once('/') {
                file.create_group(group).unwrap();
            }
            put(&file, &format!("real/{at}"), &[2], &[0_f32; 2]);
            file.link_soft(&format!("/real/{at}"), name).unwrap();
        }
        drop(file);
        let error = message(&path, &OpenOptions::default());
        assert!(
            error.contains("soft or an external link") && error.contains("copy what it leads to"),
            "{error}"
        );
        assert!(!error.contains("without `rewards`") && !error.contains("damaged"), "{error}");
    }
}

/// Writes a text beside a group, as h5py does.
fn describe(file: &hdf5_metno::File, group: &str, name: &str, text: &str) {
    let group = file.group(group).unwrap();
    let text: hdf5_metno::types::VarLenUnicode = text.parse().unwrap();
    group.new_attr::<hdf5_metno::types::VarLenUnicode>().create(name).unwrap().write_scalar(&text).unwrap();
}

#[test]
fn instructions_of_robocasa_are_a_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("kitchen.hdf5");
    robomimic(&path, 3, |file, group, episode| {
        if episode != 1 {
            describe(file, group, "ep_meta", &json!({"lang": format!("task {episode}"), "x": 1}).to_string());
        }
    });
    let mut dataset = open(&path).unwrap();
    let language = column_of(dataset.as_ref(), "language");
    assert_eq!(dataset.schema().fields()[language].kind, FieldKind::Episode);
    for (episode, expected) in ["task 0", "", "task 2"].into_iter().enumerate() {
        let read = rows(dataset.as_mut(), language, episode, 0, 1);
        assert_eq!(read, Column::Str(vec![expected.to_owned()]), "{episode}");
    }
    assert!(has_note(dataset.as_ref(), "`ep_meta.lang` is not in 1 of its 3 episodes"));
}

#[test]
fn robomimic_may_have_the_last_observation_in_obs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    let file = hdf5_metno::File::create(&path).unwrap();
    file.create_group("data/demo_0/obs").unwrap();
    put(&file, "data/demo_0/actions", &[2, 1], &[1.0, 2.0]);
    put(&file, "data/demo_0/obs/x", &[3], &[3.0, 4.0, 5.0]);
    drop(file);
    let mut dataset = open(&path).unwrap();
    assert_eq!(values(dataset.as_mut(), "obs.x", 0), ["3", "4", "5"]);
    assert_eq!(values(dataset.as_mut(), "action", 0), ["1", "2", "NaN"]);
}

#[test]
fn demonstrations_that_cannot_be_read_are_refused_with_the_fix_or_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 2, |file, group, episode| {
        if episode == 1 {
            file.group(group).unwrap().unlink("actions").unwrap();
        } else {
            let names =
                ["demo_0", "demo_7"].map(|name| name.parse::<hdf5_metno::types::VarLenUnicode>().unwrap());
            file.create_group("mask").unwrap();
            put(file, "mask/train", &[2], &names);
        }
    });
    let error = message(&path, &OpenOptions::default());
    assert!(
        error.contains("`/data/demo_1`: it has no `actions`") && error.contains("delete the group"),
        "{error}"
    );
    assert!(!error.contains("damaged"), "{error}");
    let dataset = opened(&path, &split("train")).unwrap();
    let note = "`mask/train` names 1 episodes that are not read, the first of which is `demo_7`";
    assert!(has_note(dataset.as_ref(), note), "{:?}", dataset.info().notes);
}
