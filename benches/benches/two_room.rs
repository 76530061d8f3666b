//! Both versions of TwoRoom in their world: steps by images, resets with nothing and with everything varied.

use criterion::{Criterion, criterion_group, criterion_main};
use swm_benches::{EPISODE_STEPS, Image, world_of};
use swm_core::{EnvEntry, ResetOptions, World};
use swm_envs_2d::tworoom_v1::TWO_ROOM;
use swm_envs_2d::tworoom_v2::TWO_ROOM_V2;

const VERSIONS: [(&str, &EnvEntry); 2] = [("v1", &TWO_ROOM), ("v2", &TWO_ROOM_V2)];

fn world(entry: &'static EnvEntry, image: Image) -> World {
    world_of(entry, image, "random", 1, 1).expect("the options are valid")
}

fn step(c: &mut Criterion) {
    let mut group = c.benchmark_group("two_room_step");
    for (version, entry) in VERSIONS {
        for image in Image::ALL {
            let (mut world, mut steps) = (world(entry, image), 0);
            group.bench_function(format!("{version}/{}", image.name()), |b| {
                b.iter(|| {
                    // Also where energy runs out after that many steps.
                    if steps % EPISODE_STEPS == 0 {
                        world.reset(steps as u64, &ResetOptions::default()).expect("the defaults are valid");
                    }
                    steps += 1;
                    world.step().expect("the policy is attached");
                });
            });
        }
    }
    group.finish();
}

fn reset(c: &mut Criterion) {
    let mut group = c.benchmark_group("two_room_reset");
    for (version, entry) in VERSIONS {
        for image in Image::ALL {
            for (name, options) in
                [("default", ResetOptions::default()), ("all", ResetOptions::default().vary(["all"]))]
            {
                let (mut world, mut seed) = (world(entry, image), 0);
                group.bench_function(format!("{version}/{}/{name}", image.name()), |b| {
                    b.iter(|| {
                        seed += 1;
                        world.reset(seed, &options).expect("the options are valid");
                    });
                });
            }
        }
    }
    group.finish();
}

criterion_group!(benches, step, reset);
criterion_main!(benches);
