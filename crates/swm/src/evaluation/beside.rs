//! What stands beside every result: floors that need no skill, and the ceiling of the same planner on the true dynamics.

use serde::{Deserialize, Serialize};
use serde_json::Map;
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};
use swm_core::{EnvConfig, EnvEntry, Manifest, PolicyArgs, Registry};

use super::run::Candidate;

/// What another policy is there for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Actions drawn uniformly.
    Random,
    /// Zeros.
    DoNothing,
    /// A planner on the true dynamics.
    Ceiling,
}

impl Role {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Role::Random => "random",
            Role::DoNothing => "do nothing",
            Role::Ceiling => "planner on the true dynamics",
        }
    }
}

/// Another policy on the same pairs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beside {
    /// What it is there for.
    pub role: Role,
    /// What it is.
    pub candidate: Candidate,
    /// What it came to.
    pub summary: Summary,
    /// The evaluated policy against it.
    pub test: PairedTest,
    /// For a ceiling: what the evaluated policy's plans cost more than its.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regret: Option<Regret>,
    /// Its episodes, in order.
    pub episodes: Vec<EpisodeResult>,
}

/// True cost of the evaluated policy minus that of the ceiling, in the environment's task cost: positive is worse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Regret {
    /// Pairs in which both costs are known.
    pub pairs: usize,
    /// Mean after the first plan: both begin at the same start, so this is what the first plan itself lost.
    pub first_plan: f64,
    /// Median of the same.
    pub first_plan_median: f64,
    /// Mean after each plan, as far as either plans on: what the plans up to it lost together. Where one of the two is at its
    /// end before, what was left there counts.
    #[serde(default)]
    pub by_plan: Vec<f64>,
    /// Mean at the end of the episode.
    pub at_end: f64,
}

impl Regret {
    /// From episodes of the evaluated policy and of the ceiling; `None` if no cost is known.
    pub fn of(policy: &[EpisodeResult], ceiling: &[EpisodeResult]) -> Option<Self> {
        let pairs = || policy.iter().zip(ceiling);
        let lost = |cost: fn(&EpisodeResult) -> Option<f64>| -> Vec<f64> {
            pairs().filter_map(|(policy, ceiling)| Some(cost(policy)? - cost(ceiling)?)).collect()
        };
        let (mut plans, ends) = (lost(|episode| episode.plan_cost), lost(|episode| episode.final_cost));
        if plans.is_empty() || ends.is_empty() {
            return None;
        }
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        plans.sort_by(f64::total_cmp);
        let (low, high) = (plans[(plans.len() - 1) / 2], plans[plans.len() / 2]);
        let first_plan_median = (low + high) / 2.0;
        let after = |episode: &EpisodeResult, plan: usize| match episode.plan_costs.get(plan) {
            Some(cost) => *cost,
            None => episode.final_cost,
        };
        let count =
            pairs().map(|(policy, ceiling)| policy.plan_costs.len().max(ceiling.plan_costs.len())).max();
        let by_plan = (0..count.unwrap_or(0))
            .map(|plan| {
                let lost = pairs()
                    .filter_map(|(policy, ceiling)| Some(after(policy, plan)? - after(ceiling, plan)?));
                mean(&lost.collect::<Vec<f64>>())
            })
            // Pairs whose costs are all unknown say nothing of this plan and the next.
            .take_while(|lost| lost.is_finite())
            .collect();
        let (first_plan, at_end) = (mean(&plans), mean(&ends));
        Some(Self { pairs: plans.len(), first_plan, first_plan_median, by_plan, at_end })
    }
}

impl Beside {
    /// Puts a policy's episodes beside those of the evaluated one.
    pub fn new(
        role: Role,
        candidate: Candidate,
        episodes: Vec<EpisodeResult>,
        evaluated: &[EpisodeResult],
    ) -> Self {
        let successes = |episodes: &[EpisodeResult]| -> Vec<bool> {
            episodes.iter().map(|episode| episode.success).collect()
        };
        Self {
            role,
            candidate,
            summary: Summary::of(&episodes),
            test: PairedTest::of(&successes(evaluated), &successes(&episodes)),
            regret: if role == Role::Ceiling { Regret::of(evaluated, &episodes) } else { None },
            episodes,
        }
    }
}

/// The reference policies of a candidate: random, no-op, and the oracle (see [`Candidate::oracle`]) where the environment
/// has a task cost.
pub fn roles(
    registry: &Registry,
    entry: &EnvEntry,
    manifest: &Manifest,
    candidate: &Candidate,
) -> Vec<(Role, Candidate)> {
    let named = |name: &str| Candidate::new(PolicyArgs::new(name, Map::new()));
    let mut roles = vec![(Role::Random, named("random")), (Role::DoNothing, named("constant"))];
    let config = EnvConfig { image: None, settings: manifest.settings.clone() };
    if entry.make(&config).is_ok_and(|env| env.task_cost().is_some()) {
        roles.push((Role::Ceiling, candidate.oracle(registry, entry, manifest)));
    }
    roles
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode(plan_costs: &[f64], final_cost: f64) -> EpisodeResult {
        EpisodeResult {
            success: false,
            solved_at_start: false,
            first_success_step: None,
            steps: 0,
            total_reward: None,
            best_margin: None,
            last_margin: None,
            plan_cost: plan_costs.first().copied(),
            plan_costs: plan_costs.iter().copied().map(Some).collect(),
            final_cost: Some(final_cost),
            decisions: String::new(),
            digest: String::new(),
        }
    }

    #[test]
    fn regret_is_known_after_every_plan() {
        let policy = [episode(&[5.0, 3.0, 2.0], 2.0), episode(&[4.0, 4.0], 4.0)];
        let ceiling = [episode(&[4.0, 0.0], 0.0), episode(&[2.0, 1.0], 1.0)];
        let regret = Regret::of(&policy, &ceiling).unwrap();
        assert_eq!((regret.pairs, regret.first_plan, regret.at_end), (2, 1.5, 2.5));
        // In the last column three of the four are at their end.
        assert_eq!(regret.by_plan, [1.5, 3.0, 2.5]);
        assert!(Regret::of(&[], &[]).is_none());
    }
}
