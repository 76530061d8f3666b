//! How many steps of an environment this machine makes in a second.

use std::time::{Duration, Instant};

use serde::Serialize;
use serde_json::{Map, Value as Json};
use swm_core::error::BoxError;
use swm_core::{
    EnvConfig, EpisodeEnd, ImageSize, LiveStep, Recorder, Registry, Rollout, World, WorldOptions,
};

use super::{Message, Report, Request, Stage, TaskError, apart, must_be_given, policy_args};

/// The longest measurement, in seconds.
const MAX_SECONDS: f64 = 3600.0;

swm_core::settings! {
    /// Measure steps per second, with and without images, by number of threads.
    pub struct Bench {
        /// The environment's id.
        env: String = String::new() => "must be given",
        /// Settings of the environment, by name.
        env_option: Map<String, Json> = Map::new() => "none",
        /// The policy, whose time counts: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE.
        policy: String = "random".to_owned() => "random",
        /// Seconds of each measurement.
        seconds: f64 = 1.0,
    }
}

/// One measurement.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct Throughput {
    /// The environment's id.
    pub env: String,
    /// Threads that step it.
    pub threads: usize,
    /// Environments that are stepped in parallel.
    pub num_envs: usize,
    /// Whether images were rendered.
    pub pixels: bool,
    /// Their size and style, `64x64 exact`; empty without images.
    pub image: String,
    /// Steps per second, of all environments together.
    pub steps_per_second: f64,
}

/// Images of a measurement.
type Image = (ImageSize, &'static str);

/// Side and style of the images measured.
const IMAGES: [Option<(usize, &str)>; 5] =
    [None, Some((64, "exact")), Some((224, "exact")), Some((64, "fast")), Some((224, "fast"))];

impl Request for Bench {
    const NAME: &'static str = "bench";
    type Outcome = Vec<Throughput>;

    fn check(&self, registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("env", self.env.is_empty())])?;
        if !(self.seconds > 0.0 && self.seconds <= MAX_SECONDS) {
            let range = format!("use a number above 0, at most {MAX_SECONDS}");
            return Err(Message::about("seconds", self.seconds, range).into());
        }
        Ok(registry.env(&self.env).map(drop)?)
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<Vec<Throughput>, TaskError> {
        self.check(registry)?;
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let mut layouts = vec![(1, 1), (1, 8)];
        layouts.extend((cores > 1).then_some((cores, 8.max(cores))));
        let total = (IMAGES.len() * layouts.len()) as u64;
        let stage = Stage { name: &self.env, role: None, unit: "measurements", total };
        let progress = report.begin(&stage)?;
        let mut measured = Vec::new();
        for image in IMAGES {
            let image = image.map(|(side, style)| (ImageSize { height: side, width: side }, style));
            for &(threads, num_envs) in &layouts {
                measured.push(self.measure(registry, image, [threads, num_envs], report)?);
                progress.done(None);
            }
        }
        Ok(measured)
    }
}

impl Bench {
    fn measure(
        &self,
        registry: &Registry,
        image: Option<Image>,
        [threads, num_envs]: [usize; 2],
        report: &mut dyn Report,
    ) -> Result<Throughput, TaskError> {
        let entry = registry.env(&self.env)?;
        let mut config = EnvConfig { image: image.map(|(size, _)| size), settings: self.env_option.clone() };
        let has_styles = entry.settings.iter().any(|setting| setting.name == "render");
        if let Some((_, style)) = image.filter(|_| has_styles) {
            config.settings.insert("render".to_owned(), style.into());
        }
        let mut world = World::new(entry, WorldOptions::new(num_envs).env(config).threads(threads))?;
        world.set_policy(registry.policy_from(&policy_args(registry, &self.policy)?, &world)?)?;
        let mut watch = Stopwatch::new(Duration::from_secs_f64(self.seconds));
        let rollout = Rollout::new(0..u64::MAX).cancel(report.cancel());
        let ran = apart(report, || world.run(&rollout, &mut watch))?;
        match (ran, watch.elapsed) {
            (_, Some(_)) | (Ok(_), None) => {}
            (Err(error), None) => return Err(error.into()),
        }
        Ok(Throughput {
            env: entry.id.to_owned(),
            threads,
            num_envs,
            pixels: image.is_some(),
            image: image.map(|(size, style)| format!("{size} {style}")).unwrap_or_default(),
            steps_per_second: watch.rate(),
        })
    }
}

/// Counts steps for a while, then ends the run.
struct Stopwatch {
    limit: Duration,
    started: Instant,
    steps: u64,
    elapsed: Option<Duration>,
}

impl Stopwatch {
    fn new(limit: Duration) -> Self {
        Self { limit, started: Instant::now(), steps: 0, elapsed: None }
    }

    fn rate(&self) -> f64 {
        self.steps as f64 / self.elapsed.unwrap_or(self.limit).as_secs_f64()
    }
}

impl Recorder for Stopwatch {
    fn step(&mut self, row: &LiveStep<'_>) -> Result<(), BoxError> {
        self.steps += u64::from(row.episode.step > 0);
        // Reading the clock at every step would be measured too.
        if self.steps > 0 && self.steps.is_multiple_of(64) && self.started.elapsed() >= self.limit {
            self.elapsed = Some(self.started.elapsed());
            return Err("the measurement is over".into());
        }
        Ok(())
    }

    fn episode(&mut self, _end: &EpisodeEnd) -> Result<(), BoxError> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use swm_core::testing::TOY;

    use super::*;

    #[test]
    fn steps_are_counted_with_and_without_images_and_every_refusal_names_its_setting() {
        let registry = Registry::new().with(&[TOY]);
        let ask = |given: &Json| {
            Bench::from_json(given.as_object().unwrap()).and_then(|asked| asked.run(&registry, &mut ()))
        };
        let found = ask(&json!({ "env": TOY.id, "seconds": 0.01 })).unwrap();
        assert!(found.len() >= 10 && found.iter().all(|measured| measured.steps_per_second > 0.0));
        assert_eq!(found.iter().filter(|measured| !measured.pixels).count() * IMAGES.len(), found.len());
        for (given, text) in [
            (json!({}), "env: must be given"),
            (json!({ "env": "swm/Toi-v0" }), "swm/Toi-v0"),
            (json!({ "env": TOY.id, "seconds": 0 }), "seconds=0.0: use a number above 0, at most 3600"),
            (json!({ "env": TOY.id, "seconds": 3601 }), "at most 3600"),
            (json!({ "env": TOY.id, "policy": "nobody" }), "nobody"),
            (json!({ "env": TOY.id, "second": 1 }), "second"),
        ] {
            let error = ask(&given).unwrap_err().to_string();
            assert!(error.contains(text), "{text}: {error}");
        }
    }
}
