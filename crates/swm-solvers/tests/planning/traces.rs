//! Watching solvers: what is seen, how it is written down, and that it changes nothing.

use std::io::{self, Write};
use std::sync::{Arc, Mutex};

use serde_json::{Map, Value as Json};
use swm_core::EnvConfig;
use swm_core::testing::TOY;
use swm_solvers::{
    Cem, Detail, JsonLines, Memory, MpcPolicy, NoTrace, Plan, PlanConfig, SOLVERS, SimulatorCost,
    SimulatorOptions, Solver, Trace, Workspace,
};

use crate::problems::{Analytic, Trial, keys};
use crate::worlds::{Setting, Story, run};

fn solve(solver: &dyn Solver, trace: &mut dyn Trace) -> (Plan, Analytic) {
    let trial = Trial::accepted_by(solver);
    let (keys, initial) = (keys(3..6), vec![0.0; 3 * trial.size]);
    let (mut plan, mut cost) = (Plan::new(), Analytic::new(trial.cost, 30));
    let problem = trial.problem(&keys, &initial);
    solver.solve(&problem, &mut cost, &mut Workspace::new(), trace, &mut plan).expect("finite costs");
    (plan, cost)
}

#[test]
fn watching_changes_no_plan_of_any_solver() {
    // Those that need a model's states have tests of their own.
    for entry in SOLVERS.iter().filter(|entry| !entry.needs_states) {
        let solver = entry.make(Map::new()).unwrap();
        let (alone, _) = solve(solver.as_ref(), &mut NoTrace);
        let mut memory = Memory::new(5);
        let mut both = (&mut memory, JsonLines::new(Vec::new(), Detail::Candidates));
        let (watched, _) = solve(solver.as_ref(), &mut both);
        both.1.finish().unwrap();
        assert_eq!(format!("{watched:?}"), format!("{alone:?}"), "{}", entry.name);

        assert_eq!(memory.plans().len(), 3, "{}", entry.name);
        for (episode, traced) in memory.plans().iter().enumerate() {
            assert_eq!((traced.solver, traced.key.episode), (entry.name, 3 + episode as u64));
            assert_eq!(traced.actions, alone.of(episode));
            let result = traced.result.as_ref().expect("the solve has an end");
            assert_eq!(result.cost, Some(alone.cost_of_returned[episode]), "{}", entry.name);
            assert!(!traced.iterations.is_empty(), "{} shows no iteration", entry.name);
            for (number, iteration) in traced.iterations.iter().enumerate() {
                assert_eq!(iteration.record.iteration, number, "{}", entry.name);
                let best = iteration.record.best.expect("finite costs");
                assert_eq!(iteration.elites[0].cost, best, "{}", entry.name);
                assert!(iteration.elites.is_sorted_by_key(|elite| elite.cost));
            }
        }
    }
}

#[test]
fn figures_of_a_search_are_those_of_its_costs() {
    let mut memory = Memory::new(3);
    let (plan, seen) = solve(&Cem::default(), &mut memory);
    for (episode, traced) in memory.plans().iter().enumerate() {
        assert_eq!(traced.iterations.len(), 30);
        let near = |a: Option<f64>, b: f64| (a.expect("known") - b).abs() <= 1e-9 * b.abs();
        for (iteration, seen) in traced.iterations.iter().zip(&seen.iterations) {
            let record = &iteration.record;
            assert_eq!(record.best, Some(seen[episode].min));
            assert!(
                near(record.elite_mean, seen[episode].elite) && near(record.sample_mean, seen[episode].mean)
            );
            assert_eq!((record.gradient_norm, record.non_finite, iteration.elites.len()), (None, 0, 3));
            let cost = f64::from((Trial::nav().cost)(episode, &iteration.elites[2].actions));
            assert_eq!(iteration.elites[2].cost, cost, "an elite's cost is its own");
        }
        let [first, last] = [0, 29].map(|number| &traced.iterations[number].record);
        assert!(last.mean_sigma < first.mean_sigma && last.mean_shift < first.mean_shift);
        assert_eq!(traced.iterations[29].mean, plan.of(episode), "the last mean is the plan");
        // The std of the elites is what the distribution is refitted to.
        assert!((last.mean_sigma.unwrap() - last.elite_std.unwrap()).abs() < 1e-6);
        assert!(first.clipped.unwrap() > 0.2, "a third of normal samples is beyond 1");
    }
}

fn lines(solver: &dyn Solver, detail: Detail) -> Vec<Json> {
    let shared = Shared::default();
    let mut trace = JsonLines::new(shared.clone(), detail);
    solve(solver, &mut trace);
    trace.finish().expect("memory is not full");
    let text = String::from_utf8(shared.0.lock().expect("one thread").clone()).expect("JSON is text");
    assert!(text.ends_with('\n'));
    text.lines().map(|line| serde_json::from_str(line).expect("every line is JSON")).collect()
}

