//! Environments on rapier2d: a control step, saved states, and the cost that planners ask for.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use swm_core::{
    EnvConfig, EnvEntry, EnvState, Episode, EpisodeSeed, Registry, ResetOptions, Slice, World, WorldOptions,
};
use swm_envs_2d::ENVS;
use swm_envs_2d::point_maze::POINT_MAZE;
use swm_envs_2d::pusht::PUSHT_RAPIER;

/// The environments, each with a policy that touches things.
const CASES: [(&str, &EnvEntry, &str); 2] =
    [("pusht_rapier", &PUSHT_RAPIER, "weak"), ("point_maze", &POINT_MAZE, "explorer")];

/// One step of a world of one environment, without images.
fn world_step(c: &mut Criterion) {
    let mut group = c.benchmark_group("rapier_world_step");
    for (name, entry, policy) in CASES {
        let options = WorldOptions::default().max_episode_steps(None).threads(1);
        let mut world = World::new(entry, options).expect("the options are valid");
        world
            .set_policy(Registry::new().with(ENVS).policy(policy, &world).expect("it exists"))
            .expect("it begins");
        let mut steps = 0;
        group.bench_function(name, |b| {
            b.iter(|| {
                if steps % 100 == 0 {
                    world.reset(steps, &ResetOptions::default()).expect("the defaults are valid");
                }
                steps += 1;
                world.step().expect("the policy is attached");
            });
        });
    }
    group.finish();
}

/// What planners on the true simulator do for every candidate.
fn saved_states(c: &mut Criterion) {
    let mut group = c.benchmark_group("rapier_state");
    for (name, entry, _) in CASES {
        let mut env = entry.make(&EnvConfig::default()).expect("the defaults are valid");
        let options = ResetOptions::default();
        env.reset(&Episode::new(EpisodeSeed::new(0), &options)).expect("the defaults are valid");
        env.step(Slice::F32(&[0.3, -0.2])).expect("the action is valid");
        let mut state = EnvState::new();
        group.bench_function(format!("{name}/snapshot"), |b| {
            b.iter(|| env.snapshot(black_box(&mut state)).expect("a state can be saved"));
        });
        group.bench_function(format!("{name}/restore"), |b| {
            b.iter(|| env.restore(black_box(&state)).expect("the state is its own"));
        });
        group.bench_function(format!("{name}/task_cost"), |b| b.iter(|| black_box(env.task_cost())));
    }
    group.finish();
}

criterion_group!(benches, world_step, saved_states);
criterion_main!(benches);
