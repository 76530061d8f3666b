//! A fingerprint of a dataset from a few of its rows: whether what continues on it was begun on the same values.

use swm_core::evaluate::sha256;
use swm_core::{Column, Slice};

use crate::dataset::{Dataset, Steps};
use crate::error::DataError;

/// Rows that are read: each costs a seek, and in videos the frames since the last key frame.
const ROWS: u64 = 64;

/// SHA-256 of those of `columns` that `dataset` holds, images included, in up to 64 rows that are spread over all of its episodes. It depends on
/// values and their types alone: formats without loss keep it. Other rows may differ all the same.
///
/// # Errors
///
/// A row cannot be read.
pub fn sample_digest(dataset: &dyn Dataset, columns: &[&str]) -> Result<String, DataError> {
    let mut dataset = dataset.share();
    let mut names = columns.to_vec();
    names.sort_unstable();
    names.dedup();
    let fields = dataset.schema().fields();
    let found = names.iter().filter_map(|name| fields.iter().position(|field| field.name == *name));
    let mut values: Vec<(usize, Column)> =
        found.map(|index| (index, Column::zeros(fields[index].dtype, fields[index].dim()))).collect();
    let mut bytes = Vec::new();
    for (index, _) in &values {
        let field = &fields[*index];
        bytes.extend(format!("{} {:?} {:?}\n", field.name, field.dtype, field.shape).bytes());
    }
    for (episode, row) in rows(dataset.as_ref()) {
        for (index, column) in &mut values {
            let steps = Steps { first: row, count: 1, stride: 1 };
            dataset.read_column(*index, episode, steps, column.as_slice_mut())?;
            append(&mut bytes, column.as_slice());
        }
        // Images may be large.
        bytes = sha256(&bytes).into_bytes();
    }
    Ok(sha256(&bytes))
}

/// The sampled rows: in the middle of stretches of one length.
fn rows(dataset: &dyn Dataset) -> Vec<(usize, usize)> {
    let lens: Vec<u64> =
        (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode) as u64).collect();
    let all: u64 = lens.iter().sum();
    let count = all.min(ROWS);
    let (mut episode, mut first) = (0, 0);
    let mut found = Vec::with_capacity(count as usize);
    for index in 0..count {
        let row = (u128::from(2 * index + 1) * u128::from(all) / u128::from(2 * count)) as u64;
        while row >= first + lens[episode] {
            first += lens[episode];
            episode += 1;
        }
        found.push((episode, (row - first) as usize));
    }
    found
}

fn append(bytes: &mut Vec<u8>, values: Slice<'_>) {
    // There are several NaN, and formats need not keep which.
    match values {
        Slice::Bool(values) => bytes.extend(values.iter().map(|&value| u8::from(value))),
        Slice::U8(values) => bytes.extend_from_slice(values),
        Slice::I32(values) => bytes.extend(values.iter().flat_map(|value| value.to_le_bytes())),
        Slice::I64(values) => bytes.extend(values.iter().flat_map(|value| value.to_le_bytes())),
        Slice::F32(values) => bytes.extend(
            values.iter().flat_map(|&value| if value.is_nan() { f32::NAN } else { value }.to_le_bytes()),
        ),
        Slice::F64(values) => bytes.extend(
            values.iter().flat_map(|&value| if value.is_nan() { f64::NAN } else { value }.to_le_bytes()),
        ),
        Slice::Str(values) => {
            for value in values {
                bytes.extend((value.len() as u64).to_le_bytes());
                bytes.extend(value.bytes());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use swm_core::{Batch, Dtype, Field, Schema};

    use super::*;
    use crate::MemoryDataset;

    /// Two episodes of `len` rows with images of one color.
    fn dataset(len: usize, color: u8, with_more: bool) -> MemoryDataset {
        let mut fields =
            vec![Field::step("pixels", Dtype::U8, &[2, 2, 3]), Field::step("action", Dtype::F32, &[1])];
        if with_more {
            fields.insert(0, Field::step("more", Dtype::F64, &[1]));
        }
        let schema = Schema::new(fields).unwrap();
        let mut episode = Batch::new(schema.clone(), len);
        for row in 0..len {
            let at = usize::from(with_more);
            episode.rows_mut().select(row).write(at, &[color; 12]);
            episode.rows_mut().select(row).write(at + 1, &[row as f32]);
        }
        let episode = Arc::new(episode);
        MemoryDataset::new("toy", schema, None, vec![episode.clone(), episode]).unwrap()
    }

    #[test]
    fn other_images_are_another_dataset() {
        let of = |dataset: &MemoryDataset| sample_digest(dataset, &["pixels", "action", "none"]).unwrap();
        for len in [1, 3, 500] {
            let white = of(&dataset(len, 255, false));
            assert_ne!(white, of(&dataset(len, 254, false)));
            assert_eq!(white, of(&dataset(len, 255, true)), "a column that is not named");
        }
        let empty =
            MemoryDataset::new("toy", dataset(1, 0, false).schema().clone(), None, Vec::new()).unwrap();
        assert_ne!(of(&empty), of(&dataset(1, 0, false)));
    }

    #[test]
    fn rows_are_spread_over_all_episodes() {
        let rows = rows(&dataset(500, 0, false));
        assert_eq!((rows.len(), rows[0], rows[63]), (64, (0, 7), (1, 492)));
    }
}
