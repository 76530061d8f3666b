//! Arguments of the expert.

use swm_core::settings::Table;
use swm_core::{PolicyArgs, PolicyError, Setting, Settings as _};

swm_core::settings! {
    /// Arguments of the policy. Unknown names are refused.
    pub(super) struct ExpertSettings {
        /// Random primitives tried in a decision.
        samples: usize = 100,
        /// Rounds in which half as many variations of the best are tried.
        refinements: usize = 2,
        /// How many of the best primitives are followed by a second one.
        beams: usize = 4,
        /// How many others are followed by a second one, good or bad.
        detours: usize = 8,
        /// Second primitives tried for each of them.
        beam_samples: usize = 25,
        /// Cost of a radian in pixels, for a block of scale 30.
        angle_weight: f64 = 50.0,
        /// Cost of a control step in pixels.
        step_weight: f64 = 2.0,
        /// Longest way of the agent in a control step, pixels: about 12 for an expert as slow as people.
        ///
        /// A disc goes at most 57 px, a polygon 10: the default limits neither.
        max_step: f64 = 100.0,
        /// 0: the best primitive; above: sampled by the softmax of cost, in pixels, for diverse data.
        temperature: f64 = 0.0,
        /// Standard deviation of the noise on each component, in units of 100 px.
        std: f64 = 0.0,
        /// Control steps after which a new plan is made.
        replan: usize = 1000,
    }
}

/// Defaults of `noisy-expert` where they differ.
const NOISY_STD: f64 = 0.1;
const NOISY_REPLAN: usize = 4;

/// More than this in one decision is a typing error.
const MAX_COUNT: usize = 100_000;
/// No agent goes further in a control step.
const MAX_STEP_PX: f64 = 100.0;

impl ExpertSettings {
    /// Reads the arguments of `expert`.
    pub(super) fn parse(args: &PolicyArgs) -> Result<Self, PolicyError> {
        args.parse_as::<Self>()?.checked(args)
    }

    /// Reads the arguments of `noisy-expert`.
    pub(super) fn parse_noisy(args: &PolicyArgs) -> Result<Self, PolicyError> {
        let mut args = args.clone();
        args.named.entry("std").or_insert(NOISY_STD.into());
        args.named.entry("replan").or_insert(NOISY_REPLAN.into());
        args.parse_with::<Self>("std")?.checked(&args)
    }

    fn checked(self, args: &PolicyArgs) -> Result<Self, PolicyError> {
        let counts = [
            ("samples", self.samples, 1),
            ("refinements", self.refinements, 0),
            ("beams", self.beams, 0),
            ("detours", self.detours, 0),
            ("beam_samples", self.beam_samples, 0),
            ("replan", self.replan, 1),
        ];
        for (name, count, least) in counts {
            if !(least..=MAX_COUNT).contains(&count) {
                return Err(args.wrong(format!("{name} {count} must be {least} to {MAX_COUNT}")));
            }
        }
        let values = [
            ("angle_weight", self.angle_weight),
            ("step_weight", self.step_weight),
            ("temperature", self.temperature),
            ("std", self.std),
        ];
        for (name, value) in values {
            args.check_not_negative(name, value)?;
        }
        if !(1.0..=MAX_STEP_PX).contains(&self.max_step) {
            return Err(args.wrong(format!("max_step {} must be 1 to {MAX_STEP_PX} px", self.max_step)));
        }
        Ok(self)
    }
}

/// The arguments of `expert`, for help.
pub(super) const SETTINGS: &[Setting] = ExpertSettings::SETTINGS;
/// The arguments of `noisy-expert`, for help.
pub(super) const NOISY_SETTINGS: &[Setting] = NOISY.as_slice();
const NOISY: &Table = &Table::of(&[SETTINGS]).with_default("std", "0.1").with_default("replan", "4");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documented_defaults_are_the_defaults() {
        swm_core::testing::assert_documented_defaults::<ExpertSettings>();
        let args = PolicyArgs::parse("noisy-expert").unwrap();
        let settings = ExpertSettings::parse_noisy(&args).unwrap();
        let found = [("std", settings.std.to_string()), ("replan", settings.replan.to_string())];
        for (name, default) in found {
            let documented = NOISY_SETTINGS.iter().find(|setting| setting.name == name).unwrap();
            assert_eq!(documented.default, default);
        }
    }
}
