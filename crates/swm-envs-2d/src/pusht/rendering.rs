//! How PushT is rendered: once, against `Painter`, for exact and fast images alike. The order is the reference's:
//! table and goal below, then bodies, walls over them, contacts on top.

use swm_fov::Fov;
use swm_render::{Painter, Rgb, light};

use super::engine::Engine;
use super::physics::{BodyId, Shape, WALL_SEGMENTS};
use super::settings::Settings;
use crate::image::Background;

const WALL_COLOR: Rgb = [211, 211, 211];
const CONTACT_COLOR: Rgb = [231, 76, 60];
const ACTION_COLOR: Rgb = [255, 0, 0];
/// Half the length of a contact line beyond its two points, in pixels.
const CONTACT_REACH: f64 = 2.0;
/// The inner disc of the agent is this much smaller, in pixels.
const RIM: f64 = 4.0;

/// Colors and goal of an episode.
#[derive(Clone, Debug)]
pub struct Look {
    background: Rgb,
    agent: Rgb,
    block: Rgb,
    goal: Option<GoalShape>,
}

#[derive(Clone, Debug)]
struct GoalShape {
    color: Rgb,
    parts: Vec<[[f64; 2]; 4]>,
}

impl Background for Look {
    fn render_background(&self, painter: &mut dyn Painter) {
        painter.fill(self.background);
        if let Some(goal) = &self.goal {
            for corners in &goal.parts {
                painter.polygon(corners, goal.color);
            }
        }
    }
}

impl Look {
    pub(super) fn new(fov: &Fov, shape: Shape, settings: &Settings) -> Self {
        let goal = settings.with_target.then(|| {
            let scale = if fov.touched("goal.scale") || settings.init_value.contains_key("goal.scale") {
                fov.f32("goal.scale")
            } else {
                fov.f32("block.scale")
            };
            let (sin, cos) = fov.f64("goal.angle").sin_cos();
            let [x0, y0]: [f64; 2] = fov.vector("goal.position");
            let place = |[x, y]: [f64; 2]| [x0 + cos * x - sin * y, y0 + sin * x + cos * y];
            let parts = shape.rectangles(scale).map(|part| part.corners().map(place)).collect();
            GoalShape { color: fov.rgb("goal.color"), parts }
        });
        Self {
            background: fov.rgb("background.color"),
            agent: fov.rgb("agent.color"),
            block: fov.rgb("block.color"),
            goal,
        }
    }

    /// Everything else. `target` is the controller's, if it is to be marked.
    pub(super) fn render(&self, sim: &impl Engine, target: Option<[f64; 2]>, painter: &mut dyn Painter) {
        self.render_bodies(sim, painter);
        for wall in &WALL_SEGMENTS {
            painter.fat_segment(wall.from, wall.to, WALL_COLOR);
        }
        for contact in sim.contacts() {
            let [nx, ny] = contact.normal.map(|n| CONTACT_REACH * n);
            let ([ax, ay], [bx, by]) = (contact.on_first, contact.on_second);
            painter.aa_line([ax - nx, ay - ny], [bx + nx, by + ny], CONTACT_COLOR);
        }
        if let Some([x, y]) = target {
            painter.fat_segment([x - 20.0, y], [x + 20.0, y], ACTION_COLOR);
            painter.fat_segment([x, y - 20.0], [x, y + 20.0], ACTION_COLOR);
        }
    }

    /// The reference renders shapes in the order of a hash table: with up to four moving parts the first comes
    /// last, otherwise they come in order.
    fn render_bodies(&self, sim: &impl Engine, painter: &mut dyn Painter) {
        let count = |body| sim.shape(body).part_count();
        let first_last = count(BodyId::Agent) + count(BodyId::Block) <= 4;
        let skipped = usize::from(first_last);
        self.render_parts(sim, BodyId::Agent, skipped.., painter);
        self.render_parts(sim, BodyId::Block, 0.., painter);
        if first_last {
            self.render_parts(sim, BodyId::Agent, ..1, painter);
        }
    }

    fn render_parts(
        &self,
        sim: &impl Engine,
        body: BodyId,
        parts: impl std::ops::RangeBounds<usize>,
        painter: &mut dyn Painter,
    ) {
        let color = if body == BodyId::Agent { self.agent } else { self.block };
        if sim.shape(body) == Shape::Disc {
            if parts.contains(&0) {
                let (center, radius) = (sim.position(body), Shape::disc_radius(sim.scale(body)));
                painter.disc(center, radius, color);
                painter.disc(center, radius - RIM, light(color));
            }
            return;
        }
        for (_, corners) in sim.corners(body).enumerate().filter(|(index, _)| parts.contains(index)) {
            painter.polygon(&corners, light(color));
            for (index, &from) in corners.iter().enumerate() {
                painter.fat_segment(from, corners[(index + 1) % 4], color);
            }
        }
    }
}
