//! `cargo xtask datasets`: the standard datasets, recorded whole or in parts, with a page and checksums.
//!
//! What they are stands in `recipes/datasets.toml`; how an episode is recorded is `swm collect`'s business.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use sha2::{Digest as _, Sha256};

use crate::{process, setup};

/// Options of `cargo xtask datasets`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Which ones; default: all
    names: Vec<String>,
    /// The folder to write into
    #[arg(long, default_value = "datasets", value_name = "DIR")]
    out: PathBuf,
    /// Record the I-th of N parts, on one of N machines; `--merge N` joins them
    #[arg(long, value_name = "I/N", conflicts_with_all = ["merge", "verify", "list"])]
    shard: Option<String>,
    /// Join N parts that lie in the folder; the result is that of an undivided run
    #[arg(long, value_name = "N", conflicts_with_all = ["verify", "list"])]
    merge: Option<u64>,
    /// Record each as a job of `swm submit` on ENGINE[:KEY=VALUE,…], in `NAME.job`. Again: submits what is missing, and takes over
    /// the results that are there
    #[arg(long, value_name = "ENGINE", requires = "shards", conflicts_with_all = ["shard", "merge", "verify", "list"])]
    submit: Option<String>,
    /// With --submit: divide each into N shards
    #[arg(long, value_name = "N", requires = "submit")]
    shards: Option<u64>,
    /// Record so many episodes of each, instead of the recipe's number
    #[arg(long, value_name = "N")]
    episodes: Option<u64>,
    /// Compare what is in the folder with its manifest, and look through every file
    #[arg(long, conflicts_with = "list")]
    verify: bool,
    /// List the recipes and stop
    #[arg(long)]
    list: bool,
    /// Use the development build
    #[arg(long)]
    dev: bool,
}

/// One dataset.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Recipe {
    about: String,
    env: String,
    episodes: u64,
    /// Further arguments of `swm collect`.
    collect: String,
}

/// What lies in the folder: file names with size and SHA-256.
#[derive(Debug, Default, PartialEq, Serialize, Deserialize)]
struct Manifest {
    files: BTreeMap<String, File>,
}

#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct File {
    bytes: u64,
    sha256: String,
}

const MANIFEST: &str = "manifest.json";

/// Records, joins or verifies.
pub(crate) fn run(args: &Args) -> Result<()> {
    let recipes = recipes()?;
    let chosen = choose(&recipes, &args.names)?;
    if args.list {
        for (name, recipe) in chosen {
            println!("{name:20} {:6} episodes of {}: {}", recipe.episodes, recipe.env, recipe.about);
        }
        return Ok(());
    }
    setup::run(&setup::Args::default())?;
    let swm = Swm { profile: if args.dev { &[] } else { &["--release"] } };
    fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    let out = std::path::absolute(&args.out)?;
    if args.verify {
        return verify(&swm, &out);
    }
    for (name, recipe) in chosen {
        let recipe = Recipe { episodes: args.episodes.unwrap_or(recipe.episodes), ..recipe.clone() };
        if let Some(shard) = &args.shard {
            record(&swm, &recipe, &part(&out, name, shard)?, Some(shard))?;
            continue;
        }
        let file = out.join(format!("{name}.h5"));
        if let (Some(engine), Some(shards)) = (&args.submit, args.shards)
            && !submit(&swm, &recipe, &out.join(format!("{name}.job")), engine, shards, &file)?
        {
            continue;
        }
        match args.merge {
            None if args.submit.is_some() => {}
            Some(count) => merge(&swm, &out, name, count, &file)?,
            None => record(&swm, &recipe, &file, None)?,
        }
        write_card(&swm, &out, name, &recipe, &file)?;
        add_to_manifest(&out, &file)?;
    }
    Ok(())
}

fn recipes() -> Result<BTreeMap<String, Recipe>> {
    toml::from_str(include_str!("../recipes/datasets.toml")).context("recipes/datasets.toml")
}

fn choose<'a>(
    recipes: &'a BTreeMap<String, Recipe>,
    names: &[String],
) -> Result<Vec<(&'a String, &'a Recipe)>> {
    if names.is_empty() {
        return Ok(recipes.iter().collect());
    }
    let find = |name| {
        let known = || recipes.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
        recipes
            .get_key_value(name)
            .with_context(|| format!("there is no recipe `{name}`; there are: {}", known()))
    };
    names.iter().map(find).collect()
}

