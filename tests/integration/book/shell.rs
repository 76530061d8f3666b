//! Commands of the book, shortened and run in a folder.
//!
//! Blocks in `sh` and `bash` are scripts: their numbers are cut by the tables below. Blocks in `console` are run as they stand, command by
//! command (`$ …`), and must print what stands there, but for the widths of tables; `…` stands for anything within a line, a line `…` for any lines.

use std::path::Path;
use std::process::Command;

use super::Outcome;

/// A number after one of these texts is cut to this much.
const CAPS: &[(&str, u64)] = &[
    ("--episodes ", 6),
    ("--tier moderate --episodes ", 2),
    ("--tier historic --episodes ", 2),
    ("--total ", 3),
    ("--budget ", 6),
    ("--steps ", 4),
    ("--max-steps ", 30),
    ("--rows ", 20),
    ("samples=", 6),
    ("iterations=", 2),
    ("elites=", 3),
];

/// What takes the place of something longer: planners without settings are those of the paper, with 300 samples and 30 iterations.
const SHORTER: &[(&str, &str)] = &[
    ("--policy cem ", "--policy cem:samples=6,iterations=2,elites=3 "),
    ("--policy mppi ", "--policy mppi:samples=6,iterations=2,elites=3 "),
    ("--policy icem ", "--policy icem:samples=6,iterations=2,elites=3,elites_kept=1 "),
    ("--policy mpc:runs/pldm ", "--policy mpc:runs/pldm,samples=6,iterations=2,elites=3 "),
    (",solver=icem,", ",solver=icem,iterations=2,elites_kept=1,"),
    // Few steps, and more where training goes on.
    ("--epochs 3", "--steps 2"),
    ("--epochs 6", "--steps 4"),
];

/// Commands that begin so get these options, unless they have them: their defaults are for measurements.
const ADDED: &[(&str, &str, &str)] = &[
    ("swm manifest make ", "--episodes ", "2"),
    ("swm manifest make ", "--held-out ", "1"),
    ("swm eval swm/", "--episodes ", "2"),
    ("swm quality ", "--episodes ", "4"),
    ("swm train pldm ", "--batch ", "4"),
    ("swm train lewm ", "--split ", "0.5"),
    ("swm train gcbc ", "--batch ", "4"),
];

/// Lines that begin so are not run.
const NOT_RUN: &[(&str, &str)] = &[
    ("cargo ", "builds, or is a step of CI of its own; that the command exists is tested"),
    ("pip ", "needs the network"),
    ("mdbook ", "a step of CI of its own"),
    ("python3 benches/", "takes minutes"),
    ("cd ", "every page has one folder"),
    ("export ", "for builds"),
    ("tensorboard ", "not installed"),
];

/// The programs that pages use, and what is at hand.
pub(super) struct Machine {
    folder: tempfile::TempDir,
    features: Vec<String>,
    python: Option<String>,
}

