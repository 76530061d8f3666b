//! The step `mcap` of `cargo xtask nightly`: what the crate `mcap` cannot do with recordings of ours, which is why records of MCAP files
//! are written and read in-house (docs/design/0012-mcap-in-house.md). Its tests are a package of their own, in
//! `tests/interop/mcap-crate`, that pins the crate's version; the recordings come from the program `swm`.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context as _, Result, ensure};

use crate::metadata::Metadata;
use crate::{process, test};

/// The record that commits an episode, as a file has its name: behind the length.
const EPISODE: &[u8] = b"\x0b\0\0\0swm.episode";

/// Records three episodes, cuts the file as a kill in the third does, and tests the crate on both; then `swm` continues the latter.
pub(crate) fn check() -> Result<()> {
    let program = test::program()?;
    let folder = tempfile::tempdir().context("no folder for recordings")?;
    let (whole, killed) = (folder.path().join("whole.mcap"), folder.path().join("killed.mcap"));
    record(&program, &whole)?;
    let bytes = fs::read(&whole).context("no recording")?;
    fs::write(&killed, cut(&bytes)?).context("cannot write a recording")?;

    let package = process::root().join("tests/interop/mcap-crate");
    let mut command = process::cargo(["fmt", "--check"]);
    process::run(command.current_dir(&package))?;
    let mut command = process::cargo(["test", "--quiet", "--locked"]);
    command.current_dir(&package).env("SWM_MCAP_FILES", folder.path());
    let target = Metadata::load()?.target_directory.join("mcap-crate");
    process::run(command.env("CARGO_TARGET_DIR", target))?;

    record(&program, &killed)?;
    let continued = fs::read(&killed).context("no recording")?;
    ensure!(continued == bytes, "the recording that was continued differs from the one that was not killed");
    Ok(())
}

/// Records up to three episodes.
fn record(program: &Path, out: &Path) -> Result<()> {
    let words = "collect swm/TwoRoom-v2 --policy random --total 3 --max-steps 40 --image-size 64x64 --seed 1 --mode append --quiet --out";
    process::run(Command::new(program).args(words.split(' ')).arg(out))
}

/// The file up to the middle of the third episode: what a kill leaves, as records follow one another, and the summary comes last.
fn cut(bytes: &[u8]) -> Result<&[u8]> {
    let windows = bytes.windows(EPISODE.len()).enumerate();
    let mut commits = windows.filter(|(_, window)| *window == EPISODE).map(|(at, _)| at).skip(1);
    let (Some(second), Some(third)) = (commits.next(), commits.next()) else {
        anyhow::bail!("the recording has fewer than three committed episodes");
    };
    Ok(&bytes[..second.midpoint(third)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_cut_in_its_third_episode() {
        let episode = |data: &str| [data.as_bytes(), EPISODE].concat();
        let two = [episode("first"), episode("second")].concat();
        let bytes = [two.clone(), episode(&"third".repeat(20)), b"summary".to_vec()].concat();
        let found = cut(&bytes).unwrap();
        assert!(found.starts_with(&two) && bytes.starts_with(found) && found.len() < two.len() + 100);
        assert!(cut(&two).is_err());
    }
}
