//! Replay buffers in Zarr: as diffusion_policy and Zarr's own packages wrote them, and stores that are made here.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};
use swm_core::Column;
use swm_data::testing::mutations::{files, mutated};
use swm_data::tools::compare::compare;
use swm_data::tools::copy::{all, copy};
use swm_data::tools::verify::verify;
use swm_data::{OpenOptions, WriteOptions};

use crate::open;
use crate::published::{check, column_of, golden, lengths, numbers, opened, rows};

/// As their own packages wrote them, with what these read from them.
const SAMPLES: [&str; 4] =
    ["pusht_cchi_v7_replay.zarr", "umi_like.zarr.zip", "v2_by_zarr3.zarr", "v3_sharded.zarr"];

const NAMES: &[(&str, &str, f64)] = &[
    ("state", "state", 1.0),
    ("action", "action", 1.0),
    ("keypoint", "keypoint", 1.0),
    ("n_contacts", "n_contacts", 1.0),
];

/// Files of a store: its ends of episodes, and arrays of this description and these chunks.
pub(crate) struct Files(pub(crate) PathBuf);

impl Files {
    pub(crate) fn new(path: PathBuf, ends: &[i64]) -> Self {
        let files = Self(path);
        let bytes: Vec<u8> = ends.iter().flat_map(|end| end.to_le_bytes()).collect();
        files.put("meta/.zgroup", b"{\"zarr_format\": 2}");
        let about = json!({ "shape": [ends.len()], "chunks": [ends.len()], "dtype": "<i8" });
        files.array("meta/episode_ends", &about, &[("0", &bytes)]);
        files
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        let path = self.0.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    /// An array of version 2. What its description does not say is as usual.
    pub(crate) fn array(&self, name: &str, about: &Json, chunks: &[(&str, &[u8])]) {
        let mut whole =
            json!({ "compressor": null, "filters": null, "order": "C", "fill_value": 0, "zarr_format": 2 });
        whole.as_object_mut().unwrap().extend(about.as_object().unwrap().clone());
        self.put(&format!("{name}/.zarray"), whole.to_string().as_bytes());
        chunks.iter().for_each(|(chunk, bytes)| self.put(&format!("{name}/{chunk}"), bytes));
    }
}

pub(crate) fn floats(values: impl IntoIterator<Item = f32>) -> Vec<u8> {
    values.into_iter().flat_map(f32::to_le_bytes).collect()
}

#[test]
fn samples_are_what_their_packages_read() {
    for sample in SAMPLES {
        let mut dataset = check(sample, &OpenOptions::default(), NAMES);
        let expected: Json =
            serde_json::from_slice(&fs::read(golden(&format!("{sample}.expected.json"))).unwrap()).unwrap();
        let theirs: Vec<usize> = serde_json::from_value(expected["rows_per_episode"].clone()).unwrap();
        assert_eq!(lengths(dataset.as_ref()), theirs, "{sample}");
        assert_eq!((dataset.info().format, dataset.info().skipped.len()), ("zarr", 0), "{sample}");
        assert!(dataset.info().mapping.contains(&("pixels".to_owned(), "img".to_owned())), "{sample}");
        // All images, by the sum of their bytes.
        let (column, mut sum) = (column_of(dataset.as_ref(), "pixels"), 0);
        for (episode, count) in theirs.into_iter().enumerate() {
            let Column::U8(bytes) = rows(dataset.as_mut(), column, episode, 0, count) else {
                panic!("{sample}")
            };
            sum += bytes.iter().map(|&byte| u64::from(byte)).sum::<u64>();
        }
        assert_eq!(sum, expected["images"]["img"]["sum_all"], "{sample}");
    }
    let mut human = opened(&golden(SAMPLES[0]), &OpenOptions::default()).unwrap();
    assert!(
        human.info().notes.iter().any(|note| note.contains("relative=false")),
        "{:?}",
        human.info().notes
    );
    let (state, proprio) = (column_of(human.as_ref(), "state"), column_of(human.as_ref(), "proprio"));
    let state = numbers(&rows(human.as_mut(), state, 1, 3, 1));
    assert_eq!(numbers(&rows(human.as_mut(), proprio, 1, 3, 1)), state[..2]);
    assert!(human.schema().index("reward").is_none() && human.schema().index("terminated").is_none());
}

/// Each array of these stores has the values of `action`, which is not compressed, or whole numbers of four times as much.
#[test]
fn every_codec_gives_the_same_values() {
    for (store, absent) in [("codecs.zarr", 2.5), ("codecs3.zarr", f64::NAN)] {
        let mut dataset = opened(&golden(store), &OpenOptions::default()).unwrap();
        let dataset = dataset.as_mut();
        assert_eq!(lengths(dataset), [7, 143, 160]);
        let action = column_of(dataset, "action");
        let fields: Vec<String> = dataset.schema().fields().iter().map(|field| field.name.clone()).collect();
        for (column, name) in fields.iter().enumerate() {
            let mut first = 0;
            for (episode, count) in lengths(dataset).into_iter().enumerate() {
                let theirs = numbers(&rows(dataset, action, episode, 0, count));
                let ours = numbers(&rows(dataset, column, episode, 0, count));
                for (at, (ours, theirs)) in ours.into_iter().zip(&theirs).enumerate() {
                    let row = first + at / 3;
                    let expected = match name.as_str() {
                        "slashed" | "dotted" => theirs * 4.0,
                        "marks" => continue,
                        "absent" if !(100..200).contains(&row) => absent,
                        "zeros" => 0.0,
                        "sharded" if (40..200).contains(&row) => 2.5,
                        _ => *theirs,
                    };
                    assert!(
                        ours.to_bits() == expected.to_bits(),
                        "{store} {name} row {row}: {ours} {expected}"
                    );
                }
                first += count;
            }
        }
        let skipped: Vec<&str> = dataset.info().skipped.iter().map(|(name, _)| name.as_str()).collect();
        let (expected, count): (&[&str], _) =
            if store == "codecs.zarr" { (&["filtered"], 26) } else { (&[], 12) };
        assert_eq!((skipped.as_slice(), fields.len()), (expected, count), "{fields:?}");
    }
    let mut dataset = opened(&golden("codecs.zarr"), &OpenOptions::default()).unwrap();
    let (action, marks) = (column_of(dataset.as_ref(), "action"), column_of(dataset.as_ref(), "marks"));
    let values = numbers(&rows(dataset.as_mut(), action, 1, 0, 143));
    let expected = values.chunks(3).map(|row| (row[0] * 4.0) % 2.0 == 0.0);
    let Column::Bool(marks) = rows(dataset.as_mut(), marks, 1, 0, 143) else { panic!() };
    assert!(marks.into_iter().eq(expected));
    assert!(dataset.info().skipped[0].1.contains("filter `delta` is not read"));
    assert!(dataset.schema().index("robot.joints").is_some(), "an array of a group in `data`");
}

#[test]
fn an_archive_holds_what_the_folder_holds() {
    let folder = tempfile::tempdir().unwrap();
    for (prefix, method) in
        [("", zip::CompressionMethod::Deflated), ("replay.zarr/", zip::CompressionMethod::Stored)]
    {
        let (store, path) = (golden("v3_sharded.zarr"), folder.path().join("a.zip"));
        let mut archive = zip::ZipWriter::new(fs::File::create(&path).unwrap());
        for file in files(&store) {
            let name = file.strip_prefix(&store).unwrap().to_str().unwrap().to_owned();
            let options = zip::write::SimpleFileOptions::default().compression_method(method);
            archive.start_file(format!("{prefix}{name}"), options).unwrap();
            archive.write_all(&fs::read(&file).unwrap()).unwrap();
        }
        archive.finish().unwrap();
        let (mut zipped, mut plain) = (open(&path).unwrap(), open(&store).unwrap());
        let found = compare(zipped.as_mut(), plain.as_mut(), &|_| true, 0.0, &mut |_| {}).unwrap();
        assert!(found.equal, "{found:?}");
    }
}

#[test]
fn what_is_not_read_is_left_out_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let files = Files::new(folder.path().join("a.zarr"), &[2, 3]);
    let about = json!({ "shape": [3, 2], "chunks": [2, 2], "dtype": "<f4" });
    let chunk = floats([1.0, 2.0, 3.0, 4.0]);
    files.array("data/action", &about, &[("0.0", &chunk), ("1.0", &chunk)]);
    let jpegxl = json!({ "shape": [3, 8, 8, 3], "chunks": [1, 8, 8, 3], "dtype": "|u1", "compressor": { "id": "imagecodecs_jpegxl" } });
    files.array("data/camera0_rgb", &jpegxl, &[("0.0.0.0", b"\xff\x0a")]);
    files.array("data/short", &json!({ "shape": [2, 2], "chunks": [2, 2], "dtype": "<f4" }), &[]);
    files.array("data/text", &json!({ "shape": [3], "chunks": [3], "dtype": "|O" }), &[]);
    files.array("meta/other", &json!({ "shape": [3], "chunks": [3], "dtype": "|O" }), &[]);
    let mut dataset = open(&files.0).unwrap();
    let skipped = dataset.info().skipped.clone();
    for (name, reason) in [
        ("camera0_rgb", "codec `imagecodecs_jpegxl`"),
        ("short", "2 rows, and `meta/episode_ends` ends at 3"),
        ("text", "`|O`"),
    ] {
        assert!(skipped.iter().any(|(skipped, why)| skipped == name && why.contains(reason)), "{skipped:?}");
    }
    let action = column_of(dataset.as_ref(), "action");
    assert_eq!(numbers(&rows(dataset.as_mut(), action, 1, 0, 1)), [1.0, 2.0]);
    assert!(verify(dataset.as_mut(), &mut |_| {}).problems.is_empty());
}

