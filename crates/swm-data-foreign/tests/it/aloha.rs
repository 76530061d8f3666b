//! HDF5 files of ALOHA and ACT.

use std::fs;
use std::path::Path;

use swm_core::{Column, Dtype};
use swm_data::{Channels, OpenOptions, Steps};

use crate::copied;
use crate::published::{check, column_of, golden, lengths, opened, rows};
use crate::varied::put;

const SAMPLE: &str = "aloha_toy";

fn top() -> OpenOptions {
    OpenOptions::default().camera(Some("top".to_owned()))
}

#[test]
fn a_file_is_an_episode_and_their_numbers_are_their_order() {
    let names = [
        ("action", "action", 1.0),
        ("observations/qpos", "observations.qpos", 1.0),
        ("observations/qvel", "observations.qvel", 1.0),
    ];
    let dataset = check(SAMPLE, &top(), &names);
    // Of the episodes 0, 2 and 10.
    assert_eq!(lengths(dataset.as_ref()), [4, 3, 5]);
    let info = dataset.info();
    assert_eq!((info.format, info.skipped.len(), info.rows_per_second), ("aloha", 0, Some(50.0)));
    column_of(dataset.as_ref(), "observations.images.angle");
    // Threads read the same files.
    let mut shared = dataset.share();
    let column = column_of(shared.as_ref(), "action");
    rows(shared.as_mut(), column, 2, 0, 5);
}

#[test]
fn several_cameras_are_an_error_that_lists_them() {
    let refused = opened(&golden(SAMPLE), &OpenOptions::default()).err().unwrap().to_string();
    for part in ["camera", "observations.images.angle", "observations.images.top"] {
        assert!(refused.contains(part), "{refused}");
    }
}

#[test]
fn an_episode_is_a_dataset_of_its_own() {
    let dataset = opened(&golden(SAMPLE).join("episode_10.hdf5"), &top()).unwrap();
    assert_eq!(lengths(dataset.as_ref()), [5]);
}

#[test]
fn a_file_of_another_layout_among_them_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mixed");
    copied(&golden(SAMPLE), &path);
    fs::copy(golden("halfcheetah-medium-v2.hdf5"), path.join("episode_3.hdf5")).unwrap();
    let refused = opened(&path, &top()).err().unwrap().to_string();
    assert!(refused.contains("episode_3.hdf5") && refused.contains("`action`"), "{refused}");
}

#[test]
fn a_file_that_changes_while_it_is_open_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("changed");
    copied(&golden(SAMPLE), &path);
    let mut dataset = opened(&path, &top()).unwrap();
    fs::copy(path.join("episode_2.hdf5"), path.join("new")).unwrap();
    fs::rename(path.join("new"), path.join("episode_10.hdf5")).unwrap();
    let column = column_of(dataset.as_ref(), "action");
    let mut out = Column::zeros(Dtype::F32, 14);
    let steps = Steps { first: 0, count: 1, stride: 1 };
    let error = dataset.rows(column, 2, steps, out.as_slice_mut()).unwrap_err().to_string();
    assert!(error.contains("episode_10.hdf5") && error.contains("another array"), "{error}");
    dataset.rows(column, 0, steps, out.as_slice_mut()).unwrap();
}

const SIDE: usize = 16;

/// Writes an episode of mobile ALOHA: images in this color as JPEG, padded to one length.
fn encoded(path: &Path, rows: usize, padded: usize, color: [u8; 3]) {
    let file = hdf5_metno::File::create(path).unwrap();
    file.create_group("observations/images").unwrap();
    for name in ["action", "observations/qpos"] {
        put(&file, name, &[rows, 14], &vec![0f32; rows * 14]);
    }
    let mut image = swm_media::jpeg::encode(SIDE, SIDE, 3, &color.repeat(SIDE * SIDE), 95).unwrap();
    image.resize(padded, 0);
    put(&file, "observations/images/cam_high", &[rows, padded], &image.repeat(rows));
}

#[test]
fn images_that_opencv_encoded_are_read_by_the_order_that_it_was_given() {
    let folder = tempfile::tempdir().unwrap();
    // Padded to another length in each file.
    encoded(&folder.path().join("episode_0.hdf5"), 3, 2000, [250, 20, 20]);
    encoded(&folder.path().join("episode_1.hdf5"), 2, 3000, [20, 20, 250]);
    let left_out = opened(folder.path(), &OpenOptions::default()).unwrap();
    let (name, reason) = &left_out.info().skipped[0];
    assert!(name == "observations.images.cam_high" && reason.contains("`channels`"), "{name}: {reason}");
    for (channels, first, last) in [(Channels::Bgr, 0, 2), (Channels::Rgb, 2, 0)] {
        let mut dataset = opened(folder.path(), &OpenOptions::default().channels(Some(channels))).unwrap();
        let pixels = column_of(dataset.as_ref(), "pixels");
        assert_eq!(dataset.schema().fields()[pixels].shape, [SIDE, SIDE, 3]);
        for (episode, row, bright) in [(0, 2, first), (1, 1, last)] {
            let Column::U8(image) = rows(dataset.as_mut(), pixels, episode, row, 1) else { panic!("images") };
            assert!(image[bright] > 230 && image[2 - bright] < 40, "{channels:?}: {:?}", &image[..3]);
        }
    }
    // An episode whose images are not encoded among them stays as it is.
    let raw = hdf5_metno::File::create(folder.path().join("episode_2.hdf5")).unwrap();
    raw.create_group("observations/images").unwrap();
    for name in ["action", "observations/qpos"] {
        put(&raw, name, &[1, 14], &[0f32; 14]);
    }
    let image = [250, 20, 20].repeat(SIDE * SIDE);
    put(&raw, "observations/images/cam_high", &[1, SIDE, SIDE, 3], &image);
    drop(raw);
    let rgb = OpenOptions::default().channels(Some(Channels::Rgb));
    let mut mixed = opened(folder.path(), &rgb).unwrap();
    let pixels = column_of(mixed.as_ref(), "pixels");
    assert_eq!(rows(mixed.as_mut(), pixels, 2, 0, 1), Column::U8(image));
    let refused = opened(&golden(SAMPLE), &top().channels(Some(Channels::Rgb))).err().unwrap().to_string();
    assert!(refused.contains("`channels`") && refused.contains("no use for it"), "{refused}");
}
