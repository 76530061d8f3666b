//! Engines: schedulers that start the tasks of a job. Each is one file in `engines/` and one line of [`ENGINES`].

use std::collections::BTreeMap;
use std::fs::OpenOptions;
use std::io::Write as _;

use serde::{Deserialize, Serialize};
use swm_core::error::nearest;
use swm_tasks::request::{Message, cannot};

use crate::engines::{hq, script, slurm};
use crate::error::JobError;
use crate::job::JobFolder;
use swm_tasks::text_file::read_text;

/// Every engine.
pub const ENGINES: &[Engine] = &[slurm::ENGINE, hq::ENGINE, script::ENGINE];

/// An engine, as `--on NAME:KEY=VALUE,…` chooses it.
#[derive(Clone, Copy, Debug)]
pub struct Engine {
    /// Its name.
    pub name: &'static str,
    /// What it is, for help texts.
    pub about: &'static str,
    /// Its keys and what they mean.
    pub keys: &'static [(&'static str, &'static str)],
    /// How it is reached.
    pub driver: &'static dyn Driver,
}

/// What is to be submitted.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The job.
    pub folder: &'a JobFolder,
    /// The settings of the engine.
    pub settings: &'a Settings,
    /// The number of entries that the shards are spread over: entry t runs shards t, t + entries, …
    pub entries: u64,
    /// The entries to start, ascending; none: only the end is left.
    pub indices: &'a [u64],
    /// Jobs of the engine that still hold shards: the end waits for them, too.
    pub after: &'a [String],
}

/// A task that an engine holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Queued {
    /// The engine's job.
    pub id: String,
    /// The entry; `None`: the task that joins the shards.
    pub entry: Option<u64>,
    /// Whether it runs.
    pub is_running: bool,
    /// The engine's words.
    pub state: String,
}

/// How an engine is talked to.
pub trait Driver: Sync + std::fmt::Debug {
    /// How many entries the shards of a job can be spread over.
    ///
    /// # Errors
    ///
    /// A setting is wrong.
    fn entries(&self, shards: u64, settings: &Settings) -> Result<u64, JobError>;

    /// Checks what can be known of the settings before anything is written.
    ///
    /// # Errors
    ///
    /// A setting is wrong.
    fn check(&self, _settings: &Settings) -> Result<(), JobError> {
        Ok(())
    }

    /// What the engine is given.
    ///
    /// # Errors
    ///
    /// A setting is wrong, or the engine cannot have it.
    fn script(&self, request: &Request<'_>) -> Result<String, JobError>;

    /// Hands a script over; returns the engine's name for it. `None`: nothing was submitted, a person does it.
    ///
    /// # Errors
    ///
    /// The engine refuses it, in its words.
    fn submit(&self, request: &Request<'_>, script: &str) -> Result<Option<String>, JobError>;

    /// The script of the task that joins the shards once job `id` has ended, where [`Driver::script`] does not hold it.
    ///
    /// # Errors
    ///
    /// As of [`Driver::script`].
    fn finish_script(&self, _request: &Request<'_>, _id: &str) -> Result<Option<String>, JobError> {
        Ok(None)
    }

    /// [`Driver::script`], and behind it in comments what is submitted apart from it: handed over as it is printed, it is the same.
    ///
    /// # Errors
    ///
    /// As of [`Driver::script`].
    fn dry_run(&self, request: &Request<'_>) -> Result<String, JobError> {
        let mut text = self.script(request)?;
        if let Some(finish) = self.finish_script(request, "ARRAY_ID")? {
            text += "\n# The join of the shards, a job of its own that waits for the array:\n";
            text.extend(finish.lines().map(|line| format!("#   {line}\n")));
        }
        Ok(text)
    }

    /// Submits the task that joins the shards once job `id` has ended, where [`Driver::script`] does not hold it.
    ///
    /// # Errors
    ///
    /// As of [`Driver::submit`].
    fn submit_finish(&self, _request: &Request<'_>, _id: &str) -> Result<(), JobError> {
        Ok(())
    }

    /// The tasks of the job that the engine holds.
    ///
    /// # Errors
    ///
    /// The engine does not answer.
    fn queued(&self, folder: &JobFolder) -> Result<Vec<Queued>, JobError>;

    /// Cancels the tasks of the job.
    ///
    /// # Errors
    ///
    /// The engine does not answer.
    fn cancel(&self, folder: &JobFolder) -> Result<(), JobError>;
}

/// A line of `submissions.jsonl`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Submission {
    /// The engine with its settings, as `--on` has them.
    pub on: String,
    /// The engine's name for it.
    pub id: String,
    /// The number of entries that the shards were spread over.
    pub entries: u64,
    /// The entries that were started, as `1-3,7`.
    pub indices: String,
    /// What the engine got.
    pub script: String,
    /// Seconds since 1970.
    pub time: u64,
}

impl Submission {
    /// Appends it to the file.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn record(&self, folder: &JobFolder) -> Result<(), JobError> {
        let path = folder.submissions();
        let line = serde_json::to_string(self)? + "\n";
        let file = OpenOptions::new().create(true).append(true).open(&path);
        let written = file.and_then(|mut file| file.write_all(line.as_bytes()));
        Ok(written.map_err(cannot("write", &path))?)
    }

