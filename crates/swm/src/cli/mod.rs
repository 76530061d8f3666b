//! The command line of `swm`. A downstream crate gives it its own registry: `swm::cli::main(&registry)`.
//!
//! Results go to stdout (tables, or JSON with `--json`), everything else to stderr. Exit status: 0 done, 1 the work
//! failed or found a difference, 2 the request itself is wrong, 130 interrupted by Ctrl-C; by SIGTERM 75 if the same command
//! continues, else 143.

mod args;
mod bench;
mod board;
mod bundle;
mod checkpoints;
mod collect;
mod compare;
mod conflicts;
mod convert;
#[cfg(test)]
mod default_tests;
mod doctor;
mod envs;
mod eval;
mod export;
mod fetch;
mod import;
mod inspect;
mod interrupt;
mod jobs;
mod looks;
mod man;
mod manifest;
mod new_env;
mod opening;
mod output;
mod plan;
mod preview;
mod program_name;
mod quality;
mod rates;
mod receipt_text;
mod regret;
mod render;
mod replay;
mod report;
mod reporter;
mod reproduce;
mod robustness;
mod scenario;
mod solvers;
mod stats;
mod streams;
mod submit;
mod sweep;
mod table;
mod task;
mod threads;
mod track;
mod train;
#[cfg(feature = "ui")]
mod ui;
mod verify;
mod verify_result;
mod version;
mod words;
mod work;
mod zoo;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use swm_core::Registry;
use swm_tasks::threads::within;

pub use crate::jobs::{Launcher, set_launcher};
pub(crate) use output::{Failure, Output, usage};

/// Reproducible world-model research: environments, datasets, planning, evaluation.
#[derive(Parser)]
#[command(
    name = "swm",
    version,
    propagate_version = true,
    arg_required_else_help = true,
    after_help = "\
Exit status: 0 done, 1 the work failed or found a difference, 2 the request itself is wrong, 130 interrupted by Ctrl-C, 75 stopped \
by SIGTERM and continued by the same command.

Results go to the standard output, progress and messages to the standard error. Every command explains itself: `swm eval --help`."
)]
struct Cli {
    /// Print results as JSON.
    #[arg(long, global = true, display_order = 900)]
    json: bool,
    /// Print no progress and no notes.
    #[arg(long, short, global = true, display_order = 901)]
    quiet: bool,
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Envs(envs::Envs),
    Fovs(envs::Fovs),
    Collect(collect::Collect),
    Inspect(inspect::Inspect),
    Preview(preview::Preview),
    Stats(stats::Stats),
    Verify(verify::Verify),
    Diff(verify::Diff),
    Convert(convert::Convert),
    Merge(convert::Merge),
    Split(convert::Split),
    Replay(replay::Replay),
    Manifest(manifest::ManifestCommand),
    Eval(Box<eval::Eval>),
    Compare(compare::Compare),
    VerifyResult(verify_result::VerifyResult),
    Sweep(sweep::SweepCommand),
    Robustness(robustness::RobustnessCommand),
    Report(report::ReportCommand),
    Bundle(bundle::BundleCommand),
    Board(board::BoardCommand),
    Submit(submit::Submit),
    Jobs(jobs::Jobs),
    Task(task::Task),
    Quality(quality::QualityCommand),
    Train(Box<train::Train>),
    Checkpoints(checkpoints::Checkpoints),
    Import(Box<import::Import>),
    Export(export::Export),
    Fetch(fetch::Fetch),
    Zoo(zoo::Zoo),
    Reproduce(Box<reproduce::ReproduceCommand>),
    Plan(plan::Plan),
    Solvers(solvers::Solvers),
    Render(render::Render),
    Bench(bench::Bench),
    #[cfg(feature = "ui")]
    Ui(ui::Ui),
    Doctor(doctor::Doctor),
    NewEnv(new_env::NewEnv),
    Man(man::Man),
    /// Print a completion script for a shell.
    #[command(
        after_help = "Examples:\n  swm completions bash > ~/.local/share/bash-completion/completions/swm\n  \
                      swm completions fish > ~/.config/fish/completions/swm.fish\n  \
                      swm completions zsh > _swm   (in a folder of zsh's $fpath)"
    )]
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
}

/// Runs the command line of this process.
pub fn main(registry: &Registry) -> ExitCode {
    run(registry, std::env::args_os())
}

/// Runs a command line; the first argument is the program's name.
pub fn run(registry: &Registry, args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let mut args = args.into_iter().peekable();
    program_name::set(args.peek().map(OsString::as_os_str));
    #[cfg(feature = "mujoco")]
    if let Some(home) = swm_envs_mujoco::mujoco::assets::data_folder() {
        swm_tasks::zoo::add_folder(home.join("zoo"));
    }
    // The version names the physics, which may not be installed: known at run time only.
    let parsed = Cli::command().long_version(version::long()).try_get_matches_from(args);
    let parsed = parsed.and_then(|matches| Ok((Cli::from_arg_matches(&matches)?, threads::of(&matches))));
    let (cli, threads) = match parsed {
        Ok(parsed) => parsed,
        Err(error) => {
            let error = conflicts::explained(error);
            output::print_of_clap(&error);
            return ExitCode::from(error.exit_code() as u8);
        }
    };
    let output = Output::new(cli.json, cli.quiet);
    #[cfg(feature = "remote")]
    fetch::watch(&output);
    match within(threads, || run_command(registry, cli.command, &output))
        .unwrap_or_else(|error| Err(error.into()))
    {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) if failure.is_cancelled() => {
            interrupt::say();
            ExitCode::from(interrupt::status())
        }
        Err(failure) => {
            if !failure.is_reported() {
                output::print_to_stderr(&format!("{failure}\n"));
            }
            ExitCode::from(failure.exit_code())
        }
    }
}

