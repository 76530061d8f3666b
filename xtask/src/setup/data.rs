//! What environments need at run time and the repository does not hold: the physics library and models of other projects,
//! in the user's data folder, where every checkout and the installed command find them.

use std::env;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Error, Result, bail};

use super::Source;
use super::folder;
use super::wheel::{self, ANY, Keep, Package, Wheel};

/// One line per thing to fetch: what it is, what it is for, where it goes below the data folder.
pub(super) const PACKAGES: &[&Package] = &[&MUJOCO, &DM_CONTROL, &OGBENCH, &GYMNASIUM_ROBOTICS, &METAWORLD];

/// The physics engine, loaded at run time; Apache-2.0. There are no wheels for Intel Macs and musl.
pub(crate) const MUJOCO: Package = Package {
    name: "mujoco",
    version: "3.17.0",
    wheels: &[
        Wheel {
            platforms: &["linux-x86_64"],
            tag: "manylinux_2_28_x86_64",
            sha256: "42371356efe53a5f5f73ed03fcb967bdf04048017f80e2fca01e71a360e42da2",
        },
        Wheel {
            platforms: &["linux-aarch64"],
            tag: "manylinux_2_28_aarch64",
            sha256: "525e09a00ecd964f06582773d9eeb03bb0e5a1675edf296a6868024759b3b235",
        },
        Wheel {
            platforms: &["macos-aarch64"],
            tag: "macosx_11_0_arm64",
            sha256: "c677ab789299db70ca3fffe96b44a424bdad516cc87cc2a83898140923c2e91e",
        },
        Wheel {
            platforms: &["windows-x86_64"],
            tag: "win_amd64",
            sha256: "17ab707e86b0a5da13582a5335d3ea585a5ac4cce2e814e15b203530d1bf16e3",
        },
    ],
    keep: &[
        Keep {
            from: &["mujoco/libmujoco.so.3.17.0", "mujoco/libmujoco.3.17.0.dylib", "mujoco/mujoco.dll"],
            to: "",
        },
        Keep { from: &["mujoco-3.17.0.dist-info/licenses/*"], to: "" },
    ],
};

/// The models of the DeepMind Control Suite; Apache-2.0.
pub(crate) const DM_CONTROL: Package = Package {
    name: "dm_control",
    version: "1.0.50",
    wheels: &[Wheel {
        platforms: &[ANY],
        tag: ANY,
        sha256: "5434e1e51ff69016867426da7df6064b18d140e4d0a628f879bbcf0e7d0a586d",
    }],
    keep: &[
        Keep { from: &["dm_control/suite/*.xml"], to: "suite" },
        Keep { from: &["dm_control/suite/common/*.xml"], to: "suite/common" },
        Keep { from: &["dm_control-1.0.50.dist-info/licenses/*"], to: "" },
    ],
};

/// Arm, gripper and scenes of OGBench's manipulation environments, and the bodies of its mazes; MIT. The arm's and the gripper's meshes are under the
/// BSD licenses next to them; those of the furniture (`metaworld`) carry none, so they are fetched and never passed on.
const OGBENCH: Package = Package {
    name: "ogbench",
    version: "1.2.2",
    wheels: &[Wheel {
        platforms: &[ANY],
        tag: ANY,
        sha256: "e0f809be281f2e222283283a300a5cf04fbd6947a6a7b84846fb9da2c30a088d",
    }],
    keep: &[
        Keep { from: &["ogbench/manipspace/descriptions/**"], to: "manipspace" },
        Keep { from: &["ogbench/locomaze/assets/point.xml"], to: "locomaze" },
        Keep { from: &["ogbench/locomaze/assets/ant.xml"], to: "locomaze" },
        Keep { from: &["ogbench/locomaze/assets/humanoid.xml"], to: "locomaze" },
        Keep { from: &["ogbench-1.2.2.dist-info/LICENSE"], to: "" },
    ],
};

