//! Files of LIBERO, whose observations are one step late: those of a row are after its action, and its `states` before it. Sets that were
//! made anew from them are aligned, and have the same layout.

use swm_data::error::Result;
use swm_data::hdf5::Tree;

use super::array::{Scratch, numbers};

/// Whether actions and states of a row are those of the next one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Shift {
    No,
    Yes,
}

/// Values of `states` in front of the joints.
const TIME: usize = 1;
const JOINTS: usize = 7;

const UNKNOWN: &str =
    "the file does not show whether the observations of a row are before its action (0) or after it (1)";

/// Finds the shift by the joints, which both `obs/joint_states` and `states` hold: by the first episode in which they move. The inner error
/// asks for it.
pub(super) fn shift_of(tree: &Tree, groups: &[String], given: Option<u8>) -> Result<Result<Shift, String>> {
    if let Some(given) = given {
        return Ok(Ok(if given == 1 { Shift::Yes } else { Shift::No }));
    }
    let mut has_joints = false;
    for group in groups {
        let Some([joints, states]) = joints(tree, group)? else { continue };
        has_joints |= !joints.is_empty();
        if joints.len() <= JOINTS {
            continue;
        }
        let is_moved_by = |by: usize| {
            let near = |(a, b): (&f64, &f64)| (a - b).abs() <= 1e-5 * a.abs().max(1.0);
            joints.iter().zip(&states[by * JOINTS..]).all(near)
        };
        match (is_moved_by(0), is_moved_by(1)) {
            (true, true) => {}
            (true, false) => return Ok(Ok(Shift::No)),
            (false, true) => return Ok(Ok(Shift::Yes)),
            (false, false) => {
                return Ok(Err(format!("{UNKNOWN}: `obs/joint_states` are not in `states`; say which")));
            }
        }
    }
    Ok(match has_joints {
        true => Err(format!("{UNKNOWN}: no episode has joints that move; say which")),
        false => Ok(Shift::No),
    })
}

/// The joints of the rows of an episode, as observations and as states have them.
fn joints(tree: &Tree, group: &str) -> Result<Option<[Vec<f64>; 2]>> {
    let read = |path: &str| match tree.table(group, path) {
        Ok(table) => {
            let (width, rows) = (table.shape().iter().product::<usize>(), super::hdf5::rows_of(table));
            numbers(rows.as_ref(), &mut Scratch::default()).map(|values| Some((width, values)))
        }
        Err(_) => Ok(None),
    };
    let (Some((JOINTS, joints)), Some((width, states))) = (read("obs/joint_states")?, read("states")?) else {
        return Ok(None);
    };
    let rows = joints.len() / JOINTS;
    if width < TIME + JOINTS || states.len() / width != rows {
        return Ok(None);
    }
    let states = states.chunks_exact(width).flat_map(|state| state[TIME..][..JOINTS].to_vec());
    Ok(Some([joints, states.collect()]))
}
