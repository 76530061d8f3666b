//! Whether files are those that were published: other models are other dynamics, and a library runs with all rights of the
//! user. Their SHA-256 stands in this program, so that who can change the files cannot change what they are compared with.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use swm_core::evaluate::sha256;

use super::hashes::with_hashes;
use crate::error::MujocoError;

/// Files that were published together, in the form of `sha256sum`: a hash and a path below the data folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileSet {
    /// What records call it.
    pub name: &'static str,
    list: &'static str,
}

/// The models of the DeepMind Control Suite.
pub const SUITE: FileSet =
    FileSet { name: "dm_control 1.0.50, suite", list: include_str!("dm_control.sha256") };
/// OGBench's arm, gripper, scenes and furniture.
pub const MANIPULATION: FileSet =
    FileSet { name: "ogbench 1.2.2, manipspace", list: include_str!("manipspace.sha256") };
/// The bodies of OGBench's mazes.
pub const MAZES: FileSet = FileSet { name: "ogbench 1.2.2, locomaze", list: include_str!("locomaze.sha256") };
/// The humanoid of OGBench's mazes: apart, so that records of the other bodies stay what they are.
pub const HUMANOID_MAZE: FileSet =
    FileSet { name: "ogbench 1.2.2, locomaze humanoid", list: include_str!("locomaze_humanoid.sha256") };
/// The robot and the tables of Fetch.
pub const FETCH: FileSet =
    FileSet { name: "gymnasium_robotics 1.4.2, fetch", list: include_str!("fetch.sha256") };

/// The robot and the scenes of Meta-World's ten tasks.
pub const METAWORLD: FileSet =
    FileSet { name: "metaworld 3.1.1, ten tasks", list: include_str!("metaworld.sha256") };

/// The library as it was published for this platform; none where nobody publishes it.
pub(super) const LIBRARY_SHA256: Option<&str> = if cfg!(all(target_os = "linux", target_arch = "x86_64")) {
    Some("23496b023ee80fb61ab71167e94bc649f9941710fde96b18bb8204fb332523ad")
} else if cfg!(all(target_os = "linux", target_arch = "aarch64")) {
    Some("e2edd0204fb9229f75f332a4fcd1a32345bb9f90651dc0fddfa20ec0670db789")
} else if cfg!(all(target_os = "macos", target_arch = "aarch64")) {
    Some("454d51fa639100018579716bd68e61285e9b53c9241b029680d82dec95bc8d53")
} else if cfg!(all(windows, target_arch = "x86_64")) {
    Some("c395db1b3f5110a730c4b0c31b7a4f29881af459c8a74a03e14b7683f022d57f")
} else {
    None
};

impl FileSet {
    /// The SHA-256 of the list: one value for the content of all files.
    pub fn sha256(self) -> String {
        sha256(self.list.as_bytes())
    }

    /// Compares every file below the data folder `home`; at the first call of a process only.
    ///
    /// # Errors
    ///
    /// [`MujocoError::NoAsset`] for the first file that is missing, [`MujocoError::Altered`] for one that is another.
    pub(super) fn check(self, home: &Path) -> Result<(), MujocoError> {
        static CHECKED: Mutex<BTreeSet<(PathBuf, &str)>> = Mutex::new(BTreeSet::new());
        let mut checked = CHECKED.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (home.to_owned(), self.name);
        if !checked.contains(&key) {
            self.compare(home)?;
            checked.insert(key);
        }
        Ok(())
    }

    fn compare(self, home: &Path) -> Result<(), MujocoError> {
        with_hashes(|hashes| {
            for (expected, name) in self.list.lines().filter_map(|line| line.split_once("  ")) {
                let path = home.join(name);
                match hashes.of(&path) {
                    Ok(found) if found == expected => {}
                    Ok(found) => {
                        return Err(MujocoError::Altered { path, expected: expected.to_owned(), found });
                    }
                    Err(error) if error.kind() == io::ErrorKind::NotFound => {
                        return Err(MujocoError::NoAsset { path });
                    }
                    Err(error) => {
                        let model = path.display().to_string();
                        return Err(MujocoError::Model {
                            model,
                            reason: format!("it cannot be read: {error}"),
                        });
                    }
                }
            }
            Ok(())
        })
    }
}