/// The Fetch robot and its tables; MIT. Its meshes carry no license of their own, so they are fetched and never passed on.
const GYMNASIUM_ROBOTICS: Package = Package {
    name: "gymnasium_robotics",
    version: "1.4.2",
    wheels: &[Wheel {
        platforms: &[ANY],
        tag: ANY,
        sha256: "a1743530431cb377e6b3b956d284bc96436fc68bac1648ef205054c178e7dc4b",
    }],
    keep: &[
        Keep { from: &["gymnasium_robotics/envs/assets/fetch/*.xml"], to: "fetch" },
        Keep { from: &["gymnasium_robotics/envs/assets/stls/fetch/*.stl"], to: "stls/fetch" },
        Keep { from: &["gymnasium_robotics/envs/assets/textures/block.png"], to: "textures" },
        Keep { from: &["gymnasium_robotics/envs/assets/LICENSE.md"], to: "" },
        Keep { from: &["gymnasium_robotics-1.4.2.dist-info/licenses/*"], to: "" },
    ],
};

/// The Sawyer robot and the scenes of Meta-World's ten tasks; MIT. Meshes and textures carry no license of their own, so they are fetched and never
/// passed on.
const METAWORLD: Package = Package {
    name: "metaworld",
    version: "3.1.1",
    wheels: &[Wheel {
        platforms: &[ANY],
        tag: ANY,
        sha256: "99e25d9baf97f2f1a19ca89c0d2ca9c6a2b396d9a9be81729de64eedc683f0d3",
    }],
    keep: &[
        Keep { from: &["metaworld/assets/scene/basic_scene.xml"], to: "scene" },
        Keep {
            from: &[
                "metaworld/assets/sawyer_xyz/sawyer_reach_v3.xml",
                "metaworld/assets/sawyer_xyz/sawyer_push_v3.xml",
                "metaworld/assets/sawyer_xyz/sawyer_pick_place_v3.xml",
                "metaworld/assets/sawyer_xyz/sawyer_door_pull.xml",
                "metaworld/assets/sawyer_xyz/sawyer_drawer.xml",
                "metaworld/assets/sawyer_xyz/sawyer_button_press_topdown.xml",
                "metaworld/assets/sawyer_xyz/sawyer_peg_insertion_side.xml",
                "metaworld/assets/sawyer_xyz/sawyer_window_horizontal.xml",
            ],
            to: "sawyer_xyz",
        },
        Keep { from: &["metaworld/assets/objects/assets/*.xml"], to: "objects/assets" },
        Keep { from: &["metaworld/assets/objects/meshes/xyz_base/*"], to: "objects/meshes/xyz_base" },
        Keep { from: &["metaworld/assets/objects/meshes/table/*"], to: "objects/meshes/table" },
        Keep { from: &["metaworld/assets/objects/meshes/block/*"], to: "objects/meshes/block" },
        Keep { from: &["metaworld/assets/objects/meshes/doorlock/*"], to: "objects/meshes/doorlock" },
        Keep { from: &["metaworld/assets/objects/meshes/drawer/*"], to: "objects/meshes/drawer" },
        Keep { from: &["metaworld/assets/objects/meshes/buttonbox/*"], to: "objects/meshes/buttonbox" },
        Keep { from: &["metaworld/assets/objects/meshes/peg_block/*"], to: "objects/meshes/peg_block" },
        Keep { from: &["metaworld/assets/objects/meshes/window/*"], to: "objects/meshes/window" },
        Keep {
            from: &[
                "metaworld/assets/textures/floor2.png",
                "metaworld/assets/textures/metal.png",
                "metaworld/assets/textures/metal1.png",
                "metaworld/assets/textures/metal2.png",
                "metaworld/assets/textures/wood1.png",
                "metaworld/assets/textures/wood2.png",
                "metaworld/assets/textures/wood4.png",
            ],
            to: "textures",
        },
        Keep { from: &["metaworld-3.1.1.dist-info/licenses/*"], to: "" },
    ],
};

/// The list of files and their checksums in each folder; `sha256sum --check` reads it too.
const CHECKSUMS: &str = "SHA256SUMS";

/// The data folder: `$SWM_HOME`, else below what the system has for the data of programs.
pub(crate) fn home() -> Result<PathBuf> {
    home_from(|name| env::var_os(name).map(PathBuf::from), env::consts::OS)
}

