//! Stepping allocates nothing in steady state, images included.

use std::alloc::System;

use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use swm::core::error::BoxError;
use swm::core::{
    EnvConfig, EnvEntry, EpisodeEnd, ImageSize, LiveStep, Recorder, Rollout, World, WorldOptions, policies,
};

#[global_allocator]
static ALLOCATOR: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Counts the allocations between the tenth and the last step of an episode.
struct Counter {
    last: u64,
    region: Option<Region<'static, System>>,
    allocations: Option<usize>,
}

impl Recorder for Counter {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        match row.episode.step {
            10 if self.region.is_none() => self.region = Some(Region::new(ALLOCATOR)),
            step if step == self.last && self.allocations.is_none() => {
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

/// Rapier's own step allocates.
const RAPIER: [&str; 3] = ["swm/PushTRapier-v0", "swm/PointMaze-v0", "swm/TablePush3D-v0"];
/// The count is of the whole process, where the pool of an earlier world may still be ending: what steps allocate shows
/// in every attempt.
const ATTEMPTS: usize = 3;

#[test]
fn steps_do_not_allocate() {
    let registry = swm::registry();
    let mut offenders = Vec::new();
    for entry in registry.envs().filter(|entry| !RAPIER.contains(&entry.id)) {
        for (num_envs, render) in [(1, "exact"), (1, "fast"), (4, "exact")] {
            let mut counts = Vec::new();
            while counts.len() < ATTEMPTS && !counts.contains(&Some(0)) {
                counts.push(allocations_of_steps(entry, num_envs, render));
            }
            if !counts.contains(&Some(0)) {
                offenders.push(format!("{} with {num_envs} environments, {render}: {counts:?}", entry.id));
            }
        }
    }
    assert!(offenders.is_empty(), "these allocate: {offenders:#?}");
}

fn allocations_of_steps(entry: &EnvEntry, num_envs: usize, render: &str) -> Option<usize> {
    let image = Some(ImageSize { height: 64, width: 64 });
    let mut env = EnvConfig { image, ..EnvConfig::default() };
    for label in ["depth", "segmentation"] {
        if entry.settings.iter().any(|setting| setting.name == label) {
            env.settings.insert(label.to_owned(), true.into());
        }
    }
    if entry.settings.iter().any(|setting| setting.name == "render") {
        env.settings.insert("render".to_owned(), render.into());
    }
    let options = WorldOptions::new(num_envs).env(env).threads(1);
    let mut world = World::new(entry, options).expect("the table's environments exist");
    // Random pushes end an episode of CartPole too soon; its expert allocates at the first step only.
    let policy = match entry.id {
        "swm/CartPoleControl-v1" => swm::registry().policy("expert", &world).expect("it has one"),
        _ => Box::new(policies::random()),
    };
    world.set_policy(policy).expect("it begins");
    let rollout = Rollout::new(0..num_envs as u64).seed(3);
    // Episodes of Fetch have 50 steps; a random walk on the grid meets the goal after 65, a zombie meets the player.
    let short = ["swm/Fetch", "swm/SimpleNavigation", "swm/CraftaxClassic"];
    let is_short = short.iter().any(|name| entry.id.starts_with(name));
    let last = if is_short { 45 } else { 90 };
    let mut counter = Counter { last, region: None, allocations: None };
    world.run(&rollout, &mut counter).expect("random episodes run");
    counter.allocations
}
