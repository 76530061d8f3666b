//! Runs the commands of a task in its folder. Which ones have ended, and what they cost, is kept in `steps.json` there.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;

use super::plan::{self, Row, Table};
use super::record::{Record, made};
use crate::program::Program;
use crate::setup::wheel::create_folder;

/// A folder, and what was run in it.
pub(super) struct Work<'a> {
    folder: PathBuf,
    program: &'a Program<'a>,
    steps: RefCell<BTreeMap<String, Step>>,
}

/// How far a command is.
#[derive(Clone, Default, Serialize, Deserialize)]
struct Step {
    has_ended: bool,
    /// CPU time, in seconds, of all that it took.
    seconds: f64,
}

impl<'a> Work<'a> {
    pub(super) fn open(folder: PathBuf, program: &'a Program<'a>) -> Result<Self> {
        create_folder(&folder)?;
        let file = folder.join(STEPS);
        let steps = match fs::read_to_string(&file) {
            Ok(text) => serde_json::from_str(&text)
                .with_context(|| format!("{} is damaged; remove its folder", file.display()))?,
            Err(_) => BTreeMap::new(),
        };
        Ok(Self { folder, program, steps: RefCell::new(steps) })
    }

    /// Runs a command, or what is left of it, and returns the minutes of CPU time that it took in all.
    pub(super) fn step(&self, command: &str) -> Result<f64> {
        let known = self.steps.borrow().get(command).cloned();
        let mut step = known.clone().unwrap_or_default();
        if step.has_ended {
            return Ok(step.seconds / 60.0);
        }
        let name = plan::option(command, "--out").with_context(|| format!("`{command}` has no --out"))?;
        let out = self.folder.join(name);
        let words: Vec<&str> = command.split_whitespace().collect();
        let words = match (known, words[0]) {
            // Evaluations continue by the same command.
            (Some(_), "train") if out.join("config.json").exists() => vec!["train", "--resume", name],
            (Some(_), "eval" | "sweep" | "train") => words,
            _ => {
                remove(&out)?;
                words
            }
        };
        self.keep(command, &step)?;
        let before = seconds_of_children();
        let ended = self.program.run_in(&self.folder, &words);
        step.seconds += seconds_of_children() - before;
        step.has_ended = ended.is_ok();
        self.keep(command, &step)?;
        ended.map(|_| step.seconds / 60.0)
    }

    /// Evaluates one training of a row, which took `training` minutes.
    pub(super) fn result(&self, table: &Table, row: &Row, seed: u64, training: f64) -> Result<Vec<Record>> {
        let command = plan::with_seed(&row.result, seed);
        let evaluation = self.step(&command)?;
        let out = self.folder.join(plan::option(&command, "--out").unwrap_or_default());
        let file = out.join(if table.is_sweep() { "sweep.json" } else { "receipt.json" });
        let text = fs::read_to_string(&file).with_context(|| format!("{} cannot be read", file.display()))?;
        let result: Json =
            serde_json::from_str(&text).with_context(|| format!("{} is no JSON", file.display()))?;
        let records = made(table, row, seed, &result, [training, evaluation]);
        ensure!(!records.is_empty(), "{} holds no result", file.display());
        Ok(records)
    }

    fn keep(&self, command: &str, step: &Step) -> Result<()> {
        self.steps.borrow_mut().insert(command.to_owned(), step.clone());
        let file = self.folder.join(STEPS);
        let text = serde_json::to_string_pretty(&*self.steps.borrow())?;
        fs::write(&file, text + "\n").with_context(|| format!("{} cannot be written", file.display()))
    }
}

const STEPS: &str = "steps.json";

fn remove(path: &Path) -> Result<()> {
    let removed = match path.is_dir() {
        true => fs::remove_dir_all(path),
        false if path.exists() => fs::remove_file(path),
        false => Ok(()),
    };
    removed.with_context(|| format!("{} cannot be removed", path.display()))
}

/// Seconds of CPU time of all children that have ended; 0 where the system has no `/proc`. In hundredths, as Linux counts.
fn seconds_of_children() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    // The name, in parentheses, may hold blanks; `cutime` and `cstime` are the 16th and 17th values of the line.
    let values = stat.rsplit_once(") ").map_or("", |(_, values)| values).split_whitespace();
    values.skip(13).take(2).filter_map(|value| value.parse::<f64>().ok()).sum::<f64>() / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    /// A stand-in for `swm`: it writes its `--out`, and prints JSON; `fail` in the folder makes it fail.
    fn program(folder: &Path) -> PathBuf {
        let file = folder.join("swm");
        let script = "#!/bin/sh\necho \"$@\" >> calls\n[ -e fail ] && exit 1\n\
                      if [ \"$1\" = train ] && [ \"$2\" != --resume ]; then mkdir -p run && touch run/config.json; fi\necho '{}'\n";
        fs::write(&file, script).unwrap();
        let made = Command::new("chmod").arg("+x").arg(&file).status().unwrap();
        assert!(made.success());
        file
    }

    #[test]
    fn what_has_ended_is_not_run_again_and_an_interrupted_training_is_continued() {
        let folder = tempfile::tempdir().unwrap();
        let file = program(folder.path());
        let program = Program { given: Some(&file), features: "" };
        let out = folder.path().join("task");
        let calls = || fs::read_to_string(out.join("calls")).unwrap_or_default();

        let work = Work::open(out.clone(), &program).unwrap();
        work.step("collect a --out data").unwrap();
        work.step("collect a --out data").unwrap();
        assert_eq!(calls(), "collect a --out data --json\n");

        // The first attempt makes the run and fails.
        fs::create_dir(out.join("run")).unwrap();
        fs::write(out.join("run/old"), "of another command").unwrap();
        fs::write(out.join("fail"), "").unwrap();
        work.step("train b --out run").unwrap_err();
        assert!(!out.join("run/old").exists(), "what another command made is not continued");
        fs::create_dir_all(out.join("run")).unwrap();
        fs::write(out.join("run/config.json"), "").unwrap();
        fs::remove_file(out.join("fail")).unwrap();

        let again = Work::open(out.clone(), &program).unwrap();
        again.step("train b --out run").unwrap();
        again.step("train b --out run").unwrap();
        assert!(calls().ends_with("train b --out run --json\ntrain --resume run --json\n"), "{}", calls());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_time_of_children_is_counted() {
        let before = seconds_of_children();
        let script = "i=0; while [ $i -lt 200000 ]; do i=$((i + 1)); done";
        assert!(Command::new("sh").args(["-c", script]).status().unwrap().success());
        assert!(seconds_of_children() > before);
    }
}