#[test]
fn images_are_recognized_by_their_shapes_and_cameras_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let files = Files::new(folder.path().join("a.zarr"), &[2]);
    files.array(
        "data/action",
        &json!({ "shape": [2, 1], "chunks": [2, 1], "dtype": "<f4" }),
        &[("0.0", &floats([1.0, 2.0]))],
    );
    // Cut into four, each with its colors first.
    let about = json!({ "shape": [2, 3, 16, 12], "chunks": [2, 3, 8, 8], "dtype": "|u1" });
    let value = |row: usize, color: usize, y: usize, x: usize| (row * 100 + color * 50 + y * 3 + x) as u8;
    let part = |top: usize, left: usize| -> Vec<u8> {
        let place = |at: usize| [at / 192, at / 64 % 3, at / 8 % 8 + top, at % 8 + left];
        (0..384).map(place).map(|[row, color, y, x]| value(row, color, y, x)).collect()
    };
    let parts = [part(0, 0), part(0, 8), part(8, 0), part(8, 8)];
    for camera in ["camera0_rgb", "camera1_rgb"] {
        let names = ["0.0.0.0", "0.0.0.1", "0.0.1.0", "0.0.1.1"];
        let chunks: Vec<(&str, &[u8])> = names.into_iter().zip(parts.iter().map(Vec::as_slice)).collect();
        files.array(&format!("data/{camera}"), &about, &chunks);
    }
    let refused = open(&files.0).err().unwrap().to_string();
    assert!(refused.contains("several cameras, `camera0_rgb`, `camera1_rgb`; name the one"), "{refused}");
    for camera in ["camera1", "camera1_rgb"] {
        let mut dataset = opened(&files.0, &OpenOptions::default().camera(Some(camera.to_owned()))).unwrap();
        assert!(dataset.info().mapping.contains(&("pixels".to_owned(), "camera1_rgb".to_owned())));
        let pixels = column_of(dataset.as_ref(), "pixels");
        let Column::U8(bytes) = rows(dataset.as_mut(), pixels, 0, 1, 1) else { panic!() };
        for (at, byte) in bytes.into_iter().enumerate() {
            assert_eq!(byte, value(1, at % 3, at / 36, at / 3 % 12), "{at}");
        }
    }
}

