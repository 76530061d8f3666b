//! Robustness: the same pairs under changed factors of variation, one factor alone, each group, all together, beside the
//! unchanged environment.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use swm_core::dataset::selects;
use swm_core::env::FactorSpec;
use swm_core::error::BoxError;
use swm_core::evaluate::{EpisodeResult, PairedTest, Summary};
use swm_core::{
    Env, EnvConfig, EnvEntry, EnvError, Episode, EpisodeSeed, Manifest, Registry, ResetOptions, Space, Value,
};

use super::receipt::Code;
use super::run::{Candidate, RunOptions, plan_steps, run_pairs};

/// The version of [`Sweep`] that is written and read.
pub const SWEEP_VERSION: u32 = 1;

/// Which values factors get.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Values {
    /// Drawn for every episode, by its seed.
    Sampled,
    /// The smallest, then the largest.
    Extremes,
    /// So many, evenly from the smallest to the largest.
    Grid(usize),
}

/// A policy under changed factors.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sweep {
    /// [`SWEEP_VERSION`].
    pub sweep: u32,
    /// Environment id.
    pub env: String,
    /// Hash of the manifest that is changed.
    pub manifest_hash: String,
    /// Its tier.
    pub tier: String,
    /// The policy.
    pub candidate: Candidate,
    /// The policy in its own words.
    pub policy: String,
    /// Which values factors get.
    pub values: Values,
    /// What made it.
    pub code: Code,
    /// The unchanged environment first, then factors in the order of their table, groups, all.
    pub cells: Vec<Cell>,
}

/// What is changed in a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scope {
    /// Nothing.
    Unchanged,
    /// One factor.
    Factor,
    /// All factors of a group.
    Group,
    /// All factors.
    All,
}

/// One evaluation of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// What is changed: a factor's or group's name, `all`, or `unchanged`.
    pub name: String,
    /// Which of these it is.
    pub scope: Scope,
    /// The values in a word: `sampled`, `lowest`, `highest`, or a share of the range.
    pub value: String,
    /// What it came to; nothing if the values cannot be.
    pub summary: Option<Summary>,
    /// This cell against the unchanged environment, pair by pair.
    pub test: Option<PairedTest>,
    /// Why it could not run, or that nothing came of the change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Success, pair by pair.
    pub successes: Vec<bool>,
}

/// A change to be evaluated.
#[derive(Clone, Debug)]
pub struct Change {
    name: String,
    scope: Scope,
    value: String,
    /// A share of every factor's range; drawn without one.
    share: Option<f64>,
}

/// The changes of a sweep over `factors` (names, groups, or `all`), in order; unknown names are refused.
pub fn changes(factors: &[FactorSpec], asked: &[String], values: Values) -> Result<Vec<Change>, String> {
    let all: Vec<&str> = factors.iter().map(|factor| factor.name.as_str()).collect();
    if let Some(unknown) = asked.iter().find(|asked| !all.iter().any(|name| selects(asked, name))) {
        let near = swm_core::error::nearest(unknown, all.iter().copied());
        let meant = swm_core::error::did_you_mean(near.as_deref());
        return Err(format!("unknown factor `{unknown}`{meant}; `swm fovs` lists them"));
    }
    let wanted: Vec<&str> =
        all.iter().copied().filter(|name| asked.iter().any(|asked| selects(asked, name))).collect();
    let groups: BTreeSet<&str> = wanted
        .iter()
        .filter_map(|name| name.split_once('.').map(|(group, _)| group))
        .filter(|group| wanted.iter().filter(|name| selects(group, name)).count() > 1)
        .collect();
    let singles = wanted.iter().map(|&name| (name, Scope::Factor));
    let groups = groups.into_iter().map(|name| (name, Scope::Group));
    let whole = (wanted.len() == all.len() && all.len() > 1).then_some(("all", Scope::All));
    let shares: Vec<(String, Option<f64>)> = match values {
        Values::Sampled => vec![("sampled".to_owned(), None)],
        Values::Extremes => vec![("lowest".to_owned(), Some(0.0)), ("highest".to_owned(), Some(1.0))],
        Values::Grid(count) if count >= 2 => (0..count)
            .map(|index| index as f64 / (count - 1) as f64)
            .map(|share| (format!("{:.0} %", 100.0 * share), Some(share)))
            .collect(),
        Values::Grid(count) => return Err(format!("a grid of {count} value(s); use 2 or more")),
    };
    let scopes = singles.chain(groups).chain(whole);
    Ok(scopes
        .flat_map(|(name, scope)| {
            shares.iter().map(move |(value, share)| Change {
                name: name.to_owned(),
                scope,
                value: value.clone(),
                share: *share,
            })
        })
        .collect())
}

