//! Where the MuJoCo library and the model files lie. `cargo xtask setup` puts them there; nothing here fetches.
//!
//! ```text
//! <data>/mujoco/3.17.0/libmujoco.so.3.17.0
//! <data>/dm_control/1.0.50/suite/*.xml, suite/common/*.xml
//! <data>/ogbench/1.2.2/manipspace/*.xml, and folders of meshes
//! <data>/ogbench/1.2.2/locomaze/*.xml
//! <data>/gymnasium_robotics/1.4.2/fetch/*.xml, stls/fetch/*.stl, textures/block.png
//! <data>/metaworld/3.1.1/sawyer_xyz/*.xml, and folders of parts, meshes and textures
//! ```
//!
//! `<data>` is [`data_folder`]. Its files must be those that were published (`published`). A program that brings its own files
//! says so with [`set_library`], [`set_folder`] and [`set_fix`], before it makes an environment.

mod hashes;
mod published;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::{PoisonError, RwLock};

use self::published::LIBRARY_SHA256;
pub(crate) use self::published::library_sha256;
pub use self::published::{
    FETCH, FileSet, HUMANOID_MAZE, MANIPULATION, MAZES, METAWORLD, SUITE, asset_hashes,
};
use crate::error::MujocoError;

/// The pinned version of MuJoCo: trajectories differ between versions.
pub const MUJOCO_VERSION: &str = "3.17.0";
/// The pinned version of `dm_control`, whose models the suite uses.
pub const DM_CONTROL_VERSION: &str = "1.0.50";
/// The pinned version of `ogbench`, whose arm, gripper and scenes the manipulation environments use, and whose bodies the mazes.
pub const OGBENCH_VERSION: &str = "1.2.2";
/// The pinned version of `gymnasium_robotics`, whose robot and tables the Fetch environments use.
pub const GYMNASIUM_ROBOTICS_VERSION: &str = "1.4.2";
/// The pinned version of `metaworld`, whose robot and scenes the Meta-World environments use.
pub const METAWORLD_VERSION: &str = "3.1.1";
/// The folder with everything, instead of the user's data folder.
pub const HOME_VARIABLE: &str = "SWM_HOME";
/// A MuJoCo library, instead of the one of the data folder.
pub const LIBRARY_VARIABLE: &str = "SWM_MUJOCO_LIB";

/// The file name of the library on this platform.
pub const LIBRARY_FILE: &str = if cfg!(target_os = "macos") {
    "libmujoco.3.17.0.dylib"
} else if cfg!(windows) {
    "mujoco.dll"
} else {
    "libmujoco.so.3.17.0"
};

/// What the program has set; it goes before environment variables.
#[derive(Debug)]
struct Chosen {
    library: Option<PathBuf>,
    folder: Option<PathBuf>,
    fix: Option<String>,
    /// The library that the process has loaded, and its SHA-256.
    loaded: Option<(PathBuf, String)>,
}

static CHOSEN: RwLock<Chosen> = RwLock::new(Chosen { library: None, folder: None, fix: None, loaded: None });

fn chosen<T>(read: impl FnOnce(&Chosen) -> T) -> T {
    read(&CHOSEN.read().unwrap_or_else(PoisonError::into_inner))
}

fn choose<T>(write: impl FnOnce(&mut Chosen) -> T) -> T {
    write(&mut CHOSEN.write().unwrap_or_else(PoisonError::into_inner))
}

/// Sets the file of the MuJoCo library for this process, instead of `$SWM_MUJOCO_LIB` and the data folder.
///
/// # Errors
///
/// [`MujocoError::Loaded`]: the process has loaded another library already.
pub fn set_library(path: impl Into<PathBuf>) -> Result<(), MujocoError> {
    let path = path.into();
    choose(|chosen| match &chosen.loaded {
        Some((loaded, _)) if *loaded != path => Err(MujocoError::Loaded { path: loaded.clone() }),
        _ => {
            chosen.library = Some(path);
            Ok(())
        }
    })
}

