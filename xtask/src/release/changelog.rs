//! What CHANGELOG.md says of a version: the heading and the text of its section, and turning `Unreleased` into one.

use std::fs;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result, bail, ensure};

use crate::process;

const FILE: &str = "CHANGELOG.md";

/// What stands below the heading of a version.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Section {
    /// A dated section, with its text.
    Dated { date: String, text: String },
    /// Only what is not released yet.
    Unreleased,
}

/// The section of `version`; an error where the file says nothing of it, or it is not dated.
pub(super) fn section(version: &str) -> Result<Section> {
    find(&read()?, version)
}

/// Gives what is unreleased the version's heading, with the date of today.
pub(super) fn release(version: &str) -> Result<()> {
    let text = released(&read()?, version, &today()?)?;
    fs::write(process::root().join(FILE), text).context("cannot write CHANGELOG.md")
}

fn read() -> Result<String> {
    fs::read_to_string(process::root().join(FILE)).context("cannot read CHANGELOG.md")
}

fn find(changelog: &str, version: &str) -> Result<Section> {
    let body = |heading: &str| {
        let (_, rest) = changelog.split_once(&format!("\n{heading}"))?;
        let (line, rest) = rest.split_once('\n').unwrap_or((rest, ""));
        let text = rest.split("\n## [").next().unwrap_or_default().trim();
        Some((line.trim().to_owned(), text.to_owned()))
    };
    if let Some((rest, text)) = body(&format!("## [{version}]")) {
        let date = rest.strip_prefix("- ").unwrap_or_default().to_owned();
        ensure!(
            is_date(&date),
            "CHANGELOG.md: write `## [{version}] - YYYY-MM-DD`, not `## [{version}] {rest}`"
        );
        ensure!(!text.is_empty(), "CHANGELOG.md: the section of {version} is empty");
        return Ok(Section::Dated { date, text });
    }
    match body("## [Unreleased]") {
        Some((_, text)) if !text.is_empty() => Ok(Section::Unreleased),
        _ => bail!(
            "CHANGELOG.md has neither a section `## [{version}] - DATE` nor anything below `## [Unreleased]`"
        ),
    }
}

fn released(changelog: &str, version: &str, date: &str) -> Result<String> {
    match find(changelog, version)? {
        Section::Dated { .. } => bail!("CHANGELOG.md has a section of {version} already"),
        Section::Unreleased => {
            let heading = format!("## [Unreleased]\n\n## [{version}] - {date}");
            Ok(changelog.replacen("## [Unreleased]", &heading, 1))
        }
    }
}

fn is_date(text: &str) -> bool {
    let parts: Vec<Option<u32>> = text.split('-').map(|part| part.parse().ok()).collect();
    text.len() == 10 && matches!(parts[..], [Some(2000..), Some(1..=12), Some(1..=31)])
}

/// The date of now in UTC, `YYYY-MM-DD`.
#[expect(clippy::disallowed_methods, reason = "a release is dated")]
fn today() -> Result<String> {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).context("the clock stands before 1970")?;
    Ok(date(since.as_secs() / 86_400))
}

/// The date of a day counted from 1970-01-01, by the Gregorian rule: years are counted from March, so that a leap day is the
/// last of its year.
fn date(days: u64) -> String {
    let days = days + 719_468; // from 0000-03-01
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}")
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG: &str = "# Changelog\n\n## [Unreleased]\n\n- new\n\n## [0.1.0] - 2026-11-22\n\n- old\n";

    #[test]
    fn a_section_ends_at_the_next() {
        let section = find(LOG, "0.1.0").unwrap();
        assert_eq!(section, Section::Dated { date: "2026-11-22".into(), text: "- old".into() });
        assert_eq!(find(LOG, "0.2.0").unwrap(), Section::Unreleased);
    }

    #[test]
    fn undated_empty_and_missing_sections_are_told() {
        assert!(
            find(&LOG.replace(" - 2026-11-22", ""), "0.1.0").unwrap_err().to_string().contains("YYYY-MM-DD")
        );
        assert!(find(&LOG.replace("2026-11-22", "2026-13-22"), "0.1.0").is_err());
        assert!(find(&LOG.replace("- old", ""), "0.1.0").unwrap_err().to_string().contains("is empty"));
        assert!(find(&LOG.replace("- new", ""), "0.2.0").unwrap_err().to_string().contains("neither"));
    }

    #[test]
    fn what_is_unreleased_becomes_a_version_once() {
        let text = released(LOG, "0.2.0", "2027-01-31").unwrap();
        assert!(text.contains("## [Unreleased]\n\n## [0.2.0] - 2027-01-31\n\n- new\n\n## [0.1.0]"), "{text}");
        assert!(find(&text, "0.3.0").is_err(), "nothing is unreleased any more");
        assert!(released(&text, "0.2.0", "2027-02-01").is_err());
    }

    #[test]
    fn days_become_dates() {
        for (days, text) in
            [(0, "1970-01-01"), (11_016, "2000-02-29"), (19_723, "2024-01-01"), (20_779, "2026-11-22")]
        {
            assert_eq!(date(days), text);
        }
    }

    #[test]
    fn this_changelog_says_something_of_this_version() {
        section(&super::super::version::current().unwrap()).unwrap();
    }
}