/// Evaluates the unchanged environment and every change. `each` is called after every cell with its number and their count.
pub fn sweep(
    registry: &Registry,
    manifest: &Manifest,
    candidate: &Candidate,
    asked: &[String],
    values: Values,
    options: RunOptions,
    mut each: impl FnMut(usize, usize, &Cell),
) -> Result<Sweep, BoxError> {
    let entry = registry.env(&manifest.env)?;
    let mut trial = Trial::new(entry, manifest)?;
    let changes = changes(&trial.factors, asked, values)?;
    let count = changes.len() + 1;
    let policy = candidate.make(registry, entry, manifest)?.describe();
    let (none, steps) = (BTreeMap::new(), plan_steps(&candidate.policy));
    let run = |resets: &[ResetOptions], checked: bool| {
        run_pairs(registry, manifest, resets, candidate, steps, options, &none, checked, |_, _| Ok(()))
    };
    let base_resets = manifest.resets()?;
    let base = run(&base_resets, true)?;
    let successes = |episodes: &[EpisodeResult]| episodes.iter().map(|e| e.success).collect::<Vec<bool>>();
    let unchanged = successes(&base);
    let mut cells = vec![Cell {
        name: "unchanged".to_owned(),
        scope: Scope::Unchanged,
        value: String::new(),
        summary: Some(Summary::of(&base)),
        test: None,
        note: None,
        successes: unchanged.clone(),
    }];
    each(0, count, &cells[0]);
    for change in changes {
        let mut cell = Cell {
            name: change.name.clone(),
            scope: change.scope,
            value: change.value.clone(),
            summary: None,
            test: None,
            note: None,
            successes: Vec::new(),
        };
        let resets: Vec<ResetOptions> =
            base_resets.iter().map(|reset| change.apply(&trial.factors, reset)).collect();
        match trial.refusal(manifest, &resets)? {
            Some(reason) => cell.note = Some(reason),
            None => {
                let episodes = run(&resets, false)?;
                let same = |(a, b): (&EpisodeResult, &EpisodeResult)| {
                    (a.success, a.steps, &a.decisions, a.final_cost)
                        == (b.success, b.steps, &b.decisions, b.final_cost)
                };
                if base.iter().zip(&episodes).all(same) {
                    cell.note = Some("every episode goes as without the change".to_owned());
                }
                cell.successes = successes(&episodes);
                cell.summary = Some(Summary::of(&episodes));
                cell.test = Some(PairedTest::of(&cell.successes, &unchanged));
            }
        }
        cells.push(cell);
        each(cells.len() - 1, count, &cells[cells.len() - 1]);
    }
    Ok(Sweep {
        sweep: SWEEP_VERSION,
        env: manifest.env.clone(),
        manifest_hash: manifest.hash(),
        tier: manifest.tier.name().to_owned(),
        candidate: candidate.clone(),
        policy,
        values,
        code: Code::this(),
        cells,
    })
}

/// An environment that changes are tried in before they are evaluated.
struct Trial {
    env: Box<dyn Env>,
    factors: Vec<FactorSpec>,
}

impl Trial {
    fn new(entry: &EnvEntry, manifest: &Manifest) -> Result<Self, BoxError> {
        let env = (entry.make)(&EnvConfig { image: None, settings: manifest.settings.clone() })?;
        Ok(Self { factors: env.spec().factors.clone(), env })
    }

    /// Why the environment does not take a change, if it does not.
    fn refusal(&mut self, manifest: &Manifest, resets: &[ResetOptions]) -> Result<Option<String>, BoxError> {
        for (pair, options) in manifest.pairs.iter().zip(resets) {
            let seed = EpisodeSeed::new(pair.seed as u64);
            match self.env.reset(&Episode { seed, options }) {
                Ok(_) => {}
                Err(error @ (EnvError::Constraint { .. } | EnvError::Reset { .. })) => {
                    return Ok(Some(format!("cannot be: {error}")));
                }
                Err(error) => return Err(error.into()),
            }
        }
        Ok(None)
    }
}

impl Change {
    /// The reset with the change on top.
    fn apply(&self, factors: &[FactorSpec], reset: &ResetOptions) -> ResetOptions {
        let mut changed = reset.clone();
        let selected = |factor: &&FactorSpec| selects(&self.name, &factor.name);
        for factor in factors.iter().filter(selected) {
            changed.variation_values.remove(&factor.name);
            if let Some(value) = self.share.and_then(|share| at_share(&factor.space, share)) {
                changed.variation_values.insert(factor.name.clone(), value);
            }
        }
        if self.share.is_none() {
            let drawn = changed.variation.get_or_insert_with(|| {
                factors.iter().filter(|factor| factor.drawn_by_default).map(|f| f.name.clone()).collect()
            });
            drawn.push(self.name.clone());
        }
        changed
    }
}

/// The value at a share of the way from the smallest to the largest; none where the range is not finite.
fn at_share(space: &Space, share: f64) -> Option<Value> {
    let between = |low: f64, high: f64| low + (high - low) * share;
    let (low, high) = match space {
        Space::Dict { .. } => return None,
        space => space.bounds(),
    };
    let whole = !matches!(space, Space::Box { .. });
    let numbers: Vec<f64> = low
        .iter()
        .zip(&high)
        .map(|(&low, &high)| if whole { between(low, high).round() } else { between(low, high) })
        .collect();
    let dtype = space.dtype()?;
    let finite = numbers.iter().all(|number| number.is_finite());
    finite.then(|| Value::vector(&numbers).cast("factor", dtype, &space.shape()).ok())?
}

