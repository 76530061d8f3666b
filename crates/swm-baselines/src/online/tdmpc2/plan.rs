//! The settings of the plan by which TD-MPC2 acts.

use serde::{Deserialize, Serialize};
use swm_core::Setting;

/// How it acts: each action is the first of a plan that is searched in latent space, by MPPI or the cross-entropy method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tdmpc2Plan {
    /// Whether it plans; otherwise it acts as the policy prior says.
    pub mpc: bool,
    /// Steps of a plan; the Qs tell the return after them.
    pub horizon: usize,
    /// Candidate plans per iteration.
    pub samples: usize,
    /// Rounds of sampling and refitting.
    pub iterations: usize,
    /// The same while it collects.
    pub collect_samples: usize,
    /// The same while it collects.
    pub collect_iterations: usize,
    /// Candidates that a refit uses.
    pub elites: usize,
    /// Candidates, among all, that follow the policy prior.
    pub policy_samples: usize,
    /// Std of candidates in the first iteration; later ones have at most this.
    pub sigma: f64,
    /// The smallest std.
    pub sigma_min: f64,
    /// Return by which an elite must be worse to weigh e times less (MPPI); `null`: elites weigh the same (cross-entropy method).
    pub temperature: Option<f64>,
    /// Noise of collected actions, in stds of the last iteration.
    pub exploration: f64,
    /// c: values count less where the Qs disagree, by c |Q̄| times their std.
    pub uncertainty_penalty: f64,
}

/// Settings of [`Tdmpc2Plan`] that the policy `tdmpc2:RUN` takes.
pub const OPTIONS: &[Setting] = &[
    Setting::new("mpc", "Plan; false: act as the policy prior says", "the run's"),
    Setting::new("horizon", "Steps of a plan", "the run's"),
    Setting::new("samples", "Candidate plans per iteration", "the run's"),
    Setting::new("iterations", "Rounds of sampling and refitting", "the run's"),
    Setting::new("elites", "Candidates that a refit uses", "the run's"),
    Setting::new("policy_samples", "Candidates that follow the policy prior", "the run's"),
    Setting::new("sigma", "Std of candidates in the first iteration", "the run's"),
    Setting::new("sigma_min", "Smallest std", "the run's"),
    Setting::new(
        "temperature",
        "Return by which an elite must be worse to weigh e times less; null: all alike",
        "the run's",
    ),
    Setting::new("uncertainty_penalty", "Weight of the disagreement between Qs", "the run's"),
];

impl Tdmpc2Plan {
    pub(super) fn check(&self) -> Result<(), String> {
        let Self {
            horizon,
            samples,
            iterations,
            collect_samples,
            collect_iterations,
            elites,
            policy_samples,
            ..
        } = *self;
        let sizes = [
            ("plan.horizon", horizon, 1),
            ("plan.iterations", iterations, 1),
            ("plan.collect_iterations", collect_iterations, 1),
            ("plan.elites", elites, 2),
        ];
        at_least(&sizes)?;
        // The mean of the search is a candidate, too.
        let least = elites.max(policy_samples + 1);
        for (name, samples) in [("plan.samples", samples), ("plan.collect_samples", collect_samples)] {
            if samples < least {
                return Err(format!(
                    "`{name}` is {samples}; it must be at least {least} for {elites} elites and {policy_samples} `policy_samples`"
                ));
            }
        }
        let &Self { sigma, sigma_min, temperature, exploration, uncertainty_penalty, .. } = self;
        let above =
            [Some(("plan.sigma", sigma)), temperature.map(|temperature| ("plan.temperature", temperature))];
        if let Some((name, value)) =
            above.iter().flatten().find(|(_, value)| !(*value > 0.0 && value.is_finite()))
        {
            return Err(format!("`{name}` is {value}; it must be above 0"));
        }
        if sigma_min > sigma {
            return Err(format!("`plan.sigma_min` is {sigma_min}; it must be at most `plan.sigma`, {sigma}"));
        }
        not_negative(&[
            ("plan.sigma_min", sigma_min),
            ("plan.exploration", exploration),
            ("plan.uncertainty_penalty", uncertainty_penalty),
        ])
    }
}

/// Refuses a size below the least one.
pub(super) fn at_least(sizes: &[(&str, usize, usize)]) -> Result<(), String> {
    match sizes.iter().find(|(_, size, least)| size < least) {
        Some((name, size, least)) => Err(format!("`{name}` is {size}; it must be at least {least}")),
        None => Ok(()),
    }
}

/// Refuses a value below 0.
pub(super) fn not_negative(values: &[(&str, f64)]) -> Result<(), String> {
    match values.iter().find(|(_, value)| !(*value >= 0.0 && value.is_finite())) {
        Some((name, value)) => Err(format!("`{name}` is {value}; it must be 0 or more")),
        None => Ok(()),
    }
}
