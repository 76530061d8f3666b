//! TwoRoom-v2 in its world: steps by pictures, resets with nothing and with everything varied.

use criterion::{Criterion, criterion_group, criterion_main};
use swm_benches::{EPISODE_STEPS, Picture};
use swm_core::{ResetOptions, World, WorldOptions, policy};
use swm_envs_2d::tworoom_v2::TWO_ROOM_V2;

fn world(picture: Picture) -> World {
    let options = WorldOptions {
        env: picture.config(),
        threads: Some(1),
        max_episode_steps: None,
        ..WorldOptions::default()
    };
    let mut world = World::new(&TWO_ROOM_V2, options).expect("the options are valid");
    world.set_policy(policy::random());
    world
}

fn step(c: &mut Criterion) {
    let mut group = c.benchmark_group("two_room_step");
    for picture in Picture::ALL {
        let mut world = world(picture);
        let mut steps = 0;
        group.bench_function(picture.name(), |b| {
            b.iter(|| {
                if steps % EPISODE_STEPS == 0 {
                    world.reset(steps as u64, &ResetOptions::default()).expect("the defaults are valid");
                }
                steps += 1;
                world.step().expect("the policy is attached");
            });
        });
    }
    group.finish();
}

fn reset(c: &mut Criterion) {
    let mut group = c.benchmark_group("two_room_reset");
    for picture in Picture::ALL {
        for (name, options) in
            [("default", ResetOptions::default()), ("all", ResetOptions::default().vary(&["all"]))]
        {
            let (mut world, mut seed) = (world(picture), 0);
            group.bench_function(format!("{}/{name}", picture.name()), |b| {
                b.iter(|| {
                    seed += 1;
                    world.reset(seed, &options).expect("the options are valid");
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, step, reset);
criterion_main!(benches);