impl Machine {
    pub(super) fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let command = std::env::var("SWM_BOOK_COMMAND");
        let command = command.unwrap_or_else(|_| env!("CARGO_BIN_EXE_swm-under-test").to_owned());
        let programs = folder.path().join("bin");
        std::fs::create_dir(&programs).expect("a folder for programs");
        std::os::unix::fs::symlink(command, programs.join("swm")).expect("a link");
        let python = std::env::var("SWM_INTEROP_PYTHON").ok();
        let mut machine = Self { folder, features: Vec::new(), python };
        let version = machine.run("swm --version", machine.shared()).expect("the command starts");
        let line = version.lines().find_map(|line| line.strip_prefix("features: ")).unwrap_or_default();
        machine.features.extend(line.split_whitespace().map(str::to_owned));
        if machine.run("swm fovs swm/CheetahDMControl-v0", machine.shared()).is_ok() {
            machine.features.push("mujoco-data".to_owned());
        }
        if machine
            .python("import torch", machine.shared())
            .is_ok_and(|outcome| matches!(outcome, Outcome::Ran))
        {
            machine.features.push("torch".to_owned());
        }
        if machine.run("parallel --version", machine.shared()).is_ok() {
            machine.features.push("parallel".to_owned());
        }
        machine
    }

    /// Whether a feature of the command, or of the machine, is at hand.
    pub(super) fn has(&self, what: &str) -> bool {
        self.features.iter().any(|feature| feature == what)
    }

    /// A folder for what pages share.
    pub(super) fn shared(&self) -> &Path {
        self.folder.path()
    }

    /// Runs a script in `folder`, shortened.
    pub(super) fn script(&self, text: &str, status: i32, folder: &Path) -> Result<Outcome, String> {
        let (script, left) = without_what_is_not_run(&shortened(text));
        if is_empty(&script) {
            return Ok(Outcome::Left(left.unwrap_or_else(|| "no command".to_owned())));
        }
        let (printed, found) = self.bash(&script, folder)?;
        match found == status {
            true => Ok(Outcome::Ran),
            false => Err(format!("exit status {found}, not {status}, of\n{script}\n{printed}")),
        }
    }

    /// Runs the commands of a session in `folder`, and compares what they print.
    pub(super) fn session(&self, text: &str, status: i32, folder: &Path) -> Result<Outcome, String> {
        let commands = commands_and_output(text);
        let last = commands.len().checked_sub(1).ok_or("a session without a command, `$ …`")?;
        for (index, (command, expected)) in commands.iter().enumerate() {
            let (runs, _) = without_what_is_not_run(command);
            if is_empty(&runs) {
                continue;
            }
            // What a terminal shows next to results is progress, or the message of a failure.
            let quiet = if index == last && status != 0 { "" } else { "exec 2>.stderr\n" };
            let (printed, found) = self.bash(&format!("{quiet}{runs}"), folder)?;
            let wanted = if index == last { status } else { 0 };
            if found != wanted {
                let said = std::fs::read_to_string(folder.join(".stderr")).unwrap_or_default();
                return Err(format!("exit status {found}, not {wanted}, of\n{command}\n{printed}{said}"));
            }
            if !matches(expected, &printed.lines().collect::<Vec<_>>()) {
                return Err(format!("`{command}` prints\n{printed}\nand not\n{}", expected.join("\n")));
            }
        }
        Ok(Outcome::Ran)
    }

    /// Runs a program in Python, where there is one.
    pub(super) fn python(&self, text: &str, folder: &Path) -> Result<Outcome, String> {
        let Some(python) = &self.python else {
            return Ok(Outcome::Left("no SWM_INTEROP_PYTHON; `cargo xtask test` makes one".to_owned()));
        };
        // A file: workers of a loader begin by importing it.
        let file = folder.join("block.py");
        std::fs::write(&file, text).map_err(|error| error.to_string())?;
        let output = Command::new(python).arg(&file).current_dir(folder).output();
        let output = output.map_err(|error| format!("{python}: {error}"))?;
        match output.status.success() {
            true => Ok(Outcome::Ran),
            false => Err(String::from_utf8_lossy(&output.stderr).into_owned()),
        }
    }

    /// Runs a command that must succeed, and returns what it prints.
    pub(super) fn run(&self, command: &str, folder: &Path) -> Result<String, String> {
        match self.bash(command, folder)? {
            (printed, 0) => Ok(printed),
            (printed, status) => Err(format!("exit status {status} of\n{command}\n{printed}")),
        }
    }

    /// What a script prints on both streams, and its exit status.
    fn bash(&self, script: &str, folder: &Path) -> Result<(String, i32), String> {
        let path = std::env::var("PATH").unwrap_or_default();
        let path = format!("{}:{path}", self.shared().join("bin").display());
        let mut command = Command::new("bash");
        command.args(["-eu", "-c", &format!("exec 2>&1\n{script}")]).current_dir(folder).env("PATH", path);
        let output = command.output().map_err(|error| format!("bash does not start: {error}"))?;
        Ok((String::from_utf8_lossy(&output.stdout).into_owned(), output.status.code().unwrap_or(-1)))
    }
}

/// With the numbers of [`CAPS`] cut, and the texts of [`SHORTER`] replaced.
fn shortened(text: &str) -> String {
    // A failure in `a && b` would not end a script.
    let mut text = text.replace("\\\n", " ").replace(" && ", "\n");
    for (long, short) in SHORTER {
        text = text.replace(long, short);
    }
    for &(name, most) in CAPS {
        let mut parts = text.split(name);
        let mut cut = parts.next().unwrap_or_default().to_owned();
        for part in parts {
            let digits = part.find(|c: char| !c.is_ascii_digit()).unwrap_or(part.len());
            cut += name;
            match part[..digits].parse::<u64>() {
                Ok(number) => cut += &number.min(most).to_string(),
                Err(_) => cut += &part[..digits],
            }
            cut += &part[digits..];
        }
        text = cut;
    }
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    for line in &mut lines {
        for (begin, name, value) in ADDED {
            if line.starts_with(begin) && !line.contains(name) {
                let after_command = begin.rfind(' ').map_or(0, |space| space + 1);
                line.insert_str(after_command, &format!("{name}{value} "));
            }
        }
        line.push('\n');
    }
    lines.concat()
}

