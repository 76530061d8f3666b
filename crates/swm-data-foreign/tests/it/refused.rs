//! What is left out, asked for or refused in datasets of other programs that are sound: with the right reason, the fix, and never as damage.

use std::fs;
use std::io::Write as _;
use std::path::Path;

use serde_json::json;
use swm_core::{Column, Dtype, SliceMut};
use swm_data::{Dataset, OpenOptions, Steps};

use crate::open;
use crate::partial::{Part, floats, values};
use crate::published::{column_of, lengths, opened, rows};
use crate::varied::{has_note, npz, put, robomimic, why_skipped};
use crate::zarr::Files;

pub(crate) fn message(path: &Path, options: &OpenOptions) -> String {
    opened(path, options).map(drop).unwrap_err().to_string()
}

pub(crate) fn split(name: &str) -> OpenOptions {
    OpenOptions::default().split(Some(name.to_owned()))
}

/// An archive of OGBench of so many rows, and what it has besides.
fn ogbench(path: &Path, rows: usize, more: Vec<Part<'_>>) {
    let ramp: Vec<f32> = (0..rows).map(|row| row as f32).collect();
    let mut ends = vec![0; rows];
    ends[rows - 1] = 1;
    let shape = [rows, 1];
    let mut parts: Vec<Part<'_>> = vec![
        ("observations", "<f4", &shape, floats(&ramp)),
        ("actions", "<f4", &shape, floats(&ramp)),
        ("terminals", "|b1", &shape[..1], ends),
    ];
    parts.extend(more);
    npz(path, &parts);
}

#[test]
fn parts_of_a_folder_of_ogbench_are_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join("cube-100m").join(name);
    fs::create_dir(path("")).unwrap();
    for (name, rows) in [("c-v0-000.npz", 2), ("c-v0-001.npz", 3), ("c-v0-000-val.npz", 4)] {
        ogbench(&path(name), rows, vec![]);
    }
    // What is beside it is of another dataset.
    ogbench(&folder.path().join("cube-100m-val.npz"), 7, vec![]);
    let whole = open(&path("")).unwrap();
    assert_eq!(lengths(whole.as_ref()), [2, 3]);
    assert!(has_note(whole.as_ref(), "1 files of it are the part `val`"), "{:?}", whole.info().notes);
    assert_eq!(lengths(opened(&path(""), &split("train")).unwrap().as_ref()), [2, 3]);
    assert_eq!(lengths(opened(&path(""), &split("val")).unwrap().as_ref()), [4]);
    assert!(message(&path(""), &split("test")).contains("there is no part `test`"));
    fs::remove_file(path("c-v0-000-val.npz")).unwrap();
    assert!(
        message(&path(""), &split("val")).contains("no files of this part, which are called `NAME-val.npz`")
    );
}

#[test]
fn rewards_of_ogbench_of_one_value_are_scalars() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    ogbench(&path, 3, vec![("rewards", "<f4", &[3, 1], floats(&[1.0, 2.0, 3.0]))]);
    let dataset = open(&path).unwrap();
    let reward = column_of(dataset.as_ref(), "reward");
    assert_eq!(dataset.schema().fields()[reward].shape, [0_usize; 0]);
}

