//! What works on this machine, what does not, and which command fixes it.

use serde::Serialize;
use swm_core::{EnvConfig, EnvEntry, Registry};
use swm_media::Format;
use swm_tasks::request::{Report, Stage};
use swm_tasks::traps::{self, Found};

use crate::absent::FEATURES;

/// One thing that was looked at.
#[derive(Debug, Serialize)]
pub struct Check {
    /// Its name.
    pub what: &'static str,
    /// How it came out.
    pub state: State,
    /// What was found, or why it is missing.
    pub found: String,
    /// What fixes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fix: Option<String>,
}

/// How a check came out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum State {
    /// It works.
    Works,
    /// It is not there, and nothing else needs it.
    Optional,
    /// Something to know.
    Note,
    /// It is needed, and not there.
    Missing,
}

impl Check {
    pub(crate) fn works(what: &'static str, found: impl Into<String>) -> Self {
        Self { what, state: State::Works, found: found.into(), fix: None }
    }

    /// Missing, and nothing else needs it.
    fn optional(what: &'static str, found: impl Into<String>, fix: &str) -> Self {
        Self { what, state: State::Optional, found: found.into(), fix: Some(fix.to_owned()) }
    }

    pub(crate) fn missing(what: &'static str, found: impl Into<String>, fix: &str) -> Self {
        Self { what, state: State::Missing, found: found.into(), fix: Some(fix.to_owned()) }
    }
}

/// All checks, each made when it is taken: some take seconds.
pub fn checks<'a>(registry: &'a Registry, report: &'a mut dyn Report) -> impl Iterator<Item = Check> + 'a {
    let all = [program as fn() -> Check, videos, threads].into_iter().map(|look| look());
    #[cfg(feature = "mujoco")]
    let all = all.chain(mujoco::checks());
    let all = all.chain(std::iter::once_with(|| environments(registry, report))).chain(features());
    all.chain(std::iter::once_with(packages).flatten())
}

/// `0.1.0`, with the commit where the build has it.
pub(crate) fn program_line() -> String {
    let code = crate::evaluation::Code::this();
    let commit = code.commit.map(|commit| format!(" ({commit})")).unwrap_or_default();
    format!("{}{commit}, {}", code.version, code.target)
}

fn program() -> Check {
    Check::works("program", program_line())
}

/// What other builds have.
pub(crate) fn features() -> impl Iterator<Item = Check> {
    let absent = FEATURES.iter().filter(|feature| !feature.is_built);
    absent.map(|feature| {
        Check::optional(feature.title, format!("not in this build: {}", feature.brings), feature.command)
    })
}

/// What is known to surprise among the packages of Python.
fn packages() -> Vec<Check> {
    const NAME: &str = "packages of Python";
    let Some((python, found)) = traps::installed() else { return Vec::new() };
    let note = |found: Found| Check {
        what: NAME,
        state: State::Note,
        found: format!("{}: {}", found.packages, found.trap.does),
        fix: Some(found.trap.fix.clone()),
    };
    match found.is_empty() {
        true => {
            vec![Check::works(NAME, format!("{python} has none of the versions that docs/traps.md warns of"))]
        }
        false => found.into_iter().map(note).collect(),
    }
}

fn videos() -> Check {
    if Format::Mp4.is_built() {
        Check::works("videos", "PNG, GIF, MP4")
    } else {
        Check::optional("videos", "PNG, GIF; this build has no MP4", "see the feature mp4 below")
    }
}

fn threads() -> Check {
    let count = std::thread::available_parallelism().map_or(1, usize::from);
    Check::works("threads", format!("{count} by default; --threads changes that, never the results"))
}

/// Makes every environment once.
fn environments(registry: &Registry, report: &mut dyn Report) -> Check {
    let count = registry.envs().count();
    let stage = Stage { name: "", role: None, unit: "environments made", total: count as u64 };
    let bar = report.begin(&stage);
    let make = |entry: &EnvEntry| {
        let made = entry.make(&EnvConfig::default());
        bar.iter().for_each(|bar| bar.done(None));
        made.err().map(|error| (entry.id, error))
    };
    let failures: Vec<_> = registry.envs().filter_map(make).collect();
    drop(bar);
    match failures.first() {
        None => Check::works("environments", format!("all {count} can be made")),
        Some((_, first)) => {
            let found = format!("{} of {count} cannot be made; the first: {first}", failures.len());
            match failures.iter().all(|(id, _)| is_extra(id)) {
                true => Check::optional("environments", found, "see above"),
                false => Check::missing("environments", found, "see above, or `swm envs`"),
            }
        }
    }
}

/// Whether this is a package that comes without the models of an environment, which are from elsewhere.
#[cfg(feature = "mujoco")]
fn is_extra(env: &str) -> bool {
    swm_envs_mujoco::mujoco::assets::chosen_fix().is_some()
        && ["swm/OGB", "swm/Fetch", "swm/MetaWorld"].iter().any(|family| env.starts_with(family))
}

#[cfg(not(feature = "mujoco"))]
fn is_extra(_env: &str) -> bool {
    false
}

#[cfg(feature = "mujoco")]
mod mujoco {
    //! What the environments on MuJoCo need.

    use std::path::{Path, PathBuf};

    use swm_envs_mujoco::mujoco::MujocoError;
    use swm_envs_mujoco::mujoco::assets::{
        self, DM_CONTROL_VERSION, GYMNASIUM_ROBOTICS_VERSION, HOME_VARIABLE, METAWORLD_VERSION,
        MUJOCO_VERSION, OGBENCH_VERSION,
    };
    use swm_envs_mujoco::mujoco::{Library, gl::GlContext};

