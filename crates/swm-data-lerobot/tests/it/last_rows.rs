//! Last rows without an action, beside the tables or in them; tasks as texts, written and read.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_core::{Batch, Column, Dtype, Field, Schema, SliceMut};
use swm_data::testing::mutations::files;
use swm_data::tools::copy::all;
use swm_data::tools::verify::verify;
use swm_data::{LastRow, OpenOptions, Steps, WriteMode, WriteOptions};

use crate::support::{assert_alike, assert_same, contents, episode, metadata};
use crate::{FORMATS, copy, create_with, open, open_with, registry};

/// Columns of numbers, texts and images; what is asked for, by step or for the episode.
fn schema(task: Option<Field>) -> std::sync::Arc<Schema> {
    let fields = [
        Field::step("pixels", Dtype::U8, &[40, 40, 3]),
        Field::step("action", Dtype::F32, &[2]),
        Field::step("state", Dtype::F64, &[3]),
        Field::step("reward", Dtype::F64, &[]),
    ];
    Schema::new(fields.into_iter().chain(task).collect()).unwrap()
}

/// An episode whose last row has no action, unless it is a whole one.
fn recorded(schema: &std::sync::Arc<Schema>, number: usize, rows: usize, is_whole: bool) -> Batch {
    let mut batch = episode(schema, number, rows);
    let SliceMut::F32(action) = batch.column_mut(1) else { panic!() };
    for (at, value) in action.iter_mut().enumerate() {
        *value = if !is_whole && at / 2 + 1 == rows { f32::NAN } else { at as f32 };
    }
    if let Some(task) = schema.index("task") {
        let SliceMut::Str(texts) = batch.column_mut(task) else { panic!() };
        let is_step = schema.fields()[task].kind == swm_core::FieldKind::Step;
        for (at, text) in texts.iter_mut().enumerate() {
            let part = if is_step && at * 2 >= rows { "wait" } else { "push the block" };
            *text = format!("{part} {}", number % 2);
        }
    }
    batch
}

/// Episodes of 5, 1 and 7 rows, and a fourth of 4 rows whose last action is a real one.
const LENGTHS: [usize; 4] = [5, 1, 7, 4];

fn episodes(schema: &std::sync::Arc<Schema>) -> Vec<Batch> {
    (0..4).map(|number| recorded(schema, number, LENGTHS[number], number == 3)).collect()
}

fn write(path: &Path, schema: &std::sync::Arc<Schema>, last_row: Option<LastRow>, of: &[Batch]) {
    let options = WriteOptions::default().last_row(last_row);
    let mut writer = create_with(path, &options, None).unwrap();
    writer.begin(schema, &metadata()).unwrap();
    for batch in of {
        writer.write_episode(batch).unwrap();
    }
    writer.finish().unwrap();
}

