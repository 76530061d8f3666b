//! Datasets on a server of this machine, with faults.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use swm_core::Column;
use tempfile::TempDir;

use super::address::Address;
use super::fetch::fetch_from;
use super::found::{Found, Remote};
use super::open::open_from;
use super::settings::{Credentials, Hub, Settings};
use super::test_server::{Fault, Server};
use crate::dataset::{Dataset, Steps};
use crate::error::DataError;
use crate::format::built_in;
use crate::open_options::OpenOptions;
use crate::stats::{Statistics, StatisticsOptions, side_file};

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

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        open_from(&self.remote, built_in(), path, &OpenOptions::default())
    }

    fn object(&self, path: &str) -> Result<Arc<super::Object>, super::RemoteError> {
        match self.remote.find(&Address::of(&self.at(path))?)? {
            Found::Object(object) => Ok(object),
            Found::Folder(_) => panic!("{path} is an object"),
        }
    }
}

/// All rows of all columns.
fn rows(dataset: &mut dyn Dataset) -> Result<Vec<Column>, DataError> {
    let mut all = Vec::new();
    for column in 0..dataset.schema().fields().len() {
        for episode in 0..dataset.num_episodes() {
            let (field, count) = (dataset.schema().fields()[column].clone(), dataset.episode_len(episode));
            let mut out = Column::zeros(field.dtype, count * field.dim());
            dataset.rows(column, episode, Steps { first: 0, count, stride: 1 }, out.as_slice_mut())?;
            all.push(out);
        }
    }
    Ok(all)
}

fn same(a: &[Column], b: &[Column]) -> bool {
    format!("{a:?}") == format!("{b:?}")
}

fn local(name: &str) -> Vec<Column> {
    rows(crate::open(&golden(name)).unwrap().as_mut()).unwrap()
}

/// The files of a folder, below a path.
fn files_of(folder: &Path, below: &str) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = format!("{below}/{}", entry.file_name().to_str().unwrap());
        match entry.path().is_dir() {
            true => found.extend(files_of(&entry.path(), &path)),
            false => found.push((path, std::fs::read(entry.path()).unwrap())),
        }
    }
    found
}

fn put_all(server: &Server, folder: &str, below: &str) {
    for (path, bytes) in files_of(&golden(folder), below) {
        server.put(&path, bytes);
    }
}

const NPZ: &str = "pointmaze-medium-navigate-v0.npz";

#[test]
fn an_archive_is_read_by_position() {
    let test = Test::http(&[("/d/pointmaze-medium-navigate-v0.npz", std::fs::read(golden(NPZ)).unwrap())]);
    let path = test.at(&format!("/d/{NPZ}"));
    let mut dataset = test.open(&path).unwrap();
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local(NPZ)));
    assert_eq!(dataset.path(), path);
    assert!(
        dataset.info().notes.iter().any(|note| note.contains("by position")),
        "{:?}",
        dataset.info().notes
    );
    assert!(!test.cache.path().join("copies").exists(), "no copy is made");
    assert_eq!(test.server.count(), 1, "all of it is in the first block");
    // Statistics are kept in the cache.
    let kept = crate::stats::Statistics::load_or_compute(dataset.as_mut(), &Default::default()).unwrap();
    assert!(crate::stats::side_file(&path).starts_with(test.cache.path()));
    assert_eq!(
        crate::stats::Statistics::load(dataset.as_ref()).unwrap().map(|kept| kept.columns),
        Some(kept.columns)
    );
}

