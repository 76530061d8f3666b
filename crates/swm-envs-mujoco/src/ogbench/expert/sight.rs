//! What the experts see of a row.

use swm_core::{BatchError, PolicyError, SlotView};

/// An observation, as values.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    /// Simulated seconds.
    pub(super) time_s: f64,
    /// The effector: m, and rad.
    pub(super) effector: [f64; 3],
    pub(super) yaw: f64,
    /// 0: open, 1: closed.
    pub(super) opening: f64,
    /// How firmly the gripper holds something, 0..1.
    pub(super) contact: f64,
    /// How many targets there have been.
    number: i64,
    /// What is wanted.
    pub(super) target: Target,
}

/// What is wanted, and where that is.
#[derive(Clone, Debug)]
pub(super) enum Target {
    /// A cube, and where it belongs: m, and rad.
    Cube { index: i64, at: [f64; 3], yaw: f64, goal: [f64; 3], goal_yaw: f64 },
    /// A button, by its top, and whether it is in the state that it should have.
    Button { index: i64, top: [f64; 3], is_done: bool },
    /// A drawer, by its handle, and where that belongs.
    Drawer(Handle),
    /// A window, likewise.
    Window(Handle),
}

/// A handle, m and rad, and where it belongs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Handle {
    pub(super) at: [f64; 3],
    pub(super) yaw: f64,
    pub(super) goal: [f64; 3],
}

impl Sight {
    /// Reads a row.
    pub(super) fn of(view: &SlotView<'_>) -> Result<Self, PolicyError> {
        let three = |name: &str| values::<3>(view, name);
        let one = |name: &str| Ok::<_, BatchError>(values::<1>(view, name)?[0]);
        let whole = |name: &str| Ok::<_, BatchError>(view.row.get::<i64>(name)?[0]);
        let handle = |name: &str| {
            Ok::<_, BatchError>(Handle {
                at: three(&format!("privileged.{name}_handle_pos"))?,
                yaw: one(&format!("privileged.{name}_handle_yaw"))?,
                goal: three(&format!("privileged.target_{name}_handle_pos"))?,
            })
        };
        let target = match whole("privileged.target_task")? {
            0 => {
                let index = whole("privileged.target_block")?;
                Target::Cube {
                    index,
                    at: three(&format!("privileged.block_{index}_pos"))?,
                    yaw: one(&format!("privileged.block_{index}_yaw"))?,
                    goal: three("privileged.target_block_pos")?,
                    goal_yaw: one("privileged.target_block_yaw")?,
                }
            }
            1 => {
                let index = whole("privileged.target_button")?;
                let state = whole(&format!("privileged.button_{index}_state"))?;
                let is_done = state == whole("privileged.target_button_state")?;
                Target::Button { index, top: three("privileged.target_button_top_pos")?, is_done }
            }
            2 => Target::Drawer(handle("drawer")?),
            _ => Target::Window(handle("window")?),
        };
        Ok(Self {
            time_s: one("time")?,
            effector: three("proprio.effector_pos")?,
            yaw: one("proprio.effector_yaw")?,
            opening: one("proprio.gripper_opening")?,
            contact: one("proprio.gripper_contact")?,
            number: whole("privileged.target_number")?,
            target,
        })
    }

    /// What tells one target from another.
    pub(super) fn target_key(&self) -> [i64; 2] {
        let kind = match self.target {
            Target::Cube { index, .. } => index,
            Target::Button { index, .. } => 100 + index,
            Target::Drawer(_) => 200,
            Target::Window(_) => 300,
        };
        [self.number, kind]
    }
}

fn values<const N: usize>(view: &SlotView<'_>, name: &str) -> Result<[f64; N], BatchError> {
    let values: &[f64] = view.row.get(name)?;
    Ok(std::array::from_fn(|k| values[k]))
}

/// The turn of something with `folds` equal sides that is nearest to the effector's, rad.
pub(super) fn nearest_turn(effector_yaw: f64, yaw: f64, folds: i32) -> f64 {
    let turn = |index: i32| yaw + f64::from(index) * std::f64::consts::TAU / f64::from(folds);
    let off = |turn: &f64| (effector_yaw - turn).abs();
    (-folds..=folds).map(turn).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(yaw)
}
