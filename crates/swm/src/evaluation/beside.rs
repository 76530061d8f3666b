//! What stands beside every result: floors that need no skill, and the ceiling of the same planner on the true dynamics.

use serde::{Deserialize, Serialize};
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};
use swm_core::{EnvConfig, EnvEntry, Manifest, PolicyArgs};
use swm_solvers::PLANNERS;

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
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Regret {
    /// Pairs in which both costs are known.
    pub pairs: usize,
    /// Mean after the first plan: both begin at the same start, so this is what the first plan itself lost.
    pub first_plan: f64,
    /// Median of the same.
    pub first_plan_median: f64,
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
        Some(Self { pairs: plans.len(), first_plan: mean(&plans), first_plan_median, at_end: mean(&ends) })
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

/// The policies that belong beside one of `policy`. The ceiling is the same planner where the policy is one, else `cem`; none
/// where the environment has no task cost.
pub fn roles(entry: &EnvEntry, manifest: &Manifest, policy: &PolicyArgs) -> Vec<(Role, Candidate)> {
    let named = |name: &str| Candidate::new(PolicyArgs { name: name.to_owned(), ..PolicyArgs::default() });
    let mut roles = vec![(Role::Random, named("random")), (Role::DoNothing, named("constant"))];
    let config = EnvConfig { image: None, settings: manifest.settings.clone() };
    let has_cost = (entry.make)(&config).is_ok_and(|env| env.task_cost().is_some());
    if has_cost {
        let is_planner = PLANNERS.iter().any(|planner| planner.name == policy.name);
        let ceiling = if is_planner { Candidate::new(policy.clone()) } else { named("cem") };
        roles.push((Role::Ceiling, ceiling.on(entry, manifest)));
    }
    roles
}
