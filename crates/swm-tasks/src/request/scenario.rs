//! Which factors of variation are sampled, and which are set: the settings `vary` and `set` of requests.

use std::collections::BTreeMap;

use serde_json::{Map, Value as Json, json};
use swm_core::env::{nearest_factor, selects};
use swm_core::error::{did_you_mean, nearest};
use swm_core::{EnvConfig, EnvEntry, FactorSpec, Metadata, Registry, ResetOptions, Value};
use swm_data::Dataset;
use swm_data::rendered::env_named;
use swm_fov::color_values;

use super::{Assignment, Fix, List, Message, Report, TaskError, value_text, wrong};

/// Which factors vary, which are set.
#[derive(Clone, Copy, Debug)]
pub struct Scenario<'a> {
    /// Names of factors, groups, `*.color` (in every group), `default`, `all`, or `none` alone; `+NAME` samples it in addition to
    /// the environment's default factors. `None`: the default factors.
    pub vary: Option<&'a [String]>,
    /// Values of factors: numbers, lists of numbers, or texts: names of colors and choices, or numbers with commas.
    pub set: &'a Map<String, Json>,
}

impl Scenario<'_> {
    /// The reset of every episode in an environment with these factors. Notes which default factors are no longer sampled.
    ///
    /// # Errors
    ///
    /// A name that selects no factor, or a value that none can have.
    pub fn options(
        &self,
        env: &EnvEntry,
        factors: &[FactorSpec],
        report: &mut dyn Report,
    ) -> Result<ResetOptions, TaskError> {
        let options = self.with(self.variation(true)?, env, factors, report)?;
        let left = options.unsampled_defaults(factors);
        if !left.is_empty() {
            let given: Vec<&str> = self.vary.iter().copied().flatten().map(|name| name.trim()).collect();
            let wider = format!("+{}", given.join(","));
            let wider: Vec<&str> = wider.split(',').collect();
            let left = left.join(", ");
            let text = format!("samples only what it names; {left} keep their defaults in every episode");
            let fix = Fix::Set { setting: Assignment::of("vary", json!(wider)), to: "to sample them, too" };
            report.note(&Message::about("vary", json!(given), text).fix(fix));
        }
        Ok(options)
    }

    /// As [`Scenario::options`], where starts and goals are recorded: without `vary`, nothing is sampled.
    ///
    /// # Errors
    ///
    /// As of [`Scenario::options`].
    pub fn recorded_options(
        &self,
        env: &EnvEntry,
        factors: &[FactorSpec],
        report: &mut dyn Report,
    ) -> Result<ResetOptions, TaskError> {
        self.with(self.variation(false)?, env, factors, report)
    }

    fn with(
        &self,
        variation: Option<Vec<String>>,
        env: &EnvEntry,
        factors: &[FactorSpec],
        report: &mut dyn Report,
    ) -> Result<ResetOptions, TaskError> {
        check_selected(variation.iter().flatten(), env, factors)?;
        let variation_values = factor_values(self.set, env, factors, report)?;
        self.note_set(&variation_values, report);
        Ok(ResetOptions { variation, variation_values, ..ResetOptions::default() })
    }

    /// Notes which factors of `vary` are not sampled, since `set` gives their values.
    fn note_set(&self, values: &BTreeMap<String, Value>, report: &mut dyn Report) {
        let is_asked = |name: &str| {
            let mut asked = self.vary.iter().copied().flatten();
            asked.any(|asked| asked.trim().trim_start_matches('+').trim_start() == name)
        };
        for name in values.keys().filter(|name| is_asked(name)) {
            let text = "samples nothing, since the factor is set";
            report.note(&Message::about("vary", json!([name]), text));
        }
    }

    /// The names of `vary`; `none` samples nothing. With `samples_defaults`, the default factors are what is sampled without
    /// `vary`, and `+NAME` adds to them; else nothing is, as where starts are recorded, and `+NAME` is `NAME`.
    fn variation(&self, samples_defaults: bool) -> Result<Option<Vec<String>>, TaskError> {
        let Some(asked) = self.vary else { return Ok(None) };
        if asked.is_empty() {
            return Ok(Some(Vec::new()));
        }
        let mut names: Vec<String> = Vec::new();
        for name in asked.iter().map(|name| name.trim()).filter(|name| !name.is_empty()) {
            let added = name.strip_prefix('+').map(str::trim);
            if added.is_some() && samples_defaults && !names.iter().any(|name| name == "default") {
                names.insert(0, "default".to_owned());
            }
            if added == Some("") {
                let text = "name a factor behind `+`, such as +agent.color";
                return Err(Message::about("vary", json!(["+"]), text).into());
            }
            names.push(added.unwrap_or(name).to_owned());
        }
        if names.is_empty() {
            let setting = Some(Assignment::name("vary"));
            let fix = Fix::Set { setting: Assignment::of("vary", json!(["none"])), to: "to sample none" };
            return Err(Message { setting, text: "it names no factor".to_owned(), fix: Some(fix) }.into());
        }
        match names.iter().any(|name| name == "none") {
            false => Ok(Some(names)),
            true if names.len() == 1 => Ok(Some(Vec::new())),
            true => Err(Message::about("vary", json!(names), "`none` stands alone, or is left out").into()),
        }
    }
}

