//! `cargo xtask zoo`: trained models that are shipped. A recipe in `zoo/recipes` is data: commands of `swm`, the last of which evaluates. The result
//! is bundled, and the recipe put beside it, in the bundle's list of hashes. The models that were made become a package for Python and an archive.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::Deserialize;

use crate::metadata::Metadata;
use crate::program::Program;
use crate::setup::wheel::{create_folder, sha256};
use crate::{interop, process, recipes};

/// Options of `cargo xtask zoo`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The models to train and pack; without names: list recipes, and what is made
    names: Vec<String>,
    /// Pack what is made as the Python package stable-worldmodel-zoo and as an archive
    #[arg(long)]
    pack: bool,
    /// The folder of the models; default: `zoo` in cargo's build directory. One that is there already is not made again
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// A command `swm` with baselines; else one is built
    #[arg(long, value_name = "FILE")]
    swm: Option<PathBuf>,
}

/// What `swm_tasks::zoo::Recipe` reads.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Recipe {
    about: String,
    license: String,
    steps: Vec<String>,
    result: String,
}

/// Where recipes are, below the root.
const RECIPES: &str = "zoo/recipes";
/// The Python package, below the folder `zoo`, and the name that pip knows it by.
const PACKAGE: &str = "stable_worldmodel_zoo";
const DISTRIBUTION: &str = "stable-worldmodel-zoo";
const RECIPE: &str = "recipe.toml";
const SUMS: &str = "SHA256SUMS";

pub(crate) fn run(args: &Args) -> Result<()> {
    let recipes = all()?;
    let out = match &args.out {
        Some(out) => std::path::absolute(out)?,
        None => Metadata::load()?.target_directory.join("zoo"),
    };
    for name in &args.names {
        let known: Vec<&str> = recipes.iter().map(|(known, _)| known.as_str()).collect();
        ensure!(known.contains(&name.as_str()), "`{name}`: there are recipes for {}", known.join(", "));
    }
    let program =
        Program { given: args.swm.as_deref(), features: "cli,faer,baselines,mp4,mujoco,rapier,lerobot,onnx" };
    if !args.names.is_empty() {
        program.build()?;
    }
    for name in &args.names {
        make(name, &program, &out)?;
    }
    if args.pack {
        return pack(&out);
    }
    for (name, recipe) in &recipes {
        let state = if out.join(name).is_dir() { "made" } else { "not made" };
        println!("{name:<16} {state:<9} {}", recipe.about);
    }
    println!("\nmodels go to {}; SWM_ZOO={0} finds them there", out.display());
    Ok(())
}

/// All recipes, by name.
fn all() -> Result<Vec<(String, Recipe)>> {
    recipes::read_all(&process::root().join(RECIPES))
}

/// Follows a recipe in a folder beside the models, and bundles its result. What steps have made already, they continue or refuse: the folder is made anew.
fn make(name: &str, program: &Program<'_>, out: &Path) -> Result<()> {
    let place = out.join(name);
    if place.is_dir() {
        println!("{} is there already; remove it to make it again", place.display());
        return Ok(());
    }
    let file = process::root().join(RECIPES).join(format!("{name}.toml"));
    let recipe: Recipe = recipes::read(&file)?;
    let work = out.join(format!(".{name}"));
    if work.exists() {
        fs::remove_dir_all(&work).with_context(|| format!("{} cannot be removed", work.display()))?;
    }
    create_folder(&work)?;
    for step in &recipe.steps {
        let words: Vec<&str> = step.split_whitespace().collect();
        program.run_in(&work, &words)?;
    }
    let bundle = work.join(name);
    let words = ["bundle", &recipe.result, "--out", name, "--license", &recipe.license];
    program.run_in(&work, &words)?;
    add_recipe(&bundle, &file)?;
    let checked = program.run_in(&work, &["verify-result", name])?;
    eprintln!("verified: {checked}");
    fs::rename(&bundle, &place).with_context(|| format!("{} cannot be written", place.display()))?;
    fs::remove_dir_all(&work).with_context(|| format!("{} cannot be removed", work.display()))?;
    println!("{}: {:.1} MB", place.display(), size(&place)? as f64 / 1e6);
    Ok(())
}

