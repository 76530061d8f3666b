//! Work that is killed at random moments and goes on: nothing that was committed is lost, and the result is that of an undisturbed run.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use serde_json::Value as Json;

use super::table::{Line, Table};
use super::trial::{Ended, Fault, Swm, words};

/// One kind of work. `OUT` in a line is what it makes; `IN` a folder with [`prepare`]d inputs.
struct Work {
    name: &'static str,
    /// What `OUT` is called.
    out: &'static str,
    /// Lines before the work itself, which are not killed.
    before: &'static [&'static str],
    begin: &'static str,
    /// Goes on after a kill; the first line again where this is the same.
    again: &'static str,
    /// After the work, not killed.
    finish: Option<&'static str>,
    result: Outcome,
    needs: fn(&Swm) -> bool,
}

/// What is compared.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Outcome {
    /// A dataset, of which episodes count as they are committed.
    Dataset(&'static str),
    /// JSON files below `OUT`, without times.
    Json(&'static [&'static str]),
    /// Weights of a run.
    Run,
}

const RECORD: &str = "collect swm/PushT-v1 --policy weak --seed 11 --max-steps 20 --image-size 48x48 --num-envs 3 --report-every 0 --total 60 --out OUT";
const APPEND: &str = "collect swm/PushT-v1 --policy weak --seed 11 --max-steps 20 --image-size 48x48 --num-envs 3 --report-every 0 --total 60 --out OUT --mode append";
const TRAIN: &str = "--preset small --dataset IN/small.h5 --steps 30 --batch 4 --checkpoint-every 5 --log-every 5 --threads 2 --out OUT -q";

const fn recording(name: &'static str, out: &'static str, needs: fn(&Swm) -> bool) -> Work {
    let result = Outcome::Dataset("OUT");
    Work { name, out, before: &[], begin: RECORD, again: APPEND, finish: None, result, needs }
}

const ALL: &[Work] = &[
    recording("recording, hdf5", "a.h5", |_| true),
    recording("recording, folder", "a.folder", |_| true),
    recording("recording, video", "a.video", |_| true),
    recording("recording, mcap", "a.mcap", |_| true),
    recording("recording, lerobot", "a.lerobot", |swm| swm.has_lerobot),
    Work {
        name: "evaluation",
        out: "result",
        before: &[],
        begin: "eval --manifest IN/m.json --policy cem:samples=48,iterations=4,horizon=6,elites=8 --reference no-op --out OUT --threads 1",
        again: "eval --manifest IN/m.json --policy cem:samples=48,iterations=4,horizon=6,elites=8 --reference no-op --out OUT --threads 1",
        finish: None,
        result: Outcome::Json(&["receipt.json"]),
        needs: |_| true,
    },
    Work {
        name: "sweep",
        out: "result",
        before: &[],
        begin: "sweep --manifest IN/m.json --policy cem:samples=24,iterations=2,horizon=6,elites=4 --factors block.color,agent.color --values grid --points 3 --out OUT --threads 1",
        again: "sweep --manifest IN/m.json --policy cem:samples=24,iterations=2,horizon=6,elites=4 --factors block.color,agent.color --values grid --points 3 --out OUT --threads 1",
        finish: None,
        result: Outcome::Json(&["sweep.json"]),
        needs: |_| true,
    },
    Work {
        name: "job of a recording",
        out: "job",
        before: &[
            "submit --on script --no-copy --shards 5 --job OUT -- collect swm/PushT-v1 --policy weak --seed 11 --max-steps 20 --image-size 48x48 --episodes 60",
        ],
        begin: "task OUT --all",
        again: "task OUT --all",
        finish: Some("task OUT --finish"),
        result: Outcome::Dataset("OUT/result.h5"),
        needs: |_| true,
    },
    Work {
        name: "job of an evaluation",
        out: "job",
        before: &[
            "submit --on script --no-copy --shards 5 --job OUT -- eval --manifest IN/m.json --policy cem:samples=48,iterations=4,horizon=6,elites=8 --reference none",
        ],
        begin: "task OUT --all",
        again: "task OUT --all",
        finish: Some("task OUT --finish"),
        result: Outcome::Json(&["receipt.json"]),
        needs: |_| true,
    },
    Work {
        name: "training, gcbc",
        out: "run",
        before: &[],
        begin: "train gcbc TRAIN",
        again: "train --resume OUT --threads 2 -q",
        finish: None,
        result: Outcome::Run,
        needs: |swm| swm.has_baselines,
    },
    Work {
        name: "training, lewm",
        out: "run",
        before: &[],
        begin: "train lewm TRAIN",
        again: "train --resume OUT --threads 2 -q",
        finish: None,
        result: Outcome::Run,
        needs: |swm| swm.has_baselines,
    },
];

/// The inputs of the work, in `folder`.
fn prepare(swm: &Swm, folder: &Path) -> Result<()> {
    swm.ok(folder, "manifest make swm/PushT-v1 --episodes 8 --budget 20 --out m.json")?;
    swm.ok(
        folder,
        "collect swm/TwoRoom-v2 --policy expert --seed 1 --max-steps 20 --image-size 32x32 --episodes 12 --out small.h5",
    )?;
    Ok(())
}

