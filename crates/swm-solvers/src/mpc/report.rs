//! Columns about the plans in the infos, and with them in datasets.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use swm_core::{Actions, Dtype, Field};

use crate::problem::Plan;

/// Which columns the policy adds. They hold a value at the steps at which a plan was made, and are missing (NaN, or -1
/// for integers) at all others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Report {
    /// None.
    #[default]
    Off,
    /// `plan.cost` of the plan, `plan.elite_cost` (mean of the last elites), `plan.std` (mean of the final standard
    /// deviations; NaN for solvers without one), `plan.iterations`, and `plan.non_finite`: how many costs were not.
    Plan,
    /// These, and `plan.wall_time_s`: how long the planning took, in seconds. Environments that are planned for
    /// together share this time. The only column that differs from run to run.
    Timed,
}

const COST: usize = 0;
const ELITE_COST: usize = 1;
const STD: usize = 2;
const ITERATIONS: usize = 3;
const NON_FINITE: usize = 4;
const WALL_TIME: usize = 5;

impl Report {
    /// The columns, in the order of the constants above.
    pub(super) fn fields(self) -> Vec<Field> {
        let real = |name| Field::step(name, Dtype::F64, &[]);
        let count = |name| Field::step(name, Dtype::I64, &[]);
        let mut fields = vec![
            real("plan.cost"),
            real("plan.elite_cost"),
            real("plan.std"),
            count("plan.iterations"),
            count("plan.non_finite"),
            real("plan.wall_time_s"),
        ];
        fields.truncate(match self {
            Report::Off => 0,
            Report::Plan => WALL_TIME,
            Report::Timed => WALL_TIME + 1,
        });
        fields
    }

    /// Writes what is known of the plans of the environments in `slots`, `[B]`.
    pub(super) fn write(self, slots: &[usize], plan: &Plan, time: Duration, actions: &mut Actions<'_>) {
        if self == Report::Off {
            return;
        }
        let size = (plan.std.len() / slots.len().max(1)).max(1);
        for (index, &slot) in slots.iter().enumerate() {
            let std = plan.std.chunks_exact(size).nth(index).unwrap_or_default();
            let sum: f64 = std.iter().map(|&value| f64::from(value)).sum();
            actions.report(slot, COST, &[plan.cost_of_returned[index]]);
            actions.report(slot, ELITE_COST, &[plan.elite_mean_last[index]]);
            actions.report(slot, STD, &[sum / std.len() as f64]);
            actions.report(slot, ITERATIONS, &[i64::from(plan.iterations[index])]);
            actions.report(slot, NON_FINITE, &[plan.non_finite[index] as i64]);
            if self == Report::Timed {
                actions.report(slot, WALL_TIME, &[time.as_secs_f64()]);
            }
        }
    }
}
