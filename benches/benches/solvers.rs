//! Planning without a model: what the cross-entropy method costs by itself.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use swm_core::{Dtype, EpisodeSeed, Space};
use swm_solvers::{
    Candidates, Cem, Cost, Moment, NoTrace, Plan, PlanError, PlanKey, Problem, Solver as _, Workspace,
};

/// A cost that is next to nothing: the distance of the first number from a half.
struct Free;

impl Cost for Free {
    fn prepare(&mut self, _moment: &Moment<'_>) -> Result<(), PlanError> {
        Ok(())
    }

    fn evaluate(&mut self, candidates: &Candidates<'_>, costs: &mut [f64]) -> Result<(), PlanError> {
        for (plan, cost) in candidates.plans().zip(costs) {
            *cost = f64::from((plan[0] - 0.5).abs());
        }
        Ok(())
    }
}

/// The reference's defaults: 300 candidates of 10 blocks of 2 numbers, 30 iterations, 30 elites.
fn cem(c: &mut Criterion) {
    let mut group = c.benchmark_group("cem_300x10x2x30");
    group.sample_size(30);
    let action = Space::uniform_box(Dtype::F32, &[2], -1.0, 1.0);
    for (episodes, threads) in [(1, 1), (8, 1), (8, 2)] {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        let keys: Vec<PlanKey> = (0..episodes as u64)
            .map(|episode| PlanKey { episode, seed: EpisodeSeed::of(1, episode), plan: 0 })
            .collect();
        let initial = vec![0.0; episodes * 10 * 2];
        let problem = Problem {
            keys: &keys,
            horizon: 10,
            action_block: 1,
            action: &action,
            initial: &initial,
            memory: &[],
        };
        let (mut workspace, mut plan) = (Workspace::new(), Plan::new());
        group.throughput(Throughput::Elements(episodes as u64));
        group.bench_function(format!("episodes={episodes}/threads={threads}"), |b| {
            pool.install(|| {
                b.iter(|| {
                    let solved =
                        Cem::default().solve(&problem, &mut Free, &mut workspace, &mut NoTrace, &mut plan);
                    solved.expect("the problem is sound");
                });
            });
        });
        assert!((plan.row(0)[0] - 0.5).abs() < 0.05, "the plan was found: {:?}", &plan.row(0)[..2]);
    }
    group.finish();
}

criterion_group!(benches, cem);
criterion_main!(benches);
