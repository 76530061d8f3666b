//! `cargo xtask release`: everything between a good state of the workspace and a release, as a table of steps. Nothing that
//! cannot be undone is done without `--execute`.
//!
//! For people: docs/RELEASING.md.

mod archives;
mod changelog;
mod notices;
mod packages;
mod program;
mod publish;
mod sbom;
mod version;

use std::fs;
use std::path::PathBuf;

use anyhow::{Context as _, Result, bail, ensure};
use clap::ValueEnum;
use flate2::Compression;

use self::changelog::Section;
use self::packages::Packaged;
use crate::metadata::Metadata;
use crate::{apart, deny, process, setup};

/// Options of `cargo xtask release`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Tag and publish after the checks, which cannot be undone
    #[arg(long, conflicts_with = "dry_run")]
    execute: bool,
    /// Publish nothing, and print what would be done; this is the default
    #[arg(long)]
    dry_run: bool,
    /// Write a new version into the manifests, and its heading into CHANGELOG.md; then stop
    #[arg(long, value_name = "VERSION", conflicts_with_all = ["execute", "out", "profile", "from"])]
    bump: Option<String>,
    /// How the program in the archive is built
    #[arg(long, value_enum, default_value_t)]
    profile: Profile,
    /// The folder for archives, bill of materials and checksums; default: `release` in cargo's build directory
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Go on with this crate after a publication that failed half-way
    #[arg(long, value_name = "CRATE", requires = "execute")]
    from: Option<String>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Profile {
    /// As tests are: quick, for a dry run; the archive says so in its name
    Dev,
    /// With all features, optimized: some ten minutes and more
    #[default]
    Release,
}

/// What the steps work on.
struct Release {
    metadata: Metadata,
    version: String,
    profile: Profile,
    is_dry: bool,
    from: Option<String>,
    /// Where archives go.
    out: PathBuf,
}

/// One line of the table. What it returns is printed behind its name.
struct Step {
    name: &'static str,
    run: fn(&Release) -> Result<String>,
}

const STEPS: &[Step] = &[
    Step { name: "version", run: one_version },
    Step { name: "changelog", run: dated_section },
    Step { name: "checkout", run: clean_checkout },
    Step { name: "manifests", run: manifests },
    Step { name: "licenses", run: licenses },
    Step { name: "semver", run: semver },
    Step { name: "packages", run: packaged_files },
    Step { name: "bill", run: program::write_bill },
    Step { name: "source", run: source_archive },
    Step { name: "program", run: program::archive },
    Step { name: "checksums", run: checksums },
    Step { name: "publish", run: publication },
];

/// Runs the steps; the first that fails ends the run.
pub(crate) fn run(args: &Args) -> Result<()> {
    let version = version::current()?;
    if let Some(new) = &args.bump {
        version::check_successor(&version, new)?;
        changelog::release(new)?;
        version::bump(&version, new)?;
        println!("the version is {new} now: look at `git diff`, run `cargo xtask ci`, and commit");
        return Ok(());
    }
    ensure!(
        !args.execute || args.profile == Profile::Release,
        "what is published is built with `--profile release`"
    );
    let metadata = Metadata::load()?;
    let out = args.out.clone().unwrap_or_else(|| metadata.target_directory.join("release-files"));
    fs::create_dir_all(&out).with_context(|| format!("cannot make the folder {}", out.display()))?;
    let release = Release {
        metadata,
        version,
        profile: args.profile,
        is_dry: !args.execute,
        from: args.from.clone(),
        out: std::path::absolute(out)?,
    };
    for step in STEPS {
        let said = (step.run)(&release).with_context(|| format!("release: {}", step.name))?;
        println!("{:<10} {said}", step.name);
    }
    Ok(())
}

/// Dry, as quick as it goes, into cargo's build directory: a step of `cargo xtask ci`.
pub(crate) fn rehearse() -> Result<()> {
    run(&Args { execute: false, dry_run: true, bump: None, profile: Profile::Dev, out: None, from: None })
}

fn one_version(release: &Release) -> Result<String> {
    version::check(&release.version)?;
    Ok(format!("{} everywhere", release.version))
}

