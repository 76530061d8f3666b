//! What cannot be undone: the tag, and the crates on the registry. A list of commands, which a dry run prints.

use std::process::Command;

use anyhow::{Context as _, Result, bail, ensure};

use super::{packages, version};
use crate::metadata::Metadata;
use crate::process;

/// The name of a version's tag.
pub(super) fn tag(version: &str) -> String {
    format!("v{version}")
}

/// The tag of the newest version but `version` among those before this commit, if there is one.
pub(super) fn last_tag(version: &str) -> Result<Option<String>> {
    let tags = process::output(&mut git(&["tag", "--list", "v[0-9]*", "--merged"]))?;
    Ok(newest_but(version, &String::from_utf8_lossy(&tags)))
}

/// The newest version among `tags`, one per line, but `version`: a publication that goes on has its own tag already. Git would
/// put a pre-release behind its release.
fn newest_but(version: &str, tags: &str) -> Option<String> {
    let versions = tags.lines().filter_map(|tag| tag.strip_prefix('v')).filter(|found| *found != version);
    let known = versions.filter_map(|found| Some((version::key(found).ok()?, found)));
    known.max().map(|(_, newest)| tag(newest))
}

/// Fails unless the checkout is what will be tagged.
pub(super) fn check_checkout(version: &str) -> Result<()> {
    let changed = process::output(&mut git(&["status", "--porcelain"]))?;
    ensure!(
        changed.is_empty(),
        "commit first; not committed:\n{}",
        String::from_utf8_lossy(&changed).trim_end()
    );
    let tag = tag(version);
    if !process::output(&mut git(&["tag", "--list", &tag]))?.is_empty() {
        let (tagged, head) = (commit(&format!("{tag}^{{commit}}"))?, commit("HEAD")?);
        // A publication that failed half-way goes on.
        ensure!(tagged == head, "the tag {tag} is there already, on another commit: {tagged}");
    }
    Ok(())
}

/// The commit that a name means.
pub(super) fn commit(name: &str) -> Result<String> {
    let printed = process::output(&mut git(&["rev-parse", "--verify", name]))?;
    Ok(String::from_utf8(printed).context("git printed no UTF-8")?.trim().to_owned())
}

/// `git` in the checkout, which may belong to another user than us.
pub(super) fn git(args: &[&str]) -> Command {
    let mut command = Command::new("git");
    command.current_dir(process::root()).args(["-c", "safe.directory=*"]).args(args);
    command
}

/// The commands of a publication, word by word. `from` leaves out the crates before it.
pub(super) fn plan(metadata: &Metadata, version: &str, from: Option<&str>) -> Result<Vec<Vec<String>>> {
    let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
    let names = packages::order(metadata)?.into_iter().map(|package| package.name.as_str());
    let names: Vec<&str> = names.skip_while(|name| from.is_some_and(|from| from != *name)).collect();
    if let (true, Some(from)) = (names.is_empty(), from) {
        bail!("no crate `{from}` is published");
    }
    let mut plan = Vec::new();
    if from.is_none() {
        let tag = tag(version);
        plan.push(words(&format!("git tag --annotate --message {tag} {tag}")));
    }
    plan.extend(
        names.iter().map(|name| words(&format!("cargo publish --locked --no-verify --package {name}"))),
    );
    plan.push(words(&format!("git push origin {}", tag(version))));
    Ok(plan)
}

/// Runs them, one after the other.
pub(super) fn execute(plan: &[Vec<String>]) -> Result<()> {
    for words in plan {
        let args = &words[1..];
        let mut command = match words[0].as_str() {
            "cargo" => process::cargo(args),
            _ => git(&args.iter().map(String::as_str).collect::<Vec<_>>()),
        };
        process::run(&mut command).with_context(|| {
            match words.iter().skip_while(|word| *word != "--package").nth(1) {
                Some(name) => format!("what came before is published; go on with `--execute --from {name}`"),
                None => "nothing of this step was done".into(),
            }
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::fixture;

    #[test]
    fn the_tag_comes_first_and_the_push_last() {
        let metadata = fixture("swm: swm-core\nswm-core:");
        let lines = |from| -> Vec<String> {
            plan(&metadata, "0.2.0", from).unwrap().iter().map(|words| words.join(" ")).collect()
        };
        assert_eq!(
            lines(None),
            [
                "git tag --annotate --message v0.2.0 v0.2.0",
                "cargo publish --locked --no-verify --package swm-core",
                "cargo publish --locked --no-verify --package swm",
                "git push origin v0.2.0",
            ]
        );
        assert_eq!(
            lines(Some("swm")),
            ["cargo publish --locked --no-verify --package swm", "git push origin v0.2.0"]
        );
        assert!(plan(&metadata, "0.2.0", Some("none")).is_err());
    }

    #[test]
    fn a_release_is_compared_with_the_newest_before_it() {
        let tags = "v0.1.0\nv0.2.0\nv0.2.0-rc.10\nv0.2.0-rc.9\nv2\n";
        assert_eq!(newest_but("0.3.0", tags).as_deref(), Some("v0.2.0"));
        assert_eq!(newest_but("0.2.0", tags).as_deref(), Some("v0.2.0-rc.10"));
        assert_eq!(newest_but("0.1.0", "v0.1.0\n"), None);
    }

    #[test]
    fn a_publication_that_fails_says_where_to_go_on() {
        let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
        let plan = [words("git --version"), words("cargo no-such-subcommand --package swm-fov")];
        let error = execute(&plan).unwrap_err().to_string();
        assert!(error.contains("--execute --from swm-fov"), "{error}");
    }
}
