//! `cargo xtask check`, `ci` and `nightly`: the checks that a change must pass, in three tiers with a stated time each, in an
//! order that finds cheap faults first.
//!
//! The steps are a table; a new one is one line in it.

use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};
use clap::builder::PossibleValuesParser;

use crate::{
    book, demo, deny, exports, gpu, interop, mcap, plugin, process, proof, release, separate_crates, setup,
    sizes, test, tidy, ui, wheel,
};

/// Options of the three commands.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Run the remaining steps after one has failed
    #[arg(long)]
    keep_going: bool,
    /// Run only this step, of whichever tier; may be given several times
    #[arg(long, value_name = "STEP", value_parser = PossibleValuesParser::new(STEPS.iter().map(|step| step.name)))]
    only: Vec<String>,
}

/// Which steps run, and how long they may take on two cores with built dependencies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Tier {
    /// Before each commit.
    Check,
    /// For each change: what `.ci/run` calls.
    Ci,
    /// Before a larger piece of work is called done, and before a release: every step.
    Nightly,
}

impl Tier {
    /// The minutes that the steps of a tier should take together, which help and CONTRIBUTING.md name, too.
    const fn minutes(self) -> u64 {
        match self {
            Self::Check => 5,
            Self::Ci => 60,
            Self::Nightly => 180,
        }
    }

    /// The same as a time. It is printed beside the measured one; no step fails by it.
    const fn budget(self) -> Duration {
        Duration::from_secs(60 * self.minutes())
    }
}

/// One line of the table.
struct Step {
    name: &'static str,
    about: &'static str,
    tiers: &'static [Tier],
    run: fn() -> Result<()>,
}

const EVERY: &[Tier] = &[Tier::Check, Tier::Ci, Tier::Nightly];
const CI: &[Tier] = &[Tier::Ci, Tier::Nightly];
const NIGHTLY: &[Tier] = &[Tier::Nightly];

const STEPS: &[Step] = &[
    Step {
        name: "setup",
        about: "build tools, physics library and models are there",
        tiers: EVERY,
        run: || setup::run(&setup::Args::default()),
    },
    Step { name: "fmt", about: "formatted by rustfmt", tiers: EVERY, run: || cargo("fmt --all --check") },
    Step {
        name: "tidy",
        about: "rules of the architecture and the sources",
        tiers: EVERY,
        run: || tidy::run(&tidy::Args::default()),
    },
    Step {
        name: "deny",
        about: "licenses and origins of dependencies",
        tiers: CI,
        run: || deny::run(&deny::Args::default()),
    },
    Step { name: "clippy", about: "no lint warns", tiers: EVERY, run: clippy },
    Step { name: "unit", about: "tests inside of the libraries", tiers: &[Tier::Check], run: test::units },
    Step { name: "test", about: "all tests", tiers: CI, run: || test::suites(&test::Args::default()) },
    Step {
        name: "doctest",
        about: "examples in the documentation",
        tiers: CI,
        run: || test::doctests(&test::Args::default()),
    },
    Step { name: "doc", about: "documentation without warnings", tiers: CI, run: doc },
    Step {
        name: "book",
        about: "the book builds, and its links lead somewhere",
        tiers: CI,
        run: || book::run(&book::Args::default()),
    },
    // Under `cargo test` criterion runs each benchmark once, in the profile that the tests have built already.
    Step {
        name: "benches",
        about: "each benchmark runs, once",
        tiers: NIGHTLY,
        run: || cargo("test --package swm-benches --benches"),
    },
    Step {
        name: "wheel",
        about: "the Python package as a wheel, and its tests",
        tiers: CI,
        run: wheel::check,
    },
    Step {
        name: "ui",
        about: "the page of `swm ui` is what its sources build, and works in a browser",
        tiers: CI,
        run: || ui::run(&ui::Args::default()),
    },
    Step { name: "demo", about: "the main job, in a short form", tiers: CI, run: short_demo },
    Step {
        name: "plugin",
        about: "crates outside of the workspace add environments, solvers and models",
        tiers: CI,
        run: || plugin::run(&plugin::Args::default()),
    },
    Step {
        name: "lance",
        about: "the crate of the formats on Lance, which is built apart: no lint warns",
        tiers: CI,
        run: lance,
    },
    // What they link takes a quarter of an hour to build, more than all other steps save `test`.
    Step {
        name: "pylance",
        about: "the tests of that crate, with pylance",
        tiers: NIGHTLY,
        run: lance_tests,
    },
    Step {
        name: "release",
        about: "a rehearsal of a release, from packages to checksums",
        tiers: NIGHTLY,
        run: release::rehearse,
    },
    Step {
        name: "alone",
        about: "each crate builds alone, with each of its features, and pulls in what docs/sizes.md says",
        tiers: NIGHTLY,
        run: sizes::check_each_alone,
    },
    Step {
        name: "platforms",
        about: "crates without code in C are type-checked for macOS and Windows",
        tiers: NIGHTLY,
        run: platforms,
    },
    Step {
        name: "exports",
        about: "the reference loads what `swm export` writes, with equal outputs",
        tiers: NIGHTLY,
        run: || exports::run(&exports::Args::default()),
    },
    Step {
        name: "mcap",
        about: "the crate `mcap` cannot continue a killed recording or read a row by its position",
        tiers: NIGHTLY,
        run: mcap::check,
    },
    Step {
        name: "proof",
        about: "one training of a few models reaches what is recorded of it",
        tiers: NIGHTLY,
        run: proof::check,
    },
    Step {
        name: "gpu",
        about: "the command with CUDA links, and says what a machine lacks for it",
        tiers: NIGHTLY,
        run: || gpu::run(&gpu::Args::default()),
    },
];

