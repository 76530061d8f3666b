//! One page for results: success with intervals, outcomes pair by pair, factors, videos next to their goals, plans, receipts.
//! A single HTML file without scripts or styles from elsewhere; every chart is also a table.

mod charts;
mod labels;
mod receipts;
mod replay;
mod results;

use std::path::{Path, PathBuf};

use minijinja::value::Serde;
use minijinja::{Value, context};
use swm_core::Registry;

use crate::bundle::receipt_to_repeat;
use crate::error::{TaskError, cannot};
use crate::evaluation::{Candidate, Code, Receipt, SWEEP_VERSION, Sweep, changed_model, edited, is_sweep};
use crate::html;
use crate::plan::PlanFigure;
use crate::text_file::{json_error, read_text, replace_text};
use crate::zoo;
use labels::{Label, labels};
use replay::{Replayed, VideoCard, replay};

pub use charts::heat_map as sweep_figure;
pub use replay::PageOptions;

/// A result that a report shows.
pub struct Item {
    /// The path that it was read from.
    path: PathBuf,
    content: Content,
}

enum Content {
    /// A policy on a manifest.
    Receipt(Box<Receipt>),
    /// A policy under changed factors.
    Sweep(Box<Sweep>),
}

impl Item {
    /// Reads a receipt or a sweep, from its file or the folder that it lies in: of a bundle or a model of the zoo (`zoo:NAME`), with the
    /// model by its path there.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or is neither a receipt nor a sweep of a known version; a file of a bundle was changed; the zoo has no such
    /// model.
    pub fn read(path: &Path) -> Result<Self, TaskError> {
        let in_zoo = path.to_str().and_then(|text| text.strip_prefix("zoo:")).filter(|_| !path.exists());
        let found = in_zoo.map_or_else(|| Ok(path.to_owned()), zoo::find)?;
        let sweep = if found.is_dir() { found.join("sweep.json") } else { found.clone() };
        let text = read_text(&sweep).ok();
        let json: Option<serde_json::Value> = text.as_ref().and_then(|text| serde_json::from_str(text).ok());
        let content = match json {
            Some(json) if is_sweep(&json) => {
                let wrong = |reason: String| format!("sweep {}: {reason}", sweep.display());
                let text = text.unwrap_or_default();
                let found: Sweep =
                    serde_json::from_str(&text).map_err(|error| wrong(json_error(&text, &error)))?;
                if found.sweep != SWEEP_VERSION {
                    let reason = format!("has version {}, this program reads {SWEEP_VERSION}", found.sweep);
                    return Err(wrong(reason).into());
                }
                Content::Sweep(Box::new(found))
            }
            _ => {
                let (receipt, _) = receipt_to_repeat(&found)?;
                if let Some(reason) = edited(&receipt) {
                    let path = path.display();
                    return Err(format!(
                        "receipt {path}: {reason}; it was edited or damaged; evaluate again"
                    )
                    .into());
                }
                Content::Receipt(Box::new(receipt))
            }
        };
        Ok(Self { path: path.to_owned(), content })
    }

    fn candidate(&self) -> &Candidate {
        match &self.content {
            Content::Receipt(receipt) => &receipt.candidate,
            Content::Sweep(sweep) => &sweep.candidate,
        }
    }
}

/// What a page names as its maker, in its head.
const GENERATOR: &str = "swm report";

