//! Flags of the command in libraries: these name settings, which the command, Python and the page word in their own syntax.

use super::Violation;
use super::mask::literals_only;
use super::tree::TextFile;

/// This file, for messages about the list.
const LIST: &str = "xtask/src/tidy/flags.rs";

/// Where crates are, and the one whose flags these are.
const CRATES: &str = "crates/";
const COMMAND: &str = "crates/swm/";

/// Names of files and folders that hold tests.
const TESTS: &[&str] = &["/tests.rs", "/tests/", "/testing/"];

/// The command that lists entries of a kind: data, of which a front end makes a sentence.
const LISTING: &str = "const COMMAND: &'static str";

/// Flags of other programs, and where they may be named.
struct Allowed {
    /// How the path of the file begins.
    path: &'static str,
    /// The flags, without hyphens, separated by blanks.
    flags: &'static str,
    /// Whose they are.
    of: &'static str,
}

#[rustfmt::skip]
const ALLOWED: &[Allowed] = &[
    Allowed { path: "crates/swm-baselines/src/device.rs", flags: "locked path", of: "cargo" },
    Allowed { path: "crates/swm-checkpoints/src/export/card.rs", flags: "out policy", of: "the shell commands in the README of an exported model" },
    Allowed { path: "crates/swm-checkpoints/src/reproduce/needs.rs", flags: "revision local-dir repo-type fail location create-dirs output", of: "hf and curl" },
    Allowed { path: "crates/swm-data-foreign/src/rlds/mod.rs", flags: "out_file_format", of: "tfds" },
    Allowed { path: "crates/swm-data/src/formats/mcap/chunks.rs", flags: "compression", of: "mcap" },
    Allowed { path: "crates/swm-jobs/src/engines/", flags: "index finish entries", of: "`swm task`, as a script starts it" },
    Allowed { path: "crates/swm-jobs/src/engines/hq.rs", flags: "output-mode", of: "hq" },
    Allowed { path: "crates/swm-jobs/src/engines/slurm.rs", flags: "constraint partition account qos time mem gpus cpus-per-task array requeue signal dependency me job-name output open-mode parsable", of: "sbatch, squeue and scancel" },
    Allowed { path: "crates/swm-jobs/src/job.rs", flags: "job all", of: "the shell command that goes on with a job, which scripts hold" },
    Allowed { path: "crates/swm-jobs/src/progress.rs", flags: "finish", of: "the shell command that joins a job, which scripts hold" },
    Allowed { path: "crates/swm-jobs/src/tracking.rs", flags: "logdir project", of: "tensorboard and the tracker's script" },
    Allowed { path: "crates/swm-py/src/words.rs", flags: "help lance", of: "what Python words in its own way, and cargo xtask" },
    Allowed { path: "crates/swm-tasks/src/svg.rs", flags: "ratio most scale x y", of: "CSS: properties of a style" },
];

/// Every flag in a string literal of a library, and every allowance that nothing needs.
pub(super) fn named(files: &[TextFile]) -> Vec<Violation> {
    check(ALLOWED, files)
}

fn check(list: &[Allowed], files: &[TextFile]) -> Vec<Violation> {
    let mut unused: Vec<Vec<&str>> = list.iter().map(|allowed| allowed.flags.split(' ').collect()).collect();
    let mut violations = Vec::new();
    for file in files.iter().filter(|file| is_library(&file.path)) {
        let text = file.text.split("\nmod tests {").next().unwrap_or(&file.text);
        let lines = literals_only(text);
        let code = text.lines().enumerate().zip(lines.lines());
        for ((index, _), line) in code.filter(|((_, line), _)| !line.contains(LISTING)) {
            for flag in flags(line) {
                let mut is_allowed = false;
                for (allowed, unused) in list.iter().zip(&mut unused) {
                    if file.path.starts_with(allowed.path) && allowed.flags.split(' ').any(|one| one == flag)
                    {
                        is_allowed = true;
                        unused.retain(|one| *one != flag);
                    }
                }
                if !is_allowed {
                    let message = format!(
                        "`--{flag}`: name the setting, or make a `Fix` of it; flags of other programs are listed in {LIST}"
                    );
                    violations.push(Violation::new(format!("{}:{}", file.path, index + 1), message));
                }
            }
        }
    }
    for (allowed, unused) in list.iter().zip(unused).filter(|(_, unused)| !unused.is_empty()) {
        let message = format!(
            "{} has no `--{}` of {}: take it from the list",
            allowed.path,
            unused.join("`, `--"),
            allowed.of
        );
        violations.push(Violation::new(LIST, message));
    }
    violations
}

