//! The single checks. Each says what went wrong in words that lead to the line.

use std::collections::BTreeMap;

use super::bench::{Bench, value_of};
use crate::batch::{Batch, Dtype, FieldKind, Slice, Value};
use crate::env::{EnvConfig, EnvSpec, EnvState, Episode, ResetOptions, VARIATION_PREFIX, check_factor_name};
use crate::registry::{EnvEntry, Registry};
use crate::run::{Rollout, WorldOptions};
use crate::seed::EpisodeSeed;
use crate::world::World;

const STEPS: usize = 40;
/// Longest episode of an expert.
const EXPERT_STEPS: u64 = 200;
const SEEDS: [u64; 3] = [0, 1, 42];

/// The description agrees with itself: unique fields, one episode field per factor with the factor's type and
/// shape, defaults inside their spaces, an action space that can be sampled, settings that are refused when
/// unknown, an entry that describes success where episodes are judged, and no reward at a reset.
///
/// # Errors
///
/// A sentence that says what is not so.
pub fn spec_is_sound(entry: &EnvEntry, config: &EnvConfig) -> Result<(), String> {
    let bench = Bench::new(entry, config)?;
    let spec = bench.env.spec();
    if spec.id != entry.id {
        return Err(format!("the entry is `{}`, the spec says `{}`", entry.id, spec.id));
    }
    for factor in &spec.factors {
        check_factor_name(&factor.name)?;
        let name = format!("{VARIATION_PREFIX}{}", factor.name);
        let index = bench.row.schema().index(&name).ok_or(format!("no field `{name}`"))?;
        let field = &bench.row.schema().fields()[index];
        if field.kind != FieldKind::Episode {
            return Err(format!("`{name}` must be an episode field"));
        }
        if Some(field.dtype) != factor.space.dtype() || field.shape != factor.space.shape() {
            return Err(format!("`{name}` has another type or shape than its factor"));
        }
        let default = default_of(spec, &factor.name)?;
        if !factor.space.contains(&default) {
            return Err(format!("the default of `{}`, {default}, lies outside its space", factor.name));
        }
    }
    let extras = spec.start_extras.iter().chain(spec.goal_extras);
    for column in spec.start_columns.iter().chain(spec.goal_columns).chain(extras) {
        if bench.row.schema().index(column).is_none() {
            return Err(format!("start or goal column `{column}` is not a field"));
        }
    }
    let mut env = entry.make(config).map_err(|e| e.to_string())?;
    let outcome =
        env.reset(&Episode::new(EpisodeSeed::new(0), &ResetOptions::default())).map_err(|e| e.to_string())?;
    if !outcome.reward.is_nan() {
        return Err(format!("a reset returns the reward {}; it has none: NaN", outcome.reward));
    }
    if outcome.success.is_some() && entry.success.is_empty() {
        return Err(
            "it judges success, and the entry does not say what that is: give it a `.success(\"…\")`"
                .to_owned(),
        );
    }
    let mut config = config.clone();
    config.settings.insert("no such setting".to_owned(), true.into());
    match entry.make(&config) {
        Ok(_) => Err("an unknown setting is accepted".to_owned()),
        Err(_) => Ok(()),
    }
}

