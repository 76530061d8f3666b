//! Options of opening a dataset of another program. Three groups, each in the next one, as some commands have an environment or a
//! `--split` of their own.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;
use swm_data::{Channels, Flip, OpenOptions};

use super::Failure;
use super::args::{assignment, assignments, json_value};
#[cfg(feature = "baselines")]
use super::usage;

/// What becomes of the columns of a dataset of another program.
#[derive(Args, Clone, Default)]
#[command(next_help_heading = "Datasets of other programs")]
pub(super) struct ColumnArgs {
    /// Name a column NEW; OLD is its name in the files, or the one that `swm inspect` lists. May be repeated.
    #[arg(long = "map", value_name = "NEW=OLD")]
    map: Vec<String>,
    /// The camera whose images become `pixels`.
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// Turn images over: `vertical`, or `180` by half a turn.
    #[arg(long, value_name = "HOW")]
    flip: Option<Flip>,
    /// The order of channels in which images were given to OpenCV, which encoded them (ALOHA): `rgb` or `bgr`.
    #[arg(long, value_name = "ORDER")]
    channels: Option<Channels>,
    /// Whether observations of a row are those after its action (1) or before it (0), where a file of LIBERO does not show it.
    #[arg(long, value_name = "0|1", value_parser = clap::value_parser!(u8).range(0..=1))]
    shift: Option<u8>,
    /// A folder for decoded values of compressed archives that are too large for memory.
    #[arg(long, value_name = "FOLDER")]
    storage: Option<PathBuf>,
}

/// How a dataset of another program is opened, for commands that name an environment.
#[derive(Args, Clone, Default)]
#[command(next_help_heading = "Datasets of other programs")]
pub(super) struct DataArgs {
    #[command(flatten)]
    columns: ColumnArgs,
    /// A part of the dataset, such as `val`.
    #[arg(long = "split", value_name = "NAME")]
    part: Option<String>,
    /// Rows of an episode that ran into its time limit, where a file of D4RL does not mark these.
    #[arg(long, value_name = "N")]
    max_steps: Option<usize>,
}

/// How a dataset of another program is opened (docs/datasets.md).
#[derive(Args, Clone, Default)]
#[command(next_help_heading = "Datasets of other programs")]
pub(super) struct OpenArgs {
    #[command(flatten)]
    data: DataArgs,
    /// The id of the environment that the episodes are of.
    #[arg(long, value_name = "ID")]
    env: Option<String>,
    /// A setting of that environment. May be repeated.
    #[arg(long = "env-option", value_name = "NAME=VALUE", requires = "env")]
    env_options: Vec<String>,
}

impl ColumnArgs {
    pub(super) fn options(&self) -> Result<OpenOptions, Failure> {
        let pair = |pair| assignment(pair, "--map").map(|(new, old)| (new.to_owned(), old.to_owned()));
        let map: BTreeMap<_, _> = self.map.iter().map(|text| pair(text)).collect::<Result<_, _>>()?;
        let options = OpenOptions::default().map(map).camera(self.camera.clone()).flip(self.flip);
        Ok(options.channels(self.channels).shift(self.shift).storage(self.storage.clone()))
    }
}

impl DataArgs {
    pub(super) fn options(&self) -> Result<OpenOptions, Failure> {
        Ok(self.columns.options()?.split(self.part.clone()).max_steps(self.max_steps))
    }

    /// As [`DataArgs::options`], of a dataset that may not be named.
    #[cfg(feature = "baselines")]
    pub(super) fn options_of(&self, dataset: Option<&PathBuf>) -> Result<OpenOptions, Failure> {
        let options = self.options()?;
        match (dataset, options.given().first()) {
            (None, Some(option)) => {
                let option = option.replace('_', "-");
                Err(usage(format!(
                    "--{option}: it is about a dataset, and none is named; give --dataset, or leave it out"
                )))
            }
            _ => Ok(options),
        }
    }
}

impl OpenArgs {
    pub(super) fn options(&self) -> Result<OpenOptions, Failure> {
        let env_options = assignments(&self.env_options, "--env-option", json_value)?;
        Ok(self.data.options()?.env(self.env.clone()).env_options(env_options))
    }
}
