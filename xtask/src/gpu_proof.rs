//! `cargo xtask gpu-proof`: parity, speed and a training on a GPU, by `gpu/proof/proof.py`, here or on a machine without network
//! to which `--pack` makes one file to carry.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context as _, Result, ensure};
use flate2::Compression;
use flate2::write::GzEncoder;

use crate::gpu::Workspace;
use crate::{process, setup};

/// Options of `cargo xtask gpu-proof`.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// What to do; all of it if nothing is named
    #[arg(value_parser = STAGES.to_vec())]
    stages: Vec<String>,
    /// Device to compare with the CPU and to train on: cuda, cuda:1, or cpu, which tests the script
    #[arg(long, default_value = "cuda")]
    device: String,
    /// Sizes that take minutes on a CPU, and say nothing about a GPU
    #[arg(long)]
    tiny: bool,
    /// Minutes that a stage may take; `train` goes on when it is called again
    #[arg(long, default_value_t = 9.0)]
    minutes: f64,
    /// Where everything goes; what is there already is not made again
    #[arg(long, default_value = "gpu-proof", value_name = "DIR")]
    out: PathBuf,
    /// A command `swm` with baselines; else one is built in gpu/
    #[arg(long, value_name = "FILE")]
    swm: Option<PathBuf>,
    /// Run nothing; write the command and the scripts into one file (.tar.gz), for a machine without network
    #[arg(long, value_name = "FILE", conflicts_with = "stages")]
    pack: Option<PathBuf>,
}

const STAGES: [&str; 4] = ["parity", "speed", "train", "evaluate"];
const SCRIPTS: &[&str] = &["proof.py", "lewm_torch.py"];
/// What may be carried to a machine that is lent.
const MOST_BYTES: u64 = 64 << 20;

/// Runs the stages, or packs.
pub(crate) fn run(args: &Args) -> Result<()> {
    let swm = match &args.swm {
        Some(file) => file.clone(),
        None => build()?,
    };
    if let Some(file) = &args.pack {
        let bytes = pack(file, &swm)?;
        println!(
            "{}: {:.1} MB; there: tar xf FILE && python3 proof.py parity",
            file.display(),
            bytes as f64 / 1e6
        );
        ensure!(bytes <= MOST_BYTES, "{} is larger than {} MiB", file.display(), MOST_BYTES >> 20);
        return Ok(());
    }
    process::run(&mut script(args, &swm))
}

/// All stages on a CPU with a command that is built: a test of the scripts.
pub(crate) fn rehearse(swm: &Path) -> Result<()> {
    let out = tempfile::tempdir().context("no folder for a rehearsal")?;
    let args = Args {
        stages: Vec::new(),
        device: "cpu".to_owned(),
        tiny: true,
        minutes: 9.0,
        out: out.path().to_owned(),
        swm: None,
        pack: None,
    };
    process::run(&mut script(&args, swm))
}

/// The optimized command with CUDA.
fn build() -> Result<PathBuf> {
    setup::for_build()?;
    let workspace = Workspace::open()?;
    process::run(&mut workspace.cargo(["build", "--release", "--locked"]))?;
    Ok(workspace.program("release"))
}

/// The scripts' folder.
fn scripts() -> PathBuf {
    Workspace::folder().join("proof")
}

fn script(args: &Args, swm: &Path) -> Command {
    let mut command = Command::new("python3");
    command.current_dir(process::root()).arg(scripts().join(SCRIPTS[0]));
    if args.stages.is_empty() {
        command.args(STAGES);
    }
    command.args(&args.stages).arg("--swm").arg(swm).arg("--out").arg(&args.out);
    command.args(["--device", &args.device, "--minutes", &args.minutes.to_string()]);
    command.args(args.tiny.then_some("--tiny"));
    command
}

/// Writes the command and the scripts, and returns the size of the file.
fn pack(file: &Path, swm: &Path) -> Result<u64> {
    let out = File::create(file).with_context(|| format!("cannot write {}", file.display()))?;
    let mut archive = tar::Builder::new(GzEncoder::new(out, Compression::best()));
    archive.append_path_with_name(swm, "swm").with_context(|| format!("cannot pack {}", swm.display()))?;
    for name in SCRIPTS {
        archive.append_path_with_name(scripts().join(name), name)?;
    }
    archive.into_inner()?.finish()?.flush()?;
    Ok(fs::metadata(file)?.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        args: Args,
    }

    fn words(line: &str) -> Vec<String> {
        let args = Cli::parse_from(line.split(' ')).args;
        script(&args, Path::new("swm")).get_args().skip(1).map(|word| word.to_string_lossy().into()).collect()
    }

    #[test]
    fn stages_and_options_go_to_the_script() {
        let all = "parity speed train evaluate --swm swm --out gpu-proof --device cuda --minutes 9";
        assert_eq!(words("gpu-proof").join(" "), all);
        let some = "train --swm swm --out out --device cpu --minutes 0.5 --tiny";
        assert_eq!(words("gpu-proof train --device cpu --minutes 0.5 --tiny --out out").join(" "), some);
    }

    #[test]
    fn a_package_holds_the_command_and_the_scripts() {
        let folder = tempfile::tempdir().unwrap();
        let (swm, packed) = (folder.path().join("built"), folder.path().join("proof.tar.gz"));
        fs::write(&swm, "a program").unwrap();
        assert_eq!(pack(&packed, &swm).unwrap(), fs::metadata(&packed).unwrap().len());
        let mut archive = tar::Archive::new(flate2::read::GzDecoder::new(File::open(&packed).unwrap()));
        let names: Vec<String> = archive
            .entries()
            .unwrap()
            .map(|entry| entry.unwrap().path().unwrap().display().to_string())
            .collect();
        assert_eq!(names, ["swm", "proof.py", "lewm_torch.py"]);
    }
}
