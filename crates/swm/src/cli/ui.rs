//! `swm ui`: the local web page.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use clap::Args;
use serde_json::{Value as Json, json};
use swm_core::error::BoxError;
use swm_core::{Registry, WorldError};
use swm_ui::{Commands, Server};

use super::jobs::ask;
use super::{Failure, Output, interrupt, usage, work};
use crate::jobs::{QueueState, Status};

/// Steer and record environments, and look at datasets and results, on a page in the browser.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm ui                                  (environments only)
  swm ui pusht.h5 results runs jobs       (with these datasets, results, training runs and jobs)
  swm ui data --save recordings           (record what you steer into this folder, and manifests of pairs that you pick)
  ssh -L 8000:127.0.0.1:8000 cluster swm ui --port 8000 --no-open runs    (a page of another machine)

The address that is printed works once: the browser that opens it first keeps a cookie. The page is served to this machine only; \
--host NAME serves it by that name. Only files below PATH are read, only the folder of --save is written to.")]
pub(super) struct Ui {
    /// Datasets, results, training runs, jobs, or folders that hold them.
    #[arg(value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// The folder for recordings and manifests. Default: nothing is written.
    #[arg(long, value_name = "DIR")]
    save: Option<PathBuf>,
    /// The name or address by which browsers reach this machine.
    #[arg(long, default_value = "127.0.0.1", value_name = "NAME")]
    host: String,
    /// The port; 0: a free one.
    #[arg(long, default_value_t = 0, value_name = "P")]
    port: u16,
    /// Open no browser.
    #[arg(long)]
    no_open: bool,
    /// End after so many minutes without a request and an open environment; 0: never.
    #[arg(long, default_value_t = 120, value_name = "MINUTES")]
    idle: u64,
    /// Environments that are open at once.
    #[arg(long, default_value_t = 4, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=64))]
    max_sessions: u8,
    /// A page that may show this one in a frame, such as a notebook: `http://localhost:8888`. The host must be the same.
    #[arg(long, value_name = "ORIGIN")]
    frame_from: Option<String>,
}

impl Ui {
    pub(super) fn run(self, registry: &Registry, output: &Output) -> Result<(), Failure> {
        let mut options = swm_ui::Options::new(registry.clone());
        options.commands = Some(Arc::new(Own::default()));
        options.paths = self.paths;
        options.save = self.save;
        options.host = self.host;
        options.port = self.port;
        options.idle = (self.idle > 0).then(|| Duration::from_secs(60 * self.idle));
        options.max_sessions = self.max_sessions.into();
        options.frame_from = self.frame_from;
        let server = Server::bind(options).map_err(usage)?;
        let url = server.url();
        output.result(&json!({ "url": url }), || format!("open {url}"))?;
        output.note("Ctrl-C ends the server; the address works once");
        if !self.no_open {
            open_browser(&url);
        }
        // The server itself waits so long for recordings.
        interrupt::allow(swm_ui::SAVING + Duration::from_secs(1));
        let cancel = interrupt::watch(|| "the page is closed; what was recorded is in its files".to_owned());
        let interrupted = cancel.clone();
        let stop = server.stopper();
        std::thread::spawn(move || {
            while !cancel.is_cancelled() {
                std::thread::sleep(Duration::from_millis(20));
            }
            stop.cancel();
        });
        server.run()?;
        if interrupted.is_cancelled() { Err(WorldError::Cancelled.into()) } else { Ok(()) }
    }
}

/// What other commands do, for the page. It remembers what engines held of jobs, by folder, and a note where one did not answer.
#[derive(Debug, Default)]
struct Own(Mutex<BTreeMap<PathBuf, (QueueState, Option<String>)>>);

impl Commands for Own {
    /// What `swm jobs DIR --json` prints, and its note.
    fn job(&self, registry: &Registry, dir: &Path) -> Result<Json, BoxError> {
        let folder = work::open(registry, dir).map_err(Failure::from).map_err(Failure::into_source)?;
        let folder = folder.ok_or_else(|| format!("{} holds no job", dir.display()))?;
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let ask = || {
            let mut note = None;
            (ask(&folder, |text| note = Some(text)), note)
        };
        let (held, note) = match all.remove(dir) {
            Some(known) if !known.0.is_old() => known,
            _ => ask(),
        };
        let mut json = Status::of(registry, &folder, &held)?.json();
        json["note"] = note.clone().into();
        all.insert(dir.to_owned(), (held, note));
        Ok(json)
    }
}

/// Opens the default browser, where there is one: on a machine without a display nothing happens.
fn open_browser(url: &str) {
    let program = match std::env::consts::OS {
        "macos" => "open",
        "windows" => "explorer",
        _ if std::env::var_os("DISPLAY").is_none() && std::env::var_os("WAYLAND_DISPLAY").is_none() => return,
        _ => "xdg-open",
    };
    // The address is printed, too, for where this fails.
    let _ = Command::new(program)
        .arg(url)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
}
