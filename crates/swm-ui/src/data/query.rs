//! Which episodes pass a filter. What a filter needs is read when it is first asked for, and kept.

use std::collections::BTreeMap;
use std::sync::PoisonError;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use swm_core::env::VARIATION_PREFIX;
use swm_core::{Column, FieldKind};
use swm_data::Steps;

use super::opened::Opened;
use crate::error::Refusal;

/// Bounds, both included. All are optional.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Filter {
    success: Option<Text<bool>>,
    min_length: Option<Text<usize>>,
    max_length: Option<Text<usize>>,
    min_return: Option<Text<f64>>,
    max_return: Option<Text<f64>>,
    /// A column that is constant in an episode: `variation.block.scale`; `variation.block.color[0]` its first value.
    factor: Option<String>,
    min_factor: Option<Text<f64>>,
    max_factor: Option<Text<f64>>,
    /// `length`, `return` or `factor`, largest first with a minus before it.
    sort: Option<String>,
}

/// A value in a query, which is text there: `serde_urlencoded` cannot read others in flattened structs.
#[derive(Clone, Copy, Debug)]
struct Text<T>(T);

impl<'de, T: std::str::FromStr> Deserialize<'de> for Text<T> {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let text = String::deserialize(from)?;
        text.parse()
            .map(Self)
            .map_err(|_| serde::de::Error::custom(format!("`{text}` is not what is asked for")))
    }
}

/// What is known of episodes.
#[derive(Default)]
pub(crate) struct Summaries {
    outcomes: BTreeMap<usize, Outcome>,
    factors: BTreeMap<String, BTreeMap<usize, f64>>,
}

/// How an episode went, as far as its columns say.
#[derive(Clone, Copy, Debug, Serialize)]
struct Outcome {
    total_reward: Option<f64>,
    success: Option<bool>,
}

/// One episode of a list.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    episode: usize,
    length: usize,
    #[serde(flatten)]
    outcome: Outcome,
}

/// Reading for one request ends after this; the page asks again for the rest.
const BUDGET: Duration = Duration::from_millis(400);

/// The episodes that pass, in order, and of how many episodes all is known that the filter needs: others do not pass yet.
pub(super) fn matching(opened: &Opened, filter: &Filter) -> Result<(Vec<usize>, usize), Refusal> {
    let lengths = &opened.info().lengths;
    let until = Instant::now() + BUDGET;
    let sort = filter.sort.as_deref().unwrap_or_default();
    let needs_outcome = filter.success.is_some()
        || filter.min_return.is_some()
        || filter.max_return.is_some()
        || sort.ends_with("return");
    let factor = filter.factor.as_deref().filter(|name| !name.is_empty());
    let mut keyed: Vec<(f64, usize)> = Vec::new();
    let mut known = 0;
    for (episode, &length) in lengths.iter().enumerate() {
        let fits_length = filter.min_length.is_none_or(|min| length >= min.0)
            && filter.max_length.is_none_or(|max| length <= max.0);
        if !fits_length {
            known += 1;
            continue;
        }
        let is_late = (needs_outcome || factor.is_some()) && Instant::now() > until;
        let outcome = match needs_outcome {
            true if is_late => cached_outcome(opened, episode),
            true => Some(outcome(opened, episode)?),
            false => None,
        };
        let value = match factor {
            Some(name) if is_late => cached_factor(opened, name, episode),
            Some(name) => Some(factor_value(opened, name, episode)?),
            None => None,
        };
        if (needs_outcome && outcome.is_none()) || (factor.is_some() && value.is_none()) {
            continue;
        }
        known += 1;
        let total = outcome.and_then(|outcome| outcome.total_reward).unwrap_or(f64::NAN);
        let passes =
            filter.success.is_none_or(|wanted| outcome.and_then(|outcome| outcome.success) == Some(wanted.0))
                && filter.min_return.is_none_or(|min| total >= min.0)
                && filter.max_return.is_none_or(|max| total <= max.0)
                && filter.min_factor.is_none_or(|min| value.is_none_or(|value| value >= min.0))
                && filter.max_factor.is_none_or(|max| value.is_none_or(|value| value <= max.0));
        if passes {
            let key = match sort.trim_start_matches('-') {
                "length" => length as f64,
                "return" => total,
                "factor" => value.unwrap_or(f64::NAN),
                _ => episode as f64,
            };
            keyed.push((if sort.starts_with('-') { -key } else { key }, episode));
        }
    }
    if !sort.is_empty() {
        keyed.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    }
    Ok((keyed.into_iter().map(|(_, episode)| episode).collect(), known))
}