fn home_from(variable: impl Fn(&str) -> Option<PathBuf>, os: &str) -> Result<PathBuf> {
    let set = |name: &str| variable(name).filter(|path| !path.as_os_str().is_empty());
    if let Some(home) = set("SWM_HOME") {
        return std::path::absolute(&home).with_context(|| format!("SWM_HOME={}", home.display()));
    }
    let below_home = |path: &str| set("HOME").map(|home| home.join(path));
    let data = match os {
        "macos" => below_home("Library/Application Support"),
        "windows" => set("LOCALAPPDATA"),
        // The rule of the XDG specification: a relative path counts as none.
        _ => set("XDG_DATA_HOME").filter(|path| path.is_absolute()).or_else(|| below_home(".local/share")),
    };
    match data {
        Some(data) => Ok(data.join("stable-worldmodel")),
        None => bail!("there is no data folder: neither SWM_HOME nor HOME is set; set SWM_HOME to a folder"),
    }
}

/// Where a package lies below the data folder, or below another one that is laid out like it.
pub(super) fn place(package: &Package, home: &Path) -> PathBuf {
    home.join(package.name).join(package.version)
}

/// Makes sure that the package is at its place, whole and unaltered. Returns a line that says what was done.
pub(super) fn ensure(package: &Package, home: &Path, source: &Source) -> Result<String> {
    let folder = place(package, home);
    let origin = origin(package)?;
    let state = match check(&folder, &origin) {
        State::Whole => {
            folder::tidy(home, &folder);
            return Ok(format!("{package} is in place ({})", folder.display()));
        }
        state => state,
    };
    if let State::Altered(what) = &state {
        eprintln!("setup: {} {what}: it is made anew", folder.display());
    }
    let start = Instant::now();
    source.commit(package);
    let is_new = folder::install(
        home,
        &folder,
        || matches!(check(&folder, &origin), State::Whole),
        |place| {
            source.unpack(package, place)?;
            write_checksums(place, &origin)
        },
    )
    .with_context(|| format!("failed to set up {package} in {}", folder.display()))?;
    let done = if is_new { source.done() } else { "put there by another set-up" };
    Ok(format!("{package} {done} in {:.1} s into {}", start.elapsed().as_secs_f32(), folder.display()))
}

/// Whether the folder is at fault: full, or not ours to write.
pub(super) fn is_about_the_place(error: &Error) -> bool {
    error.chain().any(|cause| {
        let kind = cause.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
        let is_ours = matches!(
            kind,
            Some(
                ErrorKind::PermissionDenied
                    | ErrorKind::ReadOnlyFilesystem
                    | ErrorKind::StorageFull
                    | ErrorKind::QuotaExceeded
                    | ErrorKind::NotADirectory
                    | ErrorKind::AlreadyExists
            )
        );
        // What pip says of the same.
        is_ours || cause.to_string().contains(wheel::DISK_FULL)
    })
}

/// How a folder compares with its list of checksums.
#[derive(Debug, PartialEq)]
enum State {
    Missing,
    Whole,
    /// Completes "the folder …".
    Altered(String),
}

fn check(folder: &Path, origin: &str) -> State {
    if !folder.exists() {
        return State::Missing;
    }
    let Ok(list) = fs::read_to_string(folder.join(CHECKSUMS)) else {
        return State::Altered(format!("has no {CHECKSUMS}"));
    };
    let Some(lines) = list.strip_prefix(origin) else {
        return State::Altered("was made from another wheel, or holds other parts of it".into());
    };
    for line in lines.lines() {
        let Some((expected, name)) = line.split_once("  ") else {
            return State::Altered(format!("has a broken {CHECKSUMS}"));
        };
        match wheel::sha256(&folder.join(name)) {
            Ok(found) if found == expected => {}
            Ok(_) => return State::Altered(format!("has an altered {name}")),
            Err(_) => return State::Altered(format!("lacks {name}")),
        }
    }
    State::Whole
}

/// The head of the list of checksums: which wheel, which parts of it.
fn origin(package: &Package) -> Result<String> {
    let kept: Vec<String> =
        package.keep.iter().map(|keep| format!("{} > ./{}", keep.from.join(" or "), keep.to)).collect();
    let sha256 = package.wheel()?.sha256;
    Ok(format!("# {package}, from the wheel {sha256}\n# kept: {}\n", kept.join(", ")))
}

