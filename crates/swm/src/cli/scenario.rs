//! `--vary` and `--set`: which factors of variation are sampled, which are set.

use std::collections::BTreeMap;

use clap::Args;
use swm_core::env::{nearest_factor, selects};
use swm_core::error::{did_you_mean, nearest};
use swm_core::{EnvEntry, FactorSpec, ResetOptions, Value};
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
    pub(super) fn options(
        &self,
        env: &EnvEntry,
        factors: &[FactorSpec],
        output: &Output,
    ) -> Result<ResetOptions, Failure> {
        let variation = self.variation(true)?;
        check_selected(variation.iter().flatten(), env, factors)?;
        let values = factor_values(&self.set, env, factors, output)?;
        self.note_set(&values, output);
        let options = ResetOptions { variation, variation_values: values, ..ResetOptions::default() };
        let left = options.unsampled_defaults(factors);
        if !left.is_empty() {
            output.note(format!(
                "note: --vary samples only what it names; {} keep their defaults in every episode (`--vary +{}` samples them, too)",
                left.join(", "),
                self.vary.iter().flatten().map(|name| name.trim()).collect::<Vec<_>>().join(","),
            ));
        }
        Ok(options)
    }

    /// As [`ScenarioArgs::options`], where starts and goals are recorded: without `--vary`, nothing is sampled.
    pub(super) fn recorded_options(
        &self,
        env: &EnvEntry,
        factors: &[FactorSpec],
        output: &Output,
    ) -> Result<ResetOptions, Failure> {
        let variation = self.variation(false)?;
        check_selected(variation.iter().flatten(), env, factors)?;
        let variation_values = factor_values(&self.set, env, factors, output)?;
        self.note_set(&variation_values, output);
        Ok(ResetOptions { variation, variation_values, ..ResetOptions::default() })
    }

    /// Says which factors of `--vary` are not sampled, since `--set` gives their values.
    fn note_set(&self, values: &BTreeMap<String, Value>, output: &Output) {
        let is_asked = |name: &str| {
            let mut asked = self.vary.iter().flatten();
            asked.any(|asked| asked.trim().trim_start_matches('+').trim_start() == name)
        };
        for name in values.keys().filter(|name| is_asked(name)) {
            output.note(format!("note: --vary {name} samples nothing, since --set {name} sets it"));
        }
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
            if added == Some("") {
                return Err(usage("--vary +: name a factor behind `+`, such as +agent.color"));
            }
            names.push(added.unwrap_or(name).to_owned());
        }
        if names.is_empty() {
            return Err(usage("--vary: it names no factor; `--vary none` samples none"));
        }
        match names.iter().any(|name| name == "none") {
            false => Ok(Some(names)),
            true if names.len() == 1 => Ok(Some(Vec::new())),
            true => Err(usage("--vary: `none` stands alone, or is left out")),
        }
    }
}

/// Refuses names of `--vary` that select no factor.
fn check_selected<'a>(
    asked: impl Iterator<Item = &'a String>,
    env: &EnvEntry,
    factors: &[FactorSpec],
) -> Result<(), Failure> {
    let selects =
        |asked: &str| asked == "default" || factors.iter().any(|factor| factor.is_selected_by(asked));
    let mut unknown = asked.filter(|asked| !selects(asked));
    unknown
        .next()
        .map_or(Ok(()), |name| Err(usage(format!("--vary {name}: {}", no_factor(name, env, factors)))))
}

/// Why there is no factor `name`: it is a setting, a group, or nothing.
fn no_factor(name: &str, env: &EnvEntry, factors: &[FactorSpec]) -> String {
    let names = || factors.iter().map(|factor| factor.name.as_str());
    let below: Vec<&str> = names().filter(|factor| selects(name, factor)).collect();
    let id = env.id;
    if !below.is_empty() {
        return format!("`{name}` is a group of factors; name one of them: {}", below.join(", "));
    }
    if env.settings.iter().any(|setting| setting.name == name) {
        return format!("`{name}` is no factor but a setting of {id}; set it by --env-option {name}=VALUE");
    }
    if name.contains(char::is_whitespace) {
        return format!("`{name}` is no factor; separate several with commas, without spaces");
    }
    let meant = did_you_mean(nearest_factor(name, names()).as_deref());
    format!("unknown factor `{name}`{meant}; `swm fovs {id}` lists them")
}

/// Reads `--set NAME=VALUE` options. Values that the environment cannot take, it refuses itself.
pub(super) fn factor_values(
    options: &[String],
    env: &EnvEntry,
    factors: &[FactorSpec],
    output: &Output,
) -> Result<BTreeMap<String, Value>, Failure> {
    let mut values = BTreeMap::new();
    for option in options {
        let (name, text) = assignment(option, "--set")?;
        let inner = text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(text);
        let Some(factor) = factors.iter().find(|factor| factor.name == name) else {
            return Err(usage(format!("--set {option}: {}", no_factor(name, env, factors))));
        };
        let color = color_values(&factor.space, name, inner);
        let color = color.map_err(|reason| usage(format!("--set {option}: {reason}")))?;
        let numbers = match color {
            Some(color) => {
                if let Some(read_as) = color.read_as {
                    output.note(format!("note: --set {option}: {read_as}"));
                }
                color.values
            }
            None => factor
                .choice(inner)
                .map(|choice| vec![choice as f64])
                .or_else(|| numbers(inner))
                .ok_or_else(|| usage(not_numbers(option, inner, factor)))?,
        };
        if values.insert(name.to_owned(), Value::vector(&numbers)).is_some() {
            output.note(format!("note: --set {option} replaces the earlier --set of `{name}`"));
        }
    }
    Ok(values)
}

/// Why a value that is not numbers cannot be set.
fn not_numbers(option: &str, text: &str, factor: &FactorSpec) -> String {
    match factor.choices.as_slice() {
        [] => format!("--set {option}: `{text}` is not a number or a list of numbers"),
        choices => {
            let meant = did_you_mean(nearest(text, choices.iter().map(String::as_str)).as_deref());
            format!("--set {option}: `{text}` is not a number or one of {}{meant}", choices.join(", "))
        }
    }
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
        let entry = registry.env("swm/PushT-v1").unwrap();
        let env = entry.make(&swm_core::EnvConfig::default()).unwrap();
        let set = |text: &str| {
            factor_values(&[text.to_owned()], entry, &env.spec().factors, &Output::new(false, true))
                .map(|values| values["block.shape"].clone())
        };
        for text in ["block.shape=small T", "block.shape=Small-t", "block.shape=6"] {
            assert_eq!(set(text).ok(), Some(Value::vector(&[6.0])), "{text}");
        }
        let refused = set("block.shape=U").unwrap_err().to_string();
        assert!(refused.contains("not a number or one of L, T, Z"), "{refused}");
        let refused = set("block.shape=sqare").unwrap_err().to_string();
        assert!(refused.contains("did you mean `square`?"), "{refused}");
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
