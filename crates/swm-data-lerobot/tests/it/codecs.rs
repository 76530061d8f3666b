//! Parquet tables in every codec that other programs write, in datasets of LeRobot: a column is read, or the dataset is
//! refused by the name of the codec. None is left out without a word.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::Batch;

use crate::copied;
use crate::open;
use crate::support::{assert_same, contents};

/// A table that pyarrow wrote.
fn table(name: &str) -> PathBuf {
    golden("others/codecs").join(format!("{name}.parquet"))
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden").join(name)
}

const DATA: &str = "data/chunk-000/file-000.parquet";

/// A copy of a LeRobot dataset with another table.
fn lerobot(folder: &Path, table: &Path) -> PathBuf {
    let path = folder.join(table.file_stem().unwrap());
    copied(&golden("datasets/lerobot_v3.0"), &path);
    fs::copy(table, path.join(DATA)).unwrap();
    path
}

fn assert_equal(found: &[Batch], expected: &[Batch]) {
    assert_eq!(found.len(), expected.len());
    found.iter().zip(expected).for_each(|(found, expected)| assert_same(found, expected));
}

#[test]
fn tables_of_lerobot_are_read_in_the_codecs_of_pyarrow() {
    let folder = tempfile::tempdir().unwrap();
    let expected = contents(&golden("datasets/lerobot_v3.0"));
    for codec in ["none", "snappy", "gzip", "zstd", "lz4"] {
        let path = lerobot(folder.path(), &table(&format!("lerobot_{codec}")));
        let dataset = open(&path).unwrap();
        assert!(dataset.info().skipped.is_empty(), "{codec}: {:?}", dataset.info().skipped);
        assert_equal(&contents(&path), &expected);
    }
}

#[test]
fn a_codec_that_is_not_read_is_an_error_with_the_fix() {
    let folder = tempfile::tempdir().unwrap();
    let check = |path: &Path, file: &str, column: &str| {
        let message = open(path).err().unwrap_or_else(|| panic!("{} opens", path.display())).to_string();
        for part in [file, column, "Brotli", "is not read", "compression=\"zstd\""] {
            assert!(message.contains(part), "{part}: {message}");
        }
        assert!(!message.contains("is damaged"), "{message}");
    };
    check(&lerobot(folder.path(), &table("lerobot_brotli")), DATA, "`observation.state`");
    check(&lerobot(folder.path(), &table("lerobot_one_brotli")), DATA, "`action`");
}

/// A part of a table that holds damage would be a column less.
#[test]
fn a_column_that_cannot_be_decoded_is_damage() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = fs::read(table("lerobot_zstd")).unwrap();
    // The blocks of Zstandard: pages of columns.
    let blocks: Vec<usize> =
        (0..bytes.len() - 4).filter(|&at| bytes[at..at + 4] == [0x28, 0xb5, 0x2f, 0xfd]).collect();
    assert!(blocks.len() > 8, "{}", blocks.len());
    for (number, &block) in blocks.iter().enumerate() {
        let damaged = folder.path().join(format!("damaged_{number}.parquet"));
        let mut bytes = bytes.clone();
        bytes[block] = 0;
        fs::write(&damaged, bytes).unwrap();
        let path = lerobot(folder.path(), &damaged);
        let error = open(&path).map(|dataset| dataset.schema().clone());
        let message = error.expect_err("a damaged table").to_string();
        assert!(message.contains("is damaged") && message.contains("file-000.parquet"), "{message}");
    }
}