fn is_library(path: &str) -> bool {
    path.starts_with(CRATES)
        && !path.starts_with(COMMAND)
        && path.contains("/src/")
        && path.ends_with(".rs")
        && !TESTS.iter().any(|tests| path.contains(tests))
}

/// Names of what looks like a flag: two hyphens that follow no word or hyphen, and a small letter.
fn flags(line: &str) -> impl Iterator<Item = &str> {
    line.match_indices("--").filter_map(|(at, _)| {
        let before = line[..at].chars().next_back();
        let name = &line[at + 2..];
        let is_name = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
        let end = name.find(|c| !is_name(c)).unwrap_or(name.len());
        let begins = name.starts_with(|c: char| c.is_ascii_lowercase());
        let is_free = !before.is_some_and(|c| c.is_alphanumeric() || c == '-' || c == '_');
        (begins && is_free).then_some(&name[..end])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const OTHERS: &[Allowed] = &[Allowed { path: "crates/swm-a/src/run", flags: "time me", of: "squeue" }];

    #[track_caller]
    fn places(path: &str, text: &str) -> Vec<String> {
        let found = check(OTHERS, &[TextFile::new(path, text)]);
        found.into_iter().map(|found| found.place).filter(|place| place != LIST).collect()
    }

    #[test]
    fn flags_are_found_in_messages_of_libraries() {
        let text = "//! Of `--seed`.\nf(\"give --seed 3\"); // --seed\nf(\"--on: no\");\nf(\"`--fix` of it,\\\n or --out\");\n\
                    let x = a --b; f(\"a--b, --- and -- c\");\n";
        let lines = |path: &str, of: &[u32]| -> Vec<String> {
            of.iter().map(|line| format!("{path}:{line}")).collect()
        };
        let (library, python) = ("crates/swm-a/src/x/y.rs", "crates/swm-py/src/lib.rs");
        assert_eq!(places(library, text), lines(library, &[2, 3, 4, 5]));
        assert_eq!(places(python, text), lines(python, &[2, 3, 4, 5]));
        for other in [
            "crates/swm/src/cli/eval.rs",
            "xtask/src/a.rs",
            "crates/swm-a/src/x/tests.rs",
            "crates/swm-a/tests/it.rs",
        ] {
            assert_eq!(places(other, text), [""; 0]);
        }
    }

    #[test]
    fn tests_inside_of_a_library_may_name_flags() {
        let text = "f(\"--seed\");\n#[cfg(test)]\nmod tests {\n    f(\"--out\");\n}\n";
        assert_eq!(places("crates/swm-a/src/x.rs", text), ["crates/swm-a/src/x.rs:1"]);
    }

    #[test]
    fn flags_of_other_programs_are_allowed_where_they_are_listed() {
        let text = "f(\"--time=3 --me --on\");\n";
        assert_eq!(places("crates/swm-a/src/run.rs", text), ["crates/swm-a/src/run.rs:1"]);
        assert_eq!(places("crates/swm-a/src/other.rs", text).len(), 3);
    }

    #[test]
    fn an_allowance_that_nothing_needs_is_reported() {
        let found = check(OTHERS, &[TextFile::new("crates/swm-a/src/run.rs", "f(\"--time=3\");")]);
        assert_eq!(found.len(), 1);
        assert!(found[0].place == LIST && found[0].message.contains("has no `--me`"), "{found:?}");
    }
}
