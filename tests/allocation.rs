//! Stepping allocates nothing in steady state, pictures included.

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use swm::core::error::BoxError;
use swm::core::{
    EnvConfig, EpisodeEnd, ImageSize, LiveRow, Recorder, ResetOptions, Rollout, Scenario, World,
    WorldOptions, policy,
};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Counts the allocations between the tenth and the ninetieth step of an episode.
#[derive(Default)]
struct Counter {
    region: Option<Region<'static, System>>,
    allocations: Option<usize>,
}

impl Recorder for Counter {
    fn step(&mut self, row: &LiveRow<'_>) -> Result<(), BoxError> {
        match row.episode.step {
            10 if self.region.is_none() => self.region = Some(Region::new(ALLOCATOR)),
            90 if self.allocations.is_none() => {
                let change = self.region.as_ref().expect("step 10 came first").change();
                self.allocations = Some(change.allocations + change.reallocations);
            }
            _ => {}
        }
        Ok(())
    }

    fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}

/// Environments whose steps are free of allocations. TwoRoom-v1 makes four small ones per step, and those that came with it
/// were not tried yet: they belong here once they pass.
const FREE: &[&str] = &["swm/PushT-v1", "swm/PushT-Discrete-v1"];

#[test]
fn steps_do_not_allocate() {
    let registry = swm::registry();
    for entry in registry.envs().iter().filter(|entry| FREE.contains(&entry.id)) {
        for (num_envs, render) in [(1, "exact"), (1, "fast"), (4, "exact")] {
            // The scenes of MuJoCo have no pictures yet.
            let draws = !entry.id.ends_with("DMControl-v0");
            let image = draws.then_some(ImageSize { height: 64, width: 64 });
            let mut env = EnvConfig { image, ..EnvConfig::default() };
            if entry.settings.iter().any(|setting| setting.name == "render") {
                env.settings.insert("render".to_owned(), render.into());
            }
            let threads = Some(1);
            let options = WorldOptions { num_envs, env, threads, ..WorldOptions::default() };
            let mut world = World::new(entry, options).unwrap();
            world.set_policy(policy::random());
            let reset = ResetOptions::default();
            let rollout = Rollout { episodes: 0..num_envs as u64, seed: 3, scenario: Scenario::Same(&reset) };
            let mut counter = Counter::default();
            world.run(&rollout, &mut counter).unwrap();
            assert_eq!(counter.allocations, Some(0), "{} with {num_envs} environments, {render}", entry.id);
        }
    }
}
