//! What cannot be undone: the tag, and the crates on the registry. A list of commands, which a dry run prints.

use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use semver::Version;

use crate::process;

/// The tag of the newest version before `version` among those before this commit, if there is one.
pub(super) fn last_tag(version: &Version) -> Result<Option<String>> {
    Ok(newest_before(version, &git("tag --list v[0-9]* --merged")?))
}

/// A publication that goes on has its own tag already. Git would sort a pre-release behind its release.
fn newest_before(version: &Version, tags: &str) -> Option<String> {
    let versions = tags.lines().filter_map(|tag| Version::parse(tag.strip_prefix('v')?).ok());
    versions.filter(|found| found < version).max().map(|newest| format!("v{newest}"))
}

/// Fails unless the checkout is what will be tagged.
pub(super) fn check_checkout(version: &Version) -> Result<()> {
    let changed = git("status --porcelain")?;
    ensure!(changed.is_empty(), "commit first; not committed:\n{changed}");
    if !git(&format!("tag --list v{version}"))?.is_empty() {
        // A publication that failed half-way goes on.
        let (tagged, head) = (git(&format!("rev-parse v{version}^{{commit}}"))?, git("rev-parse HEAD")?);
        ensure!(tagged == head, "the tag v{version} is there already, on another commit: {tagged}");
    }
    Ok(())
}

/// What git prints, given words without blanks.
pub(super) fn git(words: &str) -> Result<String> {
    let printed = process::output(&mut git_command(words))?;
    Ok(String::from_utf8(printed).context("git printed no UTF-8")?.trim_end().to_owned())
}

/// `git` in the checkout, which may belong to another user than us.
pub(super) fn git_command(words: &str) -> Command {
    let mut command = Command::new("git");
    command.current_dir(process::root()).args(["-c", "safe.directory=*"]).args(words.split(' '));
    command
}

/// The commands of a publication. The crates in `published` are on the registry already; cargo orders the others.
pub(super) fn plan(version: &Version, published: &[String]) -> Vec<String> {
    let excluded = published.iter().map(|name| format!(" --exclude {name}"));
    let publish = format!("cargo publish --workspace --locked --no-verify{}", excluded.collect::<String>());
    let tag = format!("git tag --annotate --message v{version} v{version}");
    let push = format!("git push origin v{version}");
    if published.is_empty() { vec![tag, publish, push] } else { vec![publish, push] }
}

/// Runs them, one after the other.
pub(super) fn execute(plan: &[String]) -> Result<()> {
    for line in plan {
        let mut command = match line.split_once(' ').unwrap_or_default() {
            ("cargo", words) => process::cargo(words.split(' ')),
            (_, words) => git_command(words),
        };
        process::run(&mut command).context(
            "what cargo reported above as published stays so; go on with `--execute --published CRATE,…`",
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tag_comes_first_and_the_push_last() {
        let version = Version::new(0, 2, 0);
        assert_eq!(
            plan(&version, &[]),
            [
                "git tag --annotate --message v0.2.0 v0.2.0",
                "cargo publish --workspace --locked --no-verify",
                "git push origin v0.2.0",
            ]
        );
        let publish = "cargo publish --workspace --locked --no-verify --exclude swm-fov --exclude swm-core";
        assert_eq!(
            plan(&version, &["swm-fov".into(), "swm-core".into()]),
            [publish, "git push origin v0.2.0"]
        );
    }

    #[test]
    fn a_release_is_compared_with_the_newest_before_it() {
        let tags = "v0.1.0\nv0.2.0\nv0.2.0-rc.10\nv0.2.0-rc.9\nv2\n";
        let newest = |version: &str| newest_before(&version.parse().unwrap(), tags);
        assert_eq!(newest("0.3.0").as_deref(), Some("v0.2.0"));
        assert_eq!(newest("0.2.0").as_deref(), Some("v0.2.0-rc.10"));
        assert_eq!(newest("0.1.0"), None);
    }

    #[test]
    fn a_publication_that_fails_tells_how_to_go_on() {
        let plan = ["git --version".to_owned(), "cargo no-such-subcommand".to_owned()];
        let error = execute(&plan).unwrap_err().to_string();
        assert!(error.contains("--execute --published"), "{error}");
    }
}