/// Puts the recipe into the bundle and its list of hashes.
fn add_recipe(bundle: &Path, recipe: &Path) -> Result<()> {
    let copy = bundle.join(RECIPE);
    fs::copy(recipe, &copy).with_context(|| format!("{} cannot be written", copy.display()))?;
    let list = bundle.join(SUMS);
    let text = fs::read_to_string(&list).with_context(|| format!("{} cannot be read", list.display()))?;
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    lines.push(format!("{}  {RECIPE}", sha256(&copy)?));
    lines.sort_by(|a, b| {
        a.split_once("  ").map(|(_, path)| path).cmp(&b.split_once("  ").map(|(_, path)| path))
    });
    fs::write(&list, lines.join("\n") + "\n").with_context(|| format!("{} cannot be written", list.display()))
}

/// The package for Python and the archive, beside the models.
fn pack(out: &Path) -> Result<()> {
    let names = made(out)?;
    ensure!(!names.is_empty(), "no model is made in {}; make one: cargo xtask zoo NAME", out.display());
    let version = env!("CARGO_PKG_VERSION");
    let wheel = wheel(out, &names, version)?;
    let archive = out.join(format!("{DISTRIBUTION}-{version}.tar.gz"));
    let file =
        fs::File::create(&archive).with_context(|| format!("{} cannot be written", archive.display()))?;
    let mut tar = tar::Builder::new(GzEncoder::new(file, Compression::best()));
    tar.mode(tar::HeaderMode::Deterministic);
    for name in &names {
        tar.append_dir_all(Path::new("zoo").join(name), out.join(name))?;
    }
    tar.into_inner()?.finish()?;
    for path in [&wheel, &archive] {
        println!("{} ({:.1} MB): {}", path.display(), size_of(path)? as f64 / 1e6, names.join(", "));
    }
    println!("unpack the archive in the data folder ($SWM_HOME), or `pip install` the wheel");
    Ok(())
}

/// The models in a folder, by name.
fn made(out: &Path) -> Result<Vec<String>> {
    let mut names = Vec::new();
    for entry in fs::read_dir(out).into_iter().flatten() {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if entry.path().join(RECIPE).is_file() && !name.starts_with('.') {
            names.push(name);
        }
    }
    names.sort();
    Ok(names)
}

