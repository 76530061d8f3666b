//! `cargo xtask deny`: licenses and origins of all dependencies, against the policy in `deny.toml`.
//!
//! cargo-deny does it where it is installed. Elsewhere a check of our own reads the same policy: allowed licenses with
//! their exceptions, banned crates, allowed registries. It knows nothing of duplicate versions and advisories.

use std::collections::BTreeSet;
use std::fs;

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;
use spdx::{Expression, Licensee, ParseMode};

use crate::metadata::{Metadata, Package};
use crate::process;

/// Options of `cargo xtask deny`.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// Look for published vulnerabilities too: needs cargo-deny, and the network for its database
    #[arg(long)]
    advisories: bool,
    /// Use the built-in check even where cargo-deny is installed
    #[arg(long, conflicts_with = "advisories")]
    built_in: bool,
}

impl Args {
    /// With published vulnerabilities, or without.
    pub(crate) fn with_advisories(advisories: bool) -> Self {
        Self { advisories, built_in: false }
    }
}

/// Checks every dependency; an error names each that offends the policy.
pub(crate) fn run(args: &Args) -> Result<()> {
    if !args.built_in && process::has_cargo_command("deny") {
        let checks = ["licenses", "bans", "sources"];
        return if args.advisories {
            process::run(process::cargo(["deny", "check", "advisories"]).args(checks))
        } else {
            process::run(process::cargo(["deny", "--offline", "check"]).args(checks))
        };
    }
    if args.advisories {
        bail!("advisories need cargo-deny: install it with `cargo install --locked cargo-deny`");
    }
    let text = fs::read_to_string(process::root().join("deny.toml")).context("failed to read deny.toml")?;
    let policy = Policy::parse(&text)?;
    let metadata = Metadata::load()?;
    let built = built()?;
    let foreign = || {
        metadata.foreign().filter(|package| built.contains(&format!("{} v{}", package.name, package.version)))
    };
    let offences = policy.offences(foreign());
    for offence in &offences {
        println!("error[deny] {offence}");
    }
    if !offences.is_empty() {
        bail!("deny: {} offences against deny.toml", offences.len());
    }
    println!(
        "deny: licenses and origins of {} crates are allowed by deny.toml (built-in check: no duplicates, no advisories)",
        foreign().count()
    );
    Ok(())
}

/// What is built on some platform with all features of the workspace: names and versions. `cargo metadata` lists more:
/// optional dependencies that a dependency names weakly (`tensor?/simd`) and that nothing turns on.
fn built() -> Result<BTreeSet<String>> {
    let args = [
        "tree",
        "--workspace",
        "--all-features",
        "--target=all",
        "--edges=normal,build,dev",
        "--prefix=none",
    ];
    let lines = String::from_utf8(process::output(process::cargo(args).arg("--format={p}"))?)?;
    let name_and_version = |line: &str| line.split_whitespace().take(2).collect::<Vec<_>>().join(" ");
    Ok(lines.lines().map(name_and_version).collect())
}

/// The part of deny.toml that the built-in check reads.
#[derive(Deserialize)]
struct Policy {
    licenses: Licenses,
    #[serde(default)]
    bans: Bans,
    sources: Sources,
}

#[derive(Deserialize)]
struct Licenses {
    allow: Vec<String>,
    #[serde(default)]
    exceptions: Vec<Exception>,
    #[serde(default)]
    clarify: Vec<Clarification>,
}

/// More licenses for one crate.
#[derive(Deserialize)]
struct Exception {
    #[serde(rename = "crate")]
    name: String,
    allow: Vec<String>,
}

/// The license of a crate that states it only in a file.
#[derive(Deserialize)]
struct Clarification {
    #[serde(rename = "crate")]
    name: String,
    expression: String,
}

#[derive(Default, Deserialize)]
struct Bans {
    #[serde(default)]
    deny: Vec<Ban>,
}

#[derive(Deserialize)]
struct Ban {
    #[serde(rename = "crate")]
    name: String,
    reason: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "kebab-case")]
struct Sources {
    allow_registry: Vec<String>,
    #[serde(default)]
    allow_git: Vec<String>,
}

impl Policy {
    fn parse(text: &str) -> Result<Self> {
        let policy: Self = toml::from_str(text).context("failed to read deny.toml")?;
        let exceptions = policy.licenses.exceptions.iter().flat_map(|exception| &exception.allow);
        for name in policy.licenses.allow.iter().chain(exceptions) {
            Licensee::parse(name).with_context(|| format!("deny.toml: `{name}` is no SPDX license"))?;
        }
        Ok(policy)
    }

