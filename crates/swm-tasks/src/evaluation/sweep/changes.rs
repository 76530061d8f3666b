//! The changes of a sweep: factors alone, by group and together, and which values they get.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use swm_core::env::FactorSpec;
use swm_core::env::selects;
use swm_core::{ResetOptions, Space, Value};

use crate::error::{TaskError, wrong};

/// Which values factors get.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Values {
    /// Drawn for every episode, by its seed.
    Sampled,
    /// The smallest, then the largest.
    Extremes,
    /// So many, evenly from the smallest to the largest.
    Grid(usize),
}

/// What is changed in a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
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

/// A change to be evaluated.
#[derive(Clone, Debug)]
pub struct Change {
    pub(super) name: String,
    pub(super) scope: Scope,
    pub(super) value: String,
    /// A share of every factor's range; drawn without one.
    share: Option<f64>,
}

/// Points of a grid, and the most values of a choice that are all taken unless a number is given.
const POINTS: usize = 5;
const MOST_CHOICES: usize = 16;

/// Points of a grid over the factors `asked` where no number is given: 5, or as many as the choices have values, where all of
/// them are choices of up to 16.
pub fn grid_points(factors: &[FactorSpec], asked: &[String]) -> usize {
    let names = || asked.iter().flat_map(|asked| asked.split('+'));
    let asked = |factor: &&FactorSpec| names().any(|name| factor.is_selected_by(name));
    let values = factors.iter().filter(asked).map(|factor| match factor.space {
        Space::Discrete { n, .. } => usize::try_from(n).ok().filter(|n| (2..=MOST_CHOICES).contains(n)),
        _ => None,
    });
    values.collect::<Option<Vec<_>>>().and_then(|values| values.into_iter().max()).unwrap_or(POINTS)
}

/// The first of the names `asked` that selects no factor.
pub(crate) fn unknown_factor(factors: &[FactorSpec], asked: &[String]) -> Option<String> {
    let is_unknown = |asked: &&str| !factors.iter().any(|factor| factor.is_selected_by(asked));
    asked.iter().find_map(|asked| match asked.split('+').find(is_unknown)? {
        "" => Some(asked.clone()),
        unknown => Some(unknown.to_owned()),
    })
}

/// The changes of a sweep over factors (`asked`: names, groups, `all`, or several joined by `+`, which change together), in order.
///
/// # Errors
///
/// [`TaskError::Request`]: an unknown factor, or a grid of fewer than 2 values.
pub fn changes(factors: &[FactorSpec], asked: &[String], values: Values) -> Result<Vec<Change>, TaskError> {
    let all: Vec<&str> = factors.iter().map(|factor| factor.name.as_str()).collect();
    if let Some(unknown) = unknown_factor(factors, asked) {
        let near = swm_core::env::nearest_factor(&unknown, all.iter().copied());
        let meant = swm_core::error::did_you_mean(near.as_deref());
        return Err(wrong(format!("unknown factor `{unknown}`{meant}")));
    }
    let wanted: Vec<&str> = factors
        .iter()
        .filter(|factor| asked.iter().any(|asked| factor.is_selected_by(asked)))
        .map(|factor| factor.name.as_str())
        .collect();
    let groups: BTreeSet<&str> = wanted
        .iter()
        .filter_map(|name| name.split_once('.').map(|(group, _)| group))
        .filter(|group| {
            // A group is changed as a whole, so all of it must have been asked for.
            let of_group: Vec<_> = all.iter().filter(|name| selects(group, name)).collect();
            of_group.len() > 1 && of_group.iter().all(|name| wanted.contains(name))
        })
        .collect();
    let singles = wanted.iter().map(|&name| (name, Scope::Factor));
    let groups = groups.into_iter().map(|name| (name, Scope::Group));
    let whole = (wanted.len() == all.len() && all.len() > 1).then_some(("all", Scope::All));
    let shares: Vec<(String, Option<f64>)> = match values {
        Values::Sampled => vec![("sampled".to_owned(), None)],
        Values::Extremes => vec![("lowest".to_owned(), Some(0.0)), ("highest".to_owned(), Some(1.0))],
        Values::Grid(count) if count >= 2 => (0..count)
            .map(|index| index as f64 / (count - 1) as f64)
            .map(|share| (format!("{:.0} % of the range", 100.0 * share), Some(share)))
            .collect(),
        Values::Grid(count) => return Err(wrong(format!("a grid of {count} value(s); use 2 or more"))),
    };
    // Of one's own: factors that change together, such as two that may make each other worse.
    let joint = asked.iter().filter(|asked| asked.contains('+')).map(|asked| (asked.as_str(), Scope::Group));
    let scopes = singles.chain(groups).chain(joint).chain(whole);
    let mut changes: Vec<Change> = scopes
        .flat_map(|(name, scope)| {
            let factor = factors.iter().find(|factor| factor.name == name);
            shares.iter().map(move |(value, share)| Change {
                name: name.to_owned(),
                scope,
                value: match (values, share.and_then(|share| shown(factor?, share))) {
                    (Values::Grid(_), Some(number)) => number,
                    (_, Some(number)) => format!("{value} ({number})"),
                    (_, None) => value.clone(),
                },
                share: *share,
            })
        })
        .collect();
    // A factor of few values has no other value at each point of the grid.
    if let Values::Grid(_) = values {
        changes.dedup_by(|next, before| (&next.name, &next.value) == (&before.name, &before.value));
    }
    Ok(changes)
}

