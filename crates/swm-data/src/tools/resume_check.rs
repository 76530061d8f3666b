//! Checks whether a dataset is the beginning of a copy, so that the copy can resume.
//!
//! Lengths are compared of all episodes, values of some rows of some episodes: a look at all of them would cost as much as
//! the copy.

use std::collections::BTreeSet;
use std::path::Path;

use swm_core::{Column, Dtype, Field, Registry};

use super::compare::difference;
use super::copy::Piece;
use crate::dataset::{Dataset, Steps};
use crate::entry::StoredImages;
use crate::error::DataError;
use crate::format;
use crate::recording::EP_IDX;

/// Episodes of which rows are compared.
const PROBES: usize = 16;
/// Episodes of which images are compared.
const IMAGE_PROBES: usize = 3;

/// How many of `pieces` the target holds already; an error if it holds something else.
///
/// Compared are the columns; of all episodes the lengths; of up to 16 episodes the first, middle and last row; and of up to 3 of them
/// the images of the first and last row, where the target keeps images without loss.
pub(super) fn copied_pieces(
    registry: &Registry,
    sources: &mut [Box<dyn Dataset>],
    pieces: &[Piece],
    to: &Path,
) -> Result<usize, DataError> {
    if !to.exists() || to.is_dir() && std::fs::read_dir(to).is_ok_and(|mut entries| entries.next().is_none())
    {
        return Ok(0);
    }
    let mut there = format::open_in(registry, to)?;
    let keeps_images =
        format::detect(registry, to).is_some_and(|format| format.images == StoredImages::Exact);
    let count = there.num_episodes();
    let differs =
        |what: String| Err(DataError::mismatch(to, format!("it is not the beginning of this copy: {what}")));
    if count > pieces.len() {
        return differs(format!("it holds {count} episodes, the source {}", pieces.len()));
    }
    if let Some(difference) =
        sources.first().and_then(|first| column_difference(there.as_ref(), first.as_ref()))
    {
        return differs(difference);
    }
    for (index, &(source, episode)) in pieces[..count].iter().enumerate() {
        let (rows, expected) = (there.episode_len(index), sources[source].episode_len(episode));
        if rows != expected {
            return differs(format!("its episode {index} has {rows} rows, not {expected}"));
        }
    }
    // Lengths are often all equal: some rows tell whether it is the same data.
    let images = if keeps_images { IMAGE_PROBES } else { 0 };
    for (probes, of_images) in [(PROBES, false), (images, true)] {
        for index in spread(count, probes) {
            let (source, episode) = pieces[index];
            let Some(last) = there.episode_len(index).checked_sub(1) else { continue };
            let rows =
                if of_images { BTreeSet::from([0, last]) } else { BTreeSet::from([0, last / 2, last]) };
            for row in rows {
                let here = sources[source].as_mut();
                let places = [(index, row), (episode, row)];
                if let Some(column) = different_column(there.as_mut(), here, places, of_images)? {
                    let what = if of_images { "images" } else { "column" };
                    return differs(format!(
                        "its {what} `{column}` in episode {index}, row {row} differ{} from {} of {}",
                        if of_images { "" } else { "s" },
                        if of_images { "those" } else { "that" },
                        sources[source].path().display()
                    ));
                }
            }
        }
    }
    Ok(count)
}

pub(super) fn is_image(field: &Field) -> bool {
    field.dtype == Dtype::U8 && field.shape.len() == 3
}

/// Up to `most` of `count` indices, with the first, the last and those evenly between them.
fn spread(count: usize, most: usize) -> BTreeSet<usize> {
    let (last, steps) = (count.saturating_sub(1), most.saturating_sub(1).max(1));
    (0..most.min(count)).map(|at| at * last / steps.min(last.max(1))).collect()
}

/// Which columns a copy of `here` would have and `there` has not, or the other way round, in words.
fn column_difference(there: &dyn Dataset, here: &dyn Dataset) -> Option<String> {
    let fields = |dataset: &dyn Dataset| dataset.schema().clone();
    let (found, wanted) = (fields(there), fields(here));
    let source = here.path().display();
    let is_own = |field: &&Field| field.name != EP_IDX;
    for field in wanted.fields().iter().filter(is_own) {
        let Some(at) = found.index(&field.name) else {
            return Some(format!("it has no column `{}`, which {source} has", field.name));
        };
        let other = &found.fields()[at];
        if is_image(field) && is_image(other) && other.shape != field.shape {
            return Some(format!("its images `{}` are {:?}, not {:?}", field.name, other.shape, field.shape));
        }
        if other.dim() != field.dim() {
            return Some(format!(
                "its column `{}` holds {:?}, that of {source} {:?}",
                field.name, other.shape, field.shape
            ));
        }
    }
    let more = found.fields().iter().filter(is_own).find(|field| wanted.index(&field.name).is_none())?;
    Some(format!("it has a column `{}`, which {source} has not", more.name))
}

/// The first column that differs in a row: of those with images, or of the others. Places are an episode and a row.
fn different_column(
    there: &mut dyn Dataset,
    here: &mut dyn Dataset,
    [at, from]: [(usize, usize); 2],
    of_images: bool,
) -> Result<Option<String>, DataError> {
    let schema = there.schema().clone();
    for (column, field) in schema.fields().iter().enumerate() {
        let Some(other) = here.schema().index(&field.name) else { continue };
        let is_other_type = here.schema().fields()[other].dtype != field.dtype;
        if is_other_type || field.name == EP_IDX || is_image(field) != of_images {
            continue;
        }
        let steps = |row| Steps { first: row, count: 1, stride: 1 };
        let [mut a, mut b] = [(); 2].map(|()| Column::zeros(field.dtype, field.dim()));
        there.read_column(column, at.0, steps(at.1), a.as_slice_mut())?;
        here.read_column(other, from.0, steps(from.1), b.as_slice_mut())?;
        if difference(&a.as_slice(), &b.as_slice(), 0.0).is_some() {
            return Ok(Some(field.name.clone()));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn probes_are_spread_over_all_episodes() {
        let of = |count, most| spread(count, most).into_iter().collect::<Vec<_>>();
        assert_eq!(of(0, 16), [] as [usize; 0]);
        assert_eq!(of(1, 16), [0]);
        assert_eq!(of(3, 16), [0, 1, 2]);
        assert_eq!(of(12, 3), [0, 5, 11]);
        assert_eq!(of(9, 0), [] as [usize; 0]);
        let many = of(1000, 16);
        assert_eq!((many.len(), many[0], many[15]), (16, 0, 999));
    }
}
