//! `cargo xtask deny`: licenses and origins of all dependencies, by cargo-deny against the policy in `deny.toml`, of this workspace
//! and of that in `gpu/`.

use std::path::Path;
use std::process::Command;

use anyhow::{Result, ensure};

use crate::setup::tools;
use crate::{gpu, process};

/// Options of `cargo xtask deny`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Look for published vulnerabilities too: downloads their database
    #[arg(long)]
    pub(crate) advisories: bool,
}

/// Checks every dependency; cargo-deny prints each violation of the policy.
pub(crate) fn run(args: &Args) -> Result<()> {
    let program = tools::cargo_deny();
    ensure!(
        program.is_file(),
        "cargo-deny is missing: run `cargo xtask setup`; where that cannot fetch it, `cargo install --locked cargo-deny` first"
    );
    process::run(&mut check(&program, args.advisories, process::root()))?;
    process::run(&mut check(&program, args.advisories, &gpu::Workspace::folder()))
}

/// Duplicate versions are warnings of a policy that allows them, and would fill the log.
fn check(program: &Path, advisories: bool, workspace: &Path) -> Command {
    let mut command = Command::new(program);
    command.current_dir(workspace).args([
        "--locked",
        "check",
        "--allow",
        "duplicate",
        "--hide-inclusion-graph",
    ]);
    command.args(["licenses", "bans", "sources"]).args(advisories.then_some("advisories"));
    command
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// Runs our policy on a crate whose manifest ends with `dependencies`, where the tool is set up.
    fn verdict(license: &str, dependencies: &str) -> Option<bool> {
        let program = Some(tools::cargo_deny()).filter(|program| program.is_file())?;
        let folder = tempfile::tempdir().unwrap();
        let manifest = format!(
            "[package]\nname = \"example\"\nversion = \"1.0.0\"\nedition = \"2024\"\nlicense = \"{license}\"\n{dependencies}"
        );
        fs::create_dir(folder.path().join("src")).unwrap();
        fs::write(folder.path().join("src/lib.rs"), "").unwrap();
        fs::write(folder.path().join("Cargo.toml"), manifest).unwrap();
        fs::copy(process::root().join("deny.toml"), folder.path().join("deny.toml")).unwrap();
        process::output(process::cargo(["generate-lockfile", "--offline"]).current_dir(folder.path()))
            .unwrap();
        Some(check(&program, false, folder.path()).output().unwrap().status.success())
    }

    #[test]
    fn the_policy_allows_our_license_and_refuses_others() {
        let Some(is_allowed) = verdict("MIT OR Apache-2.0", "") else { return };
        assert!(is_allowed);
        assert_eq!(verdict("GPL-3.0-only OR MIT", ""), Some(true), "one allowed choice is enough");
        assert_eq!(verdict("GPL-3.0-only AND MIT", ""), Some(false));
    }
}
