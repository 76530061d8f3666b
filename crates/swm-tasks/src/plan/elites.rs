//! The figure of elites: the actions that the cheapest candidates hold, over time, at some of the iterations.

use swm_core::{Column, Dtype, Space};
use swm_solvers::{ActionMap, TracedIteration, TracedPlan};

use crate::svg::{Anchor, Entry, Frame, Grid, Mark, Svg, evenly, number, ticks, whole_ticks};

/// Iterations shown.
const ITERATIONS: usize = 4;
/// Dimensions of an action that are shown.
const DIMS: usize = 4;
const PLOT: [f64; 2] = [190.0, 112.0];
/// Room to the left of a plot, above it, and below it.
const MARGIN: [f64; 3] = [56.0, 26.0, 20.0];
const ELITE: &str = "stroke-width=\"1\" opacity=\".35\"";
const MEAN: &str = "stroke-width=\"2\"";

/// Renders one plan: a column per iteration, with a plot per dimension. Actions are in the environment's units.
pub(super) fn render(plan: &TracedPlan, actions: &ActionMap, names: &[String]) -> String {
    let dims = names.len().min(DIMS);
    let shown = evenly(plan.iterations.len(), ITERATIONS);
    let note = format!("the first {DIMS} of {} dimensions of an action", names.len());
    let mut legend: Vec<Entry<'_>> = vec![
        (Mark::Line, "a", "stroke-width=\"1\" opacity=\".6\"", "an elite"),
        (Mark::Line, "b", MEAN, "mean of the search"),
        (Mark::Line, "bound", "", "bound of the action"),
    ];
    if names.len() > DIMS {
        legend.push((Mark::Line, "", "", &note));
    }
    let row = PLOT[1] + MARGIN[1] + MARGIN[2];
    let cell = [PLOT[0] + MARGIN[0] + 16.0, row * dims as f64 + 20.0];
    let title = "Actions of the elites over time, by iteration";
    let mut grid = Grid::new(title, &legend, cell, ITERATIONS, shown.len());
    let mut window = Window::new(actions, names.len());
    for (column, &index) in shown.iter().enumerate() {
        let svg = grid.cell(column);
        let title = format!("iteration {} of {}", index + 1, plan.iterations.len());
        svg.text([MARGIN[0], MARGIN[1] - 10.0], Anchor::Start, "strong", &title);
        for (dim, name) in names.iter().take(dims).enumerate() {
            let at = [MARGIN[0], MARGIN[1] + row * dim as f64];
            svg.upright([12.0, at[1] + PLOT[1] / 2.0], "soft", name);
            window.plot(svg, &plan.iterations[index], dim, at);
        }
        svg.text([MARGIN[0] + PLOT[0] / 2.0, cell[1] - 8.0], Anchor::Middle, "soft", "step of the plan");
    }
    grid.svg.finish()
}

/// From plans to plots.
struct Window<'a> {
    actions: &'a ActionMap,
    action: Column,
    /// `[A, 2]`: the range that is shown of each dimension.
    ranges: Vec<[f64; 2]>,
}

impl<'a> Window<'a> {
    fn new(actions: &'a ActionMap, dim: usize) -> Self {
        let space = actions.space();
        let dtype = space.dtype().unwrap_or(Dtype::F32);
        let mut window = Self { actions, action: Column::zeros(dtype, dim), ranges: Vec::new() };
        // Bounds in the environment's units: what the bounds of plans become.
        let (low, high) = space.bounds();
        let [low, high] = match space {
            Space::Box { .. } => [low, high].map(|bound| {
                let values: Vec<f32> = bound.iter().map(|&value| value as f32).collect();
                window.action_of(&values)
            }),
            _ => [low, high],
        };
        window.ranges = low.into_iter().zip(high).map(|(low, high)| [low, high]).collect();
        window
    }

    /// One action `[A]` of a plan, in the environment's units.
    fn action_of(&mut self, values: &[f32]) -> Vec<f64> {
        self.actions.write(values, &mut self.action.as_slice_mut());
        let action = self.action.as_slice();
        (0..action.len()).map(|index| action.as_f64(index).unwrap_or(f64::NAN)).collect()
    }

    /// Dimension `dim` of every action of a plan.
    fn over_time(&mut self, plan: &[f32], dim: usize) -> Vec<f64> {
        plan.chunks_exact(self.actions.dim()).map(|values| self.action_of(values)[dim]).collect()
    }

    fn plot(&mut self, svg: &mut Svg, iteration: &TracedIteration, dim: usize, at: [f64; 2]) {
        let elites: Vec<Vec<f64>> =
            iteration.elites.iter().map(|elite| self.over_time(&elite.actions, dim)).collect();
        let mean = self.over_time(&iteration.mean, dim);
        let steps = elites.first().unwrap_or(&mean).len();
        let [low, high] = self.range(dim, elites.iter().chain([&mean]).flatten().copied());
        let pad = 0.06 * (high - low).max(1e-9);
        let frame = Frame { at, size: PLOT, x: [0.0, (steps.max(2) - 1) as f64], y: [low - pad, high + pad] };
        frame.axes(svg, &whole_ticks(frame.x, 5), &ticks(frame.y, 4));
        for bound in self.ranges[dim].into_iter().filter(|bound| bound.is_finite()) {
            let y = frame.place(0.0, bound)[1];
            svg.line([at[0], y], [at[0] + PLOT[0], y], "bound");
        }
        let points = |values: &[f64]| -> Vec<[f64; 2]> {
            values.iter().enumerate().map(|(step, &value)| frame.place(step as f64, value)).collect()
        };
        for elite in &elites {
            svg.path(points(elite).into_iter(), "a", ELITE);
        }
        svg.path(points(&mean).into_iter(), "b", MEAN);
        if let Some(sigma) = iteration.record.mean_sigma.filter(|_| dim == 0) {
            let corner = [at[0] + PLOT[0], at[1] - 10.0];
            svg.text(corner, Anchor::End, "soft", &format!("σ {}", number(sigma)));
        }
    }

    /// The bounds, or the range of the values where there are none.
    fn range(&self, dim: usize, values: impl Iterator<Item = f64>) -> [f64; 2] {
        let [low, high] = self.ranges[dim];
        let finite = [low, high].map(|bound| if bound.is_finite() { Some(bound) } else { None });
        values
            .filter(|value| value.is_finite())
            .fold([finite[0].unwrap_or(0.0), finite[1].unwrap_or(0.0)], |[low, high], value| {
                [low.min(value), high.max(value)]
            })
    }
}
