//! Images of rows by the times at which videos show them: edit lists, gaps, fragments, random access.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_core::{Batch, SliceMut};
use swm_data::tools::verify::verify;
use swm_data::{DataError, Steps};

use crate::copied;
use crate::golden;
use crate::open;

const CAMERA: &str = "observation.images.top";
/// Rows of the two episodes, ten a second.
const ROWS: [usize; 2] = [4, 6];

fn videos() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/videos")
}

/// What PyAV decodes of a video: time and checksum by frame.
fn shown(name: &str) -> Vec<(f64, u32)> {
    let text = fs::read(videos().join("expected.json")).unwrap();
    let expected: Json = serde_json::from_slice(&text).unwrap();
    let frames = expected["videos"][name]["frames"].as_array().unwrap().iter();
    frames.map(|frame| (frame[0].as_f64().unwrap(), frame[1].as_u64().unwrap() as u32)).collect()
}

/// A folder with these videos in the place of its own; in version 3 there is one.
fn with_videos(path: &Path, version: &str, names: &[&str]) {
    copied(&golden(&format!("lerobot_{version}")), path);
    let info = path.join("meta/info.json");
    let mut described: Json = serde_json::from_slice(&fs::read(&info).unwrap()).unwrap();
    described["features"][CAMERA]["shape"] = serde_json::json!([64, 80, 3]);
    fs::write(info, described.to_string()).unwrap();
    for (number, name) in names.iter().enumerate() {
        let file = match version {
            "v2.1" => format!("videos/chunk-000/{CAMERA}/episode_{number:06}.mp4"),
            _ => format!("videos/{CAMERA}/chunk-000/file-{number:03}.mp4"),
        };
        fs::copy(videos().join(format!("{name}.mp4")), path.join(file)).unwrap();
    }
}

/// Checksums of the images of an episode: read at once, and one at a time from the last on by another handle.
fn images(path: &Path, episode: usize) -> Result<Vec<u32>, DataError> {
    let mut dataset = open(path)?;
    let pixels = dataset.schema().index("pixels").expect("the camera is read");
    let bytes: usize = dataset.info().field(pixels).shape.iter().product();
    let rows = dataset.episode_len(episode);
    let mut all = vec![0; rows * bytes];
    let steps = Steps { first: 0, count: rows, stride: 1 };
    dataset.read_column(pixels, episode, steps, SliceMut::U8(&mut all))?;
    let mut dataset = dataset.share();
    for row in (0..rows).rev() {
        let mut one = vec![0; bytes];
        let steps = Steps { first: row, count: 1, stride: 1 };
        dataset.read_column(pixels, episode, steps, SliceMut::U8(&mut one))?;
        assert!(one == all[row * bytes..][..bytes], "row {row}");
    }
    Ok(all.chunks_exact(bytes).map(crc32fast::hash).collect())
}

/// The checksums of the frames at the times of rows that begin at `begin` seconds.
fn at_times(name: &str, begin: f64, rows: usize) -> Vec<u32> {
    let shown = shown(name);
    let at = |row: usize| {
        let time = begin + row as f64 / 10.0;
        shown.iter().find(|(shown, _)| (shown - time).abs() < 1e-4).expect("it is shown").1
    };
    (0..rows).map(at).collect()
}

#[test]
fn rows_have_the_images_that_are_shown_at_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let pairs = [
        ["h264_cut", "h264_cut_baseline"],
        ["av1_cut", "h264_fragments"],
        ["h264_open_gop", "h264_intra_refresh"],
        ["av1_fragments", "h264_gray"],
    ];
    for (number, names) in pairs.iter().enumerate() {
        let path = folder.path().join(number.to_string());
        with_videos(&path, "v2.1", names);
        for (episode, name) in names.iter().enumerate() {
            let images = images(&path, episode).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(images, at_times(name, 0.0, ROWS[episode]), "{name}");
        }
        let report = verify(open(&path).unwrap().as_mut(), &mut |_| {});
        assert!(report.problems.is_empty(), "{names:?}: {:?}", report.problems);
    }
}

