//! PushT in its world: the bare step, `World::step` by images, environments and threads, and the reset.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use swm_benches::{Actions, BareEnv, EPISODE_STEPS, Image, world};
use swm_core::{ResetOptions, Rollout};

/// `Env::step` and `Env::observe` through whole episodes, without images.
fn bare_step(c: &mut Criterion) {
    let mut group = c.benchmark_group("bare_step");
    group.throughput(Throughput::Elements(EPISODE_STEPS as u64));
    for kind in Actions::ALL {
        let mut env = BareEnv::new().expect("the defaults are valid");
        let actions = env.actions(0, kind).expect("the environment steps");
        env.reset(0).expect("the defaults are valid");
        let start = env.snapshot().expect("a state can be saved");
        group.bench_function(kind.name(), |b| {
            b.iter(|| {
                env.restore(&start).expect("the state is its own");
                for &action in &actions {
                    black_box(env.step(action).expect("actions are finite"));
                }
            });
        });
    }
    group.finish();
}

/// One step of all environments. Threads matter for more than one environment only.
fn world_step(c: &mut Criterion) {
    let mut group = c.benchmark_group("world_step");
    for image in Image::ALL {
        for (num_envs, threads) in [(1, 1), (8, 1), (8, 2)] {
            group.throughput(Throughput::Elements(num_envs as u64));
            for kind in Actions::ALL {
                let mut world = world(image, kind, num_envs, threads).expect("the options are valid");
                world.reset(0, &ResetOptions::default()).expect("the defaults are valid");
                let name = format!("{}/{}/envs={num_envs}/threads={threads}", image.name(), kind.name());
                let mut steps = 0;
                group.bench_function(name, |b| {
                    b.iter(|| {
                        // A reset in a hundred steps costs little, and keeps the agent from wandering off for ever.
                        if steps % EPISODE_STEPS == 0 {
                            world
                                .reset(steps as u64, &ResetOptions::default())
                                .expect("the defaults are valid");
                        }
                        steps += 1;
                        world.step().expect("the policy is attached");
                    });
                });
            }
        }
    }
    group.finish();
}

/// Whole runs of 16 episodes of 100 steps, resets included: the loop that collecting and evaluating share. It moves to
/// the world's threads once, where `World::step` does so at each step.
fn world_run(c: &mut Criterion) {
    const EPISODES: u64 = 16;
    let mut group = c.benchmark_group("world_run");
    group.sample_size(20).throughput(Throughput::Elements(EPISODES * EPISODE_STEPS as u64));
    for image in Image::ALL {
        for (num_envs, threads) in [(1, 1), (8, 1), (8, 2)] {
            let mut world = world(image, Actions::Weak, num_envs, threads).expect("the options are valid");
            world.set_max_episode_steps(Some(EPISODE_STEPS as u64));
            let rollout = Rollout::new(0..EPISODES);
            let name = format!("{}/weak/envs={num_envs}/threads={threads}", image.name());
            group.bench_function(name, |b| {
                b.iter(|| world.run(&rollout, &mut ()).expect("nothing can fail"));
            });
        }
    }
    group.finish();
}

/// A reset of one environment: factors, start, goal, and the first images of both.
fn reset(c: &mut Criterion) {
    let mut group = c.benchmark_group("reset");
    for image in Image::ALL {
        for (name, options) in
            [("default", ResetOptions::default()), ("all", ResetOptions::default().vary(["all"]))]
        {
            let mut world = world(image, Actions::Random, 1, 1).expect("the options are valid");
            let mut seed = 0;
            group.bench_function(format!("{}/{name}", image.name()), |b| {
                b.iter(|| {
                    seed += 1;
                    world.reset(seed, &options).expect("the options are valid");
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, bare_step, world_step, world_run, reset);
criterion_main!(benches);
