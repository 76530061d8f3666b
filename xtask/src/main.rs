//! `cargo xtask COMMAND`: everything a contributor or a CI machine runs on this workspace, one file per command.
//!
//! Not part of the product: the command that researchers use is `swm`.

mod api;
mod bindgen;
mod book;
mod cargo_tree;
mod ci;
mod datasets;
mod demo;
mod deny;
mod endure;
mod experts;
mod exports;
mod gallery;
mod golden;
mod gpu;
mod gpu_proof;
mod interop;
mod mcap;
mod memcheck;
mod metadata;
mod onnx;
mod pages;
mod plugin;
mod process;
mod program;
mod proof;
mod python;
mod recipes;
mod reference_tests;
mod release;
mod separate_crates;
mod setup;
mod sizes;
mod test;
mod tidy;
mod ui;
mod wheel;
mod zoo;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

use ci::Tier;

/// Set up, test and check this workspace.
#[derive(Parser)]
#[command(name = "cargo xtask", bin_name = "cargo xtask", after_help = EXAMPLES, disable_help_subcommand = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  cargo xtask demo                      the main job, end to end, into demo-report/
  cargo xtask test                      set up, then run every test
  cargo xtask test -p swm-core seeds    one crate's tests whose name contains `seeds`
  cargo xtask check                     what to run before a commit
  cargo xtask ci --only clippy          one step of what the CI machine runs
  cargo xtask golden --check            replay recorded trajectories of the reference
  cargo xtask tidy                      the layering and source rules, in a second";

#[derive(Subcommand)]
enum Command {
    /// Fetch the build tools that this machine lacks, the physics library and models, pinned by version and hash
    Setup(setup::Args),
    /// Record, plan and evaluate on PushT, and leave a report with images and videos
    Demo(demo::Args),
    /// Make the figures of docs/proof.md and docs/robustness.md again: record, train, evaluate, and write the tables
    Proof(proof::Args),
    /// Train the agents of the policy `learned-expert`, and write their weights; trains for an hour or more
    Experts(experts::Args),
    /// Set up, then run all tests, and the examples in the documentation
    Test(test::Args),
    /// Format, rules, lints and unit tests: in 5 minutes, before a commit
    Check(ci::Args),
    /// What the CI machine runs for each change, in 60 minutes on two cores; prints a table
    Ci(ci::Args),
    /// Every check, with a rehearsed release and each crate alone, in 3 hours
    Nightly(ci::Args),
    /// Load what `swm export` writes with the reference, and compare outputs
    Exports(exports::Args),
    /// Replay recorded trajectories of the reference and print the differences
    Golden(golden::Args),
    /// Render every environment for the page docs/gallery.md
    Gallery(gallery::Args),
    /// Run the tests of the `unsafe` code under valgrind
    Memcheck(memcheck::Args),
    /// Link the command with CUDA from the workspace in gpu/, and ask it for a GPU; builds for many minutes
    Gpu(gpu::Args),
    /// Parity, speed and a training on a GPU, in stages; or a package of all that needs, for a machine without network
    GpuProof(gpu_proof::Args),
    /// Kill recordings, damage files and try hostile ones, thousands of times, for an hour or more
    Endure(endure::Args),
    /// Make the declarations of MuJoCo's C interface anew from its headers
    Bindgen(bindgen::Args),
    /// Record the standard datasets, whole or in parts, with a page and checksums for each
    Datasets(datasets::Args),
    /// Build the book for a browser, into target/book, and follow its links
    Book(book::Args),
    /// Test crates outside of the workspace: a plugin, and one made from the template
    Plugin(plugin::Args),
    /// Write the table of docs/sizes.md: what depending on one crate costs
    Sizes(sizes::Args),
    /// Rehearse a release: packages, archives, bill of materials, checksums; `--execute` tags and publishes
    Release(release::Args),
    /// Make the Python package as a wheel, with MuJoCo's library and the control suite's models
    Wheel(wheel::Args),
    /// Train the models of the zoo by their recipes, and pack them
    Zoo(zoo::Args),
    /// Run the reference's own tests on the Python package, from a checkout of the reference
    ReferenceTests(reference_tests::Args),
    /// Check the rules of the architecture and of the sources
    Tidy(tidy::Args),
    /// Build the page of `swm ui` again, compare it, and open it in a headless Chromium
    Ui(ui::Args),
    /// List the public types that break a downstream crate when they get a field or a variant
    Api(api::Args),
    /// Check the licenses and origins of all dependencies against deny.toml
    Deny(deny::Args),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Setup(args) => setup::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Proof(args) => proof::run(&args),
        Command::Experts(args) => experts::run(&args),
        Command::Test(args) => test::run(&args),
        Command::Memcheck(args) => memcheck::run(&args),
        Command::Endure(args) => endure::run(&args),
        Command::Bindgen(args) => bindgen::run(&args),
        Command::Check(args) => ci::run(Tier::Check, &args),
        Command::Ci(args) => ci::run(Tier::Ci, &args),
        Command::Nightly(args) => ci::run(Tier::Nightly, &args),
        Command::Gpu(args) => gpu::run(&args),
        Command::GpuProof(args) => gpu_proof::run(&args),
        Command::Exports(args) => exports::run(&args),
        Command::Golden(args) => golden::run(&args),
        Command::Gallery(args) => gallery::run(&args),
        Command::Datasets(args) => datasets::run(&args),
        Command::Book(args) => book::run(&args),
        Command::Plugin(args) => plugin::run(&args),
        Command::Sizes(args) => sizes::run(&args),
        Command::Release(args) => release::run(&args),
        Command::Wheel(args) => wheel::run(&args),
        Command::Zoo(args) => zoo::run(&args),
        Command::ReferenceTests(args) => reference_tests::run(&args),
        Command::Tidy(args) => tidy::run(&args),
        Command::Ui(args) => ui::run(&args),
        Command::Api(args) => api::run(&args),
        Command::Deny(args) => deny::run(&args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", process::report(&error));
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    #[test]
    fn the_command_line_is_well_formed() {
        super::Cli::command().debug_assert();
    }
}
