//! Two datasets side by side: which columns, episodes and values differ, and by how much.

use std::collections::HashSet;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use serde::Serialize;
use swm_core::{Column, Field, Slice};

use super::rows_per_block;
use crate::dataset::{Dataset, Steps};
use crate::error::DataError;
use crate::recording::EP_IDX;

/// What differs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Comparison {
    /// Whether nothing does, within the tolerance.
    pub equal: bool,
    /// Episodes of the first and the second dataset.
    pub episodes: [usize; 2],
    /// Columns that one of them lacks, or that have another type or shape there.
    pub schema: Vec<String>,
    /// Episodes of different lengths.
    pub lengths: Vec<usize>,
    /// Columns that both have.
    pub columns: Vec<ColumnComparison>,
    /// Where something differs: the episodes of the second dataset that the first one holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shared: Option<SharedEpisodes>,
}

/// How many episodes of the second dataset the first one holds, by all columns but images and the episode's index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct SharedEpisodes {
    /// At any place.
    pub held: usize,
    /// Of these, at another place.
    pub moved: usize,
}

/// How a column differs.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ColumnComparison {
    /// Its name.
    pub name: String,
    /// Rows that differ by more than the tolerance.
    pub rows: usize,
    /// The largest absolute difference of two numbers; infinite where only one of them is a number.
    pub largest: f64,
    /// Episode and row of the first difference.
    pub first: Option<[usize; 2]>,
    /// Of images: the peak signal-to-noise ratio in dB over all rows; none where they are equal.
    pub psnr: Option<f64>,
}

/// Compares all values of the `wanted` columns. Numbers may differ by `tolerance`. `watch` is told after each episode how many rows it has.
///
/// # Errors
///
/// Whatever reading may meet.
pub fn compare(
    a: &mut dyn Dataset,
    b: &mut dyn Dataset,
    wanted: &dyn Fn(&str) -> bool,
    tolerance: f64,
    watch: &mut dyn FnMut(usize),
) -> Result<Comparison, DataError> {
    let mut found = Comparison { episodes: [a.num_episodes(), b.num_episodes()], ..Comparison::default() };
    let (left, right) = (a.schema().clone(), b.schema().clone());
    let mut shared = Vec::new();
    for (at, field) in left.fields().iter().enumerate().filter(|(_, field)| wanted(&field.name)) {
        match right.index(&field.name).map(|index| (index, &right.fields()[index])) {
            None => found.schema.push(format!("only the first has `{}`", field.name)),
            Some((index, other)) if other.dtype == field.dtype && other.shape == field.shape => {
                shared.push((
                    at,
                    index,
                    ColumnComparison { name: field.name.clone(), ..Default::default() },
                    0.0,
                    0usize,
                ));
            }
            Some((_, other)) => found.schema.push(format!(
                "`{}` holds {} {:?} in the first, {} {:?} in the second",
                field.name, field.dtype, field.shape, other.dtype, other.shape
            )),
        }
    }
    let more = right.fields().iter().filter(|field| wanted(&field.name) && left.index(&field.name).is_none());
    found.schema.extend(more.map(|field| format!("only the second has `{}`", field.name)));

    for episode in 0..a.num_episodes().min(b.num_episodes()) {
        let rows = a.episode_len(episode).min(b.episode_len(episode));
        if a.episode_len(episode) != b.episode_len(episode) {
            found.lengths.push(episode);
        }
        for (at, other, column, squares, count) in &mut shared {
            let field = &left.fields()[*at];
            let per_block = rows_per_block(field);
            for first in (0..rows).step_by(per_block) {
                let steps = Steps { first, count: per_block.min(rows - first), stride: 1 };
                let [mut x, mut y] = [(); 2].map(|()| Column::zeros(field.dtype, steps.count * field.dim()));
                a.read_column(*at, episode, steps, x.as_slice_mut())?;
                b.read_column(*other, episode, steps, y.as_slice_mut())?;
                for row in 0..steps.count {
                    let range = |column: &'_ Column| -> Column {
                        column.as_slice().range(row * field.dim(), field.dim()).to_column()
                    };
                    let is_equal = x.as_slice().range(row * field.dim(), field.dim())
                        == y.as_slice().range(row * field.dim(), field.dim());
                    if is_equal {
                        continue;
                    }
                    let (x, y) = (range(&x), range(&y));
                    if let Some(largest) = difference(&x.as_slice(), &y.as_slice(), tolerance) {
                        column.rows += 1;
                        column.largest = column.largest.max(largest);
                        column.first.get_or_insert([episode, first + row]);
                    }
                    if let (Column::U8(x), Column::U8(y)) = (&x, &y) {
                        *squares +=
                            x.iter().zip(y).map(|(&x, &y)| f64::from(x.abs_diff(y)).powi(2)).sum::<f64>();
                    }
                }
                *count += steps.count * field.dim();
            }
        }
        watch(rows);
    }
    found.columns = shared
        .into_iter()
        .map(|(at, _, column, squares, count)| {
            let is_image = left.fields()[at].shape.len() == 3 && squares > 0.0;
            let psnr = is_image.then(|| 10.0 * (65_025.0 * count as f64 / squares).log10());
            ColumnComparison { psnr, ..column }
        })
        .collect();
    found.equal = found.schema.is_empty()
        && found.lengths.is_empty()
        && found.episodes[0] == found.episodes[1]
        && found.columns.iter().all(|column| column.rows == 0);
    if !found.equal {
        let columns: Vec<&Field> = left.fields().iter().filter(|field| wanted(&field.name)).collect();
        found.shared = Some(shared_episodes(a, b, &columns)?);
    }
    Ok(found)
}