impl Change {
    /// What is changed: a factor's name, a group's, several joined by `+`, or `all`.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether it changes this factor.
    fn selects(&self, factor: &FactorSpec) -> bool {
        self.name.split('+').any(|name| selects(name, &factor.name))
    }

    /// Whether the reset samples all that this change would sample: then it changes nothing.
    pub(super) fn is_sampled_in(&self, factors: &[FactorSpec], reset: &ResetOptions) -> bool {
        let is_sampled = |factor: &FactorSpec| {
            factor.is_sampled(reset.variation.as_deref())
                && !reset.variation_values.contains_key(&factor.name)
        };
        let mut selected = factors.iter().filter(|factor| self.selects(factor));
        self.share.is_none() && reset.start.is_none() && selected.all(is_sampled)
    }

    /// Whether it sets values, rather than sampling them.
    pub(super) fn has_values(&self) -> bool {
        self.share.is_some()
    }

    /// The reset with the change on top. Values that are set lie `toward` (0 to 1) on the way to those of `own`.
    pub(super) fn apply(
        &self,
        factors: &[FactorSpec],
        reset: &ResetOptions,
        own: &BTreeMap<String, Vec<f64>>,
        toward: f64,
    ) -> ResetOptions {
        let mut changed = reset.clone();
        for factor in factors.iter().filter(|factor| self.selects(factor)) {
            changed.variation_values.remove(&factor.name);
            let own = own.get(&factor.name).map_or(&[][..], Vec::as_slice);
            if let Some(value) = self.share.and_then(|share| at_share(&factor.space, share, own, toward)) {
                changed.variation_values.insert(factor.name.clone(), value);
            }
        }
        if self.share.is_none() {
            let drawn = changed.variation.get_or_insert_with(|| {
                factors.iter().filter(|factor| factor.sampled_by_default).map(|f| f.name.clone()).collect()
            });
            drawn.extend(self.name.split('+').map(str::to_owned));
        }
        changed
    }
}

/// The value at a share of the way from the smallest to the largest, moved `toward` (0 to 1) the numbers `own`; none where
/// the range is not finite.
fn at_share(space: &Space, share: f64, own: &[f64], toward: f64) -> Option<Value> {
    let between = |low: f64, high: f64, share: f64| low + (high - low) * share;
    let (low, high) = match space {
        Space::Dict { .. } => return None,
        space => space.bounds(),
    };
    let whole = !matches!(space, Space::Box { .. });
    let numbers: Vec<f64> = low
        .iter()
        .zip(&high)
        .enumerate()
        .map(|(at, (&low, &high))| {
            let asked = between(low, high, share);
            let moved = own.get(at).map_or(asked, |&own| between(asked, own, toward));
            if whole { moved.round() } else { moved }
        })
        .collect();
    let dtype = space.dtype()?;
    let finite = numbers.iter().all(|number| number.is_finite());
    finite.then(|| Value::vector(&numbers).cast("factor", dtype, &space.shape()).ok())?
}

/// The value at a share, for people: `20`, `0, 0.5, 1`, `2 (T)`; none where there is none, or it has many elements.
fn shown(factor: &FactorSpec, share: f64) -> Option<String> {
    let numbers = at_share(&factor.space, share, &[], 0.0)?.to_f64s("factor").ok()?;
    let text = |number: &f64| match factor.choice_name(*number as i64) {
        Some(name) => format!("{number} ({name})"),
        None => format!("{}", (number * 1e4).round() / 1e4),
    };
    (numbers.len() <= 4).then(|| numbers.iter().map(text).collect::<Vec<_>>().join(", "))
}

#[cfg(test)]
mod tests {
    use serde_json::Value as Json;
    use swm_core::Dtype;

    use super::*;

