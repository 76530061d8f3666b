//! One version for the whole workspace: in the manifests, which must agree, and in CHANGELOG.md, where `Unreleased` becomes
//! its section.

use std::fs;
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};
use semver::Version;

use crate::metadata::Metadata;
use crate::process;
use crate::setup::wheel::write;

/// Files that name the version in their lines; cargo writes `Cargo.lock`.
const FILES: &[&str] = &[
    "Cargo.toml",
    "crates/swm/templates/environment/Cargo.toml.txt",
    "packaging/Containerfile",
    "packaging/recipe.yaml",
];
/// How lines begin that end with the version, in files that are no manifests.
const ENDING: &[&str] = &["ARG VERSION=", "  version: "];
const CHANGELOG: &str = "CHANGELOG.md";
const UNRELEASED: &str = "## [Unreleased]";

/// The version of the workspace.
pub(super) fn current(metadata: &Metadata) -> Result<Version> {
    let swm = metadata.members().find(|package| package.name == "swm").context("no crate `swm`")?;
    Ok(Version::parse(&swm.version)?)
}

/// Fails where a manifest names another version of one of our crates.
pub(super) fn check(version: &Version, metadata: &Metadata) -> Result<()> {
    let members = metadata.members().filter(|package| package.version != version.to_string());
    let mut wrong: Vec<_> = members.map(|member| format!("{} {}", member.name, member.version)).collect();
    for file in FILES {
        wrong.extend(others(&read(file)?, version).into_iter().map(|line| format!("{file}: {line}")));
    }
    ensure!(wrong.is_empty(), "the version is {version}, but not everywhere: {}", wrong.join("; "));
    Ok(())
}

/// Writes a later version wherever the old one stands, lets cargo update its lock file, and gives what is unreleased the
/// version's heading, with the date of today. The first release may have the version that the files began with.
pub(super) fn bump(old: &Version, new: &Version) -> Result<()> {
    ensure!(new >= old, "{new} comes before {old}, the current version");
    let today = String::from_utf8(process::output(Command::new("date").args(["-u", "+%F"]))?)?;
    let changelog = released(&read(CHANGELOG)?, new, today.trim())?;
    for file in FILES {
        write(&process::root().join(file), with_version(&read(file)?, new).as_bytes())?;
    }
    process::run(&mut process::cargo(["update", "--workspace", "--offline"]))?;
    write(&process::root().join(CHANGELOG), changelog.as_bytes())
}

/// The date of the version's section, none while its changes are unreleased; an error where there are none, or no date.
pub(super) fn date(version: &Version) -> Result<Option<String>> {
    section(&read(CHANGELOG)?, version)
}

fn read(file: &str) -> Result<String> {
    fs::read_to_string(process::root().join(file)).with_context(|| format!("failed to read {file}"))
}

/// Lines that name a version of ours other than `version`.
fn others(text: &str, version: &Version) -> Vec<String> {
    let right = with_version(text, version);
    let lines = text.lines().zip(right.lines()).filter(|(line, right)| line != right);
    lines.map(|(line, _)| line.to_owned()).collect()
}

/// A manifest with this version of the workspace and of the dependencies on our crates. The `version` of a template is that
/// of what is made from it.
fn with_version(text: &str, version: &Version) -> String {
    let (mut section, mut out) = ("", String::new());
    for line in text.split_inclusive('\n') {
        section = if line.starts_with('[') { line.trim_end() } else { section };
        if let Some(start) = ENDING.iter().find(|start| line.starts_with(**start) && !line.contains('$')) {
            out += &format!("{start}{version}\n");
            continue;
        }
        let (name, value) = line.split_once(" = ").unwrap_or_default();
        let is_workspace = section == "[workspace.package]" && name == "version";
        let is_ours = is_workspace || name == "swm" || name.starts_with("swm-");
        let old = value.split_once("version = ").map_or(value, |(_, old)| old);
        out += &match old.strip_prefix('"').and_then(|old| old.split_once('"')) {
            Some((_, rest)) if is_ours => format!("{}\"{version}\"{rest}", &line[..line.len() - old.len()]),
            _ => line.to_owned(),
        };
    }
    out
}

