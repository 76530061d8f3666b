//! One run of the command `swm`, with a limit of time and memory, and how it ended.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};

/// What a run may take, on a machine that is busy.
const PATIENCE: Duration = Duration::from_secs(60);
/// Memory that a run may ask for, in KiB: 2 GiB of address space, which is more than it uses.
const MEMORY_KIB: u64 = 2 << 20;
/// Between two looks at a process.
const PAUSE: Duration = Duration::from_millis(1);

/// The command under test.
pub(crate) struct Swm {
    program: PathBuf,
    /// Whether it trains.
    pub(crate) has_baselines: bool,
    /// Whether it has the format `lerobot`.
    pub(crate) has_lerobot: bool,
}

/// How a run ended.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) out: String,
    pub(crate) err: String,
    pub(crate) took: Duration,
    /// It was stopped after [`PATIENCE`].
    is_late: bool,
}

impl Swm {
    pub(crate) fn new(program: PathBuf) -> Result<Self> {
        let mut swm = Self { program, has_baselines: false, has_lerobot: false };
        let version = swm.run(Path::new("."), &words("--version"))?;
        let features = version.out.lines().find_map(|line| line.strip_prefix("features: "));
        let Some(features) = features else {
            bail!("{} is not the command `swm`: {}{}", swm.program.display(), version.out, version.err);
        };
        let has = |name: &str| features.split_whitespace().any(|feature| feature == name);
        (swm.has_baselines, swm.has_lerobot) = (has("baselines"), has("lerobot"));
        eprintln!("program: {}, features {features}", swm.program.display());
        Ok(swm)
    }

    fn command(&self, folder: &Path, args: &[String]) -> Command {
        // A shell sets the limit. There is none on Windows.
        let mut command = match cfg!(unix) {
            true => {
                let mut shell = Command::new("sh");
                shell.args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" \"$@\"")]).arg(&self.program);
                shell
            }
            false => Command::new(&self.program),
        };
        // Stacks of threads count as memory, and machines have many cores.
        command.args(args).current_dir(folder).env("RAYON_NUM_THREADS", "2").env("RUST_BACKTRACE", "0");
        command
    }

    /// Starts it; its output is discarded but for the standard error.
    pub(crate) fn start(&self, folder: &Path, args: &[String]) -> Result<Running> {
        let mut command = self.command(folder, args);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().context("the program cannot be started")?;
        let err = listen(child.stderr.take());
        Ok(Running { child, err })
    }

    /// Runs it to its end.
    pub(crate) fn run(&self, folder: &Path, args: &[String]) -> Result<Ended> {
        let mut command = self.command(folder, args);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let started = Instant::now();
        let mut child = command.spawn().context("the program cannot be started")?;
        let (out, err) = (listen(child.stdout.take()), listen(child.stderr.take()));
        let status = wait(&mut child, started)?;
        let is_late = status.is_none();
        if is_late {
            stop(&mut child)?;
        }
        let code = status.and_then(|status| status.code());
        Ok(Ended { code, out: heard(out), err: heard(err), took: started.elapsed(), is_late })
    }

    /// Runs a line that must succeed.
    pub(crate) fn ok(&self, folder: &Path, line: &str) -> Result<Ended> {
        let ended = self.run(folder, &words(line))?;
        match ended.code {
            Some(0) => Ok(ended),
            _ => bail!("`swm {line}`: {}", ended.text()),
        }
    }
}

/// A run that may be killed.
pub(crate) struct Running {
    child: Child,
    err: JoinHandle<String>,
}

impl Running {
    /// Kills it after a time, if it has not ended. Returns what it wrote to the standard error, and whether it was still running.
    pub(crate) fn kill_after(mut self, delay: Duration) -> Result<(String, bool)> {
        let started = Instant::now();
        while started.elapsed() < delay && self.child.try_wait()?.is_none() {
            thread::sleep(PAUSE);
        }
        let was_running = self.child.try_wait()?.is_none();
        stop(&mut self.child)?;
        Ok((heard(self.err), was_running))
    }
}

impl Ended {
    /// What it must not do, if it did; `None` for success and for an error in a sentence.
    pub(crate) fn fault(&self) -> Option<Fault> {
        let says = |words: &[&str]| words.iter().any(|words| self.err.contains(words));
        match self.code {
            _ if self.is_late => Some(Fault::Hang),
            _ if says(&["memory allocation of", "capacity overflow"]) => Some(Fault::Memory),
            _ if says(&["panicked at"]) => Some(Fault::Panic),
            Some(0..=2 | 75) => None,
            _ => Some(Fault::Panic),
        }
    }

    /// Its status and its last words.
    pub(crate) fn text(&self) -> String {
        let code = self.code.map_or_else(|| "ended by a signal".to_owned(), |code| format!("status {code}"));
        let lines: Vec<&str> = self.err.lines().rev().take(3).collect();
        format!("{code}: {}", lines.into_iter().rev().collect::<Vec<_>>().join(" | "))
    }
}

/// What no input may cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fault {
    /// A panic, or an end by a signal.
    Panic,
    Hang,
    Memory,
}

fn wait(child: &mut Child, started: Instant) -> Result<Option<ExitStatus>> {
    while started.elapsed() < PATIENCE {
        if let Some(status) = child.try_wait()? {
            return Ok(Some(status));
        }
        thread::sleep(PAUSE);
    }
    Ok(None)
}

fn stop(child: &mut Child) -> Result<()> {
    // One that has ended meanwhile cannot be killed.
    let _ = child.kill();
    child.wait().context("the program does not end")?;
    Ok(())
}

fn listen(from: Option<impl Read + Send + 'static>) -> JoinHandle<String> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        // What was written before a kill is whole or not there.
        let _ = from.map(|mut from| from.read_to_end(&mut bytes));
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

fn heard(thread: JoinHandle<String>) -> String {
    thread.join().unwrap_or_default()
}

/// The words of a line.
pub(crate) fn words(line: &str) -> Vec<String> {
    line.split_whitespace().map(str::to_owned).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ended(code: Option<i32>, err: &str) -> Ended {
        Ended { code, out: String::new(), err: err.to_owned(), took: Duration::ZERO, is_late: false }
    }

    #[test]
    fn errors_in_a_sentence_are_no_faults() {
        for code in [0, 1, 2, 75] {
            assert_eq!(ended(Some(code), "error: it is damaged").fault(), None);
        }
        assert_eq!(ended(Some(101), "thread 'main' panicked at src/a.rs").fault(), Some(Fault::Panic));
        assert_eq!(ended(Some(1), "thread 'x' panicked at src/a.rs").fault(), Some(Fault::Panic));
        assert_eq!(ended(None, "").fault(), Some(Fault::Panic));
        assert_eq!(ended(None, "memory allocation of 8 bytes failed").fault(), Some(Fault::Memory));
        assert_eq!(Ended { is_late: true, ..ended(None, "") }.fault(), Some(Fault::Hang));
    }

    #[test]
    fn a_program_that_is_no_swm_is_refused() {
        let error = Swm::new("/bin/echo".into()).err().map(|error| error.to_string());
        assert!(cfg!(not(unix)) || error.is_some_and(|error| error.contains("is not the command `swm`")));
    }
}
