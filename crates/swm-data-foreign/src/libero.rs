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

/// Finds the shift by the joints, which both `obs/joint_states` and `states` hold. The inner error asks for it.
pub(super) fn shift_of(tree: &Tree, group: &str, given: Option<u8>) -> Result<Result<Shift, String>> {
    if let Some(given) = given {
        return Ok(Ok(if given == 1 { Shift::Yes } else { Shift::No }));
    }
    let read = |path: &str| match tree.table(group, path) {
        Ok(table) => {
            let (width, rows) = (table.shape().iter().product::<usize>(), super::hdf5::rows_of(table));
            numbers(rows.as_ref(), &mut Scratch::default()).map(|values| Some((width, values)))
        }
        Err(_) => Ok(None),
    };
    let (Some((JOINTS, joints)), Some((width, states))) = (read("obs/joint_states")?, read("states")?) else {
        return Ok(Ok(Shift::No));
    };
    let rows = joints.len() / JOINTS;
    if width < TIME + JOINTS || rows < 2 || states.len() / width != rows {
        return Ok(Ok(Shift::No));
    }
    let is_moved_by = |by: usize| {
        (0..rows - by).all(|row| {
            let state = &states[(row + by) * width + TIME..][..JOINTS];
            joints[row * JOINTS..][..JOINTS]
                .iter()
                .zip(state)
                .all(|(a, b)| (a - b).abs() <= 1e-5 * a.abs().max(1.0))
        })
    };
    Ok(match (is_moved_by(0), is_moved_by(1)) {
        (true, _) => Ok(Shift::No),
        (false, true) => Ok(Shift::Yes),
        (false, false) => Err(
            "the file does not show whether the observations of a row are before its action (0) or after it \
                               (1): `obs/joint_states` are not in `states`; say which"
                .to_owned(),
        ),
    })
}
