//! `swm verify-result`: repeat an evaluation and compare its result with the receipt.

use std::path::PathBuf;

use clap::Args;
use swm_core::Registry;

use super::output::counted;
use super::rates::rate;
use super::threads::ThreadsArg;
use super::{Failure, Output, interrupt, usage};
use crate::bundle::receipt_to_repeat;
use crate::evaluation::{Role, RunOptions, Verification, env_of, verify};

/// Repeat an evaluation: is the result equal bit for bit, and if not, which part differs?
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm verify-result results/receipt.json
  swm verify-result results --threads 1 --num-envs 3
  swm verify-result cem-bundle

Of a bundle (`swm bundle`), the SHA-256 of every file is compared first.

Exit status 0: equal. 1: protocol, physics, images, model, seed, solver, outcomes or reference policies differ. \
Of receipts of version 1, the hash of the environment's tables is not compared: it counted help texts, too.")]
pub(super) struct VerifyResult {
    /// The receipt, or the folder that holds it, or a bundle.
    receipt: PathBuf,
    /// Environments stepped in parallel; results do not depend on it.
    #[arg(long, default_value_t = RunOptions::default().num_envs, value_name = "N")]
    num_envs: usize,
    #[command(flatten)]
    threads: ThreadsArg,
    /// Run the oracle again, too: it can take as long as the policy itself.
    #[arg(long)]
    oracle: bool,
}

impl VerifyResult {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let (receipt, bundle) = receipt_to_repeat(&self.receipt).map_err(usage)?;
        if let Some(bundle) = &bundle {
            output.note(format!("the hashes of {} agree", counted(bundle.files, "file")));
        }
        env_of(registry, &receipt.manifest).map_err(usage)?;
        let references = receipt.references.iter().filter(|known| self.oracle || known.role != Role::Oracle);
        let episodes = receipt.episodes.len() + references.map(|known| known.episodes.len()).sum::<usize>();
        let bar = output.bar(episodes as u64, "episodes");
        let cancel = interrupt::watch(|| "the result is not verified; run it again".to_owned());
        let (num_envs, threads) = (self.num_envs, self.threads.count());
        let options = RunOptions { num_envs, threads, cancel: Some(cancel), ..RunOptions::default() };
        let verification = verify(registry, &receipt, &options, self.oracle, || bar.inc(1));
        bar.finish_and_clear();
        let verification = verification?;
        output.result(&verification, || text(&verification))?;
        if verification.equal { Ok(()) } else { Err("the result is not equal".into()) }
    }
}

fn text(verification: &Verification) -> String {
    let Verification { equal, differences, episodes, notes, summary, recorded } = verification;
    let notes: String = notes.iter().map(|note| format!("note: {note}\n")).collect();
    if *equal {
        return format!("equal: {}, {}\n{notes}", counted(summary.episodes, "episode"), rate(summary));
    }
    let mut text = format!("recorded {}, now {}\n{notes}", rate(recorded), rate(summary));
    for (part, reason) in differences {
        let part = serde_json::to_value(part).unwrap_or_default();
        text += &format!("{} differs: {reason}\n", part.as_str().unwrap_or_default());
    }
    if !episodes.is_empty() {
        let shown: Vec<String> = episodes.iter().take(20).map(usize::to_string).collect();
        let more = if episodes.len() > 20 { ", …" } else { "" };
        text += &format!("episodes that differ: {} ({}{more})\n", episodes.len(), shown.join(", "));
    }
    text
}