/// Whether the file at `path` is a page of [`write_page`], which may be written anew: it can be made again from the results that
/// it shows, and nothing refers to it.
///
/// # Errors
///
/// The file cannot be read.
pub fn is_page(path: &Path) -> std::io::Result<bool> {
    use std::io::Read as _;

    // The head is at the beginning; a page with videos is large.
    let mut head = Vec::new();
    std::fs::File::open(path)?.take(4096).read_to_end(&mut head)?;
    let maker = format!("<meta name=\"generator\" content=\"{GENERATOR}\">");
    Ok(String::from_utf8_lossy(&head).contains(&maker))
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
) -> Result<Vec<String>, TaskError> {
    let named: Vec<(&Path, &Candidate)> =
        items.iter().map(|item| (item.path.as_path(), item.candidate())).collect();
    let mut labels = labels(&named);
    for (item, label) in items.iter().zip(&mut labels) {
        if let Content::Receipt(receipt) = &item.content {
            label.warning = changed_model(registry, receipt);
        }
    }
    let (mut receipts, mut sweeps, mut replayed, mut notes) =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (item, label) in items.iter().zip(&labels) {
        match &item.content {
            Content::Receipt(receipt) => {
                each(&label.name);
                receipts.push((&**receipt, label));
                if let Some(warning) = &label.warning {
                    let shown = if options.videos > 0 {
                        "; videos and plans, which it would make now, are left out"
                    } else {
                        ""
                    };
                    notes.push(format!("{}: {warning}{shown}", label.name));
                } else if options.videos > 0 {
                    replayed.push((label, replay(registry, receipt, options, &mut notes)?));
                }
            }
            Content::Sweep(sweep) => sweeps.push((&**sweep, label)),
        }
    }
    let mut envs: Vec<&str> = receipts.iter().map(|(receipt, _)| receipt.manifest.env.as_str()).collect();
    envs.extend(sweeps.iter().map(|(sweep, _)| sweep.env.as_str()));
    envs.sort_unstable();
    envs.dedup();
    let envs = envs.join(", ");
    let tabs = [
        ("overview", !receipts.is_empty()),
        ("episodes", !receipts.is_empty()),
        ("factors", !sweeps.is_empty()),
        ("videos", replayed.iter().any(|(_, replayed)| !replayed.videos.is_empty())),
        ("plans", replayed.iter().any(|(_, replayed)| !replayed.plans.is_empty())),
        ("receipts", true),
    ];
    let page = context! {
        generator => GENERATOR,
        title => format!("Evaluation: {envs}"),
        envs,
        lead => lead(&receipts, !sweeps.is_empty()),
        version => Code::this().version,
        tabs => tabs.iter().filter(|(_, shown)| *shown).map(|(tab, _)| *tab).collect::<Vec<_>>(),
        groups => results::groups(&receipts),
        sweeps => sweeps.iter().map(sweep_context).collect::<Vec<_>>(),
        replayed => replayed.iter().map(replayed_context).collect::<Vec<_>>(),
        saved => receipts::saved(&receipts, &sweeps)?,
    };
    let html = html::render("report.html", page)?;
    replace_text(path, &html).map_err(cannot("write", path))?;
    Ok(notes)
}

/// One sentence on what the page is about.
fn lead(receipts: &[(&Receipt, &Label)], has_sweeps: bool) -> String {
    let mut parts = Vec::new();
    if let Some((first, _)) = receipts.first() {
        let count = receipts.len();
        let policies = if count == 1 { "One policy".to_owned() } else { format!("{count} results") };
        let same = receipts.iter().all(|(receipt, _)| receipt.manifest_hash == first.manifest_hash);
        parts.push(if same {
            format!(
                "{policies} on {} pairs of the {} tier, up to {} {} each. Success: {}.",
                first.episodes.len(),
                first.manifest.tier.name(),
                first.manifest.budget,
                if first.manifest.budget == 1 { "action" } else { "actions" },
                first.manifest.success.describe(),
            )
        } else {
            format!("{policies} on several manifests: rates of different manifests cannot be compared.")
        });
    }
    if has_sweeps {
        parts.push("Robustness under changed factors of variation.".to_owned());
    }
    parts.join(" ")
}

