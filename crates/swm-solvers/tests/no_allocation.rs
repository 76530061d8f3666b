//! Planning allocates at the first plan and at no later one of the same size. Alone in this binary, because it counts
//! all allocations of the process.

use std::alloc::System;
use std::collections::BTreeMap;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use swm_core::testing::{DISCRETE_TOY, TOY};
use swm_core::{Dtype, EnvConfig, EpisodeSeed, PolicyContext, Registry, ResetOptions, Space};
use swm_core::{Value, World, WorldOptions};
use swm_solvers::models::{ControlModel, Stage};
use swm_solvers::{
    Candidates, Cost, NoTrace, Outputs, PLANNERS, Plan, PlanError, PlanKey, Problem, SOLVERS, Workspace,
    plan_dim,
};

#[global_allocator]
static COUNTED: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// A cost that allocates nothing, on actions of so many values.
struct Free(usize);

impl Cost for Free {
    fn evaluate(&mut self, candidates: &Candidates<'_>, outputs: &mut Outputs<'_>) -> Result<(), PlanError> {
        let Outputs { costs, gradient, .. } = outputs;
        gradient.iter_mut().for_each(|gradient| gradient.fill(0.0));
        for (index, (plan, cost)) in candidates.plans().zip(costs.iter_mut()).enumerate() {
            *cost = f64::from(plan[0] * plan[0]);
            if let Some(gradient) = gradient {
                gradient[index * plan.len()] = 2.0 * plan[0];
            }
        }
        Ok(())
    }

    fn has_gradients(&self) -> bool {
        true
    }

    fn control(&self) -> Option<&dyn ControlModel> {
        Some(self)
    }
}

impl ControlModel for Free {
    fn state_dim(&self) -> usize {
        3
    }
    fn action_dim(&self) -> usize {
        self.0
    }
    fn start(&self, _row: usize, state: &mut [f64]) {
        state.copy_from_slice(&[1.0, 2.0, 3.0]);
    }
    fn step(&self, at: &Stage<'_>, next: &mut [f64]) {
        next.copy_from_slice(&[
            at.state[0] + at.action[0].sin(),
            at.state[1] * 0.9,
            at.state[2] + at.action[1],
        ]);
    }
    fn cost(&self, at: &Stage<'_>) -> f64 {
        at.state.iter().chain(at.action).map(|value| value * value).sum()
    }
}

fn count(work: impl FnOnce()) -> usize {
    let region = Region::new(COUNTED);
    work();
    let change = region.change();
    change.allocations + change.reallocations
}

/// The fewest of several repetitions: a thread that is just starting elsewhere allocates too, but not always.
fn fewest(mut work: impl FnMut()) -> Option<usize> {
    (0..5).map(|_| count(&mut work)).min()
}

#[test]
fn later_plans_allocate_nothing() {
    // One thread: what rayon needs to wake others is not ours. One test: others would be counted.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for entry in SOLVERS.iter().filter(|entry| !entry.needs_states) {
        let solver = entry.make(serde_json::Map::new()).unwrap();
        let key = |episode| PlanKey { episode, seed: EpisodeSeed::new(episode), plan: 0 };
        let keys: Vec<PlanKey> = (0..4).map(key).collect();
        let spaces = [Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0), Space::Discrete { n: 5, start: 0 }];
        let action = spaces.into_iter().find(|space| solver.check(space).is_ok()).unwrap();
        let initial = vec![0.0; 4 * 10 * plan_dim(&action)];
        let problem = Problem {
            keys: &keys,
            horizon: 10,
            action_block: 1,
            action: &action,
            initial: &initial,
            memory: &[],
        };
        let (mut workspace, mut plan) = (Workspace::new(), Plan::new());
        let mut cost = Free(plan_dim(&action));
        pool.install(|| {
            let mut solve =
                || solver.solve(&problem, &mut cost, &mut workspace, &mut NoTrace, &mut plan).unwrap();
            assert!(count(&mut solve) > 0, "the counter counts");
            assert_eq!(fewest(&mut solve), Some(0), "{}", entry.name);
        });
    }

    for planner in PLANNERS {
        let config = EnvConfig::default();
        let text = format!("{}:horizon=2,receding_horizon=1,action_block=1,history_len=2", planner.name);
        let registry = Registry::new().with(PLANNERS);
        // The toy environment with real actions, or that with integers: whichever the planner can plan for.
        let (toy, policy) = [TOY, DISCRETE_TOY]
            .into_iter()
            .find_map(|toy| Some((toy, registry.policy(&text, PolicyContext::new(&toy, &config)).ok()?)))
            .unwrap();
        let options = WorldOptions::default().threads(1);
        let mut world = World::new(&toy, options).unwrap();
        world.set_policy(policy).unwrap();
        // So far away that the episode, and with it the planning, does not end.
        let place = |value: f64| Some(BTreeMap::from([("state".to_owned(), Value::vector(&[value]))]));
        let reset = ResetOptions { start: place(0.0), goal: place(1000.0), ..ResetOptions::default() };
        world.reset(3, &reset).unwrap();
        pool.install(|| {
            assert!(count(|| world.step().unwrap()) > 0, "the counter counts");
            assert_eq!(fewest(|| world.step().unwrap()), Some(0), "{}", planner.name);
        });
    }
}
