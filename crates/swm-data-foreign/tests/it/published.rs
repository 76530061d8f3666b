//! What the packages of other programs read from their published datasets, and how it is compared.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use sha2::{Digest as _, Sha256};
use swm_core::Column;
use swm_data::{DataError, Dataset, OpenOptions, Steps, open_with};

use crate::registry;

pub(crate) fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field").join(name)
}

pub(crate) fn opened(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    open_with(registry(), path, options)
}

/// Rows of a column, from one on.
pub(crate) fn rows(
    dataset: &mut dyn Dataset,
    column: usize,
    episode: usize,
    first: usize,
    count: usize,
) -> Column {
    let field = dataset.schema().fields()[column].clone();
    let mut out = Column::zeros(field.dtype, count * field.dim());
    dataset.rows(column, episode, Steps { first, count, stride: 1 }, out.as_slice_mut()).unwrap();
    out
}

pub(crate) fn numbers(column: &Column) -> Vec<f64> {
    if let Column::Bool(marks) = column {
        return marks.iter().map(|&mark| f64::from(u8::from(mark))).collect();
    }
    (0..column.len()).map(|at| column.as_slice().as_f64(at).unwrap()).collect()
}

pub(crate) fn column_of(dataset: &dyn Dataset, name: &str) -> usize {
    dataset.schema().index(name).unwrap_or_else(|| panic!("no column `{name}` in {:?}", dataset.schema()))
}

pub(crate) fn json_of(name: &str) -> Value {
    serde_json::from_slice(&fs::read(golden(&format!("{name}.expected.json"))).unwrap()).unwrap()
}

pub(crate) fn naturals(value: &Value) -> Vec<usize> {
    value.as_array().unwrap().iter().map(|value| value.as_u64().unwrap() as usize).collect()
}

/// Whether the columns of a sample are those of its JSON. `names` gives ours, and what theirs are divided by.
pub(crate) fn check(sample: &str, options: &OpenOptions, names: &[(&str, &str, f64)]) -> Box<dyn Dataset> {
    let expected = json_of(sample);
    let mut dataset = opened(&golden(sample), options).unwrap();
    let dataset_ref = dataset.as_mut();
    for (theirs, found) in expected["columns"].as_object().unwrap() {
        let Some(&(_, ours, divisor)) = names.iter().find(|(name, _, _)| name == theirs) else {
            panic!("the test of {sample} has no name for `{theirs}`");
        };
        let column = column_of(dataset_ref, ours);
        let (mut sum, mut all) = (0.0, Vec::new());
        for (episode, &count) in naturals(&found["rows"]).iter().enumerate() {
            let values = numbers(&rows(dataset_ref, column, episode, 0, count));
            assert!(
                values.iter().all(|value| value.is_finite()),
                "{sample} {ours}: a value that exists is missing"
            );
            sum += values.iter().sum::<f64>();
            all.extend(values);
        }
        let width = found["first"].as_array().unwrap().len();
        // A vector of ours may be longer: theirs and another one.
        let near = |ours: &[f64], theirs: &Value| {
            theirs.as_array().unwrap().iter().zip(ours).all(|(theirs, ours)| {
                let theirs = theirs.as_f64().unwrap() / divisor;
                (theirs - ours).abs() <= theirs.abs() * if divisor == 1.0 { 0.0 } else { 1e-7 }
            })
        };
        let dim = dataset_ref.schema().dim(column);
        assert!(near(&all[..width], &found["first"]), "{sample} {ours}: {:?}", &all[..width]);
        if dim == width {
            assert!(near(&all[all.len() - width..], &found["last"]), "{sample} {ours}");
            let theirs = found["sum"].as_f64().unwrap() / divisor;
            assert!((sum - theirs).abs() <= 1e-5 * theirs.abs().max(1.0), "{sample} {ours}: {sum} {theirs}");
        }
    }
    for (_, image) in expected["images"].as_object().unwrap() {
        let Some(hash) = image["sha256_of_u8_rgb"].as_str() else { continue };
        let (column, at) =
            (column_of(dataset_ref, "pixels"), |name: &str| image[name].as_u64().unwrap() as usize);
        let Column::U8(bytes) = rows(dataset_ref, column, at("episode"), at("row"), 1) else {
            panic!("{sample}")
        };
        assert_eq!(Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect::<String>(), hash);
        assert_eq!(dataset_ref.schema().fields()[column].shape, naturals(&image["shape"]));
    }
    dataset
}

/// The lengths of all episodes.
pub(crate) fn lengths(dataset: &dyn Dataset) -> Vec<usize> {
    (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode)).collect()
}
