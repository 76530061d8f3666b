//! `swm fetch`, and what commands print while they fetch a dataset as a whole.

use std::path::{Path, PathBuf};

use clap::Args;
use swm_files::remote::is_remote;

use super::{Failure, Output, usage};

/// Fetch a dataset that lies elsewhere, to keep it.
#[derive(Args)]
#[command(after_help = "\
Examples:
  swm fetch s3://bucket/pusht.h5 --out data/pusht.h5
  swm fetch hf://datasets/USER/REPO@main/pusht.zarr
  swm fetch 'https://host/pusht.h5?X-Amz-Signature=…' --out pusht.h5   (an address with credentials, which is not stored)

A fetch that was interrupted continues when it is started again, if nothing changed there. Every command that reads a dataset takes such \
an address too, and fetches what it reads: `swm inspect s3://bucket/pusht.zarr`.

Credentials: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, AWS_REGION, and AWS_ENDPOINT_URL for another store than \
Amazon's; HF_TOKEN.")]
pub(super) struct Fetch {
    /// Its address: https://HOST/PATH, s3://BUCKET/KEY, or hf://datasets/USER/REPO[@REVISION]/PATH.
    address: PathBuf,
    /// The file or folder to write. Default: its own name, in the current folder.
    #[arg(long, short, value_name = "PATH")]
    out: Option<PathBuf>,
}

impl Fetch {
    pub(super) fn run(self, output: &Output) -> Result<(), Failure> {
        if !is_remote(&self.address) {
            let address = self.address.display();
            return Err(usage(format!(
                "{address} is no address of a dataset that lies elsewhere; write https://…, s3://… or hf://datasets/…"
            )));
        }
        fetch(&self.address, self.out.as_deref(), output)
    }
}

#[cfg(feature = "remote")]
fn fetch(address: &Path, out: Option<&Path>, output: &Output) -> Result<(), Failure> {
    use serde_json::json;
    use swm_files::remote::{self, RemoteErrorKind as Kind};
    use swm_tasks::request::create_parent;

    use super::output::counted;

    if let Some(out) = out {
        create_parent(out)?;
    }
    let fetched = remote::fetch(address, out).map_err(|error| {
        let text = if error.name.is_empty() { error.to_string() } else { format!("{}: {error}", error.name) };
        match error.kind {
            Kind::Address | Kind::Missing | Kind::Denied => usage(text.replace("by `out`", "by --out")),
            _ => Failure::from(text),
        }
    })?;
    let result =
        json!({"name": fetched.name, "path": fetched.path, "bytes": fetched.bytes, "files": fetched.files});
    output.result(&result, || {
        let (files, path) = (counted(fetched.files, "file"), fetched.path.display());
        format!("{path}: {files}, {}", size(fetched.bytes))
    })
}

#[cfg(not(feature = "remote"))]
fn fetch(_address: &Path, _out: Option<&Path>, _output: &Output) -> Result<(), Failure> {
    let (feature, command) = crate::absent::REMOTE;
    Err(usage(format!("`swm fetch` needs the feature `{feature}`, which this build lacks; {command}")))
}

/// Prints what is fetched as a whole, and its size, before it is; then how far it is.
#[cfg(feature = "remote")]
pub(super) fn watch(output: &Output) {
    use std::sync::{Mutex, PoisonError};

    use indicatif::ProgressBar;
    use swm_files::remote::Event;

    let output = output.clone();
    let bar: Mutex<Option<ProgressBar>> = Mutex::new(None);
    swm_files::remote::watch(move |event| {
        let mut bar = bar.lock().unwrap_or_else(PoisonError::into_inner);
        match event {
            Event::Begin { name, bytes, done, to } => {
                let part =
                    if *done > 0 { format!(", of which {} are here", size(*done)) } else { String::new() };
                output.note(format!("fetching {name}: {}{part}, to {}", size(*bytes), to.display()));
                let new = output.bar(*bytes, "bytes");
                new.set_position(*done);
                *bar = Some(new);
            }
            Event::More(count) => {
                if let Some(bar) = &*bar {
                    bar.inc(*count);
                }
            }
            _ => {
                if let Some(bar) = bar.take() {
                    bar.finish_and_clear();
                }
            }
        }
    });
}

/// Bytes, for people.
#[cfg(feature = "remote")]
fn size(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_no_address() {
        let fetch = Fetch { address: "data/pusht.h5".into(), out: None };
        let refused = fetch.run(&Output::new(false, true)).unwrap_err();
        assert_eq!(refused.exit_code(), 2);
        assert!(refused.to_string().contains("write https://"), "{refused}");
        let fetch = Fetch { address: "http://example.org/x.h5".into(), out: None };
        assert_eq!(fetch.run(&Output::new(false, true)).unwrap_err().exit_code(), 2);
    }
}
