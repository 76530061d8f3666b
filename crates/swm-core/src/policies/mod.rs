//! Policies that fit every environment: random, smooth random, constant.

mod constant;
mod random;
mod smooth;

use crate::registry::{NoArgs, PolicyEntry};

pub use constant::constant;
pub use random::random;
pub use smooth::{OrnsteinUhlenbeck, Sines, ornstein_uhlenbeck, sines};

/// Policies that fit every environment.
pub const BASIC_POLICIES: &[PolicyEntry] = &[
    PolicyEntry {
        name: "random",
        summary: "every action uniform over the action space",
        settings: &[],
        make: |_, args| {
            args.parse_as::<NoArgs>()?;
            Ok(Box::new(random()))
        },
    },
    smooth::ENTRIES[0],
    smooth::ENTRIES[1],
    PolicyEntry {
        name: "constant",
        summary: "one action for ever (`constant:0.5,0`); without values all zeros: do nothing",
        settings: &[],
        make: |_, args| {
            let values = args.positional.iter().map(|value| value.as_f64().map(|value| value as f32));
            let values: Option<Vec<f32>> = values.collect();
            let values = values.ok_or_else(|| args.wrong("the values of the action must be numbers"))?;
            Ok(Box::new(constant(values)))
        },
    },
];