#[test]
fn damage_is_reported_where_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let message = |change: &dyn Fn(&Files)| {
        let files = Files::new(folder.path().join("a.zarr"), &[2, 3]);
        let about = json!({ "shape": [3, 2], "chunks": [2, 2], "dtype": "<f4" });
        files.array("data/action", &about, &[("0.0", &floats([0.0; 4])), ("1.0", &floats([0.0; 4]))]);
        change(&files);
        let message = match open(&files.0) {
            Err(error) => error.to_string(),
            Ok(mut dataset) => format!("{:?}", verify(dataset.as_mut(), &mut |_| {}).problems),
        };
        fs::remove_dir_all(&files.0).unwrap();
        message
    };
    assert_eq!(message(&|_| {}), "[]");
    let cut = message(&|files| files.put("data/action/1.0", &[0; 9]));
    assert!(cut.contains("action") && cut.contains("9 bytes, 16 make a chunk of [2, 2]"), "{cut}");
    let ends = message(&|files| files.put("meta/episode_ends/0", &[3_i64, 2].map(i64::to_le_bytes).concat()));
    assert!(ends.contains("episode 1 would be the rows from 3 to 2"), "{ends}");
    let far = message(&|files| files.put("meta/episode_ends/0", &[3_i64, 9].map(i64::to_le_bytes).concat()));
    assert!(far.contains("none of its arrays") && far.contains("3 rows"), "{far}");
    let about = message(&|files| files.put("data/action/.zarray", b"{"));
    assert!(about.contains("`.zarray`"), "{about}");
    let huge = json!({ "shape": [3, 1 << 20], "chunks": [1 << 13, 1 << 20], "dtype": "<f4", "compressor": { "id": "zstd" } });
    let huge = message(&|files| files.array("data/action", &huge, &[("0.0", b"small")]));
    assert!(huge.contains("a chunk claims"), "{huge}");
    let many = json!({ "shape": [3, 1 << 20], "chunks": [1, 1], "dtype": "<f4" });
    let many = message(&|files| files.array("data/action", &many, &[]));
    assert!(many.contains("a row in 1048576 chunks"), "{many}");
    let episodes = json!({ "shape": [1_u64 << 40], "chunks": [3], "dtype": "<i8" });
    let episodes = message(&|files| files.array("meta/episode_ends", &episodes, &[]));
    assert!(episodes.contains("claims 1099511627776 episodes"), "{episodes}");
}

