//! What other devices than the CPU do in another way gives what the CPU does, computed by the CPU's tensor operations.

use serde_json::json;
use swm_solvers::{Candidates, Outputs};

use super::{Clips, TINY, for_each, options, step, tiny, weights};
use crate::{BASELINES, Baseline, BaselineError, Device, Losses, MakeOptions, Step, make, restore};
use swm_nn::placement::as_on_a_device;

/// Baselines without noise: no dropout, and none with random directions.
fn without_noise() -> Vec<Box<dyn Baseline>> {
    let names = BASELINES.iter().map(|entry| entry.name).filter(|name| !["conv-jepa", "lewm"].contains(name));
    let made = names.map(|name| {
        let (_, changes) = TINY.iter().find(|(of, _)| *of == name).unwrap();
        let mut changes = changes();
        let model = if changes.get("model").is_some() { &mut changes["model"] } else { &mut changes };
        if let Some(predictor) = model.get_mut("predictor") {
            predictor["dropout"] = json!(0.0);
        }
        // The gradient is clipped. With Adam's own epsilon, gradients that are 0 but for rounding move weights as others do.
        changes["optim"] = json!({ "clip": 0.5, "ema": 0.9, "epsilon": 1e-3 });
        make(name, &MakeOptions { seed: 3, ..options("small", changes) }).unwrap()
    });
    made.collect()
}

fn close(name: &str, a: &Losses, b: &Losses) {
    let all = |losses: &Losses| {
        let parts = losses.parts.iter().map(|(_, value)| *value);
        std::iter::once(losses.total).chain(parts).collect::<Vec<_>>()
    };
    assert!(a.parts.iter().map(|(name, _)| name).eq(b.parts.iter().map(|(name, _)| name)), "{name}");
    for (a, b) in all(a).iter().zip(all(b)) {
        assert!((a - b).abs() <= 1e-4 * a.abs().max(1e-3), "{name}: {a} and {b}");
    }
}

/// Steps whose losses wait, all read at the end.
fn started(model: &mut dyn Baseline, phase: usize, steps: std::ops::Range<u64>) -> Vec<Losses> {
    as_on_a_device(|| {
        for step in steps {
            let clips = Clips::of(model);
            let at = Step { seed: 9, phase, step, total: 10 };
            assert_eq!(model.start_step(&clips.batch(), &at).unwrap(), None);
        }
        model.take_losses().unwrap()
    })
}

#[test]
fn a_device_trains_as_the_host_does() {
    let (hosts, devices) = (without_noise(), without_noise());
    assert!(hosts.len() > 5);
    for (mut on_host, mut on_device) in hosts.into_iter().zip(devices) {
        let name = on_host.name();
        for phase in 0..on_host.phases().len() {
            let losses: Vec<Losses> = (0..4).map(|index| step(on_host.as_mut(), phase, index)).collect();
            let waited = started(on_device.as_mut(), phase, 0..4);
            assert_eq!(waited.len(), 4);
            losses.iter().zip(&waited).for_each(|(a, b)| close(name, a, b));
            assert!(as_on_a_device(|| on_device.take_losses()).unwrap().is_empty());
        }
        let (host, device) = (weights(on_host.as_ref()), weights(on_device.as_ref()));
        for (tensor, values) in &host {
            for (a, b) in values.values.iter().zip(&device[tensor].values) {
                assert!((a - b).abs() < 1e-4, "{name}, {tensor}: {a} and {b}");
            }
        }
    }
}

