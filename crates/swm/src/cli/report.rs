//! `swm report`: results as a page.

use std::path::PathBuf;

use clap::Args;
use swm_core::Registry;
use swm_media::Format;
use swm_tasks::request::create_parent;

use super::output::claim;
use super::threads::ThreadsArg;
use super::{Failure, Output, usage};
use crate::report_page::{Item, PageOptions, is_page, write_page};

/// Write results as one self-contained HTML page.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm report results/cem results/mppi sweep --out report.html
  swm report results/cem/receipt.json --videos 0 --out report.html
  swm report cem-bundle zoo:tworoom-gcbc --out report.html

RESULT is what `swm eval --manifest … --out`, `swm sweep --out` and `swm bundle --out` write, or `zoo:NAME`, a model of the zoo. Some episodes are run again to record videos. A page that \
an earlier `swm report` wrote is written anew: it holds nothing but what the results hold. Any other file is kept.")]
pub(super) struct ReportCommand {
    /// Receipts and sweeps, or the folders that hold them; bundles; models of the zoo, zoo:NAME.
    #[arg(required = true, value_name = "RESULT")]
    results: Vec<PathBuf>,
    /// The page to write.
    #[arg(long, short, value_name = "FILE")]
    out: PathBuf,
    /// Videos of successes, and as many of failures, per result.
    #[arg(long, default_value_t = PageOptions::default().videos)]
    videos: usize,
    /// Kind of video. Default: mp4 where this build can make it.
    #[arg(long, value_parser = ["mp4", "gif"])]
    video_format: Option<String>,
    /// Plans shown of the first success and the first failure of a planner.
    #[arg(long, default_value_t = PageOptions::default().plans)]
    plans: usize,
    /// Replace a file that is no report.
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    threads: ThreadsArg,
}

impl ReportCommand {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let format = match self.video_format.as_deref() {
            Some("gif") => Format::Gif,
            None => PageOptions::default().format,
            _ if Format::Mp4.is_built() => Format::Mp4,
            _ => {
                return Err(usage(
                    "this build has no MP4 encoder; use --video-format gif, or build with the feature `mp4`",
                ));
            }
        };
        if self.out.extension().is_none_or(|extension| extension != "html" && extension != "htm") {
            let out = self.out.display();
            return Err(usage(format!(
                "--out {out}: the report is a page; write --out {}",
                self.out.with_extension("html").display()
            )));
        }
        let items: Vec<Item> =
            self.results.iter().map(|path| Item::read(path).map_err(usage)).collect::<Result<_, _>>()?;
        create_parent(&self.out)?;
        let _claim = claim(&self.out)?;
        self.check_out()?;
        let bar = output.bar(items.len() as u64, "results");
        let options = PageOptions { videos: self.videos, format, plans: self.plans };
        let notes = write_page(registry, &self.out, &items, options, |policy| {
            bar.inc(1);
            bar.set_message(policy.to_owned());
        });
        bar.finish_and_clear();
        let notes = notes?;
        for note in &notes {
            output.note(note);
        }
        let json = serde_json::json!({ "page": self.out, "notes": notes });
        output.result(&json, || format!("wrote {}\n", self.out.display()))
    }

    /// Refuses to replace what is no report.
    fn check_out(&self) -> Result<(), Failure> {
        let out = self.out.display();
        match is_page(&self.out) {
            _ if self.out.is_dir() => {
                Err(usage(format!("--out {out} is a folder; name the file of the page")))
            }
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
            Ok(true) => Ok(()),
            _ if self.overwrite => Ok(()),
            _ => Err(usage(format!(
                "{out} exists and is no report; give another --out, or --overwrite to replace it"
            ))),
        }
    }
}