    use super::{Check, State};

    /// What fixes whatever is missing in the data folder.
    fn setup() -> String {
        let setup = "cargo xtask setup";
        if let Some(fix) = assets::chosen_fix() {
            return fix;
        }
        match assets::data_folder() {
            Some(folder) if can_be_made(&folder) => setup.into(),
            Some(folder) => format!(
                "{} cannot be written: set {HOME_VARIABLE} to a folder that can, and keep it set; then {setup}",
                folder.display()
            ),
            None => format!("set {HOME_VARIABLE} to a folder, and keep it set; then {setup}"),
        }
    }

    /// Whether somebody like us may write there, or make it: only an attempt shows it.
    fn can_be_made(folder: &Path) -> bool {
        let Some(there) = folder.ancestors().find(|path| path.exists()) else { return false };
        let attempt = there.join(format!(".swm-doctor-{}", std::process::id()));
        std::fs::create_dir(&attempt).and_then(|()| std::fs::remove_dir(&attempt)).is_ok()
    }

    pub(super) fn checks() -> impl Iterator<Item = Check> {
        [folder as fn() -> Check, library, suite, ogbench, fetch, metaworld, gl]
            .into_iter()
            .map(|look| look())
    }

    fn folder() -> Check {
        match assets::data_folder() {
            Some(folder) if folder.is_dir() => Check::works("data folder", folder.display().to_string()),
            Some(folder) => {
                Check::missing("data folder", format!("{} does not exist", folder.display()), &setup())
            }
            None => Check::missing(
                "data folder",
                "neither SWM_HOME nor HOME is set, so it is not known where it is",
                &setup(),
            ),
        }
    }

    fn library() -> Check {
        match (Library::get(), assets::library_path()) {
            (Ok(library), Ok(path)) => {
                let sha256 = assets::loaded_sha256().unwrap_or_default();
                let source = match assets::expected_library(&path) {
                    Some(_) => "as published".to_owned(),
                    None => format!("SHA-256 {sha256}, not compared"),
                };
                let version = library.version();
                Check::works("MuJoCo", format!("{version} at {} ({source})", path.display()))
            }
            (Err(error), _) | (_, Err(error)) => Check::missing("MuJoCo", error.to_string(), &setup()),
        }
    }

    fn suite() -> Check {
        const NAME: &str = "models of the Control Suite";
        models(NAME, assets::suite_model("cheetah.xml"), &format!("dm_control {DM_CONTROL_VERSION}"))
    }

    fn ogbench() -> Check {
        const NAME: &str = "models of OGBench";
        let all = assets::manipulation_model("robotiq_2f85/2f85.xml")
            .and(assets::maze_model("ant.xml"))
            .and(assets::maze_model("humanoid.xml"));
        extra(models(NAME, all, &format!("ogbench {OGBENCH_VERSION}")))
    }

    /// Models that a package does not carry.
    fn extra(check: Check) -> Check {
        match check.state {
            State::Missing if assets::chosen_fix().is_some() => Check { state: State::Optional, ..check },
            _ => check,
        }
    }

    fn models(name: &'static str, found: Result<PathBuf, MujocoError>, version: &str) -> Check {
        match found {
            Ok(_) => Check::works(name, format!("{version}, as published")),
            Err(MujocoError::NoAsset { .. } | MujocoError::NoLibrary { .. }) => {
                Check::missing(name, "not where they are looked for", &setup())
            }
            Err(error) => Check::missing(name, error.to_string(), &setup()),
        }
    }

    fn fetch() -> Check {
        const NAME: &str = "models of Fetch";
        let version = format!("gymnasium_robotics {GYMNASIUM_ROBOTICS_VERSION}");
        extra(models(NAME, assets::fetch_model("push.xml"), &version))
    }

    fn metaworld() -> Check {
        const NAME: &str = "models of Meta-World";
        let found = assets::metaworld_model("sawyer_drawer.xml");
        extra(models(NAME, found, &format!("metaworld {METAWORLD_VERSION}")))
    }

    /// Our own renderer draws without it.
    fn gl() -> Check {
        let needless =
            "only `renderer=gl` needs it (MuJoCo's own images); Debian: apt install libegl1 libgl1-mesa-dri";
        match GlContext::new() {
            Ok(context) => Check::works("OpenGL", format!("by {}, for `renderer=gl`", context.driver_name())),
            Err(error) => Check::optional("OpenGL", error.to_string(), needless),
        }
    }

    /// The version of the physics, for `swm --version`: what is pinned, and whether it is there.
    pub(crate) fn version() -> String {
        let there = assets::library_path().is_ok_and(|path| path.is_file());
        format!("MuJoCo {MUJOCO_VERSION}{}", if there { "" } else { " (not installed: cargo xtask setup)" })
    }
}

#[cfg(feature = "mujoco")]
pub(crate) use mujoco::version as mujoco_version;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_that_are_not_built_come_with_the_command_that_adds_them() {
        let onnx = features().find(|check| check.what == "feature onnx");
        assert_eq!(onnx.is_none(), cfg!(feature = "onnx"));
        for check in features() {
            let name = check.what.trim_start_matches("feature ");
            let fix = check.fix.unwrap_or_default();
            assert!(fix.starts_with("in a checkout, cargo install") && fix.contains(name), "{fix}");
        }
    }

    /// What brings MP4 has the feature `mp4`.
    #[test]
    fn a_build_has_mp4_or_has_it_not() {
        let is_absent = features().any(|check| check.what == "feature mp4");
        assert_eq!(is_absent, !Format::Mp4.is_built());
        assert_eq!(is_absent, videos().state == State::Optional);
    }
}
