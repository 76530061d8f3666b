//! MPPI, model-predictive path integral control: the plan is the mean of its samples, weighted by how cheap they are.
//! The spread of the samples never changes, and control itself costs nothing.
//!
//! Source: Williams et al., *Information-Theoretic Model Predictive Control* (2018), in the variant of the reference's
//! `MPPISolver`: weights are a softmax of minus cost over temperature, of the cheapest samples only.

use serde::{Deserialize, Serialize};
use swm_core::registry::Setting;

use crate::error::PlanError;
use crate::ranges::{check_at_most_samples, check_counts, check_positive};
use crate::sampling::Noise;
use crate::search::{Carried, Episode, Sampler, Search};
use crate::settings::Settings;
use crate::solver::{Problem, SolverConfig};

/// Settings of MPPI. Defaults are the reference's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mppi {
    /// S: candidates per iteration.
    pub samples: usize,
    /// Iterations; 0 returns the initial plan.
    pub iterations: usize,
    /// K: how many of the cheapest candidates have a weight; 0 for all.
    pub elites: usize,
    /// Standard deviation of every number, in all iterations.
    pub sigma: f64,
    /// How much more a candidate must cost to have a weight e times smaller.
    pub temperature: f64,
    /// In what the temperature counts.
    pub temperature_mode: TemperatureMode,
    /// Whether candidates are clipped to the bounds of the actions. The reference does not.
    pub clip: bool,
    /// Whether the cheapest plan ever evaluated is returned instead of the final mean.
    pub return_best: bool,
    /// Seed of the noise, beside that of the episode.
    pub seed: u32,
}

/// In what a temperature counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TemperatureMode {
    /// Units of the cost, as in the reference: what it does depends on the scale of the cost.
    #[default]
    Absolute,
    /// Standard deviations of the costs that have a weight.
    Relative,
}

impl Default for Mppi {
    fn default() -> Self {
        Self {
            samples: 300,
            iterations: 30,
            elites: 30,
            sigma: 1.0,
            temperature: 0.5,
            temperature_mode: TemperatureMode::Absolute,
            clip: false,
            return_best: false,
            seed: 0,
        }
    }
}

impl Settings for Mppi {
    const SETTINGS: &'static [Setting] = &[
        Setting { name: "samples", doc: "candidate plans per iteration", default: "300" },
        Setting { name: "iterations", doc: "rounds of drawing and averaging", default: "30" },
        Setting { name: "elites", doc: "cheapest candidates that have a weight; 0 for all", default: "30" },
        Setting { name: "sigma", doc: "standard deviation of the candidates", default: "1" },
        Setting {
            name: "temperature",
            doc: "extra cost that makes a weight e times smaller",
            default: "0.5",
        },
        Setting {
            name: "temperature_mode",
            doc: "temperature in units of the cost (absolute) or in standard deviations of it (relative)",
            default: "absolute",
        },
        Setting { name: "clip", doc: "clip candidates to the action bounds", default: "false" },
        Setting { name: "return_best", doc: "return the cheapest plan seen, not the mean", default: "false" },
        Setting { name: "seed", doc: "seed of the noise, beside the episode's", default: "0" },
    ];

    fn validate(&self) -> Result<(), PlanError> {
        check_counts(self.samples, self.iterations)?;
        check_at_most_samples(self.elites, self.samples)?;
        check_positive("sigma", self.sigma)?;
        check_positive("temperature", self.temperature)
    }
}

impl SolverConfig for Mppi {
    const NAME: &'static str = "mppi";
    const SUMMARY: &'static str = "path integral control: average samples, the cheaper the heavier";
}

impl Sampler for Mppi {
    fn search(&self) -> Search {
        Search {
            samples: self.samples,
            iterations: self.iterations,
            elites: if self.elites == 0 { self.samples } else { self.elites },
            sigma: self.sigma as f32,
            clip: self.clip,
            return_best: self.return_best,
        }
    }

    fn carried(&self, problem: &Problem<'_>) -> Carried {
        Carried { doubles: problem.plan_size(), ..Carried::default() }
    }

    /// The mean, then mean + spread × noise.
    fn draw(&self, episode: &mut Episode<'_>, candidates: &mut [f32]) {
        let noise = Noise { purpose: Self::NAME, seed: self.seed };
        episode.draw_around_mean(candidates, &noise);
    }

    fn learn(&self, episode: &mut Episode<'_>, candidates: &[f32], costs: &[f64], elites: &[u32]) {
        let cost = |elite: u32| costs[elite as usize];
        let least = cost(elites[0]);
        let temperature = match self.temperature_mode {
            TemperatureMode::Absolute => self.temperature,
            TemperatureMode::Relative => {
                self.temperature * deviation(elites.iter().map(|&elite| cost(elite)))
            }
        };
        let (size, sums) = (episode.mean.len(), &mut *episode.doubles);
        sums.fill(0.0);
        let mut total = 0.0;
        for &elite in elites {
            let excess = cost(elite) - least;
            // Equal costs have equal weights, also where all are equal and a relative temperature is 0.
            let weight = if excess > 0.0 { (-excess / temperature).exp() } else { 1.0 };
            total += weight;
            let candidate = &candidates[elite as usize * size..][..size];
            sums.iter_mut().zip(candidate).for_each(|(sum, &value)| *sum += weight * f64::from(value));
        }
        for (mean, sum) in episode.mean.iter_mut().zip(sums) {
            *mean = (*sum / total) as f32;
        }
    }
}

/// Standard deviation (dividing by the count).
fn deviation(values: impl ExactSizeIterator<Item = f64> + Clone) -> f64 {
    let count = values.len() as f64;
    let mean = values.clone().sum::<f64>() / count;
    (values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / count).sqrt()
}
