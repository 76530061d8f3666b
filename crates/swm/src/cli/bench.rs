//! `swm bench`: steps per second on this machine.

use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;
use swm_core::error::BoxError;
use swm_core::{EpisodeEnd, ImageSize, LiveStep, Recorder, Registry, Rollout, World, WorldOptions};

use super::args::{EnvArgs, policy_args};
use super::output::table;
use super::{Failure, Output, usage};

/// Measure steps per second, with and without images, by number of threads.
#[derive(Args)]
#[command(after_help = "Examples:\n  swm bench swm/PushT-v1\n  swm bench swm/PushT-v1 --seconds 5 --json")]
pub(super) struct Bench {
    #[command(flatten)]
    env: EnvArgs,
    /// The policy, as for `swm eval`; its time counts.
    #[arg(long, default_value = "random")]
    policy: String,
    /// Seconds per measurement.
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
}

/// One measurement.
#[derive(Serialize)]
struct Measurement {
    env: String,
    threads: usize,
    num_envs: usize,
    /// Whether images were rendered.
    pixels: bool,
    /// Their size and style, `64x64 exact`; empty without images.
    image: String,
    steps_per_second: f64,
}

/// Size and style of the images measured.
const IMAGES: [Option<(usize, &str)>; 5] =
    [None, Some((64, "exact")), Some((224, "exact")), Some((64, "fast")), Some((224, "fast"))];

impl Bench {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        if !(self.seconds > 0.0 && self.seconds <= 3600.0) {
            return Err(usage(format!("--seconds {}: use a number above 0, at most 3600", self.seconds)));
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let mut layouts = vec![(1, 1), (1, 8)];
        layouts.extend((cores > 1).then_some((cores, 8.max(cores))));
        let bar = output.bar((IMAGES.len() * layouts.len()) as u64, "measurements");
        let mut list = Vec::new();
        for image in IMAGES {
            for &(threads, num_envs) in &layouts {
                list.push(self.measure(registry, image, threads, num_envs)?);
                bar.inc(1);
            }
        }
        bar.finish_and_clear();
        output.result(&list, || {
            let row = |m: &Measurement| {
                let image = if m.pixels { m.image.clone() } else { "none".to_owned() };
                let rate = format!("{:.0}", m.steps_per_second);
                vec![image, m.threads.to_string(), m.num_envs.to_string(), rate]
            };
            let rows = list.iter().map(row);
            table(&["images", "threads", "environments", "steps per second"], rows)
        })
    }

    fn measure(
        &self,
        registry: &Registry,
        image: Option<(usize, &str)>,
        threads: usize,
        num_envs: usize,
    ) -> Result<Measurement, Failure> {
        let entry = self.env.entry(registry)?;
        let mut config = self.env.config(image.map(|(side, _)| ImageSize { height: side, width: side }))?;
        let has_styles = entry.settings.iter().any(|setting| setting.name == "render");
        if let Some((_, style)) = image.filter(|_| has_styles) {
            config.settings.insert("render".to_owned(), style.into());
        }
        let options = WorldOptions::new(num_envs).env(config).threads(threads);
        let mut world = World::new(entry, options)?;
        world.set_policy(registry.policy_from(&policy_args(registry, &self.policy)?, &world)?)?;
        let mut watch = Stopwatch::new(Duration::from_secs_f64(self.seconds));
        let rollout = Rollout::new(0..u64::MAX);
        if let Err(error) = world.run(&rollout, &mut watch)
            && !watch.finished()
        {
            return Err(error.into());
        }
        Ok(Measurement {
            env: entry.id.to_owned(),
            threads,
            num_envs,
            pixels: image.is_some(),
            image: image.map(|(side, style)| format!("{side}x{side} {style}")).unwrap_or_default(),
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

    fn finished(&self) -> bool {
        self.elapsed.is_some()
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
