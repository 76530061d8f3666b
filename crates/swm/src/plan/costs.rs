//! The figure of costs: how cheap the candidates of each iteration were, a plot per plan.

use swm_solvers::TracedPlan;

use crate::svg::{Anchor, Frame, Svg, number, ticks};

const COLUMNS: usize = 3;
const PLOT: [f64; 2] = [270.0, 150.0];
/// Room around each plot: left, top, right, bottom.
const MARGIN: [f64; 4] = [58.0, 30.0, 16.0, 42.0];
const HEAD: f64 = 46.0;

/// Draws the first `drawn` plans.
pub(super) fn draw(plans: &[TracedPlan], drawn: usize) -> String {
    let shown = &plans[..plans.len().min(drawn)];
    let columns = shown.len().clamp(1, COLUMNS);
    let cell = [PLOT[0] + MARGIN[0] + MARGIN[2], PLOT[1] + MARGIN[1] + MARGIN[3]];
    let rows = shown.len().div_ceil(columns).max(1);
    let width = (cell[0] * columns as f64).max(520.0);
    let mut svg = Svg::new(width, HEAD + cell[1] * rows as f64, "Cost of the candidates by iteration");
    legend(&mut svg);
    for (index, plan) in shown.iter().enumerate() {
        let (column, row) = (index % columns, index / columns);
        let at = [cell[0] * column as f64 + MARGIN[0], HEAD + cell[1] * row as f64 + MARGIN[1]];
        plot(&mut svg, plan, at);
    }
    if shown.is_empty() {
        svg.text([16.0, HEAD + 40.0], Anchor::Start, "soft", "no plan was made");
    }
    svg.finish()
}

fn legend(svg: &mut Svg) {
    let y = 22.0;
    let mut x = 16.0;
    for (class, text) in
        [("a", "best candidate"), ("b", "mean of the elites"), ("c", "mean of all candidates")]
    {
        svg.path([[x, y], [x + 22.0, y]].into_iter(), class, "stroke-width=\"2\"");
        svg.text([x + 28.0, y + 4.0], Anchor::Start, "", text);
        x += 44.0 + 6.4 * text.len() as f64;
    }
    svg.dot([x + 8.0, y], 4.0, "fa", "");
    svg.text([x + 18.0, y + 4.0], Anchor::Start, "", "the plan");
}

fn plot(svg: &mut Svg, plan: &TracedPlan, at: [f64; 2]) {
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
    let whole = |ticks: Vec<f64>| ticks.into_iter().filter(|tick| tick.fract() == 0.0).collect::<Vec<_>>();
    let x_ticks = whole(ticks([1.0, count], 6));
    frame.axes(svg, &x_ticks, &ticks(frame.y, 4), [true, true]);
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
