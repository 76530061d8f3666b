//! One page that a person wants to look at: results with intervals, outcomes pair by pair, factors, videos beside their goals,
//! plans, receipts. A single HTML file without scripts or styles from elsewhere; every chart is also a table.

mod charts;
mod page;
mod receipts;
mod replay;
mod sections;

use std::path::Path;

use swm_core::Registry;
use swm_core::error::BoxError;
use swm_media::Format;

use crate::evaluation::{Receipt, SWEEP_VERSION, Sweep, is_sweep, read_receipt};

pub use charts::heat_map as sweep_figure;

/// What a report shows.
pub enum Item {
    /// A policy on a manifest.
    Receipt(Box<Receipt>),
    /// A policy under changed factors.
    Sweep(Box<Sweep>),
}

/// What is made for a page beside what its results hold.
#[derive(Clone, Copy, Debug)]
pub struct PageOptions {
    /// Videos of successes, and as many of failures, per result; 0: none is run again.
    pub videos: usize,
    /// Their format.
    pub format: Format,
    /// Plans drawn per recorded episode.
    pub plans: usize,
}

impl Item {
    /// Reads a receipt or a sweep, from its file or the folder that it lies in.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or is neither a receipt nor a sweep of a known version.
    pub fn read(path: &Path) -> Result<Self, BoxError> {
        let sweep = if path.is_dir() { path.join("sweep.json") } else { path.to_owned() };
        let json: Option<serde_json::Value> =
            std::fs::read_to_string(&sweep).ok().and_then(|text| serde_json::from_str(&text).ok());
        match json {
            Some(json) if is_sweep(&json) => {
                let wrong = |reason: String| format!("sweep {}: {reason}", sweep.display());
                let found: Sweep = serde_json::from_value(json).map_err(|error| wrong(error.to_string()))?;
                if found.sweep != SWEEP_VERSION {
                    let reason = format!("has version {}, this program reads {SWEEP_VERSION}", found.sweep);
                    return Err(wrong(reason).into());
                }
                Ok(Item::Sweep(Box::new(found)))
            }
            _ => Ok(Item::Receipt(Box::new(read_receipt(path)?))),
        }
    }
}

/// Writes the page of `items` to `path`; some episodes of each receipt are run again, for their videos. Returns notes for
/// people: what could not be shown, and why.
///
/// # Errors
///
/// An episode cannot be run again, or the page cannot be written.
pub fn write_page(
    registry: &Registry,
    path: &Path,
    items: &[Item],
    options: PageOptions,
    mut each: impl FnMut(&str),
) -> Result<Vec<String>, BoxError> {
    let (mut shown, mut notes) = (Vec::new(), Vec::new());
    for item in items {
        if let Item::Receipt(receipt) = item {
            each(&receipt.policy);
            let replayed = if options.videos > 0 {
                replay::replay(registry, receipt, options, &mut notes)?
            } else {
                replay::Replayed::default()
            };
            shown.push((&**receipt, replayed));
        }
    }
    let sweeps: Vec<&Sweep> = items
        .iter()
        .filter_map(|item| match item {
            Item::Sweep(sweep) => Some(&**sweep),
            Item::Receipt(_) => None,
        })
        .collect();
    let html = page::draw(&shown, &sweeps)?;
    std::fs::write(path, html).map_err(|error| format!("cannot write {}: {error}", path.display()))?;
    Ok(notes)
}