/// Refuses names of `vary` that select no factor.
fn check_selected<'a>(
    asked: impl Iterator<Item = &'a String>,
    env: &EnvEntry,
    factors: &[FactorSpec],
) -> Result<(), TaskError> {
    let selects =
        |asked: &str| asked == "default" || factors.iter().any(|factor| factor.is_selected_by(asked));
    let mut unknown = asked.filter(|asked| !selects(asked));
    unknown.next().map_or(Ok(()), |name| {
        Err(no_factor(Assignment::of("vary", json!([name])), name, env, factors).into())
    })
}

/// Why there is no factor `name`: it is a setting, a group, or nothing.
pub(super) fn no_factor(setting: Assignment, name: &str, env: &EnvEntry, factors: &[FactorSpec]) -> Message {
    let names = || factors.iter().map(|factor| factor.name.as_str());
    let below: Vec<&str> = names().filter(|factor| selects(name, factor)).collect();
    let id = env.id;
    let (text, fix) = if !below.is_empty() {
        (format!("`{name}` is a group of factors; name one of them: {}", below.join(", ")), None)
    } else if env.settings.iter().any(|setting| setting.name == name) {
        let fix = Fix::set("env_option", json!({ name: "VALUE" }));
        (format!("`{name}` is no factor but a setting of {id}"), Some(fix))
    } else if name.contains(char::is_whitespace) {
        (format!("`{name}` is no factor; separate several with commas, without spaces"), None)
    } else {
        let meant = did_you_mean(nearest_factor(name, names()).as_deref());
        (format!("unknown factor `{name}`{meant}"), Some(Fix::List(List::Factors(id.to_owned()))))
    };
    Message { setting: Some(setting), text, fix }
}

/// The values of `set`, by the names of factors of the environment that a dataset was recorded in, for images that are rendered anew.
///
/// # Errors
///
/// The dataset does not say how it was recorded, its environment cannot be made, or has no such factor or value.
pub fn look_of(
    dataset: &dyn Dataset,
    registry: &Registry,
    set: &Map<String, Json>,
    report: &mut dyn Report,
) -> Result<BTreeMap<String, Value>, TaskError> {
    if set.is_empty() {
        return Ok(BTreeMap::new());
    }
    let path = dataset.path().display();
    let Some(metadata) = dataset.metadata().and_then(Metadata::of_known_env) else {
        let text =
            format!("{path} does not say how it was recorded, so that its images cannot be rendered anew");
        return Err(Message::about("set", set.clone(), text).fix(Fix::Leave("set")).into());
    };
    let entry = env_named(registry, &metadata.env, &format!("{path} was recorded in")).map_err(wrong)?;
    let config = EnvConfig { image: None, settings: metadata.settings.clone() };
    let factors = entry.make(&config)?.spec().factors.clone();
    factor_values(set, entry, &factors, report)
}

/// Values of factors. What the environment cannot take, it refuses itself.
///
/// # Errors
///
/// There is no such factor, or the value is not one that any factor has.
pub fn factor_values(
    set: &Map<String, Json>,
    env: &EnvEntry,
    factors: &[FactorSpec],
    report: &mut dyn Report,
) -> Result<BTreeMap<String, Value>, TaskError> {
    let mut values = BTreeMap::new();
    for (name, given) in set {
        let setting = || Assignment::of("set", json!({ name: given }));
        let refuse = |text: String| Message { setting: Some(setting()), text, fix: None };
        let Some(factor) = factors.iter().find(|factor| factor.name == *name) else {
            return Err(no_factor(setting(), name, env, factors).into());
        };
        let numbers = match text_of(given) {
            // What is numbers already is taken as it is.
            None => {
                numbers(&value_text(given)).ok_or_else(|| refuse(not_numbers(&given.to_string(), factor)))?
            }
            Some(text) => {
                let inner = text.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(&text);
                match color_values(&factor.space, name, inner).map_err(refuse)? {
                    Some(color) => {
                        if let Some(read_as) = color.read_as {
                            report.note(&refuse(read_as));
                        }
                        color.values
                    }
                    None => {
                        let choice = factor.choice(inner).map(|choice| vec![choice as f64]);
                        let found = choice.or_else(|| numbers(inner));
                        found.ok_or_else(|| refuse(not_numbers(inner, factor)))?
                    }
                }
            }
        };
        values.insert(name.clone(), Value::vector(&numbers));
    }
    Ok(values)
}

