//! Formats: which are read by position, and which are fetched as a whole.

use crate::stats::{Statistics, StatisticsOptions, side_file};
use crate::testing::mutations::seed;

use super::*;

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
    let kept = Statistics::load_or_compute(dataset.as_mut(), &StatisticsOptions::default()).unwrap();
    assert!(side_file(&path).starts_with(test.cache.path()));
    assert_eq!(Statistics::load(dataset.as_ref()).unwrap().map(|kept| kept.columns), Some(kept.columns));
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
fn our_formats_are_read_from_a_store() {
    let test = Test::new(&[], |settings, url| settings.s3.endpoint = Some(url.to_owned()));
    let folder = tempfile::tempdir().unwrap();
    for format in crate::FORMATS {
        let name = format!("mine.{}", format.extensions[0]);
        let here = folder.path().join(&name);
        seed(&here);
        match here.is_dir() {
            true => {
                for (path, content) in files_of(&here, &format!("/bucket/{name}")) {
                    test.server.put(&path, content);
                }
            }
            false => test.server.put(&format!("/bucket/{name}"), std::fs::read(&here).unwrap()),
        }
        let path = PathBuf::from(format!("s3://bucket/{name}"));
        let mut dataset = test.open(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        let expected = rows(crate::open(&here).unwrap().as_mut()).unwrap();
        assert!(same(&rows(dataset.as_mut()).unwrap(), &expected), "{name}");
        assert_eq!((dataset.path(), dataset.info().format), (path.as_path(), format.name));
        let is_by_position = dataset.info().notes.iter().any(|note| note.contains("by position"));
        assert_eq!(is_by_position, format.name == "mcap", "{name}");
        // Threads of a loader share what is open.
        assert!(same(&rows(dataset.share().as_mut()).unwrap(), &expected), "{name}");
    }
}

#[test]
fn tables_of_lance_are_read_by_position_with_those_beside_them() {
    let test = Test::new(&[], |settings, url| settings.s3.endpoint = Some(url.to_owned()));
    for name in ["upstream_head.lance", "upstream_head_episodes.lance"] {
        put_all(&test.server, name, &format!("/bucket/{name}"));
    }
    let mut dataset = test.open(Path::new("s3://bucket/upstream_head.lance")).unwrap();
    assert!(dataset.schema().index("seed").is_some(), "{:?}", dataset.schema());
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local("upstream_head.lance")));
    assert!(!test.cache.path().join("copies").exists(), "no copy is made");
}

#[test]
fn an_archive_of_zarr_is_read_by_position() {
    let name = "umi_like.zarr.zip";
    let test = Test::http(&[("/umi_like.zarr.zip", std::fs::read(golden(name)).unwrap())]);
    let mut dataset = test.open(&test.at("/umi_like.zarr.zip")).unwrap();
    assert!(same(&rows(dataset.as_mut()).unwrap(), &local(name)));
    assert!(!test.cache.path().join("copies").exists(), "no copy is made");
}
