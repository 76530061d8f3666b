//! Sound files of other programs that differ from the samples: what has no place in a dataset is left out with the reason, and nothing of
//! it is damage.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use serde_json::json;
use swm_core::SliceMut;
use swm_data::tools::copy::{all, copy};
use swm_data::tools::verify::verify;
use swm_data::{Dataset, OpenOptions, Steps, WriteOptions};

use crate::published::{column_of, golden, lengths, numbers, opened, rows};
use crate::zarr::{Files, floats};
use crate::{copied, open};

pub(crate) fn has_note(dataset: &dyn Dataset, text: &str) -> bool {
    dataset.info().notes.iter().any(|note| note.contains(text))
}

pub(crate) fn why_skipped(dataset: &dyn Dataset, name: &str) -> String {
    let found = dataset.info().skipped.iter().find(|(skipped, _)| skipped == name);
    found.unwrap_or_else(|| panic!("`{name}` is not left out: {:?}", dataset.info().skipped)).1.clone()
}

/// Writes an array of an HDF5 file.
pub(crate) fn put<T: hdf5_metno::H5Type>(file: &hdf5_metno::File, name: &str, shape: &[usize], values: &[T]) {
    let array = file.new_dataset::<T>().shape(shape).create(name).unwrap();
    if !values.is_empty() {
        array.write_raw(values).unwrap();
    }
}

#[test]
fn episodes_without_rows_are_left_out_with_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    let file = hdf5_metno::File::create(&path).unwrap();
    for (name, rows) in [("demo_0", 2), ("demo_1", 0), ("demo_2", 3)] {
        file.create_group(&format!("data/{name}/obs")).unwrap();
        let values: Vec<f64> = (0..rows).map(|row| row as f64).collect();
        put(&file, &format!("data/{name}/actions"), &[rows, 1], &values);
        put(&file, &format!("data/{name}/obs/x"), &[rows], &values);
    }
    drop(file);
    let store = Files::new(folder.path().join("a.zarr"), &[2, 2, 5]);
    let about = json!({ "shape": [5], "chunks": [5], "dtype": "<f4" });
    store.array("data/action", &about, &[("0", &floats([0.0, 1.0, 0.0, 1.0, 2.0]))]);
    for path in [path, store.0] {
        let mut dataset = open(&path).unwrap();
        assert_eq!(lengths(dataset.as_ref()), [2, 3], "{}", path.display());
        assert!(has_note(dataset.as_ref(), "1 of its 3 episodes have no rows"), "{:?}", dataset.info().notes);
        let action = column_of(dataset.as_ref(), "action");
        assert_eq!(numbers(&rows(dataset.as_mut(), action, 1, 0, 3)), [0.0, 1.0, 2.0]);
        assert!(verify(dataset.as_mut(), &mut |_| {}).problems.is_empty());
    }
}

#[test]
fn columns_without_values_that_a_dataset_can_have_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let store = Files::new(folder.path().join("a.zarr"), &[2, 3]);
    let about = |dtype: &str| json!({ "shape": [3], "chunks": [3], "dtype": dtype });
    store.array("data/action", &about("<f4"), &[("0", &floats([0.0, 1.0, 2.0]))]);
    store.array("data/none", &json!({ "shape": [3, 0], "chunks": [3, 1], "dtype": "<f4" }), &[]);
    let large: Vec<u8> = [1, 2, 1_u64 << 63].iter().flat_map(|value| value.to_le_bytes()).collect();
    store.array("data/large", &about("<u8"), &[("0", &large)]);
    store.array("data/small", &about("<u8"), &[("0", &large[..8].repeat(3))]);
    let hdf5 = folder.path().join("traj.h5");
    let file = hdf5_metno::File::create(&hdf5).unwrap();
    file.create_group("traj_0").unwrap();
    put(&file, "traj_0/actions", &[3], &[0.0_f32, 1.0, 2.0]);
    put(&file, "traj_0/large", &[3], &[1, 2, 1_u64 << 63]);
    put(&file, "traj_0/none", &[3, 0], &[0_f32; 0]);
    put(&file, "traj_0/small", &[3], &[1_u64; 3]);
    drop(file);
    for path in [store.0, hdf5] {
        let mut dataset = open(&path).unwrap();
        assert!(!why_skipped(dataset.as_ref(), "none").is_empty());
        assert!(why_skipped(dataset.as_ref(), "large").contains("the u64 9223372036854775808"));
        let small = column_of(dataset.as_ref(), "small");
        assert_eq!(numbers(&rows(dataset.as_mut(), small, 0, 0, 2)), [1.0, 1.0]);
        let (copied, mut sources) = (path.with_extension("copy.h5"), [dataset]);
        let pieces = all(&sources);
        copy(&mut sources, &pieces, &copied, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
    }
}

