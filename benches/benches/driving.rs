//! A step by hand, as an outside driver pays for it: environments so cheap that only the world's own work is measured.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use swm_core::testing::TOY;
use swm_core::{ResetOptions, Slice, World, WorldOptions, policies};

fn by_hand(c: &mut Criterion) {
    let mut group = c.benchmark_group("driving");
    for num_envs in [1, 2, 8] {
        for threads in [1, 2] {
            let options = WorldOptions::new(num_envs).max_episode_steps(None).threads(threads);
            let mut world = World::new(&TOY, options).expect("the options are valid");
            world.set_policy(policies::random()).expect("it begins");
            // So far from the goal that no episode ends.
            let far = ResetOptions {
                start: Some([("state".to_owned(), swm_core::Value::vector(&[1e9]))].into_iter().collect()),
                ..ResetOptions::default()
            };
            world.reset(0, &far).expect("the start is valid");
            group.throughput(Throughput::Elements(num_envs as u64));
            group.bench_function(format!("step/envs={num_envs}/threads={threads}"), |b| {
                b.iter(|| world.step().expect("nothing can fail"));
            });
            let actions = vec![0.1_f32; num_envs];
            group.bench_function(format!("step_with/envs={num_envs}/threads={threads}"), |b| {
                b.iter(|| world.step_with(Slice::F32(&actions)).expect("nothing can fail"));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, by_hand);
criterion_main!(benches);
