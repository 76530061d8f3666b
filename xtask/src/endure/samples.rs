//! A sample of every kind of file that the command reads, and the commands that read it.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};

use super::trial::Swm;
use crate::process;

/// A file or folder to damage.
pub(crate) struct Sample {
    pub(crate) kind: String,
    /// It lies in a folder of its own, which is copied for each thread.
    pub(crate) folder: PathBuf,
    /// Below which files are damaged, in this folder.
    pub(crate) name: String,
    /// Commands on it; `IN` is where it is.
    pub(crate) commands: Vec<String>,
}

/// Formats that are recorded, by extension.
const RECORDED: &[&str] = &["h5", "folder", "video", "mcap", "lerobot"];

/// Makes all of them, below `folder`.
pub(crate) fn all(swm: &Swm, folder: &Path) -> Result<Vec<Sample>> {
    let mut samples = Vec::new();
    recorded(swm, folder, &mut samples)?;
    foreign(folder, &mut samples)?;
    results(swm, folder, &mut samples)?;
    if swm.has_baselines {
        runs(swm, folder, &mut samples)?;
        checkpoints(folder, &mut samples)?;
    } else {
        eprintln!("runs and published checkpoints: left out, as the program was built without baselines");
    }
    Ok(samples)
}

/// A folder of its own for a sample.
fn make(folder: &Path, kind: &str) -> Result<PathBuf> {
    let folder = folder.join(kind.replace([' ', ',', '/'], "-"));
    fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(folder)
}

fn push(samples: &mut Vec<Sample>, kind: &str, folder: PathBuf, name: &str, commands: &[&str]) {
    let commands = commands.iter().map(|&line| line.to_owned()).collect();
    samples.push(Sample { kind: kind.to_owned(), folder, name: name.to_owned(), commands });
}

/// Datasets in the built-in formats, and the statistics that lie beside one.
fn recorded(swm: &Swm, folder: &Path, samples: &mut Vec<Sample>) -> Result<()> {
    let record = "collect swm/TwoRoom-v2 --policy expert --seed 1 --max-steps 8 --image-size 24x24 --episodes 2 -q --out";
    for extension in RECORDED.iter().filter(|&&extension| extension != "lerobot" || swm.has_lerobot) {
        let kind = format!("dataset, {extension}");
        let folder = make(folder, &kind)?;
        let name = format!("a.{extension}");
        swm.ok(&folder, &format!("{record} {name}"))?;
        push(samples, &kind, folder, &name, &["verify IN -q"]);
    }
    let folder = make(folder, "statistics")?;
    swm.ok(&folder, &format!("{record} a.h5"))?;
    swm.ok(&folder, "stats a.h5 -q")?;
    let beside = |name: &String| name != "a.h5" && name.starts_with("a.h5");
    let name = names(&folder)?.into_iter().find(beside).context("`stats` stored nothing beside a.h5")?;
    push(samples, "statistics", folder, &name, &["stats a.h5 -q"]);
    Ok(())
}

/// Datasets of other programs, from the fixtures of the tests: NumPy archives, Zarr, HDF5 with groups, folders of DINO-WM, LeRobot.
fn foreign(folder: &Path, samples: &mut Vec<Sample>) -> Result<()> {
    let golden = process::root().join("tests/golden/field");
    for name in names(&golden)? {
        let is_note = Path::new(&name).extension().is_some_and(|ending| ending == "json" || ending == "py");
        // Those of LeRobot are large, and as ours.
        if is_note || name.starts_with("lerobot") {
            continue;
        }
        let kind = format!("foreign, {name}");
        let folder = make(folder, &kind)?;
        copy(&golden.join(&name), &folder.join(&name))?;
        // Some have a description beside them.
        let beside = format!("{}.json", name.trim_end_matches(".h5"));
        if golden.join(&beside).is_file() {
            copy(&golden.join(&beside), &folder.join(&beside))?;
        }
        // Chunks that are not there are NaN in it, which `verify` reports.
        let command = if name == "codecs3.zarr" { "diff IN IN -q" } else { "verify IN -q" };
        push(samples, &kind, folder, &name, &[command]);
    }
    Ok(())
}

