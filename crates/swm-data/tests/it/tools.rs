//! Copying, verifying and comparing whole datasets.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use swm_core::{Batch, Dtype, Field, Schema, SliceMut};
use swm_data::tools::compare::compare;
use swm_data::tools::copy::{Copied, all};
use swm_data::tools::verify::verify;
use swm_data::{DataError, WriteMode, WriteOptions};

use crate::support::{self, assert_alike, assert_same, contents, metadata, record};
use crate::{FORMATS, copy, create, open};

fn convert(from: &Path, to: &Path) -> Result<Copied, DataError> {
    let mut sources = vec![open(from)?];
    let pieces = all(&sources);
    copy(&mut sources, &pieces, to, (None, &WriteOptions::default()), &mut |_| {})
}

/// Episodes that were there, episodes copied, rows copied.
fn counts(copied: &Copied) -> [usize; 3] {
    [copied.resumed, copied.episodes, copied.rows]
}

#[test]
fn any_format_becomes_any_other() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("source.h5");
    record(&source, WriteMode::Append, 0..4).unwrap();
    for format in FORMATS {
        let there = folder.path().join("there").with_extension(format.extensions[0]);
        let back = folder.path().join(format!("back-{}.h5", format.name));
        assert_eq!(counts(&convert(&source, &there).unwrap()), [0, 4, 323]);
        assert_eq!(convert(&there, &back).unwrap().episodes, 4, "{}", format.name);
        assert_eq!(open(&there).unwrap().info().format, format.name);
        assert_eq!(open(&back).unwrap().metadata(), Some(&metadata()));
        for (a, b) in contents(&source).iter().zip(&contents(&back)) {
            assert_alike(a, b);
        }
        let found = compare(
            open(&source).unwrap().as_mut(),
            open(&there).unwrap().as_mut(),
            &|name| name != "pixels" && name != "goal",
            0.0,
            &mut |_| {},
        );
        assert!(found.unwrap().equal, "{}", format.name);
        let report = verify(open(&there).unwrap().as_mut(), &mut |_| {});
        // The made-up texts and numbers do not stay constant where a recording's would.
        let expected = |reason: &str| reason.contains("constant") || reason.contains("NaN");
        assert!(report.problems.iter().all(|problem| expected(&problem.reason)), "{:?}", report.problems);
        assert!(report.has_checksums && report.rows == 323, "{}", format.name);
    }
}

#[test]
fn a_copy_is_continued_and_nothing_else_is() {
    let folder = tempfile::tempdir().unwrap();
    let [source, other, target] = ["a.h5", "b.h5", "c.h5"].map(|name| folder.path().join(name));
    record(&source, WriteMode::Append, 0..5).unwrap();
    record(&target, WriteMode::Append, 0..2).unwrap();
    assert_eq!(counts(&convert(&source, &target).unwrap()), [2, 3, 1117]);
    for (a, b) in contents(&source).iter().zip(&contents(&target)) {
        assert_same(a, b);
    }
    assert_eq!(convert(&source, &target).unwrap().episodes, 0);
    // Of equal lengths, but with other values.
    record(&other, WriteMode::Append, 5..8).unwrap();
    let message = convert(&other, &target).unwrap_err().to_string();
    assert!(message.contains("not the beginning") && message.contains("holds 5 episodes"), "{message}");
    fs::remove_file(&target).unwrap();
    record(&target, WriteMode::Append, 0..1).unwrap();
    let message = convert(&other, &target).unwrap_err().to_string();
    assert!(message.contains("not the beginning") && message.contains("column"), "{message}");
    let message = convert(&source, &source).unwrap_err().to_string();
    assert!(message.contains("one of the sources"), "{message}");
}

