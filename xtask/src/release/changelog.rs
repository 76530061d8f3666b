//! The section of a version in CHANGELOG.md: finding it, and turning `Unreleased` into one.

use std::fs;
use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};
use semver::Version;

use crate::process;

const FILE: &str = "CHANGELOG.md";
const UNRELEASED: &str = "## [Unreleased]";

/// The date of the version's section, none while its changes are unreleased; an error where there are none, or no date.
pub(super) fn date(version: &Version) -> Result<Option<String>> {
    find(&read()?, version)
}

/// Gives what is unreleased the version's heading, with the date of today.
pub(super) fn release(version: &Version) -> Result<()> {
    let today = String::from_utf8(process::output(Command::new("date").args(["-u", "+%F"]))?)?;
    let text = released(&read()?, version, today.trim())?;
    fs::write(process::root().join(FILE), text).context("failed to write CHANGELOG.md")
}

fn read() -> Result<String> {
    fs::read_to_string(process::root().join(FILE)).context("failed to read CHANGELOG.md")
}

fn find(changelog: &str, version: &Version) -> Result<Option<String>> {
    // What follows a heading in its line, and whether text follows below it.
    let section = |heading: &str| {
        let (_, rest) = changelog.split_once(&format!("\n{heading}"))?;
        let (line, rest) = rest.split_once('\n').unwrap_or((rest, ""));
        let text = rest.split("\n## [").next().unwrap_or_default();
        Some((line.trim(), !text.trim().is_empty()))
    };
    if let Some((rest, has_text)) = section(&format!("## [{version}]")) {
        let date = rest.strip_prefix("- ").unwrap_or_default();
        ensure!(
            is_date(date),
            "CHANGELOG.md: write `## [{version}] - YYYY-MM-DD`, not `## [{version}] {rest}`"
        );
        ensure!(has_text, "CHANGELOG.md: the section of {version} is empty");
        return Ok(Some(date.to_owned()));
    }
    match section(UNRELEASED) {
        Some((_, true)) => Ok(None),
        _ => {
            bail!("CHANGELOG.md has neither a section `## [{version}] - DATE` nor text below `{UNRELEASED}`")
        }
    }
}

fn released(changelog: &str, version: &Version, today: &str) -> Result<String> {
    ensure!(find(changelog, version)?.is_none(), "CHANGELOG.md has a section of {version} already");
    Ok(changelog.replacen(UNRELEASED, &format!("{UNRELEASED}\n\n## [{version}] - {today}"), 1))
}

fn is_date(text: &str) -> bool {
    let parts: Vec<Option<u32>> = text.split('-').map(|part| part.parse().ok()).collect();
    text.len() == 10 && matches!(parts[..], [Some(2000..), Some(1..=12), Some(1..=31)])
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &str = "# Changelog\n\n## [Unreleased]\n\n- new\n\n## [0.1.0] - 2026-11-22\n\n- old\n";

    #[test]
    fn undated_empty_and_missing_sections_are_reported() {
        let (old, new) = (Version::new(0, 1, 0), Version::new(0, 2, 0));
        assert_eq!(find(LOG, &old).unwrap().as_deref(), Some("2026-11-22"));
        assert_eq!(find(LOG, &new).unwrap(), None);
        let error = |text: &str, version| find(text, version).unwrap_err().to_string();
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
        assert!(find(&text, &Version::new(0, 3, 0)).is_err(), "nothing is unreleased any more");
        assert!(released(&text, &new, "2027-02-01").is_err());
    }
}