/// A file that its reader shares.
#[derive(Clone, Default)]
struct Shared(Arc<Mutex<Vec<u8>>>);

impl Write for Shared {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().expect("one thread").extend_from_slice(bytes);
        Ok(bytes.len())
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn lines_hold_what_the_detail_asks_for() {
    let solver = Cem { samples: 16, elites: 4, iterations: 2, ..Cem::default() };
    for detail in [Detail::Figures, Detail::Elites, Detail::Candidates] {
        let lines = lines(&solver, detail);
        let kinds: Vec<&str> = lines.iter().map(|line| line["record"].as_str().unwrap()).collect();
        assert_eq!(kinds, [&["begin"; 3][..], &["iteration"; 6], &["plan"; 3]].concat());
        let (begin, iteration, plan) = (&lines[1], &lines[7], &lines[10]);
        assert_eq!(
            (&begin["episode"], &begin["solver"], &begin["horizon"]),
            (&4.into(), &"cem".into(), &10.into())
        );
        assert_eq!(begin["initial"].as_array().unwrap().len(), 20);
        assert_eq!(
            (&iteration["episode"], &iteration["plan"], &iteration["iteration"]),
            (&4.into(), &0.into(), &1.into())
        );
        assert!(iteration["best"].as_f64() <= iteration["elite_mean"].as_f64());
        assert!(iteration["gradient_norm"].is_null());
        assert_eq!((&plan["episode"], &plan["iterations"]), (&4.into(), &2.into()));
        assert_eq!(plan["actions"].as_array().unwrap().len(), 20);

        let length = |name: &str| iteration[name].as_array().map(Vec::len);
        let (elites, candidates) = (detail >= Detail::Elites, detail >= Detail::Candidates);
        assert_eq!(length("elites"), elites.then_some(4));
        assert_eq!((length("mean"), length("std")), (elites.then_some(20), elites.then_some(20)));
        assert_eq!(
            (length("costs"), length("candidates")),
            (candidates.then_some(16), candidates.then_some(16))
        );
        if elites {
            assert_eq!(iteration["elites"][0]["cost"], iteration["best"]);
            assert_eq!(iteration["elites"][0]["actions"].as_array().unwrap().len(), 20);
        }
    }
}

#[test]
fn a_full_disk_is_told_at_the_end_and_disturbs_no_plan() {
    /// Takes so many bytes.
    struct Disk(usize);
    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0 = self.0.checked_sub(bytes.len()).ok_or_else(|| io::Error::other("the disk is full"))?;
            Ok(bytes.len())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let solver = Cem::default();
    let mut trace = JsonLines::new(Disk(3000), Detail::Figures);
    let (plan, _) = solve(&solver, &mut trace);
    assert_eq!(plan, solve(&solver, &mut NoTrace).0);
    assert_eq!(trace.finish().unwrap_err().to_string(), "the disk is full");
}

fn stories(trace: Option<Arc<Mutex<Memory>>>) -> Vec<Story> {
    let solver = Cem { samples: 24, elites: 4, iterations: 3, ..Cem::default() };
    let cost = SimulatorCost::new(&TOY, &EnvConfig::default(), SimulatorOptions::default());
    let cost = Box::new(cost.expect("the toy can be made"));
    let config = PlanConfig { horizon: 3, receding_horizon: 2, action_block: 2, ..PlanConfig::default() };
    let mut policy = MpcPolicy::new(Box::new(solver), cost, config).expect("a valid configuration");
    if let Some(trace) = trace {
        policy = policy.with_trace(trace);
    }
    run(&Setting { num_envs: 3, episodes: 5, ..Setting::default() }, policy).expect("a run without failures")
}

#[test]
fn a_watched_policy_does_what_an_unwatched_one_does() {
    let memory = Arc::new(Mutex::new(Memory::new(2)));
    let watched = stories(Some(Arc::clone(&memory)));
    assert_eq!(watched, stories(None));
    let memory = memory.lock().unwrap();
    let mut seen: Vec<(u64, u64)> =
        memory.plans().iter().map(|plan| (plan.key.episode, plan.key.plan)).collect();
    seen.sort_unstable();
    let made = watched.iter().enumerate().flat_map(|(episode, story)| {
        (0..story.actions.len().div_ceil(4) as u64).map(move |plan| (episode as u64, plan))
    });
    assert_eq!(seen, made.collect::<Vec<_>>(), "every plan is seen once");
}
