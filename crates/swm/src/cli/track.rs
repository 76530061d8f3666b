//! `swm train --track`: metrics in trackers, by a program of the Python package that follows the run's `metrics.jsonl`.
//!
//! A training does not wait for trackers, and goes on where one fails: its file has every line, which `swm.track.send` hands over later.
//! TensorBoard needs no program, as every run has event files.

use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::Duration;

use clap::{Args, ValueEnum};
use swm_tasks::traps::pythons;

use super::{Failure, Output, usage};
use crate::jobs::Tracking;

/// Where metrics go beside the run's folder.
#[derive(Args, Clone, Default)]
#[command(next_help_heading = "Tracking")]
pub(super) struct TrackArgs {
    /// Send metrics to a tracker as they come; several with commas. tensorboard reads the run's own event files, the others need the
    /// Python package.
    #[arg(long, value_name = "TRACKER", value_delimiter = ',')]
    track: Vec<Tracker>,
    /// What the tracker groups runs by. Default: stable-worldmodel.
    #[arg(long, value_name = "NAME", requires = "track")]
    track_project: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Tracker {
    Trackio,
    Wandb,
    Mlflow,
    Tensorboard,
}

impl Tracker {
    fn name(self) -> &'static str {
        match self {
            Self::Trackio => "trackio",
            Self::Wandb => "wandb",
            Self::Mlflow => "mlflow",
            Self::Tensorboard => "tensorboard",
        }
    }
}

/// How long libraries of trackers may take to start, and to end their runs.
const START: Duration = Duration::from_secs(60);
const END: Duration = Duration::from_secs(60);

/// The module of the Python package that follows a run.
const MODULE: &str = "stable_worldmodel_rs.track";

impl TrackArgs {
    /// What follows the training.
    pub(super) fn tracking(&self) -> Tracking {
        let trackers = self.track.iter().map(|tracker| tracker.name().to_owned()).collect();
        Tracking { trackers, project: self.track_project.clone() }
    }
}

/// Does `work`, a training in the folder `run`, while trackers follow it.
///
/// # Errors
///
/// A tracker cannot be started, or `work` fails.
pub(super) fn around(
    tracking: &Tracking,
    run: &Path,
    output: &Output,
    work: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    let is_own = |name: &&String| *name == Tracker::Tensorboard.name();
    if tracking.trackers.iter().any(|name| is_own(&name)) {
        output
            .note(format!("TensorBoard reads the run's event files: tensorboard --logdir {}", run.display()));
    }
    let others: Vec<&str> =
        tracking.trackers.iter().filter(|name| !is_own(name)).map(String::as_str).collect();
    if others.is_empty() {
        return work();
    }
    let mut follower = Follower::start(pythons(), run, &others, tracking.project.as_deref())?;
    let done = work();
    if let Err(reason) = follower.finish() {
        output.note(format!(
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
    ) -> Result<Self, Failure> {
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
                    return Err(usage(format!("--track: {}", line.strip_prefix("error ").unwrap_or(&line))));
                }
                // An interpreter without the package ends without a word.
                Err(_) => {
                    let _ = child.kill();
                    let _ = child.wait();
                }
            }
        }
        let trackers = trackers.join(" ");
        Err(usage(format!(
            "--track: {trackers} needs the Python package: pip install stable-worldmodel-rs {trackers}, and SWM_PYTHON=PYTHON names its \
             interpreter where it is not the first on the search path; or leave it out: the run has metrics.jsonl and event files for \
             TensorBoard"
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

    fn started(script: &str) -> Result<Follower, Failure> {
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
        assert!(said.contains(&format!("--track: {reason}")), "{said}");
        let said = started("exit 1").err().unwrap().to_string();
        let words = ["pip install stable-worldmodel-rs trackio", "SWM_PYTHON=PYTHON"];
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    }
}
