//! The reference policies that every result is compared with: random, no-op, and the oracle, which is the same planner on the
//! true dynamics.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};
use swm_core::{EnvConfig, EnvEntry, Manifest, PolicyArgs, Registry};

use super::run::Candidate;

/// What a reference policy is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Role {
    /// Actions sampled uniformly.
    Random,
    /// Zeros.
    #[serde(alias = "do_nothing")]
    NoOp,
    /// A planner on the true dynamics.
    #[serde(alias = "ceiling")]
    Oracle,
}

impl Role {
    /// As on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Role::Random => "random",
            Role::NoOp => "no-op",
            Role::Oracle => "oracle",
        }
    }
}

/// A reference policy on the same pairs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Reference {
    /// Which of them it is.
    pub role: Role,
    /// The policy.
    pub candidate: Candidate,
    /// Its results over all pairs.
    pub summary: Summary,
    /// The evaluated policy against it.
    pub test: PairedTest,
    /// For an oracle: how much more the evaluated policy's plans cost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regret: Option<Regret>,
    /// Its episodes, in order.
    pub episodes: Vec<EpisodeResult>,
}

/// True cost of the evaluated policy minus that of the oracle, in the environment's task cost: positive is worse.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Regret {
    /// Pairs in which both costs are known.
    pub pairs: usize,
    /// Mean after the first plan. Both begin at the same start, so this is the regret of the first plan alone.
    pub first_plan: f64,
    /// Median of the same.
    pub first_plan_median: f64,
    /// Mean after each plan, up to the longer of the two episodes: the regret that the plans up to it add up to. Where one of
    /// the two has ended, its final cost counts.
    #[serde(default)]
    pub by_plan: Vec<f64>,
    /// Mean at the end of the episode.
    pub at_end: f64,
}

impl Regret {
    /// From episodes of the evaluated policy and of the oracle; `None` if no cost is known.
    pub fn of(policy: &[EpisodeResult], oracle: &[EpisodeResult]) -> Option<Self> {
        let pairs = || policy.iter().zip(oracle);
        let lost = |cost: fn(&EpisodeResult) -> Option<f64>| -> Vec<f64> {
            pairs().filter_map(|(policy, oracle)| Some(cost(policy)? - cost(oracle)?)).collect()
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
            pairs().map(|(policy, oracle)| policy.plan_costs.len().max(oracle.plan_costs.len())).max();
        let by_plan = (0..count.unwrap_or(0))
            .map(|plan| {
                let lost =
                    pairs().filter_map(|(policy, oracle)| Some(after(policy, plan)? - after(oracle, plan)?));
                mean(&lost.collect::<Vec<f64>>())
            })
            // Where no pair has a known cost, this plan and the next have no regret.
            .take_while(|lost| lost.is_finite())
            .collect();
        let (first_plan, at_end) = (mean(&plans), mean(&ends));
        Some(Self { pairs: plans.len(), first_plan, first_plan_median, by_plan, at_end })
    }
}

impl Reference {
    /// Compares the episodes of a reference policy with those of the evaluated one.
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
            regret: if role == Role::Oracle { Regret::of(evaluated, &episodes) } else { None },
            episodes,
        }
    }
}