/// The same seed and actions give the same bits in another instance, also in one that was used before; another
/// seed gives another episode; no observed float is NaN; and observing changes nothing.
///
/// # Errors
///
/// A sentence that says what is not so.
pub fn deterministic(entry: &EnvEntry, config: &EnvConfig) -> Result<(), String> {
    let options = ResetOptions::default();
    let mut used = Bench::new(entry, config)?;
    let mut starts: Vec<Batch> = Vec::new();
    for seed in SEEDS {
        let again = used.trajectory(seed, &options, STEPS)?;
        let fresh = Bench::new(entry, config)?.trajectory(seed, &options, STEPS)?;
        if let Some((step, field)) = first_difference(&fresh, &again) {
            return Err(format!(
                "seed {seed}: `{field}` differs at step {step} between a new and a used instance"
            ));
        }
        for row in &fresh {
            for (index, field) in row.schema().fields().iter().enumerate() {
                if !row.column(index).is_finite() {
                    return Err(format!("seed {seed}: `{}` is not finite", field.name));
                }
            }
        }
        if starts.contains(&fresh[0]) {
            return Err(format!("seed {seed} starts like another seed"));
        }
        used.reset(seed, &options)?;
        for step in 0..STEPS {
            used.step_unobserved(seed, step)?;
        }
        used.env.observe(&mut used.row.rows_mut());
        let once = used.row.clone();
        used.env.observe(&mut used.row.rows_mut());
        if let Some((_, field)) =
            first_difference(&[once, used.row.clone()], &[fresh[STEPS].clone(), fresh[STEPS].clone()])
        {
            return Err(format!("seed {seed}: `{field}` depends on how often it was observed"));
        }
        starts.push(fresh.into_iter().next().expect("the first row is the reset"));
    }
    Ok(())
}

/// A field that is declared [`Field::episode`](crate::Field::episode) keeps the value that it has after the reset: steps and
/// observations do not change it, and `write_episode` writes the same after them.
///
/// # Errors
///
/// A sentence that says what is not so.
pub fn episode_fields_are_constant(entry: &EnvEntry, config: &EnvConfig) -> Result<(), String> {
    let mut bench = Bench::new(entry, config)?;
    bench.reset(0, &ResetOptions::default())?;
    let at_reset = bench.row.clone();
    for step in 0..STEPS {
        bench.step(0, step)?;
        if step + 1 == STEPS {
            bench.env.write_episode(&mut bench.row.rows_mut());
        }
        for (index, field) in at_reset.schema().fields().iter().enumerate() {
            if field.kind == FieldKind::Episode && !same_bits(at_reset.column(index), bench.row.column(index))
            {
                return Err(format!(
                    "`{}` is a field of the episode, and has another value after step {step} than after the reset; declare it by \
                     `Field::step`, or write it in `write_episode` alone",
                    field.name
                ));
            }
        }
    }
    Ok(())
}

/// A snapshot restored into a fresh instance, at any step, continues with the same bits and rewards, images
/// included; and a damaged state is refused.
///
/// # Errors
///
/// A sentence that says what is not so.
pub fn snapshots_are_exact(entry: &EnvEntry, config: &EnvConfig) -> Result<(), String> {
    let everything = ResetOptions { variation: Some(vec!["all".to_owned()]), ..ResetOptions::default() };
    for (seed, options) in [(0, ResetOptions::default()), (1, everything)] {
        let mut bench = Bench::new(entry, config)?;
        bench.reset(seed, &options)?;
        let mut state = EnvState::new();
        for step in 0..STEPS {
            let fork = if step % 9 == 0 {
                bench.env.snapshot(&mut state).map_err(|e| e.to_string())?;
                let mut fork = Bench::new(entry, config)?;
                fork.env.restore(&state).map_err(|e| e.to_string())?;
                let mut again = EnvState::new();
                fork.env.snapshot(&mut again).map_err(|e| e.to_string())?;
                if state != again {
                    return Err(format!("step {step}: the snapshot of a restored state differs from it"));
                }
                fork.env.write_episode(&mut fork.row.rows_mut());
                let outcome = fork.step(seed, step)?;
                Some((fork.outcome(&outcome), fork.env.is_truncated(), fork.row))
            } else {
                None
            };
            let outcome = bench.step(seed, step)?;
            if let Some((forked, is_truncated, forked_row)) = fork {
                for ((name, value), (_, forked)) in bench.outcome(&outcome).into_iter().zip(forked) {
                    if value.to_bits() != forked.to_bits() {
                        return Err(format!("step {step}: {name} {forked} after restoring, {value} without"));
                    }
                }
                if is_truncated != bench.env.is_truncated() {
                    return Err(format!("step {step}: truncated {is_truncated} after restoring"));
                }
                if let Some((_, field)) = first_difference(&[bench.row.clone()], &[forked_row]) {
                    return Err(format!("step {step}: `{field}` differs after restoring (seed {seed})"));
                }
            }
        }
        let cut = EnvState::from_bytes(state.bytes()[..state.bytes().len() / 2].to_vec());
        if bench.env.restore(&cut).is_ok() {
            return Err("half a state is accepted".to_owned());
        }
    }
    Ok(())
}