/// Sets the data folder for this process, instead of `$SWM_HOME`. Environments that exist keep their models.
pub fn set_folder(path: impl Into<PathBuf>) {
    choose(|chosen| chosen.folder = Some(path.into()));
}

/// Sets what errors tell a user to do about a missing file, instead of running `cargo xtask setup`: an imperative such as
/// "reinstall the package".
pub fn set_fix(text: impl Into<String>) {
    choose(|chosen| chosen.fix = Some(text.into()));
}

/// What [`set_fix`] set: a package around this library brings its own files, and not all that environments can use.
pub fn chosen_fix() -> Option<String> {
    chosen(|chosen| chosen.fix.clone())
}

/// The fix for a missing file, for messages.
pub(crate) fn fix(or: &str) -> String {
    let default = || format!("run `cargo xtask setup`, which fetches it{or}");
    chosen_fix().unwrap_or_else(default)
}

/// Remembers which library the process has loaded.
pub(crate) fn set_loaded(path: &Path, sha256: String) {
    choose(|chosen| chosen.loaded = Some((path.to_owned(), sha256)));
}

/// The SHA-256 of the library that the process has loaded; `None` before the first environment.
pub fn loaded_sha256() -> Option<String> {
    chosen(|chosen| chosen.loaded.as_ref().map(|(_, sha256)| sha256.clone()))
}

/// What the SHA-256 of the library at `path` must be: that of the published one in the data folder, anything elsewhere, for
/// there the user or the program chose it.
pub fn expected_library(path: &Path) -> Option<&'static str> {
    let ours = known_data_folder().ok()?.join("mujoco").join(MUJOCO_VERSION).join(LIBRARY_FILE);
    LIBRARY_SHA256.filter(|_| path == ours)
}

/// The data folder: what [`set_folder`] says, else `$SWM_HOME`, else `stable-worldmodel` where the system keeps the data of programs: `$XDG_DATA_HOME`
/// or `~/.local/share`; on macOS `~/Library/Application Support`, on Windows `%LOCALAPPDATA%`. `None`: none of these
/// variables is set.
pub fn data_folder() -> Option<PathBuf> {
    chosen(|chosen| chosen.folder.clone())
        .or_else(|| data_folder_from(|name| std::env::var_os(name), std::env::consts::OS))
}

