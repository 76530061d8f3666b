//! Policies of rocket landing: the expert, alone and with noise, and the planner's settings.

use swm_core::policy::{add_noise, write_action};
use swm_core::{
    Actor, PerEpisode, Policy, PolicyArgs, PolicyEntry, PolicyError, Settings as _, SliceMut, SlotView,
};

use super::flight::Conditions;
use super::guidance::Pilot;
use super::state::{STATE_DIM, State};

/// A planner on the true dynamics that lands.
pub(super) const PLANNER: &str =
    "icem:samples=64,elites=8,iterations=3,horizon=16,receding_horizon=2,action_block=1,return_best=true";

/// The policies of rocket landing.
pub(super) const POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new(
        "expert",
        "descends as fast as the engine can brake, by throttle and gimbal",
        |_, args| {
            args.parse_as::<swm_core::registry::NoArgs>()?;
            Ok(pilot("expert".to_owned(), 0.0))
        },
    ),
    PolicyEntry::new(
        "noisy-expert",
        "the expert with normal noise on its actions (`noisy-expert:STD`)",
        |_, args| noisy(args),
    )
    .settings(Noise::SETTINGS),
];

swm_core::settings! {
    /// Arguments of the noisy expert.
    struct Noise {
        /// Standard deviation of the noise on each value of an action.
        std: f64 = 0.1,
    }
}

fn noisy(args: &PolicyArgs) -> Result<Box<dyn Policy>, PolicyError> {
    let Noise { std } = args.parse_with("std")?;
    args.check_not_negative("std", std)?;
    Ok(pilot(format!("{}:std={std}", args.name), std))
}

fn pilot(description: String, std: f64) -> Box<dyn Policy> {
    Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let dry_mass: &[f64] = view.row.get("variation.rocket.dry_mass")?;
        let wind: &[f64] = view.row.get("variation.environment.wind")?;
        let conditions = Conditions { dry_mass: dry_mass[0], wind: [wind[0], wind[1]] };
        Ok(Box::new(Expert { std, conditions, pilot: Pilot::default() }) as Box<dyn Actor>)
    }))
}

/// The expert of one episode, which knows its factors.
struct Expert {
    std: f64,
    conditions: Conditions,
    pilot: Pilot,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let row: &[f64] = view.row.get("state")?;
        let row: &[f64; STATE_DIM] = row.try_into().map_err(|_| PolicyError::Unsupported {
            policy: "expert".to_owned(),
            reason: format!("the column `state` has {} values, not {STATE_DIM}", row.len()),
        })?;
        let mut values = self.pilot.act(&self.conditions, &State::from_row(row));
        if self.std > 0.0 {
            add_noise(view, "policy rocket noise", self.std, &mut values);
            let (low, high) = view.spec.action.bounds();
            for (value, (low, high)) in values.iter_mut().zip(low.into_iter().zip(high)) {
                *value = value.clamp(low, high);
            }
        }
        write_action(&mut action, &values.map(|value| value as f32));
        Ok(())
    }
}
