//! A model that is measured while it trains, as [`Measure`](swm_tasks::request::Measure) does, on episodes that validate.

use swm_core::{Batch, BoxError, Env, EnvConfig, ImageSize, Registry};
use swm_data::adapt::Subset;
use swm_tasks::evaluation::{ProbeTarget, QualityOptions, default_probes, quality, recorded_episodes};
use swm_tasks::request::{Fix, Message, TaskError, open_dataset_with};

use super::failed;
use crate::acting::LatentModel;
use crate::baseline::Baseline;
use crate::train::{DataConfig, Diagnosis, RunConfig, validation_episodes, with_images};

/// Episodes, and steps of each, that are encoded; starts of the ranking, and plans of each. They take some seconds. With 40 episodes
/// of PushT, probes of the true state itself explain 0.84 of its angle's variance, with 100 0.95.
const EPISODES: usize = 120;
const ROWS: usize = 60;
const STARTS: usize = 20;
const PLANS: usize = 32;
/// Most predictions on end, each over the frame skip of the model.
const PREDICTIONS: usize = 5;

/// What is measured, and on what.
pub(super) struct OnTheWay {
    env: Box<dyn Env>,
    recorded: Vec<Batch>,
    probed: Vec<ProbeTarget>,
    options: QualityOptions,
}

impl OnTheWay {
    /// Measurements of a model in the environment of its dataset.
    pub(super) fn of(
        registry: &Registry,
        model: &dyn Baseline,
        config: &RunConfig,
    ) -> Result<Self, TaskError> {
        let RunConfig { data, fit, .. } = config;
        let refused = |text: String, fix: Fix| Message::about_setting("quality_every", text).fix(fix);
        if model.planner().is_none() {
            let text = format!("measures world models, and {} is a policy", model.name());
            return Err(refused(text, Fix::Leave("quality_every")).into());
        }
        let (dataset, input) = (open_dataset_with(registry, &data.path, &data.opening)?, model.input_spec());
        let dataset = with_images(dataset.as_ref(), registry, model.name(), input.image, &data.looks);
        let dataset = dataset.map_err(failed)?;
        let metadata = dataset.metadata().cloned().unwrap_or_default();
        let Some(env) = metadata.known_env() else {
            let text = "the dataset does not say which environment it was recorded in";
            return Err(refused(text.to_owned(), Fix::Leave("quality_every")).into());
        };
        let entry = registry.env(env).map_err(BoxError::from)?;
        let image = Some(ImageSize { height: input.image, width: input.image });
        let config = EnvConfig { image, settings: metadata.settings };
        let env = entry.make(&config).map_err(BoxError::from)?;
        let episodes = validation_episodes(dataset.as_ref(), data.split);
        let episodes = episodes.map_err(|error| Message::new(error.to_string()))?;
        if episodes.len() < 2 {
            let text = format!(
                "measures on episodes that validate, and needs 2 or more: there are {}",
                episodes.len()
            );
            return Err(refused(text, Fix::Reduce(&["split"])).into());
        }
        let mut source = Subset::new(dataset, &episodes).map_err(BoxError::from)?;
        let recorded = recorded_episodes(env.as_ref(), &mut source, EPISODES, ROWS)?;
        let probed = default_probes(env.spec(), &config.settings, &recorded);
        // Episodes may be short; an error is for episodes that go on after it.
        let longest = recorded.iter().map(Batch::rows).max().unwrap_or(0).saturating_sub(1);
        let horizon = PREDICTIONS.min(longest / input.frameskip).max(1) * input.frameskip;
        let options =
            QualityOptions { episodes: 0, starts: STARTS, rows: ROWS, horizon, plans: PLANS, seed: fit.seed };
        Ok(Self { env, recorded, probed, options })
    }
}

impl Diagnosis for OnTheWay {
    fn measure(&mut self, model: &dyn Baseline, data: &DataConfig) -> Result<Vec<(String, f64)>, BoxError> {
        let Some(mut model) = LatentModel::of(model, data) else {
            return Err(format!("{} is no world model; leave quality_every out", model.name()).into());
        };
        let Self { env, recorded, probed, options, .. } = self;
        let found = quality(&mut model, env.as_mut(), recorded, probed, &[], options, |_| Ok(()))?;
        let probes = found
            .probes
            .iter()
            .filter_map(|probed| Some((format!("probe_r2.{}", probed.column), probed.r2()?)));
        let ranking = found.ranking.as_ref().and_then(|ranking| ranking.mean);
        let ranking = ranking.map(|mean| ("rank_correlation".to_owned(), mean));
        let open_loop = (1..).zip(&found.open_loop_unexplained).map(|(prediction, &share): (usize, _)| {
            (format!("open_loop_error.{}", prediction * found.stride), share)
        });
        Ok(probes.chain(ranking).chain(open_loop).collect())
    }
}