/// The demonstration, its report in a folder that git ignores.
fn short_demo() -> Result<()> {
    demo::run(&demo::Args { short: true, robustness: false, out: process::root().join(".tools/demo-report") })
}

/// Platforms for which nothing is built here.
const OTHER_PLATFORMS: &[&str] = &["aarch64-apple-darwin", "x86_64-pc-windows-gnu"];
/// Crates that need no C compiler of another platform. (`swm-data` builds HDF5, and so do those above it.)
const WITHOUT_C: &[&str] = &[
    "swm-core",
    "swm-envs-2d",
    "swm-envs-3d",
    "swm-envs-mujoco",
    "swm-files",
    "swm-fov",
    "swm-lance",
    "swm-mujoco",
    "swm-render",
    "swm-solvers",
];

fn platforms() -> Result<()> {
    for target in OTHER_PLATFORMS {
        process::run(Command::new("rustup").args(["target", "add", target]))?;
        let packages = WITHOUT_C.iter().flat_map(|name| ["--package", name]);
        process::run(process::cargo(["check", "--target", target]).args(packages))?;
    }
    Ok(())
}

/// How a step ended.
struct Outcome {
    name: &'static str,
    wall: Duration,
    error: Option<String>,
}

/// Runs the steps of a tier, or those that are named, and prints the table; an error if any of them failed.
pub(crate) fn run(tier: Tier, args: &Args) -> Result<()> {
    let mut chosen = STEPS.iter().filter(|step| is_chosen(step, tier, &args.only));
    let outcomes = run_steps(&mut chosen, args.keep_going);
    let not_run: Vec<&str> = chosen.map(|step| step.name).collect();
    let budget = args.only.is_empty().then(|| tier.budget());
    println!("\n{}", table(&outcomes, &not_run, budget));
    let failed: Vec<&str> =
        outcomes.iter().filter(|outcome| outcome.error.is_some()).map(|outcome| outcome.name).collect();
    match failed.as_slice() {
        [] => Ok(()),
        failed => bail!("failed: {}", failed.join(", ")),
    }
}

fn is_chosen(step: &Step, tier: Tier, only: &[String]) -> bool {
    if only.is_empty() { step.tiers.contains(&tier) } else { only.iter().any(|named| named == step.name) }
}

/// Runs steps until one fails, or all of them.
fn run_steps<'a>(steps: &mut impl Iterator<Item = &'a Step>, keep_going: bool) -> Vec<Outcome> {
    let mut outcomes = Vec::new();
    for step in steps {
        eprintln!("\n── {}: {} ──", step.name, step.about);
        let start = Instant::now();
        let error = (step.run)().err().map(|error| process::report(&error));
        let outcome = Outcome { name: step.name, wall: start.elapsed(), error };
        if let Some(error) = &outcome.error {
            eprintln!(
                "\n── FAILED: {} ──\n{error}\nagain, alone: cargo xtask ci --only {}",
                step.name, step.name
            );
        }
        let is_over = outcome.error.is_some() && !keep_going;
        outcomes.push(outcome);
        if is_over {
            break;
        }
    }
    outcomes
}

/// One line per step, wall times in seconds, and their sum beside the time that they should take.
fn table(outcomes: &[Outcome], not_run: &[&str], budget: Option<Duration>) -> String {
    let line = |name: &str, wall: String, result: &str| {
        format!("{name:<10}{wall:>10}  {result}").trim_end().to_owned() + "\n"
    };
    let seconds = |wall: Duration| format!("{:.1} s", wall.as_secs_f64());
    let mut text = line("step", "wall".into(), "result");
    for Outcome { name, wall, error } in outcomes {
        text += &line(name, seconds(*wall), if error.is_none() { "ok" } else { "FAILED" });
    }
    for name in not_run {
        text += &line(name, "-".into(), "not run");
    }
    let should =
        budget.map_or_else(String::new, |budget| format!("should be below {:.0} s", budget.as_secs_f64()));
    text + &line("total", seconds(outcomes.iter().map(|outcome| outcome.wall).sum()), &should)
}

/// Runs cargo with arguments that hold no blanks.
fn cargo(args: &str) -> Result<()> {
    process::run(&mut process::cargo(args.split_whitespace()))
}