#[test]
fn other_files_are_fetched_whole_and_once() {
    let name = "robomimic_can.hdf5";
    let test = Test::http(&[("/robomimic_can.hdf5", std::fs::read(golden(name)).unwrap())]);
    let options = OpenOptions::default().camera(Some("agentview".to_owned()));
    let open = || open_from(&test.remote, built_in(), &test.at(&format!("/{name}")), &options);
    let mut dataset = open().unwrap();
    let here = crate::open_with(built_in(), &golden(name), &options);
    assert!(same(&rows(dataset.as_mut()).unwrap(), &rows(here.unwrap().as_mut()).unwrap()));
    let note = format!("fetched as a whole, {} bytes", std::fs::metadata(golden(name)).unwrap().len());
    assert!(dataset.info().notes.iter().any(|found| found.contains(&note)), "{:?}", dataset.info().notes);
    drop(dataset);
    let before = test.server.count();
    open().unwrap();
    assert_eq!(test.server.count(), before + 1, "it is asked whether it is the same, and not fetched again");
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

#[test]
fn cut_slow_and_busy_answers_are_continued() {
    let whole = bytes(3 << 20);
    for faults in [
        vec![Fault::Cut, Fault::Cut, Fault::Cut],
        vec![Fault::Status(503), Fault::Status(429), Fault::Status(500)],
        vec![Fault::Slow],
        vec![Fault::Silent],
    ] {
        let test = Test::http(&[("/x", whole.clone())]);
        test.server.fail(&faults);
        let object = test.object("/x").unwrap();
        let mut out = vec![0; whole.len()];
        object.read_exact_at(&mut out, 0).unwrap();
        assert_eq!(out, whole, "{faults:?}");
    }
}

#[test]
fn what_does_not_work_is_named_with_its_fix() {
    let test = Test::http(&[("/x.npz", bytes(100)), ("/empty.npz", Vec::new())]);
    let message = |path: &str| test.open(&test.at(path)).err().unwrap().to_string();
    for (faults, path, reasons) in [
        (vec![], "/none.npz", ["nothing is there (404)", "check the address"]),
        (vec![Fault::Status(403); 3], "/x.npz", ["access is denied (403)", "wants a login"]),
        (vec![Fault::Status(503); 5], "/x.npz", ["answers 503, 5 times", "what was fetched is kept"]),
        (vec![Fault::Status(416)], "/x.npz", ["416", "another server"]),
        (vec![Fault::Status(418)], "/x.npz", ["418", "check the address"]),
        (vec![], "/empty.npz", ["the file is empty", ""]),
        (vec![], "/x.npz", ["not a dataset", ""]),
    ] {
        test.server.fail(&faults);
        let message = message(path);
        test.server.state.faults.lock().unwrap().clear();
        assert!(reasons.iter().all(|reason| message.contains(reason)), "{message}");
        assert!(message.contains(path.trim_start_matches('/')) && !message.contains("damaged"), "{message}");
    }
    let none = test.open(Path::new("http://127.0.0.1:9/x.npz")).err().unwrap().to_string();
    assert!(none.contains("5 times") && none.contains("http://127.0.0.1:9/x.npz"), "{none}");
}

#[test]
fn a_change_under_the_reader_is_an_error() {
    let test = Test::http(&[("/x", bytes(3 << 20))]);
    let object = test.object("/x").unwrap();
    test.server.put("/x", vec![1; 3 << 20]);
    let mut out = vec![0; 10];
    let error = object.read_exact_at(&mut out, 2 << 20).unwrap_err().to_string();
    assert!(error.contains("changed after it was opened") && error.contains("open it again"), "{error}");
    // A new look at it reads the new version, and none of the old blocks.
    test.object("/x").unwrap().read_exact_at(&mut out, 0).unwrap();
    assert_eq!(out, [1; 10]);
}

#[test]
fn servers_without_ranges_or_tags() {
    let (whole, name) = (bytes((2 << 20) + 5), "pldm_maze.npz");
    let test = Test::http(&[("/x", whole.clone()), ("/p.npz", std::fs::read(golden(name)).unwrap())]);
    test.server.state.has_no_ranges.store(true, Ordering::Relaxed);
    let object = test.object("/x").unwrap();
    let error = object.read_exact_at(&mut [0; 10], 2 << 20).unwrap_err().to_string();
    assert!(error.contains("gives no parts of it"), "{error}");
    assert!(
        same(&rows(test.open(&test.at("/p.npz")).unwrap().as_mut()).unwrap(), &local(name)),
        "it is one block"
    );
    let out = test.cache.path().join("x");
    fetch_from(&test.remote, &test.at("/x"), Some(&out)).unwrap();
    assert_eq!(std::fs::read(&out).unwrap(), whole);
    test.server.state.has_no_tags.store(true, Ordering::Relaxed);
    assert!(test.open(&test.at("/p.npz")).is_ok());
}

#[test]
fn stores_of_s3_are_listed_and_signed() {
    let name = "pusht_cchi_v7_replay.zarr";
    let test = Test::new(&[("/bucket/other/file", bytes(10))], |settings, url| {
        settings.s3.endpoint = Some(url.to_owned());
        settings.s3.credentials = Some(Credentials {
            key: "KEY".to_owned(),
            secret: "SECRET".to_owned(),
            session: Some("SESSION".to_owned()),
        });
    });
    put_all(&test.server, name, "/bucket/sets/pusht.zarr");
    *test.server.state.wants.lock().unwrap() = Some("AWS4-HMAC-SHA256 Credential=KEY/");
    let path = Path::new("s3://bucket/sets/pusht.zarr");
    let mut dataset = test.open(path).unwrap();
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)));
    assert_eq!(dataset.path(), path);
    assert!(!test.cache.path().join("copies").exists(), "its chunks are read one by one");
    drop(dataset);
    let asked = |test: &Test| {
        test.server.state.asked.lock().unwrap().iter().filter(|(target, _)| !target.contains('?')).count()
    };
    let before = asked(&test);
    rows(test.open(path).unwrap().as_mut()).unwrap();
    assert_eq!(asked(&test), before + 1, "chunks that are on disk are not fetched again");
    *test.server.state.wants.lock().unwrap() = Some("AWS4-HMAC-SHA256 Credential=OTHER/");
    let message = test.open(Path::new("s3://bucket/sets/none.zarr")).err().unwrap().to_string();
    assert!(message.contains("denied (403, AccessDenied)") && message.contains("AWS_REGION"), "{message}");
    assert!(!["SECRET", "SESSION", "KEY,"].iter().any(|secret| message.contains(secret)), "{message}");
    for (path, _) in files_of(test.cache.path(), "") {
        assert!(!path.contains("KEY") && !path.contains("SECRET"), "{path}");
    }
}