/// A wheel of files alone, for every Python.
fn wheel(out: &Path, names: &[String], version: &str) -> Result<PathBuf> {
    let work = tempfile::tempdir().context("no folder to make a wheel in")?;
    let tree = work.path().join("tree");
    let package = tree.join(PACKAGE);
    create_folder(&package)?;
    let source = process::root().join("zoo").join(PACKAGE);
    for file in ["__init__.py", "py.typed"] {
        fs::copy(source.join(file), package.join(file))
            .with_context(|| format!("{file} cannot be copied"))?;
    }
    for name in names {
        copy(&out.join(name), &package.join("models").join(name))?;
    }
    let about = tree.join(format!("{PACKAGE}-{version}.dist-info"));
    create_folder(&about)?;
    fs::write(about.join("METADATA"), metadata(out, names, version)?)?;
    fs::write(
        about.join("WHEEL"),
        "Wheel-Version: 1.0\nGenerator: xtask\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    )?;
    fs::write(about.join("RECORD"), "")?;
    let mut pack = Command::new(interop::python(&interop::WHEEL_BUILD)?);
    process::output(pack.args(["-m", "wheel", "pack", "--dest-dir"]).arg(out).arg(&tree))?;
    Ok(out.join(format!("{PACKAGE}-{version}-py3-none-any.whl")))
}

/// What pip reads: with the licenses of all models, and what they are.
fn metadata(out: &Path, names: &[String], version: &str) -> Result<String> {
    let (mut licenses, mut list) = (Vec::new(), String::new());
    for name in names {
        let recipe: Recipe = recipes::read(&out.join(name).join(RECIPE))?;
        list += &format!("- `zoo:{name}`: {} ({})\n", recipe.about, recipe.license);
        licenses.push(recipe.license);
    }
    licenses.sort();
    licenses.dedup();
    Ok(format!(
        "Metadata-Version: 2.4\nName: {DISTRIBUTION}\nVersion: {version}\nSummary: Trained models of stable-worldmodel for Rust\n\
         License-Expression: {}\nRequires-Python: >=3.10\nDescription-Content-Type: text/markdown\n\n\
         Trained models of stable-worldmodel for Rust, each with its card, its receipt and the commands that made it: `swm-rs zoo` lists them, \
         `swm.zoo.load(NAME)` loads one.\n\n{list}",
        licenses.join(" AND ")
    ))
}

fn copy(from: &Path, to: &Path) -> Result<()> {
    create_folder(to)?;
    for entry in fs::read_dir(from).with_context(|| format!("{} cannot be read", from.display()))? {
        let (path, name) = entry.map(|entry| (entry.path(), entry.file_name()))?;
        match path.is_dir() {
            true => copy(&path, &to.join(name))?,
            false => {
                fs::copy(&path, to.join(name)).with_context(|| format!("{}", path.display()))?;
            }
        }
    }
    Ok(())
}

fn size_of(path: &Path) -> Result<u64> {
    Ok(fs::metadata(path).with_context(|| format!("{} cannot be read", path.display()))?.len())
}

/// Bytes of all files below a folder.
fn size(folder: &Path) -> Result<u64> {
    let mut bytes = 0;
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        bytes += if path.is_dir() { size(&path)? } else { size_of(&path)? };
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recipes_end_with_the_evaluation_that_is_bundled() {
        let recipes = all().unwrap();
        assert!(recipes.len() > 1);
        for (name, Recipe { about, license, steps, result }) in recipes {
            let last: Vec<&str> = steps.last().unwrap().split_whitespace().collect();
            assert!(last[0] == "eval" && last.ends_with(&["--out", &result]), "{name}: {last:?}");
            assert!(
                last.contains(&"--manifest") && steps.iter().any(|step| step.starts_with("train ")),
                "{name}"
            );
            assert!(!about.is_empty() && license == "MIT OR Apache-2.0", "{name}");
        }
    }

    #[test]
    fn the_recipe_is_in_the_list_of_hashes() {
        let folder = tempfile::tempdir().unwrap();
        let bundle = folder.path().join("bundle");
        fs::create_dir(&bundle).unwrap();
        fs::write(bundle.join(SUMS), format!("{0}  a\n{0}  z\n", "0".repeat(64))).unwrap();
        let recipe = folder.path().join("a.toml");
        fs::write(&recipe, "about = 'a'\nlicense = 'MIT'\nsteps = []\nresult = 'r'\n").unwrap();
        add_recipe(&bundle, &recipe).unwrap();
        let list = fs::read_to_string(bundle.join(SUMS)).unwrap();
        let paths: Vec<&str> = list.lines().filter_map(|line| Some(line.split_once("  ")?.1)).collect();
        assert_eq!(paths, ["a", RECIPE, "z"]);
        assert!(list.contains(&sha256(&recipe).unwrap()));

        fs::rename(&bundle, folder.path().join("model")).unwrap();
        assert_eq!(made(folder.path()).unwrap(), ["model"]);
        let about = metadata(folder.path(), &["model".to_owned()], "1.2.3").unwrap();
        assert!(about.contains("Version: 1.2.3\n") && about.contains("License-Expression: MIT\n"), "{about}");
    }
}
