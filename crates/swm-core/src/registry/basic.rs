//! Policies that fit every environment.

use super::{NoArgs, PolicyEntry};
use crate::{policy, smooth};

/// Policies that fit every environment.
pub const BASIC_POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new("random", "every action uniform over the action space", |_, args| {
        args.parse_as::<NoArgs>()?;
        Ok(Box::new(policy::random()))
    }),
    smooth::ENTRIES[0],
    smooth::ENTRIES[1],
    PolicyEntry::new(
        "constant",
        "one action for ever (`constant:0.5,0`); without values all zeros: a no-op",
        |_, args| {
            let values = args.positional.iter().map(|value| value.as_f64().map(|value| value as f32));
            let values: Option<Vec<f32>> = values.collect();
            let values = values.ok_or_else(|| args.wrong("the values of the action must be numbers"))?;
            Ok(Box::new(policy::constant(values)))
        },
    ),
];
