//! `swm quality`: a world model, evaluated without control.

use std::path::PathBuf;
use std::sync::LazyLock;

use clap::Args;
use swm_core::{Cancel, Registry};
use swm_tasks::request::{ImageChoice, Measure, Request as _};

use super::args::{EnvArgs, ImageArg};
use super::opening::DataArgs;
use super::output::{compact, table};
use super::reporter::Reporter;
use super::threads::ThreadsArg;
use super::{Failure, Output};
use crate::evaluation::{GateCheck, ProbeScore, Quality};

/// The defaults of a request, for help and for what is not given.
static DEFAULT: LazyLock<Measure> = LazyLock::new(Measure::default);

/// Evaluate a world model without control: open-loop prediction, probes of the state, ranking of plans, violation of expectation.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm quality swm/TwoRoom-v2 --violation teleport
  swm quality swm/PushT-v1 --model gain=0.8 --violation teleport --violation state[2,3]=-500,-500 --violation block.color
  swm quality swm/PushT-v1 --model pixels=8 --image-size 64 --episodes 100 --probe state
  swm quality swm/PushT-v1 --dataset pusht.h5 --episodes 200 --rows 100 --model constant --json
  swm quality swm/TwoRoom-v1 --dataset two-room.h5 --model lewm:runs/lewm   (of `swm train`, in builds with baselines)

Models that need no training are for comparison: `true` (the environment in its standardized state space), `gain=G` (the same with actions \
multiplied by G), `constant` (nothing ever changes), and `pixels=C` (the image in C × C cells, and nothing ever changes). \
World models that a plugin registers are measured by their names. \
Trained ones are `lewm:RUN`, `pldm:RUN`, `conv-jepa:RUN`, `dino-wm:RUN`, `keypoint-wm:RUN` (`checkpoint=best` behind a comma), which predict as many steps at a \
time as the frame skip that they were trained with. \
Probes predict columns of the true state from latents: a linear one and a small MLP, fitted to four fifths of the episodes and \
scored on the others. Gate: R² of at least 0.8 over all probes and a rank correlation of at least 0.85; below it, do not expect plans on the model to work. A violation is `teleport`, COLUMN[ELEMENTS]=VALUES for something that \
jumps or vanishes, or the name of a factor, which changes. An accuracy of 0.5 is chance.")]
pub(super) struct QualityCommand {
    #[command(flatten)]
    env: EnvArgs,
    /// The model: true, constant, gain=G, pixels=C, or a trained one: lewm:RUN.
    #[arg(long, default_value = DEFAULT.model.as_str())]
    model: String,
    /// Take the episodes for prediction and probes from this dataset. Without it, they are simulated with random actions.
    #[arg(long, value_name = "FILE")]
    dataset: Option<PathBuf>,
    /// Size of the images that the model sees, or `none`. Default: that of its training, the dataset's, or none.
    #[arg(long)]
    image_size: Option<ImageArg>,
    /// What to probe latents for: COLUMN, COLUMN[0,1] or angle(COLUMN[4]); may be repeated. Default: what the moderate
    /// tier's test of success reads, else the environment's start columns; `none`: no probes.
    #[arg(long = "probe", value_name = "COLUMN")]
    probes: Vec<String>,
    /// An impossible event; may be repeated.
    #[arg(long = "violation", value_name = "WHAT", default_values_t = DEFAULT.violation.clone())]
    violations: Vec<String>,
    /// Episodes; also pairs per violation and, up to 50, starts of the ranking. Probes need 100 or more episodes where what they
    /// predict changes little within one.
    #[arg(long, default_value_t = DEFAULT.episodes)]
    episodes: usize,
    /// Steps per episode; of recorded ones the first.
    #[arg(long, default_value_t = DEFAULT.rows)]
    rows: usize,
    /// Steps of open-loop prediction, and actions of a plan.
    #[arg(long, default_value_t = DEFAULT.horizon)]
    horizon: usize,
    /// Plans per start. Each follows the recorded actions up to some step and takes random ones after it.
    #[arg(long, default_value_t = DEFAULT.plans)]
    plans: usize,
    /// Seed of episodes, plans and probes.
    #[arg(long, default_value_t = DEFAULT.seed)]
    seed: u64,
    #[command(flatten)]
    opening: DataArgs,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl QualityCommand {
    /// What is asked for.
    fn request(&self, registry: &Registry) -> Result<Measure, Failure> {
        let (env, env_option) = self.env.named(registry)?;
        Ok(Measure {
            env,
            env_option,
            model: self.model.clone(),
            dataset: self.dataset.clone(),
            opening: self.opening.options()?,
            image_size: self.image_size.map(|size| ImageChoice(size.0)),
            probe: self.probes.clone(),
            violation: self.violations.clone(),
            episodes: self.episodes,
            rows: self.rows,
            horizon: self.horizon,
            plans: self.plans,
            seed: self.seed,
            threads: self.threads.count(),
        })
    }

    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let request = self.request(registry)?;
        let found = request.run(registry, &mut Reporter::new(output, Cancel::new()))?;
        output.result(&found, || text(&request.env, &request.model, &found))
    }
}

fn text(env: &str, model: &str, found: &Quality) -> String {
    let mut text = format!("{env}, model `{model}`\n\n");
    text += &diagnosis(found);
    let probes = found.probes.iter().map(|probed| {
        let none = || ["–", "–"].map(str::to_owned);
        let [line, line_correlation] = probed.linear.as_ref().map_or_else(none, shown);
        let [network, network_correlation] = shown(&probed.network);
        vec![probed.column.clone(), line, line_correlation, network, network_correlation]
    });
    if !found.probes.is_empty() {
        let head =
            ["probed column", "linear: unexplained", "correlation", "network: unexplained", "correlation"];
        text += "\n";
        text += &table(&head, probes);
    }
    let rows = found.violations.iter().map(|violation| {
        let [possible, impossible] = violation.surprise.map(compact);
        let accuracy = violation.accuracy.map_or("–".to_owned(), |accuracy| format!("{accuracy:.2}"));
        vec![violation.name.clone(), accuracy, possible, impossible]
    });
    text + "\n" + &table(&["violation", "accuracy", "surprise if possible", "if impossible"], rows)
}

/// The gate, then errors of prediction: what is asked before a plan is made.
fn diagnosis(found: &Quality) -> String {
    let check = |check: &GateCheck| {
        let found = check.found.map_or("–".to_owned(), |found| format!("{found:.3}"));
        let passes = if check.passes { "passes" } else { "fails" };
        vec![check.name.clone(), found, format!("{} or more: {passes}", check.least)]
    };
    let errors = (1..).zip(&found.open_loop_error).map(|(step, error): (usize, _)| {
        let share = found.open_loop_unexplained.get(step - 1);
        let share = share.map_or("–".to_owned(), |share| format!("{share:.3}"));
        vec![(step * found.stride).to_string(), compact(*error), share]
    });
    let gate = found.gate.iter().map(check);
    let (passed, all) = (found.gate.iter().filter(|check| check.passes).count(), found.gate.len());
    let verdict = match all {
        0 => String::new(),
        _ => format!(
            "{}\n{passed} of {all} requirements of the gate are met\n\n",
            table(&["measure", "result", "gate"], gate)
        ),
    };
    verdict + &table(&["steps ahead", "squared error", "of the variance"], errors)
}

/// Unexplained share of the variance, and mean correlation.
fn shown(score: &ProbeScore) -> [String; 2] {
    [score.unexplained, score.mean_correlation()]
        .map(|number| number.map_or("–".to_owned(), |number| format!("{number:.4}")))
}
