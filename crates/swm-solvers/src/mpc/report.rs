//! What the policy says of its plans in the infos, and with them in datasets, when it is asked to.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use swm_core::{Actions, Dtype, Field};

use crate::solver::Plan;

/// Which columns the policy adds. They hold a value at the steps at which a plan was made, and are missing (NaN, or -1
/// for integers) at all others.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Report {
    /// None.
    #[default]
    Off,
    /// `plan.cost` of the plan, `plan.elite_cost` (mean of the last elites), `plan.spread` (mean of the final standard
    /// deviations; NaN for solvers without one), `plan.iterations`, and `plan.non_finite`: how many costs were not.
    Plan,
    /// These, and `plan.wall_time_s`: how long the planning took, in seconds. Environments that are planned for
    /// together share their time, and it is shown for each. The only column that differs from run to run.
    Timed,
}

const COST: usize = 0;
const ELITE_COST: usize = 1;
const SPREAD: usize = 2;
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
            real("plan.spread"),
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

    /// Writes what is known of the plans of environments `rows`, `[B]`.
    pub(super) fn write(self, rows: &[usize], plan: &Plan, time: Duration, actions: &mut Actions<'_>) {
        if self == Report::Off {
            return;
        }
        let size = (plan.spread.len() / rows.len().max(1)).max(1);
        for (index, &row) in rows.iter().enumerate() {
            let spread = plan.spread.chunks_exact(size).nth(index).unwrap_or_default();
            let sum: f64 = spread.iter().map(|&value| f64::from(value)).sum();
            actions.report(row, COST, &[plan.cost_of_returned[index]]);
            actions.report(row, ELITE_COST, &[plan.elite_mean_last[index]]);
            actions.report(row, SPREAD, &[sum / spread.len() as f64]);
            actions.report(row, ITERATIONS, &[i64::from(plan.iterations[index])]);
            actions.report(row, NON_FINITE, &[plan.non_finite[index] as i64]);
            if self == Report::Timed {
                actions.report(row, WALL_TIME, &[time.as_secs_f64()]);
            }
        }
    }
}