impl Reference {
    /// Why the mean regret after the first plan is negative, where it is: an oracle is a planner with the true dynamics, which seeks what
    /// its cost says with the time that it has, and no bound on what the task cost can be after some steps. `evaluated` are the
    /// episodes of the evaluated policy.
    pub fn negative_regret(&self, evaluated: &[EpisodeResult]) -> Option<String> {
        self.regret.as_ref().filter(|regret| regret.first_plan < 0.0)?;
        let ended = evaluated.iter().zip(&self.episodes).filter(|&(policy, oracle)| {
            let is_ahead = policy.plan_cost.zip(oracle.plan_cost).is_some_and(|(own, other)| own < other);
            is_ahead && oracle.success && oracle.plan_costs.len() == 1
        });
        let ended = ended.count();
        let setting = |name: &str| self.candidate.policy.named.get(name).and_then(Json::as_u64).unwrap_or(5);
        let (executed, planned) = (setting("receding_horizon"), setting("horizon"));
        let mut reasons = Vec::new();
        if ended > 0 {
            let pairs = if ended == 1 { "1 pair".to_owned() } else { format!("{ended} pairs") };
            reasons.push(format!(
                "in {pairs} its first plan succeeded, which ends an episode at any cost that counts as success"
            ));
        }
        if executed < planned {
            reasons.push(format!(
                "its plans are the cheapest after {planned} blocks, and the cost is that after the {executed} that it executes"
            ));
        }
        reasons.push("its search is finite: more samples or iterations make it a better oracle".to_owned());
        Some(format!(
            "a negative regret says that the oracle's plans were not optimal: {}",
            reasons.join("; ")
        ))
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
    let mut roles = vec![(Role::Random, named("random")), (Role::NoOp, named("constant"))];
    let config = EnvConfig { image: None, settings: manifest.settings.clone() };
    if entry.make(&config).is_ok_and(|env| env.task_cost().is_some()) {
        roles.push((Role::Oracle, candidate.oracle(registry, entry, manifest)));
    }
    roles
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode(plan_costs: &[f64], final_cost: f64) -> EpisodeResult {
        let mut result = EpisodeResult::default();
        result.plan_cost = plan_costs.first().copied();
        result.plan_costs = plan_costs.iter().copied().map(Some).collect();
        result.final_cost = Some(final_cost);
        result
    }

    #[test]
    fn roles_of_old_receipts_are_read() {
        let read = |role: &str| serde_json::from_str::<Role>(role).unwrap();
        assert_eq!([read("\"do_nothing\""), read("\"ceiling\"")], [Role::NoOp, Role::Oracle]);
        assert_eq!(serde_json::to_string(&Role::NoOp).unwrap(), "\"no_op\"");
    }

    #[test]
    fn regret_is_known_after_every_plan() {
        let policy = [episode(&[5.0, 3.0, 2.0], 2.0), episode(&[4.0, 4.0], 4.0)];
        let oracle = [episode(&[4.0, 0.0], 0.0), episode(&[2.0, 1.0], 1.0)];
        let regret = Regret::of(&policy, &oracle).unwrap();
        assert_eq!((regret.pairs, regret.first_plan, regret.at_end), (2, 1.5, 2.5));
        // In the last column three of the four are at their end.
        assert_eq!(regret.by_plan, [1.5, 3.0, 2.5]);
        assert!(Regret::of(&[], &[]).is_none());
    }

    #[test]
    fn a_negative_regret_is_explained() {
        let oracle = |text: &str, costs: [f64; 2], solved: bool| {
            let episodes = costs.map(|cost| {
                let mut episode = episode(&[cost], cost);
                episode.success = solved;
                episode
            });
            let candidate = Candidate::new(PolicyArgs::parse(text).unwrap());
            Reference::new(Role::Oracle, candidate, episodes.to_vec(), &policy())
        };
        fn policy() -> [EpisodeResult; 2] {
            [episode(&[1.0], 1.0), episode(&[3.0], 3.0)]
        }
        let reason = |reference: Reference| reference.negative_regret(&policy());
        assert_eq!(reason(oracle("cem", [0.5, 2.0], false)), None, "a positive regret needs no explanation");
        let finite = "its search is finite";
        let found = reason(oracle("cem", [1.5, 3.5], false)).unwrap();
        assert!(
            found.contains(finite) && !found.contains("blocks") && !found.contains("succeeded"),
            "{found}"
        );
        let found = reason(oracle("cem:horizon=8,receding_horizon=2", [1.5, 3.5], false)).unwrap();
        assert!(found.contains("cheapest after 8 blocks") && found.contains("after the 2 that"), "{found}");
        let found = reason(oracle("cem", [1.5, 3.5], true)).unwrap();
        assert!(found.contains("in 2 pairs its first plan succeeded"), "{found}");
        let found = reason(oracle("cem", [0.9, 9.5], true)).unwrap();
        assert!(found.contains("in 1 pair its first plan"), "{found}");
    }
}