    /// One line per offence, ordered by crate.
    fn offences<'a>(&self, packages: impl Iterator<Item = &'a Package>) -> Vec<String> {
        let mut offences = Vec::new();
        for package in packages {
            let reasons = [self.license_offence(package), self.ban(package), self.source_offence(package)];
            let reasons = reasons.into_iter().flatten();
            offences.extend(reasons.map(|reason| format!("{} {}: {reason}", package.name, package.version)));
        }
        offences.sort();
        offences
    }

    fn license_offence(&self, package: &Package) -> Option<String> {
        let clarified = self.licenses.clarify.iter().find(|clarification| clarification.name == package.name);
        let Some(text) =
            package.license.as_ref().or(clarified.map(|clarification| &clarification.expression))
        else {
            return Some("states no license expression".into());
        };
        let Ok(expression) = Expression::parse_mode(text, ParseMode::LAX) else {
            return Some(format!("its license `{text}` is no SPDX expression"));
        };
        let exceptions = self.licenses.exceptions.iter().filter(|exception| exception.name == package.name);
        let names = self.licenses.allow.iter().chain(exceptions.flat_map(|exception| &exception.allow));
        let allowed: Vec<Licensee> = names.filter_map(|name| Licensee::parse(name).ok()).collect();
        let is_allowed =
            expression.evaluate(|wanted| allowed.iter().any(|licensee| licensee.satisfies(wanted)));
        (!is_allowed).then(|| format!("its license `{text}` is not allowed"))
    }

    fn ban(&self, package: &Package) -> Option<String> {
        let ban = self.bans.deny.iter().find(|ban| ban.name == package.name)?;
        Some(format!("is banned: {}", ban.reason))
    }

    fn source_offence(&self, package: &Package) -> Option<String> {
        let Some(source) = package.source.as_deref() else {
            return Some("comes from a local folder outside of the workspace".into());
        };
        let is_allowed = match source.split_once('+') {
            Some(("registry" | "sparse", url)) => {
                self.sources.allow_registry.iter().any(|allowed| allowed == url)
            }
            Some(("git", url)) => {
                let url = url.split(['?', '#']).next().unwrap_or(url);
                self.sources.allow_git.iter().any(|allowed| allowed == url)
            }
            _ => false,
        };
        (!is_allowed).then(|| format!("its origin `{source}` is not allowed"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POLICY: &str = r#"
        [licenses]
        allow = ["MIT", "Apache-2.0 WITH LLVM-exception", "BSD-3-Clause"]
        exceptions = [{ crate = "unicode", allow = ["Unicode-3.0"] }]
        clarify = [{ crate = "silent", expression = "BSD-3-Clause" }, { crate = "sly", expression = "GPL-3.0" }]
        [bans]
        deny = [{ crate = "openssl-sys", reason = "no network" }]
        [sources]
        allow-registry = ["https://github.com/rust-lang/crates.io-index"]
        allow-git = ["https://example.org/repo"]
    "#;
    const CRATES_IO: &str = "registry+https://github.com/rust-lang/crates.io-index";

    #[track_caller]
    fn check(name: &str, license: Option<&str>, source: Option<&str>, expected: &[&str]) {
        let package = Package {
            name: name.into(),
            version: "1.2.3".into(),
            license: license.map(Into::into),
            source: source.map(Into::into),
            ..Package::default()
        };
        let policy = Policy::parse(POLICY).unwrap();
        assert_eq!(policy.offences([&package].into_iter()), expected);
    }

    #[test]
    fn one_allowed_choice_is_enough() {
        check("a", Some("GPL-3.0 OR MIT"), Some(CRATES_IO), &[]);
        check("a", Some("GPL-3.0/MIT"), Some(CRATES_IO), &[]);
        check("a", Some("(GPL-3.0 OR MIT) AND BSD-3-Clause"), Some(CRATES_IO), &[]);
        check("a", Some("Apache-2.0 WITH LLVM-exception"), Some(CRATES_IO), &[]);
    }

    #[test]
    fn every_required_license_must_be_allowed() {
        let offence = "a 1.2.3: its license `GPL-3.0 AND MIT` is not allowed";
        check("a", Some("GPL-3.0 AND MIT"), Some(CRATES_IO), &[offence]);
        check(
            "a",
            Some("Apache-2.0"),
            Some(CRATES_IO),
            &["a 1.2.3: its license `Apache-2.0` is not allowed"],
        );
        check("a", Some("my own"), Some(CRATES_IO), &["a 1.2.3: its license `my own` is no SPDX expression"]);
        check("a", None, Some(CRATES_IO), &["a 1.2.3: states no license expression"]);
    }

    #[test]
    fn an_exception_holds_for_its_crate_alone() {
        check("unicode", Some("MIT AND Unicode-3.0"), Some(CRATES_IO), &[]);
        check(
            "other",
            Some("MIT AND Unicode-3.0"),
            Some(CRATES_IO),
            &["other 1.2.3: its license `MIT AND Unicode-3.0` is not allowed"],
        );
    }

    #[test]
    fn a_clarification_speaks_for_a_crate_that_states_nothing() {
        check("silent", None, Some(CRATES_IO), &[]);
        check("sly", None, Some(CRATES_IO), &["sly 1.2.3: its license `GPL-3.0` is not allowed"]);
        check(
            "silent",
            Some("GPL-3.0"),
            Some(CRATES_IO),
            &["silent 1.2.3: its license `GPL-3.0` is not allowed"],
        );
    }

    #[test]
    fn origins_are_checked() {
        check("a", Some("MIT"), Some("git+https://example.org/repo?branch=main#0123"), &[]);
        check(
            "a",
            Some("MIT"),
            Some("git+https://example.org/other#0123"),
            &["a 1.2.3: its origin `git+https://example.org/other#0123` is not allowed"],
        );
        check("a", Some("MIT"), None, &["a 1.2.3: comes from a local folder outside of the workspace"]);
    }

    #[test]
    fn bans_say_why() {
        check("openssl-sys", Some("MIT"), Some(CRATES_IO), &["openssl-sys 1.2.3: is banned: no network"]);
    }

    #[test]
    fn our_own_policy_is_readable() {
        Policy::parse(&fs::read_to_string(process::root().join("deny.toml")).unwrap()).unwrap();
        assert!(Policy::parse(&POLICY.replace("\"MIT\"", "\"No-Such\"")).is_err());
    }
}
