//! What can be chosen about the expert.

use serde::{Deserialize, Serialize};
use swm_core::{PolicyArgs, PolicyError, Setting};

/// Arguments of the policy. Unknown names are refused.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ExpertSettings {
    pub(super) samples: usize,
    pub(super) refinements: usize,
    pub(super) beams: usize,
    pub(super) detours: usize,
    pub(super) beam_samples: usize,
    pub(super) angle_weight: f64,
    pub(super) step_weight: f64,
    pub(super) temperature: f64,
    pub(super) std: f64,
    pub(super) replan: usize,
}

impl Default for ExpertSettings {
    fn default() -> Self {
        Self {
            samples: 100,
            refinements: 2,
            beams: 4,
            detours: 8,
            beam_samples: 25,
            angle_weight: 50.0,
            step_weight: 2.0,
            temperature: 0.0,
            std: 0.0,
            replan: 1000,
        }
    }
}

/// What `noisy-expert` has otherwise.
const NOISY_STD: f64 = 0.1;
const NOISY_REPLAN: usize = 4;

/// More than this in one decision is a typing error.
const MAX_COUNT: usize = 100_000;

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
        let numbers = [
            ("angle_weight", self.angle_weight),
            ("step_weight", self.step_weight),
            ("temperature", self.temperature),
            ("std", self.std),
        ];
        for (name, number) in numbers {
            if !(number >= 0.0 && number.is_finite()) {
                return Err(args.wrong(format!("{name} {number} must be 0 or more, and finite")));
            }
        }
        Ok(self)
    }

    /// The policy's name with the settings that are not `expert`'s defaults.
    pub(super) fn describe(&self, name: &str) -> String {
        let [own, default] = [self, &Self::default()].map(serde_json::to_value);
        let (Ok(serde_json::Value::Object(own)), Ok(default)) = (own, default) else {
            return name.to_owned();
        };
        let changed = own.iter().filter(|(key, value)| default[key.as_str()] != **value);
        let settings: Vec<String> = changed.map(|(key, value)| format!("{key}={value}")).collect();
        if settings.is_empty() { name.to_owned() } else { format!("{name}:{}", settings.join(",")) }
    }
}

macro_rules! settings {
    ($std:literal, $replan:literal) => {
        &[
            Setting { name: "samples", doc: "primitives tried at random in a decision", default: "100" },
            Setting {
                name: "refinements",
                doc: "rounds in which half as many variations of the best are tried",
                default: "2",
            },
            Setting { name: "beams", doc: "how many of the best are followed up", default: "4" },
            Setting { name: "detours", doc: "how many others are followed up, good or bad", default: "8" },
            Setting { name: "beam_samples", doc: "second primitives tried for each of them", default: "25" },
            Setting {
                name: "angle_weight",
                doc: "pixels that a radian counts, for a block of scale 30",
                default: "50",
            },
            Setting { name: "step_weight", doc: "pixels that a control step counts", default: "2" },
            Setting {
                name: "temperature",
                doc: "0: the best primitive; above: drawn by the softmax of cost, in pixels, for diverse data",
                default: "0",
            },
            Setting {
                name: "std",
                doc: "standard deviation of the noise on each component, in units of 100 px",
                default: $std,
            },
            Setting { name: "replan", doc: "control steps after which a new plan is made", default: $replan },
        ]
    };
}

/// The arguments of `expert`, for help.
pub(super) const SETTINGS: &[Setting] = settings!("0", "1000");
/// The arguments of `noisy-expert`, for help.
pub(super) const NOISY_SETTINGS: &[Setting] = settings!("0.1", "4");

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_described_with_its_default() {
        let json = serde_json::to_value(ExpertSettings::default()).unwrap();
        for (name, value) in json.as_object().unwrap() {
            let described = SETTINGS.iter().find(|setting| setting.name == name).expect(name);
            assert_eq!(described.default.parse::<f64>().unwrap(), value.as_f64().unwrap(), "{name}");
        }
        assert_eq!(SETTINGS.len(), json.as_object().unwrap().len());
    }
}
