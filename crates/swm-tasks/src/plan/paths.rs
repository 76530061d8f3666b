//! The figure of paths: where the elites would have led, by simulation, over the image at planning time.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use swm_core::Keypoint;
use swm_media::png;
use swm_solvers::{PlanPaths, TracedPlan};

use super::watched::PlanStart;
use crate::error::TaskError;
use crate::svg::{Anchor, Entry, Grid, Mark, Svg, evenly};

/// Iterations shown, before the plan itself.
const ITERATIONS: usize = 3;
/// Height of an image.
const SIDE: f64 = 216.0;
const MARGIN: f64 = 16.0;
/// Where the image lies in its cell.
const AT: [f64; 2] = [MARGIN, 26.0];

/// Colors of the objects that move, in their order: on images, which are the same on light and dark pages.
const COLORS: [&str; 4] = ["#d6006c", "#0068d6", "#6b8f00", "#8a3ffc"];
const START: &str = "fill=\"#fff\" stroke=\"#333\" stroke-width=\"1.5\"";

/// Renders one plan; nothing if there is no image, or if the environment does not say where objects are in it.
pub(super) fn render(
    start: &PlanStart,
    plan: &TracedPlan,
    size: Option<[usize; 2]>,
    simulator: &mut PlanPaths,
) -> Result<Option<String>, TaskError> {
    let (Some(image), Some([height, width])) = (&start.image, size) else { return Ok(None) };
    let expected = simulator.keypoints(&start.state, &plan.actions)?;
    let Some(objects) = expected.first().filter(|objects| !objects.is_empty()).cloned() else {
        return Ok(None);
    };
    let shown = evenly(plan.iterations.len(), ITERATIONS);
    let size = [SIDE * width as f64 / height as f64, SIDE];
    let keys: Vec<(String, String)> = objects
        .iter()
        .zip(COLORS.iter().cycle())
        .map(|(object, color)| {
            (stroke(color, "stroke-width=\"2.5\""), format!("path of the {}", object.name))
        })
        .collect();
    let mut legend: Vec<Entry<'_>> =
        keys.iter().map(|(style, text)| (Mark::Line, "", style.as_str(), text.as_str())).collect();
    legend.push((Mark::Dot, "", START, "position at planning time"));
    let title = "Simulated paths of the elites, by iteration, and of the plan";
    let cell = [size[0] + MARGIN, AT[1] + SIDE + MARGIN];
    let mut grid = Grid::new(title, &legend, cell, ITERATIONS + 1, shown.len() + 1);
    // Images are known by name on a page: equal names are equal images.
    let mut hasher = DefaultHasher::new();
    image.hash(&mut hasher);
    let id = format!("start-{:016x}", hasher.finish());
    grid.svg.define_image(&id, size, &png::encode(height, width, image)?);
    let mut render = |index: usize, title: &str, paths: &[Vec<Vec<Keypoint>>], style: &str| {
        let svg = grid.cell(index);
        svg.text([AT[0], AT[1] - 12.0], Anchor::Start, "strong", title);
        svg.again(&id, AT);
        for path in paths {
            lines(svg, path, size, style);
        }
        for object in &objects {
            svg.dot(inside(object, size), 4.0, "", START);
        }
    };
    for (column, &index) in shown.iter().enumerate() {
        // The cheapest last, so that they lie on top.
        let elites = plan.iterations[index].elites.iter().rev();
        let paths = elites.map(|elite| simulator.keypoints(&start.state, &elite.actions));
        let title = format!("iteration {} of {}", index + 1, plan.iterations.len());
        render(
            column,
            &title,
            &paths.collect::<Result<Vec<_>, _>>()?,
            "stroke-width=\"1.2\" opacity=\".45\"",
        );
    }
    render(shown.len(), "the plan", &[expected], "stroke-width=\"2.5\"");
    Ok(Some(grid.svg.finish()))
}

fn stroke(color: &str, style: &str) -> String {
    format!("stroke=\"{color}\" {style}")
}

fn inside(keypoint: &Keypoint, size: [f64; 2]) -> [f64; 2] {
    // What leaves the image stays at its edge.
    let [x, y] = keypoint.at.map(|part| part.clamp(0.0, 1.0));
    [AT[0] + x * size[0], AT[1] + y * size[1]]
}

fn lines(svg: &mut Svg, path: &[Vec<Keypoint>], size: [f64; 2], style: &str) {
    let objects = path.first().map_or(0, Vec::len);
    for (object, color) in (0..objects).zip(COLORS.iter().cycle()) {
        let points = path.iter().map(|keypoints| inside(&keypoints[object], size));
        svg.path(points, "", &stroke(color, style));
    }
}
