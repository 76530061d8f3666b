//! `swm eval`: how often does a policy reach the goal?

use std::path::{Path, PathBuf};

use clap::Args;
use swm_core::error::BoxError;
use swm_core::{
    EpisodeEnd, EvalOptions, Evaluation, ImageSize, LiveRow, Recorder, Registry, Rollout, Scenario, World,
};

use super::args::{EnvArgs, ImageArg, ScenarioArgs, WorldArgs};
use super::output::table;
use super::{Failure, Output, policies, usage};
use crate::film::Film;
use crate::report::write_report;

/// Actions allowed per episode: online, and from goals of a dataset (the reference's).
const BUDGET_ONLINE: u64 = 200;
const BUDGET_DATASET: u64 = 50;

/// Evaluate a policy online, or from starts and goals of a dataset.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm eval swm/PushT-v1 --policy expert --episodes 100 --seed 42
  swm eval swm/PushT-v1 --policy cem:samples=300,iterations=30,elites=30 --dataset pusht.h5 --goal-offset 25 --budget 50 --out results
  swm eval swm/PushT-v1 --policy expert --episodes 50 --vary all --json

With --out, the folder gets result.json, a contact sheet (episodes.png) and a film per filmed episode.")]
pub(super) struct Eval {
    #[command(flatten)]
    env: EnvArgs,
    /// The policy: NAME, NAME:VALUE, NAME:KEY=VALUE,… or NAME:@FILE; `swm envs ENV` lists them.
    #[arg(long)]
    policy: String,
    /// Episodes to evaluate.
    #[arg(long, default_value_t = 50)]
    episodes: u64,
    /// Seed of starts, goals and policy.
    #[arg(long, default_value_t = 42)]
    seed: u64,
    /// Take starts and goals from this dataset.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// With --dataset: the goal is this many rows after the start.
    #[arg(long, default_value_t = 25, requires = "dataset")]
    goal_offset: usize,
    /// Actions allowed per episode. Default: 200, or 50 with --dataset.
    #[arg(long)]
    budget: Option<u64>,
    #[command(flatten)]
    world: WorldArgs,
    #[command(flatten)]
    scenario: ScenarioArgs,
    /// A folder for result.json, pictures and films.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// With --out: episodes to film.
    #[arg(long, default_value_t = 4)]
    films: u64,
    /// With --out: kind of film, `mp4` or `gif`.
    #[arg(long, default_value = "mp4", value_parser = ["mp4", "gif"])]
    film_format: String,
    /// Picture size. Default: 128x128 with --out, else none.
    #[arg(long)]
    image_size: Option<ImageArg>,
}

impl Eval {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        if self.episodes == 0 {
            return Err(usage("0 episodes asked for; use 1 or more"));
        }
        let entry = self.env.entry(registry)?;
        let filmed = self.out.as_ref().map(|_| ImageSize { height: 128, width: 128 });
        let config = self.env.config(self.image_size.map_or(filmed, |size| size.0))?;
        let policy = policies::make(registry, entry, &config, self.world.frame_skip, &self.policy)?;
        let budget =
            self.budget.unwrap_or(if self.dataset.is_some() { BUDGET_DATASET } else { BUDGET_ONLINE });
        if let Some(dir) = &self.out {
            std::fs::create_dir_all(dir)
                .map_err(|error| usage(format!("cannot make the folder {}: {error}", dir.display())))?;
        }
        let mut world = World::new(entry, self.world.options(config, budget))?;
        world.set_policy(policy);
        let bar = output.bar(self.episodes, "episodes");
        let mut film = Film::first(if self.out.is_some() { self.films } else { 0 });
        let mut watch = (&mut film, Progress { bar: bar.clone(), successes: 0 });
        let evaluation = match &self.dataset {
            None => {
                let options = self.scenario.options()?;
                let scenario = Scenario::Same(&options);
                world.evaluate(
                    &Rollout { episodes: 0..self.episodes, seed: self.seed, scenario },
                    &mut watch,
                )?
            }
            Some(path) => {
                let mut dataset = swm_data::open(path)?;
                let options = EvalOptions {
                    episodes: usize::try_from(self.episodes)?,
                    goal_offset: self.goal_offset,
                    budget,
                    seed: self.seed,
                    variation: self.scenario.variation().unwrap_or_default(),
                    variation_values: self.scenario.values()?,
                };
                world.evaluate_from_dataset(dataset.as_mut(), &options, &mut watch)?
            }
        };
        bar.finish_and_clear();
        let written = match &self.out {
            Some(dir) => write_report(dir, &evaluation, &film, &self.film_format)?,
            None => Vec::new(),
        };
        output.result(&evaluation, || text(&evaluation, &written))
    }
}

/// A short summary for people.
fn text(evaluation: &Evaluation, written: &[PathBuf]) -> String {
    let [low, high] = evaluation.ci95;
    let won = evaluation.episode_successes.iter().filter(|&&success| success).count();
    let steps = evaluation.mean_success_steps.map_or("–".to_owned(), |steps| format!("{steps:.1}"));
    let rows = vec![
        vec![
            "success".to_owned(),
            format!("{:.1} % ({won} of {})", evaluation.success_rate, evaluation.episodes),
        ],
        vec!["95 % interval".to_owned(), format!("{low:.1} to {high:.1} %")],
        vec!["mean steps to success".to_owned(), steps],
        vec!["solved at the start".to_owned(), evaluation.solved_at_start.to_string()],
        vec!["policy".to_owned(), evaluation.setup.policy.clone()],
        vec!["environment".to_owned(), evaluation.setup.env.clone()],
        vec!["wall time".to_owned(), format!("{:.1} s", evaluation.wall_time_s)],
    ];
    let files = written.iter().map(|path| format!("{}\n", Path::display(path)));
    format!("{}{}", table(&["result", ""], &rows), files.collect::<String>())
}

struct Progress {
    bar: indicatif::ProgressBar,
    successes: u64,
}

impl Recorder for Progress {
    fn step(&mut self, _row: &LiveRow<'_>) -> Result<(), BoxError> {
        Ok(())
    }

    fn episode(&mut self, end: &EpisodeEnd) -> Result<(), BoxError> {
        self.successes += u64::from(end.success == Some(true));
        self.bar.inc(1);
        self.bar.set_message(format!("{} successful", self.successes));
        Ok(())
    }
}
