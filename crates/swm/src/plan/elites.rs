//! The figure of elites: the actions that the cheapest candidates hold, over time, at some of the iterations.

use swm_core::{Column, Dtype, Space};
use swm_solvers::{ActionMap, TracedIteration, TracedPlan};

use super::spread_out;
use crate::svg::{Anchor, Frame, Svg, number, ticks};

/// Iterations shown.
const COLUMNS: usize = 4;
/// Numbers of an action that are shown.
const ROWS: usize = 4;
const PLOT: [f64; 2] = [205.0, 112.0];
const LEFT: f64 = 64.0;
const GAP: f64 = 18.0;
const HEAD: f64 = 66.0;
const FOOT: f64 = 46.0;

/// Draws one plan. Actions are shown as they are carried out, in the environment's units.
pub(super) fn draw(plan: &TracedPlan, actions: &ActionMap, names: &[String]) -> String {
    let rows = names.len().min(ROWS);
    let shown = spread_out(plan.iterations.len(), COLUMNS);
    let columns = shown.len().max(1);
    let size =
        [(LEFT + (PLOT[0] + GAP) * columns as f64).max(520.0), HEAD + (PLOT[1] + GAP) * rows as f64 + FOOT];
    let mut svg = Svg::new(size[0], size[1], "Actions of the elites over time, by iteration");
    legend(&mut svg, names.len());
    let mut window = Window::new(actions, names.len());
    for (column, &index) in shown.iter().enumerate() {
        let iteration = &plan.iterations[index];
        let left = LEFT + (PLOT[0] + GAP) * column as f64;
        let title = format!("iteration {} of {}", index + 1, plan.iterations.len());
        svg.text([left, HEAD - 12.0], Anchor::Start, "strong", &title);
        for (row, name) in names.iter().take(rows).enumerate() {
            let at = [left, HEAD + (PLOT[1] + GAP) * row as f64];
            let edge = [row + 1 == rows, column == 0];
            window.plot(&mut svg, iteration, row, at, edge);
            if column == 0 {
                svg.upright([16.0, at[1] + PLOT[1] / 2.0], "soft", name);
            }
        }
        svg.text([left + PLOT[0] / 2.0, size[1] - 10.0], Anchor::Middle, "soft", "step of the plan");
    }
    svg.finish()
}

fn legend(svg: &mut Svg, width: usize) {
    let y = 22.0;
    svg.path([[16.0, y], [38.0, y]].into_iter(), "a", "stroke-width=\"1\" opacity=\".6\"");
    svg.text([44.0, y + 4.0], Anchor::Start, "", "an elite");
    svg.path([[106.0, y], [128.0, y]].into_iter(), "b", "stroke-width=\"2\"");
    svg.text([134.0, y + 4.0], Anchor::Start, "", "mean of the search");
    svg.line([262.0, y], [284.0, y], "bound");
    svg.text([290.0, y + 4.0], Anchor::Start, "", "bound of the action");
    if width > ROWS {
        let note = format!("the first {ROWS} of {width} numbers of an action");
        svg.text([430.0, y + 4.0], Anchor::Start, "soft", &note);
    }
}

/// From plans to plots.
struct Window<'a> {
    actions: &'a ActionMap,
    action: Column,
    /// `[width, 2]`: what is shown of each number.
    ranges: Vec<[f64; 2]>,
}

impl<'a> Window<'a> {
    fn new(actions: &'a ActionMap, width: usize) -> Self {
        let space = actions.space();
        let dtype = space.dtype().unwrap_or(Dtype::F32);
        let mut window = Self { actions, action: Column::zeros(dtype, width), ranges: Vec::new() };
        // Bounds are those of the environment's numbers: what the bounds of plans become.
        let (low, high) = space.bounds();
        let [low, high] = match space {
            Space::Box { .. } => [low, high].map(|bound| {
                let numbers: Vec<f32> = bound.iter().map(|&value| value as f32).collect();
                window.carried_out(&numbers)
            }),
            _ => [low, high],
        };
        window.ranges = low.into_iter().zip(high).map(|(low, high)| [low, high]).collect();
        window
    }

    /// One action `[A]` of a plan, in the environment's numbers.
    fn carried_out(&mut self, numbers: &[f32]) -> Vec<f64> {
        self.actions.write(numbers, &mut self.action.as_slice_mut());
        let action = self.action.as_slice();
        (0..action.len()).map(|index| action.number(index).unwrap_or(f64::NAN)).collect()
    }

    /// Number `row` of every action of a plan.
    fn over_time(&mut self, plan: &[f32], row: usize) -> Vec<f64> {
        let width = self.actions.dim();
        plan.chunks_exact(width).map(|numbers| self.carried_out(numbers)[row]).collect()
    }

    fn plot(
        &mut self,
        svg: &mut Svg,
        iteration: &TracedIteration,
        row: usize,
        at: [f64; 2],
        [lowest, leftmost]: [bool; 2],
    ) {
        let elites: Vec<Vec<f64>> =
            iteration.elites.iter().map(|elite| self.over_time(&elite.actions, row)).collect();
        let mean = self.over_time(&iteration.mean, row);
        let steps = elites.first().unwrap_or(&mean).len();
        let [low, high] = self.range(row, elites.iter().chain([&mean]).flatten().copied());
        let pad = 0.06 * (high - low).max(1e-9);
        let frame = Frame { at, size: PLOT, x: [0.0, (steps.max(2) - 1) as f64], y: [low - pad, high + pad] };
        let x_ticks: Vec<f64> = ticks(frame.x, 5).into_iter().filter(|tick| tick.fract() == 0.0).collect();
        frame.axes(svg, &x_ticks, &ticks(frame.y, 4), [lowest, leftmost]);
        for bound in self.ranges[row].into_iter().filter(|bound| bound.is_finite()) {
            let y = frame.place(0.0, bound)[1];
            svg.line([at[0], y], [at[0] + PLOT[0], y], "bound");
        }
        let points = |values: &[f64]| -> Vec<[f64; 2]> {
            values.iter().enumerate().map(|(step, &value)| frame.place(step as f64, value)).collect()
        };
        for elite in &elites {
            svg.path(points(elite).into_iter(), "a", "stroke-width=\"1\" opacity=\".35\"");
        }
        svg.path(points(&mean).into_iter(), "b", "stroke-width=\"2\"");
        if let Some(sigma) = iteration.record.mean_sigma.filter(|_| row == 0) {
            let corner = [at[0] + PLOT[0], at[1] - 12.0];
            svg.text(corner, Anchor::End, "soft", &format!("σ {}", number(sigma)));
        }
    }

    /// The bounds, or what there is where there are none.
    fn range(&self, row: usize, values: impl Iterator<Item = f64>) -> [f64; 2] {
        let [low, high] = self.ranges[row];
        let finite = [low, high].map(|bound| if bound.is_finite() { Some(bound) } else { None });
        values
            .filter(|value| value.is_finite())
            .fold([finite[0].unwrap_or(0.0), finite[1].unwrap_or(0.0)], |[low, high], value| {
                [low.min(value), high.max(value)]
            })
    }
}
