//! Policies of TablePush3D: the expert, alone and with noise, and the planner's settings.

use swm_core::policy::{add_noise, write_action};
use swm_core::{
    Actor, EnvState, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Settings as _,
    SliceMut, SlotView,
};

use super::env::saved_conditions;
use super::guidance::Pilot;
use super::physics::Conditions;
use super::settings::Settings;
use super::state::{STATE_DIM, State};

/// A planner on the true dynamics that brings the object to the goal.
pub(super) const PLANNER: &str =
    "icem:samples=64,elites=8,iterations=3,horizon=12,receding_horizon=2,action_block=2,return_best=true";

/// The policies of TablePush3D.
pub(super) const POLICIES: &[PolicyEntry] = &[
    PolicyEntry::new("expert", "goes around the object and pushes it to the goal", |context, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        make(context, args, 0.0)
    }),
    PolicyEntry::new(
        "noisy-expert",
        "the expert with normal noise on its actions (`noisy-expert:STD`)",
        |context, args| {
            let Noise { std } = args.parse_with("std")?;
            args.check_not_negative("std", std)?;
            make(context, args, std)
        },
    )
    .settings(Noise::SETTINGS),
];

swm_core::settings! {
    /// Arguments of the noisy expert. Unknown names are refused.
    struct Noise {
        /// Standard deviation of the noise on each component of an action.
        std: f64 = 0.3,
    }
}

fn make(context: &PolicyContext<'_>, args: &PolicyArgs, std: f64) -> Result<Box<dyn Policy>, PolicyError> {
    let settings: Settings = context.config.parse_settings(context.env.id)?;
    let description = if std > 0.0 { format!("{}:std={std}", args.name) } else { args.name.clone() };
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let mut state = EnvState::new();
        view.snapshot(&mut state)?;
        let conditions = saved_conditions(&settings, &state)?;
        Ok(Box::new(Expert { conditions, pilot: Pilot::default(), std }) as Box<dyn Actor>)
    })))
}

/// The expert in one episode, whose factors it knows.
struct Expert {
    conditions: Conditions,
    pilot: Pilot,
    std: f64,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let row = |column: &str| -> Result<State, PolicyError> {
            let values: &[f64] = view.row.get(column)?;
            let row: &[f64; STATE_DIM] = values.try_into().map_err(|_| PolicyError::Unsupported {
                policy: "expert".to_owned(),
                reason: format!("the column `{column}` has {} values, not {STATE_DIM}", values.len()),
            })?;
            Ok(State::from_row(row))
        };
        let (state, goal) = (row("state")?, row("goal_state")?.object());
        let mut values = self.pilot.act(&self.conditions, &state, goal);
        if self.std > 0.0 {
            add_noise(view, "policy expert noise", self.std, &mut values);
            values = values.map(|value| value.clamp(-1.0, 1.0));
        }
        write_action(&mut action, &values.map(|value| value as f32));
        Ok(())
    }
}
