//! Parquet tables in codecs that other programs write, in datasets of Minari: read, or refused by the name of the codec.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::Batch;
use swm_data::testing::{assert_same, contents_in};

use crate::{copied, open, registry};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden").join(name)
}

/// A copy of a dataset of Minari whose second episode is another table, which pyarrow wrote.
fn minari(folder: &Path, table: &str) -> PathBuf {
    let path = folder.join(table);
    copied(&golden("field/minari_parquet"), &path);
    fs::copy(golden("others/codecs").join(format!("{table}.parquet")), path.join("data/1/part-0.parquet"))
        .unwrap();
    path
}

fn contents(path: &Path) -> Vec<Batch> {
    contents_in(registry(), path)
}

#[test]
fn tables_of_minari_are_read_in_the_codecs_of_pyarrow() {
    let folder = tempfile::tempdir().unwrap();
    let expected = contents(&golden("field/minari_parquet"));
    for codec in ["gzip", "zstd", "lz4"] {
        let found = contents(&minari(folder.path(), &format!("minari_{codec}")));
        assert_eq!(found.len(), expected.len());
        found.iter().zip(&expected).for_each(|(found, expected)| assert_same(found, expected));
    }
}

#[test]
fn a_codec_that_is_not_read_is_an_error_with_the_fix() {
    let folder = tempfile::tempdir().unwrap();
    let message = open(&minari(folder.path(), "minari_brotli")).err().unwrap().to_string();
    for part in ["1/part-0.parquet", "`observations", "Brotli", "is not read", "compression=\"zstd\""] {
        assert!(message.contains(part), "{part}: {message}");
    }
    assert!(!message.contains("is damaged"), "{message}");
}
