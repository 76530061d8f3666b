//! Planning without a world: what one control step takes that makes a new plan, at 50 Hz.

#[path = "../../crates/swm-solvers/examples/plan_at_50_hz/model.rs"]
mod model;

use criterion::{Criterion, criterion_group, criterion_main};
use model::{Body, GOAL, OBSTACLE, RADIUS};
use swm_solvers::Mpc;
use swm_solvers::models::ControlCost;

/// Whole drives past the obstacle, step by step: 64 candidates of 50 actions, 6 iterations.
fn latency(c: &mut Criterion) {
    let mut group = c.benchmark_group("mpc");
    for threads in [1, 2] {
        let pool =
            rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads can be started");
        let mut mpc =
            Mpc::new(Box::new(model::solver()), model::config(), model::actions()).expect("settings");
        let mut cost = ControlCost::new(Body { now: [0.0; 4] });
        group.bench_function(format!("double_integrator/threads={threads}"), |b| {
            pool.install(|| {
                b.iter(|| {
                    let action = mpc.next(&mut cost, None).expect("finite costs");
                    let action = [f64::from(action[0]), f64::from(action[1])];
                    cost.model.now = Body::after(&cost.model.now, action);
                    assert!(Body::distance(&cost.model.now, OBSTACLE) > RADIUS, "it does not touch");
                    if Body::distance(&cost.model.now, GOAL) < 0.05 {
                        cost.model.now = [0.0; 4];
                        mpc.reset();
                    }
                });
            });
        });
    }
    group.finish();
}

criterion_group!(benches, latency);
criterion_main!(benches);