fn dated_section(release: &Release) -> Result<String> {
    match changelog::section(&release.version)? {
        Section::Dated { date, text } => Ok(format!("{date}, {} lines", text.lines().count())),
        Section::Unreleased if release.is_dry => Ok(format!(
            "{0} has no section yet: `--bump {0}` makes one of what is unreleased",
            release.version
        )),
        Section::Unreleased => bail!("{0} has no section: `cargo xtask release --bump {0}`", release.version),
    }
}

fn clean_checkout(release: &Release) -> Result<String> {
    let faults = publish::check_checkout(&release.version);
    match (faults, release.is_dry) {
        (Ok(()), _) => Ok("committed, and not tagged otherwise".into()),
        (Err(error), true) => Ok(format!("not as `--execute` wants it: {error:#}")),
        (Err(error), false) => Err(error),
    }
}

fn manifests(release: &Release) -> Result<String> {
    let order = packages::order(&release.metadata)?;
    let faults: Vec<String> =
        order.iter().flat_map(|package| packages::faults(package, &release.version)).collect();
    ensure!(faults.is_empty(), "{}", faults.join("\n"));
    Ok(format!("{} crates say what they are", order.len()))
}

/// Known vulnerabilities stand in a database on the network, which only a real release asks.
fn licenses(release: &Release) -> Result<String> {
    deny::run(&deny::Args::with_advisories(!release.is_dry))?;
    Ok(if release.is_dry {
        "allowed; advisories are asked for by --execute alone"
    } else {
        "allowed, and no advisories"
    }
    .into())
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
    // Of all crates, also of those on Lance, which ask for its compiler of protocols.
    let mut check = process::cargo(["semver-checks", "--workspace", "--baseline-rev", &tag]);
    process::run(check.envs(setup::tools::protoc()))?;
    Ok(format!("compatible with {tag}, or the version says otherwise"))
}

/// Builds everything from the packaged files, in the profile of tests.
fn packaged_files(release: &Release) -> Result<String> {
    let packaged = Packaged::make(&release.metadata, &release.version, release.is_dry)?;
    let mut build = packaged.cargo(&release.metadata, &["build", "--quiet"]);
    process::run(build.args(apart::all_others()).args(program::FEATURES.dev_options()))?;
    for name in apart::APART {
        // With tests, whose features their own step in `cargo xtask ci` has built already.
        let args = ["check", "--quiet", "--all-targets", "--package", name];
        let mut check = packaged.cargo(&release.metadata, &args);
        process::run(check.envs(setup::tools::protoc()))?;
    }
    Ok(format!("{} packages build from their files alone", packages::order(&release.metadata)?.len()))
}

/// What git has, and nothing else.
fn source_archive(release: &Release) -> Result<String> {
    let root = format!("stable-worldmodel-rs-{}", release.version);
    let tar = process::output(&mut publish::git(&[
        "archive",
        "--format=tar",
        &format!("--prefix={root}/"),
        "HEAD",
    ]))?;
    release.write(&format!("{root}.tar.gz"), &archives::gzip(&tar, Compression::best())?)
}

fn checksums(release: &Release) -> Result<String> {
    archives::write_checksums(&release.out)?;
    Ok(format!("SHA256SUMS in {}", release.out.display()))
}

fn publication(release: &Release) -> Result<String> {
    let plan = publish::plan(&release.metadata, &release.version, release.from.as_deref())?;
    if release.is_dry {
        let lines: Vec<String> = plan.iter().map(|words| format!("\n  {}", words.join(" "))).collect();
        return Ok(format!("a dry run; --execute would do:{}", lines.concat()));
    }
    publish::execute(&plan)?;
    Ok(format!("{} is published", release.version))
}

impl Release {
    /// Writes a file of the release, and says so.
    fn write(&self, name: &str, bytes: &[u8]) -> Result<String> {
        let path = self.out.join(name);
        fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(format!("{name}, {:.1} MB", bytes.len() as f64 / 1e6))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_on_releasing_explains_every_step_in_order() {
        let page = fs::read_to_string(process::root().join("docs/RELEASING.md")).unwrap();
        let rows = page.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next());
        assert_eq!(rows.collect::<Vec<_>>(), STEPS.iter().map(|step| step.name).collect::<Vec<_>>());
    }
}
