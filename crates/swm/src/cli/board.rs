//! `swm board`: bundles on one page.

use std::path::PathBuf;

use clap::Args;
use swm_core::Registry;
use swm_tasks::request::{BoardMade, MakeBoard, Request as _};

use super::output::table;
use super::rates::{difference, rate};
use super::reporter::Reporter;
use super::threads::ThreadsArg;
use super::{Failure, Output, interrupt};

/// Verify bundles and write them as one static page, sorted by manifest.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm board cem-bundle lewm-bundle --out board
  swm board bundles/* --rerun --out board --title 'PushT, strict tier'

The page shows success with intervals, paired differences on each manifest, and reproduced beside reported rates where bundles have \
one. It needs no network and nothing beside it. A bundle with a changed byte is refused.

Exit status 0: written. 1: written, and with --rerun a bundle came out otherwise. 2: a bundle is damaged, or none.")]
pub(super) struct BoardCommand {
    /// The bundles, which `swm bundle` makes.
    #[arg(required = true, value_name = "BUNDLE")]
    bundles: Vec<PathBuf>,
    /// The folder to write: index.html and board.json. An earlier board is replaced.
    #[arg(long, short, value_name = "FOLDER")]
    out: PathBuf,
    /// What the page is called.
    #[arg(long, default_value_t = MakeBoard::default().title)]
    title: String,
    /// Run every bundle again, beside comparing the hashes of its files.
    #[arg(long)]
    rerun: bool,
    /// With --rerun: the oracles, too.
    #[arg(long, requires = "rerun")]
    oracle: bool,
    /// With --rerun: environments stepped in parallel; results do not depend on it.
    #[arg(long, default_value_t = MakeBoard::default().num_envs, value_name = "N")]
    num_envs: usize,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl BoardCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let threads = self.threads.count();
        let Self { bundles, out, title, rerun, oracle, num_envs, threads: _ } = self;
        let request = MakeBoard { bundles, out, title, rerun, oracle, num_envs, threads };
        let cancel = interrupt::watch(|| "no board is written; run it again".to_owned());
        let made = request.run(registry, &mut Reporter::new(output, cancel))?;
        output.result(&made, || text(&made))?;
        match made.board.differing()[..] {
            [] => Ok(()),
            ref names => Err(format!("these bundles came out otherwise: {}", names.join(", ")).into()),
        }
    }
}

fn text(made: &BoardMade) -> String {
    let mut text = String::new();
    for group in &made.board.groups {
        let rows = group.rows.iter().map(|row| {
            let test = row.test.as_ref();
            let [difference, p] = test
                .map(|test| difference(test.difference, test.interval95, test.p_value))
                .unwrap_or_default();
            let again = row.rerun.as_ref().map_or("", |rerun| if rerun.equal { "equal" } else { "differs" });
            vec![row.name.clone(), rate(&row.summary), difference, p, again.to_owned()]
        });
        let hash = group.manifest_hash.get(..12).unwrap_or_default();
        text += &format!("{}, {} tier, manifest {hash}, {} pairs\n\n", group.env, group.tier, group.pairs);
        text += &table(&["bundle", "success (95 %)", "first − this", "paired test", "run again"], rows);
        text += "\n";
    }
    if !made.board.reported.is_empty() {
        let rows = made.board.reported.iter().map(|row| {
            let reported = format!("{:.1} %", row.reported);
            vec![row.name.clone(), reported, rate(&row.summary), row.source.clone().unwrap_or_default()]
        });
        text += &format!("{}\n", table(&["bundle", "reported", "reproduced (95 %)", "source"], rows));
    }
    text + &format!("wrote {}\n", made.page.display())
}
