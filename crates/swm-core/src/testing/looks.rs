//! Looks: visual factors change images and nothing else, and images are those of an episode with such factors.

use std::collections::BTreeMap;

use super::bench::{Bench, value_of};
use crate::batch::{Batch, Dtype, Value};
use crate::env::{EnvConfig, EnvState, FactorSpec, ResetOptions, VARIATION_PREFIX};
use crate::registry::EnvEntry;

const STEPS: usize = 12;
const SEED: u64 = 5;

/// In another look, states, columns and snapshots are those of the episode, and images those of an episode with these values of
/// factors; the look outlasts `reset` and `restore` and ends with an empty one; factors that are not visual are refused.
///
/// # Errors
///
/// A sentence that says what is not so.
pub fn looks_change_images_alone(entry: &EnvEntry, config: &EnvConfig) -> Result<(), String> {
    let mut bench = Bench::new(entry, config)?;
    let factors = bench.env.spec().factors.clone();
    for factor in &factors {
        let name = &factor.name;
        let alone = ResetOptions { variation: Some(vec![name.clone()]), ..ResetOptions::default() };
        bench.reset_from(SEED, &alone)?;
        let value = value_of(&bench.row, &format!("{VARIATION_PREFIX}{name}"));
        let look = BTreeMap::from([(name.clone(), value)]);
        if factor.visual {
            check(entry, config, factor, &look)?;
        } else if bench.env.dress(&look).is_ok() {
            return Err(format!("`{name}` is not visual, and a look with it is accepted"));
        }
    }
    let unknown = BTreeMap::from([("no.such".to_owned(), Value::scalar(1.0))]);
    match bench.env.dress(&unknown) {
        Err(_) => Ok(()),
        Ok(()) => Err("a look with an unknown factor is accepted".to_owned()),
    }
}

fn check(
    entry: &EnvEntry,
    config: &EnvConfig,
    factor: &FactorSpec,
    look: &BTreeMap<String, Value>,
) -> Result<(), String> {
    let name = &factor.name;
    let mut context = BTreeMap::new();
    for (other, json) in &factor.shows_with {
        context.insert(other.clone(), Value::from_json(other, json).map_err(|error| error.to_string())?);
    }
    let plain = ResetOptions { variation_values: context.clone(), ..ResetOptions::default() };
    context.extend(look.clone());
    let varied = ResetOptions { variation_values: context, ..ResetOptions::default() };
    let fresh = || Bench::new(entry, config);
    let usual = fresh()?.trajectory(SEED, &plain, STEPS)?;
    let wanted = fresh()?.trajectory(SEED, &varied, STEPS)?;
    let mut bench = fresh()?;
    bench.env.dress(look).map_err(|error| format!("the look `{name}`: {error}"))?;
    let dressed = bench.trajectory(SEED, &plain, STEPS)?;
    let snapshot = |bench: &Bench| {
        let mut state = EnvState::new();
        bench.env.snapshot(&mut state).map_err(|error| error.to_string()).map(|()| state)
    };
    let mut bare = fresh()?;
    bare.trajectory(SEED, &plain, STEPS)?;
    let state = snapshot(&bare)?;
    if snapshot(&bench)?.bytes() != state.bytes() {
        return Err(format!("a look with another `{name}` is in the snapshot"));
    }
    for (step, dressed) in dressed.iter().enumerate() {
        compare(dressed, [&usual[step], &wanted[step]])
            .map_err(|what| format!("a look with another `{name}`: {what} at step {step}"))?;
    }
    // In another instance, whose look was set before.
    let mut other = fresh()?;
    other.env.dress(look).map_err(|error| error.to_string())?;
    other.env.restore(&state).map_err(|error| error.to_string())?;
    let observe = |bench: &mut Bench| {
        bench.env.write_episode(&mut bench.row.rows_mut());
        bench.env.observe(&mut bench.row.rows_mut());
    };
    observe(&mut other);
    compare(&other.row, [&usual[STEPS], &wanted[STEPS]])
        .map_err(|what| format!("a look with another `{name}`, then `restore`: {what}"))?;
    other.env.dress(&BTreeMap::new()).map_err(|error| error.to_string())?;
    observe(&mut other);
    compare(&other.row, [&usual[STEPS]; 2])
        .map_err(|what| format!("after the look with another `{name}` ended: {what}"))
}

/// Compares a row with what its columns shall be, and its images.
fn compare(found: &Batch, [columns, images]: [&Batch; 2]) -> Result<(), String> {
    for (index, field) in found.schema().fields().iter().enumerate() {
        let is_image = field.dtype == Dtype::U8 && field.shape.len() == 3;
        let (wanted, what) = if is_image {
            (images, "is not the image of an episode with this value")
        } else {
            (columns, "is not that of the episode")
        };
        if !super::checks::same_bits(found.column(index), wanted.column(index)) {
            return Err(format!("`{}` {what}", field.name));
        }
    }
    Ok(())
}