/// Sampling one more factor moves no other one; factors that are not sampled keep their defaults; unknown names
/// and values outside the bounds are errors that name them.
///
/// # Errors
///
/// A sentence that says what is not so.
pub fn factors_are_independent(entry: &EnvEntry, config: &EnvConfig) -> Result<(), String> {
    let mut bench = Bench::new(entry, config)?;
    let spec = bench.env.spec().clone();
    let all = ResetOptions { variation: Some(vec!["all".to_owned()]), ..ResetOptions::default() };
    for factor in spec.factors.iter().filter(|factor| factor.constraint.is_none()) {
        let alone = ResetOptions { variation: Some(vec![factor.name.clone()]), ..ResetOptions::default() };
        let seed = bench.reset_from(7, &alone)?.0;
        bench.reset(seed, &all)?;
        let together = bench.row.clone();
        bench.reset(seed, &alone)?;
        for other in &spec.factors {
            let field = format!("{VARIATION_PREFIX}{}", other.name);
            let value = value_of(&bench.row, &field);
            let expected = if other.name == factor.name {
                value_of(&together, &field)
            } else {
                default_of(&spec, &other.name)?
            };
            if value != expected {
                return Err(format!(
                    "sampling `{}` alone: `{}` is {value}, not {expected}",
                    factor.name, other.name
                ));
            }
        }
        let (_, high) = factor.space.bounds();
        let outside = Value::vector(&high.iter().map(|h| h + 1.0).collect::<Vec<_>>());
        let values = BTreeMap::from([(factor.name.clone(), outside)]);
        let options = ResetOptions { variation_values: values, ..ResetOptions::default() };
        match bench.reset(seed, &options) {
            Err(message) if message.contains(&factor.name) => {}
            other => return Err(format!("a value outside the bounds of `{}` gives {other:?}", factor.name)),
        }
    }
    let unknown = ResetOptions { variation: Some(vec!["no.such".to_owned()]), ..ResetOptions::default() };
    match bench.reset(7, &unknown) {
        Err(message) if message.contains("no.such") => Ok(()),
        other => Err(format!("an unknown factor name gives {other:?}")),
    }
}

