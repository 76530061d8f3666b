//! The folder of what this program keeps of datasets and could make again.

use std::path::PathBuf;

/// `SWM_CACHE`, else `SWM_HOME/cache`, else the system's folder of caches; `None`: no variable names one.
#[must_use]
pub fn cache_folder(variable: impl Fn(&str) -> Option<String>, os: &str) -> Option<PathBuf> {
    let set =
        |name: &str| variable(name).map(|value| value.trim().to_owned()).filter(|value| !value.is_empty());
    let below_home = |path: &str| set("HOME").map(|home| PathBuf::from(home).join(path));
    let system = || match os {
        "macos" => below_home("Library/Caches"),
        "windows" => set("LOCALAPPDATA").map(PathBuf::from),
        _ => set("XDG_CACHE_HOME")
            .map(PathBuf::from)
            .filter(|path| path.is_absolute())
            .or_else(|| below_home(".cache")),
    };
    let own = set("SWM_CACHE").map(PathBuf::from);
    let data = || set("SWM_HOME").map(|home| PathBuf::from(home).join("cache"));
    own.or_else(data).or_else(|| Some(system()?.join("stable-worldmodel")))
}