fn json(path: PathBuf) -> Json {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// A column of the tables as another program reads them: all rows of all tables, in order.
fn of_tables(path: &Path, feature: &str) -> Column {
    // Without our description, the folder is one of another program's.
    let folder = tempfile::tempdir().unwrap();
    let there = folder.path().join("theirs");
    crate::copied(path, &there);
    fs::remove_file(there.join("meta/swm.json")).unwrap();
    let how = OpenOptions::default().camera(Some("pixels".to_owned()));
    let mut dataset = open_with(registry(), &there, &how).unwrap();
    let column = dataset.schema().index(feature).unwrap_or_else(|| panic!("no {feature}"));
    let field = dataset.schema().fields()[column].clone();
    let mut all = Column::zeros(field.dtype, 0);
    for episode in 0..dataset.num_episodes() {
        let count = dataset.episode_len(episode);
        let mut values = Column::zeros(field.dtype, count * field.dim());
        let steps = Steps { first: 0, count, stride: 1 };
        dataset.read_column(column, episode, steps, values.as_slice_mut()).unwrap();
        assert!(all.extend(values.as_slice()));
    }
    all
}

#[test]
fn a_row_without_an_action_is_beside_the_tables_and_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let schema = schema(None);
    let all = episodes(&schema);
    let [dropped, kept] = ["dropped.lerobot", "kept.lerobot"].map(|name| folder.path().join(name));
    write(&dropped, &schema, None, &all);
    write(&kept, &schema, Some(LastRow::Keep), &all);
    for (path, rows) in [(&dropped, [4, 1, 6, 4]), (&kept, LENGTHS)] {
        let info = json(path.join("meta/info.json"));
        assert_eq!(info["total_frames"], rows.iter().sum::<usize>());
        let read = contents(path);
        assert_eq!(read.iter().map(Batch::rows).collect::<Vec<_>>(), LENGTHS);
        read.iter().zip(&all).for_each(|(read, written)| assert_alike(written, read));
        let report = verify(open(path).unwrap().as_mut(), &mut |_| {});
        assert!(report.problems.is_empty(), "{:?}", report.problems);
    }
    // An episode of one row keeps it: it would have none.
    let Column::F32(actions) = of_tables(&dropped, "action") else { panic!() };
    let missing: Vec<usize> = (0..actions.len()).filter(|&at| actions[at].is_nan()).collect();
    assert_eq!((actions.len(), missing), (2 * 15, vec![8, 9]));
    let Column::F32(actions) = of_tables(&kept, "action") else { panic!() };
    assert_eq!(actions.iter().filter(|value| value.is_nan()).count(), 2 * 3);
    // Statistics count the rows of the tables.
    assert_eq!(json(dropped.join("meta/stats.json"))["observation.state"]["count"][0], 15);
    assert_eq!(json(dropped.join("meta/stats.json"))["action"]["count"][0], 14);
    assert_eq!(json(kept.join("meta/stats.json"))["observation.state"]["count"][0], 17);

    // Rows with a stride across the border, and the last one alone.
    let mut dataset = open(&dropped).unwrap();
    let state = dataset.schema().index("state").unwrap();
    for (first, count, stride) in [(0, 3, 2), (1, 2, 3), (4, 1, 1), (0, 4, 1)] {
        let mut values = vec![0.0; count * 3];
        dataset.read_column(state, 0, Steps { first, count, stride }, SliceMut::F64(&mut values)).unwrap();
        let written = all[0].get::<f64>("state").unwrap();
        let expected: Vec<f64> =
            (0..count).flat_map(|at| written[(first + at * stride) * 3..][..3].to_vec()).collect();
        assert_eq!(values, expected, "{first} {count} {stride}");
    }
}

/// The files of a folder, by their places in it.
fn names(folder: &Path) -> Vec<PathBuf> {
    files(folder).into_iter().filter_map(|file| Some(file.strip_prefix(folder).ok()?.to_owned())).collect()
}