#[test]
fn a_bucket_without_credentials_names_the_variables() {
    let test = Test::new(&[], |settings, url| settings.s3.endpoint = Some(url.to_owned()));
    *test.server.state.wants.lock().unwrap() = Some("AWS4");
    let message = test.open(Path::new("s3://bucket/x.h5")).err().unwrap().to_string();
    assert!(message.contains("s3://bucket/x.h5") && message.contains("set AWS_ACCESS_KEY_ID"), "{message}");
    *test.server.state.wants.lock().unwrap() = None;
    let message = test.open(Path::new("s3://bucket/x.h5")).err().unwrap().to_string();
    assert!(message.contains("nothing is there (404)"), "{message}");
}

fn of_hub(files: &[(&str, Vec<u8>)], token: Option<&str>) -> Test {
    Test::new(files, |settings, url| {
        settings.hub = Hub { endpoint: url.to_owned(), token: token.map(str::to_owned) };
    })
}

#[test]
fn repositories_of_the_hub_are_read_at_a_commit() {
    let test = of_hub(&[("/data/p.npz", std::fs::read(golden("pldm_maze.npz")).unwrap())], Some("TOKEN"));
    *test.server.state.wants.lock().unwrap() = Some("Bearer TOKEN");
    put_all(&test.server, "v3_sharded.zarr", "/s.zarr");
    put_all(&test.server, "dinowm_pusht_noise", "/noise");
    for (path, name) in [
        ("hf://datasets/user/repo/data/p.npz", "pldm_maze.npz"),
        ("hf://datasets/user/repo@main/s.zarr", "v3_sharded.zarr"),
        ("hf://datasets/user/repo/noise", "dinowm_pusht_noise"),
    ] {
        let mut dataset = test.open(Path::new(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)), "{path}");
    }
    *test.server.state.wants.lock().unwrap() = Some("Bearer OTHER");
    let message = test.open(Path::new("hf://datasets/user/repo/x.npz")).err().unwrap().to_string();
    assert!(message.contains("the token of HF_TOKEN") && !message.contains("TOKEN\""), "{message}");
    assert!(!message.contains("Bearer"), "{message}");
}

