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
    /// Of these, rows where one dataset holds NaN and the other a number.
    pub nan_rows: usize,
    /// The largest absolute difference of two numbers; 0 where there is none, as of texts.
    pub largest: f64,
    /// Episode and row of the first difference.
    pub first: Option<[usize; 2]>,
    /// Of images: the peak signal-to-noise ratio in dB over all rows; none where they are equal.
    pub psnr: Option<f64>,
}

/// Compares all values of the `wanted` columns. `ep_idx`, which copies have of datasets without it, counts only where both have it. Numbers may differ by `tolerance`. `watch` is told after each episode how many rows it has.
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
            None if field.name == EP_IDX => {}
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
    let is_more =
        |field: &&Field| wanted(&field.name) && field.name != EP_IDX && left.index(&field.name).is_none();
    let more = right.fields().iter().filter(is_more);
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
                    if let Some(found) = difference(&x.as_slice(), &y.as_slice(), tolerance) {
                        column.rows += 1;
                        column.nan_rows += usize::from(found.is_nan);
                        column.largest = column.largest.max(found.largest);
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
    let alike: Vec<&Field> = shared.iter().map(|(at, ..)| &left.fields()[*at]).collect();
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
        found.shared = Some(shared_episodes(a, b, &alike)?);
    }
    Ok(found)
}

/// Which episodes of `b` are in `a`, by those of these columns, which both have alike, that are neither images nor the episode's index.
fn shared_episodes(
    a: &mut dyn Dataset,
    b: &mut dyn Dataset,
    columns: &[&Field],
) -> Result<SharedEpisodes, DataError> {
    let is_told = |field: &Field| field.shape.len() < 3 && field.name != EP_IDX;
    let columns: Vec<&Field> = columns.iter().copied().filter(|field| is_told(field)).collect();
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

/// How two rows differ.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Difference {
    /// The largest absolute difference of two numbers.
    largest: f64,
    /// Whether a value is NaN in one of them alone.
    is_nan: bool,
}

/// How two rows of a column differ, if by more than the tolerance; NaN equals NaN, and of texts there is no size.
pub(super) fn difference(a: &Slice<'_>, b: &Slice<'_>, tolerance: f64) -> Option<Difference> {
    if let (Slice::Str(a), Slice::Str(b)) = (a, b) {
        return (a != b).then_some(Difference::default());
    }
    let mut found = Difference::default();
    for at in 0..a.len().max(b.len()) {
        let value = |row: &Slice<'_>| (at < row.len()).then(|| row.as_f64(at)).flatten().unwrap_or(f64::NAN);
        let (x, y) = (value(a), value(b));
        match (x.is_nan(), y.is_nan()) {
            (true, true) => {}
            (false, false) if x == y => {}
            (false, false) => found.largest = found.largest.max((x - y).abs()),
            _ => found.is_nan = true,
        }
    }
    (found.is_nan || found.largest > tolerance).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_rows() {
        let nan = f64::NAN;
        let of = |a: &[f64], b: &[f64], tolerance| difference(&Slice::F64(a), &Slice::F64(b), tolerance);
        let by = |largest, is_nan| Some(Difference { largest, is_nan });
        assert_eq!(of(&[1.0, nan], &[1.5, nan], 0.0), by(0.5, false));
        assert_eq!(of(&[1.0], &[1.5], 0.5), None);
        assert_eq!(of(&[nan, 3.0], &[1.5, 1.0], 9.0), by(2.0, true));
        assert_eq!(of(&[f64::INFINITY], &[1.5], 9.0), by(f64::INFINITY, false));
        assert_eq!(difference(&Slice::Str(&["a".into()]), &Slice::Str(&["a".into()]), 0.0), None);
        assert_eq!(difference(&Slice::Str(&["a".into()]), &Slice::Str(&["b".into()]), 0.0), by(0.0, false));
    }
}