/// Which episodes of `b` are in `a`, by those of these columns that both have and that are neither images nor the episode's index.
fn shared_episodes(
    a: &mut dyn Dataset,
    b: &mut dyn Dataset,
    columns: &[&Field],
) -> Result<SharedEpisodes, DataError> {
    let is_told = |field: &Field| field.shape.len() < 3 && field.name != EP_IDX;
    let columns: Vec<&Field> = columns
        .iter()
        .copied()
        .filter(|field| is_told(field) && b.schema().index(&field.name).is_some())
        .collect();
    if columns.is_empty() {
        return Ok(SharedEpisodes::default());
    }
    let all = |dataset: &mut dyn Dataset| -> Result<Vec<u64>, DataError> {
        (0..dataset.num_episodes()).map(|episode| fingerprint(dataset, episode, &columns)).collect()
    };
    let (first, second) = (all(a)?, all(b)?);
    let held: HashSet<&u64> = first.iter().collect();
    let found = second.iter().enumerate().filter(|(_, print)| held.contains(print));
    let moved = found.clone().filter(|&(at, print)| first.get(at) != Some(print)).count();
    Ok(SharedEpisodes { held: found.count(), moved })
}

/// A hash over all values of an episode in some columns.
fn fingerprint(dataset: &mut dyn Dataset, episode: usize, columns: &[&Field]) -> Result<u64, DataError> {
    let rows = dataset.episode_len(episode);
    let mut hash = DefaultHasher::new();
    for field in columns {
        let Some(column) = dataset.schema().index(&field.name) else { continue };
        let mut values = Column::zeros(field.dtype, rows * field.dim());
        dataset.read_column(
            column,
            episode,
            Steps { first: 0, count: rows, stride: 1 },
            values.as_slice_mut(),
        )?;
        match values.as_slice() {
            Slice::Str(texts) => texts.hash(&mut hash),
            numbers => {
                (0..numbers.len()).for_each(|at| numbers.as_f64(at).map(f64::to_bits).hash(&mut hash));
            }
        }
    }
    Ok(hash.finish())
}

/// The largest absolute difference of two rows if it is above the tolerance; NaN equals NaN, texts differ by infinity.
pub(super) fn difference(a: &Slice<'_>, b: &Slice<'_>, tolerance: f64) -> Option<f64> {
    if let (Slice::Str(a), Slice::Str(b)) = (a, b) {
        return (a != b).then_some(f64::INFINITY);
    }
    let mut largest = 0.0f64;
    for at in 0..a.len().max(b.len()) {
        if at >= a.len() || at >= b.len() {
            return Some(f64::INFINITY);
        }
        let (Some(x), Some(y)) = (a.as_f64(at), b.as_f64(at)) else { return Some(f64::INFINITY) };
        let gap = if x == y || x.is_nan() && y.is_nan() { 0.0 } else { (x - y).abs() };
        largest = largest.max(if gap.is_nan() { f64::INFINITY } else { gap });
    }
    (largest > tolerance).then_some(largest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_rows() {
        let nan = f64::NAN;
        assert_eq!(difference(&Slice::F64(&[1.0, nan]), &Slice::F64(&[1.5, nan]), 0.0), Some(0.5));
        assert_eq!(difference(&Slice::F64(&[1.0]), &Slice::F64(&[1.5]), 0.5), None);
        assert_eq!(difference(&Slice::F64(&[nan]), &Slice::F64(&[1.5]), 9.0), Some(f64::INFINITY));
        assert_eq!(difference(&Slice::Str(&["a".into()]), &Slice::Str(&["a".into()]), 0.0), None);
    }
}