#[test]
fn a_resumed_training_on_a_device_gives_its_bits_again_and_goes_on_elsewhere() {
    for_each(|mut model| {
        let folder = tempfile::tempdir().unwrap();
        let [file, state] =
            ["weights.safetensors", "training.safetensors"].map(|name| folder.path().join(name));
        started(model.as_mut(), 0, 0..2);
        model.save_weights(&file).unwrap();
        model.save_training(&state).unwrap();
        let resume = || {
            let mut resumed = restore(model.model_config(), Device::Cpu).unwrap();
            resumed.load_weights(&file).unwrap();
            resumed.load_training(&state).unwrap();
            resumed
        };
        let (mut resumed, mut on_host) = (resume(), resume());
        let losses = started(model.as_mut(), 0, 2..4);
        assert_eq!(losses, started(resumed.as_mut(), 0, 2..4), "{}", model.name());
        let there = step(on_host.as_mut(), 0, 2);
        // The same weights, other noise.
        assert!(
            there.total.is_finite() && (there.total - losses[0].total).abs() < 0.5 * losses[0].total.abs()
        );
    });
}

#[test]
fn losses_that_are_not_finite_are_told_with_the_losses_or_change_nothing() {
    let mut model = tiny("gcbc");
    let mut clips = Clips::of(model.as_ref());
    clips.action.fill(1e30);
    let before = weights(model.as_ref());
    let at = Step { seed: 9, phase: 0, step: 3, total: 10 };
    as_on_a_device(|| {
        let error = model.train_step(&clips.batch(), &at).unwrap_err();
        assert!(matches!(error, BaselineError::NotFinite { step: 3, .. }), "{error}");
        assert_eq!(weights(model.as_ref()), before);
        assert_eq!(model.start_step(&clips.batch(), &at).unwrap(), None);
        let error = model.take_losses().unwrap_err();
        assert!(matches!(error, BaselineError::NotFinite { step: 3, .. }), "{error}");
    });
}

#[test]
fn a_device_plans_and_acts_as_the_host_does() {
    for_each(|mut model| {
        (0..3).for_each(|index| drop(step(model.as_mut(), 0, index)));
        let name = model.name();
        let clips = Clips::of(model.as_ref());
        let near = |a: &[f64], b: &[f64]| {
            assert_eq!(a.len(), b.len());
            let largest = a.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
            for (a, b) in a.iter().zip(b) {
                assert!((a - b).abs() <= 1e-5 * largest, "{name}: {a} and {b}");
            }
            assert!(a.iter().any(|value| *value != a[0]), "{name}: {a:?}");
        };
        let wide = |values: &[f32]| values.iter().map(|value| f64::from(*value)).collect::<Vec<_>>();
        if model.policy().is_some() {
            let act = || {
                let mut policy = model.policy().unwrap();
                let mut actions = vec![0.0; 3 * policy.block_dim()];
                policy.act(&clips.planning_batch(0..3), &mut actions).unwrap();
                actions
            };
            near(&wide(&act()), &wide(&as_on_a_device(act)));
        }
        if model.planner().is_some() {
            let plan = || {
                let mut planner = model.planner().unwrap();
                let dim = planner.block_dim();
                let actions: Vec<f32> = (0..2 * 70 * 3 * dim).map(|i| (i as f32).cos()).collect();
                let candidates = Candidates { actions: &actions, episodes: 2, samples: 70, horizon: 3, dim };
                planner.prepare(&clips.planning_batch(0..2)).unwrap();
                let (mut costs, mut again) = (vec![0.0; 140], vec![0.0; 140]);
                let mut gradient = vec![0.0; actions.len()];
                planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
                let outputs = &mut Outputs { gradient: Some(&mut gradient), ..Outputs::new(&mut again) };
                planner.evaluate(&candidates, outputs).unwrap();
                let mut latents = vec![0.0; 3 * planner.latent_dim()];
                planner.encode(&clips.observations(3), &mut latents).unwrap();
                let encoded = latents.clone();
                planner.predict(&mut latents, &actions[..3 * dim]).unwrap();
                [costs, again, wide(&gradient), wide(&encoded), wide(&latents)]
            };
            let (host, device) = (plan(), as_on_a_device(plan));
            host.iter().zip(&device).for_each(|(host, device)| near(host, device));
        }
    });
}