/// Manifests, receipts, sweeps, bundles, jobs.
fn results(swm: &Swm, folder: &Path, samples: &mut Vec<Sample>) -> Result<()> {
    for name in ["m.json", "m.toml"] {
        let kind = format!("manifest, {name}");
        let folder = make(folder, &kind)?;
        swm.ok(&folder, &format!("manifest make swm/TwoRoom-v2 --episodes 4 --budget 6 --out {name} -q"))?;
        push(
            samples,
            &kind,
            folder,
            name,
            &["manifest show IN", "eval --manifest IN --policy random --reference none -q"],
        );
    }
    let task = make(folder, "task")?;
    swm.ok(&task, "manifest make swm/TwoRoom-v2 --episodes 4 --budget 6 --out m.json -q")?;
    let manifest = task.join("m.json");
    let manifest = manifest.display();

    let made = make(folder, "result")?;
    let eval = format!("eval --manifest {manifest} --policy random --reference no-op -q --out");
    swm.ok(&made, &format!("{eval} r"))?;
    let report = "report IN --videos 0 --plans 0 --overwrite --out page.html -q";
    push(samples, "result", made, "r", &["compare IN IN", report]);

    let made = make(folder, "sweep")?;
    let sweep = "--factors agent.color --values grid --points 2 -q --out";
    swm.ok(&made, &format!("sweep --manifest {manifest} --policy random {sweep} s"))?;
    push(samples, "sweep", made, "s", &[report]);

    let made = make(folder, "bundle")?;
    swm.ok(&made, &format!("{eval} r"))?;
    swm.ok(&made, "bundle r --out b -q")?;
    push(samples, "bundle", made, "b", &["verify-result IN -q", "board IN --out board -q"]);

    let made = make(folder, "job")?;
    let submit = "submit --on script --no-copy --shards 2 --job j -- collect swm/TwoRoom-v2 --policy expert --max-steps 6";
    swm.ok(&made, &format!("{submit} --image-size none --episodes 4"))?;
    for line in ["task j --index 1 -q", "task j --index 2 -q"] {
        swm.ok(&made, line)?;
    }
    push(samples, "job", made, "j", &["jobs IN", "task IN --index 1 -q", "task IN --finish -q"]);
    Ok(())
}

/// Training runs.
fn runs(swm: &Swm, folder: &Path, samples: &mut Vec<Sample>) -> Result<()> {
    let record = "collect swm/TwoRoom-v2 --policy expert --seed 1 --max-steps 20 --image-size 32x32 --episodes 12 -q --out d.h5";
    for (baseline, policy) in [("lewm", "mpc"), ("gcbc", "gcbc")] {
        let kind = format!("run, {baseline}");
        let made = make(folder, &kind)?;
        swm.ok(&made, record)?;
        let train = format!(
            "train {baseline} --preset small --dataset d.h5 --steps 2 --batch 2 --threads 2 -q --out r"
        );
        swm.ok(&made, &train)?;
        let search = if policy == "mpc" {
            ",samples=4,elites=2,iterations=1,horizon=2,receding_horizon=1"
        } else {
            ""
        };
        let act = format!("eval swm/TwoRoom-v2 --policy {policy}:IN{search} --episodes 1 --budget 2 -q");
        push(
            samples,
            &kind,
            made,
            "r",
            &["checkpoints IN", &act, "train --resume IN --steps 3 --threads 2 -q"],
        );
    }
    Ok(())
}

/// Published checkpoints that cannot be imported without these options.
const IMPORTED_WITH: &[(&str, &str)] = &[
    ("dino_wm", "--encoder IN/backbone.pth --set encoder.heads=2 --set predictor.heads=2"),
    ("gcivl_policy", "--as gcivl --set model.encoder.heads=2"),
    ("hilp_policy", "--as hilp --set model.encoder.heads=2"),
    ("lewm_trainer", "--weights last.ckpt"),
];
/// Folders of the fixtures without weights of their own.
const WITHOUT_WEIGHTS: &[&str] = &["bad", "tdmpc2_pixels"];

/// Published checkpoints, from the fixtures of the tests.
fn checkpoints(folder: &Path, samples: &mut Vec<Sample>) -> Result<()> {
    let golden = process::root().join("tests/golden/checkpoints");
    for name in names(&golden)?.into_iter().filter(|name| !WITHOUT_WEIGHTS.contains(&name.as_str())) {
        let kind = format!("checkpoint, {name}");
        let made = make(folder, &kind)?;
        copy(&golden.join(&name), &made.join(&name))?;
        let options = IMPORTED_WITH.iter().find(|(with, _)| *with == name).map_or("", |(_, options)| options);
        push(samples, &kind, made, &name, &[&format!("import --check IN {options} -q")]);
    }
    Ok(())
}

/// Names of what is in a folder, sorted.
pub(crate) fn names(folder: &Path) -> Result<Vec<String>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?;
    let name = |entry: std::io::Result<fs::DirEntry>| -> Result<String> {
        Ok(entry?.file_name().to_string_lossy().into_owned())
    };
    let names = entries.map(name);
    let mut names = names.collect::<Result<Vec<_>>>()?;
    names.sort();
    Ok(names)
}

/// All files of a sample.
pub(crate) fn files(path: &Path) -> Result<Vec<PathBuf>> {
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let mut found = Vec::new();
    for name in names(path)? {
        found.extend(files(&path.join(name))?);
    }
    Ok(found)
}

/// Copies a file or a folder.
pub(crate) fn copy(from: &Path, to: &Path) -> Result<()> {
    if from.is_dir() {
        fs::create_dir_all(to)?;
        return names(from)?.iter().try_for_each(|name| copy(&from.join(name), &to.join(name)));
    }
    fs::copy(from, to).map(drop).with_context(|| format!("cannot copy {}", from.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_copied_with_all_their_files() {
        let folder = tempfile::tempdir().unwrap();
        let from = folder.path().join("from");
        fs::create_dir_all(from.join("b")).unwrap();
        fs::write(from.join("a"), "1").unwrap();
        fs::write(from.join("b/c"), "2").unwrap();
        let to = folder.path().join("to");
        copy(&from, &to).unwrap();
        assert_eq!(files(&to).unwrap(), [to.join("a"), to.join("b/c")]);
        assert_eq!(fs::read(to.join("b/c")).unwrap(), b"2");
    }
}
