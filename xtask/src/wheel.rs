//! `cargo xtask wheel`: the Python package as a wheel, with MuJoCo's library and the control suite's models in it; and the
//! tests of that wheel in a virtual environment of its own.
//!
//! maturin builds the wheel of a release. For the tests, which need no optimization, the extension comes from the build of
//! the whole workspace, as tests have it: cargo alone would choose other features of shared dependencies for this one
//! crate, and build HDF5 and the solvers' algebra again. maturin then writes the metadata, and nothing is built twice.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};

use crate::metadata::Metadata;
use crate::setup::data;
use crate::{interop, process, setup, test};

/// Options of `cargo xtask wheel`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Pack the extension as tests build it: quick to make, slow to run
    #[arg(long)]
    dev: bool,
    /// Build for every Linux since glibc 2.28, with zig, which is fetched (100 MB); else for systems whose glibc is as new as this one's
    #[arg(long, conflicts_with = "dev")]
    zig: bool,
    /// Build for another CPU, such as aarch64-unknown-linux-gnu, whose standard library `rustup target add` brings; with --zig
    #[arg(long, requires = "zig")]
    target: Option<String>,
    /// Build Lance tables in, which takes many minutes more
    #[arg(long, conflicts_with = "dev")]
    lance: bool,
    /// The folder for the wheel; default: `wheels` in cargo's build directory, from which other wheels of the package are removed; with --target,
    /// a folder in it
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// The crate, below the root.
const CRATE: &str = "crates/swm-py";
/// The Python package, below the crate's folder `python`.
const PACKAGE: &str = "stable_worldmodel_rs";
/// What the wheel carries of the data folder, below the package.
const FILES: &str = "_lib";
/// The feature of the crate that brings training.
const TRAINING: &str = "baselines";
/// In a new process, with nothing but the wheel: an environment on MuJoCo, and the script.
const SMOKE: &str = "
import gymnasium, stable_worldmodel_rs
env = gymnasium.make('swm/CheetahDMControl-v0', image_shape=(32, 32))
observation, _ = env.reset(seed=0)
assert observation['pixels'].any(), 'the image is black'
env.step(env.action_space.sample())
";

/// Makes the wheel and says where it is.
pub(crate) fn run(args: &Args) -> Result<()> {
    setup::run(&setup::Args::default())?;
    let wheel = make(args)?;
    let size = fs::metadata(&wheel)?.len() as f64 / 1e6;
    println!("{} ({size:.1} MB); install it with `pip install {}`", wheel.display(), wheel.display());
    Ok(())
}

/// A step of `cargo xtask ci`: the wheel of this build, alone in a virtual environment, runs an environment and passes the
/// tests of the package.
pub(crate) fn check() -> Result<()> {
    let wheel = make(&Args { dev: true, ..Args::default() })?;
    let python = interop::python(&interop::WHEEL_TESTS)?;
    let mut pip = Command::new(&python);
    pip.args([
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
        "--force-reinstall",
    ]);
    process::run(pip.arg(&wheel))?;
    process::output(Command::new(&python).args(["-m", "pip", "check"]))?;

    let empty = tempfile::tempdir().context("no folder for a home without data")?;
    let mut smoke = Command::new(&python);
    smoke.args(["-c", SMOKE]).current_dir(empty.path());
    process::output(
        smoke.env_remove("SWM_HOME").env("HOME", empty.path()).env("XDG_DATA_HOME", empty.path()),
    )
    .context("the wheel alone does not run an environment on MuJoCo")?;

    let mut tests = Command::new(&python);
    tests.args(["-m", "pytest", "-q", "-p", "no:cacheprovider"]).current_dir(process::root().join(CRATE));
    tests.env("SWM_HOME", data::home()?).env("SWM_COMMAND", test::program()?);
    tests.env("SWM_TEST_TRAINING", "1");
    process::run(tests.env_remove("PYTHONPATH").env("PYTHONDONTWRITEBYTECODE", "1"))
}