/// The command `swm` of this checkout.
struct Swm {
    profile: &'static [&'static str],
}

impl Swm {
    fn run(&self, args: &[&str]) -> Result<Json> {
        let mut command = process::cargo(["run", "--quiet", "--package", "swm", "--bin", "swm"]);
        command.args(self.profile).args(["--", "--json", "--quiet"]).args(args);
        eprintln!("swm {}", args.join(" "));
        let printed = process::output(&mut command)?;
        serde_json::from_slice(&printed).with_context(|| format!("`swm {}` printed no JSON", args.join(" ")))
    }
}

/// Records, or goes on where it was interrupted.
fn record(swm: &Swm, recipe: &Recipe, file: &Path, shard: Option<&str>) -> Result<()> {
    let (total, file) = (recipe.episodes.to_string(), text(file)?);
    let mut args = vec!["collect", &recipe.env, "--total", &total, "--mode", "append", "--out", file];
    args.extend(recipe.collect.split_whitespace());
    args.extend(shard.iter().flat_map(|shard| ["--shard", *shard]));
    let said = swm.run(&args)?;
    println!("{file}: {} episodes", said["total_episodes"]);
    Ok(())
}

/// Submits what is missing of a recording. Once its result is there, it becomes `file`, and the answer is `true`.
fn submit(swm: &Swm, recipe: &Recipe, job: &Path, engine: &str, shards: u64, file: &Path) -> Result<bool> {
    let result = job.join("result.h5");
    if file.is_file() && !result.is_file() {
        println!("{}: there already", file.display());
        return Ok(false);
    }
    if job.join("finished.json").is_file() {
        // The parts stay until a person removes the folder.
        fs::rename(&result, file).with_context(|| format!("cannot move {}", result.display()))?;
        return Ok(true);
    }
    let (shards, episodes) = (shards.min(recipe.episodes).to_string(), recipe.episodes.to_string());
    let mut args = vec!["submit", "--on", engine, "--shards", &shards, "--job", text(job)?, "--"];
    args.extend(["collect", &recipe.env, "--total", &episodes]);
    args.extend(recipe.collect.split_whitespace());
    let said = swm.run(&args)?;
    match said["script"].as_str() {
        Some(script) if engine == "script" => print!("{script}"),
        _ => println!(
            "{}: {} done, {} queued now",
            job.display(),
            said["done"],
            said["submitted"].as_array().map_or(0, Vec::len)
        ),
    }
    Ok(false)
}

/// Where part `3/16` of a dataset lies.
fn part(out: &Path, name: &str, shard: &str) -> Result<PathBuf> {
    let (index, count) =
        shard.split_once('/').with_context(|| format!("write I/N for --shard, not `{shard}`"))?;
    Ok(out.join(format!("{name}.{index}-of-{count}.h5")))
}

fn merge(swm: &Swm, out: &Path, name: &str, count: u64, file: &Path) -> Result<()> {
    let parts = (1..=count).map(|index| part(out, name, &format!("{index}/{count}")));
    let parts = parts.collect::<Result<Vec<_>>>()?;
    let missing: Vec<_> =
        parts.iter().filter(|part| !part.is_file()).map(|part| part.display().to_string()).collect();
    ensure!(missing.is_empty(), "parts are missing: {}", missing.join(", "));
    if count == 1 {
        fs::copy(&parts[0], file)?;
        return Ok(());
    }
    let mut args = vec!["merge"];
    for part in &parts {
        args.push(text(part)?);
    }
    args.extend(["--out", text(file)?]);
    swm.run(&args).map(drop)
}

/// The page of a dataset: what it is, its columns, images, statistics.
fn write_card(swm: &Swm, out: &Path, name: &str, recipe: &Recipe, file: &Path) -> Result<()> {
    let image = out.join(format!("{name}.png"));
    swm.run(&["preview", text(file)?, "--out", text(&image)?])?;
    let about = swm.run(&["inspect", text(file)?])?;
    let statistics = swm.run(&["stats", text(file)?, "--columns", "action"])?;
    let card = out.join(format!("{name}.md"));
    fs::write(&card, card_text(name, recipe, &about, &statistics))
        .with_context(|| format!("cannot write {}", card.display()))
}

