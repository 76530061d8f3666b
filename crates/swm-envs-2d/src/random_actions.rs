//! Random actions in between those of an expert, where actions are discrete and cannot carry normal noise: the policy
//! `noisy-expert:SHARE`.

use rand_distr::{Distribution as _, StandardUniform};
use swm_core::registry::MakePolicy;
use swm_core::{PolicyArgs, PolicyEntry, PolicyError, Settings as _, SliceMut, SlotView};

swm_core::settings! {
    /// Arguments of the noisy expert. Unknown names are refused.
    struct Noise {
        /// Share of the steps with a uniformly random action, 0 to 1.
        share: f64 = 0.3,
    }
}

/// The entry `noisy-expert`; `make` reads its arguments by [`description_and_share`].
pub(crate) const fn noisy_expert(make: MakePolicy) -> PolicyEntry {
    let summary = "the expert, with a random action in a share of the steps (`noisy-expert:SHARE`)";
    PolicyEntry::new("noisy-expert", summary, make).settings(Noise::SETTINGS)
}

/// What the policy of these arguments is called in records, and its share of random actions, 0 to 1.
///
/// # Errors
///
/// An argument is unknown, or the share is not within 0 to 1.
pub(crate) fn description_and_share(args: &PolicyArgs) -> Result<(String, f64), PolicyError> {
    let Noise { share } = args.parse_with("share")?;
    if !(0.0..=1.0).contains(&share) {
        return Err(args.wrong(format!("share {share} must be 0 to 1")));
    }
    Ok((format!("{}:share={share}", args.name), share))
}

/// In a share of the steps, writes a random action and returns `true`. Share 0: nothing is sampled. `purpose` names the random
/// stream of the episode; every step has its own part of it.
pub(crate) fn acts_at_random(
    view: &SlotView<'_>,
    purpose: &str,
    share: f64,
    action: &mut SliceMut<'_>,
) -> bool {
    if share <= 0.0 {
        return false;
    }
    let mut stream = view.episode.seed.indexed(purpose, [view.episode.step, 0]);
    let random: f64 = StandardUniform.sample(&mut stream);
    let is_random = random < share;
    if is_random {
        view.spec.action.sample_into(&mut stream, action.reborrow());
    }
    is_random
}