/// Every factor changes what is seen or what happens: some step field (pixels included) or the goal image, in
/// one of two dozen samples, in the context that its description names; under random actions or, where these do not show
/// it (a limit of speed that they do not reach), in the length or return of an episode of the entry's own policy `expert`.
/// Those of `only_in_images` change nothing here, where no images are rendered.
///
/// # Errors
///
/// A sentence that names the factors without effect, or one that acts where it should not.
pub fn every_factor_acts(
    entry: &EnvEntry,
    config: &EnvConfig,
    only_in_images: &[&str],
) -> Result<(), String> {
    let mut bench = Bench::new(entry, config)?;
    let spec = bench.env.spec().clone();
    let nothing_sampled = || ResetOptions { variation: Some(Vec::new()), ..ResetOptions::default() };
    let mut idle = Vec::new();
    for factor in &spec.factors {
        let mut context = BTreeMap::new();
        for (name, json) in &factor.shows_with {
            context.insert(name.clone(), Value::from_json(name, json).map_err(|e| e.to_string())?);
        }
        let base = ResetOptions { variation_values: context.clone(), ..nothing_sampled() };
        let plain = bench.trajectory(3, &base, STEPS)?;
        let mut acts = false;
        // Nearby values may look the same by rounding, so there are many samples; the first usually suffices.
        let samples = SEEDS.into_iter().chain((1..20).map(|number| 100 * number));
        let varied = |bench: &mut Bench, seed: u64| -> Result<ResetOptions, String> {
            let alone = ResetOptions { variation: Some(vec![factor.name.clone()]), ..base.clone() };
            bench.reset_from(seed, &alone)?;
            let sampled = value_of(&bench.row, &format!("{VARIATION_PREFIX}{}", factor.name));
            let mut values = context.clone();
            values.insert(factor.name.clone(), sampled);
            Ok(ResetOptions { variation_values: values, ..nothing_sampled() })
        };
        for seed in samples.clone() {
            let varied = varied(&mut bench, seed)?;
            acts = differs_visibly(&plain, &bench.trajectory(3, &varied, STEPS)?);
            if acts {
                break;
            }
        }
        let is_listed = only_in_images.contains(&factor.name.as_str());
        if !acts && !is_listed && entry.policies.iter().any(|policy| policy.name == "expert") {
            let plain = expert_episode(entry, config, &base)?;
            for seed in samples {
                let varied = varied(&mut bench, seed)?;
                acts = expert_episode(entry, config, &varied)? != plain;
                if acts {
                    break;
                }
            }
        }
        if acts && is_listed {
            return Err(format!("`{}` acts without images", factor.name));
        }
        if !acts && !is_listed {
            idle.push(factor.name.as_str());
        }
    }
    if idle.is_empty() { Ok(()) } else { Err(format!("without any effect: {}", idle.join(", "))) }
}

/// Length and return of an episode of the entry's policy `expert`, without images.
fn expert_episode(
    entry: &EnvEntry,
    config: &EnvConfig,
    options: &ResetOptions,
) -> Result<(Vec<u64>, Vec<f64>), String> {
    let config = EnvConfig { image: None, ..config.clone() };
    let world = WorldOptions::new(1).env(config).max_episode_steps(EXPERT_STEPS).threads(1);
    let mut world = World::new(entry, world).map_err(|e| e.to_string())?;
    let expert = Registry::new().policy("expert", &world).map_err(|e| e.to_string())?;
    world.set_policy(expert).map_err(|e| e.to_string())?;
    let rollout = Rollout::new(0..1).seed(3).options(options.clone());
    let evaluation = world.evaluate(&rollout).map_err(|e| e.to_string())?;
    Ok((evaluation.episode_lengths, evaluation.episode_returns))
}

fn differs_visibly(a: &[Batch], b: &[Batch]) -> bool {
    a.iter().zip(b).any(|(a, b)| {
        a.schema().fields().iter().enumerate().any(|(index, field)| {
            (field.kind == FieldKind::Step || field.name == "goal")
                && !same_bits(a.column(index), b.column(index))
        })
    })
}

/// The first step and field in which two trajectories differ.
fn first_difference(a: &[Batch], b: &[Batch]) -> Option<(usize, String)> {
    a.iter().zip(b).enumerate().find_map(|(step, (a, b))| {
        let fields = a.schema().fields().iter().enumerate();
        let mut differing = fields.filter(|(index, _)| !same_bits(a.column(*index), b.column(*index)));
        differing.next().map(|(_, field)| (step, field.name.clone()))
    })
}

pub(super) fn same_bits(a: Slice<'_>, b: Slice<'_>) -> bool {
    match (a, b) {
        (Slice::F32(a), Slice::F32(b)) => a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits()),
        (Slice::F64(a), Slice::F64(b)) => a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits()),
        (a, b) => a == b,
    }
}

fn default_of(spec: &EnvSpec, name: &str) -> Result<Value, String> {
    let factor = spec.factors.iter().find(|factor| factor.name == name).ok_or("no such factor")?;
    let dtype = factor.space.dtype().unwrap_or(Dtype::F64);
    Value::from_json(name, &factor.default)
        .and_then(|value| value.cast(name, dtype, &factor.space.shape()))
        .map_err(|e| e.to_string())
}