fn sweep_context((sweep, label): &(&Sweep, &Label)) -> Value {
    let cells = sweep.cells.iter().map(|cell| {
        let (summary, test) = (cell.summary.as_ref(), cell.test.as_ref());
        context! {
            name => &cell.name, value => &cell.value, note => cell.note.as_deref(),
            rate => summary.map(|summary| summary.success_rate),
            interval => summary.map(|summary| summary.ci95.to_vec()),
            difference => test.map(|test| test.difference), p_value => test.map(|test| test.p_value),
        }
    });
    let (cells, chart) = (cells.collect::<Vec<_>>(), Value::from_safe_string(sweep_figure(sweep)));
    context! { cells, chart, ..label.context() }
}

fn replayed_context((label, replayed): &(&Label, Replayed)) -> Value {
    let plans = replayed.plans.iter().map(|(pair, success, figures)| {
        context! {
            pair, success, costs => Value::from_safe_string(figures.costs.clone()), table => Serde(&figures.table),
            plans => figures.plans.iter().map(PlanFigure::context).collect::<Vec<_>>(),
        }
    });
    let videos = replayed.videos.iter().map(VideoCard::context).collect::<Vec<_>>();
    context! { videos, plans => plans.collect::<Vec<_>>(), ..label.context() }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use swm_core::evaluate::{EpisodeResult, ManifestOptions, make_manifest};
    use swm_core::testing::TOY;
    use swm_core::{EnvConfig, PolicyArgs, PolicyEntry, policies};

    use super::*;
    use crate::evaluation::fingerprints;

    /// A policy whose model is the file that its argument names.
    static MODELS: [PolicyEntry; 1] =
        [PolicyEntry::new("of-file", "acts at random", |_, _| Ok(Box::new(policies::random())))];

    #[test]
    fn a_result_of_a_model_that_was_trained_since_is_marked() {
        let folder = tempfile::tempdir().unwrap();
        let (weights, page) = (folder.path().join("weights"), folder.path().join("page.html"));
        std::fs::write(&weights, "100 steps").unwrap();
        let registry = Registry::new().with(&[TOY]).with(&MODELS);
        let entry = registry.env(TOY.id).unwrap();
        let options = ManifestOptions { pairs: 1, budget: 2, ..ManifestOptions::default() };
        let manifest = make_manifest(entry, &EnvConfig::default(), &options, None).unwrap();
        let policy = PolicyArgs::parse(&format!("of-file:{}", weights.display())).unwrap();
        let candidate = Candidate::new(policy);
        let files = candidate.files(&registry, entry).unwrap();
        let prints = fingerprints(entry, &manifest, 0).unwrap();
        let of = |files: &BTreeMap<String, String>| {
            let receipt = Receipt::new(
                manifest.clone(),
                candidate.clone(),
                "of-file".to_owned(),
                files.clone(),
                prints.clone(),
                1,
            )
            .with_results(vec![EpisodeResult::default()], Vec::new(), 1.0);
            Item { path: folder.path().to_owned(), content: Content::Receipt(Box::new(receipt)) }
        };
        let written = |item: Item| {
            let options = PageOptions { videos: 1, plans: 0, format: swm_media::Format::Gif };
            let notes = write_page(&registry, &page, &[item], options, |_| {}).unwrap();
            (notes, std::fs::read_to_string(&page).unwrap())
        };
        assert_eq!(files.len(), 1);
        let (notes, html) = written(of(&files));
        assert!(!html.contains("since this result") && html.contains("data:image/gif"), "{notes:?}");
        std::fs::write(&weights, "200 steps").unwrap();
        let (notes, html) = written(of(&files));
        let warning = "The model has changed since this result";
        assert!(
            notes.len() == 1 && notes[0].contains(warning) && notes[0].contains("evaluate again"),
            "{notes:?}"
        );
        assert!(html.contains(&format!("<strong>{warning}")), "the page says it too");
        assert!(!html.contains("data:image/gif"), "a video would be of the newer model");
        let (notes, html) = written(of(&BTreeMap::new()));
        assert!(!html.contains("since this result"), "no model: {notes:?}");
    }
}
