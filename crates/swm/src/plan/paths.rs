//! The figure of paths: where the elites would have led, by simulation, over the image of the moment that the plan
//! was made at.

use swm_core::Place;
use swm_core::error::BoxError;
use swm_media::png;
use swm_solvers::TracedPlan;

use super::future::Future;
use super::spread_out;
use super::watched::PlanStart;
use crate::svg::{Anchor, Svg};

/// Iterations shown, beside the plan itself.
const COLUMNS: usize = 3;
/// Height of an image.
const SIDE: f64 = 216.0;
const MARGIN: f64 = 16.0;
const HEAD: f64 = 66.0;

/// Colors of the things that move, in their order: on images, which are the same on light and dark pages.
const COLORS: [&str; 4] = ["#d6006c", "#0068d6", "#6b8f00", "#8a3ffc"];

/// Draws one plan; nothing if there is no image, or if the environment does not say where things are in it.
pub(super) fn draw(
    start: &PlanStart,
    plan: &TracedPlan,
    future: &mut Future<'_>,
) -> Result<Option<String>, BoxError> {
    let (Some(image), Some([height, width])) = (&start.image, future.size) else { return Ok(None) };
    let expected = future.places(&start.state, &plan.actions)?;
    let Some(things) = expected.first().filter(|things| !things.is_empty()).cloned() else { return Ok(None) };
    let shown = spread_out(plan.iterations.len(), COLUMNS);
    let size = [SIDE * width as f64 / height as f64, SIDE];
    let left = |column: usize| MARGIN + (size[0] + MARGIN) * column as f64;
    let full = [(left(shown.len() + 1)).max(520.0), HEAD + SIDE + MARGIN];
    let mut svg = Svg::new(full[0], full[1], "Simulated paths of the elites, by iteration, and of the plan");
    legend(&mut svg, &things);
    let id = format!("start-{}-{}", plan.key.episode, plan.key.plan);
    svg.define_image(&id, size, &png::encode(height, width, image)?);
    for (column, &index) in shown.iter().enumerate() {
        let at = [left(column), HEAD];
        let iteration = &plan.iterations[index];
        let title = format!("iteration {} of {}", index + 1, plan.iterations.len());
        svg.text([at[0], HEAD - 12.0], Anchor::Start, "strong", &title);
        svg.again(&id, at);
        // The cheapest last, so that they lie on top.
        for elite in iteration.elites.iter().rev() {
            let path = future.places(&start.state, &elite.actions)?;
            let style = "stroke-width=\"1.2\" opacity=\".45\"";
            lines(&mut svg, &path, at, size, style);
        }
        start_dots(&mut svg, &things, at, size);
    }
    let at = [left(shown.len()), HEAD];
    svg.text([at[0], HEAD - 12.0], Anchor::Start, "strong", "the plan");
    svg.again(&id, at);
    lines(&mut svg, &expected, at, size, "stroke-width=\"2.5\"");
    start_dots(&mut svg, &things, at, size);
    Ok(Some(svg.finish()))
}

fn legend(svg: &mut Svg, things: &[Place]) {
    let y = 22.0;
    let mut x = 16.0;
    for (thing, color) in things.iter().zip(COLORS.iter().cycle()) {
        let style = format!("stroke=\"{color}\" stroke-width=\"2.5\"");
        svg.path([[x, y], [x + 22.0, y]].into_iter(), "", &style);
        let text = format!("path of the {}", thing.name);
        svg.text([x + 28.0, y + 4.0], Anchor::Start, "", &text);
        x += 48.0 + 6.4 * text.len() as f64;
    }
    svg.dot([x + 8.0, y], 4.0, "", START);
    svg.text([x + 18.0, y + 4.0], Anchor::Start, "", "where it is now");
}

const START: &str = "fill=\"#fff\" stroke=\"#333\" stroke-width=\"1.5\"";

fn inside(place: &Place, at: [f64; 2], size: [f64; 2]) -> [f64; 2] {
    // What leaves the image stays at its edge.
    let [x, y] = place.at.map(|part| part.clamp(0.0, 1.0));
    [at[0] + x * size[0], at[1] + y * size[1]]
}

fn lines(svg: &mut Svg, path: &[Vec<Place>], at: [f64; 2], size: [f64; 2], style: &str) {
    let things = path.first().map_or(0, Vec::len);
    for (thing, color) in (0..things).zip(COLORS.iter().cycle()) {
        let points = path.iter().map(|places| inside(&places[thing], at, size));
        svg.path(points, "", &format!("stroke=\"{color}\" {style}"));
    }
}

fn start_dots(svg: &mut Svg, things: &[Place], at: [f64; 2], size: [f64; 2]) {
    for thing in things {
        svg.dot(inside(thing, at, size), 4.0, "", START);
    }
}