/// Writes arrays as `numpy.savez` does: name, type, shape, bytes.
pub(crate) fn npz(path: &Path, arrays: &[(&str, &str, &[usize], Vec<u8>)]) {
    let mut archive = zip::ZipWriter::new(fs::File::create(path).unwrap());
    let options = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, descriptor, shape, bytes) in arrays {
        archive.start_file(format!("{name}.npy"), options).unwrap();
        let sizes: String = shape.iter().map(|size| format!("{size},")).collect();
        let text = format!("{{'descr': '{descriptor}', 'fortran_order': False, 'shape': ({sizes}), }}");
        archive.write_all(b"\x93NUMPY\x01\x00\x76\x00").unwrap();
        archive.write_all(format!("{text:<117}\n").as_bytes()).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap();
}

fn put_npz(path: &Path, descriptor: &str, rows: usize, bytes: &[u8]) {
    npz(path, &[("arr_0", descriptor, &[rows], bytes.to_vec())]);
}

/// Opening looks at the first values only: it takes no longer for a larger file.
#[test]
fn a_number_too_large_far_behind_is_an_error_where_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let mut values: Vec<u64> = (0..70_000).map(|row| row + (1 << 40)).collect();
    values[69_998] = 1 << 63;
    let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();

    let flat = folder.path().join("flat.h5");
    let file = hdf5_metno::File::create(&flat).unwrap();
    put(&file, "count", &[70_000], &values);
    put(&file, "ep_len", &[2], &[60_000_i32, 10_000]);
    put(&file, "ep_offset", &[2], &[0_i64, 60_000]);
    drop(file);
    let grouped = folder.path().join("traj.h5");
    let file = hdf5_metno::File::create(&grouped).unwrap();
    for (name, rows) in [("traj_0", 0..60_000), ("traj_1", 60_000..70_000)] {
        file.create_group(name).unwrap();
        put(&file, &format!("{name}/actions"), &[rows.len()], &vec![0.0_f32; rows.len()]);
        put(&file, &format!("{name}/count"), &[rows.len()], &values[rows]);
    }
    drop(file);
    let store = Files::new(folder.path().join("a.zarr"), &[60_000, 70_000]);
    let chunks: Vec<(String, &[u8])> =
        bytes.chunks(80_000).enumerate().map(|(at, chunk)| (at.to_string(), chunk)).collect();
    let chunks: Vec<(&str, &[u8])> = chunks.iter().map(|(name, chunk)| (&**name, *chunk)).collect();
    store.array("data/count", &json!({ "shape": [70_000], "chunks": [10_000], "dtype": "<u8" }), &chunks);
    let arrays = folder.path().join("arrays");
    fs::create_dir(&arrays).unwrap();
    put_npz(&arrays.join("count.npz"), "<u8", 70_000, &bytes);
    put_npz(&arrays.join("ep_len.npz"), "<i4", 2, &[60_000_i32, 10_000].map(i32::to_le_bytes).concat());
    put_npz(&arrays.join("ep_offset.npz"), "<i8", 2, &[0_i64, 60_000].map(i64::to_le_bytes).concat());

    for path in [flat, grouped, store.0, arrays] {
        let mut dataset = open(&path).unwrap();
        let count = column_of(dataset.as_ref(), "count");
        let mut read = |episode, first, rows| {
            let mut out = vec![0; rows];
            let steps = Steps { first, count: rows, stride: 1 };
            let read = dataset.read_column(count, episode, steps, SliceMut::I64(&mut out));
            read.map(|()| out).map_err(|error| error.to_string())
        };
        let expected = |from: i64, to: i64| Ok((from..to).map(|row| row + (1 << 40)).collect::<Vec<_>>());
        assert_eq!(read(0, 0, 60_000), expected(0, 60_000), "{}", path.display());
        assert_eq!(read(1, 0, 9_998), expected(60_000, 69_998), "{}", path.display());
        assert_eq!(read(1, 9_999, 1), expected(69_999, 70_000), "{}", path.display());
        let message = read(1, 9_000, 1_000).unwrap_err();
        for part in ["`count`", "episode 1", "row 9998: it holds the u64 9223372036854775808"] {
            assert!(message.contains(part) && !message.contains("damaged"), "{part}: {message}");
        }
    }
}

#[test]
fn a_store_of_which_no_array_can_be_read_is_not_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let store = Files::new(folder.path().join("a.zarr"), &[2, 3]);
    let about = json!({ "shape": [3], "chunks": [3], "dtype": "<f4", "compressor": { "id": "bz2" } });
    store.array("data/action", &about, &[("0", b"BZh")]);
    let message = open(&store.0).err().unwrap().to_string();
    assert!(message.contains("codec `bz2`") && !message.contains("damaged"), "{message}");
}

