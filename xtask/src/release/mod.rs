//! `cargo xtask release`: everything between a good state of the workspace and a release, as a table of steps. Without
//! `--execute` it changes nothing that cannot be undone. For people: docs/RELEASING.md.

mod archives;
mod packages;
mod parts;
mod program;
mod publish;
mod version;

use std::path::PathBuf;

use anyhow::{Context as _, Result, ensure};
use semver::Version;

use crate::metadata::Metadata;
use crate::{deny, process, separate_crates, setup};

/// Options of `cargo xtask release`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Tag and publish after the checks, which cannot be undone; without it, print what would be done
    #[arg(long)]
    execute: bool,
    /// Write a new version into the manifests, and its heading into CHANGELOG.md; then stop
    #[arg(long, value_name = "VERSION", conflicts_with_all = ["execute", "out", "dev", "published"])]
    bump: Option<Version>,
    /// Pack the program of the tests, for a quick rehearsal; the archive has it in its name
    #[arg(long, conflicts_with = "execute")]
    dev: bool,
    /// The folder for archives, bill of materials and checksums; default: `release-files` in cargo's build directory
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Continue a publication that failed half-way: these crates are on the registry already
    #[arg(long, value_name = "CRATE,…", value_delimiter = ',', requires = "execute")]
    published: Vec<String>,
}

/// What the steps work on.
struct Release {
    metadata: Metadata,
    version: Version,
    is_dev: bool,
    is_dry: bool,
    published: Vec<String>,
    /// Where archives go.
    out: PathBuf,
}

/// What it returns is printed behind its name.
type Step = fn(&Release) -> Result<String>;

const STEPS: &[(&str, Step)] = &[
    ("version", one_version),
    ("changelog", dated_section),
    ("checkout", clean_checkout),
    ("manifests", manifests),
    ("licenses", licenses),
    ("semver", semver),
    ("packages", packaged_files),
    ("source", source_archive),
    ("program", program::archive),
    ("checksums", checksums),
    ("publish", publication),
];

/// Runs the steps; the first that fails ends the run.
pub(crate) fn run(args: &Args) -> Result<()> {
    let metadata = Metadata::load()?;
    let version = version::current(&metadata)?;
    if let Some(new) = &args.bump {
        version::bump(&version, new)?;
        println!("the version is {new} now: look at `git diff`, run `cargo xtask nightly`, and commit");
        return Ok(());
    }
    let out = args.out.clone().unwrap_or_else(|| metadata.target_directory.join("release-files"));
    let (out, is_dry, published) = (std::path::absolute(out)?, !args.execute, args.published.clone());
    setup::wheel::create_folder(&out)?;
    let release = Release { metadata, version, is_dev: args.dev, is_dry, published, out };
    for (name, step) in STEPS {
        println!("{name:<10} {}", step(&release).with_context(|| format!("release: {name}"))?);
    }
    Ok(())
}

/// A dry run with the program of the tests: a step of `cargo xtask nightly`.
pub(crate) fn rehearse() -> Result<()> {
    run(&Args { dev: true, ..Args::default() })
}

fn one_version(release: &Release) -> Result<String> {
    version::check(&release.version, &release.metadata)?;
    Ok(format!("{} everywhere", release.version))
}

fn dated_section(release: &Release) -> Result<String> {
    let date = version::date(&release.version)?;
    let advice = format!("{0} has no section yet: `cargo xtask release --bump {0}`", release.version);
    ensure!(date.is_some() || release.is_dry, "{advice}");
    Ok(date.unwrap_or(advice))
}

fn clean_checkout(release: &Release) -> Result<String> {
    match publish::check_checkout(&release.version) {
        Ok(()) => Ok("committed, and not tagged otherwise".into()),
        Err(error) if release.is_dry => Ok(format!("`--execute` would refuse it: {error:#}")),
        Err(error) => Err(error),
    }
}

fn manifests(release: &Release) -> Result<String> {
    let crates = packages::published(&release.metadata);
    let faults: Vec<String> = crates.iter().flat_map(|package| packages::faults(package)).collect();
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(format!("{} crates are described in full", crates.len()))
}

/// Known vulnerabilities stand in a database on the network, which only a real release asks.
fn licenses(release: &Release) -> Result<String> {
    deny::run(&deny::Args { advisories: !release.is_dry })?;
    let said =
        if release.is_dry { "allowed; `--execute` asks for advisories" } else { "allowed, no advisories" };
    Ok(said.into())
}

fn semver(release: &Release) -> Result<String> {
    let Some(tag) = publish::last_tag(&release.version)? else {
        return Ok("no earlier release, nothing to compare".into());
    };
    if !process::has_cargo_command("semver-checks") {
        let install = "`cargo install --locked cargo-semver-checks`";
        ensure!(release.is_dry, "comparing with {tag} needs cargo-semver-checks: {install}");
        return Ok(format!("NOT compared with {tag}: {install}"));
    }
    // Of all crates: those on Lance need its compiler of protocols.
    let mut check = process::cargo(["semver-checks", "--workspace", "--baseline-rev", &tag]);
    process::run(check.envs(setup::tools::protoc()))?;
    Ok(format!("compatible with {tag}, or a breaking version"))
}

/// Builds everything from the packaged files, in the profile of tests.
fn packaged_files(release: &Release) -> Result<String> {
    let metadata = &release.metadata;
    let count = packages::make(metadata, release.is_dry)?;
    let features: Vec<String> = program::DEV_FEATURES.split(',').map(|name| format!("swm/{name}")).collect();
    let build = ["build", "--quiet", "--features", &features.join(",")];
    process::run(packages::cargo(metadata, &build).args(separate_crates::all_others()))?;
    for name in separate_crates::SEPARATE {
        // With tests, whose features their own step in `cargo xtask nightly` has built already.
        let mut check = packages::cargo(metadata, &["check", "--quiet", "--all-targets", "--package", name]);
        process::run(check.envs(setup::tools::protoc()))?;
    }
    Ok(format!("{count} packages build from their files alone"))
}

/// What git has, and nothing else.
fn source_archive(release: &Release) -> Result<String> {
    let name = format!("stable-worldmodel-rs-{}", release.version);
    let archive = format!("archive --format=tar.gz --prefix={name}/ HEAD");
    release.write(&format!("{name}.tar.gz"), &process::output(&mut publish::git_command(&archive))?)
}

fn checksums(release: &Release) -> Result<String> {
    archives::write_checksums(&release.out)?;
    Ok(format!("SHA256SUMS in {}", release.out.display()))
}

fn publication(release: &Release) -> Result<String> {
    let plan = publish::plan(&release.version, &release.published);
    if release.is_dry {
        return Ok(format!("a dry run; --execute would do:\n  {}", plan.join("\n  ")));
    }
    publish::execute(&plan)?;
    Ok(format!("{} is published", release.version))
}

impl Release {
    /// Writes a file of the release, and returns its name and size for people.
    fn write(&self, name: &str, bytes: &[u8]) -> Result<String> {
        setup::wheel::write(&self.out.join(name), bytes)?;
        Ok(format!("{name}, {:.1} MB", bytes.len() as f64 / 1e6))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_on_releasing_explains_every_step_in_order() {
        let page = std::fs::read_to_string(process::root().join("docs/RELEASING.md")).unwrap();
        let rows = page.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next());
        assert_eq!(rows.collect::<Vec<_>>(), STEPS.iter().map(|(name, _)| *name).collect::<Vec<_>>());
    }
}
