//! The expert of Piecewise: walks straight to the target against the push of its zone, with noise if asked.

use swm_core::policy::{add_noise, write_action};
use swm_core::{
    Actor, EnvState, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Settings as _,
    SliceMut, SlotView,
};

use super::env::saved_zones;
use super::settings::Settings;
use super::zones::Zones;

/// A planner on the true dynamics that finds the target.
pub(super) const PLANNER: &str =
    "icem:samples=32,elites=4,iterations=2,horizon=4,receding_horizon=1,action_block=2,return_best=true";

/// `expert`.
pub(super) const EXPERT: PolicyEntry = PolicyEntry::new(
    "expert",
    "walks straight to the target, against the push of its zone",
    |context, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        make(context, args, 0.0)
    },
);

/// `noisy-expert`.
pub(super) const NOISY_EXPERT: PolicyEntry = PolicyEntry::new(
    "noisy-expert",
    "the expert with normal noise on its actions (`noisy-expert:STD`)",
    |context, args| {
        let Noise { std } = args.parse_with("std")?;
        args.check_not_negative("std", std)?;
        make(context, args, std)
    },
)
.settings(Noise::SETTINGS);

swm_core::settings! {
    /// Arguments of the noisy expert. Unknown names are refused.
    struct Noise {
        /// Standard deviation of the noise on each component of an action.
        std: f64 = 1.0,
    }
}

fn make(context: &PolicyContext<'_>, args: &PolicyArgs, std: f64) -> Result<Box<dyn Policy>, PolicyError> {
    let settings: Settings = context.config.parse_settings(context.env.id)?;
    let description = if std > 0.0 { format!("{}:std={std}", args.name) } else { args.name.clone() };
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let mut state = EnvState::new();
        view.snapshot(&mut state)?;
        Ok(Box::new(Expert { zones: saved_zones(&settings, &state)?, std }) as Box<dyn Actor>)
    })))
}

/// The expert in one episode.
struct Expert {
    zones: Zones,
    std: f64,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let position = |field: &str| -> Result<[f32; 2], PolicyError> {
            let values: &[f32] = view.row.get(field)?;
            Ok([values[0], values[1]])
        };
        let (agent, target) = (position("state")?, position("goal_state")?);
        let bias = self.zones.bias(agent);
        let mut chosen: [f64; 2] = std::array::from_fn(|axis| {
            f64::from((target[axis] - agent[axis] - bias[axis]) / self.zones.speed)
        });
        add_noise(view, "policy expert noise", self.std, &mut chosen);
        write_action(&mut action, &chosen.map(|value| (value as f32).clamp(-1.0, 1.0)));
        Ok(())
    }
}
