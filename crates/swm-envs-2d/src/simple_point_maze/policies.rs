//! The expert of SimplePointMaze: takes the shortest way around the walls, with noise if asked.

use swm_core::policy::{add_noise, write_action};
use swm_core::{
    Actor, EnvState, PerEpisode, Policy, PolicyArgs, PolicyContext, PolicyEntry, PolicyError, Settings as _,
    SliceMut, SlotView,
};

use super::env::saved_room;
use super::factors::Factors;
use super::settings::Settings;
use super::walls::{MAX_ACTION, Room};
use crate::ways::Ways;

/// A planner on the true dynamics that finds the goal.
pub(super) const PLANNER: &str =
    "icem:samples=32,elites=4,iterations=2,horizon=6,receding_horizon=1,action_block=2,return_best=true";

/// `expert`.
pub(super) const EXPERT: PolicyEntry =
    PolicyEntry::new("expert", "takes the shortest way around the walls to the goal", |context, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        make(context, args, 0.0)
    });

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
        std: f64 = 0.1,
    }
}

fn make(context: &PolicyContext<'_>, args: &PolicyArgs, std: f64) -> Result<Box<dyn Policy>, PolicyError> {
    let settings: Settings = context.config.parse_settings(context.env.id)?;
    let factors = Factors::new(context.env.id, &settings.init_value)?;
    let description = if std > 0.0 { format!("{}:std={std}", args.name) } else { args.name.clone() };
    Ok(Box::new(PerEpisode::new(description, move |view: &SlotView<'_>| {
        let mut state = EnvState::new();
        view.snapshot(&mut state)?;
        let room = saved_room(&factors.space, &state)?;
        let ways = room.ways(position(view, "goal_state")?);
        Ok(Box::new(Expert { room, ways, std }) as Box<dyn Actor>)
    })))
}

fn position(view: &SlotView<'_>, field: &str) -> Result<[f32; 2], PolicyError> {
    let values: &[f32] = view.row.get(field)?;
    Ok([values[0], values[1]])
}

/// The expert in one episode.
struct Expert {
    room: Room,
    ways: Ways,
    std: f64,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        let agent = position(view, "state")?.map(f64::from);
        let to = self.ways.leg(agent).to;
        let wanted = [0, 1].map(|axis| (to[axis] - agent[axis]) / f64::from(self.room.speed));
        // Straight to the corner: along both axes by the same share of the way.
        let bound = f64::from(MAX_ACTION);
        let excess = wanted.iter().map(|value| value.abs() / bound).fold(1.0, f64::max);
        let mut chosen = wanted.map(|value| value / excess);
        add_noise(view, "policy expert noise", self.std, &mut chosen);
        write_action(&mut action, &chosen.map(|value| value.clamp(-bound, bound) as f32));
        Ok(())
    }
}
