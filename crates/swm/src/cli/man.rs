//! `swm man`: manual pages, one for the program and one for each command.

use std::path::PathBuf;

use clap::{Args, CommandFactory as _};

use super::{Cli, Failure};

/// Write manual pages into a folder.
#[derive(Args)]
#[command(after_help = "Example:\n  swm man ~/.local/share/man/man1 && man swm-collect")]
pub(super) struct Man {
    /// The folder; made if it is missing.
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

impl Man {
    pub(super) fn run(self) -> Result<(), Failure> {
        let failed = |error| format!("cannot write manual pages into {}: {error}", self.folder.display());
        std::fs::create_dir_all(&self.folder).map_err(failed)?;
        clap_mangen::generate_to(Cli::command(), &self.folder).map_err(failed)?;
        Ok(())
    }
}
