//! Where the MuJoCo library and the model files lie. `cargo xtask setup` puts them there; nothing here fetches.
//!
//! ```text
//! <data>/mujoco/3.17.0/libmujoco.so.3.17.0
//! <data>/dm_control/1.0.50/suite/*.xml, suite/common/*.xml
//! ```
//!
//! `<data>` is `$SWM_HOME`, or else `stable-worldmodel` in the user's data folder.

use std::ffi::OsString;
use std::path::PathBuf;

use crate::error::MujocoError;

/// The pinned version of MuJoCo: trajectories differ between versions.
pub const MUJOCO_VERSION: &str = "3.17.0";
/// The pinned version of `dm_control`, whose models the suite uses.
pub const DM_CONTROL_VERSION: &str = "1.0.50";
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

/// The data folder: `$SWM_HOME`, else `stable-worldmodel` in `$XDG_DATA_HOME`, in `%LOCALAPPDATA%` (Windows) or in
/// `~/.local/share`. `None`: none of these variables is set.
pub fn data_folder() -> Option<PathBuf> {
    data_folder_from(|name| std::env::var_os(name).filter(|value| !value.is_empty()))
}

fn data_folder_from(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    if let Some(home) = variable(HOME_VARIABLE) {
        return Some(home.into());
    }
    let user = variable("XDG_DATA_HOME").or_else(|| variable("LOCALAPPDATA")).map(PathBuf::from);
    let user = user.or_else(|| Some(PathBuf::from(variable("HOME")?).join(".local/share")))?;
    Some(user.join("stable-worldmodel"))
}

/// Where the library is looked for: `$SWM_MUJOCO_LIB` alone if it is set, else the data folder.
pub fn library_path() -> Result<PathBuf, MujocoError> {
    if let Some(path) = std::env::var_os(LIBRARY_VARIABLE).filter(|value| !value.is_empty()) {
        return Ok(path.into());
    }
    Ok(known_data_folder()?.join("mujoco").join(MUJOCO_VERSION).join(LIBRARY_FILE))
}

/// The model `name` of the DeepMind Control Suite: `cheetah.xml`.
pub fn suite_model(name: &str) -> Result<PathBuf, MujocoError> {
    let path = known_data_folder()?.join("dm_control").join(DM_CONTROL_VERSION).join("suite").join(name);
    if path.is_file() { Ok(path) } else { Err(MujocoError::NoAsset { path }) }
}

fn known_data_folder() -> Result<PathBuf, MujocoError> {
    let tried = || format!("no folder: {HOME_VARIABLE}, XDG_DATA_HOME and HOME are all unset");
    data_folder().ok_or_else(|| MujocoError::NoLibrary { tried: tried() })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn folder(variables: &[(&str, &str)]) -> Option<PathBuf> {
        data_folder_from(|name| {
            variables.iter().find(|(key, _)| *key == name).map(|(_, value)| OsString::from(value))
        })
    }

    #[test]
    fn the_data_folder_follows_the_environment() {
        assert_eq!(folder(&[("SWM_HOME", "/a"), ("HOME", "/h")]).as_deref(), Some(Path::new("/a")));
        let xdg = folder(&[("XDG_DATA_HOME", "/x"), ("HOME", "/h")]);
        assert_eq!(xdg.as_deref(), Some(Path::new("/x/stable-worldmodel")));
        let home = folder(&[("HOME", "/h")]);
        assert_eq!(home.as_deref(), Some(Path::new("/h/.local/share/stable-worldmodel")));
        assert_eq!(folder(&[]), None);
    }

    #[test]
    fn the_library_file_carries_the_version() {
        assert!(cfg!(windows) || LIBRARY_FILE.contains(MUJOCO_VERSION));
    }

    #[test]
    fn a_missing_model_names_its_path_and_the_command() {
        let message = suite_model("no_such.xml").unwrap_err().to_string();
        assert!(message.contains("no_such.xml") && message.contains("cargo xtask setup"), "{message}");
    }
}
