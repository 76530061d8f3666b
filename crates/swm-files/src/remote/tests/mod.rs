//! Objects on a server of this machine.

#![expect(clippy::unwrap_used, reason = "helpers of tests panic as tests do")]

mod faults;
mod fetching;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use tempfile::TempDir;

use super::address::Address;
use super::found::{Found, Remote};
use super::settings::{Hub, Settings};
use super::testing::{Server, files_of};

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/field").join(name)
}

/// Bytes that are no dataset, over several blocks.
fn bytes(count: usize) -> Vec<u8> {
    (0..count).map(|at| (at * 7 + at / 251) as u8).collect()
}

struct Test {
    server: Server,
    cache: TempDir,
    remote: Arc<Remote>,
}

impl Test {
    fn new(files: &[(&str, Vec<u8>)], change: impl FnOnce(&mut Settings, &str)) -> Self {
        let (server, cache) = (Server::start(files), tempfile::tempdir().unwrap());
        let mut settings = Settings::of_test(cache.path());
        change(&mut settings, &server.url);
        Self { remote: Remote::new(settings).unwrap(), server, cache }
    }

    fn http(files: &[(&str, Vec<u8>)]) -> Self {
        Self::new(files, |_, _| {})
    }

    fn at(&self, path: &str) -> PathBuf {
        PathBuf::from(format!("{}{path}", self.server.url))
    }

    fn object(&self, path: &str) -> Result<Arc<super::Object>, super::RemoteError> {
        match self.remote.find(&Address::of(&self.at(path))?)? {
            Found::Object(object) => Ok(object),
            Found::Folder(_) => panic!("{path} is an object"),
        }
    }
}

fn put_all(server: &Server, folder: &str, below: &str) {
    for (path, bytes) in files_of(&golden(folder), below) {
        server.put(&path, bytes);
    }
}

#[test]
fn blocks_are_fetched_as_they_are_read() {
    let whole = bytes(5 * (1 << 20) + 77);
    let test = Test::http(&[("/x", whole.clone())]);
    let object = test.object("/x").unwrap();
    let read = |object: &super::Object, at: usize, count: usize| {
        let mut out = vec![0; count];
        object.read_exact_at(&mut out, at as u64).map(|()| out)
    };
    assert_eq!(read(&object, 4_000_000, 300_000).unwrap(), whole[4_000_000..4_300_000]);
    assert_eq!(test.server.count(), 3, "the first block, and the two that have these bytes");
    assert_eq!(read(&object, 0, whole.len()).unwrap(), whole);
    assert!(read(&object, whole.len() - 1, 2).is_err() && read(&object, usize::MAX, 2).is_err());
    let again = test.object("/x").unwrap();
    let before = test.server.count();
    assert_eq!(read(&again, 0, whole.len()).unwrap(), whole);
    assert_eq!(test.server.count(), before, "all blocks are on disk");
}

fn of_hub(files: &[(&str, Vec<u8>)], token: Option<&str>) -> Test {
    Test::new(files, |settings, url| {
        settings.hub = Hub { endpoint: url.to_owned(), token: token.map(str::to_owned) };
    })
}

#[test]
fn what_is_open_stays_at_its_commit() {
    let (old, new) = (bytes(3 << 20), vec![9; 3 << 20]);
    let test = of_hub(&[("/x", old.clone()), ("/moved/x", new)], None);
    let path = Path::new("hf://datasets/user/repo@main/x");
    let find = || match test.remote.find(&Address::of(path).unwrap()).unwrap() {
        Found::Object(object) => object,
        Found::Folder(_) => panic!("it is a file"),
    };
    let object = find();
    test.server.state.is_moved.store(true, Ordering::Relaxed);
    let mut out = vec![0; 100];
    object.read_exact_at(&mut out, 2 << 20).unwrap();
    assert_eq!(out, old[2 << 20..][..100], "the branch moved, and what is open did not");
    find().read_exact_at(&mut out, 2 << 20).unwrap();
    assert_eq!(out, [9; 100], "it is opened at the commit that the branch is now");
}