/// Two episodes of 4 rows of `schema`, with 1 added to the values of `changed` in row `row` of the second one.
fn changed(path: &Path, schema: &Arc<Schema>, changed: &str, row: usize) {
    let mut writer = create(path, WriteMode::Overwrite, None).unwrap();
    writer.begin(schema, &metadata()).unwrap();
    for index in 0..2 {
        let mut batch = support::episode(schema, index, 4);
        if let Some(column) = schema.index(changed).filter(|_| index == 1) {
            let width = schema.fields()[column].dim();
            match batch.column_mut(column) {
                SliceMut::U8(values) => values[row * width..][..width].iter_mut().for_each(|v| *v ^= 1),
                SliceMut::F64(values) => values[row * width..][..width].iter_mut().for_each(|v| *v += 1.0),
                _ => panic!("a column of another type"),
            }
        }
        writer.write_rows(&batch).unwrap();
        writer.end_episode().unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn a_copy_of_other_images_or_columns_is_no_beginning() {
    let folder = tempfile::tempdir().unwrap();
    let [source, other, target] = ["a.h5", "b.h5", "c.h5"].map(|name| folder.path().join(name));
    let schema = support::schema();
    changed(&source, &schema, "", 0);
    convert(&source, &target).unwrap();
    let refused = |from: &Path, wanted: &str| {
        let message = convert(from, &target).unwrap_err().to_string();
        assert!(message.contains("not the beginning of this copy") && message.contains(wanted), "{message}");
        assert!(message.contains(&from.display().to_string()), "{message}");
    };
    // Of the same lengths and numbers, as a copy with loss has.
    for (column, row) in
        [("pixels", 0), ("pixels", 3), ("goal", 0), ("state", 0), ("state", 3), ("heights", 3)]
    {
        changed(&other, &schema, column, row);
        refused(&other, &format!("`{column}` in episode 1, row {row}"));
    }
    let without = |name: &str| {
        Schema::new(schema.fields().iter().filter(|f| f.name != name).cloned().collect()).unwrap()
    };
    changed(&other, &without("pixels"), "", 0);
    refused(&other, "it has a column `pixels`");
    changed(&target, &without("task"), "", 0);
    refused(&source, "it has no column `task`");
    // Where images are stored with loss, they cannot tell.
    let lossy = folder.path().join("d.folder");
    convert(&source, &lossy).unwrap();
    assert_eq!(counts(&convert(&source, &lossy).unwrap()), [2, 0, 0]);
    let message = {
        fs::remove_file(&target).unwrap();
        convert(&lossy, &target).unwrap();
        convert(&source, &target).unwrap_err().to_string()
    };
    assert!(message.contains("its images `pixels` in episode 0, row 0 differ"), "{message}");
    assert_eq!(counts(&convert(&lossy, &target).unwrap()), [2, 0, 0]);
}

#[test]
fn merged_and_chosen_episodes_stay_what_they_were() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, target] = ["a.h5", "b.folder", "c.h5"].map(|name| folder.path().join(name));
    record(&a, WriteMode::Append, 0..3).unwrap();
    record(&b, WriteMode::Append, 3..5).unwrap();
    let mut sources = vec![open(&a).unwrap(), open(&b).unwrap()];
    let pieces = [(1, 1), (0, 2), (0, 0), (1, 1)];
    let options = WriteOptions::default();
    let copied = copy(&mut sources, &pieces, &target, (None, &options), &mut |_| {}).unwrap();
    assert_eq!(copied.episodes, 4);
    let (a, b, found) = (contents(&a), contents(&b), contents(&target));
    assert_eq!(found[1].get::<f64>("state").unwrap(), a[2].get::<f64>("state").unwrap());
    assert_eq!(found[0].get::<u8>("pixels").unwrap(), b[1].get::<u8>("pixels").unwrap());
    for (index, batch) in found.iter().enumerate() {
        assert!(batch.get::<i32>("ep_idx").unwrap().iter().all(|&value| value == index as i32));
    }
}

#[test]
fn parts_of_hdf5_are_merged_to_the_bytes_of_one_recording() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    record(&path("whole.h5"), WriteMode::Append, 0..9).unwrap();
    let bounds = [0, 1, 4, 9];
    let parts = bounds.windows(2).map(|bounds| {
        let part = path(&format!("part{}.h5", bounds[0]));
        record(&part, WriteMode::Append, bounds[0]..bounds[1]).unwrap();
        part
    });
    let parts: Vec<PathBuf> = parts.collect();
    let merge = |target: &Path, count: usize| {
        let mut sources: Vec<_> = parts[..count].iter().map(|part| open(part).unwrap()).collect();
        let images = ["pixels", "goal"].map(|name| sources[0].schema().index(name).unwrap());
        assert!(images.iter().all(|&column| sources[0].encoding(column).is_some_and(|e| e.contains("LZ4"))));
        assert_eq!(sources[0].encoding(sources[0].schema().index("state").unwrap()), None);
        let pieces = all(&sources);
        copy(&mut sources, &pieces, target, (None, &WriteOptions::default()), &mut |_| {}).unwrap()
    };
    assert_eq!(merge(&path("merged.h5"), 3).episodes, 9);
    assert!(fs::read(path("merged.h5")).unwrap() == fs::read(path("whole.h5")).unwrap());
    // One that ended between two parts goes on from there.
    assert_eq!(merge(&path("continued.h5"), 2).episodes, 4);
    assert_eq!(counts(&merge(&path("continued.h5"), 3)), [4, 5, 1123]);
    for (a, b) in contents(&path("whole.h5")).iter().zip(&contents(&path("continued.h5"))) {
        assert_same(a, b);
    }
}

