//! A policy whose description leaves out its settings, which records and results tell policies apart by.

use std::any::Any;

use serde_json::Value as Json;

use super::arguments::literal;
use super::{PolicyArgs, Setting};
use crate::batch::Field;
use crate::error::PolicyError;
use crate::policy::{Actions, Policy, View};

/// `policy`, described with its arguments where its own description is the name alone and some differ from their defaults.
pub(super) fn described(policy: Box<dyn Policy>, args: &PolicyArgs, settings: &[Setting]) -> Box<dyn Policy> {
    let is_default = |(name, value): (&String, &Json)| {
        let known = settings.iter().find(|setting| setting.name == name);
        known.is_some_and(|setting| is_same(&literal(setting.default), value))
    };
    match args.positional.is_empty() && args.named.iter().all(is_default) || policy.describe() != args.name {
        true => policy,
        false => Box::new(Described { policy, text: args.to_string() }),
    }
}

/// `1` and `1.0` are the same.
fn is_same(one: &Json, other: &Json) -> bool {
    one == other || one.as_f64().is_some_and(|number| Some(number) == other.as_f64())
}

struct Described {
    policy: Box<dyn Policy>,
    text: String,
}

impl Policy for Described {
    fn describe(&self) -> String {
        self.text.clone()
    }

    fn fields(&self) -> Vec<Field> {
        self.policy.fields()
    }

    fn act(&mut self, view: &View<'_>, actions: &mut Actions<'_>) -> Result<(), PolicyError> {
        self.policy.act(view, actions)
    }

    fn is_parallel(&self) -> bool {
        self.policy.is_parallel()
    }

    fn divide(&mut self, rows: usize) -> Option<Vec<Box<dyn Policy>>> {
        self.policy.divide(rows)
    }

    fn as_any(&mut self) -> Option<&mut dyn Any> {
        self.policy.as_any()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::scripted;

    #[test]
    fn settings_that_an_author_left_out_are_described() {
        const SETTINGS: &[Setting] = &[Setting::new("gain", "how strongly", "1")];
        let told = |text: &str| {
            let args = PolicyArgs::parse(text).unwrap();
            let policy = scripted("pid", |_, _| Ok(()));
            described(Box::new(policy), &args, SETTINGS).describe()
        };
        assert_eq!(["pid", "pid:gain=1", "pid:gain=1.0"].map(told), ["pid"; 3]);
        assert_eq!(["pid:gain=2", "pid:2"].map(told), ["pid:gain=2", "pid:2"]);
        // One that says more says it all.
        assert_eq!(told("other:gain=2"), "pid");
    }
}
