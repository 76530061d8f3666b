//! Programs of engines: their output, within a time limit. A scheduler that does not answer must not hang `swm`.

use std::io::{Read, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;
use std::time::{Duration, Instant};

use crate::error::JobError;

/// Seconds that a program of an engine may take; `SWM_ENGINE_TIMEOUT` is another number.
const LIMIT: u64 = 60;
/// How long the output of an ended program is waited for: a child of its own may hold it open.
const GRACE: Duration = Duration::from_millis(500);
/// Between two looks.
const PAUSE: Duration = Duration::from_millis(2);

/// What a program said.
pub(crate) struct Said {
    pub(crate) is_ok: bool,
    pub(crate) out: String,
    pub(crate) err: String,
}

impl Said {
    /// What a person has to read: the errors, or else the output.
    pub(crate) fn words(&self) -> &str {
        if self.err.trim().is_empty() { self.out.trim() } else { self.err.trim() }
    }
}

/// Runs a program of an engine, without the settings of a job that this process may be in.
///
/// # Errors
///
/// It is not there, cannot be started, or does not end in time. That it fails is no error.
pub(crate) fn run(program: &'static str, args: &[&str], input: &str) -> Result<Said, JobError> {
    let limit =
        std::env::var("SWM_ENGINE_TIMEOUT").ok().and_then(|limit| limit.parse().ok()).unwrap_or(LIMIT);
    let mut command = Command::new(program);
    command.args(args).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    for (name, _) in std::env::vars_os() {
        let text = name.to_string_lossy();
        if (text.starts_with("SLURM_") || text.starts_with("SBATCH_")) && text != "SLURM_CONF" {
            command.env_remove(&name);
        }
    }
    let mut child = command.spawn().map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => JobError::NoProgram(program),
        _ => JobError::NotStarted { program, source: error },
    })?;
    if let Some(mut stdin) = child.stdin.take() {
        // A program that reads no input ends without it.
        let _ = stdin.write_all(input.as_bytes());
    }
    let (out, err) = (listen(child.stdout.take()), listen(child.stderr.take()));
    let started = Instant::now();
    let status = loop {
        match child.try_wait()? {
            Some(status) => break status,
            None if started.elapsed() > Duration::from_secs(limit) => {
                // It may have ended just now.
                let _ = child.kill();
                let _ = child.wait();
                return Err(JobError::NoAnswer { program, seconds: limit });
            }
            None => thread::sleep(PAUSE),
        }
    };
    let text = |heard: Receiver<Vec<u8>>| {
        let bytes = heard.recv_timeout(GRACE).unwrap_or_default();
        String::from_utf8_lossy(&bytes).into_owned()
    };
    Ok(Said { is_ok: status.success(), out: text(out), err: text(err) })
}

/// Reads to the end on a thread.
fn listen(from: Option<impl Read + Send + 'static>) -> Receiver<Vec<u8>> {
    let (to, heard) = channel();
    thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut from) = from {
            // What was read until an error counts.
            let _ = from.read_to_end(&mut bytes);
        }
        let _ = to.send(bytes);
    });
    heard
}

/// Bytes that are free where `dir` lies, if the system says it.
pub fn free_bytes(dir: &Path) -> Option<u64> {
    let said = run("df", &["-Pk", dir.to_str()?], "").ok()?;
    let blocks: u64 = said.out.lines().last()?.split_whitespace().nth(3)?.parse().ok()?;
    said.is_ok.then_some(blocks * 1024)
}

/// A word of a shell command.
pub(crate) fn quoted(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,@%".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text.to_owned(),
        false => format!("'{}'", text.replace('\'', r"'\''")),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn programs_are_heard() {
        let said =
            run("sh", &["-c", "read line; echo \"$line\"; echo warning >&2; exit 3"], "hello\n").unwrap();
        assert_eq!((said.is_ok, said.out.as_str(), said.words()), (false, "hello\n", "warning"));
        let message = run("swm-no-such-program", &[], "").err().map(|error| error.to_string());
        assert!(message.is_some_and(|message| message.contains("no program `swm-no-such-program`")));
    }

    #[test]
    fn free_space_is_known() {
        assert!(free_bytes(Path::new("/tmp")).is_some_and(|bytes| bytes > 0));
        assert_eq!(free_bytes(Path::new("/no/such/folder")), None);
    }

    #[test]
    fn words_of_a_shell_stay_words() {
        let words = ["plain/path", "with blank", "it's", "", "$HOME"];
        let line = words.map(quoted).join(" ");
        let said = run("sh", &["-c", &format!("printf '%s\\n' {line}")], "").unwrap();
        assert_eq!(said.out, words.map(|word| format!("{word}\n")).concat());
    }
}