/// A value that is text, or a list of texts.
fn text_of(value: &Json) -> Option<String> {
    let is_text = match value {
        Json::Array(items) => items.first().is_some_and(Json::is_string),
        value => value.is_string(),
    };
    is_text.then(|| value_text(value))
}

/// Why a value that is not numbers cannot be set.
fn not_numbers(text: &str, factor: &FactorSpec) -> String {
    match factor.choices.as_slice() {
        [] => format!("`{text}` is not a number or a list of numbers"),
        choices => {
            let meant = did_you_mean(nearest(text, choices.iter().map(String::as_str)).as_deref());
            format!("`{text}` is not a number or one of {}{meant}", choices.join(", "))
        }
    }
}

/// `1,2.5` as numbers.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |text: &str| match text {
        "true" => Some(1.0),
        "false" => Some(0.0),
        text => text.parse().ok(),
    };
    text.split(',').map(|part| number(part.trim())).collect()
}

#[cfg(test)]
mod tests {
    use swm_core::Space;
    use swm_core::testing::TOY;

    use super::*;

    fn variation(text: &str, samples_defaults: bool) -> Option<Vec<String>> {
        let vary: Vec<String> = text.split(',').map(str::to_owned).collect();
        Scenario { vary: Some(&vary), set: &Map::new() }.variation(samples_defaults).ok().flatten()
    }

    /// The factor `block.shape`, whose choices are L, small T and Z, set to a value.
    fn shape(given: Json) -> Result<Value, String> {
        let space = Space::Discrete { n: 3, start: 0 };
        let mut factor = FactorSpec::new("block.shape", space, 0_i64);
        factor.choices = ["L", "small T", "Z"].map(str::to_owned).to_vec();
        let factors = [factor];
        let set = Map::from_iter([("block.shape".to_owned(), given)]);
        let mut values = factor_values(&set, &TOY, &factors, &mut ()).map_err(|error| error.to_string())?;
        Ok(values.remove("block.shape").unwrap())
    }

    #[test]
    fn choices_are_set_by_name_or_number() {
        for given in [json!("small T"), json!("Small-t"), json!("1"), json!(1), json!([1]), json!("[1]")] {
            assert_eq!(shape(given.clone()), Ok(Value::vector(&[1.0])), "{given}");
        }
        let refused = shape(json!("U")).unwrap_err();
        assert!(
            refused.starts_with("set=block.shape=U: `U` is not a number or one of L, small T"),
            "{refused}"
        );
    }

    #[test]
    fn a_plus_adds_to_what_is_sampled_without_it() {
        assert_eq!(variation("+agent.color, +block", true).unwrap(), ["default", "agent.color", "block"]);
        assert_eq!(variation("agent.color", true).unwrap(), ["agent.color"]);
        assert_eq!(variation("+agent.color", false).unwrap(), ["agent.color"]);
        assert!(variation("none", true).unwrap().is_empty());
        assert_eq!(variation("none,agent", true), None);
        assert_eq!(variation("", true), None);
    }

    #[test]
    fn a_name_that_selects_nothing_is_refused_with_the_remedy() {
        let message = |name: &str| {
            let vary = [name.to_owned()];
            let factors =
                [FactorSpec::new("point.gain", Space::uniform_box(swm_core::Dtype::F64, &[], 0.1, 2.0), 1.0)];
            let scenario = Scenario { vary: Some(&vary), set: &Map::new() };
            match scenario.options(&TOY, &factors, &mut ()) {
                Err(TaskError::Request(message)) => *message,
                other => panic!("{other:?}"),
            }
        };
        let unknown = message("point.gian");
        assert!(unknown.text.contains("did you mean `point.gain`?"), "{unknown}");
        assert_eq!(unknown.fix, Some(Fix::List(List::Factors(TOY.id.to_owned()))));
        assert!(message("point.gain other").text.contains("separate several with commas"));
    }
}
