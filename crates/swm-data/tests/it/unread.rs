//! Datasets of other programs, whose layouts the formats of this crate are without: the message says which crate reads them.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::Registry;
use swm_core::registry::Absent;
use swm_data::{DataError, Layout, OpenOptions, format, open, open_in, open_with};

fn field() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field")
}

fn refusal(opened: Result<Box<dyn swm_data::Dataset>, DataError>) -> String {
    let error = opened.err().unwrap();
    assert!(matches!(error, DataError::NotADataset { .. }), "{error}");
    error.to_string()
}

/// Every published sample that a layout reads.
#[test]
fn the_crate_that_reads_them_is_named() {
    let mut samples: Vec<PathBuf> =
        fs::read_dir(field()).unwrap().map(|entry| entry.unwrap().path()).collect();
    samples.sort();
    let is_of_layout = |path: &&PathBuf| {
        let name = path.file_name().unwrap().to_str().unwrap();
        !name.ends_with(".json") && !name.ends_with(".py") && name != "lerobot061_av1"
    };
    let samples: Vec<&PathBuf> = samples.iter().filter(is_of_layout).collect();
    assert!(samples.len() > 20, "{samples:?}");
    for path in samples {
        let message = refusal(open(path));
        let is_said =
            message.contains("add the crate `swm-data-foreign`") && message.contains("to the registry");
        assert!(is_said && !message.contains("not read yet"), "{message}");
        assert!(!format::is_of_other_program(format::built_in(), path), "{}", path.display());
    }
}

#[test]
fn what_a_front_end_lacks_is_named_in_its_words() {
    const LACKING: &[Absent] =
        &[Absent::of::<Layout>("minari-parquet", "tables", "build it with `--features tables`")];
    let registry = Registry::new().with(swm_data::FORMATS).with(LACKING);
    let message = refusal(open_in(&registry, &field().join("minari_parquet")));
    assert!(message.contains("a Minari dataset in Parquet; ") && message.contains("`tables`"), "{message}");
    let message = refusal(open(&field().join("minari_parquet")));
    assert!(message.contains("`swm-data-foreign` with its feature `lerobot`"), "{message}");
}

/// A layout of a plugin, which is a line in a table.
#[test]
fn layouts_of_other_crates_are_asked_behind_the_formats() {
    const NOTES: Layout = Layout::new(
        "notes",
        "for this test",
        |path| path.join("notes.txt").is_file(),
        |path, options| {
            options.only("notes", &["fps"])?;
            Err(DataError::request(path, format!("opened at {:?}", options.fps)))
        },
    );
    let registry = Registry::new().with(swm_data::FORMATS).with(&[NOTES]);
    assert_eq!(registry.find::<Layout>("notes").unwrap().about, "for this test");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    fs::create_dir(&path).unwrap();
    let options = OpenOptions::default().fps(Some(5.0));
    let message = |options: &OpenOptions| open_with(&registry, &path, options).err().unwrap().to_string();
    assert!(message(&options).contains("its content is of no known format"), "{}", message(&options));
    assert!(!format::is_of_other_program(&registry, &path));
    fs::write(path.join("notes.txt"), "c d e").unwrap();
    assert!(format::is_of_other_program(&registry, &path));
    assert!(message(&options).contains("opened at Some(5.0)"), "{}", message(&options));
    let wrong = message(&OpenOptions::default().max_steps(Some(3)));
    assert!(wrong.contains("max_steps") && wrong.contains("notes has no use for it"), "{wrong}");
    // What a format recognizes is its own, whatever a layout says of it.
    const ALL: Layout =
        Layout::new("all", "for this test", |_| true, |path, _| Err(DataError::request(path, "taken")));
    let registry = Registry::new().with(&[ALL]).with(swm_data::FORMATS);
    let ours = folder.path().join("a.h5");
    crate::support::record(&ours, swm_data::WriteMode::Error, 0..1).unwrap();
    assert_eq!(open_in(&registry, &ours).unwrap().info().format, "hdf5");
}
