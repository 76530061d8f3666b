//! `swm quality`: how good is a world model, without control?

use clap::Args;
use swm_core::Registry;
use swm_core::evaluate::{StateModel, Violation};

use super::args::EnvArgs;
use super::output::table;
use super::{Failure, Output, usage};
use crate::evaluation::{Quality, QualityOptions, quality};

/// Measure a world model without control: prediction, ranking of plans, surprise.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm quality swm/TwoRoom-v2 --violation teleport
  swm quality swm/PushT-v1 --model gain=0.8 --violation teleport --violation state[2,3]=-500,-500 --violation block.color
  swm quality swm/TwoRoom-v1 --model constant --json

Models that need no training are the yardsticks: `true` (the environment in its state space), `gain=G` (the same with actions
multiplied by G), and `constant` (nothing ever changes). A violation is `teleport`, COLUMN[ELEMENTS]=VALUES for something that
jumps or vanishes, or the name of a factor, which changes. 0.5 of a violation is chance.")]
pub(super) struct QualityCommand {
    #[command(flatten)]
    env: EnvArgs,
    /// The model: true, constant, or gain=G.
    #[arg(long, default_value = "true")]
    model: String,
    /// Something that cannot happen; may be repeated.
    #[arg(long = "violation", value_name = "WHAT", default_value = "teleport")]
    violations: Vec<String>,
    /// Random episodes, pairs per violation, and starts of the ranking.
    #[arg(long, default_value_t = 20)]
    episodes: usize,
    /// Rows of an episode.
    #[arg(long, default_value_t = 30)]
    rows: usize,
    /// Steps of open-loop prediction, and actions of a plan.
    #[arg(long, default_value_t = 10)]
    horizon: usize,
    /// Random plans per start.
    #[arg(long, default_value_t = 64)]
    plans: usize,
    /// Seed of everything.
    #[arg(long, default_value_t = 42)]
    seed: u64,
}

impl QualityCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let Self { episodes, rows, horizon, plans, seed, .. } = self;
        if episodes == 0 || horizon == 0 || plans < 2 || rows <= horizon {
            return Err(usage(
                "at least 1 episode, 2 plans and a horizon of 1 are needed, and more rows than the horizon",
            ));
        }
        let (entry, config) = (self.env.entry(registry)?, self.env.config(None)?);
        let gain = gain(&self.model)?;
        let violations: Vec<(String, Violation)> = self
            .violations
            .iter()
            .map(|text| Ok((text.clone(), violation(text)?)))
            .collect::<Result<_, Failure>>()?;
        let mut model = StateModel::new(entry, &config, gain)?;
        let mut env = (entry.make)(&config)?;
        let options = QualityOptions { episodes, rows, horizon, plans, seed };
        let found = quality(&mut model, env.as_mut(), &violations, &options)?;
        output.result(&found, || text(entry.id, &self.model, &found))
    }
}

/// What actions are multiplied by in a model; none if nothing ever changes.
fn gain(model: &str) -> Result<Option<f64>, Failure> {
    match (model, model.strip_prefix("gain=").map(str::parse::<f64>)) {
        ("true", _) => Ok(Some(1.0)),
        ("constant", _) => Ok(None),
        (_, Some(Ok(gain))) if gain.is_finite() => Ok(Some(gain)),
        _ => Err(usage(format!("--model {model}: there are true, constant and gain=NUMBER"))),
    }
}

fn violation(text: &str) -> Result<Violation, Failure> {
    if text == "teleport" {
        return Ok(Violation::Teleport);
    }
    let Some((left, right)) = text.split_once('=') else {
        return Ok(Violation::Factor { name: text.to_owned() });
    };
    let wrong =
        || usage(format!("--violation {text}: write COLUMN[ELEMENTS]=VALUES, such as state[2,3]=-500,-500"));
    let (column, elements) =
        left.strip_suffix(']').and_then(|left| left.split_once('[')).ok_or_else(wrong)?;
    let elements: Result<Vec<usize>, _> = elements.split(',').map(|number| number.trim().parse()).collect();
    let to: Result<Vec<f64>, _> = right.split(',').map(|number| number.trim().parse()).collect();
    match (elements, to) {
        (Ok(elements), Ok(to)) => Ok(Violation::Set { column: column.to_owned(), elements, to }),
        _ => Err(wrong()),
    }
}

fn text(env: &str, model: &str, found: &Quality) -> String {
    let mut text = format!("{env}, model `{model}`\n\n");
    let errors: Vec<Vec<String>> = (1..)
        .zip(&found.open_loop_error)
        .map(|(step, error): (usize, _)| vec![step.to_string(), format!("{error:.4e}")])
        .collect();
    text += &table(&["steps ahead", "squared error"], &errors);
    if let Some(ranking) = &found.ranking {
        let mean = ranking.mean.map_or("– (a cost is constant)".to_owned(), |mean| format!("{mean:.3}"));
        text += &format!("\nrank correlation of model cost and true cost: {mean}\n");
    }
    let rows: Vec<Vec<String>> = found
        .violations
        .iter()
        .map(|violation| {
            let [possible, impossible] = violation.surprise.map(|surprise| format!("{surprise:.4e}"));
            let accuracy = violation.accuracy.map_or("–".to_owned(), |accuracy| format!("{accuracy:.2}"));
            vec![violation.name.clone(), accuracy, possible, impossible]
        })
        .collect();
    text + "\n" + &table(&["violation", "told apart", "surprise if possible", "if not"], &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_and_violations_are_read() {
        assert_eq!(gain("gain=0.5").ok(), Some(Some(0.5)));
        assert_eq!(gain("constant").ok(), Some(None));
        assert!(gain("gain=x").is_err() && gain("best").is_err());
        let set = Violation::Set { column: "state".to_owned(), elements: vec![2, 3], to: vec![-5.0, 1.5] };
        assert_eq!(violation("state[2,3]=-5,1.5").ok(), Some(set));
        assert_eq!(violation("block.color").ok(), Some(Violation::Factor { name: "block.color".to_owned() }));
        assert!(violation("state=3").is_err() && violation("state[a]=3").is_err());
    }
}