fn write_checksums(folder: &Path, origin: &str) -> Result<()> {
    let mut files = Vec::new();
    collect_files(folder, &mut files)?;
    files.sort();
    let mut list = origin.to_owned();
    for file in files {
        let name = file.strip_prefix(folder).unwrap_or(&file).to_string_lossy().replace('\\', "/");
        list += &format!("{}  {name}\n", wheel::sha256(&file)?);
    }
    wheel::write(&folder.join(CHECKSUMS), list.as_bytes())
}

fn collect_files(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() { collect_files(&path, files)? } else { files.push(path) }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn home_with(os: &str, variables: &[(&str, &str)]) -> Result<PathBuf> {
        let find = |name: &str| variables.iter().find(|(known, _)| *known == name);
        home_from(|name| find(name).map(|(_, value)| PathBuf::from(value)), os)
    }

    #[cfg(unix)]
    #[test]
    fn the_data_folder_is_where_the_system_has_data() {
        let path = |os: &str, variables: &[_]| home_with(os, variables).unwrap().display().to_string();
        let home = ("HOME", "/users/a");
        assert_eq!(path("linux", &[home]), "/users/a/.local/share/stable-worldmodel");
        assert_eq!(path("linux", &[home, ("XDG_DATA_HOME", "/data")]), "/data/stable-worldmodel");
        assert_eq!(
            path("linux", &[home, ("XDG_DATA_HOME", "relative")]),
            "/users/a/.local/share/stable-worldmodel"
        );
        assert_eq!(path("macos", &[home]), "/users/a/Library/Application Support/stable-worldmodel");
        assert_eq!(path("windows", &[("LOCALAPPDATA", "/local")]), "/local/stable-worldmodel");
    }

    #[cfg(unix)]
    #[test]
    fn the_variable_comes_first_unless_it_is_empty() {
        let home = ("HOME", "/users/a");
        assert_eq!(home_with("macos", &[home, ("SWM_HOME", "/swm")]).unwrap(), Path::new("/swm"));
        assert!(home_with("linux", &[home, ("SWM_HOME", "")]).unwrap().ends_with("share/stable-worldmodel"));
        assert!(home_with("linux", &[("SWM_HOME", "here")]).unwrap().is_absolute());
    }

    #[test]
    fn without_a_home_the_message_says_what_to_set() {
        let error = home_with("linux", &[]).unwrap_err();
        assert!(error.to_string().ends_with("set SWM_HOME to a folder"), "{error}");
    }

    #[test]
    fn a_folder_is_whole_when_each_file_has_its_checksum() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("1.0");
        let origin = "# example\n";
        assert_eq!(check(&folder, origin), State::Missing);
        fs::create_dir_all(folder.join("deep")).unwrap();
        fs::write(folder.join("deep/a.xml"), "a").unwrap();
        assert_eq!(check(&folder, origin), State::Altered("has no SHA256SUMS".into()));
        write_checksums(&folder, origin).unwrap();
        assert_eq!(check(&folder, origin), State::Whole);
        assert!(matches!(check(&folder, "# another\n"), State::Altered(_)));
        fs::write(folder.join("deep/a.xml"), "b").unwrap();
        assert_eq!(check(&folder, origin), State::Altered("has an altered deep/a.xml".into()));
        fs::remove_file(folder.join("deep/a.xml")).unwrap();
        assert_eq!(check(&folder, origin), State::Altered("lacks deep/a.xml".into()));
    }

    #[test]
    fn full_and_forbidden_places_are_told_from_other_faults() {
        let fault = |kind: ErrorKind| Error::from(std::io::Error::from(kind)).context("failed to write a");
        assert!(is_about_the_place(&fault(ErrorKind::StorageFull)));
        assert!(is_about_the_place(&fault(ErrorKind::PermissionDenied)));
        assert!(is_about_the_place(&Error::msg("OSError: [Errno 28] No space left on device")));
        assert!(!is_about_the_place(&fault(ErrorKind::NotFound)));
        assert!(!is_about_the_place(&Error::msg("no network")));
    }
}