/// One episode for a list.
pub(super) fn summary(opened: &Opened, episode: usize) -> Result<Summary, Refusal> {
    Ok(Summary { episode, length: opened.info().lengths[episode], outcome: outcome(opened, episode)? })
}

fn cached_outcome(opened: &Opened, episode: usize) -> Option<Outcome> {
    opened.summaries.lock().unwrap_or_else(PoisonError::into_inner).outcomes.get(&episode).copied()
}

fn outcome(opened: &Opened, episode: usize) -> Result<Outcome, Refusal> {
    if let Some(known) = cached_outcome(opened, episode) {
        return Ok(known);
    }
    let rewards = numbers(opened, &["reward", "next.reward"], episode)?;
    let total_reward = rewards.map(|rewards| rewards.iter().filter(|reward| !reward.is_nan()).sum());
    let flags = numbers(opened, &["success", "next.success", "is_success", "terminated"], episode)?;
    let success = flags.map(|flags| flags.iter().any(|&flag| flag > 0.0));
    let outcome = Outcome { total_reward, success };
    opened.summaries.lock().unwrap_or_else(PoisonError::into_inner).outcomes.insert(episode, outcome);
    Ok(outcome)
}

fn cached_factor(opened: &Opened, name: &str, episode: usize) -> Option<f64> {
    let summaries = opened.summaries.lock().unwrap_or_else(PoisonError::into_inner);
    summaries.factors.get(name)?.get(&episode).copied()
}

fn factor_value(opened: &Opened, name: &str, episode: usize) -> Result<f64, Refusal> {
    if let Some(known) = cached_factor(opened, name, episode) {
        return Ok(known);
    }
    let (column, element) = match name.strip_suffix(']').and_then(|name| name.split_once('[')) {
        Some((column, element)) => {
            (column, element.parse::<usize>().map_err(|_| Refusal::bad(format!("`{name}` names no value")))?)
        }
        None => (name, 0),
    };
    let schema = &opened.info().schema;
    let index = schema.require(column)?;
    let field = &schema.fields()[index];
    let is_constant = field.kind == FieldKind::Episode || column.starts_with(VARIATION_PREFIX);
    if !is_constant || element >= field.dim() {
        return Err(Refusal::bad(format!("`{name}` is no value that is constant in an episode")));
    }
    let mut values = Column::zeros(field.dtype, field.dim());
    let first = Steps { first: 0, count: 1, stride: 1 };
    opened.dataset().read_column(index, episode, first, values.as_slice_mut())?;
    let value = values.as_slice().as_f64(element).unwrap_or(f64::NAN);
    let mut summaries = opened.summaries.lock().unwrap_or_else(PoisonError::into_inner);
    summaries.factors.entry(name.to_owned()).or_default().insert(episode, value);
    Ok(value)
}

/// The first of these columns that is there and has one value per step.
fn numbers(opened: &Opened, names: &[&str], episode: usize) -> Result<Option<Vec<f64>>, Refusal> {
    let info = opened.info();
    let index =
        names.iter().filter_map(|name| info.schema.index(name)).find(|&index| info.schema.dim(index) == 1);
    let Some(index) = index else { return Ok(None) };
    let count = info.lengths[episode];
    let mut values = Column::zeros(info.field(index).dtype, count);
    let all = Steps { first: 0, count, stride: 1 };
    opened.dataset().read_column(index, episode, all, values.as_slice_mut())?;
    let values = values.as_slice();
    Ok(Some((0..count).map(|row| values.as_f64(row).unwrap_or(f64::NAN)).collect()))
}
