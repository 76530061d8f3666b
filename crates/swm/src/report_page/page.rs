//! The page around the sections: title, tabs, styles, script.

use std::fmt::Write as _;

use swm_core::error::BoxError;

use super::replay::Replayed;
use super::{receipts, sections};
use crate::evaluation::{Code, Receipt, Sweep};
use crate::svg::escape;

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// The whole page.
pub(super) fn draw(receipts: &[(&Receipt, Replayed)], sweeps: &[&Sweep]) -> Result<String, BoxError> {
    let mut tabs: Vec<(&str, &str, String)> = Vec::new();
    if !receipts.is_empty() {
        tabs.push(("overview", "Overview", sections::overview(receipts)));
        tabs.push(("episodes", "Episodes", sections::episodes(receipts)));
    }
    if !sweeps.is_empty() {
        tabs.push(("factors", "Factors", sections::factors(sweeps)));
    }
    if receipts.iter().any(|(_, replayed)| !replayed.videos.is_empty()) {
        tabs.push(("videos", "Videos", sections::videos(receipts)));
    }
    if receipts.iter().any(|(_, replayed)| !replayed.plans.is_empty()) {
        tabs.push(("plans", "Plans", sections::plans(receipts)));
    }
    tabs.push(("receipts", "Receipts", receipts::tab(receipts, sweeps)?));
    let envs: Vec<&str> = receipts
        .iter()
        .map(|(receipt, _)| receipt.manifest.env.as_str())
        .chain(sweeps.iter().map(|sweep| sweep.env.as_str()))
        .collect();
    let mut named = envs.clone();
    named.sort_unstable();
    named.dedup();
    let title = named.join(", ");
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>Evaluation: {title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
         <header>\n<h1>{title}</h1>\n<p>{}</p>\n</header>\n<nav><div role=\"tablist\" aria-label=\"Parts of the report\">\n",
        lead(receipts, sweeps),
        title = escape(&title),
    );
    for (id, name, _) in &tabs {
        let _ = writeln!(
            html,
            "<button role=\"tab\" id=\"tab-{id}\" aria-controls=\"{id}\" aria-selected=\"false\">{name}</button>"
        );
    }
    html += "</div></nav>\n<main>\n";
    for (id, _, content) in &tabs {
        let _ = writeln!(
            html,
            "<section role=\"tabpanel\" id=\"{id}\" aria-labelledby=\"tab-{id}\">\n{content}</section>"
        );
    }
    let code = Code::this();
    let _ = write!(
        html,
        "</main>\n<footer>stable-worldmodel {}. This page needs no network.</footer>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n",
        escape(&code.version)
    );
    Ok(html)
}

/// One sentence on what the page is about.
fn lead(receipts: &[(&Receipt, Replayed)], sweeps: &[&Sweep]) -> String {
    let mut parts = Vec::new();
    if let Some((first, _)) = receipts.first() {
        let count = receipts.len();
        let policies = if count == 1 { "One policy".to_owned() } else { format!("{count} results") };
        let same = receipts.iter().all(|(receipt, _)| receipt.manifest_hash == first.manifest_hash);
        parts.push(if same {
            format!(
                "{policies} on {} pairs of the {} tier, up to {} actions each. Success: {}.",
                first.episodes.len(),
                first.manifest.tier.name(),
                first.manifest.budget,
                escape(&first.manifest.success.describe()),
            )
        } else {
            format!("{policies} on several manifests: rates of different manifests cannot be compared.")
        });
    }
    if !sweeps.is_empty() {
        parts.push("Robustness under changed factors of variation.".to_owned());
    }
    parts.join(" ")
}
