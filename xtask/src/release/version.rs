//! One version for the whole workspace: where it is written, whether all places agree, and changing it.
//!
//! Knows nothing of the changelog.

use std::fs;

use anyhow::{Context as _, Result, bail, ensure};
use toml::{Table, Value};

use crate::process;

/// Files with the version in their lines, beside `Cargo.lock`, which cargo writes.
const FILES: &[&str] = &["Cargo.toml", "templates/environment/Cargo.toml"];

/// The version of the workspace.
pub(super) fn current() -> Result<String> {
    let manifest: Table = read("Cargo.toml")?.parse().context("Cargo.toml cannot be read")?;
    let version = manifest.get("workspace").and_then(|table| table.get("package"));
    let version = version.and_then(|package| package.get("version")).and_then(Value::as_str);
    Ok(version.context("Cargo.toml has no version below [workspace.package]")?.to_owned())
}

/// Fails where a file names another version of one of our crates.
pub(super) fn check(version: &str) -> Result<()> {
    let mut wrong = Vec::new();
    for file in FILES {
        wrong.extend(others(&read(file)?, version).into_iter().map(|line| format!("{file}: {line}")));
    }
    let lock: Table = read("Cargo.lock")?.parse().context("Cargo.lock cannot be read")?;
    for package in lock.get("package").and_then(Value::as_array).into_iter().flatten() {
        let text = |key| package.get(key).and_then(Value::as_str).unwrap_or_default();
        if package.get("source").is_none() && text("version") != version {
            wrong.push(format!("Cargo.lock: {} {}", text("name"), text("version")));
        }
    }
    ensure!(wrong.is_empty(), "the version is {version}, but not everywhere: {}", wrong.join("; "));
    Ok(())
}

/// Writes a new version wherever the old one stands; cargo brings its lock file up to date.
pub(super) fn bump(old: &str, new: &str) -> Result<()> {
    for file in FILES {
        let path = process::root().join(file);
        fs::write(&path, replaced(&read(file)?, old, new))
            .with_context(|| format!("cannot write {}", path.display()))?;
    }
    process::run(&mut process::cargo(["update", "--workspace", "--offline"]))
}

/// An error unless `new` is three numbers (and perhaps a pre-release), and comes after `old`.
pub(super) fn check_successor(old: &str, new: &str) -> Result<()> {
    let (old_key, new_key) = (key(old)?, key(new)?);
    // The first release may be of the version that the files have from the start.
    if new_key < old_key {
        bail!("{new} comes before {old}, which is the version now");
    }
    Ok(())
}

/// A part of a pre-release, in the order that semantic versions have: numbers by their value, and before words.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part<'a> {
    Number(u64),
    Word(&'a str),
}

/// What versions are ordered by: a pre-release comes before its release.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Key<'a> {
    numbers: [u64; 3],
    is_release: bool,
    pre: Vec<Part<'a>>,
}

/// That of `version`, such as `0.2.0` or `0.2.0-rc.1`.
pub(super) fn key(version: &str) -> Result<Key<'_>> {
    let (numbers, pre) =
        version.split_once('-').map_or((version, None), |(numbers, pre)| (numbers, Some(pre)));
    let parts: Vec<u64> = numbers.split('.').map_while(|part| part.parse().ok()).collect();
    let parts: [u64; 3] = parts
        .try_into()
        .ok()
        .filter(|_| numbers.split('.').count() == 3)
        .with_context(|| format!("`{version}` is no version such as 0.2.0 or 0.2.0-rc.1"))?;
    let part = |part| str::parse(part).map_or(Part::Word(part), Part::Number);
    Ok(Key {
        numbers: parts,
        is_release: pre.is_none(),
        pre: pre.map(|pre| pre.split('.').map(part).collect()).unwrap_or_default(),
    })
}

/// Lines that name a version of ours other than `version`.
fn others(text: &str, version: &str) -> Vec<String> {
    let ours = lines(text).filter(|(section, line)| names_our_version(section, line));
    let others = ours.filter(|(_, line)| !line.contains(&format!("\"{version}\"")));
    others.map(|(_, line)| line.trim_end().to_owned()).collect()
}

fn replaced(text: &str, old: &str, new: &str) -> String {
    let (old, new) = (format!("\"{old}\""), format!("\"{new}\""));
    let changed = |(section, line): (&str, &str)| match names_our_version(section, line) {
        true => line.replace(&old, &new),
        false => line.to_owned(),
    };
    lines(text).map(changed).collect()
}

/// Each line with its end, and the heading that it stands below.
fn lines(text: &str) -> impl Iterator<Item = (&str, &str)> {
    text.split_inclusive('\n').scan("", |section, line| {
        if line.starts_with('[') {
            *section = line.trim_end();
        }
        Some((*section, line))
    })
}

/// The version of the workspace, or a dependency on one of our crates by version. The `version` of a template is that of what
/// is made from it.
fn names_our_version(section: &str, line: &str) -> bool {
    let Some((name, value)) = line.split_once(" = ") else { return false };
    let is_ours = name == "swm" || name.starts_with("swm-");
    let has_version = value.starts_with('"') || value.contains("version = ");
    (is_ours && has_version) || (section == "[workspace.package]" && name == "version")
}

fn read(file: &str) -> Result<String> {
    fs::read_to_string(process::root().join(file)).with_context(|| format!("cannot read {file}"))
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

    #[test]
    fn our_versions_change_and_those_of_others_stay() {
        let text = replaced(MANIFEST, "0.1.0", "0.2.0-rc.1");
        assert_eq!(text.matches("0.2.0-rc.1").count(), 3);
        assert!(text.contains("other = \"0.1.0\"") && text.starts_with("[package]\nversion = \"0.1.0\""));
        assert!(others(&text, "0.2.0-rc.1").is_empty());
        assert_eq!(
            others(&text.replace("swm-core = \"0.2.0-rc.1\"", "swm-core = \"0.1\""), "0.2.0-rc.1"),
            ["swm-core = \"0.1\""]
        );
    }

    #[test]
    fn versions_do_not_go_back() {
        for (old, new, is_good) in [
            ("0.1.0", "0.1.0", true),
            ("0.1.0", "0.2.0", true),
            ("0.9.0", "0.10.0", true),
            ("0.2.0-rc.1", "0.2.0", true),
            ("0.2.0-rc.9", "0.2.0-rc.10", true),
            ("0.2.0-beta", "0.2.0-beta.1", true),
            ("0.2.0-rc.1", "0.2.0-beta.2", false),
            ("0.2.0", "0.2.0-rc.1", false),
            ("0.2.0", "0.1.9", false),
            ("0.2.0", "0.3", false),
            ("0.2.0", "0.3.x", false),
        ] {
            assert_eq!(check_successor(old, new).is_ok(), is_good, "{old} -> {new}");
        }
    }

    #[test]
    fn this_workspace_has_one_version() {
        check(&current().unwrap()).unwrap();
    }
}
