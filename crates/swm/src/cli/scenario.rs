//! `--vary` and `--set`: which factors of variation are sampled, which are set.

use std::collections::BTreeMap;

use clap::Args;
use swm_core::error::{did_you_mean, nearest};
use swm_core::{FactorSpec, ResetOptions, Value};
use swm_fov::color_values;

use super::args::assignment;
use super::{Failure, Output, usage};

/// Which factors vary, which are set.
#[derive(Args, Clone)]
pub(super) struct ScenarioArgs {
    /// Factors to sample per episode: names, groups, `*.color` (in every group), `default`, `all` or `none`, separated by commas.
    /// `+NAME` samples it in addition to the environment's default factors, mostly starts and goals. Without --vary: the default
    /// factors.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    vary: Option<Vec<String>>,
    /// A factor to set, `NAME=VALUE` (numbers separated by commas); may be repeated. Colors also as `#ff0000` or `red`, choices
    /// by name, as in `block.shape=T`.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
}

impl ScenarioArgs {
    /// The reset of every episode in an environment with these factors. Says which default factors are no longer sampled.
    pub(super) fn options(&self, factors: &[FactorSpec], output: &Output) -> Result<ResetOptions, Failure> {
        let variation = self.variation(true)?;
        let values = self.values(factors, output)?;
        for name in values
            .keys()
            .filter(|name| self.vary.iter().flatten().any(|asked| asked.trim_start_matches('+') == **name))
        {
            output.note(format!("note: --vary {name} samples nothing, since --set {name} sets it"));
        }
        if let Some(asked) = &variation
            && !asked.is_empty()
        {
            let is_known = |asked: &String| factors.iter().any(|factor| factor.is_selected_by(asked));
            let left: Vec<&str> = factors
                .iter()
                .filter(|factor| factor.sampled_by_default && !values.contains_key(&factor.name))
                .filter(|factor| !asked.iter().any(|asked| factor.is_selected_by(asked)))
                .map(|factor| factor.name.as_str())
                .collect();
            // A name that does not exist is refused in the words of the environment.
            if !left.is_empty() && asked.iter().all(is_known) {
                output.note(format!(
                    "note: --vary samples only what it names; {} keep their defaults in every episode (`--vary +{}` samples them, too)",
                    left.join(", "),
                    self.vary.iter().flatten().map(|name| name.trim()).collect::<Vec<_>>().join(","),
                ));
            }
        }
        Ok(ResetOptions { variation, variation_values: values, ..ResetOptions::default() })
    }

    /// As [`ScenarioArgs::options`], where starts and goals are recorded: without `--vary`, nothing is sampled.
    pub(super) fn recorded_options(
        &self,
        factors: &[FactorSpec],
        output: &Output,
    ) -> Result<ResetOptions, Failure> {
        let (variation, variation_values) = (self.variation(false)?, self.values(factors, output)?);
        Ok(ResetOptions { variation, variation_values, ..ResetOptions::default() })
    }

    /// The names of `--vary`; `none` samples nothing. With `samples_defaults`, the default factors are what is sampled without
    /// `--vary`, and `+NAME` adds to them; else nothing is, as where starts are recorded, and `+NAME` is `NAME`.
    fn variation(&self, samples_defaults: bool) -> Result<Option<Vec<String>>, Failure> {
        let Some(asked) = &self.vary else { return Ok(None) };
        let mut names: Vec<String> = Vec::new();
        for name in asked.iter().map(|name| name.trim()).filter(|name| !name.is_empty()) {
            let added = name.strip_prefix('+').map(str::trim);
            if added.is_some() && samples_defaults && !names.iter().any(|name| name == "default") {
                names.insert(0, "default".to_owned());
            }
            names.push(added.unwrap_or(name).to_owned());
        }
        match names.iter().any(|name| name == "none") {
            false => Ok(Some(names)),
            true if names.len() == 1 => Ok(Some(Vec::new())),
            true => Err(usage("--vary: `none` stands alone, or is left out")),
        }
    }

    fn values(&self, factors: &[FactorSpec], output: &Output) -> Result<BTreeMap<String, Value>, Failure> {
        factor_values(&self.set, factors, output)
    }
}

/// Reads `--set NAME=VALUE` options. What the environment cannot take, it refuses itself.
pub(super) fn factor_values(
    options: &[String],
    factors: &[FactorSpec],
    output: &Output,
) -> Result<BTreeMap<String, Value>, Failure> {
    let mut values = BTreeMap::new();
    for option in options {
        let (name, text) = assignment(option, "--set")?;
        let inner = text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(text);
        let factor = factors.iter().find(|factor| factor.name == name);
        let color = factor.map(|factor| color_values(&factor.space, name, inner)).transpose();
        let color = color.map_err(|reason| usage(format!("--set {option}: {reason}")))?.flatten();
        let numbers = match color {
            Some(color) => {
                if let Some(read_as) = color.read_as {
                    output.note(format!("note: --set {option}: {read_as}"));
                }
                color.values
            }
            None => factor
                .and_then(|factor| factor.choice(inner))
                .map(|choice| vec![choice as f64])
                .or_else(|| numbers(inner))
                .ok_or_else(|| usage(not_numbers(option, name, text, factors)))?,
        };
        values.insert(name.to_owned(), Value::vector(&numbers));
    }
    Ok(values)
}

/// Why a value that is not numbers cannot be set.
fn not_numbers(option: &str, name: &str, text: &str, factors: &[FactorSpec]) -> String {
    if let Some(factor) = factors.iter().find(|factor| factor.name == name) {
        return match factor.choices.as_slice() {
            [] => format!("--set {option}: `{text}` is not a number or a list of numbers"),
            choices => format!("--set {option}: `{text}` is not a number or one of {}", choices.join(", ")),
        };
    }
    let near = nearest(name, factors.iter().map(|factor| factor.name.as_str()));
    format!("--set {option}: unknown factor `{name}`{}; `swm fovs` lists them", did_you_mean(near.as_deref()))
}

/// `1,2.5` as numbers.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|part| part.trim().parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn variation(text: &str, samples_defaults: bool) -> Option<Vec<String>> {
        let vary = Some(text.split(',').map(str::to_owned).collect());
        ScenarioArgs { vary, set: Vec::new() }.variation(samples_defaults).ok().flatten()
    }

    #[test]
    fn choices_are_set_by_name_or_number() {
        let registry = crate::registry();
        let env = registry.env("swm/PushT-v1").unwrap().make(&swm_core::EnvConfig::default()).unwrap();
        let set = |text: &str| {
            factor_values(&[text.to_owned()], &env.spec().factors, &Output::new(false, true))
                .map(|values| values["block.shape"].clone())
        };
        for text in ["block.shape=small T", "block.shape=Small-t", "block.shape=6"] {
            assert_eq!(set(text).ok(), Some(Value::vector(&[6.0])), "{text}");
        }
        let refused = set("block.shape=U").unwrap_err().to_string();
        assert!(refused.contains("not a number or one of L, T, Z"), "{refused}");
    }

    #[test]
    fn a_plus_adds_to_what_is_sampled_without_it() {
        assert_eq!(variation("+agent.color, +block", true).unwrap(), ["default", "agent.color", "block"]);
        assert_eq!(variation("agent.color", true).unwrap(), ["agent.color"]);
        assert_eq!(variation("+agent.color", false).unwrap(), ["agent.color"]);
        assert!(variation("none", true).unwrap().is_empty());
        assert_eq!(variation("none,agent", true), None);
    }
}
