//! `swm checkpoints` at work, in builds that have baselines.

use serde_json::json;
use swm_baselines::online::is_online;
use swm_baselines::train::{Checkpoint, RunConfig, RunFolder, State};

use super::Checkpoints;
use super::work::{failure, short};
use crate::cli::output::table;
use crate::cli::{Failure, Output};

impl Checkpoints {
    pub(in crate::cli) fn run(self, output: &Output) -> Result<(), Failure> {
        let run = RunFolder::open(&self.run).map_err(failure)?;
        if is_online(&run).map_err(failure)? {
            return super::online::checkpoints(&run, output);
        }
        let config = RunConfig::read(&run).map_err(failure)?;
        let checkpoint = |step: u64| run.checkpoint::<State>(step).map_err(failure);
        let all: Vec<Checkpoint<State>> =
            run.steps().map_err(failure)?.into_iter().map(checkpoint).collect::<Result<_, _>>()?;
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
            let rows: Vec<Vec<String>> = all.iter().map(row).collect();
            format!(
                "{}, preset {}, on {}\n\n{}",
                config.model_config.baseline,
                config.model_config.preset,
                config.data.path.display(),
                table(&["step", "logged loss", "validation", "", "weights"], &rows)
            )
        })
    }
}