/// Writes a tensor of bytes as `torch.save` does.
fn tensor(path: &Path, sizes: &[i32], bytes: &[u8]) {
    let text = |text: &str| [b"X", &(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
    let int = |value: i32| [b"J", &value.to_le_bytes()[..]].concat();
    let strides: Vec<i32> = (0..sizes.len()).map(|axis| sizes[axis + 1..].iter().product()).collect();
    let tuple = |values: &[i32]| {
        [b"(".to_vec(), values.iter().flat_map(|&value| int(value)).collect(), b"t".to_vec()].concat()
    };
    let pickled = [
        b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n((".to_vec(),
        text("storage"),
        b"ctorch\nByteStorage\n".to_vec(),
        text("0"),
        text("cpu"),
        int(bytes.len() as i32),
        b"tQ".to_vec(),
        int(0),
        tuple(sizes),
        tuple(&strides),
        b"\x89ccollections\nOrderedDict\n)RtR.".to_vec(),
    ];
    let mut archive = zip::ZipWriter::new(fs::File::create(path).unwrap());
    let stored = zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, bytes) in [("a/data.pkl", &pickled.concat()[..]), ("a/data/0", bytes)] {
        archive.start_file(name, stored).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap();
}

#[test]
fn images_of_deformable_scenes_are_in_folders_of_episodes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join("rope").join(name);
    tensor_folder(&path(""));
    let images: Vec<u8> = (0..3 * 8 * 8 * 3).map(|at| (at % 251) as u8).collect();
    for episode in ["000000", "000001"] {
        fs::create_dir(path(episode)).unwrap();
        tensor(&path(episode).join("obses.pth"), &[3, 8, 8, 3], &images);
    }
    let mut dataset = open(&path("")).unwrap();
    assert!(dataset.info().skipped.is_empty(), "{:?}", dataset.info().skipped);
    let pixels = column_of(dataset.as_ref(), "pixels");
    assert_eq!(rows(dataset.as_mut(), pixels, 1, 1, 2), Column::U8(images[192..].to_vec()));
}

/// States and actions of two episodes of three steps.
fn tensor_folder(path: &Path) {
    fs::create_dir(path).unwrap();
    tensor(&path.join("states.pth"), &[2, 3, 5, 4], &[1; 120]);
    tensor(&path.join("actions.pth"), &[2, 3, 4], &[2; 24]);
}

#[test]
fn files_of_aloha_may_be_called_h5() {
    let folder = tempfile::tempdir().unwrap();
    for episode in [0, 1] {
        let file = hdf5_metno::File::create(folder.path().join(format!("episode_{episode}.h5"))).unwrap();
        file.create_group("observations").unwrap();
        put(&file, "action", &[2, 1], &[1_f32; 2]);
        put(&file, "observations/qpos", &[2, 1], &[1_f32; 2]);
    }
    assert_eq!(lengths(open(folder.path()).unwrap().as_ref()), [2, 2]);
}

#[test]
fn numbers_of_a_wider_type_in_some_episodes_widen_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    let file = hdf5_metno::File::create(&path).unwrap();
    for demo in 0..2 {
        let name = |name: &str| format!("data/demo_{demo}/{name}");
        file.create_group(&name("obs")).unwrap();
        match demo {
            0 => put(&file, &name("actions"), &[2, 1], &[0.5_f32, 1.5]),
            _ => put(&file, &name("actions"), &[2, 1], &[0.1_f64, 0.2]),
        }
        match demo {
            0 => put(&file, &name("obs/count"), &[2], &[1_i64 << 40, 2]),
            _ => put(&file, &name("obs/count"), &[2], &[3_i32, 4]),
        }
        match demo {
            0 => put(&file, &name("obs/mixed"), &[2], &[1_i32, 2]),
            _ => put(&file, &name("obs/mixed"), &[2], &[1.5_f32, 2.0]),
        }
    }
    drop(file);
    let mut dataset = open(&path).unwrap();
    let dtype = |name: &str| dataset.schema().fields()[column_of(dataset.as_ref(), name)].dtype;
    assert_eq!((dtype("action"), dtype("obs.count")), (Dtype::F64, Dtype::I64));
    assert!(why_skipped(dataset.as_ref(), "obs.mixed").contains("store all in one type"));
    assert_eq!(values(dataset.as_mut(), "action", 0), ["0.5", "1.5"]);
    assert_eq!(values(dataset.as_mut(), "action", 1), ["0.1", "0.2"]);
    assert_eq!(values(dataset.as_mut(), "obs.count", 0), ["1099511627776", "2"]);
    assert_eq!(values(dataset.as_mut(), "obs.count", 1), ["3", "4"]);
}

/// The error of reading all rows of a column in the second episode.
fn unread(dataset: &mut dyn Dataset, name: &str) -> String {
    let (column, count) = (column_of(dataset, name), dataset.episode_len(1));
    let field = dataset.schema().fields()[column].clone();
    let mut out = Column::zeros(field.dtype, count * field.dim());
    let steps = Steps { first: 0, count, stride: 1 };
    dataset.rows(column, 1, steps, out.as_slice_mut()).unwrap_err().to_string()
}

#[test]
fn archives_of_other_types_are_widened_or_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let doubles: Vec<u8> = [0.1_f64, 0.2].iter().flat_map(|value| value.to_le_bytes()).collect();
    let extra = |wide: bool| -> Vec<Part<'_>> {
        vec![if wide { ("x", "<f8", &[2], doubles.clone()) } else { ("x", "<f4", &[2], floats(&[0.5, 1.5])) }]
    };
    for (name, wide) in [("a-0.npz", false), ("a-1.npz", true)] {
        ogbench(&folder.path().join(name), 2, extra(wide));
    }
    let mut dataset = open(folder.path()).unwrap();
    assert_eq!(values(dataset.as_mut(), "x", 0), ["0.5", "1.5"]);
    assert_eq!(values(dataset.as_mut(), "x", 1), ["0.1", "0.2"]);

    // Of episodes of Dreamer's agents, only the first is opened.
    for wide_first in [true, false] {
        let folder = tempfile::tempdir().unwrap();
        for (name, wide) in [("1.npz", wide_first), ("2.npz", !wide_first)] {
            let mut parts: Vec<Part<'_>> = vec![
                ("action", "<f4", &[2, 1], floats(&[0.0, 1.0])),
                ("reward", "<f4", &[2], floats(&[0.0, 1.0])),
                ("is_first", "|b1", &[2], vec![1, 0]),
            ];
            parts.extend(extra(wide));
            npz(&folder.path().join(name), &parts);
        }
        let mut dataset = open(folder.path()).unwrap();
        if wide_first {
            assert_eq!(values(dataset.as_mut(), "x", 1), ["0.5", "1.5"]);
            continue;
        }
        let error = unread(dataset.as_mut(), "x");
        assert!(error.contains("2.npz") && error.contains("store all in one type"), "{error}");
        assert!(!error.contains("damaged") && !error.contains("Plain"), "{error}");
    }
}

