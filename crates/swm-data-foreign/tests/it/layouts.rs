//! Layouts of others that are not read yet: told as what they are, never as damage.

use std::fs;
use std::path::Path;

use swm_data::DataError;

use crate::open;

/// The message for a file or folder.
fn told(path: &Path) -> String {
    let error = open(path).err().unwrap();
    assert!(matches!(error, DataError::NotADataset { .. } | DataError::Unsupported { .. }), "{error}");
    let message = error.to_string();
    assert!(message.contains("HDF5Writer") && message.contains("docs/datasets.md"), "{message}");
    message
}

fn hdf5(path: &Path, names: &[&str]) {
    let file = hdf5_metno::File::create(path).unwrap();
    for name in names {
        if let Some((group, _)) = name.rsplit_once('/')
            && !file.link_exists(group)
        {
            file.create_group(group).unwrap();
        }
        file.new_dataset::<f32>().shape(4).create(*name).unwrap();
    }
}

fn zip_of(path: &Path, names: &[&str]) {
    let mut archive = zip::ZipWriter::new(fs::File::create(path).unwrap());
    for name in names {
        archive.start_file(*name, zip::write::SimpleFileOptions::default()).unwrap();
    }
    archive.finish().unwrap();
}

#[test]
fn files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    hdf5(&path("flat.hdf5"), &["observations", "actions", "terminals"]);
    zip_of(&path("other.npz"), &["x.npy"]);
    zip_of(&path("umi.zarr.zip"), &[".zgroup", "data/.zgroup"]);
    zip_of(&path("chunk_0.pt"), &["chunk_0/data.pkl", "chunk_0/version"]);
    fs::write(path("a.bag"), b"#ROSBAG V2.0\n").unwrap();
    fs::write(path("a.db3"), b"SQLite format 3\0").unwrap();
    fs::write(path("a.parquet"), b"PAR1").unwrap();
    fs::write(path("a.npy"), b"\x93NUMPY\x01\0").unwrap();
    for (name, part) in [
        ("flat.hdf5", "a dataset of D4RL without `rewards`"),
        ("other.npz", "an archive of NumPy arrays"),
        ("umi.zarr.zip", "a Zarr store without `meta/episode_ends`"),
        ("chunk_0.pt", "a file of PyTorch"),
        ("a.bag", "a ROS 1 recording"),
        ("a.db3", "an SQLite database"),
        ("a.parquet", "a Parquet table"),
        ("a.npy", "a NumPy array"),
    ] {
        let message = told(&path(name));
        assert!(message.contains(part) && message.contains("is not read yet"), "{name}: {message}");
    }
}

#[test]
fn folders_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (name, files, part) in [
        ("minari", &["data/metadata.json", "data/main_data.hdf5"][..], "a Minari dataset"),
        ("pusht.zarr", &[".zgroup", "meta/episode_ends/0"][..], "a Zarr replay buffer"),
        ("other.zarr", &["zarr.json"][..], "a Zarr store without `meta/episode_ends`"),
        ("pldm", &["states.npy", "actions.npy"][..], "a dataset of walls of PLDM"),
        (
            "rlds",
            &["dataset_info.json", "features.json"][..],
            "an RLDS dataset whose `features.json` names no `steps`",
        ),
        ("bag", &["metadata.yaml", "bag_0.mcap"][..], "a ROS 2 recording"),
    ] {
        for file in files {
            let path = folder.path().join(name).join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, b"").unwrap();
        }
        let message = told(&folder.path().join(name));
        assert!(message.contains(part), "{name}: {message}");
    }
}

#[test]
fn logs_are_named_by_their_encoding() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    let text = |text: &str| [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
    let record = |opcode: u8, content: Vec<u8>| {
        [&[opcode][..], &(content.len() as u64).to_le_bytes(), &content].concat()
    };
    for (profile, encoding, part) in [
        ("ros2", "ros2msg", "a ROS 2 recording"),
        ("", "ros1msg", "a ROS 1 recording"),
        ("", "protobuf", "an MCAP file of another program, without the record `swm.dataset`"),
    ] {
        let header = record(1, [text(profile), text("libmcap")].concat());
        let schema = record(3, [vec![1, 0], text("a/msg/B"), text(encoding), text("float64 x")].concat());
        let magic = b"\x89MCAP0\r\n".to_vec();
        let end = [record(15, vec![0; 4]), record(2, vec![0; 20])].concat();
        fs::write(&path, [magic.clone(), header, schema, end, magic].concat()).unwrap();
        let message = told(&path);
        assert!(message.contains(part), "{message}");
    }
}

#[cfg(feature = "lerobot")]
#[test]
fn lerobot_in_the_storage_of_lance_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.lerobot");
    crate::copied(
        &Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/others/stale.lerobot"),
        &path,
    );
    fs::remove_dir_all(path.join("data")).unwrap();
    let info = path.join("meta/info.json");
    let text = fs::read_to_string(&info).unwrap().replacen('{', "{\"storage_format\": \"lance\",", 1);
    fs::write(&info, text).unwrap();
    let message = told(&path);
    assert!(
        message.starts_with("cannot read ") && message.contains("LeRobot dataset in Lance's storage"),
        "{message}"
    );
    // A version that is to come is no damage, either.
    let text = fs::read_to_string(&info).unwrap().replace("v3.0", "v4.0");
    fs::write(&info, text).unwrap();
    let message = open(&path).err().unwrap().to_string();
    assert!(message.starts_with("cannot read ") && message.contains("its version is `v4.0`"), "{message}");
}
