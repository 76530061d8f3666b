//! What is saved beside the weights that a step leaves: averages of weights, and estimated statistics of batch normalization.

use serde_json::json;

use super::{Clips, joint, options, step, tiny, weights};
use crate::{Baseline, Device, MakeOptions, make, restore};

fn with_ema(ema: f64) -> Box<dyn Baseline> {
    let mut changes = joint();
    changes["optim"] = json!({ "ema": ema });
    make("lewm", &MakeOptions { seed: 3, ..options("small", changes) }).unwrap()
}

#[test]
fn an_average_of_weights_is_saved_and_the_weights_themselves_go_on() {
    let (mut plain, mut averaging) = (with_ema(0.0), with_ema(0.9));
    let [first, second] = [0, 1].map(|index| {
        assert_eq!(step(plain.as_mut(), 0, index), step(averaging.as_mut(), 0, index));
        weights(plain.as_ref())
    });
    let (mut trained, mut gathered) = (0, 0);
    for (name, saved) in weights(averaging.as_ref()) {
        let is_gathered = name.contains("running_") || name.contains("background");
        // The decay after the second step is (1 + 1) / (10 + 1), which is less than 0.9.
        let kept = if is_gathered { 0.0 } else { 2.0 / 11.0 };
        for ((saved, first), second) in
            saved.values.iter().zip(&first[&name].values).zip(&second[&name].values)
        {
            let wanted = kept * first + (1.0 - kept) * second;
            assert!(
                (saved - wanted).abs() <= 1e-6 * wanted.abs().max(1.0),
                "{name}: {saved} is not {wanted}"
            );
            *(if is_gathered { &mut gathered } else { &mut trained }) += usize::from(first != second);
        }
    }
    assert!(trained > 100 && gathered > 10, "{trained} {gathered}");
    let refused =
        make("lewm", &options("small", json!({ "optim": { "ema": 1.0 } }))).err().unwrap().to_string();
    assert!(refused.contains("`optim.ema` is 1"), "{refused}");
}

#[test]
fn an_average_of_weights_is_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let [file, state] = ["weights.safetensors", "training.safetensors"].map(|name| folder.path().join(name));
    let mut model = with_ema(0.9);
    (0..3).for_each(|index| drop(step(model.as_mut(), 0, index)));
    model.save_weights(&file).unwrap();
    model.save_training(&state).unwrap();
    let mut resumed = restore(model.model_config(), Device::Cpu).unwrap();
    resumed.load_weights(&file).unwrap();
    resumed.load_training(&state).unwrap();
    for index in 3..5 {
        assert_eq!(step(model.as_mut(), 0, index), step(resumed.as_mut(), 0, index));
    }
    assert_eq!(weights(model.as_ref()), weights(resumed.as_ref()));
}

#[test]
fn estimated_statistics_are_means_over_batches() {
    let mut model = tiny("lewm");
    (0..2).for_each(|index| drop(step(model.as_mut(), 0, index)));
    let before = weights(model.as_ref());
    let one = Clips::of(model.as_ref());
    let mut other = Clips::of(model.as_ref());
    other.pixels.reverse();
    other.action.iter_mut().for_each(|value| *value = 1.0 - *value);
    let mut estimate = |batches: &[&Clips]| {
        for (before, clips) in batches.iter().enumerate() {
            model.estimate_statistics(&clips.batch(), 0, before as u64).unwrap();
        }
        weights(model.as_ref())
    };
    let (of_one, of_other, of_both) = (estimate(&[&one]), estimate(&[&other]), estimate(&[&one, &other]));
    let mut differing = 0;
    for (name, both) in &of_both {
        if !name.contains("running_") {
            assert_eq!(both, &before[name], "{name}: weights stay");
            continue;
        }
        for ((both, a), b) in both.values.iter().zip(&of_one[name].values).zip(&of_other[name].values) {
            assert!((both - (a + b) / 2.0).abs() <= 1e-6 * a.abs().max(1.0), "{name}: {both} of {a} and {b}");
            differing += usize::from(a != b);
        }
    }
    assert!(differing > 20, "{differing}");
}
