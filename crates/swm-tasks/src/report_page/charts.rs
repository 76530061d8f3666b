//! The charts of a report, as SVG that follows the page's colors.

use std::collections::BTreeSet;

use crate::evaluation::{Cell, Scope, Sweep};
use crate::svg::{Anchor, Entry, Frame, Grid, Mark, Svg, ticks, whole_ticks};

/// A line of the chart of success over steps.
pub(super) struct Curve<'a> {
    pub(super) name: &'a str,
    /// First successful steps.
    pub(super) steps: Vec<u64>,
    /// Of so many episodes.
    pub(super) episodes: usize,
    pub(super) is_reference: bool,
}

impl Curve<'_> {
    /// Percent of the episodes that have succeeded by `step`.
    pub(super) fn share(&self, step: u64) -> f64 {
        let done = self.steps.iter().filter(|&&first| first <= step).count();
        100.0 * done as f64 / self.episodes.max(1) as f64
    }
}

/// Color and dash of each curve: two colors for candidates, gray for reference policies, and a dash for each round of them.
fn looks(curves: &[Curve<'_>]) -> Vec<(&'static str, &'static str)> {
    const DASHES: [&str; 3] = [
        "stroke-width=\"2.2\"",
        "stroke-width=\"2.2\" stroke-dasharray=\"6 4\"",
        "stroke-width=\"2.2\" stroke-dasharray=\"2 4\"",
    ];
    let (mut candidates, mut references) = (0, 0);
    let look = |curve: &Curve<'_>| {
        let count = if curve.is_reference { &mut references } else { &mut candidates };
        let (class, round) =
            if curve.is_reference { ("c", *count) } else { (["a", "b"][*count % 2], *count / 2) };
        *count += 1;
        (class, DASHES[round % DASHES.len()])
    };
    curves.iter().map(look).collect()
}