/// The SHA-256 of the library at `path`, before it is loaded. `expected`: what it must be, if anything.
///
/// # Errors
///
/// [`MujocoError::NoLibrary`]: it cannot be read; [`MujocoError::Altered`]: it is another.
pub(crate) fn library_sha256(path: &Path, expected: Option<&str>) -> Result<String, MujocoError> {
    let failed = |error: io::Error| {
        let reason = match error.kind() {
            io::ErrorKind::NotFound => "no such file".to_owned(),
            _ => error.to_string(),
        };
        MujocoError::NoLibrary { tried: format!("{} ({reason})", path.display()) }
    };
    let found = with_hashes(|hashes| hashes.of(path)).map_err(failed)?;
    match expected {
        Some(expected) if expected != found => {
            Err(MujocoError::Altered { path: path.to_owned(), expected: expected.to_owned(), found })
        }
        _ => Ok(found),
    }
}

/// The SHA-256 of the library and of the files that an environment is made from, for its record.
pub fn asset_hashes(files: FileSet) -> BTreeMap<String, String> {
    let library = super::loaded_sha256().map(|sha256| (format!("MuJoCo {}", super::MUJOCO_VERSION), sha256));
    library.into_iter().chain([(files.name.to_owned(), files.sha256())]).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::assets::{
        DM_CONTROL_VERSION, GYMNASIUM_ROBOTICS_VERSION, METAWORLD_VERSION, OGBENCH_VERSION, data_folder,
    };

    #[test]
    fn the_lists_are_of_the_pinned_versions() {
        for (set, files, folder) in [
            (SUITE, 22, format!("dm_control/{DM_CONTROL_VERSION}/suite/")),
            (MANIPULATION, 66, format!("ogbench/{OGBENCH_VERSION}/manipspace/")),
            (MAZES, 2, format!("ogbench/{OGBENCH_VERSION}/locomaze/")),
            (HUMANOID_MAZE, 1, format!("ogbench/{OGBENCH_VERSION}/locomaze/")),
            (FETCH, 25, format!("gymnasium_robotics/{GYMNASIUM_ROBOTICS_VERSION}/")),
            (METAWORLD, 72, format!("metaworld/{METAWORLD_VERSION}/")),
        ] {
            assert_eq!(set.list.lines().count(), files, "{}", set.name);
            for line in set.list.lines() {
                let (hash, path) = line.split_once("  ").unwrap();
                assert!(hash.len() == 64 && path.starts_with(&folder), "{line}");
            }
            set.check(&data_folder().unwrap()).unwrap();
        }
    }

    #[test]
    fn an_altered_or_missing_model_is_told_by_name() {
        let (home, installed) = (tempfile::tempdir().unwrap(), data_folder().unwrap());
        for line in MAZES.list.lines() {
            let (_, name) = line.split_once("  ").unwrap();
            fs::create_dir_all(home.path().join(name).parent().unwrap()).unwrap();
            fs::copy(installed.join(name), home.path().join(name)).unwrap();
        }
        MAZES.compare(home.path()).unwrap();
        let ant = home.path().join("ogbench/1.2.2/locomaze/ant.xml");
        let text = fs::read_to_string(&ant).unwrap();
        fs::write(&ant, text.replacen("0.25", "0.26", 1)).unwrap();
        let message = MAZES.compare(home.path()).unwrap_err().to_string();
        for part in ["ant.xml", "not the file that was published", "cargo xtask setup"] {
            assert!(message.contains(part), "{message}");
        }
        fs::remove_file(&ant).unwrap();
        assert!(matches!(MAZES.compare(home.path()), Err(MujocoError::NoAsset { path }) if path == ant));
    }

    #[test]
    fn an_altered_library_is_refused_before_it_is_loaded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("libmujoco.so");
        fs::write(&path, "not even a library").unwrap();
        let error = library_sha256(&path, LIBRARY_SHA256.or(Some("another"))).unwrap_err();
        assert!(matches!(&error, MujocoError::Altered { path: at, .. } if *at == path), "{error}");
        // One that the user names is taken as it is.
        assert_eq!(library_sha256(&path, None).unwrap().len(), 64);
    }
}