fn run_command(registry: &Registry, command: Command, output: &Output) -> Result<(), Failure> {
    match command {
        Command::Envs(command) => command.run(registry, output),
        Command::Fovs(command) => command.run(registry, output),
        Command::Collect(command) => command.run(registry, output),
        Command::Inspect(command) => command.run(registry, output),
        Command::Preview(command) => command.run(registry, output),
        Command::Stats(command) => command.run(registry, output),
        Command::Verify(command) => command.run(registry, output),
        Command::Diff(command) => command.run(registry, output),
        Command::Convert(command) => command.run(registry, output),
        Command::Merge(command) => command.run(registry, output),
        Command::Split(command) => command.run(registry, output),
        Command::Replay(command) => command.run(registry, output),
        Command::Manifest(command) => command.run(registry, output),
        Command::Eval(command) => command.run(registry, output),
        Command::Compare(command) => command.run(output),
        Command::VerifyResult(command) => command.run(registry, output),
        Command::Sweep(command) => command.run(registry, output),
        Command::Robustness(command) => command.run(registry, output),
        Command::Report(command) => command.run(registry, output),
        Command::Bundle(command) => command.run(registry, output),
        Command::Board(command) => command.run(registry, output),
        Command::Submit(command) => command.run(registry, output),
        Command::Jobs(command) => command.run(registry, output),
        Command::Task(command) => command.run(registry, output),
        Command::Quality(command) => command.run(registry, output),
        Command::Train(command) => command.run(registry, output),
        #[cfg(feature = "baselines")]
        Command::Checkpoints(command) => command.run(output),
        #[cfg(feature = "baselines")]
        Command::Import(command) => command.run(registry, output),
        #[cfg(feature = "baselines")]
        Command::Export(command) => command.run(registry, output),
        #[cfg(not(feature = "baselines"))]
        Command::Checkpoints(_) | Command::Import(_) | Command::Export(_) | Command::Reproduce(_) => {
            let (feature, build) = crate::absent::BASELINES;
            Err(usage(format!(
                "this program was built without the feature `{feature}`, which brings it: {build}"
            )))
        }
        Command::Fetch(command) => command.run(output),
        Command::Zoo(command) => command.run(output),
        #[cfg(feature = "baselines")]
        Command::Reproduce(command) => command.run(registry, output),
        Command::Plan(command) => command.run(registry, output),
        Command::Solvers(command) => command.run(registry, output),
        Command::Render(command) => command.run(registry, output),
        Command::Bench(command) => command.run(registry, output),
        #[cfg(feature = "ui")]
        Command::Ui(command) => command.run(registry, output),
        Command::Doctor(command) => command.run(registry, output),
        Command::NewEnv(command) => command.run(output),
        Command::Man(command) => command.run(),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), program_name::name(), &mut script);
            output::print(&String::from_utf8_lossy(&script))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_sound() {
        Cli::command().debug_assert();
    }

    /// A terminal wraps paragraphs; line breaks in them would stay.
    #[test]
    fn paragraphs_of_help_are_lines() {
        fn check(command: &clap::Command) {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let lines: Vec<&str> = help.lines().collect();
            for pair in lines.windows(2) {
                let is_text = |line: &str| !line.is_empty() && !line.starts_with(' ');
                assert!(
                    !(is_text(pair[0]) && is_text(pair[1])),
                    "`swm {}`: a line break in a paragraph: {pair:?}",
                    command.get_name()
                );
            }
            command.get_subcommands().for_each(check);
        }
        check(&Cli::command());
    }

    /// A command, and those below it, with their names.
    fn each(command: &clap::Command, path: &str, look: &mut dyn FnMut(&str, &clap::Command)) {
        let path = format!("{path} {}", command.get_name());
        look(path.trim_start_matches(" swm "), command);
        command.get_subcommands().for_each(|below| each(below, &path, look));
    }

    #[test]
    fn commands_that_divide_work_take_threads() {
        let divide = [
            "collect",
            "preview",
            "stats",
            "verify",
            "convert",
            "merge",
            "split",
            "replay",
            "eval",
            "verify-result",
            "sweep",
            "robustness",
            "report",
            "board",
            "quality",
            "train",
            "plan",
            "render",
            "reproduce",
        ];
        each(&Cli::command(), "", &mut |name, command| {
            let threads = command.get_arguments().any(|argument| argument.get_long() == Some("threads"));
            assert_eq!(threads, divide.contains(&name), "`swm {name}`");
        });
    }

    #[test]
    fn options_of_several_commands_have_one_name_and_form() {
        each(&Cli::command(), "", &mut |name, command| {
            for argument in command.get_arguments() {
                match argument.get_long() {
                    Some("out") => assert_eq!(argument.get_short(), Some('o'), "`swm {name} --out`"),
                    Some(other @ ("data" | "file" | "output" | "num-threads" | "random-seed")) => {
                        panic!("`swm {name} --{other}`: others say --dataset, --out, --threads or --seed")
                    }
                    _ => {}
                }
            }
        });
    }

    #[test]
    fn every_command_has_an_example() {
        for command in Cli::command().get_subcommands() {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            assert!(help.contains("swm "), "`swm {}` has no example in its help", command.get_name());
        }
    }
}