    fn factor(name: &str, space: Space, sampled_by_default: bool) -> FactorSpec {
        FactorSpec::new(name, space, Json::Null).sampled_by_default(sampled_by_default)
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
            let changes = changes(&factors(), &asked, values).map_err(|error| error.to_string());
            changes.map(|changes| {
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
        assert_eq!(
            of(&["agent"], Values::Extremes).unwrap(),
            ["agent.shape lowest (1)", "agent.shape highest (4)"]
        );
        assert_eq!(
            of(&["agent.shape"], Values::Grid(3)).unwrap(),
            ["agent.shape 1", "agent.shape 3", "agent.shape 4"]
        );
        let every = ["agent.shape 1", "agent.shape 2", "agent.shape 3", "agent.shape 4"];
        assert_eq!(of(&["agent.shape"], Values::Grid(9)).unwrap(), every, "each value once");
        assert!(of(&["agent.shap"], Values::Sampled).unwrap_err().contains("did you mean `agent.shape`?"));
        assert!(of(&["all"], Values::Grid(1)).unwrap_err().contains("2 or more"));
        let joint = ["agent.shape", "agent.shape+block.color"];
        assert_eq!(
            of(&joint, Values::Sampled).unwrap(),
            ["agent.shape sampled", "agent.shape+block.color sampled"]
        );
        let unknown = of(&["agent.shape+blok.color"], Values::Sampled).unwrap_err();
        assert!(unknown.contains("`blok.color` (did you mean `block.color`?)"), "{unknown}");
        assert!(
            of(&["+agent.shape"], Values::Sampled).unwrap_err().contains("unknown factor `+agent.shape`")
        );
    }

    #[test]
    fn factors_that_are_joined_change_together() {
        let factors = factors();
        let change = |values| {
            let asked = ["agent.shape+block.color".to_owned()];
            changes(&factors, &asked, values).unwrap().remove(0)
        };
        let none = BTreeMap::new();
        let plain = ResetOptions::default();
        let drawn = change(Values::Sampled).apply(&factors, &plain, &none, 0.0);
        assert_eq!(drawn.variation.unwrap(), ["block.start", "agent.shape", "block.color"]);
        let lowest = change(Values::Extremes).apply(&factors, &plain, &none, 0.0);
        assert!(lowest.variation_values.keys().eq(["agent.shape", "block.color"]));

        let is_sampled = |reset: &ResetOptions| change(Values::Sampled).is_sampled_in(&factors, reset);
        assert!(!is_sampled(&plain) && !is_sampled(&plain.clone().vary(["agent"])));
        let both = plain.clone().vary(["agent", "block.color"]);
        assert!(is_sampled(&both) && !change(Values::Extremes).is_sampled_in(&factors, &both));
        assert!(!is_sampled(&both.set("agent.shape", Value::scalar(2_i64))));
        let start = changes(&factors, &["block.start".to_owned()], Values::Sampled).unwrap().remove(0);
        assert!(start.is_sampled_in(&factors, &plain), "by default");
    }

    #[test]
    fn changes_draw_or_set_what_they_name_and_nothing_else() {
        let (factors, plain) =
            (factors(), ResetOptions::default().set("block.color", Value::vector(&[9u8; 3])));
        let change =
            |share| Change { name: "block".to_owned(), scope: Scope::Group, value: String::new(), share };
        let none = BTreeMap::new();
        let drawn = change(None).apply(&factors, &plain, &none, 0.0);
        assert_eq!(
            drawn.variation.unwrap(),
            ["block.start", "block"],
            "what is sampled by default stays sampled"
        );
        assert!(drawn.variation_values.is_empty(), "what is drawn is not set");
        let set = change(Some(1.0)).apply(&factors, &plain, &none, 0.0);
        assert_eq!(set.variation, None);
        assert_eq!(set.variation_values["block.color"], Value::vector(&[255u8; 3]));
        assert_eq!(set.variation_values["block.start"], Value::vector(&[3.0, 3.0]));
        let own = BTreeMap::from([("block.start".to_owned(), vec![1.0, 0.0])]);
        let nearer = change(Some(1.0)).apply(&factors, &plain, &own, 0.5);
        assert_eq!(nearer.variation_values["block.start"], Value::vector(&[2.0, 1.5]));
        assert_eq!(at_share(&Space::Discrete { n: 4, start: 1 }, 0.5, &[], 0.0), Some(Value::scalar(3i64)));
        let open = Space::uniform_box(Dtype::F64, &[], 0.0, f64::INFINITY);
        assert_eq!(at_share(&open, 1.0, &[], 0.0), None);
    }
}