#[test]
fn what_is_beside_the_tables_is_continued_copied_checked_and_found_again() {
    let folder = tempfile::tempdir().unwrap();
    let schema = schema(Some(Field::step("task", Dtype::Str, &[])));
    let all_episodes = episodes(&schema);
    let path = folder.path().join("a.lerobot");
    write(&path, &schema, None, &all_episodes[..2]);
    write(&path, &schema, None, &all_episodes[2..]);
    let once = folder.path().join("once.lerobot");
    write(&once, &schema, None, &all_episodes);
    assert_eq!(names(&path), names(&once), "in two recordings as in one");
    contents(&path).iter().zip(&all_episodes).for_each(|(read, written)| assert_alike(written, read));
    let other = create_with(&path, &WriteOptions::default().last_row(Some(LastRow::Keep)), None);
    let refused = other.unwrap().begin(&schema, &metadata()).unwrap_err().to_string();
    assert!(refused.contains("last rows are kept in another way"), "{refused}");

    let [there, back] = ["there.h5", "back.lerobot"].map(|name| folder.path().join(name));
    for (from, to) in [(&path, &there), (&there, &back)] {
        let mut sources = vec![open(from).unwrap()];
        let pieces = all(&sources);
        copy(&mut sources, &pieces, to, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
    }
    contents(&path).iter().zip(&contents(&there)).for_each(|(a, b)| assert_same(a, b));
    contents(&path).iter().zip(&contents(&back)).for_each(|(a, b)| assert_alike(a, b));

    // Damage of the row is found, and a list that is gone is written again.
    let last = path.join("meta/swm-last/chunk-000/file-002.parquet");
    let before = (names(&path), contents(&path));
    let mut bytes = fs::read(&last).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 4;
    fs::write(&last, &bytes).unwrap();
    let mut dataset = open(&path).unwrap();
    assert!(dataset.check_episode(0).is_ok());
    assert!(dataset.check_episode(2).unwrap_err().to_string().contains("checksum"));
    bytes[middle] ^= 4;
    fs::write(&last, bytes).unwrap();
    fs::remove_dir_all(path.join("meta/episodes")).unwrap();
    let lerobot = FORMATS.iter().find(|format| format.name == "lerobot").unwrap();
    assert_eq!(lerobot.repair(&path, true).unwrap().len(), 1);
    assert_eq!(names(&path), before.0);
    contents(&path).iter().zip(&before.1).for_each(|(a, b)| assert_same(a, b));

    // What an episode leaves that did not end.
    let left = path.join("meta/swm-last/chunk-000/file-004.parquet");
    fs::write(&left, "half").unwrap();
    assert_eq!(lerobot.repair(&path, true).unwrap(), ["remove 1 files of an unfinished episode"]);
    assert!(!left.exists());
}

#[test]
fn tasks_are_those_of_the_column() {
    let folder = tempfile::tempdir().unwrap();
    for (name, field) in [
        ("steps.lerobot", Field::step("task", Dtype::Str, &[])),
        ("episodes.lerobot", Field::episode("task", Dtype::Str, &[])),
    ] {
        let schema = schema(Some(field));
        let all = episodes(&schema);
        let path = folder.path().join(name);
        write(&path, &schema, None, &all);
        contents(&path).iter().zip(&all).for_each(|(read, written)| assert_alike(written, read));
        let info = json(path.join("meta/info.json"));
        assert!(info["features"].get("task").is_none(), "LeRobot's tables have its number");
        // As LeRobot reads it: the text at the place that the number of the row names.
        let Column::Str(texts) = of_tables(&path, "task") else { panic!() };
        let tables: Vec<String> = all
            .iter()
            .enumerate()
            .flat_map(|(number, batch)| {
                let rows = [4, 1, 6, 4][number];
                batch.get::<String>("task").unwrap()[..rows].to_vec()
            })
            .collect();
        assert_eq!(texts, tables);
        let mut distinct = tables.clone();
        distinct.sort();
        distinct.dedup();
        assert_eq!(info["total_tasks"], distinct.len());
        let report = verify(open(&path).unwrap().as_mut(), &mut |_| {});
        assert!(report.problems.is_empty(), "{:?}", report.problems);
    }
}

#[test]
fn tasks_of_another_programs_folder_are_kept_by_copies() {
    let folder = tempfile::tempdir().unwrap();
    let copied = folder.path().join("copy.lerobot");
    let camera = OpenOptions::default().camera(Some("top".to_owned()));
    let mut sources = vec![open_with(registry(), &sample(), &camera).unwrap()];
    let pieces = all(&sources);
    copy(&mut sources, &pieces, &copied, (None, &WriteOptions::default()), &mut |_| {}).unwrap();
    let texts = |dataset: &mut dyn swm_data::Dataset, number: usize| {
        let (column, count) = (dataset.schema().index("task").unwrap(), dataset.episode_len(number));
        let mut out = vec![String::new(); count];
        let steps = Steps { first: 0, count, stride: 1 };
        dataset.read_column(column, number, steps, SliceMut::Str(&mut out)).unwrap();
        out
    };
    let mut written = open(&copied).unwrap();
    for number in 0..written.num_episodes() {
        assert_eq!(texts(written.as_mut(), number), texts(sources[0].as_mut(), number));
    }
    assert!(json(copied.join("meta/info.json"))["total_tasks"].as_u64().unwrap() > 1);
}

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field/lerobot061_av1")
}

#[test]
fn options_that_would_not_act_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.lerobot");
    let schema = schema(None);
    write(&path, &schema, None, &episodes(&schema)[..1]);
    let camera = OpenOptions::default().camera(Some("pixels".to_owned()));
    let refused = open_with(registry(), &path, &camera).err().unwrap().to_string();
    assert!(refused.contains("`camera`") && refused.contains("this program wrote the dataset"), "{refused}");
    let keep = WriteOptions::default().last_row(Some(LastRow::Keep)).mode(WriteMode::Append);
    let refused = create_with(&folder.path().join("a.h5"), &keep, None).err().unwrap().to_string();
    assert!(refused.contains("`last_row`: the format `hdf5` has the last row of every episode"), "{refused}");
    assert!("both".parse::<LastRow>().unwrap_err().contains("drop or keep"));
    assert!(LastRow::ALL.into_iter().all(|(name, value)| name.parse() == Ok(value)));
}