#[test]
fn zarr_of_a_server_without_lists_needs_its_metadata_in_one_file() {
    let name = "pusht_cchi_v7_replay.zarr";
    let test = Test::http(&[]);
    put_all(&test.server, name, "/p.zarr");
    let found = test.open(&test.at("/p.zarr"));
    let has_metadata = golden(name).join(".zmetadata").is_file();
    if !has_metadata {
        assert!(found.err().unwrap().to_string().contains("404"));
        let mut about = serde_json::Map::new();
        for (path, bytes) in files_of(&golden(name), "") {
            if path.ends_with(".zarray") || path.ends_with(".zgroup") {
                about
                    .insert(path.trim_start_matches('/').to_owned(), serde_json::from_slice(&bytes).unwrap());
            }
        }
        test.server
            .put("/p.zarr/.zmetadata", serde_json::json!({ "metadata": about }).to_string().into_bytes());
    }
    let mut dataset = test.open(&test.at("/p.zarr")).unwrap();
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)));
}

#[test]
fn fetching_continues_and_refuses_what_is_there() {
    let whole = bytes((2 << 20) + 9);
    let test = Test::http(&[("/a/x.h5", whole.clone())]);
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("mine.h5");
    let path = test.at("/a/x.h5?token=SECRET");
    let fetch = || fetch_from(&test.remote, &path, Some(&out));
    // The first block, and half of the rest; then nothing more.
    test.server.fail(&[Fault::Slow, Fault::Cut]);
    drop(test.server.state.faults.lock().unwrap().splice(0..0, vec![Fault::Status(503); 4]));
    let message = fetch().unwrap_err();
    assert!(message.to_string().contains("503") && !format!("{message:?}").contains("SECRET"), "{message:?}");
    assert!(!out.exists());
    let parts = std::fs::read_dir(folder.path()).unwrap().flatten();
    let part = parts
        .map(|entry| entry.path())
        .find(|path| path.extension().is_some_and(|end| end == "part"))
        .unwrap();
    assert!(std::fs::metadata(&part).unwrap().len() > 1 << 20, "what was fetched is kept");
    test.server.state.asked.lock().unwrap().clear();
    let fetched = fetch().unwrap();
    assert_eq!((fetched.bytes, fetched.files, std::fs::read(&out).unwrap()), (whole.len() as u64, 1, whole));
    let asked = test.server.state.asked.lock().unwrap().clone();
    assert!(asked.len() == 2 && !asked[1].1.as_ref().unwrap().starts_with("bytes=0-"), "{asked:?}");
    assert!(!part.exists());
    let message = fetch().unwrap_err();
    assert!(message.to_string().contains("exists already"), "{message}");
}

#[test]
fn whole_folders_are_fetched_and_checked() {
    let test = of_hub(&[], None);
    put_all(&test.server, "dinowm_pusht_noise", "/noise");
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("noise");
    let fetched = fetch_from(&test.remote, Path::new("hf://datasets/user/repo/noise"), Some(&out)).unwrap();
    let sorted = |mut files: Vec<(String, Vec<u8>)>| {
        files.sort();
        files
    };
    assert_eq!(sorted(files_of(&out, "")), sorted(files_of(&golden("dinowm_pusht_noise"), "")));
    assert_eq!(fetched.files, files_of(&out, "").len());
    // A list that names a place outside is not followed.
    test.server.put("/bad/../../x", bytes(3));
    let error =
        fetch_from(&test.remote, Path::new("hf://datasets/user/repo/bad"), Some(&folder.path().join("bad")));
    assert!(error.unwrap_err().to_string().contains("has a name that no file can have"));
}