#[test]
fn floats_of_another_range_are_not_read_and_have_their_row() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 2, |file, group, episode| {
        let mut images = vec![0.5_f32; 3 * 192];
        images[0] = -1e-7;
        images[1] = 1.000_000_1;
        if episode == 1 {
            images[2 * 192] = 7.0;
        }
        put(file, &format!("{group}/obs/image"), &[3, 8, 8, 3], &images);
    });
    let mut dataset = open(&path).unwrap();
    let pixels = column_of(dataset.as_ref(), "pixels");
    let Column::U8(bytes) = rows(dataset.as_mut(), pixels, 1, 0, 1) else { panic!() };
    assert_eq!(bytes[..3], [0, 255, 128]);
    let error = unread(dataset.as_mut(), "pixels");
    for part in ["episode 1", "row 2", "is 7, unlike those of the first episode", "store all images"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    assert!(!error.contains("damaged"), "{error}");
    let mut out = vec![0; 192];
    let steps = Steps { first: 1, count: 1, stride: 1 };
    dataset.rows(pixels, 1, steps, SliceMut::U8(&mut out)).unwrap();
}

#[test]
fn a_camera_that_was_named_and_cannot_be_read_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("can.hdf5");
    robomimic(&path, 1, |file, group, _| {
        put(file, &format!("{group}/obs/neg"), &[3, 8, 8, 3], &[-1_f32; 576]);
        put(file, &format!("{group}/obs/top"), &[3, 8, 8, 3], &[1_u8; 576]);
    });
    let camera = |name: &str| OpenOptions::default().camera(Some(name.to_owned()));
    assert!(opened(&path, &camera("top")).is_ok());
    let error = message(&path, &camera("neg"));
    for part in ["`camera`", "`obs/neg`", "-1 to -1", "0 to 255", "store"] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let map = [("pixels".to_owned(), "actions".to_owned())].into_iter().collect();
    let error = message(&path, &OpenOptions::default().map(map));
    assert!(error.contains("`map`") && error.contains("`actions` holds no images"), "{error}");
}

#[test]
fn filters_of_zarr_are_refused_with_what_helps() {
    let folder = tempfile::tempdir().unwrap();
    let store = Files::new(folder.path().join("a.zarr"), &[2]);
    let about = json!({ "shape": [2], "chunks": [2], "dtype": "<f4" });
    store.array("data/action", &about, &[("0", &floats(&[0.0, 1.0]))]);
    let about = json!({ "shape": [2], "chunks": [2], "dtype": "<i4", "filters": [{ "id": "delta" }] });
    store.array("data/count", &about, &[("0", &[0; 8])]);
    let reason = why_skipped(open(&store.0).unwrap().as_ref(), "count");
    assert!(reason.contains("`delta`") && reason.contains("store it without filters"), "{reason}");
}