fn data_folder_from(variable: impl Fn(&str) -> Option<OsString>, os: &str) -> Option<PathBuf> {
    let set = |name: &str| variable(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    if let Some(home) = set(HOME_VARIABLE) {
        return Some(home);
    }
    let below_home = |path: &str| set("HOME").map(|home| home.join(path));
    let user = match os {
        "macos" => below_home("Library/Application Support"),
        "windows" => set("LOCALAPPDATA"),
        // The rule of the XDG specification: a relative path counts as none.
        _ => set("XDG_DATA_HOME").filter(|path| path.is_absolute()).or_else(|| below_home(".local/share")),
    };
    Some(user?.join("stable-worldmodel"))
}

/// The path of the library: what [`set_library`] says, else `$SWM_MUJOCO_LIB`, else the one in the data folder.
///
/// # Errors
///
/// [`MujocoError::NoLibrary`]: neither a variable nor a home folder says where to look.
pub fn library_path() -> Result<PathBuf, MujocoError> {
    if let Some(path) = chosen(|chosen| chosen.library.clone()) {
        return Ok(path);
    }
    if let Some(path) = std::env::var_os(LIBRARY_VARIABLE).filter(|value| !value.is_empty()) {
        return Ok(path.into());
    }
    Ok(known_data_folder()?.join("mujoco").join(MUJOCO_VERSION).join(LIBRARY_FILE))
}

/// The model `name` of the DeepMind Control Suite: `cheetah.xml`.
///
/// # Errors
///
/// [`MujocoError::NoAsset`]: a file is missing; [`MujocoError::Altered`]: one is not as it was published;
/// [`MujocoError::NoLibrary`]: nothing says where the data folder is.
pub fn suite_model(name: &str) -> Result<PathBuf, MujocoError> {
    model(SUITE, &format!("dm_control/{DM_CONTROL_VERSION}/suite/{name}"))
}

/// A model of OGBench's manipulation environments: `robotiq_2f85/2f85.xml`.
///
/// # Errors
///
/// As of [`suite_model`].
pub fn manipulation_model(name: &str) -> Result<PathBuf, MujocoError> {
    model(MANIPULATION, &format!("ogbench/{OGBENCH_VERSION}/manipspace/{name}"))
}

/// A body of OGBench's mazes: `ant.xml`.
///
/// # Errors
///
/// As of [`suite_model`].
pub fn maze_model(name: &str) -> Result<PathBuf, MujocoError> {
    let files = if name == "humanoid.xml" { HUMANOID_MAZE } else { MAZES };
    model(files, &format!("ogbench/{OGBENCH_VERSION}/locomaze/{name}"))
}

/// A model of the Fetch environments: `push.xml`.
///
/// # Errors
///
/// As of [`suite_model`].
pub fn fetch_model(name: &str) -> Result<PathBuf, MujocoError> {
    model(FETCH, &format!("gymnasium_robotics/{GYMNASIUM_ROBOTICS_VERSION}/fetch/{name}"))
}

/// A scene of the Meta-World environments: `sawyer_drawer.xml`.
///
/// # Errors
///
/// As of [`suite_model`].
pub fn metaworld_model(name: &str) -> Result<PathBuf, MujocoError> {
    model(METAWORLD, &format!("metaworld/{METAWORLD_VERSION}/sawyer_xyz/{name}"))
}

/// A file of a set, once all of the set were compared.
fn model(files: FileSet, name: &str) -> Result<PathBuf, MujocoError> {
    let home = known_data_folder()?;
    let path = home.join(name);
    if !path.is_file() {
        return Err(MujocoError::NoAsset { path });
    }
    files.check(&home)?;
    Ok(path)
}

fn known_data_folder() -> Result<PathBuf, MujocoError> {
    let tried = || format!("no data folder: neither {HOME_VARIABLE} nor HOME is set");
    data_folder().ok_or_else(|| MujocoError::NoLibrary { tried: tried() })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(os: &str, variables: &[(&str, &str)]) -> Option<PathBuf> {
        let variable =
            |name: &str| variables.iter().find(|(key, _)| *key == name).map(|(_, value)| value.into());
        data_folder_from(variable, os)
    }

    #[test]
    fn the_data_folder_follows_the_environment_and_the_system() {
        let all = [("SWM_HOME", "/a"), ("XDG_DATA_HOME", "/x"), ("HOME", "/h"), ("LOCALAPPDATA", "/l")];
        let expect = |os: &str, variables: &[(&str, &str)], path: &str| {
            assert_eq!(folder(os, variables).as_deref(), Some(Path::new(path)), "{os} {variables:?}");
        };
        expect("linux", &all, "/a");
        expect("linux", &all[1..], "/x/stable-worldmodel");
        expect(
            "linux",
            &[("XDG_DATA_HOME", "relative"), ("HOME", "/h")],
            "/h/.local/share/stable-worldmodel",
        );
        expect("macos", &all[1..], "/h/Library/Application Support/stable-worldmodel");
        expect("windows", &all[1..], "/l/stable-worldmodel");
        assert_eq!(folder("linux", &[("SWM_HOME", "")]), None);
    }

    #[test]
    fn the_library_file_carries_the_version() {
        assert!(cfg!(windows) || LIBRARY_FILE.contains(MUJOCO_VERSION));
    }

    #[test]
    fn a_missing_model_names_its_path_and_the_command() {
        for find in [suite_model, manipulation_model, maze_model, fetch_model, metaworld_model] {
            let message = find("no_such.xml").unwrap_err().to_string();
            assert!(message.contains("no_such.xml") && message.contains("cargo xtask setup"), "{message}");
        }
    }
}