/// What other programs wrote is as they wrote it, and copies of it are no worse.
#[test]
fn numbers_of_others_may_be_missing_or_infinite() {
    let folder = tempfile::tempdir().unwrap();
    let store = Files::new(folder.path().join("a.zarr"), &[4]);
    let about = json!({ "shape": [4], "chunks": [4], "dtype": "<f4" });
    store.array("data/action", &about, &[("0", &floats([0.0, f32::NAN, f32::INFINITY, 3.0]))]);
    store.array("data/reward", &about, &[("0", &floats([0.0, f32::NAN, 1.0, f32::NEG_INFINITY]))]);
    let copied = folder.path().join("a.h5");
    let mut sources = [open(&store.0).unwrap()];
    let pieces = all(&sources);
    copy(&mut sources, &pieces, &copied, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
    for path in [store.0, copied] {
        let report = verify(open(&path).unwrap().as_mut(), &mut |_| {});
        assert_eq!(report.problems, [], "{}", path.display());
        let notes = report.notes.join("\n");
        assert!(notes.contains("`reward` is NaN in 1 of 4 rows"), "{notes}");
        assert!(notes.contains("`action` holds infinite numbers, first in episode 0, row 2"), "{notes}");
    }
}

/// Rows in which terminals follow each other are at the goal of a maze, or episodes of one row.
#[test]
fn terminals_in_a_row_end_episodes_where_observations_begin_anew() {
    let folder = tempfile::tempdir().unwrap();
    let terminals = [false, false, true, true, false, false, true, false];
    let write = |name: &str, observations: &[f32]| {
        let path = folder.path().join(name);
        let file = hdf5_metno::File::create(&path).unwrap();
        put(&file, "observations", &[8, 1], observations);
        put(&file, "actions", &[8, 1], &[0.5_f32; 8]);
        put(&file, "rewards", &[8], &[0.0_f32; 8]);
        put(&file, "terminals", &[8], &terminals);
        put(&file, "timeouts", &[8], &[false, false, false, false, false, false, false, true]);
        drop(file);
        open(&path).unwrap()
    };
    let anew = write("hopper-medium-replay-v2.hdf5", &[0.0, 1.0, 2.0, 9.0, 0.0, 1.0, 2.0, 9.0]);
    assert_eq!(lengths(anew.as_ref()), [3, 1, 3, 1]);
    assert!(anew.schema().index("terminated").is_some());
    let on = write("maze.hdf5", &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
    assert_eq!(lengths(on.as_ref()), [8]);
    let published = "Ant_maze_u-maze_noisy_multistart_False_multigoal_False.hdf5";
    let named = write(published, &[0.0, 1.0, 2.0, 9.0, 0.0, 1.0, 2.0, 9.0]);
    assert_eq!(lengths(named.as_ref()), [8]);
    assert!(named.schema().index("terminated").is_none());
}

/// Observations that go on slowly, or begin anew near the last one, tell nothing; `next_observations` do.
#[test]
fn terminals_in_a_row_are_ends_by_the_observations_behind_them() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, observations: &[f32], next: &[f32]| {
        let path = folder.path().join(name);
        let file = hdf5_metno::File::create(&path).unwrap();
        put(&file, "observations", &[6, 1], observations);
        put(&file, "next_observations", &[6, 1], next);
        put(&file, "actions", &[6, 1], &[0.5_f32; 6]);
        put(&file, "rewards", &[6], &[0.0_f32; 6]);
        put(&file, "terminals", &[6], &[true, true, false, true, true, false]);
        put(&file, "timeouts", &[6], &[false, false, false, false, false, true]);
        drop(file);
        open(&path).unwrap()
    };
    // Every episode begins near 0, and every step is 9.
    let anew = write("short.hdf5", &[0.0, 0.1, 0.2, 9.2, 0.0, 0.1], &[9.0, 9.1, 9.2, 18.2, 9.0, 9.1]);
    assert_eq!(lengths(anew.as_ref()), [2, 2, 3, 2, 2]);
    assert!(anew.schema().index("terminated").is_some());
    // Observations jump, as the next ones do.
    let on =
        write("jumps.hdf5", &[0.0, 50.0, 60.0, 61.0, 120.0, 190.0], &[50.0, 60.0, 61.0, 120.0, 190.0, 191.0]);
    assert_eq!(lengths(on.as_ref()), [7]);
    assert!(on.schema().index("terminated").is_none());
}

#[test]
fn other_tensors_of_dinowm_are_columns_or_left_out_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pusht_noise");
    copied(&golden("dinowm_pusht_noise"), &path);
    let part = path.join("train");
    fs::copy(part.join("rel_actions.pth"), part.join("rewards.pth")).unwrap();
    fs::write(part.join("notes.pth"), "a text").unwrap();
    rename(&part.join("obses"), "episode_000.mp4", "episode_00000.mp4");
    let mut dataset = opened(&path, &OpenOptions::default()).unwrap();
    let [reward, action] = ["rewards", "action"].map(|name| column_of(dataset.as_ref(), name));
    let [first, scaled] = [reward, action].map(|column| numbers(&rows(dataset.as_mut(), column, 0, 0, 1))[0]);
    assert!((first / 100.0 - scaled).abs() < 1e-6, "{first} {scaled}");
    assert!(why_skipped(dataset.as_ref(), "notes").contains("zip"));
    assert!(why_skipped(dataset.as_ref(), "pixels").contains("`episode_000.mp4`"));
}