fn section(changelog: &str, version: &Version) -> Result<Option<String>> {
    // What follows a heading in its line, and whether text follows below it.
    let section = |heading: &str| {
        let (_, rest) = changelog.split_once(&format!("\n{heading}"))?;
        let (line, rest) = rest.split_once('\n').unwrap_or((rest, ""));
        let text = rest.split("\n## [").next().unwrap_or_default();
        Some((line.trim(), !text.trim().is_empty()))
    };
    if let Some((rest, has_text)) = section(&format!("## [{version}]")) {
        let date = rest.strip_prefix("- ").unwrap_or_default();
        let parts: Vec<Option<u32>> = date.split('-').map(|part| part.parse().ok()).collect();
        let is_date = date.len() == 10 && matches!(parts[..], [Some(2000..), Some(1..=12), Some(1..=31)]);
        ensure!(is_date, "{CHANGELOG}: write `## [{version}] - YYYY-MM-DD`, not `## [{version}] {rest}`");
        ensure!(has_text, "{CHANGELOG}: the section of {version} is empty");
        return Ok(Some(date.to_owned()));
    }
    match section(UNRELEASED) {
        Some((_, true)) => Ok(None),
        _ => bail!("{CHANGELOG} has neither a section `## [{version}] - DATE` nor text below `{UNRELEASED}`"),
    }
}

fn released(changelog: &str, version: &Version, today: &str) -> Result<String> {
    ensure!(section(changelog, version)?.is_none(), "{CHANGELOG} has a section of {version} already");
    Ok(changelog.replacen(UNRELEASED, &format!("{UNRELEASED}\n\n## [{version}] - {today}"), 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MANIFEST: &str = r#"[package]
version = "0.1.0"
[workspace.package]
version = "0.1.0"
[workspace.dependencies]
swm = { path = "crates/swm", version = "0.1.0", default-features = false }
swm-core = "0.1.0"
other = "0.1.0"
swm-fov = { path = "crates/swm-fov" }
"#;
    const RECIPE: &str =
        "context:\n  version: 0.1.0\npackage:\n  version: ${{ version }}\nARG VERSION=0.1.0\n";
    const LOG: &str = "# Changelog\n\n## [Unreleased]\n\n- new\n\n## [0.1.0] - 2026-11-22\n\n- old\n";

    #[test]
    fn our_versions_change_and_those_of_others_stay() {
        let new: Version = "0.2.0-rc.1".parse().unwrap();
        let text = with_version(MANIFEST, &new);
        assert_eq!(text.replace("0.2.0-rc.1", "0.1.0"), MANIFEST);
        assert_eq!(text.matches("0.2.0-rc.1").count(), 3);
        assert!(text.contains("other = \"0.1.0\"") && text.starts_with("[package]\nversion = \"0.1.0\""));
        assert_eq!(with_version(RECIPE, &new), RECIPE.replace("0.1.0", "0.2.0-rc.1"));
        let stale = text.replace("swm-core = \"0.2.0-rc.1\"", "swm-core = \"0.1\"");
        assert_eq!(others(&stale, &new), ["swm-core = \"0.1\""]);
    }

    #[test]
    fn this_workspace_has_one_version_which_does_not_go_back() {
        let metadata = Metadata::load().unwrap();
        check(&current(&metadata).unwrap(), &metadata).unwrap();
        let error = bump(&Version::new(0, 2, 0), &"0.2.0-rc.1".parse().unwrap()).unwrap_err().to_string();
        assert!(error.contains("comes before"), "{error}");
    }

    #[test]
    fn undated_empty_and_missing_sections_are_reported() {
        let (old, new) = (Version::new(0, 1, 0), Version::new(0, 2, 0));
        assert_eq!(section(LOG, &old).unwrap().as_deref(), Some("2026-11-22"));
        assert_eq!(section(LOG, &new).unwrap(), None);
        let error = |text: &str, version| section(text, version).unwrap_err().to_string();
        assert!(error(&LOG.replace(" - 2026-11-22", ""), &old).contains("YYYY-MM-DD"));
        assert!(error(&LOG.replace("2026-11-22", "2026-13-22"), &old).contains("YYYY-MM-DD"));
        assert!(error(&LOG.replace("- old", ""), &old).contains("is empty"));
        assert!(error(&LOG.replace("- new", ""), &new).contains("neither"));
    }

    #[test]
    fn what_is_unreleased_becomes_a_version_once() {
        let new = Version::new(0, 2, 0);
        let text = released(LOG, &new, "2027-01-31").unwrap();
        assert!(text.contains("## [Unreleased]\n\n## [0.2.0] - 2027-01-31\n\n- new\n\n## [0.1.0]"), "{text}");
        assert!(section(&text, &Version::new(0, 3, 0)).is_err(), "nothing is unreleased any more");
        assert!(released(&text, &new, "2027-02-01").is_err());
    }
}
