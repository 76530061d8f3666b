//! bf16 gives about what fp32 gives, and leaves the weights in fp32.

use swm_solvers::{Candidates, Outputs};

use super::{Clips, for_each, step, tiny, weights};
use crate::{BASELINES, Baseline, Device, Losses, Precision, restore};

/// What bf16 may change: its values have 8 significant bits.
const NEAR: f32 = 2e-2;
/// The same for norms of gradients, for which the errors of two passes add up.
const NEAR_NORM: f32 = 3e-2;
/// The same for a validation of HILP, whose values are distances of embeddings that differ little.
const NEAR_HILP: f32 = 4e-2;
/// HILP's policy weighs clips by the exponential of such differences. It makes single steps differ by up to 7 %, and others by nothing,
/// depending on the last bits of the weights: the mean of so many steps is compared, with [`NEAR`].
const HILP_STEPS: u64 = 24;

fn in_bf16(mut model: Box<dyn Baseline>) -> Box<dyn Baseline> {
    model.set_precision(Precision::Bf16);
    model
}

/// A copy of the model with the weights and the optimizer that it has now.
fn copy(model: &dyn Baseline) -> Box<dyn Baseline> {
    let folder = tempfile::tempdir().unwrap();
    let [file, state] = ["weights.safetensors", "training.safetensors"].map(|name| folder.path().join(name));
    model.save_weights(&file).unwrap();
    model.save_training(&state).unwrap();
    let mut copy = restore(model.model_config(), Device::Cpu).unwrap();
    copy.load_weights(&file).unwrap();
    copy.load_training(&state).unwrap();
    copy
}

#[test]
fn losses_and_gradients_are_near_those_of_fp32() {
    let mut far = Vec::new();
    let mut compare = |what: String, error: f32, near: f32| {
        if error > near {
            far.push(format!("{what}: {error}"));
        }
    };
    let error = |full: f32, narrow: f32| (full - narrow).abs() / full.abs();
    for entry in BASELINES {
        let (name, mut full) = (entry.name, tiny(entry.name));
        let is_hilp = name == "hilp";
        for phase in 0..full.phases().len() {
            let of = format!("{name}, phase {phase}");
            let errors: Vec<[f32; 2]> = (0..if is_hilp { HILP_STEPS } else { 4 })
                .map(|index| {
                    // From the same weights in each step.
                    let mut narrow = in_bf16(copy(full.as_ref()));
                    let [a, b] = [full.as_mut(), narrow.as_mut()].map(|model| step(model, phase, index));
                    let norm = |losses: &Losses| {
                        losses.parts.iter().find(|(name, _)| *name == "gradient_norm").unwrap().1
                    };
                    assert!((a.total, norm(&a)) != (b.total, norm(&b)), "{name}: bf16 is in use");
                    [error(a.total, b.total), error(norm(&a), norm(&b))]
                })
                .collect();
            for (part, near, what) in [(0, NEAR, "loss"), (1, NEAR_NORM, "gradient norm")] {
                let errors: Vec<f32> = errors.iter().map(|errors| errors[part]).collect();
                if is_hilp {
                    let mean = errors.iter().sum::<f32>() / errors.len() as f32;
                    compare(format!("{what} of {of}, mean"), mean, NEAR);
                } else {
                    for (index, error) in errors.into_iter().enumerate() {
                        compare(format!("{what} of {of}, step {index}"), error, near);
                    }
                }
            }
            let narrow = in_bf16(copy(full.as_ref()));
            let clips = Clips::of(full.as_ref());
            let [a, b] = [&full, &narrow].map(|model| model.validate(&clips.batch(), phase).unwrap().total);
            compare(format!("validation of {of}"), error(a, b), if is_hilp { NEAR_HILP } else { NEAR });
        }
    }
    assert!(far.is_empty(), "{far:#?}");
}

#[test]
fn weights_stay_in_fp32_and_gather_small_steps() {
    for_each(|model| {
        let mut model = in_bf16(model);
        step(model.as_mut(), 0, 0);
        let before = weights(model.as_ref());
        step(model.as_mut(), 0, 1);
        let (mut small, mut fine) = (0, 0);
        for (name, after) in weights(model.as_ref()) {
            for (before, after) in before[&name].values.iter().zip(&after.values) {
                fine += usize::from(after.to_bits() & 0xffff != 0);
                // Less than half of bf16's last place.
                let step = (before - after).abs();
                small += usize::from(step > 0.0 && step < before.abs() / 512.0);
            }
        }
        assert!(small > 10 && fine > 100, "{}: {small} {fine}", model.name());
    });
}

#[test]
fn plans_and_decisions_are_near_those_of_fp32() {
    for_each(|mut model| {
        (0..3).for_each(|index| drop(step(model.as_mut(), 0, index)));
        if model.policy().is_none() && model.planner().is_none() {
            return;
        }
        let clips = Clips::of(model.as_ref());
        let mut found = [Precision::Fp32, Precision::Bf16].map(|precision| {
            model.set_precision(precision);
            if let Some(mut policy) = model.policy() {
                let mut actions = vec![0.0; 3 * policy.block_dim()];
                policy.act(&clips.planning_batch(0..3), &mut actions).unwrap();
                return actions.into_iter().map(f64::from).collect::<Vec<_>>();
            }
            let mut planner = model.planner().unwrap();
            let dim = planner.block_dim();
            let actions: Vec<f32> = (0..2 * 40 * 3 * dim).map(|i| (i as f32).cos()).collect();
            let candidates = Candidates { actions: &actions, episodes: 2, samples: 40, horizon: 3, dim };
            let mut costs = vec![0.0; 80];
            planner.prepare(&clips.planning_batch(0..2)).unwrap();
            planner.evaluate(&candidates, &mut Outputs::new(&mut costs)).unwrap();
            costs
        });
        let [full, narrow] = &mut found;
        let largest = full.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        for (a, b) in full.iter().zip(narrow.iter()) {
            assert!((a - b).abs() <= f64::from(NEAR) * largest, "{}: {a} and {b}", model.name());
        }
        assert!(full != narrow, "{}: bf16 is in use", model.name());
    });
}

#[test]
fn names_of_precisions_are_read() {
    for precision in [Precision::Fp32, Precision::Bf16] {
        assert_eq!(precision.to_string().parse::<Precision>().unwrap(), precision);
    }
    let error = "fp16".parse::<Precision>().unwrap_err().to_string();
    assert!(error.contains("`fp16`; use fp32 or bf16"), "{error}");
}