/// Kills all kinds in turn, and adds a line for each to the table.
pub(crate) fn run(swm: &Swm, kills: usize, threads: usize, filter: &str, table: &mut Table) -> Result<()> {
    let folder = tempfile::tempdir().context("no folder for what is killed")?;
    let (there, absent): (Vec<&Work>, Vec<&Work>) =
        ALL.iter().filter(|work| work.name.contains(filter)).partition(|work| (work.needs)(swm));
    for work in absent {
        eprintln!("{}: left out, as the program was built without it", work.name);
    }
    if there.is_empty() {
        return Ok(());
    }
    prepare(swm, folder.path())?;
    for (index, work) in there.iter().enumerate() {
        // The rest goes to the first kinds.
        let count = kills / there.len() + usize::from(index < kills % there.len());
        let trials = Trials::new(swm, work, folder.path())?;
        table.push(trials.run(count, threads)?);
    }
    Ok(())
}

/// A kind of work, and what it makes when nothing disturbs it.
struct Trials<'a> {
    swm: &'a Swm,
    work: &'a Work,
    inputs: &'a Path,
    whole: PathBuf,
    expected: Content,
    /// Of the undisturbed work.
    took: Duration,
}

/// What is compared of a result; of a dataset, the command `diff` does it.
type Content = BTreeMap<PathBuf, Vec<u8>>;

impl<'a> Trials<'a> {
    /// Does the work once, undisturbed.
    fn new(swm: &'a Swm, work: &'a Work, inputs: &'a Path) -> Result<Self> {
        let folder = inputs.join(work.name.replace([' ', ','], "-"));
        fs::create_dir(&folder)?;
        let whole = folder.join(work.out);
        let mut trials =
            Self { swm, work, inputs, whole: whole.clone(), expected: Content::new(), took: Duration::ZERO };
        trials.before(&folder, &whole)?;
        let started = Instant::now();
        swm.ok(&folder, &trials.line(work.begin, &whole))?;
        trials.took = started.elapsed();
        trials.after(&folder, &whole)?;
        trials.expected = trials.content(&whole)?;
        Ok(trials)
    }

    /// A line with the names of its inputs and of what it makes.
    fn line(&self, line: &str, out: &Path) -> String {
        let line = line.replace("TRAIN", TRAIN).replace("IN/", &format!("{}/", self.inputs.display()));
        line.replace("OUT", &out.display().to_string())
    }

    fn before(&self, folder: &Path, out: &Path) -> Result<()> {
        self.work.before.iter().try_for_each(|line| self.swm.ok(folder, &self.line(line, out)).map(drop))
    }

    fn after(&self, folder: &Path, out: &Path) -> Result<()> {
        self.work.finish.iter().try_for_each(|line| self.swm.ok(folder, &self.line(line, out)).map(drop))
    }

