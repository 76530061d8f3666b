//! The log of a shard: a line per attempt, and what the command printed.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Seek as _, SeekFrom, Write as _};
use std::path::Path;

/// How an attempt begins.
const ATTEMPT: &str = "swm task: attempt ";
/// Progress is looked for in so many bytes at the end.
const PROGRESS_BYTES: u64 = 4 << 10;

/// A start of a shard's task.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Attempt {
    /// Counted from 1.
    pub number: u64,
    /// The node.
    pub node: String,
    /// The engine's job, if there is one.
    pub engine: String,
    /// Episodes that were committed before it.
    pub held: u64,
}

impl std::fmt::Display for Attempt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { number, node, engine, held } = self;
        write!(f, "{ATTEMPT}{number} on {node} by {engine}: {held} committed")
    }
}

impl Attempt {
    fn parse(line: &str) -> Option<Self> {
        let (number, rest) = line.strip_prefix(ATTEMPT)?.split_once(" on ")?;
        let (node, rest) = rest.split_once(" by ")?;
        let (engine, rest) = rest.rsplit_once(": ")?;
        let held = rest.strip_suffix(" committed")?.parse().ok()?;
        Some(Self { number: number.parse().ok()?, node: node.to_owned(), engine: engine.to_owned(), held })
    }
}

/// Opens a log to append to it, on a new line: an attempt that was killed may have ended in the middle of one.
///
/// # Errors
///
/// It cannot be read or written.
pub fn open(log: &Path) -> std::io::Result<File> {
    let mut file = swm_files::append_own(log)?;
    if file.metadata()?.len() > 0 {
        let mut last = [0];
        file.seek(SeekFrom::End(-1))?;
        file.read_exact(&mut last)?;
        if last != *b"\n" {
            file.write_all(b"\n")?;
        }
    }
    Ok(file)
}

/// All attempts, the oldest first. A log that is not there has none; one with a line per episode may be long.
pub fn attempts(log: &Path) -> Vec<Attempt> {
    let Ok(file) = File::open(log) else { return Vec::new() };
    let lines = BufReader::new(file).split(b'\n').map_while(Result::ok);
    let begun = lines.filter(|line| line.starts_with(ATTEMPT.as_bytes()));
    begun.filter_map(|line| Attempt::parse(&String::from_utf8_lossy(&line))).collect()
}

/// The number after the last episode that `swm collect` said it wrote.
pub fn last_episode(log: &Path) -> Option<u64> {
    let text = tail(log, PROGRESS_BYTES);
    let number =
        |line: &str| line.strip_prefix("episode ")?.split_once(" written to ")?.0.parse::<u64>().ok();
    text.lines().rev().find_map(number).map(|episode| episode + 1)
}

/// The last `bytes` of a file, as text.
fn tail(path: &Path, bytes: u64) -> String {
    let read = || -> std::io::Result<String> {
        let mut file = File::open(path)?;
        let len = file.metadata()?.len();
        file.seek(SeekFrom::Start(len.saturating_sub(bytes)))?;
        let mut text = Vec::new();
        file.take(bytes).read_to_end(&mut text)?;
        Ok(String::from_utf8_lossy(&text).into_owned())
    };
    read().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn attempts_are_read_as_they_are_written() {
        let attempt = |number, engine: &str, held| {
            Attempt { number, node: "n1".into(), engine: engine.into(), held }.to_string()
        };
        let path = std::env::temp_dir().join(format!("swm-log-{}", std::process::id()));
        let lines = [
            attempt(1, "slurm 12", 0),
            "episode 6 written to a.h5 (3 rows)\n".repeat(20_000),
            "episode 7 written to a.h5 (3 rows)".to_owned(),
            attempt(2, "nothing", 8),
            "swm task: attempt without an end".to_owned(),
        ];
        std::fs::write(&path, lines.join("\n")).unwrap();
        let found = attempts(&path);
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].engine.as_str(), found[1].number, found[1].held), ("slurm 12", 2, 8));
        assert_eq!(last_episode(&path), Some(8));
        std::fs::remove_file(&path).unwrap();
        assert!(attempts(&path).is_empty() && last_episode(&path).is_none());
    }

    #[test]
    fn an_attempt_after_a_kill_begins_a_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("0001.log");
        let attempt = |number| Attempt { number, node: "n1".into(), engine: "slurm 12".into(), held: 0 };
        // The first attempt was killed in the middle of a line, the second one between two lines.
        for (number, rest) in [(1, "episode 7 written to"), (2, "episode 8 written\n"), (3, "")] {
            write!(open(&path).unwrap(), "{}\n{rest}", attempt(number)).unwrap();
        }
        assert_eq!(attempts(&path), [attempt(1), attempt(2), attempt(3)]);
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.lines().all(|line| !line.is_empty()), "no line was added in vain: {text}");
    }
}
