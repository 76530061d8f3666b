//! Lance tables as a user sees them: every type there and back, appending, kills, foreign bytes, tables of the reference,
//! and pylance reading ours.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use swm_core::{Batch, BoxError, Dtype, Registry};
use swm_data::testing::kills::{kill_in, record_until_stopped_in};
use swm_data::testing::mutations::{mutate_for, play_in, seed_in};
use swm_data::testing::{
    assert_alike, assert_same, contents_in, episode, fail_before_the_first_episode, metadata, record_in,
    rows_of, schema,
};
use swm_data::tools::copy::{all, copy_in};
use swm_data::tools::verify::verify;
use swm_data::{DataError, Dataset, DatasetWriter, Format, Steps, WriteMode, WriteOptions};
use swm_data_lance::FORMATS;

/// The test that is the recording process.
const TEST: &str = "record_until_stopped";

static REGISTRY: LazyLock<Registry> = LazyLock::new(|| Registry::new().with(swm_data::FORMATS).with(FORMATS));

fn open(path: &Path) -> Result<Box<dyn Dataset>, DataError> {
    swm_data::open_in(&REGISTRY, path)
}

fn create(path: &Path, mode: WriteMode, format: Option<&str>) -> Result<Box<dyn DatasetWriter>, DataError> {
    swm_data::create_in(&REGISTRY, path, &mode.into(), format)
}

fn record(path: &Path, mode: WriteMode, episodes: Range<usize>) -> Result<u64, BoxError> {
    record_in(&REGISTRY, path, mode, episodes)
}