/// Without the lines of [`NOT_RUN`], and the reason of the last that went.
fn without_what_is_not_run(script: &str) -> (String, Option<String>) {
    let (mut kept, mut left) = (String::new(), None);
    for line in script.lines() {
        match NOT_RUN.iter().find(|(begin, _)| line.trim_start().starts_with(begin)) {
            Some((begin, reason)) => left = Some(format!("`{}`: {reason}", begin.trim())),
            None => kept = kept + line + "\n",
        }
    }
    (kept, left)
}

fn is_empty(script: &str) -> bool {
    script.lines().all(|line| line.trim().is_empty() || line.trim_start().starts_with('#'))
}

/// The commands of a session, and the lines that each prints.
fn commands_and_output(text: &str) -> Vec<(String, Vec<&str>)> {
    let mut commands: Vec<(String, Vec<&str>)> = Vec::new();
    let mut goes_on = false;
    for line in text.lines() {
        match (line.strip_prefix("$ "), commands.last_mut()) {
            (Some(command), _) => commands.push((command.to_owned(), Vec::new())),
            (None, Some((command, _))) if goes_on => *command = format!("{command}\n{line}"),
            (None, Some((_, output))) => output.push(line),
            (None, None) => {}
        }
        goes_on = line.ends_with('\\');
    }
    commands
}

/// Whether `found` is what `expected` describes.
fn matches(expected: &[&str], found: &[&str]) -> bool {
    let blank = |line: &&str| line.trim().is_empty();
    let expected: &[&str] =
        &expected[..expected.len() - expected.iter().rev().take_while(|line| blank(line)).count()];
    match (expected.first(), found.first()) {
        (None, _) => found.iter().all(blank),
        (Some(&"…"), _) => (0..=found.len()).any(|skip| matches(&expected[1..], &found[skip..])),
        (Some(line), Some(other)) => line_matches(line, other) && matches(&expected[1..], &found[1..]),
        (Some(_), None) => false,
    }
}

fn line_matches(expected: &str, found: &str) -> bool {
    let (expected, found) = (plain(expected), plain(found));
    wildcard_matches(&expected, &found)
}

/// With one blank between words, and one dash for the lines of tables: widths are those of the longest value.
fn plain(line: &str) -> String {
    let words = line.split_whitespace().map(|word| if word.chars().all(|c| c == '─') { "─" } else { word });
    words.collect::<Vec<_>>().join(" ")
}

fn wildcard_matches(expected: &str, found: &str) -> bool {
    let Some((head, rest)) = expected.split_once('…') else { return expected == found };
    let Some(found) = found.strip_prefix(head) else { return false };
    let starts = (0..=found.len()).filter(|&at| found.is_char_boundary(at));
    starts.map(|at| &found[at..]).any(|found| wildcard_matches(rest, found))
}

#[test]
fn numbers_are_cut_and_others_stay() {
    let text = "swm eval x --policy cem --episodes 100 --seed 100\nswm preview --episodes 0..16\ncem:samples=300,iterations=1";
    let expected = "swm eval x --policy cem:samples=6,iterations=2,elites=3 --episodes 6 --seed 100\n\
                    swm preview --episodes 0..16\ncem:samples=6,iterations=1\n";
    assert_eq!(shortened(text), expected);
    assert_eq!(
        shortened("swm manifest make x \\\n --held-out 0.3"),
        "swm manifest make --episodes 2 x   --held-out 0.3\n"
    );
}

#[test]
fn output_is_compared_line_by_line() {
    let found = ["a 12 s", "b", "c", "d"];
    assert!(matches(&["a … s", "…", "d"], &found));
    assert!(matches(&["a   12 s", "b", "c", "d", ""], &found));
    assert!(!matches(&["a … m", "…", "d"], &found));
    assert!(!matches(&["a 12 s", "b"], &found));
}

#[test]
fn sessions_are_commands_and_what_they_print() {
    let text = "$ swm a \\\n    --b\nx\n\ny\n$ swm c\n";
    assert_eq!(
        commands_and_output(text),
        [("swm a \\\n    --b".to_owned(), vec!["x", "", "y"]), ("swm c".to_owned(), vec![])]
    );
}
