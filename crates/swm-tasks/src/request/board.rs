//! Bundles are verified and put on one page.

use std::path::PathBuf;

use serde::Serialize;
use swm_core::Registry;

use super::report::apart;
use super::source::claim;
use super::{Fix, Message, NUM_ENVS, Report, Request, Stage, TaskError, create_parent, must_be_given, wrong};
use crate::board::{Board, holds_board, write_board};
use crate::bundle::Bundle;
use crate::evaluation::{Role, RunOptions, Verification, verify};

swm_core::settings! {
    /// Verify bundles, and put them on one page.
    pub struct MakeBoard {
        /// The bundles' folders.
        bundles: Vec<PathBuf> = Vec::new() => "must be given",
        /// The folder to write: `index.html` and `board.json`.
        out: PathBuf = PathBuf::new() => "must be given",
        /// What the page is called.
        title: String = "Results".to_owned() => "Results",
        /// Run every bundle again, beside comparing the hashes of its files.
        rerun: bool = false,
        /// With `rerun`: the oracles, too.
        oracle: bool = false,
        /// With `rerun`: environments stepped in parallel; results do not depend on it.
        num_envs: usize = NUM_ENVS => "8",
        /// With `rerun`: threads.
        threads: Option<usize> = None => "one per core",
    }
}

/// A board that was written.
#[derive(Clone, Debug, Serialize)]
#[non_exhaustive]
pub struct BoardMade {
    /// Its page.
    pub page: PathBuf,
    /// What is on it.
    #[serde(flatten)]
    pub board: Board,
}

impl Request for MakeBoard {
    const NAME: &'static str = "board";
    type Outcome = BoardMade;

    fn check(&self, _registry: &Registry) -> Result<(), TaskError> {
        must_be_given(&[("bundles", self.bundles.is_empty()), ("out", self.out.as_os_str().is_empty())])?;
        if self.oracle && !self.rerun {
            let message = Message::about("oracle", true, "runs again what is not run again");
            return Err(message.fix(Fix::Any(vec![Fix::set("rerun", true), Fix::Leave("oracle")])).into());
        }
        if self.num_envs == 0 {
            return Err(Message::about("num_envs", 0, "use 1 to 65536").into());
        }
        let refused = |text: String| -> TaskError { Message::new(text).fix(Fix::Change("out")).into() };
        match holds_board(&self.out) {
            Ok(true) => Ok(()),
            Ok(false) => Err(refused(format!("{} holds something else than a board", self.out.display()))),
            Err(error) => Err(refused(format!("cannot read {}: {error}", self.out.display()))),
        }
    }

    fn run(&self, registry: &Registry, report: &mut dyn Report) -> Result<BoardMade, TaskError> {
        self.check(registry)?;
        let mut bundles = Vec::new();
        // All hashes before the first episode.
        for folder in &self.bundles {
            bundles.push((Bundle::open(folder).map_err(wrong)?, None));
        }
        // Before the first episode, too: what is given twice, or contradicts itself.
        Board::new(&self.title, &bundles).map_err(wrong)?;
        for (bundle, verification) in &mut bundles {
            if self.rerun {
                *verification = self.run_again(registry, bundle, report)?;
            }
        }
        let board = Board::new(&self.title, &bundles)?;
        // The page and the data of one board, also if two are written at once.
        create_parent(&self.out)?;
        let _claim = claim(&self.out)?;
        Ok(BoardMade { page: write_board(&board, &self.out)?, board })
    }
}

impl MakeBoard {
    /// What running a bundle again shows; `None` and a note where its policy is an object of another program.
    fn run_again(
        &self,
        registry: &Registry,
        bundle: &Bundle,
        report: &mut dyn Report,
    ) -> Result<Option<Verification>, TaskError> {
        let receipt = &bundle.receipt;
        if bundle.info.is_foreign {
            let name = bundle.folder.display();
            report.note(&Message::new(format!(
                "{name} is not run again: its policy is an object of the program that evaluated it"
            )));
            return Ok(None);
        }
        let references = receipt.references.iter().filter(|known| self.oracle || known.role != Role::Oracle);
        let episodes = receipt.episodes.len() + references.map(|known| known.episodes.len()).sum::<usize>();
        let name = bundle.name();
        let stage = Stage { name: &name, role: None, unit: "episodes", total: episodes as u64 };
        let progress = report.begin(&stage)?;
        progress.now(&name);
        let options = RunOptions {
            num_envs: self.num_envs,
            threads: self.threads,
            cancel: Some(report.cancel()),
            ..RunOptions::default()
        };
        let work = || verify(registry, receipt, &options, self.oracle, || progress.done(None));
        Ok(Some(apart(report, work)??))
    }
}
