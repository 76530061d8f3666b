//! The simulation alone: a control step with and without contact, saved states.

use std::hint::black_box;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use swm_benches::{Actions, BareEnv, EPISODE_STEPS};
use swm_core::{Env as _, EnvState};
use swm_envs_2d::pusht::physics::{ActionMode, Placement, Setup, Sim};

/// Whole episodes of control steps: one that touches nothing, one that pushes the block about.
fn control_step(c: &mut Criterion) {
    let mut group = c.benchmark_group("control_step");
    group.throughput(Throughput::Elements(EPISODE_STEPS as u64));

    let mut free = Sim::new(&Setup::default()).expect("the defaults are valid");
    let apart = Placement::from([100.0, 100.0, 350.0, 300.0, 0.0]);
    free.place_exactly(&apart).expect("the values are finite");
    let circle: Vec<[f32; 2]> = (0..EPISODE_STEPS)
        .map(|step| (step as f32 * 0.3).sin_cos().into())
        .map(|[x, y]: [f32; 2]| [0.2 * x, 0.2 * y])
        .collect();
    assert_eq!(contact_points(&free, &circle), 0, "the free episode touches nothing");

    let mut env = BareEnv::new().expect("the defaults are valid");
    let pushes = env.actions(0, Actions::Weak).expect("the environment steps");
    env.reset(0).expect("the defaults are valid");
    let rich = env.env().scene().sim().clone();
    assert!(contact_points(&rich, &pushes) > 100, "the contact-rich episode is one");

    for (name, start, actions) in [("free", free, circle), ("contact_rich", rich, pushes)] {
        group.bench_function(name, |b| b.iter(|| contact_points(black_box(&start), &actions)));
    }
    group.finish();
}

fn contact_points(start: &Sim, actions: &[[f32; 2]]) -> u32 {
    let mut sim = start.clone();
    actions.iter().map(|&action| sim.control_step(action, ActionMode::Relative)).sum()
}

/// What planners on the true simulator do for every candidate.
fn saved_states(c: &mut Criterion) {
    let mut group = c.benchmark_group("state");
    let mut env = BareEnv::new().expect("the defaults are valid");
    env.actions(0, Actions::Weak).expect("the environment steps");
    let mut state = EnvState::new();
    group.bench_function("snapshot", |b| {
        b.iter(|| env.env().snapshot(black_box(&mut state)).expect("a state can be saved"));
    });
    group.bench_function("restore", |b| {
        b.iter(|| env.env().restore(black_box(&state)).expect("the state is its own"));
    });
    let sim = env.env().scene().sim().clone();
    group.bench_function("clone_sim", |b| b.iter(|| black_box(sim.clone())));
    group.finish();
}

criterion_group!(benches, control_step, saved_states);
criterion_main!(benches);