#[test]
fn copies_are_exact_and_keep_how_they_were_read() {
    let folder = tempfile::tempdir().unwrap();
    for sample in SAMPLES {
        let options = OpenOptions::default().fps(Some(10.0)).env(Some("swm/PushT-v1".to_owned()));
        let mut sources = [opened(&golden(sample), &options).unwrap()];
        let target = folder.path().join(format!("{sample}.h5"));
        let pieces = all(&sources);
        copy(&mut sources, &pieces, &target, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
        let ([mut source], mut written) = (sources, open(&target).unwrap());
        let found = compare(source.as_mut(), written.as_mut(), &|_| true, 0.0, &mut |_| {}).unwrap();
        assert!(found.equal, "{sample}: {found:?}");
        let run = written.metadata().unwrap();
        let source = run.source.as_ref().unwrap();
        assert_eq!((&source["format"], &source["columns"]["pixels"]), (&json!("zarr"), &json!("img")));
        assert_eq!(
            (run.env.as_str(), run.rows_per_second, &source["options"]["fps"]),
            ("swm/PushT-v1", Some(10.0), &json!(10.0))
        );
    }
}

#[test]
fn no_mutation_makes_it_trip() {
    for sample in ["umi_like.zarr.zip", "v2_by_zarr3.zarr", "v3_sharded.zarr"] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(sample);
        match golden(sample).is_dir() {
            true => crate::copied(&golden(sample), &path),
            false => drop(fs::copy(golden(sample), &path).unwrap()),
        }
        let (files, mut errors) = (files(&path), 0);
        for number in 0..300 {
            let file = &files[number % files.len()];
            let bytes = fs::read(file).unwrap();
            fs::write(file, mutated(&bytes, number / files.len() + number)).unwrap();
            let begun = Instant::now();
            errors += usize::from(!is_sound(&path));
            let took = begun.elapsed();
            assert!(
                took < Duration::from_secs(10),
                "{sample}: {}, mutation {number}: {took:?}",
                file.display()
            );
            fs::write(file, bytes).unwrap();
        }
        assert!(is_sound(&path), "{sample}: as it was");
        assert!(errors > 15, "{sample}: {errors} of 300 mutations were noticed");
    }
}

/// Whether everything of it can be read.
fn is_sound(path: &Path) -> bool {
    open(path).is_ok_and(|mut dataset| verify(dataset.as_mut(), &mut |_| {}).problems.is_empty())
}

#[test]
fn rows_behind_the_last_end_have_a_note() {
    let folder = tempfile::tempdir().unwrap();
    let about = |rows: usize| json!({ "shape": [rows], "chunks": [rows], "dtype": "<f4" });
    let notes = |name: &str, other: usize| {
        let store = Files::new(folder.path().join(name), &[2, 5]);
        for (array, rows) in [("data/action", 8), ("data/state", other)] {
            let values = floats((0..rows).map(|row| row as f32));
            store.array(array, &about(rows), &[("0", &values)]);
        }
        let dataset = open(&store.0).unwrap();
        assert_eq!(lengths(dataset.as_ref()), [2, 3]);
        dataset.info().notes.join("\n")
    };
    let all = notes("all.zarr", 8);
    assert!(
        all.contains("all of its arrays have 3 rows behind the last end of `meta/episode_ends`"),
        "{all}"
    );
    assert!(all.contains("an episode whose end is not marked"), "{all}");
    let some = notes("some.zarr", 5);
    assert!(some.contains("`action` has 3 rows behind the last end of `meta/episode_ends`"), "{some}");
    assert!(!some.contains("`state` has") && !some.contains("not marked"), "{some}");
}