fn card_text(name: &str, recipe: &Recipe, about: &Json, statistics: &Json) -> String {
    let mut text = format!(
        "# {name}\n\n{}.\n\n![the first episodes](./{name}.png)\n\n{} episodes of {} to {} steps, {} steps.\n\n```sh\nswm collect {} \
         --episodes {} {} --out {name}.h5\n```\n\n| column | type | shape |\n|---|---|---|\n",
        recipe.about,
        about["episodes"],
        about["episode_lengths"]["min"],
        about["episode_lengths"]["max"],
        about["steps"],
        recipe.env,
        recipe.episodes,
        recipe.collect,
    );
    for (column, field) in about["columns"].as_object().into_iter().flatten() {
        let kind = field["dtype"].as_str().unwrap_or_default();
        text += &format!("| `{column}` | {kind} | {} |\n", field["shape"]);
    }
    text + &format!("\nStatistics of the actions:\n\n```json\n{statistics:#}\n```\n")
}

fn add_to_manifest(out: &Path, file: &Path) -> Result<()> {
    let path = out.join(MANIFEST);
    let mut manifest: Manifest = match fs::read(&path) {
        Ok(bytes) => {
            serde_json::from_slice(&bytes).with_context(|| format!("{} is damaged", path.display()))?
        }
        Err(_) => Manifest::default(),
    };
    manifest.files.insert(file_name(file), checksum(file)?);
    // Under another name first: an interruption leaves the old one or the new one.
    let new = out.join("manifest.json.new");
    fs::write(&new, serde_json::to_vec_pretty(&manifest)?)?;
    fs::rename(&new, &path).with_context(|| format!("cannot write {}", path.display()))
}

fn verify(swm: &Swm, out: &Path) -> Result<()> {
    let path = out.join(MANIFEST);
    let bytes = fs::read(&path).with_context(|| format!("no manifest: {}", path.display()))?;
    let manifest: Manifest = serde_json::from_slice(&bytes).context("the manifest is damaged")?;
    let mut wrong = Vec::new();
    for (name, expected) in &manifest.files {
        let file = out.join(name);
        match checksum(&file) {
            Ok(found) if found == *expected => {
                swm.run(&["verify", text(&file)?])?;
                println!("{name}: as recorded");
            }
            Ok(_) => wrong.push(format!("{name} differs from the manifest")),
            Err(error) => wrong.push(format!("{name}: {error:#}")),
        }
    }
    if wrong.is_empty() { Ok(()) } else { bail!("{}", wrong.join("; ")) }
}

fn checksum(path: &Path) -> Result<File> {
    let mut file = fs::File::open(path).with_context(|| format!("cannot open {}", path.display()))?;
    let (mut hash, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 1 << 20]);
    loop {
        match file.read(&mut buffer)? {
            0 => break,
            count => {
                hash.update(&buffer[..count]);
                bytes += count as u64;
            }
        }
    }
    let sha256 = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    Ok(File { bytes, sha256 })
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn text(path: &Path) -> Result<&str> {
    path.to_str().with_context(|| format!("{} is not UTF-8", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_recipe_says_what_it_is_and_has_its_own_seed() {
        let recipes = recipes().unwrap();
        let mut seeds: Vec<&str> = Vec::new();
        for (name, recipe) in &recipes {
            assert!(
                recipe.episodes > 0 && !recipe.about.is_empty() && recipe.env.starts_with("swm/"),
                "{name}"
            );
            let words: Vec<_> = recipe.collect.split_whitespace().collect();
            let seed = words.windows(2).find(|pair| pair[0] == "--seed").expect("a seed")[1];
            assert!(!seeds.contains(&seed), "{name}: seed {seed} is taken");
            seeds.push(seed);
        }
        assert!(seeds.len() >= 16);
    }

    #[test]
    fn unknown_names_are_answered_with_the_known() {
        let recipes = recipes().unwrap();
        let message = choose(&recipes, &["pusht".to_owned()]).unwrap_err().to_string();
        assert!(message.contains("`pusht`") && message.contains("pusht-expert"), "{message}");
    }

    #[test]
    fn a_manifest_tells_a_changed_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.h5");
        fs::write(&file, b"one").unwrap();
        add_to_manifest(folder.path(), &file).unwrap();
        let manifest: Manifest =
            serde_json::from_slice(&fs::read(folder.path().join(MANIFEST)).unwrap()).unwrap();
        assert_eq!(manifest.files["a.h5"], checksum(&file).unwrap());
        assert_eq!(manifest.files["a.h5"].bytes, 3);
        fs::write(&file, b"two").unwrap();
        assert_ne!(manifest.files["a.h5"], checksum(&file).unwrap());
    }
}