    /// Kills it so often, in several folders at once.
    fn run(&self, kills: usize, threads: usize) -> Result<Line> {
        let started = Instant::now();
        let total = Mutex::new(Line::new("kill", self.work.name));
        let next = AtomicUsize::new(0);
        let failure = Mutex::new(None);
        thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        if index >= kills || failure.lock().is_ok_and(|failure| failure.is_some()) {
                            break;
                        }
                        match self.kill_once(index) {
                            Ok(line) => drop(total.lock().map(|mut total| total.add(&line))),
                            Err(error) => drop(failure.lock().map(|mut failure| *failure = Some(error))),
                        }
                    }
                });
            }
        });
        if let Some(error) = failure.into_inner().unwrap_or_default() {
            return Err(error.context(self.work.name));
        }
        let total = total.into_inner().unwrap_or_else(PoisonError::into_inner);
        let Line { tried, hit, lost, different, .. } = &total;
        let seconds = started.elapsed().as_secs();
        eprintln!(
            "{}: {tried} kills ({hit} amid work), {lost} lost, {different} differ, in {seconds} s",
            self.work.name
        );
        Ok(total)
    }

    /// One kill, and going on.
    fn kill_once(&self, index: usize) -> Result<Line> {
        let Self { swm, work, .. } = self;
        let folder = tempfile::tempdir().context("no folder for what is killed")?;
        let (folder, out) = (folder.path(), folder.path().join(work.out));
        let mut line = Line { tried: 1, ..Line::default() };
        self.before(folder, &out)?;
        let delay = self.took.mul_f64(random(index));
        let running = swm.start(folder, &words(&self.line(work.begin, &out)))?;
        let (said, was_running) = running.kill_after(delay)?;
        line.hit = usize::from(was_running);
        if said.contains("panicked at") {
            eprintln!("{}, kill {index}: {said}", work.name);
            line.panics += 1;
        }
        if matches!(work.result, Outcome::Dataset("OUT")) {
            line.committed = said.lines().filter(|line| is_commit(line)).count();
            let held = self.episodes(folder, &out)?;
            if held < line.committed {
                eprintln!(
                    "{}, kill {index}: {held} of {} committed episodes are left",
                    work.name, line.committed
                );
                line.lost = line.committed - held;
            }
        }
        let has_begun = work.result != Outcome::Run || out.join("config.json").exists();
        let again = self.line(if has_begun { work.again } else { work.begin }, &out);
        let mut lines = vec![again];
        lines.extend(work.finish.map(|finish| self.line(finish, &out)));
        for text in &lines {
            let ended = swm.run(folder, &words(text))?;
            line.longest_s = line.longest_s.max(ended.took.as_secs_f64());
            if !self.count(index, &ended, &mut line) {
                return Ok(line);
            }
        }
        if !self.is_whole(folder, &out)? {
            eprintln!("{}, kill {index} after {delay:?}: the result differs", work.name);
            line.different += 1;
        }
        Ok(line)
    }

    /// Counts how a run ended that had to succeed; whether it did.
    fn count(&self, index: usize, ended: &Ended, line: &mut Line) -> bool {
        if ended.code == Some(0) && ended.fault().is_none() {
            return true;
        }
        eprintln!("{}, kill {index}: going on failed: {}", self.work.name, ended.text());
        match ended.fault() {
            Some(Fault::Hang) => line.hangs += 1,
            Some(Fault::Memory) => line.memory += 1,
            Some(Fault::Panic) => line.panics += 1,
            None => line.different += 1,
        }
        false
    }

    /// How many episodes are there.
    fn episodes(&self, folder: &Path, out: &Path) -> Result<usize> {
        if !out.exists() {
            return Ok(0);
        }
        let ended = self.swm.run(folder, &words(&format!("inspect {} --json", out.display())))?;
        // A folder before its first episode is no dataset yet.
        let json: Json = serde_json::from_str(&ended.out).unwrap_or_default();
        Ok(json["episodes"].as_u64().unwrap_or(0) as usize)
    }

    /// Whether the result is that of the undisturbed work.
    fn is_whole(&self, folder: &Path, out: &Path) -> Result<bool> {
        match self.work.result {
            Outcome::Dataset(name) => {
                let [whole, made] =
                    [&*self.whole, out].map(|out| name.replace("OUT", &out.display().to_string()));
                let ended = self.swm.run(folder, &words(&format!("diff {whole} {made}")))?;
                Ok(ended.code == Some(0))
            }
            _ => Ok(self.content(out)? == self.expected),
        }
    }

    fn content(&self, out: &Path) -> Result<Content> {
        let mut content = Content::new();
        match self.work.result {
            Outcome::Dataset(_) => {}
            Outcome::Json(names) => {
                for name in names {
                    let file = out.join(name);
                    let text = fs::read(&file).with_context(|| format!("no {}", file.display()))?;
                    let mut json: Json = serde_json::from_slice(&text)?;
                    without_times(&mut json);
                    content.insert((*name).into(), serde_json::to_vec(&json)?);
                }
            }
            Outcome::Run => {
                for file in fs::read_dir(out.join("checkpoints"))? {
                    let file = file?.path();
                    if file.extension().is_some_and(|extension| extension == "safetensors") {
                        let name = file.file_name().unwrap_or_default().into();
                        content.insert(name, fs::read(&file)?);
                    }
                }
                if content.is_empty() {
                    bail!("{} has no weights", out.display());
                }
            }
        }
        Ok(content)
    }
}

fn is_commit(line: &str) -> bool {
    line.starts_with("episode ") && line.contains(" written to ")
}

/// A number from 0 to 1, the same for the same index.
fn random(index: usize) -> f64 {
    // The golden ratio spreads them evenly.
    (index as f64 + 0.5) * 0.618_033_988_749_894_9 % 1.0
}

/// Without what differs from run to run.
fn without_times(json: &mut Json) {
    match json {
        Json::Object(fields) => {
            fields.retain(|name, _| !["wall_time_s", "seconds", "modified"].contains(&name.as_str()));
            fields.values_mut().for_each(without_times);
        }
        Json::Array(items) => items.iter_mut().for_each(without_times),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn times_of_kills_are_spread_evenly() {
        let early = (0..100).filter(|&index| random(index) < 0.5).count();
        assert!((48..=52).contains(&early), "{early}");
        assert!((0..1000).all(|index| (0.0..1.0).contains(&random(index))));
    }

    #[test]
    fn times_are_not_compared() {
        let mut json = json!({ "a": [{ "wall_time_s": 1.5, "b": 2 }], "seconds": 3 });
        without_times(&mut json);
        assert_eq!(json, json!({ "a": [{ "b": 2 }] }));
    }

    #[test]
    fn every_kind_has_a_name_of_its_own() {
        let names: std::collections::BTreeSet<_> = ALL.iter().map(|work| work.name).collect();
        assert_eq!(names.len(), ALL.len());
    }
}
