//! Replay buffers in Zarr, as of diffusion_policy and UMI: a folder or a zip archive with arrays of all steps in `data`, and the ends of
//! episodes in `meta/episode_ends`.
//!
//! Sources of the layouts: diffusion_policy 5ba07ac `common/replay_buffer.py`; the specifications of Zarr, versions 2 and 3.
//!
//! | file | duty |
//! |---|---|
//! | `store` | files of a folder or an archive, by key |
//! | `meta`, `fill` | the description of an array, in both versions |
//! | `codec`, `blosc` | chunks as they were before they were stored |
//! | `array` | rows out of chunks |

mod array;
mod blosc;
mod codec;
mod fill;
mod meta;
mod store;

pub(super) use codec::crc32c;

use std::path::Path;
use std::sync::Arc;

use array::ZarrArray;
use store::Store;
use swm_data::OpenOptions;
use swm_data::dataset::Dataset;
use swm_data::error::{At as _, DataError, Result, invalid, missing, unsupported};

use super::array::{Array, Joined, Scratch, Shared, is_number, numbers};
use super::found::{Found, Source};

pub(super) const NAME: &str = "zarr";

/// The array that tells a replay buffer from other stores.
const ENDS: &str = "meta/episode_ends";
/// Episodes of a dataset are never more.
const MAX_EPISODES: usize = 1 << 24;
/// The group of the arrays of all steps.
const DATA: &str = "data";

pub(super) fn detect(path: &Path) -> bool {
    matches!(Store::open(path), Ok(Some(_)))
}

pub(super) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Dataset>, DataError> {
    find(path).map_err(|error| DataError::damaged(path, error))?.open(path, NAME, options, &[])
}

fn find(path: &Path) -> Result<Found> {
    let store = Store::open(path)?.ok_or_else(|| missing(format!("`{ENDS}` is missing")))?;
    let store = Arc::new(store);
    let ends = ZarrArray::open(&store, ENDS).and_then(|ends| match ends.rows() {
        ..=MAX_EPISODES => numbers(&ends, &mut Scratch::default()),
        episodes => Err(invalid(format!("it claims {episodes} episodes"))),
    });
    let mut found = Found { lengths: lengths(&ends.at(ENDS)?).at(ENDS)?, ..Found::default() };
    let rows: usize = found.lengths.iter().sum();
    let step = |path: &str, array: Shared, found: &mut Found| {
        let spans = found.end_to_end();
        found.sources.push(Source::step(path, &path.replace('/', "."), vec![array], spans));
    };
    let mut behind = Vec::new();
    for name in store.arrays(DATA)? {
        let whole = format!("{DATA}/{name}");
        match ZarrArray::open(&store, &whole) {
            Ok(array) if array.rows() < rows => {
                let own = array.rows();
                let reason = format!("it has {own} rows, and `{ENDS}` ends at {rows}");
                found.skipped.push((name.replace('/', "."), reason));
            }
            Ok(array) => {
                behind.push((name.clone(), array.rows() - rows));
                step(&name, Arc::new(array), &mut found);
            }
            Err(error) if error.is_unsupported() => {
                found.skipped.push((name.replace('/', "."), error.to_string()));
            }
            Err(error) => return Err(error.at(whole)),
        }
    }
    if found.sources.is_empty() {
        return Err(match &found.skipped[..] {
            [] => missing(format!("`{DATA}` has no arrays")),
            [(name, reason), ..] => {
                unsupported(format!("none of its arrays can be read; `{name}`: {reason}"))
            }
        });
    }
    about_rest(&behind, &mut found);
    about_pusht(&mut found)?;
    Ok(found)
}

/// Notes rows behind the last end, which are of no episode: by array, how many.
fn about_rest(behind: &[(String, usize)], found: &mut Found) {
    let Some(&(_, first)) = behind.first() else { return };
    if first > 0 && behind.iter().all(|&(_, rows)| rows == first) {
        found.notes.push(format!(
            "all of its arrays have {first} rows behind the last end of `{ENDS}`, which are left out: they are an episode whose end is not \
             marked, as a recording that was interrupted has it; append {} to `{ENDS}` to read it",
            found.lengths.iter().sum::<usize>() + first
        ));
        return;
    }
    let note = |(name, rows): &(String, usize)| {
        format!("`{name}` has {rows} rows behind the last end of `{ENDS}`, which are left out")
    };
    found.notes.extend(behind.iter().filter(|(_, rows)| *rows > 0).map(note));
}

/// Lengths of episodes, from where each ends among all rows.
fn lengths(ends: &[f64]) -> Result<Vec<usize>> {
    /// Rows of a dataset are never more.
    const MOST: f64 = 1e12;
    let mut before = 0.0;
    let mut lengths = Vec::with_capacity(ends.len());
    for (episode, &end) in ends.iter().enumerate() {
        if end.fract() != 0.0 || end < before || end > MOST {
            return Err(invalid(format!("episode {episode} would be the rows from {before} to {end}")));
        }
        lengths.push((end - before) as usize);
        before = end;
    }
    Ok(lengths)
}

/// What is known of the human demonstrations of PushT, which are recognized by their columns.
fn about_pusht(found: &mut Found) -> Result<()> {
    let array = |name: &str| {
        let source = found.sources.iter().find(|source| source.old == name)?;
        source.arrays.first().cloned()
    };
    let is_of = |name: &str, shape: &[usize]| array(name).is_some_and(|array| array.shape() == shape);
    let (true, Some(state)) = (is_of("action", &[2]) && is_of("keypoint", &[9, 2]), array("state")) else {
        return Ok(());
    };
    if state.shape() != [5] || !is_number(state.dtype()) {
        return Ok(());
    }
    let spans = found.end_to_end();
    found.sources.push(Source::step("state[:2]", "proprio", vec![Joined::of(vec![(state, 2)])?], spans));
    found.notes.push(
        "its columns are those of PushT's human demonstrations: `action` is the target of the agent in pixels of 512, as the option `env` \
         swm/PushT-v1 with `env_options` relative=false takes it; `state` is agent x, y and block x, y, angle, without velocities"
            .to_owned(),
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_grow() {
        assert_eq!(lengths(&[3.0, 5.0, 9.0]).unwrap(), [3, 2, 4]);
        assert_eq!(lengths(&[0.0, 3.0, 3.0, 4.0]).unwrap(), [0, 3, 0, 1]);
        for wrong in [&[5.0, 2.0][..], &[-1.0], &[1.5], &[f64::NAN], &[1e15]] {
            assert!(lengths(wrong).is_err(), "{wrong:?}");
        }
    }
}