fn contents(path: &Path) -> Vec<Batch> {
    contents_in(&REGISTRY, path)
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn path_in(folder: &tempfile::TempDir, name: &str, format: &Format) -> PathBuf {
    folder.path().join(name).with_extension(format.extensions[0])
}

#[test]
fn nothing_is_left_of_a_recording_without_an_episode() {
    for format in FORMATS {
        let folder = folder();
        fail_before_the_first_episode(&REGISTRY, &path_in(&folder, "data", format));
    }
}

#[test]
fn every_type_comes_back() {
    let folder = folder();
    for format in FORMATS {
        let path = path_in(&folder, "data", format);
        assert_eq!(record(&path, WriteMode::Error, 0..3).unwrap(), 0);
        let mut dataset = open(&path).unwrap();
        assert_eq!((dataset.info().format, dataset.metadata()), (format.name, Some(&metadata())));
        let own = dataset.schema().index("ep_idx").unwrap();
        assert_eq!(dataset.schema().fields()[own].dtype, Dtype::I32);
        for field in schema().fields() {
            let at = dataset.schema().require(&field.name).unwrap();
            assert_eq!(&dataset.schema().fields()[at], field, "{}", format.name);
        }
        for (index, read) in contents(&path).iter().enumerate() {
            assert_alike(&episode(&schema(), index, rows_of(index)), read);
        }
        // Rows at a stride, across a second handle.
        let column = dataset.schema().index("state").unwrap();
        let mut shared = dataset.share();
        let (mut some, mut one) = (vec![0.0f64; 7 * 40], vec![0.0f64; 7]);
        let steps = Steps { first: 13, count: 40, stride: 7 };
        dataset.read_column(column, 2, steps, swm_core::SliceMut::F64(&mut some)).unwrap();
        for at in 0..40 {
            let steps = Steps { first: 13 + at * 7, count: 1, stride: 1 };
            shared.read_column(column, 2, steps, swm_core::SliceMut::F64(&mut one)).unwrap();
            assert_eq!(some[at * 7..][..7], one);
        }
        let report = verify(dataset.as_mut(), &mut |_| {});
        let expected = |reason: &str| reason.contains("constant") || reason.contains("NaN");
        assert!(report.problems.iter().all(|problem| expected(&problem.reason)), "{:?}", report.problems);
        assert!(report.has_checksums);
    }
}

#[test]
fn recordings_are_continued_replaced_or_refused() {
    let folder = folder();
    for format in FORMATS {
        let path = path_in(&folder, "data", format);
        record(&path, WriteMode::Append, 0..2).unwrap();
        assert_eq!(record(&path, WriteMode::Append, 2..4).unwrap(), 2);
        let read = contents(&path);
        assert_eq!(read.len(), 4);
        read.iter().enumerate().for_each(|(i, read)| assert_alike(&episode(&schema(), i, rows_of(i)), read));
        let other = FORMATS.iter().find(|other| other.name != format.name).unwrap();
        let mut writer = create(&path, WriteMode::Append, Some(other.name)).unwrap();
        let message = writer.begin(&schema(), &metadata()).unwrap_err().to_string();
        assert!(message.contains(&format!("of the format `{}`", format.name)), "{message}");
        drop(writer);
        assert!(record(&path, WriteMode::Error, 0..1).unwrap_err().to_string().contains("exists already"));
        record(&path, WriteMode::Overwrite, 1..2).unwrap();
        assert_eq!(contents(&path).len(), 1);
        let first = create(&path, WriteMode::Append, None).unwrap();
        let message = create(&path, WriteMode::Append, None).err().unwrap().to_string();
        assert!(message.contains("is being written by process"), "{message}");
        drop(first);
    }
}

#[test]
fn what_was_not_ended_is_not_seen_and_is_cleared_away() {
    let folder = folder();
    for format in FORMATS {
        let path = path_in(&folder, "data", format);
        record(&path, WriteMode::Append, 0..1).unwrap();
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        writer.begin(&schema(), &metadata()).unwrap();
        writer.write_rows(&episode(&schema(), 1, 30)).unwrap();
        drop(writer);
        fs::write(path.join("data/.tmpleft"), "what a kill leaves").unwrap();
        assert_eq!(contents(&path).len(), 1, "{}", format.name);
        let steps = format.repair(&path, true).unwrap();
        let said = |what: &str| steps.iter().any(|step| step.contains(what));
        assert!(said("remove 1 files of an unfinished episode") && said("list all 1 episodes"), "{steps:?}");
        assert!(format.repair(&path, true).unwrap().is_empty());
        assert_eq!(record(&path, WriteMode::Append, 1..2).unwrap(), 1);
        assert_alike(&episode(&schema(), 1, rows_of(1)), &contents(&path)[1]);
    }
}

/// More episodes than are listed one by one: the last ones are known by their files alone until the recording ends.
#[test]
fn episodes_that_no_manifest_lists_yet_are_there() {
    const EPISODES: usize = 66;
    let folder = folder();
    let schema = swm_core::Schema::new(vec![swm_core::Field::step("state", Dtype::F64, &[7])]).unwrap();
    for format in FORMATS {
        let path = path_in(&folder, "data", format);
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        writer.begin(&schema, &metadata()).unwrap();
        (0..EPISODES).for_each(|index| writer.write_episode(&episode(&schema, index, 2)).unwrap());
        // Amid an episode, a recording ends as a kill would end it.
        writer.write_rows(&episode(&schema, EPISODES, 1)).unwrap();
        drop(writer);
        let manifests = || fs::read_dir(path.join("_versions")).unwrap().count();
        assert!(manifests() <= 2);
        let check = |episodes: usize| {
            let read = contents(&path);
            assert_eq!(read.len(), episodes, "{}", format.name);
            read.iter().enumerate().for_each(|(at, read)| assert_alike(&episode(&schema, at, 2), read));
        };
        check(EPISODES);
        let steps = format.repair(&path, true).unwrap();
        assert!(
            steps.iter().all(|step| step.contains("list all 66 episodes")) && !steps.is_empty(),
            "{steps:?}"
        );
        assert!(format.repair(&path, true).unwrap().is_empty());
        check(EPISODES);
        let mut writer = create(&path, WriteMode::Append, None).unwrap();
        assert_eq!(writer.begin(&schema, &metadata()).unwrap(), EPISODES as u64);
        writer.write_episode(&episode(&schema, EPISODES, 2)).unwrap();
        writer.finish().unwrap();
        drop(writer);
        check(EPISODES + 1);
        assert!(format.repair(&path, true).unwrap().is_empty());
    }
}

#[test]
fn tables_are_converted_both_ways() {
    let folder = folder();
    let source = folder.path().join("source.h5");
    record(&source, WriteMode::Append, 0..3).unwrap();
    let convert = |from: &Path, to: &Path| {
        let mut sources = vec![open(from).unwrap()];
        let pieces = all(&sources);
        copy_in(&REGISTRY, &mut sources, &pieces, to, (None, &WriteOptions::default()), &mut |_| {}).unwrap()
    };
    for format in FORMATS {
        let there = path_in(&folder, "there", format);
        assert_eq!(convert(&source, &there).episodes, 3);
        let back = folder.path().join(format!("back-{}.h5", format.name));
        convert(&there, &back);
        for (a, b) in contents(&source).iter().zip(&contents(&back)) {
            assert_alike(a, b);
        }
    }
}

#[test]
fn record_until_stopped() {
    record_until_stopped_in(&REGISTRY);
}

#[test]
fn killed_tables_keep_what_they_committed_and_can_be_continued() {
    for format in FORMATS {
        let folder = folder();
        // A folder of its own: nothing else may be left there.
        let inner = folder.path().join(format.name);
        fs::create_dir(&inner).unwrap();
        let path = inner.join("data").with_extension(format.extensions[0]);
        let episodes = kill_in(&REGISTRY, &path, TEST, 20);
        let mut dataset = open(&path).unwrap();
        (0..episodes).for_each(|episode| dataset.check_episode(episode).unwrap());
    }
}

#[test]
fn no_reader_trips_over_foreign_bytes() {
    for format in FORMATS {
        let folder = folder();
        let path = path_in(&folder, "seed", format);
        seed_in(&REGISTRY, &path);
        mutate_for(format.name, &path, &mut |path| play_in(&REGISTRY, path));
    }
}

/// A table that the reference wrote, and what is in it.
#[test]
fn the_references_table_is_read() {
    let folder = folder();
    let golden =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets/pusht_up_64_lance.lance");
    let mut dataset = open(&golden).unwrap();
    assert_eq!((dataset.info().format, dataset.num_episodes()), ("lance", 4));
    let rows: usize = (0..4).map(|episode| dataset.episode_len(episode)).sum();
    assert_eq!(rows, 84);
    let shape = |name: &str| {
        let field = &dataset.schema().fields()[dataset.schema().require(name).unwrap()];
        (field.dtype, field.shape.clone())
    };
    assert_eq!(shape("pixels"), (Dtype::U8, vec![64, 64, 3]));
    assert_eq!(shape("action"), (Dtype::F32, vec![2]));
    assert_eq!(shape("reward"), (Dtype::F32, vec![]));
    assert!(dataset.metadata().is_none() && dataset.info().skipped.is_empty());
    // The same recording as HDF5: equal up to JPEG and `float32`.
    let copy_path = folder.path().join("copy.h5");
    let mut sources = vec![dataset.share()];
    let pieces = all(&sources);
    copy_in(&REGISTRY, &mut sources, &pieces, &copy_path, (None, &WriteOptions::default()), &mut |_| {})
        .unwrap();
    for (a, b) in contents(&golden).iter().zip(&contents(&copy_path)) {
        assert_same(a, b);
    }
    let message = create(&golden, WriteMode::Append, None).err().map(|error| error.to_string());
    assert!(message.is_none(), "{message:?}");
    assert!(dataset.check_episode(0).is_ok());
}

/// The Python with pylance; says so where there is none.
fn python() -> Option<String> {
    let python = std::env::var("SWM_LANCE_PYTHON").ok();
    if python.is_none() {
        eprintln!("skipped: no SWM_LANCE_PYTHON; `cargo xtask ci --only lance` makes that environment");
    }
    python
}

#[test]
fn pylance_reads_our_tables() {
    let Some(python) = python() else { return };
    let folder = folder();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/interop/read_lance.py");
    for format in FORMATS {
        let path = path_in(&folder, "ours", format);
        record(&path, WriteMode::Append, 0..3).unwrap();
        let output = Command::new(&python).arg(&script).arg(&path).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let seen: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let ours = contents(&path);
        let sum = |name: &str| -> f64 {
            let values = ours.iter().flat_map(|batch| {
                let column = batch.column(batch.schema().require(name).unwrap());
                (0..column.len())
                    .filter_map(move |at| column.as_f64(at))
                    .filter(|value| value.is_finite())
                    .collect::<Vec<_>>()
            });
            values.sum()
        };
        assert_eq!(seen["lengths"], serde_json::json!([5, 1, 300]), "{}", format.name);
        for (name, there) in
            [("state", "state"), ("reward", "reward"), ("step_idx", "step_idx_"), ("heights", "heights")]
        {
            let (ours, theirs) = (sum(name), seen["sums"][there].as_f64().unwrap());
            assert!((ours - theirs).abs() <= 1e-9 * ours.abs(), "{}: {name}: {ours}, {theirs}", format.name);
        }
        assert_eq!(seen["texts"]["task"], "épisode 0, 0");
        // Decoders may differ in the last bit of a value.
        let (ours, theirs) =
            (sum("pixels") / (306 * 40 * 40 * 3) as f64, seen["means"]["pixels"].as_f64().unwrap());
        assert!((ours - theirs).abs() < 1.0, "{}: {ours}, {theirs}", format.name);
    }
}