/// One video of several episodes, with images between them that belong to none.
#[test]
fn gaps_in_shared_videos_shift_no_images() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["h264_main_long", "h264_fragments_open_gop", "av1_svt"] {
        let path = folder.path().join(name);
        with_videos(&path, "v3.0", &[name]);
        let list = path.join("meta/episodes/chunk-000/file-000.parquet");
        fs::copy(videos().join("episodes_apart.parquet"), list).unwrap();
        assert_eq!(images(&path, 0).unwrap(), at_times(name, 0.0, ROWS[0]), "{name}");
        assert_eq!(images(&path, 1).unwrap(), at_times(name, 2.1, ROWS[1]), "{name}");
    }
}

#[test]
fn images_belong_to_the_rows_whatever_table_holds_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    let name = "h264_main_long";
    with_videos(&path, "v3.0", &[name]);
    let list = path.join("meta/episodes/chunk-000/file-000.parquet");
    fs::copy(videos().join("episodes_apart.parquet"), list).unwrap();
    // The list names a table that is not there: the rows are found by their labels, and so are their times.
    let data = path.join("data/chunk-000");
    fs::rename(data.join("file-000.parquet"), data.join("file-001.parquet")).unwrap();
    assert_eq!(images(&path, 1).unwrap(), at_times(name, 2.1, ROWS[1]));
}

#[test]
fn a_row_without_an_image_at_its_time_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("dataset");
    with_videos(&path, "v3.0", &["h264_cut"]);
    fs::copy(videos().join("episodes_apart.parquet"), path.join("meta/episodes/chunk-000/file-000.parquet"))
        .unwrap();
    assert_eq!(images(&path, 0).unwrap(), at_times("h264_cut", 0.0, ROWS[0]));
    let message = images(&path, 1).unwrap_err().to_string();
    for part in ["episode 1", "row 0 is at 2.1000 s", "shown at 1.5000 s", "file-000.mp4"] {
        assert!(message.contains(part), "no `{part}` in {message}");
    }
    let report = verify(open(&path).unwrap().as_mut(), &mut |_| {});
    assert!(
        report.problems.iter().any(|problem| problem.reason.contains("2.1000 s")),
        "{:?}",
        report.problems
    );
}

#[test]
fn videos_that_are_not_decoded_are_left_out_and_not_damaged() {
    let folder = tempfile::tempdir().unwrap();
    for (name, reason) in [
        ("no_h264_444", "H.264 in 4:4:4 is not decoded"),
        ("no_h264_interlaced", "interlaced H.264 is not decoded"),
        ("no_av1_10_bits", "AV1 in 10 bits is not decoded"),
        ("no_hevc", "HEVC"),
    ] {
        let path = folder.path().join(name);
        with_videos(&path, "v2.1", &[name, name]);
        let mut dataset = open(&path).unwrap();
        assert!(dataset.schema().index("pixels").is_none() && dataset.schema().index("proprio").is_some());
        let (left_out, told) = &dataset.info().skipped[0];
        assert!(left_out == CAMERA && told.contains(reason), "{left_out}: {told}");
        assert!(!told.contains("damaged") && !told.contains("failed"), "{told}");
        let report = verify(dataset.as_mut(), &mut |_| {});
        assert!(report.problems.is_empty(), "{:?}", report.problems);

        // Only in a later episode: the column is there, and that episode's images are not.
        let path = folder.path().join(format!("{name}_later"));
        with_videos(&path, "v2.1", &["h264_baseline", name]);
        let mut dataset = open(&path).unwrap();
        let mut batch = Batch::new(dataset.schema().clone(), 0);
        dataset.read(0, 0..2, &mut batch).unwrap();
        let error = dataset.read(1, 0..2, &mut batch).unwrap_err();
        assert!(matches!(error, DataError::Unsupported { .. }), "{error}");
        let message = error.to_string();
        assert!(message.contains("cannot read") && message.contains(reason), "{message}");
    }
}
