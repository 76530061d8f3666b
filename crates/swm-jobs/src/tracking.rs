//! Trackers that follow a training run: a program of the Python package reads the run's `metrics.jsonl` as it grows.
//!
//! A training does not wait for trackers, and goes on where one fails: its file has every line, which `swm.track.send` hands over later.
//! TensorBoard needs no program, as every run has event files.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use swm_tasks::request::Message;
use swm_tasks::traps::pythons;

use crate::error::JobError;

/// Trackers that follow a training run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tracking {
    /// Their names.
    pub trackers: Vec<String>,
    /// What they group runs by.
    pub project: Option<String>,
}

/// The tracker that reads the event files of a run.
const TENSORBOARD: &str = "tensorboard";
/// How long libraries of trackers may take to start, and to end their runs.
const START: Duration = Duration::from_secs(60);
const END: Duration = Duration::from_secs(60);

/// The module of the Python package that follows a run.
const MODULE: &str = "stable_worldmodel_rs.track";

/// The refusal of a tracker.
fn wrong(reason: impl Into<String>) -> JobError {
    Message::about_setting("track", reason).into()
}

/// Does `work`, a training in the folder `run`, while trackers follow it.
///
/// # Errors
///
/// A tracker cannot be started, or `work` fails.
pub fn around<E: From<JobError>>(
    tracking: &Tracking,
    run: &Path,
    note: impl Fn(String),
    work: impl FnOnce() -> Result<(), E>,
) -> Result<(), E> {
    let is_own = |name: &&String| *name == TENSORBOARD;
    if tracking.trackers.iter().any(|name| is_own(&name)) {
        note(format!("TensorBoard reads the run's event files: tensorboard --logdir {}", run.display()));
    }
    let others: Vec<&str> =
        tracking.trackers.iter().filter(|name| !is_own(name)).map(String::as_str).collect();
    if others.is_empty() {
        return work();
    }
    let mut follower = Follower::start(pythons(), run, &others, tracking.project.as_deref())?;
    let done = work();
    if let Err(reason) = follower.finish() {
        note(format!(
            "tracking stopped: {reason}; {} has every line, and Python hands them over: swm.track.send({:?}, {:?})",
            run.join("metrics.jsonl").display(),
            run.display().to_string(),
            others.join(",")
        ));
    }
    done
}

/// A program that follows a run, until its standard input is closed: also where this process is killed.
struct Follower {
    child: Child,
    said: Receiver<String>,
}

impl Follower {
    /// Starts the first of some interpreters that has the package.
    fn start(
        pythons: impl IntoIterator<Item = String>,
        run: &Path,
        trackers: &[&str],
        project: Option<&str>,
    ) -> Result<Self, JobError> {
        for python in pythons {
            // Without the current folder, whose files are no packages.
            let mut command = Command::new(python);
            command.args(["-c", &format!("import runpy, sys; sys.path = [p for p in sys.path if p]; runpy.run_module({MODULE:?}, run_name='__main__', alter_sys=True)")]);
            command.arg(run).arg(trackers.join(","));
            command.args(project.map(|project| format!("--project={project}")));
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
            #[cfg(unix)]
            std::os::unix::process::CommandExt::process_group(&mut command, 0);
            let Ok(mut child) = command.spawn() else { continue };
            let (sender, said) = channel();
            if let Some(out) = child.stdout.take() {
                std::thread::spawn(move || {
                    BufReader::new(out)
                        .lines()
                        .map_while(Result::ok)
                        .try_for_each(|line| sender.send(line).ok())
                });
            }
            match said.recv_timeout(START) {
                Ok(line) if line == "ready" => return Ok(Self { child, said }),
                Ok(line) => {
                    let _ = child.wait();
                    return Err(wrong(line.strip_prefix("error ").unwrap_or(&line)));
                }
                // An interpreter without the package ends without a word.
                Err(_) => {
                    let _ = child.kill();
                    let _ = child.wait();
                }
            }
        }
        let trackers = trackers.join(" ");
        Err(wrong(format!(
            "{trackers} needs the Python package stable_worldmodel_rs, the wheel of a release, and `pip install {trackers}`; SWM_PYTHON=PYTHON \
             names its interpreter where it is not the first on the search path; or leave it out: the run has metrics.jsonl and event files \
             for TensorBoard"
        )))
    }

    /// Ends it: it hands on what is left.
    ///
    /// # Errors
    ///
    /// A tracker failed, or does not end.
    fn finish(&mut self) -> Result<(), String> {
        drop(self.child.stdin.take());
        let said = match self.said.recv_timeout(END) {
            Ok(line) => line,
            Err(RecvTimeoutError::Disconnected) => {
                return match self.child.wait() {
                    Ok(status) if !status.success() => Err(format!("its program ended by {status}")),
                    _ => Ok(()),
                };
            }
            Err(RecvTimeoutError::Timeout) => {
                let _ = self.child.kill();
                let _ = self.child.wait();
                return Err(format!("it took more than {} s to end", END.as_secs()));
            }
        };
        let _ = self.child.wait();
        Err(said.strip_prefix("error ").unwrap_or(&said).to_owned())
    }
}

#[cfg(all(test, unix))]
#[expect(clippy::unwrap_used, reason = "what a helper cannot do ends its test")]
mod tests {
    use std::fs;
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    /// A program in the place of Python.
    fn python(folder: &Path, script: &str) -> String {
        let path = folder.join("python");
        fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
        fs::set_permissions(&path, fs::Permissions::from_mode(0o755)).unwrap();
        path.display().to_string()
    }

    fn started(script: &str) -> Result<Follower, JobError> {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("none").display().to_string();
        Follower::start(
            [missing, python(folder.path(), script)],
            Path::new("runs/a"),
            &["trackio"],
            Some("p"),
        )
    }

    /// One after the other: a file that another thread writes while this one forks cannot be run.
    #[test]
    fn a_follower_says_what_is_missing_and_what_fails() {
        let script = r#"test "$3,$4,$5" = "runs/a,trackio,--project=p" && echo ready; cat"#;
        assert_eq!(started(script).ok().unwrap().finish(), Ok(()));

        let mut follower = started("echo ready; cat; echo 'error the disk is full'; exit 1").ok().unwrap();
        assert_eq!(follower.finish(), Err("the disk is full".to_owned()));
        let mut follower = started("echo ready; cat; exit 3").ok().unwrap();
        assert!(follower.finish().unwrap_err().contains("exit status: 3"));

        let reason = "tracking by trackio needs the package trackio; `pip install trackio`";
        let said = started(&format!("echo 'error {reason}'")).err().unwrap().to_string();
        assert!(said.contains(&format!("track: {reason}")), "{said}");
        let said = started("exit 1").err().unwrap().to_string();
        let words = ["`pip install trackio`", "SWM_PYTHON=PYTHON"];
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
}