fn clippy() -> Result<()> {
    let mut command = process::cargo(["clippy", "--all-targets"]);
    process::run(command.args(test::whole_workspace()).args(["--", "-D", "warnings"]))
}

fn doc() -> Result<()> {
    let flags = std::env::var("RUSTDOCFLAGS").unwrap_or_default();
    let mut command = process::cargo(["doc", "--no-deps"]);
    process::run(
        command
            .args(test::whole_workspace())
            .env("RUSTDOCFLAGS", format!("{flags} -D warnings").trim_start()),
    )
}

/// The crate, and the command with these formats.
fn lance() -> Result<()> {
    let environment = setup::tools::protoc();
    separate_crates::lint("swm-data-lance", &environment)?;
    process::run(process::cargo(["check", "--package", "swm", "--features", "lance"]).envs(environment))
}

/// With pylance, which reads what we write.
fn lance_tests() -> Result<()> {
    let mut environment = setup::tools::protoc().to_vec();
    environment.push(("SWM_LANCE_PYTHON", interop::python(&interop::LANCE)?));
    separate_crates::test("swm-data-lance", &environment)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::*;

    const GOOD: Step = Step { name: "good", about: "", tiers: EVERY, run: || Ok(()) };
    const BAD: Step = Step { name: "bad", about: "", tiers: EVERY, run: || bail!("it is bad") };

    #[test]
    fn the_first_failure_ends_the_run() {
        let mut steps = [GOOD, BAD, GOOD].into_iter().collect::<Vec<_>>();
        steps[2].name = "later";
        let mut rest = steps.iter();
        let outcomes = run_steps(&mut rest, false);
        assert_eq!(outcomes.len(), 2);
        assert_eq!(outcomes[1].error.as_deref(), Some("it is bad"));
        assert_eq!(rest.next().map(|step| step.name), Some("later"));
    }

    #[test]
    fn keep_going_runs_everything() {
        let outcomes = run_steps(&mut [BAD, GOOD].iter(), true);
        assert_eq!(outcomes.iter().map(|outcome| outcome.error.is_none()).collect::<Vec<_>>(), [false, true]);
    }

    #[test]
    fn the_table_names_each_step_once_and_sums_the_times() {
        let outcome = |name, ms, error: Option<&str>| Outcome {
            name,
            wall: Duration::from_millis(ms),
            error: error.map(Into::into),
        };
        let outcomes = [outcome("fmt", 400, None), outcome("test", 61_200, Some("no"))];
        let text = table(&outcomes, &["doc"], Some(Tier::Ci.budget()));
        let expected = "\
step            wall  result
fmt            0.4 s  ok
test          61.2 s  FAILED
doc                -  not run
total         61.6 s  should be below 3600 s\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn help_and_guide_name_the_time_of_each_tier() {
        let guide = std::fs::read_to_string(process::root().join("CONTRIBUTING.md")).unwrap();
        let command = crate::Cli::command();
        for (name, tier) in [("check", Tier::Check), ("ci", Tier::Ci), ("nightly", Tier::Nightly)] {
            let time = match tier.minutes() {
                minutes if minutes > 60 && minutes % 60 == 0 => format!(" {} hours", minutes / 60),
                minutes => format!(" {minutes} minutes"),
            };
            let about = command.find_subcommand(name).and_then(clap::Command::get_about).unwrap().to_string();
            assert!(about.contains(&time), "help of {name}, {time}: {about}");
            let line = guide.lines().find(|line| line.starts_with(&format!("cargo xtask {name} "))).unwrap();
            assert!(line.contains(&time), "CONTRIBUTING.md, {time}: {line}");
        }
    }

    #[test]
    fn a_step_runs_in_its_tiers_or_when_it_is_named() {
        let step = Step { name: "release", about: "", tiers: NIGHTLY, run: || Ok(()) };
        let only = |name: &str| vec![name.to_owned()];
        assert!(is_chosen(&step, Tier::Nightly, &[]) && !is_chosen(&step, Tier::Ci, &[]));
        assert!(is_chosen(&step, Tier::Check, &only("release")));
        assert!(!is_chosen(&step, Tier::Nightly, &only("fmt")));
    }

    #[test]
    fn each_tier_has_the_steps_of_the_one_before() {
        let names = |tier| STEPS.iter().filter(move |step| step.tiers.contains(&tier)).map(|step| step.name);
        // The unit tests are part of the step `test`.
        let missing: Vec<&str> =
            names(Tier::Check).filter(|name| !names(Tier::Ci).any(|other| other == *name)).collect();
        assert_eq!(missing, ["unit"]);
        assert!(names(Tier::Ci).all(|name| names(Tier::Nightly).any(|other| other == name)));
    }

    #[test]
    fn step_names_are_distinct() {
        let mut names: Vec<&str> = STEPS.iter().map(|step| step.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), STEPS.len());
    }
}
