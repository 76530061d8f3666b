//! The charts of a report, as SVG that follows the page's colors.

use crate::evaluation::{Cell, Scope, Sweep};
use crate::svg::{Anchor, Frame, Svg, ticks};

/// One bar of success rates.
pub(super) struct Bar {
    pub(super) name: String,
    /// In percent, with its interval.
    pub(super) rate: f64,
    pub(super) interval: [f64; 2],
    /// Whether it is a reference policy rather than the evaluated one.
    pub(super) reference: bool,
}

const LABEL: f64 = 250.0;
const TRACK: f64 = 520.0;
const ROW: f64 = 34.0;

/// Success rates with their intervals, one under the other.
pub(super) fn bars(bars: &[Bar]) -> String {
    let top = 12.0;
    let height = ROW * bars.len() as f64;
    let mut svg = Svg::new(LABEL + TRACK + 96.0, top + height + 34.0, "Success rates with 95 % intervals");
    let frame = Frame { at: [LABEL, top], size: [TRACK, height], x: [0.0, 100.0], y: [0.0, 1.0] };
    for tick in ticks(frame.x, 5) {
        let [x, _] = frame.place(tick, 0.0);
        svg.line([x, top], [x, top + height], "grid");
        svg.text([x, top + height + 18.0], Anchor::Middle, "soft", &format!("{tick} %"));
    }
    for (index, bar) in bars.iter().enumerate() {
        let y = top + ROW * (index as f64 + 0.5);
        let (fill, weight) = if bar.reference { ("fc", "soft") } else { ("fa", "strong") };
        svg.text([LABEL - 12.0, y + 4.0], Anchor::End, weight, &shortened(&bar.name, 32));
        let [x, _] = frame.place(bar.rate, 0.0);
        svg.rect([LABEL, y - 9.0], [(x - LABEL).max(1.5), 18.0], fill, "rx=\"3\" fill-opacity=\".82\"");
        let [low, high] = bar.interval.map(|value| frame.place(value, 0.0)[0]);
        svg.line([low, y], [high, y], "ink");
        for end in [low, high] {
            svg.line([end, y - 5.0], [end, y + 5.0], "ink");
        }
        svg.text([LABEL + TRACK + 14.0, y + 4.0], Anchor::Start, weight, &format!("{:.1} %", bar.rate));
    }
    svg.finish()
}

/// A line of the chart of success over steps.
pub(super) struct Curve {
    pub(super) name: String,
    /// First successful steps.
    pub(super) steps: Vec<u64>,
    /// Of so many episodes.
    pub(super) episodes: usize,
}

const CURVES: [&str; 3] = ["a", "b", "c"];

/// The share of episodes that have succeeded by each step.
pub(super) fn curves(curves: &[Curve], budget: u64) -> String {
    let legend = 26.0 + 20.0 * curves.len() as f64;
    let mut svg = Svg::new(760.0, legend + 300.0, "Success by step");
    let frame =
        Frame { at: [56.0, legend], size: [680.0, 240.0], x: [0.0, budget.max(1) as f64], y: [0.0, 100.0] };
    let x_ticks: Vec<f64> = ticks(frame.x, 8).into_iter().filter(|tick| tick.fract() == 0.0).collect();
    frame.axes(&mut svg, &x_ticks, &ticks(frame.y, 5), [true, true]);
    for (index, curve) in curves.iter().enumerate() {
        let class = CURVES[index % CURVES.len()];
        let dash = if index < CURVES.len() { "" } else { " stroke-dasharray=\"6 4\"" };
        let y = 20.0 + 20.0 * index as f64;
        let style = format!("stroke-width=\"2.2\"{dash}");
        svg.path([[16.0, y], [40.0, y]].into_iter(), class, &style);
        svg.text([48.0, y + 4.0], Anchor::Start, "", &shortened(&curve.name, 96));
        let share = |step: u64| {
            let done = curve.steps.iter().filter(|&&first| first <= step).count();
            100.0 * done as f64 / curve.episodes.max(1) as f64
        };
        let points = (0..=budget).flat_map(|step| {
            let before = if step == 0 { share(0) } else { share(step - 1) };
            [frame.place(step as f64, before), frame.place(step as f64, share(step))]
        });
        svg.path(points, class, &style);
    }
    svg.text([396.0, legend + 284.0], Anchor::Middle, "soft", "actions taken");
    svg.upright([14.0, legend + 120.0], "soft", "episodes successful, %");
    svg.finish()
}

/// A row of the map of episodes.
pub(super) struct Strip {
    pub(super) name: String,
    /// Success, and whether it was so at the start, pair by pair.
    pub(super) episodes: Vec<[bool; 2]>,
}

/// Pairs per line of the map.
const PER_LINE: usize = 50;

