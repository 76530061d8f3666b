//! What a file or folder is that no format of this program reads: a table of signs, and what to do. Nothing is read here but names and
//! first bytes.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};

use swm_files::{begins, is_zip};

/// What is to be done about all of them.
pub const BRING: &str = "write it with `HDF5Writer`: docs/datasets.md, Formats that are not read yet";

/// By what a layout is told. In names, one `*` stands for any characters.
pub(super) enum Sign {
    /// A folder that has all of these paths.
    Folder(&'static [&'static str]),
    /// An HDF5 file that has all of these objects, at its root or in a group of it.
    Hdf5(&'static [&'static str]),
    /// A zip archive, such as an `.npz` file, that has all of these entries.
    Zip(&'static [&'static str]),
    /// A folder whose first such archive has all of these entries.
    Zips(&'static [&'static str]),
    /// A file that begins so.
    Start(&'static [u8]),
    /// An MCAP file whose profile, or the encoding of one of whose schemas, is one of these.
    Mcap(&'static [&'static str]),
}

/// What it is, and what reads it in Python. More particular layouts come first.
const KNOWN: &[(Sign, &str, &str)] = &[
    (Sign::Folder(&["data/0/part-0.arrow"]), "a Minari dataset in Arrow", "minari.load_dataset"),
    (Sign::Folder(&["0/part-0.arrow"]), "the data of a Minari dataset in Arrow", "minari.load_dataset"),
    (Sign::Folder(&["data/metadata.json"]), "a Minari dataset", "minari.load_dataset"),
    (Sign::Folder(&["data/main_data.hdf5"]), "a Minari dataset", "minari.load_dataset"),
    (Sign::Folder(&["main_data.hdf5"]), "the data of a Minari dataset", "minari.load_dataset"),
    (Sign::Hdf5(&["episode_*/observations"]), "the data of a Minari dataset", "minari.load_dataset"),
    (
        Sign::Hdf5(&["data/demo_*"]),
        "a dataset of robomimic, LIBERO or MimicGen whose first demonstration has no `actions`",
        "h5py",
    ),
    (Sign::Hdf5(&["traj_*/actions"]), "a dataset of ManiSkill", "h5py"),
    (Sign::Hdf5(&["observations", "actions", "terminals"]), "a dataset of D4RL without `rewards`", "h5py"),
    (
        Sign::Zip(&["observations.npy", "actions.npy", "terminals.npy"]),
        "a dataset of OGBench or PLDM",
        "numpy.load",
    ),
    (Sign::Zip(&["*.npy"]), "an archive of NumPy arrays", "numpy.load"),
    (Sign::Zip(&[".zgroup"]), "a Zarr store without `meta/episode_ends`", "zarr.open"),
    (Sign::Zip(&["zarr.json"]), "a Zarr store without `meta/episode_ends`", "zarr.open"),
    (Sign::Zip(&["*/data.pkl"]), "a file of PyTorch", "torch.load"),
    (
        Sign::Folder(&["meta/episode_ends"]),
        "a Zarr replay buffer, as of diffusion_policy and UMI",
        "zarr.open",
    ),
    (Sign::Folder(&[".zgroup"]), "a Zarr store without `meta/episode_ends`", "zarr.open"),
    (Sign::Folder(&[".zarray"]), "a Zarr array", "zarr.open"),
    (Sign::Folder(&["zarr.json"]), "a Zarr store without `meta/episode_ends`", "zarr.open"),
    (
        Sign::Folder(&["dataset_info.json", "features.json"]),
        "an RLDS dataset whose `features.json` names no `steps`",
        "tensorflow_datasets.builder_from_directory",
    ),
    (Sign::Folder(&["states.npy", "actions.npy"]), "a dataset of walls of PLDM", "numpy.load"),
    (Sign::Folder(&["states.pth"]), "a dataset of DINO-WM", "torch.load"),
    (Sign::Folder(&["train/states.pth"]), "a dataset of DINO-WM", "torch.load"),
    (Sign::Folder(&["metadata.yaml", "*.mcap"]), "a ROS 2 recording (rosbag2)", "rosbags"),
    (Sign::Folder(&["metadata.yaml", "*.db3"]), "a ROS 2 recording (rosbag2)", "rosbags"),
    (
        Sign::Mcap(&["ros2", "ros2msg", "ros2idl"]),
        "a ROS 2 recording",
        "rosbags, or mcap and mcap-ros2-support",
    ),
    (Sign::Mcap(&["ros1", "ros1msg"]), "a ROS 1 recording", "rosbags"),
    (Sign::Start(b"#ROSBAG V"), "a ROS 1 recording", "rosbags"),
    (Sign::Start(b"SQLite format 3\0"), "an SQLite database, such as a ROS 2 recording (rosbag2)", "rosbags"),
    (
        Sign::Start(b"PAR1"),
        "a Parquet table (a LeRobot dataset is the folder with `meta/info.json`)",
        "pyarrow.parquet",
    ),
    (Sign::Start(b"\x93NUMPY"), "a NumPy array", "numpy.load"),
    (Sign::Start(b"ARROW1"), "an Arrow table", "pyarrow"),
];

