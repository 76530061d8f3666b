//! Folders of jobs, of which a file has the bytes of the fuzzer.

use std::ffi::OsString;
use std::path::Path;

use crate::sample::{Sample, Samples};

/// Runs the command, which prints to the standard output.
fn run(words: &[&str], path: &Path) {
    let words = words.iter().map(|&word| if word == "JOB" { path.into() } else { OsString::from(word) });
    let _ = swm::cli::run(&swm::registry(), [OsString::from("swm"), "-q".into()].into_iter().chain(words));
}

/// A job of two shards, one of which is done.
pub fn samples() -> Samples {
    let submit = "submit --on script --no-copy --shards 2 --job JOB -- collect swm/TwoRoom-v2 --max-steps 4 --episodes 2 --image-size none";
    Samples::new(vec![Sample::new("job", |path| {
        run(&submit.split(' ').collect::<Vec<_>>(), path);
        run(&["task", "JOB", "--index", "1"], path);
    })])
}

/// Its state, and whether it can be joined.
pub fn read(path: &Path) {
    run(&["jobs", "JOB"], path);
    run(&["task", "JOB", "--finish"], path);
}