/// Every pair of every policy as a square: what succeeds where others fail is seen at a glance.
pub(super) fn episode_map(strips: &[Strip]) -> String {
    const SIDE: f64 = 11.0;
    let count = strips.iter().map(|strip| strip.episodes.len()).max().unwrap_or(0);
    let lines = count.div_ceil(PER_LINE).max(1);
    let block = SIDE * strips.len() as f64 + 26.0;
    let size = [LABEL + SIDE * count.min(PER_LINE) as f64 + 24.0, 34.0 + block * lines as f64];
    let mut svg = Svg::new(size[0].max(620.0), size[1], "Outcome of every pair");
    let mut x = LABEL;
    for (class, style, text) in
        [("fa", "", "success"), ("fb", "", "success at reset"), ("fc", "fill-opacity=\".22\"", "failure")]
    {
        svg.rect([x, 8.0], [10.0, 10.0], class, &format!("rx=\"2\" {style}"));
        svg.text([x + 16.0, 17.0], Anchor::Start, "soft", text);
        x += 34.0 + 6.6 * text.len() as f64;
    }
    for line in 0..lines {
        let top = 44.0 + block * line as f64;
        let first = line * PER_LINE;
        for mark in (first..count.min(first + PER_LINE)).step_by(10) {
            let x = LABEL + SIDE * (mark - first) as f64;
            svg.text([x, top - 6.0], Anchor::Start, "soft", &mark.to_string());
        }
        for (row, strip) in strips.iter().enumerate() {
            let y = top + SIDE * row as f64;
            svg.text([LABEL - 12.0, y + 9.0], Anchor::End, "soft", &shortened(&strip.name, 36));
            for (column, [success, at_start]) in strip.episodes.iter().skip(first).take(PER_LINE).enumerate()
            {
                let (class, style) = match (success, at_start) {
                    (true, true) => ("fb", ""),
                    (true, false) => ("fa", ""),
                    (false, _) => ("fc", " fill-opacity=\".22\""),
                };
                let at = [LABEL + SIDE * column as f64, y];
                svg.rect(at, [SIDE - 1.5, SIDE - 1.5], class, &format!("rx=\"2\"{style}"));
            }
        }
    }
    svg.finish()
}

/// Cells of a sweep: a row per factor, group and all; a column per value. Color says how far it is from the unchanged
/// environment.
pub fn heat_map(sweep: &Sweep) -> String {
    const CELL: [f64; 2] = [104.0, 30.0];
    const NAMES: f64 = 200.0;
    let changed: Vec<&Cell> = sweep.cells.iter().filter(|cell| cell.scope != Scope::Unchanged).collect();
    let mut names: Vec<(&str, Scope)> = Vec::new();
    let mut values: Vec<&str> = Vec::new();
    for cell in &changed {
        if !names.contains(&(&cell.name, cell.scope)) {
            names.push((&cell.name, cell.scope));
        }
        if !values.contains(&cell.value.as_str()) {
            values.push(&cell.value);
        }
    }
    let base = sweep.cells.first().and_then(|cell| cell.summary.as_ref()).map_or(0.0, |s| s.success_rate);
    let top = 74.0;
    let width = (NAMES + CELL[0] * values.len() as f64 + 24.0).max(560.0);
    let mut svg = Svg::new(width, top + CELL[1] * names.len() as f64 + 14.0, "Success under changed factors");
    svg.text([16.0, 20.0], Anchor::Start, "strong", &format!("unchanged: {base:.1} %"));
    svg.rect([180.0, 10.0], [14.0, 12.0], "fb", "rx=\"2\" fill-opacity=\".7\"");
    svg.text([200.0, 20.0], Anchor::Start, "soft", "worse than unchanged");
    svg.rect([352.0, 10.0], [14.0, 12.0], "fa", "rx=\"2\" fill-opacity=\".7\"");
    svg.text([372.0, 20.0], Anchor::Start, "soft", "better");
    svg.text([16.0, 42.0], Anchor::Start, "soft", "a dot marks differences with p < 0.05");
    for (column, value) in values.iter().enumerate() {
        let x = NAMES + CELL[0] * (column as f64 + 0.5);
        svg.text([x, top - 10.0], Anchor::Middle, "soft", value);
    }
    for (row, (name, scope)) in names.iter().enumerate() {
        let y = top + CELL[1] * row as f64;
        let class = if *scope == Scope::Factor { "" } else { "strong" };
        svg.text([NAMES - 12.0, y + 19.0], Anchor::End, class, name);
        for cell in changed.iter().filter(|cell| cell.name == *name && cell.scope == *scope) {
            let column = values.iter().position(|value| *value == cell.value).unwrap_or(0);
            let x = NAMES + CELL[0] * column as f64;
            let Some(summary) = &cell.summary else {
                svg.text([x + CELL[0] / 2.0, y + 19.0], Anchor::Middle, "soft", "–");
                continue;
            };
            let difference = summary.success_rate - base;
            let fill = if difference < 0.0 { "fb" } else { "fa" };
            let strength = 0.04 + 0.66 * (difference.abs() / 100.0).min(1.0).sqrt();
            let strength = if difference == 0.0 { 0.04 } else { strength };
            let style = format!("rx=\"4\" fill-opacity=\"{strength:.2}\"");
            svg.rect([x + 1.5, y + 1.5], [CELL[0] - 3.0, CELL[1] - 3.0], fill, &style);
            let text = format!("{:.1} %", summary.success_rate);
            svg.text([x + CELL[0] / 2.0, y + 19.0], Anchor::Middle, "", &text);
            if cell.test.as_ref().is_some_and(|test| test.p_value < 0.05) {
                svg.dot([x + CELL[0] - 12.0, y + 10.0], 2.6, "fink", "");
            }
        }
    }
    svg.finish()
}

/// The end cut off, with a mark, where a text is too long.
fn shortened(text: &str, most: usize) -> String {
    if text.chars().count() <= most {
        return text.to_owned();
    }
    text.chars().take(most - 1).chain(['…']).collect()
}
