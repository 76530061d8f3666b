//! Types of numbers that others write and this project does not: kept without loss, or left out with the reason.

use std::path::{Path, PathBuf};

use serde_json::Value as Json;
use swm_core::{Batch, Column, Dtype};
use swm_data::tools::verify::verify;

use crate::copied;
use crate::support::contents;
use crate::{mutate, open};

/// A file or folder that `tests/golden/others/make.py` made.
pub(crate) fn others(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/others").join(name)
}

/// The values of a column, row after row.
fn expected(name: &str) -> Vec<Json> {
    fn leaves(value: &Json, all: &mut Vec<Json>) {
        match value.as_array() {
            Some(values) => values.iter().for_each(|value| leaves(value, all)),
            None => all.push(value.clone()),
        }
    }
    let text = std::fs::read_to_string(others("values.json")).unwrap();
    let (all, mut found): (Json, _) = (serde_json::from_str(&text).unwrap(), Vec::new());
    leaves(&all[name], &mut found);
    found
}

/// All values of a column.
pub(crate) fn values(path: &Path, name: &str) -> Column {
    let parts = contents(path);
    let part = |batch: &Batch| batch.column(batch.schema().require(name).unwrap()).to_column();
    let mut all = part(&parts[0]);
    parts[1..].iter().for_each(|batch| assert!(all.extend(part(batch).as_slice())));
    all
}

/// Compares a column with what was written under the name behind the last `_`; how it is stored comes before that.
pub(crate) fn assert_kept(path: &Path, name: &str) {
    let written = name.rsplit_once('_').map_or(name, |(_, written)| written);
    let (found, expected) = (values(path, name), expected(written));
    let wanted = match written {
        "u32" | "u64" => Dtype::I64,
        "i16" => Dtype::I32,
        "matrix" => Dtype::F64,
        _ => Dtype::F32,
    };
    assert_eq!((found.dtype(), found.len()), (wanted, expected.len()), "{name}");
    for (at, expected) in expected.iter().enumerate() {
        match &found {
            Column::I64(values) => assert_eq!(Some(values[at]), expected.as_i64(), "{name}, {at}"),
            column => assert_eq!(column.as_slice().as_f64(at), expected.as_f64(), "{name}, {at}"),
        }
    }
}

/// The reason for which a column is left out.
pub(crate) fn reason(path: &Path, name: &str) -> String {
    let dataset = open(path).unwrap();
    assert!(dataset.schema().index(name).is_none(), "{name} is read");
    let skipped = dataset.info().skipped.iter().find(|(skipped, _)| skipped == name);
    skipped.unwrap_or_else(|| panic!("{name} is not told")).1.clone()
}

#[test]
fn numbers_of_hdf5_are_kept_or_left_out_with_the_reason() {
    let path = others("types.h5");
    let types = ["u32", "u64", "f16", "i16", "matrix"];
    let names = types.iter().flat_map(|name| [(*name).to_owned(), format!("big_{name}")]);
    let stored = ["bf16", "gz_f16", "gz_bf16", "gz_u64", "lzf_u64", "float_bf16"].map(str::to_owned);
    names.chain(stored).for_each(|name| assert_kept(&path, &name));
    for name in ["too_large", "lzf_too_large"] {
        let reason = reason(&path, name);
        assert!(
            reason.contains("the u64 9223372036854775808") && reason.contains("9223372036854775807"),
            "{reason}"
        );
    }
    for (name, part) in [
        ("complex", "compound"),
        ("long", "float of 128 bits"),
        ("three_bytes", "opaque (3 bytes"),
        ("lzf_words", "compressed text of fixed length is not read"),
        ("lzf_bf16", "bfloat16, which h5py stores as opaque bytes"),
    ] {
        let reason = reason(&path, name);
        assert!(reason.contains(part), "{name}: {reason}");
    }
    let report = verify(open(&path).unwrap().as_mut(), &mut |_| {});
    assert!(report.problems.is_empty(), "{:?}", report.problems);
    assert!(report.notes.iter().any(|note| note.contains("`too_large` cannot be read and is left out")));
}

#[test]
fn arrays_of_numpy_are_kept_in_any_order_of_bytes_and_elements() {
    let path = others("types.folder");
    for name in ["u32", "u64", "f16", "bf16", "i16", "matrix"] {
        let stored =
            ["", "columns_", "big_", "gz_big_"].iter().filter(|how| name != "bf16" || !how.contains("big"));
        stored.for_each(|how| assert_kept(&path, &format!("{how}{name}")));
    }
    let Column::Str(words) = values(&path, "words") else { panic!("no texts") };
    assert_eq!((&words[0][..], &words[11][..]), ("wört0", "wört11"));
    // A part of rows, in strides.
    let mut dataset = open(&path).unwrap();
    let column = dataset.schema().require("columns_matrix").unwrap();
    let mut out = [0.0; 12];
    let steps = swm_data::Steps { first: 1, count: 2, stride: 3 };
    dataset.read_column(column, 1, steps, swm_core::SliceMut::F64(&mut out)).unwrap();
    assert_eq!((out[0], out[5], out[6]), (6.0, 6.5, 9.0));
    for (name, part) in
        [("too_large", "the u64 9223372036854775808"), ("complex", "`<c16`"), ("two_bytes", "`|V2`")]
    {
        let reason = reason(&path, name);
        assert!(reason.contains(part), "{name}: {reason}");
    }
}

#[test]
fn no_mutation_makes_a_reader_trip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("types.folder");
    copied(&others("types.folder"), &path);
    mutate("types.folder", &path);
}
