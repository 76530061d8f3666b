//! The figure of costs: how cheap the candidates of each iteration were, a plot per plan.

use swm_solvers::TracedPlan;

use crate::svg::{Anchor, Frame, Grid, Mark, Svg, number, ticks, whole_ticks};

const COLUMNS: usize = 3;
const PLOT: [f64; 2] = [270.0, 150.0];
/// Room around each plot: left, top, right, bottom.
const MARGIN: [f64; 4] = [58.0, 30.0, 16.0, 42.0];

/// Renders the figure of `plans`.
pub(super) fn render(plans: &[TracedPlan]) -> String {
    let width = "stroke-width=\"2\"";
    let legend = [
        (Mark::Line, "a", width, "best candidate"),
        (Mark::Line, "b", width, "mean of the elites"),
        (Mark::Line, "c", width, "mean of all candidates"),
        (Mark::Dot, "fa", "", "the plan"),
    ];
    let cell = [PLOT[0] + MARGIN[0] + MARGIN[2], PLOT[1] + MARGIN[1] + MARGIN[3]];
    let mut grid = Grid::new("Cost of the candidates by iteration", &legend, cell, COLUMNS, plans.len());
    for (index, plan) in plans.iter().enumerate() {
        plot(grid.cell(index), plan);
    }
    if plans.is_empty() {
        grid.cell(0).text([16.0, 40.0], Anchor::Start, "soft", "no plan was made");
    }
    grid.svg.finish()
}

fn plot(svg: &mut Svg, plan: &TracedPlan) {
    let at = [MARGIN[0], MARGIN[1]];
    let records: Vec<_> = plan.iterations.iter().map(|iteration| &iteration.record).collect();
    let cost = plan.result.as_ref().and_then(|result| result.cost);
    let series = [
        ("c", records.iter().map(|r| r.sample_mean).collect::<Vec<_>>()),
        ("b", records.iter().map(|r| r.elite_mean).collect()),
        ("a", records.iter().map(|r| r.best).collect()),
    ];
    let all = || series.iter().flat_map(|(_, values)| values).flatten().chain(&cost);
    let low = all().copied().fold(f64::INFINITY, f64::min);
    let high = all().copied().fold(f64::NEG_INFINITY, f64::max);
    let name = format!("episode {}, plan {}", plan.key.episode, plan.key.plan);
    svg.text([at[0], at[1] - 10.0], Anchor::Start, "strong", &name);
    if low > high {
        svg.text([at[0] + 8.0, at[1] + 24.0], Anchor::Start, "soft", "no finite cost");
        return;
    }
    let pad = 0.06 * (high - low).max(1e-3 * high.abs()).max(1e-9);
    let count = records.len().max(1) as f64;
    let frame = Frame { at, size: PLOT, x: [0.5, count + 0.5 + 0.04 * count], y: [low - pad, high + pad] };
    frame.axes(svg, &whole_ticks([1.0, count], 6), &ticks(frame.y, 4));
    for (class, values) in &series {
        let points =
            (1..).zip(values).filter_map(|(i, cost)| cost.map(|cost| frame.place(f64::from(i), cost)));
        svg.path(points, class, "stroke-width=\"2\"");
    }
    if let Some(cost) = cost {
        let [x, y] = frame.place(count, cost);
        svg.dot([x, y], 4.0, "fa", "");
        let corner = [at[0] + PLOT[0], at[1] - 10.0];
        svg.text(corner, Anchor::End, "soft", &format!("cost of the plan {}", number(cost)));
    }
    let bottom = at[1] + PLOT[1] + 34.0;
    svg.text([at[0] + PLOT[0] / 2.0, bottom], Anchor::Middle, "soft", "iteration");
    svg.upright([at[0] - 46.0, at[1] + PLOT[1] / 2.0], "soft", "cost");
}
