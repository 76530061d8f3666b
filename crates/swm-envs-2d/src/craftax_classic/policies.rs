//! The policies of Craftax-Classic: the expert, alone and with random actions in between.

use rand_distr::{Distribution as _, StandardUniform};
use swm_core::policy::write_action;
use swm_core::{
    Actor, EnvState, PerEpisode, Policy, PolicyEntry, PolicyError, Settings as _, SliceMut, SlotView,
};

use super::env::saved_game;
use super::expert::choose;

/// A planner on the true dynamics that collects what is near.
pub(super) const PLANNER: &str =
    "categorical-cem:samples=128,elites=12,iterations=3,horizon=12,receding_horizon=4,action_block=1";

/// `expert`.
pub(super) const EXPERT: PolicyEntry =
    PolicyEntry::new("expert", "goes through the achievements and knows the whole world", |_, args| {
        args.parse_as::<swm_core::registry::NoArgs>()?;
        Ok(make("expert".to_owned(), 0.0))
    });

/// `noisy-expert`.
pub(super) const NOISY_EXPERT: PolicyEntry = PolicyEntry::new(
    "noisy-expert",
    "the expert, with a random action in a share of the steps (`noisy-expert:SHARE`)",
    |_, args| {
        let Noise { share } = args.parse_with("share")?;
        if !(0.0..=1.0).contains(&share) {
            return Err(args.wrong(format!("share {share} must be 0 to 1")));
        }
        Ok(make(format!("{}:share={share}", args.name), share))
    },
)
.settings(Noise::SETTINGS);

swm_core::settings! {
    /// Arguments of the noisy expert. Unknown names are refused.
    struct Noise {
        /// Share of the steps with a uniformly random action, 0 to 1.
        share: f64 = 0.3,
    }
}

fn make(description: String, share: f64) -> Box<dyn Policy> {
    Box::new(PerEpisode::new(description, move |_: &SlotView<'_>| {
        Ok(Box::new(Expert { state: EnvState::new(), share }) as Box<dyn Actor>)
    }))
}

/// The expert in one episode.
struct Expert {
    state: EnvState,
    share: f64,
}

impl Actor for Expert {
    fn act(&mut self, view: &SlotView<'_>, mut action: SliceMut<'_>) -> Result<(), PolicyError> {
        if self.share > 0.0 {
            let mut stream = view.episode.seed.indexed("policy expert noise", [view.episode.step, 0]);
            let random: f64 = StandardUniform.sample(&mut stream);
            if random < self.share {
                view.spec.action.sample_into(&mut stream, action);
                return Ok(());
            }
        }
        view.snapshot(&mut self.state)?;
        let chosen = choose(&saved_game(&view.spec.id, &self.state)?);
        write_action(&mut action, &[chosen as f32]);
        Ok(())
    }
}
