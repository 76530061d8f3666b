//! `--vary` and `--set`: which factors of variation are sampled, which are set. What they mean is a request's.

use clap::Args;
use serde_json::{Map, Value as Json};

use super::args::assignment;
use super::{Failure, Output};

/// Which factors vary, which are set.
#[derive(Args, Clone)]
pub(super) struct ScenarioArgs {
    /// Factors to sample per episode: names, groups, `*.color` (in every group), `default`, `all` or `none`, separated by commas.
    /// `+NAME` samples it in addition to the environment's default factors, mostly starts and goals. Without --vary: the default
    /// factors.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(super) vary: Option<Vec<String>>,
    /// A factor to set, `NAME=VALUE` (numbers separated by commas); may be repeated. Colors also as `#ff0000` or `red`, choices
    /// by name, as in `block.shape=T`.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
}

impl ScenarioArgs {
    /// The values of `--set` as a request has them.
    pub(super) fn set(&self, output: &Output) -> Result<Map<String, Json>, Failure> {
        set(&self.set, output)
    }
}

/// Reads `--set NAME=VALUE` options.
pub(super) fn set(options: &[String], output: &Output) -> Result<Map<String, Json>, Failure> {
    let mut values = Map::new();
    for option in options {
        let (name, text) = assignment(option, "--set")?;
        if values.insert(name.to_owned(), text.into()).is_some() {
            output.note(format!("note: --set {option} replaces the earlier --set of `{name}`"));
        }
    }
    Ok(values)
}