fn make(args: &Args) -> Result<PathBuf> {
    let metadata = Metadata::load()?;
    let folder = metadata.target_directory.join("wheels").join(args.target.as_deref().unwrap_or_default());
    let out = args.out.clone().unwrap_or(folder);
    let out = std::path::absolute(&out).with_context(|| format!("{}", out.display()))?;
    setup::wheel::create_folder(&out)?;
    let python = interop::python(if args.zig { &interop::WHEEL_ZIG } else { &interop::WHEEL_BUILD })?;
    let work = tempfile::tempdir().context("no folder to make a wheel in")?;
    let tree = if args.dev {
        from_the_workspace(&metadata, &python, work.path())?
    } else {
        by_maturin(args, &python, work.path())?
    };
    add_files(&tree.join(PACKAGE).join(FILES), args.target.as_deref())?;
    let wheel = pack(&python, &tree, &out)?;
    if args.out.is_none() {
        remove_others(&wheel)?;
    }
    Ok(wheel)
}

/// Removes wheels of this package for other systems or of other versions, as `pip install target/wheels/*.whl` takes one.
fn remove_others(wheel: &Path) -> Result<()> {
    let folder = wheel.parent().context("a wheel lies in a folder")?;
    for entry in fs::read_dir(folder).with_context(|| format!("{} cannot be read", folder.display()))? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path != wheel && name.starts_with(&format!("{PACKAGE}-")) && name.ends_with(".whl") {
            fs::remove_file(&path).with_context(|| format!("{} cannot be removed", path.display()))?;
        }
    }
    Ok(())
}

/// maturin, in the crate's folder.
fn maturin(python: &Path) -> Command {
    let mut command = Command::new(python);
    command.args(["-m", "maturin"]).current_dir(process::root().join(CRATE));
    command
}

/// Builds a wheel by maturin and unpacks it.
fn by_maturin(args: &Args, python: &Path, work: &Path) -> Result<PathBuf> {
    let wheels = work.join("wheels");
    let mut build = maturin(python);
    build.args(["build", "--release", "--locked", "--interpreter"]).arg(python).arg("--out").arg(&wheels);
    build.args(["--features", &features(args)]);
    if args.lance {
        build.envs(setup::tools::protoc());
    }
    if args.zig {
        build.args(["--zig", "--compatibility", "manylinux_2_28"]);
        // The package `ziglang` of that environment, whatever else is on the PATH.
        build.env("CARGO_ZIGBUILD_PYTHON_PATH", python);
    }
    if let Some(target) = &args.target {
        build.args(["--target", target]);
    }
    process::run(&mut build)?;
    let wheel = only_entry(&wheels)?;
    let trees = work.join("trees");
    process::output(Command::new(python).args(["-m", "wheel", "unpack", "--dest"]).arg(&trees).arg(&wheel))?;
    only_entry(&trees)
}

/// What a wheel has beside the defaults: features that are named on maturin's command line replace those of `pyproject.toml`.
fn features(args: &Args) -> String {
    if args.lance { format!("{TRAINING},lance") } else { TRAINING.to_owned() }
}

/// Builds the workspace as tests do, and lays the extension, the Python files and maturin's metadata out as a wheel.
fn from_the_workspace(metadata: &Metadata, python: &Path, work: &Path) -> Result<PathBuf> {
    test::program()?;
    let tree = work.join("tree");
    lay_out(metadata, &tree)?;
    let mut info = maturin(python);
    info.args(["pep517", "write-dist-info", "--metadata-directory"])
        .arg(&tree)
        .arg("--interpreter")
        .arg(python);
    process::output(&mut info)?;
    Ok(tree)
}

