//! GRASP on a trained world model: single steps of its latents with the derivative by actions, and plans in its environment.

use swm_baselines::Device;
use swm_baselines::acting::ModelCost;
use swm_baselines::train::{TrainedModel, Which};
use swm_solvers::{Candidates, Cost as _, StepBatch};

use super::{IMAGE, paths, record, trained};

/// Values that look like none in particular.
fn spread(count: usize, from: f32) -> Vec<f32> {
    (0..count).map(|index| (from + 1.7 * index as f32).sin()).collect()
}

#[test]
fn latents_are_searched_beside_actions() {
    let folder = tempfile::tempdir().unwrap();
    record(folder.path());
    trained(folder.path(), "lewm", "world");
    let run = folder.path().join("world");
    let model = TrainedModel::open(&run, Which::default(), Device::Cpu).unwrap();
    let mut cost = ModelCost::new(model).unwrap();
    let steps = cost.steps().unwrap();
    let (dim, block) = (steps.state_dim(), 4);
    let (states, targets, actions) = (spread(2 * dim, 0.0), spread(2 * dim, 5.0), spread(2 * block, 9.0));
    let mut run_with = |actions: &[f32]| {
        let (mut next, mut gradient) = (vec![0.0; 2 * dim], vec![0.0; 2 * block]);
        let candidates = Candidates { actions, episodes: 1, samples: 1, horizon: 2, dim: block };
        let batch = StepBatch { candidates, states: &states, targets: &targets };
        steps.step_toward(&batch, &mut next, &mut gradient).unwrap();
        let off = |(next, target): (&f32, &f32)| f64::from(next - target).powi(2);
        (next.iter().zip(&targets).map(off).sum::<f64>(), gradient)
    };
    let (_, gradient) = run_with(&actions);
    // The model has learned for a step: its predictions hardly depend on actions.
    let largest = gradient.iter().fold(0.0_f64, |most, slope| most.max(f64::from(slope.abs())));
    assert!(largest > 1e-5, "{gradient:?}");
    for (index, slope) in gradient.iter().enumerate() {
        let mut at = |move_by: f32| {
            let mut moved = actions.clone();
            moved[index] += move_by;
            run_with(&moved).0
        };
        let found = (at(0.25) - at(-0.25)) / 0.5;
        assert!((found - f64::from(*slope)).abs() < 0.3 * largest, "{index}: {slope} is not {found}");
    }

    let run = run.display();
    let search = "iterations=6,sync_interval=3,sync_iterations=2,sync_samples=6,sync_elites=2,horizon=2,receding_horizon=1";
    let policy = |more: &str| format!("mpc:{run},solver=grasp,{search}{more}");
    let alone = paths(&policy(""), 1, Some(IMAGE)).unwrap();
    assert!(alone.0 == paths(&policy(""), 3, Some(IMAGE)).unwrap().0, "plans depend on the others");
    let by_gradient = paths(&policy(",sync=gradient"), 1, Some(IMAGE)).unwrap();
    assert!(by_gradient.0.len() == alone.0.len() && by_gradient.0 != alone.0);
    let error = paths(&policy(",sync_elites=1"), 1, Some(IMAGE)).err().unwrap();
    assert!(error.contains("sync_elites"), "{error}");
}