/// Entries of a folder, a group or an archive that are looked at: a sign is among the first.
const LOOKED_AT: usize = 1000;

/// What a file or folder is that no format detects.
pub(crate) fn recognize(path: &Path) -> Option<String> {
    named(|sign| is_it(sign, path, &[]))
}

/// Whether a file or folder has a sign. `members` are those of the file, as [`of_hdf5`] has them.
pub(super) fn is_it(sign: &Sign, path: &Path, members: &[String]) -> bool {
    match sign {
        Sign::Folder(names) => path.is_dir() && names.iter().all(|name| has_path(path, name)),
        Sign::Zip(names) => path.is_file() && has_entries(path, names),
        Sign::Zips(names) => {
            path.is_dir() && first_file(path, "npz").is_some_and(|path| has_entries(&path, names))
        }
        Sign::Start(start) => path.is_file() && begins(path, start),
        Sign::Hdf5(names) => has_members(members, names),
        Sign::Mcap(_) => false,
    }
}

/// What an HDF5 file is that has no index of episodes. `members` are names at the root, and of objects in groups there, `group/name`.
pub(crate) fn of_hdf5(members: &[String]) -> Option<String> {
    named(|sign| matches!(sign, Sign::Hdf5(names) if has_members(members, names)))
}

fn has_members(members: &[String], names: &[&str]) -> bool {
    names.iter().all(|name| members.iter().any(|member| fits(name, member)))
}

/// What an MCAP file is that has no record of ours, by its profile and the encodings of its schemas.
pub(crate) fn mcap(about: &[String]) -> String {
    let found = named(|sign| match sign {
        Sign::Mcap(names) => about.iter().any(|own| names.contains(&own.as_str())),
        _ => false,
    });
    found.unwrap_or_else(|| {
        format!(
            "it is an MCAP file of another program, without the record `swm.dataset` that names the columns; read it with the package \
             mcap in Python, and {BRING}"
        )
    })
}

fn named(is_it: impl Fn(&Sign) -> bool) -> Option<String> {
    let (_, name, reader) = KNOWN.iter().find(|(sign, ..)| is_it(sign))?;
    Some(format!("it is {name}, which is not read yet; read it with {reader} in Python, and {BRING}"))
}

/// Whether a name is that of a pattern.
fn fits(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((start, end)) => {
            name.len() >= start.len() + end.len() && name.starts_with(start) && name.ends_with(end)
        }
    }
}

/// Whether a folder has a path; only the last name is a pattern.
fn has_path(folder: &Path, pattern: &str) -> bool {
    if !pattern.contains('*') {
        return folder.join(pattern).exists();
    }
    let (folder, pattern) = match pattern.rsplit_once('/') {
        Some((below, pattern)) => (&folder.join(below), pattern),
        None => (&folder.to_owned(), pattern),
    };
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().take(LOOKED_AT);
    entries.into_iter().any(|entry| entry.file_name().to_str().is_some_and(|name| fits(pattern, name)))
}

/// The first file of a folder with this extension, by name.
pub(super) fn first_file(folder: &Path, extension: &str) -> Option<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().take(LOOKED_AT);
    let paths = entries.map(|entry| entry.path());
    paths.filter(|path| path.extension().is_some_and(|kind| kind == extension)).min()
}

fn has_entries(path: &Path, patterns: &[&str]) -> bool {
    if !is_zip(path) {
        return false;
    }
    let archive = File::open(path).ok().and_then(|file| zip::ZipArchive::new(BufReader::new(file)).ok());
    archive.is_some_and(|archive| {
        let names: Vec<&str> = archive.file_names().take(LOOKED_AT).collect();
        patterns.iter().all(|pattern| names.iter().any(|name| fits(pattern, name)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_fit_names() {
        for (pattern, name) in [
            ("a", "a"),
            ("data/demo_*", "data/demo_12"),
            ("*.npy", "x.npy"),
            ("*/data.pkl", "archive/data.pkl"),
        ] {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("a", "ab"), ("data/demo_*", "data/dem"), ("ab*ba", "aba")] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
    }
}
