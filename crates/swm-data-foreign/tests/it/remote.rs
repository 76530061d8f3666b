//! Datasets on a server of this machine: which layouts are read by position, and which are fetched as a whole.

use std::fs;
use std::path::{Path, PathBuf};

use swm_core::Column;
use swm_data::stats::{Statistics, StatisticsOptions, side_file};
use swm_data::testing::elsewhere::{open_hosted, rows, same};
use swm_data::{DataError, Dataset, OpenOptions, Steps, open_with};
use swm_files::remote::testing::{Hosted, Server, files_of};
use tempfile::TempDir;

use crate::published::golden;
use crate::registry;

const NPZ: &str = "pointmaze-medium-navigate-v0.npz";

struct Test {
    hosted: Hosted,
    cache: TempDir,
}

impl Test {
    fn http(files: &[(&str, Vec<u8>)]) -> Self {
        let cache = tempfile::tempdir().unwrap();
        Self { hosted: Hosted::http(files, cache.path()), cache }
    }

    fn s3(credentials: Option<[&str; 3]>) -> Self {
        let cache = tempfile::tempdir().unwrap();
        Self { hosted: Hosted::s3(cache.path(), credentials), cache }
    }

    fn hub(files: &[(&str, Vec<u8>)], token: &str) -> Self {
        let cache = tempfile::tempdir().unwrap();
        Self { hosted: Hosted::hub(files, cache.path(), Some(token)), cache }
    }

    fn server(&self) -> &Server {
        &self.hosted.server
    }

    fn at(&self, path: &str) -> PathBuf {
        PathBuf::from(format!("{}{path}", self.server().url))
    }

    fn open(&self, path: &Path) -> Result<Box<dyn Dataset>, DataError> {
        open_hosted(&self.hosted, registry(), path, &OpenOptions::default())
    }
}

fn local(name: &str) -> Vec<Column> {
    rows(crate::open(&golden(name)).unwrap().as_mut()).unwrap()
}

fn put_all(server: &Server, folder: &str, below: &str) {
    for (path, bytes) in files_of(&golden(folder), below) {
        server.put(&path, bytes);
    }
}

#[test]
fn stores_of_s3_are_listed_and_signed() {
    let name = "pusht_cchi_v7_replay.zarr";
    let test = Test::s3(Some(["KEY", "SECRET", "SESSION"]));
    test.server().put("/bucket/other/file", vec![7; 10]);
    put_all(test.server(), name, "/bucket/sets/pusht.zarr");
    *test.server().state.wants.lock().unwrap() = Some("AWS4-HMAC-SHA256 Credential=KEY/");
    let path = Path::new("s3://bucket/sets/pusht.zarr");
    let mut dataset = test.open(path).unwrap();
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)));
    assert_eq!(dataset.path(), path);
    assert!(!test.cache.path().join("copies").exists(), "its chunks are read one by one");
    drop(dataset);
    let asked = |test: &Test| {
        test.server().state.asked.lock().unwrap().iter().filter(|(target, _)| !target.contains('?')).count()
    };
    let before = asked(&test);
    rows(test.open(path).unwrap().as_mut()).unwrap();
    assert_eq!(asked(&test), before + 1, "chunks that are on disk are not fetched again");
    *test.server().state.wants.lock().unwrap() = Some("AWS4-HMAC-SHA256 Credential=OTHER/");
    let message = test.open(Path::new("s3://bucket/sets/none.zarr")).err().unwrap().to_string();
    assert!(message.contains("denied (403, AccessDenied)") && message.contains("AWS_REGION"), "{message}");
    assert!(!["SECRET", "SESSION", "KEY,"].iter().any(|secret| message.contains(secret)), "{message}");
    for (path, content) in files_of(test.cache.path(), "") {
        for secret in ["KEY", "SECRET", "SESSION"] {
            let is_in = content.windows(secret.len()).any(|part| part == secret.as_bytes());
            assert!(!path.contains(secret) && !is_in, "{path}");
        }
    }
}

#[test]
fn repositories_of_the_hub_are_read_at_a_commit() {
    let test = Test::hub(&[("/data/p.npz", fs::read(golden("pldm_maze.npz")).unwrap())], "TOKEN");
    *test.server().state.wants.lock().unwrap() = Some("Bearer TOKEN");
    put_all(test.server(), "v3_sharded.zarr", "/s.zarr");
    put_all(test.server(), "dinowm_pusht_noise", "/noise");
    for (path, name) in [
        ("hf://datasets/user/repo/data/p.npz", "pldm_maze.npz"),
        ("hf://datasets/user/repo@main/s.zarr", "v3_sharded.zarr"),
        ("hf://datasets/user/repo/noise", "dinowm_pusht_noise"),
    ] {
        let mut dataset = test.open(Path::new(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
        assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)), "{path}");
    }
    *test.server().state.wants.lock().unwrap() = Some("Bearer OTHER");
    let message = test.open(Path::new("hf://datasets/user/repo/x.npz")).err().unwrap().to_string();
    assert!(message.contains("the token of HF_TOKEN") && !message.contains("TOKEN\""), "{message}");
    assert!(!message.contains("Bearer"), "{message}");
}