#[test]
fn damage_is_not_copied() {
    let folder = tempfile::tempdir().unwrap();
    let [path, bad, target] = ["data.h5", "bad.h5", "copy.h5"].map(|name| folder.path().join(name));
    record(&path, WriteMode::Append, 0..3).unwrap();
    let mut bytes = fs::read(&path).unwrap();
    let head = [2u8, 1, 0x21, 1];
    let starts: Vec<usize> = (0..bytes.len() - 4).filter(|&at| bytes[at..at + 4] == head).collect();
    bytes[starts[starts.len() / 2] + 60] ^= 8;
    fs::write(&bad, &bytes).unwrap();
    let message = convert(&bad, &target).unwrap_err().to_string();
    assert!(message.contains("bad.h5") && message.contains("checksum is wrong"), "{message}");
    // What was committed before it is there, and that is said.
    let there = open(&target).unwrap().num_episodes();
    assert!((1..3).contains(&there));
    let part = format!("copy.h5 holds the first {there} of 3 episodes");
    assert!(message.contains(&part) && message.contains("goes on from there"), "{message}");
    assert_eq!(counts(&convert(&path, &target).unwrap())[..2], [there, 3 - there]);
}

#[test]
fn a_flipped_bit_in_an_image_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let [path, bad] = ["data.h5", "bad.h5"].map(|name| folder.path().join(name));
    record(&path, WriteMode::Append, 0..3).unwrap();
    let bytes = fs::read(&path).unwrap();
    let check = |path: &Path| {
        let mut dataset = open(path).unwrap();
        (0..3).find_map(|episode| dataset.check_episode(episode).err())
    };
    assert!(check(&path).is_none());
    // Chunks of images begin with the head of their compression: flip a bit in the middle of some.
    let head = [2u8, 1, 0x21, 1];
    let starts = bytes.windows(4).enumerate().filter(|(_, window)| *window == head).map(|(at, _)| at);
    let chunks: Vec<usize> = starts.step_by(37).collect();
    assert!(chunks.len() > 5, "{} chunks", chunks.len());
    for at in chunks {
        let mut flipped = bytes.clone();
        flipped[at + 60] ^= 8;
        fs::write(&bad, &flipped).unwrap();
        let message = check(&bad).expect("the flip must be found").to_string();
        assert!(message.contains("checksum is wrong"), "{message}");
    }
}

#[test]
fn differences_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b, c] = ["a.h5", "b.h5", "c.h5"].map(|name| folder.path().join(name));
    record(&a, WriteMode::Append, 0..3).unwrap();
    record(&b, WriteMode::Append, 0..3).unwrap();
    record(&c, WriteMode::Append, 2..4).unwrap();
    let found = |b: &Path| {
        compare(open(&a).unwrap().as_mut(), open(b).unwrap().as_mut(), &|_| true, 0.0, &mut |_| {}).unwrap()
    };
    assert!(found(&b).equal);
    let differs = found(&c);
    assert_eq!((differs.equal, differs.episodes, &differs.lengths[..]), (false, [3, 2], &[0, 1][..]));
    let state = differs.columns.iter().find(|column| column.name == "state").unwrap();
    assert!(state.rows > 0 && state.first == Some([0, 0]) && state.largest > 1.0, "{state:?}");
}

#[test]
fn datasets_of_two_environments_are_compared_by_what_they_share() {
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a.h5", "b.h5"].map(|name| folder.path().join(name));
    record(&a, WriteMode::Append, 0..2).unwrap();
    let fields = vec![Field::step("state", Dtype::F32, &[2]), Field::step("reward", Dtype::F64, &[])];
    let schema = Schema::new(fields).unwrap();
    let mut writer = create(&b, WriteMode::Append, None).unwrap();
    writer.begin(&schema, &metadata()).unwrap();
    writer.write_episode(&Batch::new(schema.clone(), 5)).unwrap();
    writer.finish().unwrap();
    drop(writer);
    for (first, second, said) in [
        (&a, &b, "`state` holds float64 [7] in the first, float32 [2] in the second"),
        (&b, &a, "`state` holds float32 [2] in the first, float64 [7] in the second"),
    ] {
        let (mut first, mut second) = (open(first).unwrap(), open(second).unwrap());
        let found = compare(first.as_mut(), second.as_mut(), &|_| true, 0.0, &mut |_| {}).unwrap();
        assert!(!found.equal && found.schema.iter().any(|line| line == said), "{:?}", found.schema);
        assert_eq!(found.columns.len(), 2, "the reward, and the episode's index");
    }
}