/// The share of episodes that have succeeded by each step.
pub(super) fn curves(curves: &[Curve<'_>], budget: u64) -> String {
    let names: Vec<String> = curves.iter().map(|curve| shortened(curve.name, 44)).collect();
    let looks = looks(curves);
    let entry = |(name, &(class, style))| (Mark::Line, class, style, name);
    let legend: Vec<Entry<'_>> = names.iter().map(String::as_str).zip(&looks).map(entry).collect();
    let mut grid = Grid::new("Success by step", &legend, [480.0, 250.0], 1, 1);
    let svg = grid.cell(0);
    let frame =
        Frame { at: [48.0, 8.0], size: [416.0, 190.0], x: [0.0, budget.max(1) as f64], y: [0.0, 100.0] };
    frame.axes(svg, &whole_ticks(frame.x, 8), &ticks(frame.y, 5));
    for (curve, &(class, style)) in curves.iter().zip(&looks) {
        // Between successes the share stays, however large the budget is.
        let firsts = curve.steps.iter().copied().filter(|&step| step <= budget);
        let steps: BTreeSet<u64> = firsts.chain([0, budget]).collect();
        let points = steps.into_iter().flat_map(|step| {
            let before = curve.share(step.saturating_sub(1));
            [frame.place(step as f64, before), frame.place(step as f64, curve.share(step))]
        });
        svg.path(points, class, style);
    }
    svg.text([256.0, 234.0], Anchor::Middle, "soft", "actions taken");
    svg.upright([12.0, 103.0], "soft", "episodes successful, %");
    grid.svg.finish()
}

const NAMES: f64 = 200.0;
/// Least width of a cell, and its height.
const CELL: [f64; 2] = [104.0, 30.0];
/// About the width of a character.
const CHARACTER: f64 = 6.6;

/// Cells of a sweep: a row per factor, group and all; a column per value. Color says how far it is from the unchanged
/// environment.
pub fn heat_map(sweep: &Sweep) -> String {
    let changed: Vec<&Cell> = sweep.cells.iter().filter(|cell| cell.scope != Scope::Unchanged).collect();
    let (mut names, mut values) = (Vec::new(), Vec::new());
    for cell in &changed {
        if !names.contains(&(&cell.name, cell.scope)) {
            names.push((&cell.name, cell.scope));
        }
        if !values.contains(&&cell.value) {
            values.push(&cell.value);
        }
    }
    let base = sweep.cells.first().and_then(|cell| cell.summary.as_ref()).map_or(0.0, |s| s.success_rate);
    let longest = values.iter().map(|value| value.chars().count()).max().unwrap_or(0);
    let width = CELL[0].max(CHARACTER * longest as f64 + 12.0);
    let cells = width * values.len() as f64;
    let mut svg = Svg::new("Success under changed factors");
    let widths = [(NAMES + cells + 24.0).max(560.0), (cells + 8.0).max(360.0)];
    let unchanged = format!("unchanged: {base:.1} %");
    let square = "rx=\"2\" fill-opacity=\".7\"";
    let ends = svg.legend(
        &[
            (Mark::Square, "bg", "rx=\"2\" stroke=\"#8a93a5\"", &unchanged),
            (Mark::Square, "fb", square, "worse than unchanged"),
            (Mark::Square, "fa", square, "better"),
            (Mark::Dot, "fink", "", "difference with p < 0.05"),
        ],
        widths,
    );
    // On narrow screens a name stands above its cells.
    let tops = [ends[0] + 26.0, ends[1] + 26.0];
    let heights = [CELL[1], CELL[1] + 20.0];
    svg.at([NAMES, tops[0] - 10.0], [4.0, tops[1] - 10.0]);
    for (column, value) in values.iter().enumerate() {
        svg.text([width * (column as f64 + 0.5), 0.0], Anchor::Middle, "soft", value);
    }
    for (row, (name, scope)) in names.iter().enumerate() {
        let [wide, narrow] = [0, 1].map(|layout| tops[layout] + heights[layout] * row as f64);
        svg.at([16.0, wide + 19.0], [4.0, narrow + 14.0]);
        svg.text([0.0; 2], Anchor::Start, if *scope == Scope::Factor { "" } else { "strong" }, name);
        svg.at([NAMES, wide], [4.0, narrow + 20.0]);
        for cell in changed.iter().filter(|cell| cell.name == **name && cell.scope == *scope) {
            let column = values.iter().position(|value| **value == cell.value).unwrap_or(0);
            heat_cell(&mut svg, [width * column as f64, width], cell, base);
        }
    }
    svg.resize(
        [0, 1].map(|layout| [widths[layout], tops[layout] + heights[layout] * names.len() as f64 + 14.0]),
    );
    svg.finish()
}

/// One cell, `x` to the right.
fn heat_cell(svg: &mut Svg, [x, width]: [f64; 2], cell: &Cell, base: f64) {
    let middle = [x + width / 2.0, 19.0];
    let Some(summary) = &cell.summary else {
        return svg.text(middle, Anchor::Middle, "soft", "–");
    };
    let difference = summary.success_rate - base;
    let fill = if difference < 0.0 { "fb" } else { "fa" };
    let strength = 0.04 + 0.66 * (difference.abs() / 100.0).min(1.0).sqrt();
    let style = format!("rx=\"4\" fill-opacity=\"{strength:.2}\"");
    svg.rect([x + 1.5, 1.5], [width - 3.0, CELL[1] - 3.0], fill, &style);
    svg.text(middle, Anchor::Middle, "", &format!("{:.1} %", summary.success_rate));
    if cell.test.as_ref().is_some_and(|test| test.p_value < 0.05) {
        svg.dot([x + width - 12.0, 10.0], 2.6, "fink", "");
    }
}

/// The end cut off, with a mark, where a text is too long.
fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_policies_are_gray_and_no_two_curves_look_alike() {
        let curve = |is_reference| Curve { name: "", steps: Vec::new(), episodes: 1, is_reference };
        let curves = [false, false, false, true, true, true].map(curve);
        let looks = looks(&curves);
        assert!(looks.iter().zip(&curves).all(|((class, _), curve)| (*class == "c") == curve.is_reference));
        let mut distinct = looks.clone();
        distinct.sort_unstable();
        distinct.dedup();
        assert_eq!(distinct.len(), looks.len());
    }
}