/// Copies the Python files and the extension of the last build for tests to the folder `tree`.
fn lay_out(metadata: &Metadata, tree: &Path) -> Result<()> {
    copy(&process::root().join(CRATE).join("python").join(PACKAGE), &tree.join(PACKAGE), &is_source)?;
    let library = if cfg!(windows) {
        "_swm.dll"
    } else if cfg!(target_os = "macos") {
        "lib_swm.dylib"
    } else {
        "lib_swm.so"
    };
    let extension = tree.join(PACKAGE).join(if cfg!(windows) { "_swm.pyd" } else { "_swm.abi3.so" });
    fs::copy(metadata.target_directory.join("debug").join(library), &extension)
        .with_context(|| format!("the build left no {library}"))?;
    // Debug information is most of the file. Without the program `strip` the wheel is large, and as good.
    let _ = process::output(Command::new("strip").arg("-S").arg(&extension));
    Ok(())
}

/// Whether a file of the package's folder in the checkout belongs into a wheel: no libraries, caches or fetched files.
fn is_source(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default();
    let is_built = path.extension().is_some_and(|extension| extension == "so" || extension == "pyd");
    !is_built && name != "__pycache__" && name != FILES
}

/// Copies MuJoCo's library and the control suite's models with their licenses, laid out as in the data folder, from which
/// they are checked first. Models of OGBench stay out: part of them has no license.
fn add_files(folder: &Path, target: Option<&str>) -> Result<()> {
    let source = tempfile::tempdir().context("no folder for the files of the wheel")?;
    // The data folder holds what this machine runs; another one's library stays out of it.
    let home = if target.is_none() { data::home()? } else { source.path().to_owned() };
    let platform = platform(target)?;
    for package in [&data::MUJOCO, &data::DM_CONTROL] {
        let package = &package.for_platform(&platform)?;
        let place = setup::ensure_in(package, &home).or_else(|_| setup::ensure_in(package, source.path()))?;
        copy(&place, &folder.join(package.name).join(package.version), &|_| true)?;
    }
    Ok(())
}

/// What packages call the machine of a target; none: this one.
fn platform(target: Option<&str>) -> Result<String> {
    let Some(target) = target else { return Ok(setup::wheel::host()) };
    match target.split('-').collect::<Vec<_>>().as_slice() {
        [arch, _, "linux", "gnu"] => Ok(format!("linux-{arch}")),
        _ => bail!("no wheels are made for --target {target}; targets are named ARCH-unknown-linux-gnu"),
    }
}

/// Writes the list of files and packs them.
fn pack(python: &Path, tree: &Path, out: &Path) -> Result<PathBuf> {
    let fresh = tempfile::tempdir_in(out).context("no folder to pack a wheel in")?;
    process::output(
        Command::new(python).args(["-m", "wheel", "pack", "--dest-dir"]).arg(fresh.path()).arg(tree),
    )?;
    let wheel = only_entry(fresh.path())?;
    let name = wheel.file_name().context("a wheel has a name")?;
    let is_stable = name.to_string_lossy().contains("-cp310-abi3-");
    ensure!(is_stable, "{} is for other Pythons than 3.10 and later", name.display());
    let place = out.join(name);
    fs::rename(&wheel, &place).with_context(|| format!("cannot write {}", place.display()))?;
    Ok(place)
}

/// Copies a folder with what is in it, as far as `takes` agrees.
fn copy(from: &Path, to: &Path, takes: &dyn Fn(&Path) -> bool) -> Result<()> {
    setup::wheel::create_folder(to)?;
    for entry in fs::read_dir(from).with_context(|| format!("{} cannot be read", from.display()))? {
        let path = entry?.path();
        let place = to.join(path.file_name().context("an entry has a name")?);
        if !takes(&path) {
            continue;
        }
        if path.is_dir() {
            copy(&path, &place, takes)?;
        } else {
            fs::copy(&path, &place).with_context(|| format!("cannot write {}", place.display()))?;
        }
    }
    Ok(())
}