    /// All submissions of a job; a line that was cut off is left out.
    ///
    /// # Errors
    ///
    /// The file cannot be read.
    pub fn all(folder: &JobFolder) -> Result<Vec<Self>, JobError> {
        let path = folder.submissions();
        match read_text(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Vec::new()),
            Err(error) => Err(cannot("read", &path)(error).into()),
            Ok(text) => Ok(text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()),
        }
    }
}

/// The settings of an engine.
#[derive(Clone, Debug, Default)]
pub struct Settings(BTreeMap<String, String>);

impl Settings {
    /// The value of a key, if it is given.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    /// A whole number above 0.
    ///
    /// # Errors
    ///
    /// It is something else.
    pub fn number(&self, key: &str) -> Result<Option<u64>, JobError> {
        let read = |text: &str| match text.parse() {
            Ok(number) if number > 0 => Ok(number),
            _ => Err(wrong(format!("{key}={text} is no whole number above 0"))),
        };
        self.get(key).map(read).transpose()
    }
}

/// The refusal of an engine or of what it is given.
pub(crate) fn wrong(reason: impl Into<String>) -> JobError {
    Message::about_setting("on", reason).into()
}

/// Reads `NAME:KEY=VALUE,…`. The value of `raw` is everything behind it.
///
/// # Errors
///
/// There is no such engine or key; the message names those that exist.
pub fn engine(text: &str) -> Result<(&'static Engine, Settings), JobError> {
    let (name, rest) = text.split_once(':').unwrap_or((text, ""));
    let names = || ENGINES.iter().map(|engine| engine.name).collect::<Vec<_>>().join(", ");
    let engine = ENGINES.iter().find(|engine| engine.name == name);
    let engine = engine.ok_or_else(|| {
        wrong(format!(
            "`{name}` is unknown; there are: {}; script prints the commands for any other scheduler",
            names()
        ))
    })?;
    let wrong = |reason: String| wrong(format!("{name}: {reason}"));
    let mut settings = BTreeMap::new();
    let mut rest = rest;
    while !rest.is_empty() {
        let is_raw = rest.starts_with("raw=");
        let (one, more) = if is_raw { (rest, "") } else { rest.split_once(',').unwrap_or((rest, "")) };
        rest = more;
        let (key, value) =
            one.split_once('=').ok_or_else(|| wrong(format!("write KEY=VALUE, not `{one}`")))?;
        if !engine.keys.iter().any(|(known, _)| *known == key) {
            let keys: Vec<&str> = engine.keys.iter().map(|(key, _)| *key).collect();
            let known = match keys.is_empty() {
                true => "it has none".to_owned(),
                false => format!("its keys: {}", keys.join(", ")),
            };
            let hint = nearest(key, keys).map_or(String::new(), |near| format!(" (did you mean `{near}`?)"));
            return Err(wrong(format!("there is no key `{key}`{hint}; {known}")));
        }
        let value = value.trim_matches('"');
        if value.is_empty() || value.contains('\n') {
            return Err(wrong(format!("{key} needs a value in one line")));
        }
        settings.insert(key.to_owned(), value.to_owned());
    }
    let settings = Settings(settings);
    engine.driver.check(&settings)?;
    Ok((engine, settings))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_engine_has_a_name_and_explains_its_keys() {
        for (at, engine) in ENGINES.iter().enumerate() {
            assert!(ENGINES[..at].iter().all(|other| other.name != engine.name), "{}", engine.name);
            assert!(!engine.about.is_empty() && engine.keys.iter().all(|(_, about)| !about.is_empty()));
        }
    }

    #[test]
    fn settings_are_read() {
        let (slurm, settings) = engine("slurm:partition=cpu,tasks=8,raw=--constraint=a,b --nice").unwrap();
        assert_eq!((slurm.name, settings.get("partition")), ("slurm", Some("cpu")));
        assert_eq!(settings.number("tasks").unwrap(), Some(8));
        assert_eq!(settings.get("raw"), Some("--constraint=a,b --nice"));
        let message = |text: &str| engine(text).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(message("pbs").contains("slurm, hq, script"), "{}", message("pbs"));
        assert!(message("slurm:partion=cpu").contains("no key `partion` (did you mean `partition`?); its"));
        assert!(message("slurm:cpu").contains("KEY=VALUE"));
        assert!(message("script:a=b").contains("it has none"));
        let (_, settings) = engine("slurm:tasks=0").unwrap();
        assert!(settings.number("tasks").is_err());
    }
}
