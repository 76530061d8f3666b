//! Recordings that are killed. Each runs in a process of its own, which is the test binary again with a variable that says
//! what to do: a test of the name that is given calls [`record_until_stopped`].

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use swm_core::Registry;

use super::{assert_alike, contents_in, episode, metadata, record_in, rows_of, schema};
use crate::format::built_in;
use crate::{WriteMode, create_in, open_in};

/// Names the dataset to the process that records.
pub const TARGET: &str = "SWM_DATA_TEST_RECORD_TO";

/// Where [`TARGET`] is set: records until it is stopped, and says so after every episode.
pub fn record_until_stopped() {
    record_until_stopped_in(built_in());
}

/// As [`record_until_stopped`], in a format of a registry.
pub fn record_until_stopped_in(registry: &Registry) {
    let Some(path) = std::env::var_os(TARGET) else { return };
    let schema = schema();
    let mut writer = create_in(registry, Path::new(&path), &WriteMode::Append.into(), None).unwrap();
    let there = writer.begin(&schema, &metadata()).unwrap() as usize;
    println!("\nbegun {there}");
    for index in there..2000 {
        if let Err(error) = writer.write_episode(&episode(&schema, index, rows_of(index))) {
            println!("failed {error}");
            return;
        }
        println!("written {}", index + 1);
    }
}

/// This test binary again: its test `test`, recording to `path`, behind the command line `shell`.
pub fn child(path: &Path, test: &str, shell: &str) -> Command {
    let mut command = Command::new("sh");
    let program = std::env::current_exe().unwrap();
    command.args(["-c", &format!("{shell} exec \"$0\" \"$@\"")]).arg(program);
    command.args(["--exact", test, "--nocapture", "--test-threads=1"]);
    command.env(TARGET, path).stdout(Stdio::piped()).stderr(Stdio::null());
    command
}

/// The number behind the last line that begins with `word`.
pub fn last(lines: &[String], word: &str) -> Option<usize> {
    lines.iter().rev().find_map(|line| line.strip_prefix(word)?.trim().parse().ok())
}

/// Kills a recording again and again, at different moments; what it committed must be there each time. The number of
/// episodes at the end, after it was continued.
pub fn kill(path: &Path, test: &str, rounds: u64) -> usize {
    kill_in(built_in(), path, test, rounds)
}

/// As [`kill`], in a format of a registry.
pub fn kill_in(registry: &Registry, path: &Path, test: &str, rounds: u64) -> usize {
    let mut committed = 0;
    for round in 0..rounds {
        let mut process = child(path, test, "").spawn().unwrap();
        let mut output = BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok);
        let mut lines = Vec::new();
        // Killed at different moments: before, while and after the first episodes are written.
        if round % 4 > 0 {
            lines.extend(output.by_ref().find(|line| line.starts_with("begun")));
        }
        if round % 4 == 3 {
            // However busy the machine is.
            lines.extend(output.by_ref().find(|line| line.starts_with("written")));
        }
        std::thread::sleep(Duration::from_millis(20 + 23 * (round % 8) + round));
        process.kill().unwrap();
        lines.extend(output);
        process.wait().unwrap();
        committed = last(&lines, "written ").unwrap_or(committed);
        if !path.exists() || open_in(registry, path).is_err() && committed == 0 {
            assert_eq!(committed, 0, "the file is gone");
            continue;
        }
        let read = contents_in(registry, path);
        assert!(read.len() >= committed, "{} episodes of {committed} committed", read.len());
        assert!(read.len() <= committed + 1);
        if let Some(there) = last(&lines, "begun ") {
            assert!(there <= committed);
        }
        for (index, batch) in read.iter().enumerate() {
            assert_alike(&episode(&schema(), index, rows_of(index)), batch);
        }
        committed = read.len();
    }
    assert!(committed > 0, "no round lived long enough to write an episode");

    let end = committed + 3;
    assert_eq!(record_in(registry, path, WriteMode::Append, committed..end).unwrap(), committed as u64);
    let read = contents_in(registry, path);
    assert_eq!(read.len(), end);
    for (index, batch) in read.iter().enumerate() {
        assert_alike(&episode(&schema(), index, rows_of(index)), batch);
    }
    // No lock and no draft is left.
    for entry in std::fs::read_dir(path.parent().unwrap()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(!name.ends_with(".lock") && !name.ends_with(".new"), "{name} is left");
    }
    end
}
