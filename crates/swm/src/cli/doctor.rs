//! `swm doctor`: prints what works on this machine, what does not, and which command fixes it.

use clap::Args;
use swm_core::{Cancel, Registry};

use super::reporter::Reporter;
use super::{Failure, Output};
use crate::doctor::{Check, State, checks};

/// Show what is installed, what is missing, and which command fixes it.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm doctor
  swm doctor --json

Exit status: 0 if everything that this build offers works, 1 if something is missing. What is optional counts as working.")]
pub(super) struct Doctor {}

impl Doctor {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let mut report = Reporter::new(output, Cancel::new());
        let all = look(checks(registry, &mut report), |check| output.line(|| line(check)))?;
        output.json(&all)?;
        let missing: Vec<_> =
            all.iter().filter(|check| check.state == State::Missing).map(|check| check.what).collect();
        match missing.as_slice() {
            [] => Ok(()),
            names => Err(Failure::from(format!("missing: {}", names.join(", ")))),
        }
    }
}

/// Tells of each check before the next one begins: some take seconds.
fn look(
    checks: impl Iterator<Item = Check>,
    mut tell: impl FnMut(&Check) -> Result<(), Failure>,
) -> Result<Vec<Check>, Failure> {
    checks.map(|check| tell(&check).map(|()| check)).collect()
}

/// Characters of the longest name of a check.
const WIDTH: usize = "models of the Control Suite".len();

fn line(check: &Check) -> String {
    let Check { what, state, found, fix } = check;
    let mark = match state {
        State::Works => "ok      ",
        State::Optional => "optional",
        State::Note => "note    ",
        State::Missing => "MISSING ",
    };
    let mut text = format!("{mark}  {what:WIDTH$}  {found}");
    if let Some(fix) = fix {
        text += &format!("\n{:10}{:WIDTH$}  -> {fix}", "", "");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doctor::features;

    #[test]
    fn what_is_missing_comes_with_what_fixes_it() {
        let pad = " ".repeat(WIDTH - 6);
        assert_eq!(line(&Check::works("videos", "GIF")), format!("ok        videos{pad}  GIF"));
        let missing = Check::missing("MuJoCo", "no such file", "cargo xtask setup");
        let expected =
            format!("MISSING   MuJoCo{pad}  no such file\n                {pad}  -> cargo xtask setup");
        assert_eq!(line(&missing), expected);
        assert!(features().all(|check| check.what.len() <= WIDTH));
    }

    #[test]
    fn each_check_is_told_before_the_next_one_begins() {
        let told = std::cell::Cell::new(0);
        let checks = (0..3).map(|done| {
            assert_eq!(told.get(), done);
            Check::works("videos", "GIF")
        });
        let tell = |_: &Check| {
            told.set(told.get() + 1);
            Ok(())
        };
        assert_eq!(look(checks, tell).unwrap().len(), 3);
    }
}
