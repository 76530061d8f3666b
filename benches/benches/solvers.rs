//! Planning without a model: what every solver costs by itself.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use swm_benches::SolveCase;

/// 300 candidates of 10 blocks of 2 values, 30 iterations: the reference's defaults.
fn solvers(c: &mut Criterion) {
    for (episodes, threads) in [(1, 1), (8, 1), (8, 2)] {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        for mut case in SolveCase::all(episodes).expect("the settings are sound") {
            let mut group = c.benchmark_group(case.name);
            group.sample_size(20);
            group.throughput(Throughput::Elements(episodes as u64));
            group.bench_function(format!("episodes={episodes}/threads={threads}"), |b| {
                pool.install(|| b.iter(|| case.solve().expect("the problem is sound")));
            });
            group.finish();
            assert!(case.plan.cost_of_returned[0] <= 0.5, "{} found the plan", case.name);
        }
    }
}

criterion_group!(benches, solvers);
criterion_main!(benches);