fn rename(folder: &Path, old: &str, new: &str) {
    fs::rename(folder.join(old), folder.join(new)).unwrap();
}

/// Writes a file of robomimic: arrays of each episode by `fill`.
pub(crate) fn robomimic(path: &Path, episodes: usize, fill: impl Fn(&hdf5_metno::File, &str, usize)) {
    let file = hdf5_metno::File::create(path).unwrap();
    for episode in 0..episodes {
        let group = format!("data/demo_{episode}");
        file.create_group(&format!("{group}/obs")).unwrap();
        put(&file, &format!("{group}/actions"), &[3, 1], &[0.0, 1.0, 2.0]);
        put(&file, &format!("{group}/obs/x"), &[3], &[3.0, 4.0, 5.0]);
        fill(&file, &group, episode);
    }
}

#[test]
fn rewards_and_marks_of_one_value_are_scalars() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 2, |file, group, _| {
        put(file, &format!("{group}/rewards"), &[3, 1], &[0.0_f32, 0.5, 1.0]);
        put(file, &format!("{group}/dones"), &[3, 1], &[false, false, true]);
        put(file, &format!("{group}/terminated"), &[3, 1], &[false, false, true]);
    });
    let mut dataset = open(&path).unwrap();
    for name in ["reward", "truncated", "success", "terminated"] {
        let column = column_of(dataset.as_ref(), name);
        assert_eq!(dataset.schema().fields()[column].shape, [0_usize; 0], "{name}");
    }
    let reward = column_of(dataset.as_ref(), "reward");
    assert_eq!(numbers(&rows(dataset.as_mut(), reward, 1, 0, 3)), [0.0, 0.5, 1.0]);
}

#[test]
fn arrays_of_some_episodes_only_have_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 3, |file, group, episode| {
        if episode == 1 {
            put(file, &format!("{group}/obs/late"), &[3], &[7_i64, 8, 9]);
        }
    });
    let mut dataset = open(&path).unwrap();
    let note = "`obs/late` is not in 2 of its 3 episodes, the first of which is 0";
    assert!(has_note(dataset.as_ref(), note), "{:?}", dataset.info().notes);
    assert!(!has_note(dataset.as_ref(), "`obs/x` is not"), "{:?}", dataset.info().notes);
    let late = column_of(dataset.as_ref(), "obs.late");
    assert_eq!(numbers(&rows(dataset.as_mut(), late, 0, 0, 1)), [-1.0]);
    assert_eq!(numbers(&rows(dataset.as_mut(), late, 1, 0, 1)), [7.0]);
}

#[test]
fn links_by_name_are_left_out_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 2, |file, group, _| {
        let group = file.group(group).unwrap();
        group.link_soft("x", "obs/same").unwrap();
        group.link_soft("obs", "seen").unwrap();
    });
    let dataset = open(&path).unwrap();
    for name in ["obs.same", "seen"] {
        assert!(why_skipped(dataset.as_ref(), name).contains("copy what it leads to"), "{name}");
    }
    assert!(dataset.schema().index("obs.x").is_some());
}

#[test]
fn lengths_of_dinowm_in_another_pickle_are_refused_with_the_fix() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pusht_noise");
    copied(&golden("dinowm_pusht_noise"), &path);
    // What `pickle.dumps(numpy.array([12, 9]), 4)` begins with.
    let array = b"\x80\x04\x95\x8a\0\0\0\0\0\0\0\x8c\x16numpy._core.multiarray\x94\x8c\x0c_reconstruct\x94\x93\x94\x8c\x05numpy\x94\x8c\x07ndarray\x94\x93\x94K\0\x85\x94C\x01b\x94\x87\x94R\x94.";
    fs::write(path.join("train/seq_lengths.pkl"), array).unwrap();
    let error = opened(&path, &OpenOptions::default()).map(drop).unwrap_err().to_string();
    assert!(error.contains("store a list of whole numbers: pickle.dump("), "{error}");
}
