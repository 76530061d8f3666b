//! `swm checkpoints`: the checkpoints of a training run.

use std::path::PathBuf;

use clap::Args;

/// List the checkpoints of a training run.
#[derive(Args)]
#[command(after_help = "Examples:\n  swm checkpoints runs/lewm\n  swm checkpoints runs/lewm --json")]
pub(super) struct Checkpoints {
    /// The run's folder.
    run: PathBuf,
}

#[cfg(feature = "baselines")]
mod work {
    use serde_json::json;
    use swm_baselines::online::{OnlineConfig, OnlineState, is_online};
    use swm_baselines::train::{Checkpoint, RunConfig, RunFolder, State};
    use swm_baselines::trainer::{failed, short};

    use super::Checkpoints;
    use crate::cli::output::table;
    use crate::cli::{Failure, Output};

    impl Checkpoints {
        pub(in crate::cli) fn run(self, output: &Output) -> Result<(), Failure> {
            let run = RunFolder::open(&self.run).map_err(failed)?;
            if is_online(&run).map_err(failed)? {
                return of_agent(&run, output);
            }
            let config = RunConfig::read(&run).map_err(failed)?;
            let checkpoint = |step: u64| run.checkpoint::<State>(step).map_err(failed);
            let all: Vec<Checkpoint<State>> =
                run.steps().map_err(failed)?.into_iter().map(checkpoint).collect::<Result<_, _>>()?;
            let best = all.last().and_then(|last| last.state.best).map(|(step, _)| step);
            output.result(&json!({ "config": config, "checkpoints": all }), || {
                let loss =
                    |values: &[(String, f64)]| values.first().map_or(String::new(), |(_, loss)| short(*loss));
                let row = |one: &Checkpoint<State>| {
                    let mark = if Some(one.step) == best { "best" } else { "" };
                    vec![
                        one.step.to_string(),
                        loss(&one.state.train),
                        loss(&one.state.validation),
                        mark.to_owned(),
                        run.weights(one.step).display().to_string(),
                    ]
                };
                let rows = all.iter().map(row);
                format!(
                    "{}, preset {}, on {}\n\n{}",
                    config.model_config.baseline,
                    config.model_config.preset,
                    config.data.path.display(),
                    table(&["step", "logged loss", "validation", "", "weights"], rows)
                )
            })
        }
    }

    /// Shows the checkpoints of an online run.
    fn of_agent(run: &RunFolder, output: &Output) -> Result<(), Failure> {
        let config = OnlineConfig::read(run).map_err(failed)?;
        let checkpoint = |step: u64| run.checkpoint::<OnlineState>(step).map_err(failed);
        let all: Vec<Checkpoint<OnlineState>> =
            run.steps().map_err(failed)?.into_iter().map(checkpoint).collect::<Result<_, _>>()?;
        let best = all.last().and_then(|last| last.state.best).map(|(step, _)| step);
        output.result(&json!({ "config": config, "checkpoints": all }), || {
            let row = |one: &Checkpoint<OnlineState>| {
                let mark = if Some(one.step) == best { "best" } else { "" };
                vec![
                    one.step.to_string(),
                    one.state.episodes.to_string(),
                    one.state.evaluation.first().map_or("–".to_owned(), |(_, value)| short(*value)),
                    mark.to_owned(),
                    run.weights(one.step).display().to_string(),
                ]
            };
            let rows = all.iter().map(row);
            let agent = &config.agent;
            let shown = table(&["step", "episodes", "mean return", "", "weights"], rows);
            format!("{}, preset {}, {}\n\n{shown}", agent.agent, agent.preset, config.place())
        })
    }
}
