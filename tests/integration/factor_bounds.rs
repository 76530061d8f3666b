//! Every factor of every environment at both of its bounds: episodes go, or a constraint with other factors says why not.

use swm::core::seed::{EpisodeSeed, keyed};
use swm::core::{Column, Dtype, Env, EnvConfig, EnvError, Episode, FactorSpec, ResetOptions, Value};
use swm::data::testing::rounds;

/// Steps of an episode.
const STEPS: usize = 60;

/// The factor at its lower or upper bound.
fn at_bound(factor: &FactorSpec, upper: bool) -> Value {
    let (low, high) = factor.space.bounds();
    let values = Value { shape: factor.space.shape(), ..Value::vector(if upper { &high } else { &low }) };
    values
        .cast(&factor.name, factor.space.dtype().unwrap_or(Dtype::F64), &factor.space.shape())
        .expect("bounds are values")
}

/// What goes wrong in `episodes` episodes of random actions with the factor at a bound.
fn run(env: &mut dyn Env, factor: &FactorSpec, upper: bool, episodes: usize) -> Result<(), EnvError> {
    let action_space = env.spec().action.clone();
    let mut action = Column::zeros(action_space.dtype().unwrap_or(Dtype::F32), action_space.dim());
    let options = ResetOptions::default().vary(["none"]).set(&factor.name, at_bound(factor, upper));
    for index in 0..episodes as u64 {
        env.reset(&Episode::new(EpisodeSeed::of(5, index), &options))?;
        for step in 0..STEPS as u64 {
            let mut rng = keyed(5, "factor bounds", [index, step]);
            action_space.sample_into(&mut rng, action.as_slice_mut());
            if env.step(action.as_slice())?.terminated || env.is_truncated() {
                break;
            }
        }
    }
    Ok(())
}

#[test]
fn episodes_go_at_every_bound_of_every_factor() {
    let (episodes, mut wrong, mut bounds) = (rounds(2, 100), Vec::new(), 0);
    for entry in swm::registry().envs() {
        let mut env = entry.make(&EnvConfig::default()).unwrap();
        let factors = env.spec().factors.clone();
        for factor in factors.iter().filter(|factor| !factor.name.contains("color")) {
            for upper in [false, true] {
                bounds += 1;
                match run(env.as_mut(), factor, upper, episodes) {
                    // A constraint ties it to other factors, which the message names.
                    Ok(()) | Err(EnvError::Constraint { .. }) => {}
                    Err(error) => {
                        let bound = at_bound(factor, upper).to_json();
                        wrong.push(format!("{} {} = {bound}: {error}", entry.id, factor.name));
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(bounds > 300, "{bounds} bounds");
}
