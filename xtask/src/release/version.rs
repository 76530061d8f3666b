//! One version for the whole workspace: where it is written, whether all places agree, and changing it.

use std::fs;

use anyhow::{Context as _, Result, ensure};
use semver::Version;

use crate::metadata::Metadata;
use crate::process;

/// Files that name the version in their lines; cargo writes `Cargo.lock`.
const FILES: &[&str] = &["Cargo.toml", "crates/swm/templates/environment/Cargo.toml.txt"];

/// The version of the workspace.
pub(super) fn current(metadata: &Metadata) -> Result<Version> {
    let swm = metadata.members().find(|package| package.name == "swm").context("no crate `swm`")?;
    Ok(Version::parse(&swm.version)?)
}

/// Fails where a manifest names another version of one of our crates.
pub(super) fn check(version: &Version, metadata: &Metadata) -> Result<()> {
    let members = metadata.members().filter(|package| package.version != version.to_string());
    let mut wrong: Vec<String> =
        members.map(|member| format!("{} {}", member.name, member.version)).collect();
    for file in FILES {
        wrong.extend(others(&read(file)?, version).into_iter().map(|line| format!("{file}: {line}")));
    }
    ensure!(wrong.is_empty(), "the version is {version}, but not everywhere: {}", wrong.join("; "));
    Ok(())
}

/// Writes a later version wherever the old one stands, and lets cargo update its lock file. The first release may have the
/// version that the files began with.
pub(super) fn bump(old: &Version, new: &Version) -> Result<()> {
    ensure!(new >= old, "{new} comes before {old}, the current version");
    for file in FILES {
        fs::write(process::root().join(file), replaced(&read(file)?, old, new))
            .with_context(|| format!("failed to write {file}"))?;
    }
    process::run(&mut process::cargo(["update", "--workspace", "--offline"]))
}

/// Lines that name a version of ours other than `version`.
fn others(text: &str, version: &Version) -> Vec<String> {
    let ours = lines(text).filter(|(_, is_ours)| *is_ours).map(|(line, _)| line.trim_end());
    ours.filter(|line| !line.contains(&format!("\"{version}\""))).map(str::to_owned).collect()
}

fn replaced(text: &str, old: &Version, new: &Version) -> String {
    let (old, new) = (format!("\"{old}\""), format!("\"{new}\""));
    lines(text).map(|(line, is_ours)| if is_ours { line.replace(&old, &new) } else { line.into() }).collect()
}

/// Each line with its end, and whether it names our version: that of the workspace, or of a dependency on one of our crates.
/// The `version` of a template is that of what is made from it.
fn lines(text: &str) -> impl Iterator<Item = (&str, bool)> {
    text.split_inclusive('\n').scan("", |section, line| {
        if line.starts_with('[') {
            *section = line.trim_end();
        }
        let (name, value) = line.split_once(" = ").unwrap_or_default();
        let is_crate = name == "swm" || name.starts_with("swm-");
        let has_version = value.starts_with('"') || value.contains("version = ");
        let is_workspace = *section == "[workspace.package]" && name == "version";
        Some((line, is_workspace || (is_crate && has_version)))
    })
}

fn read(file: &str) -> Result<String> {
    fs::read_to_string(process::root().join(file)).with_context(|| format!("failed to read {file}"))
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
        let new: Version = "0.2.0-rc.1".parse().unwrap();
        let text = replaced(MANIFEST, &Version::new(0, 1, 0), &new);
        assert_eq!(text.matches("0.2.0-rc.1").count(), 3);
        assert!(text.contains("other = \"0.1.0\"") && text.starts_with("[package]\nversion = \"0.1.0\""));
        assert!(others(&text, &new).is_empty());
        let stale = text.replace("swm-core = \"0.2.0-rc.1\"", "swm-core = \"0.1\"");
        assert_eq!(others(&stale, &new), ["swm-core = \"0.1\""]);
    }

    #[test]
    fn versions_do_not_go_back() {
        let error = bump(&Version::new(0, 2, 0), &"0.2.0-rc.1".parse().unwrap()).unwrap_err().to_string();
        assert!(error.contains("comes before"), "{error}");
    }

    #[test]
    fn this_workspace_has_one_version() {
        let metadata = Metadata::load().unwrap();
        check(&current(&metadata).unwrap(), &metadata).unwrap();
    }
}