impl Sweep {
    /// One line per cell, for spreadsheets.
    pub fn csv(&self) -> String {
        let mut csv = "scope,name,value,episodes,successes,success_rate,low,high,difference,difference_low,difference_high,p_value,note\n".to_owned();
        for cell in &self.cells {
            let scope = serde_json::to_value(cell.scope).unwrap_or_default();
            let scope = scope.as_str().unwrap_or_default().to_owned();
            let number = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
            let (summary, test) = (cell.summary.as_ref(), cell.test.as_ref());
            let _ = writeln!(
                csv,
                "{scope},{},{},{},{},{},{},{},{},{},{},{},{}",
                cell.name,
                cell.value,
                summary.map_or(0, |summary| summary.episodes),
                summary.map_or(0, |summary| summary.successes),
                number(summary.map(|summary| summary.success_rate)),
                number(summary.map(|summary| summary.ci95[0])),
                number(summary.map(|summary| summary.ci95[1])),
                number(test.map(|test| test.difference)),
                number(test.map(|test| test.interval95[0])),
                number(test.map(|test| test.interval95[1])),
                number(test.map(|test| test.p_value)),
                quoted(cell.note.as_deref().unwrap_or_default()),
            );
        }
        csv
    }
}

/// A text as a cell of CSV (RFC 4180).
fn quoted(text: &str) -> String {
    if text.is_empty() {
        String::new()
    } else {
        format!("\"{}\"", text.replace('"', "\"\"").replace('\n', " "))
    }
}

/// Whether JSON is a sweep rather than a receipt.
pub fn is_sweep(json: &Json) -> bool {
    json.get("sweep").and_then(Json::as_u64).is_some()
}

#[cfg(test)]
mod tests {
    use swm_core::Dtype;

    use super::*;

    fn factor(name: &str, space: Space, drawn_by_default: bool) -> FactorSpec {
        FactorSpec {
            name: name.to_owned(),
            doc: String::new(),
            default: Json::Null,
            space,
            drawn_by_default,
            constraint: None,
            shows_with: Vec::new(),
        }
    }

    fn factors() -> Vec<FactorSpec> {
        let box_ = || Space::uniform_box(Dtype::F64, &[2], -1.0, 3.0);
        vec![
            factor("block.color", Space::Rgb, false),
            factor("block.start", box_(), true),
            factor("agent.shape", Space::Discrete { n: 4, start: 1 }, false),
        ]
    }

    #[test]
    fn factors_come_alone_in_groups_and_together() {
        let of = |asked: &[&str], values| {
            let asked: Vec<String> = asked.iter().map(|&name| name.to_owned()).collect();
            changes(&factors(), &asked, values).map(|changes| {
                changes.iter().map(|change| format!("{} {}", change.name, change.value)).collect::<Vec<_>>()
            })
        };
        assert_eq!(
            of(&["all"], Values::Sampled).unwrap(),
            [
                "block.color sampled",
                "block.start sampled",
                "agent.shape sampled",
                "block sampled",
                "all sampled"
            ]
        );
        assert_eq!(of(&["agent"], Values::Extremes).unwrap(), ["agent.shape lowest", "agent.shape highest"]);
        assert_eq!(
            of(&["agent.shape"], Values::Grid(3)).unwrap(),
            ["agent.shape 0 %", "agent.shape 50 %", "agent.shape 100 %"]
        );
        assert!(of(&["agent.shap"], Values::Sampled).unwrap_err().contains("did you mean `agent.shape`?"));
        assert!(of(&["all"], Values::Grid(1)).unwrap_err().contains("2 or more"));
    }

    #[test]
    fn changes_draw_or_set_what_they_name_and_nothing_else() {
        let (factors, plain) =
            (factors(), ResetOptions::default().fix("block.color", Value::vector(&[9u8; 3])));
        let change =
            |share| Change { name: "block".to_owned(), scope: Scope::Group, value: String::new(), share };
        let drawn = change(None).apply(&factors, &plain);
        assert_eq!(
            drawn.variation.unwrap(),
            ["block.start", "block"],
            "what is drawn by default stays drawn"
        );
        assert!(drawn.variation_values.is_empty(), "what is drawn is not set");
        let set = change(Some(1.0)).apply(&factors, &plain);
        assert_eq!(set.variation, None);
        assert_eq!(set.variation_values["block.color"], Value::vector(&[255u8; 3]));
        assert_eq!(set.variation_values["block.start"], Value::vector(&[3.0, 3.0]));
        assert_eq!(at_share(&Space::Discrete { n: 4, start: 1 }, 0.5), Some(Value::scalar(3i64)));
        let open = Space::uniform_box(Dtype::F64, &[], 0.0, f64::INFINITY);
        assert_eq!(at_share(&open, 1.0), None);
    }
}
