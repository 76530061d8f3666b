//! Running the command under test, and reading what it wrote.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use swm::core::{Batch, Schema, Slice};

pub(crate) const PUSHT: &str = "swm/PushT-v1";

/// A recording of short episodes without images.
const SHORT: &str = "collect swm/TwoRoom-v2 --policy noisy-expert:2 --max-steps 6 --image-size none";

/// The arguments of a recording that takes milliseconds, with more of them.
pub(crate) fn short_recording<'a>(more: &[&'a str]) -> Vec<&'a str> {
    SHORT.split(' ').chain(more.iter().copied()).collect()
}

/// The command `swm`.
pub(crate) fn swm(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_swm-under-test"));
    command.args(args);
    command
}

/// Runs `swm` and demands success; returns what it printed.
pub(crate) fn swm_ok(args: &[&str]) -> String {
    let output = run(args);
    assert!(output.status.success(), "swm {args:?} failed:\n{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("output is text")
}

/// Runs `swm --json` and demands success; returns the result.
pub(crate) fn swm_json(args: &[&str]) -> serde_json::Value {
    let mut args = args.to_vec();
    args.push("--json");
    serde_json::from_str(&swm_ok(&args)).expect("--json prints JSON")
}

/// Runs `swm --json` and returns the result, also of a command that finds a difference.
pub(crate) fn swm_finds(args: &[&str]) -> serde_json::Value {
    let output = run(&[args, &["--json"]].concat());
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("swm {args:?}: {error}: {message}"))
}

/// Runs `swm` and demands a failure with this exit status; returns what it said.
pub(crate) fn swm_fails(status: i32, args: &[&str]) -> String {
    let output = run(args);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(status), "swm {args:?} said:\n{message}");
    message
}

/// As [`swm_fails`], and demands that the message holds every word, and none of our inside.
pub(crate) fn says(status: i32, args: &[&str], words: &[&str]) {
    let message = swm_fails(status, args);
    for word in words {
        assert!(message.contains(word), "swm {args:?}: no `{word}` in\n{message}");
    }
    for inner in ["panicked", "Number("] {
        assert!(!message.contains(inner), "{message}");
    }
}

/// The words of `swm collect` in PushT, quietly to `out`; `more` of them are divided at blanks.
pub(crate) fn collecting<'a>(out: &'a str, more: &'a str) -> Vec<&'a str> {
    ["collect", PUSHT, "--out", out, "--quiet"].into_iter().chain(more.split_whitespace()).collect()
}

/// Records PushT to a file of the folder, as [`collecting`] says; returns its path.
pub(crate) fn record(folder: &Folder, name: &str, more: &str) -> String {
    let out = folder.path(name);
    swm_ok(&collecting(&out, more));
    out
}

fn run(args: &[&str]) -> Output {
    swm(args).output().expect("the command under test starts")
}

/// A folder that goes away, and paths in it.
pub(crate) struct Folder(tempfile::TempDir);

impl Folder {
    pub(crate) fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    pub(crate) fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().expect("temporary paths are text").to_owned()
    }
}

/// A fingerprint of every column and of the episode lengths of a dataset.
pub(crate) fn content(path: &str) -> BTreeMap<String, u64> {
    let mut dataset = swm::data::open(Path::new(path)).expect("the dataset opens");
    let schema = dataset.schema().clone();
    let mut hashes: BTreeMap<String, u64> = BTreeMap::new();
    let mut rows = Batch::new(Schema::new(schema.fields().to_vec()).expect("names are unique"), 0);
    for episode in 0..dataset.num_episodes() {
        let len = dataset.episode_len(episode);
        dataset.read(episode, 0..len, &mut rows).expect("every episode reads");
        for (index, field) in schema.fields().iter().enumerate() {
            let hash = hashes.entry(field.name.clone()).or_insert(OFFSET);
            hash_slice(hash, rows.column(index));
        }
        hash_slice(hashes.entry("(episode lengths)".to_owned()).or_insert(OFFSET), Slice::I64(&[len as i64]));
    }
    hashes
}

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;

fn hash_slice(hash: &mut u64, values: Slice<'_>) {
    let mut add = |bits: u64| *hash = (*hash ^ bits).wrapping_mul(0x0100_0000_01b3);
    match values {
        Slice::Bool(v) => v.iter().for_each(|&v| add(u64::from(v))),
        Slice::U8(v) => v.iter().for_each(|&v| add(u64::from(v))),
        Slice::I32(v) => v.iter().for_each(|&v| add(v as u64)),
        Slice::I64(v) => v.iter().for_each(|&v| add(v as u64)),
        Slice::F32(v) => v.iter().for_each(|&v| add(u64::from(v.to_bits()))),
        Slice::F64(v) => v.iter().for_each(|&v| add(v.to_bits())),
        Slice::Str(v) => v.iter().flat_map(|v| v.bytes()).for_each(|v| add(u64::from(v))),
    }
}

/// The root of the repository.
pub(crate) fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("tests/ lies in the repository").to_owned()
}
