//! Factors for people: a tree for terminals and a Markdown table for pages.

use std::fmt;

use swm_core::FactorSpec;

use crate::factor::FovSpace;

/// A Markdown table of factors: name, kind, bounds, default, what it does. Names of choices follow what a factor does, unless its
/// description has them.
pub fn markdown(factors: &[FactorSpec]) -> String {
    let mut table =
        String::from("| factor | kind | bounds | default | what it does |\n|---|---|---|---|---|\n");
    for factor in factors {
        let FactorSpec { name, default, .. } = factor;
        let mut doc = factor.doc.clone();
        if !factor.choices.iter().all(|choice| mentions(&doc, choice)) {
            let name = |at: i64| factor.choice_name(at).map(|name| format!("{at} {name}"));
            let first = factor.space.bounds().0.first().map_or(0, |&first| first as i64);
            let names: Vec<String> = (first..).map_while(name).collect();
            doc += &format!(": {}", names.join(", "));
        }
        if let Some(words) = &factor.constraint {
            doc += &format!("; must be {words}");
        }
        let sampled = if factor.sampled_by_default { " (sampled by default)" } else { "" };
        table +=
            &format!("| `{name}` | {} | {} | {default} | {doc}{sampled} |\n", kind(factor), bounds(factor));
    }
    table
}

/// Whether `text` has `name` as words of its own.
fn mentions(text: &str, name: &str) -> bool {
    let is_apart = |at: usize| {
        let (before, behind) = (text[..at].chars().next_back(), text[at + name.len()..].chars().next());
        ![before, behind].into_iter().flatten().any(char::is_alphanumeric)
    };
    text.match_indices(name).any(|(at, _)| is_apart(at))
}

/// A tree by groups.
impl fmt::Display for FovSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut specs = self.specs();
        specs.sort_by(|a, b| a.name.cmp(&b.name));
        let mut group = "";
        for spec in &specs {
            let (parent, leaf) = spec.name.rsplit_once('.').unwrap_or(("", &spec.name));
            if parent != group {
                writeln!(f, "{parent}")?;
                group = parent;
            }
            let indent = if parent.is_empty() { "" } else { "  " };
            write!(f, "{indent}{leaf}: {} {}, default {}", kind(spec), bounds(spec), spec.default)?;
            writeln!(f, "{}", if spec.sampled_by_default { " *" } else { "" })?;
        }
        Ok(())
    }
}

fn kind(spec: &FactorSpec) -> String {
    match spec.space.shape().as_slice() {
        [] => spec.space.kind().to_owned(),
        shape => format!("{} {shape:?}", spec.space.kind()),
    }
}

/// `low..high`, short where all elements agree.
fn bounds(spec: &FactorSpec) -> String {
    let short = |values: &[f64]| {
        // Decimals that a reader needs: small numbers have more.
        let decimals = |v: f64| if v.abs() < 0.1 { 1e6 } else { 1e4 };
        let text = |v: f64| format!("{}", (v * decimals(v)).round() / decimals(v));
        match values {
            [first, rest @ ..] if rest.iter().all(|v| v == first) => text(*first),
            values => format!("({})", values.iter().map(|&v| text(v)).collect::<Vec<_>>().join(", ")),
        }
    };
    let (low, high) = spec.space.bounds();
    format!("{}..{}", short(&low), short(&high))
}
