//! Policies that fit every environment.

use super::{NoArgs, PolicyEntry};
use crate::env::Env;
use crate::policies::{OrnsteinUhlenbeck, Sines, constant, ornstein_uhlenbeck, random, sines};
use crate::settings::Settings as _;
use crate::space::Space;

fn has_real_actions(env: &dyn Env) -> bool {
    matches!(env.spec().action, Space::Box { .. })
}

/// Policies that fit every environment.
pub const BASIC_POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new("random", "every action uniform over the action space", |_, args| {
        args.parse_as::<NoArgs>()?;
        Ok(Box::new(random()))
    }),
    PolicyEntry::new("ou", "smooth random actions: an Ornstein-Uhlenbeck process per element", |_, args| {
        Ok(Box::new(ornstein_uhlenbeck(args.parse_as()?)?))
    })
    .settings(OrnsteinUhlenbeck::SETTINGS)
    .suits_if(has_real_actions),
    PolicyEntry::new(
        "sine",
        "smooth random actions: sums of sines with random frequencies and phases",
        |_, args| Ok(Box::new(sines(args.parse_as()?)?)),
    )
    .settings(Sines::SETTINGS)
    .suits_if(has_real_actions),
    PolicyEntry::new(
        "constant",
        "one action for ever (`constant:0.5,0`); without values all zeros: a no-op",
        |_, args| {
            let values = args.positional.iter().map(|value| value.as_f64().map(|value| value as f32));
            let values: Option<Vec<f32>> = values.collect();
            let values = values.ok_or_else(|| args.wrong("the values of the action must be numbers"))?;
            Ok(Box::new(constant(values)))
        },
    ),
];
