//! Files that the reference recorded, in both generations of its layout: every column has the reference's values,
//! and the loader gives the items that its own loader gives.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use flate2::read::GzDecoder;
use serde_json::Value as Json;
use sha2::{Digest, Sha256};
use swm_core::Column;
use swm_data::loader::{ClipOptions, Clips, Images, Loader};
use swm_data::{WriteMode, create, open};

use crate::support::{bits, contents, metadata, schema};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/datasets")
}

/// Unpacks a golden file into `target`.
pub(crate) fn unpacked(name: &str, target: &Path) -> PathBuf {
    let packed = File::open(folder().join(format!("{name}.gz"))).unwrap();
    let path = target.join(name);
    io::copy(&mut GzDecoder::new(packed), &mut File::create(&path).unwrap()).unwrap();
    path
}

fn expected() -> serde_json::Map<String, Json> {
    serde_json::from_slice(&fs::read(folder().join("expected.json")).unwrap()).unwrap()
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

fn shape(json: &Json) -> Vec<usize> {
    json.as_array().unwrap().iter().map(|size| size.as_u64().unwrap() as usize).collect()
}

#[test]
fn every_column_of_every_file_has_the_reference_values() {
    let target = tempfile::tempdir().unwrap();
    let expected = expected();
    assert_eq!(expected.len(), 6);
    for (name, facts) in &expected {
        let path = unpacked(name, target.path());
        let episodes = contents(&path);
        let dataset = open(&path).unwrap();
        let lengths: Vec<i32> =
            (0..dataset.num_episodes()).map(|episode| dataset.episode_len(episode) as i32).collect();
        let mut columns = 0;
        for (column, fact) in facts["columns"].as_object().unwrap() {
            let bytes = match column.as_str() {
                "ep_len" => bits(&Column::I32(lengths.clone())),
                "ep_offset" => bits(&Column::I64(
                    (0..lengths.len())
                        .map(|at| lengths[..at].iter().map(|&len| i64::from(len)).sum())
                        .collect(),
                )),
                _ => {
                    let at = dataset.schema().require(column).unwrap();
                    let field = &dataset.schema().fields()[at];
                    assert_eq!(field.dtype.name(), fact["dtype"].as_str().unwrap(), "{name}: {column}");
                    assert_eq!(field.shape, shape(&fact["shape"])[1..], "{name}: {column}");
                    columns += 1;
                    episodes.iter().flat_map(|episode| bits(&episode.column(at).to_column())).collect()
                }
            };
            assert_eq!(sha256(&bytes), fact["sha256"].as_str().unwrap(), "{name}: {column}");
        }
        assert_eq!(columns, dataset.schema().fields().len(), "{name}");
        assert!(dataset.info().skipped.is_empty() && dataset.metadata().is_none());
    }
}

#[test]
fn the_loader_gives_the_items_of_the_reference() {
    let target = tempfile::tempdir().unwrap();
    let (mut items, mut settings) = (0, 0);
    for (name, facts) in &expected() {
        let path = unpacked(name, target.path());
        for (setting, fact) in facts["loader"].as_object().unwrap() {
            let number = |key: &str| fact[key].as_u64().unwrap() as usize;
            let options = ClipOptions::default()
                .num_steps(number("num_steps"))
                .frameskip(number("frameskip"))
                .clips(Clips::Paper)
                .images(Images::ChannelsFirst);
            let loader = Loader::new(open(&path).unwrap(), &options).unwrap();
            assert_eq!(loader.len(), number("len"), "{name} {setting}");
            for (index, clip) in fact["first_clips"].as_array().unwrap().iter().enumerate() {
                let found = loader.clip(index).unwrap();
                assert_eq!(vec![found.episode, found.start], shape(clip), "{name} {setting} clip {index}");
            }
            let mut batch = loader.new_batch();
            for (index, item) in fact["items"].as_object().unwrap() {
                loader.read(&[index.parse().unwrap()], &mut batch).unwrap();
                for (key, value) in item.as_object().unwrap() {
                    let at = loader.schema().require(key).unwrap();
                    assert_eq!(
                        loader.schema().fields()[at].shape,
                        shape(&value["shape"]),
                        "{name} {setting} {key}"
                    );
                    let digest = sha256(&bits(&batch.column(at).to_column()));
                    assert_eq!(
                        digest,
                        value["sha256"].as_str().unwrap(),
                        "{name} {setting} item {index} {key}"
                    );
                    items += 1;
                }
            }
            settings += 1;
        }
    }
    assert!(settings == 24 && items > 400, "{settings} settings, {items} items");
}

#[test]
fn a_file_of_the_reference_is_not_continued() {
    let folder = tempfile::tempdir().unwrap();
    let path = unpacked("tworoom_v1_64.h5", folder.path());
    let mut writer = create(&path, WriteMode::Append, None).unwrap();
    let message = writer.begin(&schema(), &metadata()).unwrap_err().to_string();
    assert!(message.contains("another program"), "{message}");
}