/// The one entry of a folder.
fn only_entry(folder: &Path) -> Result<PathBuf> {
    let entries: Vec<_> = fs::read_dir(folder)?.collect::<Result<_, _>>()?;
    ensure!(entries.len() == 1, "{} files in {}, and one was expected", entries.len(), folder.display());
    Ok(entries[0].path())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_told_from_what_is_built_or_fetched() {
        let takes = |path: &str| is_source(Path::new(path));
        assert!(takes("a/world.py") && takes("a/py.typed") && takes("a/_swm.pyi"));
        assert!(!takes("a/_swm.abi3.so") && !takes("a/__pycache__") && !takes("a/_lib"));
    }

    #[test]
    fn every_wheel_trains() {
        let pyproject = fs::read_to_string(process::root().join(CRATE).join("pyproject.toml")).unwrap();
        assert!(pyproject.contains(&format!("features = [\"{TRAINING}\"]")), "{pyproject}");
        let args = |lance| Args { lance, ..Args::default() };
        assert_eq!(features(&args(false)), "baselines");
        assert_eq!(features(&args(true)), "baselines,lance");
    }

    #[test]
    fn targets_are_the_machines_that_packages_name() {
        assert_eq!(platform(None).unwrap(), setup::wheel::host());
        let arm = platform(Some("aarch64-unknown-linux-gnu")).unwrap();
        assert_eq!(arm, "linux-aarch64");
        assert!(
            platform(Some("aarch64-apple-darwin"))
                .unwrap_err()
                .to_string()
                .contains("ARCH-unknown-linux-gnu")
        );
        let [here, there] = ["linux-x86_64", &arm]
            .map(|name| data::MUJOCO.for_platform(name).unwrap().wheel().unwrap().sha256);
        assert_ne!(here, there);
    }

    #[test]
    fn zig_is_pinned_by_hash_with_the_maturin_of_other_wheels() {
        let [zig, others] = [&interop::WHEEL_ZIG, &interop::WHEEL_BUILD]
            .map(|environment| fs::read_to_string(process::root().join(environment.requirements)).unwrap());
        let pinned = |text: &str, name: &str| {
            let at = text.find(&format!("{name}==")).unwrap_or_else(|| panic!("{name} is missing"));
            let pin: String = text[at..].lines().take_while(|line| !line.trim().starts_with('#')).collect();
            assert!(pin.contains("--hash=sha256:"), "{pin}");
            pin
        };
        assert!(pinned(&zig, "ziglang").len() > 64);
        assert_eq!(pinned(&zig, "maturin"), pinned(&others, "maturin"));
        assert!(!others.contains("ziglang"));
    }

    #[test]
    fn wheels_of_other_systems_and_versions_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let made = "stable_worldmodel_rs-0.2.0-cp310-abi3-linux_x86_64.whl";
        let others = [
            "stable_worldmodel_rs-0.2.0-cp310-abi3-manylinux_2_28_x86_64.whl",
            "stable_worldmodel_rs-0.1.0-cp310-abi3-linux_x86_64.whl",
        ];
        let strangers =
            ["stable_worldmodel_rs_extras-1.0-py3-none-any.whl", "stable_worldmodel_rs-0.2.0.tar.gz"];
        for name in others.iter().chain(&strangers).chain([&made]) {
            fs::write(folder.path().join(name), "").unwrap();
        }
        remove_others(&folder.path().join(made)).unwrap();
        let left = |name: &&str| folder.path().join(name).exists();
        assert!(left(&made) && strangers.iter().all(left) && !others.iter().any(left));
    }

    #[test]
    fn a_copy_has_what_was_chosen_and_nothing_else() {
        let (from, to) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        fs::create_dir_all(from.path().join("inner/__pycache__")).unwrap();
        for name in ["a.py", "b.so", "inner/c.py", "inner/__pycache__/c.pyc"] {
            fs::write(from.path().join(name), name).unwrap();
        }
        let place = to.path().join("copy");
        copy(from.path(), &place, &is_source).unwrap();
        assert_eq!(fs::read_to_string(place.join("inner/c.py")).unwrap(), "inner/c.py");
        assert!(!place.join("b.so").exists() && !place.join("inner/__pycache__").exists());
        assert!(only_entry(&place.join("inner")).is_ok());
        assert!(only_entry(&place).unwrap_err().to_string().contains("2 files"));
    }
}