#[test]
fn an_archive_is_read_by_position() {
    let test = Test::http(&[("/d/pointmaze-medium-navigate-v0.npz", fs::read(golden(NPZ)).unwrap())]);
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
    assert_eq!(test.server().count(), 1, "all of it is in the first block");
    // Statistics are kept in the cache.
    let kept = Statistics::load_or_compute(dataset.as_mut(), &StatisticsOptions::default()).unwrap();
    assert!(side_file(&path).starts_with(test.cache.path()));
    assert_eq!(Statistics::load(dataset.as_ref()).unwrap().map(|kept| kept.columns), Some(kept.columns));
}

#[test]
fn other_files_are_fetched_whole_and_once() {
    let name = "robomimic_can.hdf5";
    let test = Test::http(&[("/robomimic_can.hdf5", fs::read(golden(name)).unwrap())]);
    let options = OpenOptions::default().camera(Some("agentview".to_owned()));
    let open = || open_hosted(&test.hosted, registry(), &test.at(&format!("/{name}")), &options);
    let mut dataset = open().unwrap();
    let here = open_with(registry(), &golden(name), &options);
    assert!(same(&rows(dataset.as_mut()).unwrap(), &rows(here.unwrap().as_mut()).unwrap()));
    let note = format!("fetched as a whole, {} bytes", fs::metadata(golden(name)).unwrap().len());
    assert!(dataset.info().notes.iter().any(|found| found.contains(&note)), "{:?}", dataset.info().notes);
    drop(dataset);
    let before = test.server().count();
    open().unwrap();
    assert_eq!(
        test.server().count(),
        before + 1,
        "it is asked whether it is the same, and not fetched again"
    );
}

#[test]
fn zarr_of_a_server_without_lists_needs_its_metadata_in_one_file() {
    let name = "pusht_cchi_v7_replay.zarr";
    let test = Test::http(&[]);
    put_all(test.server(), name, "/p.zarr");
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
        test.server()
            .put("/p.zarr/.zmetadata", serde_json::json!({ "metadata": about }).to_string().into_bytes());
    }
    let mut dataset = test.open(&test.at("/p.zarr")).unwrap();
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)));
}

#[test]
fn tables_of_lance_are_read_by_position_with_those_beside_them() {
    let test = Test::s3(None);
    for name in ["upstream_head.lance", "upstream_head_episodes.lance"] {
        put_all(test.server(), name, &format!("/bucket/{name}"));
    }
    let mut dataset = test.open(Path::new("s3://bucket/upstream_head.lance")).unwrap();
    assert!(dataset.schema().index("seed").is_some(), "{:?}", dataset.schema());
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local("upstream_head.lance")));
    assert!(!test.cache.path().join("copies").exists(), "no copy is made");
}

#[test]
fn an_archive_of_zarr_is_read_by_position() {
    let name = "umi_like.zarr.zip";
    let test = Test::http(&[("/umi_like.zarr.zip", fs::read(golden(name)).unwrap())]);
    let mut dataset = test.open(&test.at("/umi_like.zarr.zip")).unwrap();
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)));
    assert!(!test.cache.path().join("copies").exists(), "no copy is made");
}

#[test]
fn a_chunk_that_was_changed_is_an_error_that_names_it() {
    let test = Test::s3(None);
    put_all(test.server(), "pusht_cchi_v7_replay.zarr", "/bucket/p.zarr");
    let mut dataset = test.open(Path::new("s3://bucket/p.zarr")).unwrap();
    let pixels = dataset.schema().index("pixels").unwrap();
    let all: Vec<String> = test.server().state.files.lock().unwrap().keys().cloned().collect();
    for path in all.iter().filter(|path| path.contains("/data/img/") && !path.contains("/.z")) {
        test.server().put(path, vec![1; 10]);
    }
    // Of the first episode, something was read when it was opened.
    let episode = dataset.num_episodes() - 1;
    let (count, field) = (dataset.episode_len(episode), dataset.schema().fields()[pixels].clone());
    let mut out = Column::zeros(field.dtype, count * field.dim());
    let read = dataset.rows(pixels, episode, Steps { first: 0, count, stride: 1 }, out.as_slice_mut());
    let error = read.unwrap_err();
    let message = error.to_string();
    assert!(message.contains("s3://bucket/p.zarr/data/img/"), "{message}");
    assert!(message.contains("changed after it was opened") && !message.contains("damaged"), "{message}");
}
