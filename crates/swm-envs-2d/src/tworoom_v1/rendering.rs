//! How TwoRoom is rendered: once, against `Painter`, for exact and fast images alike. Floor, goal, borders, wall pieces
//! and doors below, the agent on top. (The reference renders borders after doors; the two never meet.)
//!
//! Only the floor is the renderer's background. The rest differs between episodes in few pixels, and the renderer
//! renders again what differs.

use swm_fov::Fov;
use swm_render::{Painter, Rgb, light, round_half_even};

use super::factors::{agent_radius, goal_radius};
use super::physics::{Aabb, FloorPlan, Vec2};
use crate::image::Background;

/// The inner part of a disc is this much smaller, and the corners of the inner part of a rectangle this much nearer to
/// its middle, pixels.
const RIM_PX: f64 = 4.0;

/// Everything about an episode's images but the places of agent and goal.
#[derive(Clone, Debug)]
pub(super) struct Look {
    background: Rgb,
    agent: Spot,
    goal: Spot,
    rectangles: Vec<Filled>,
}

/// A disc with a rim.
#[derive(Clone, Copy, Debug)]
struct Spot {
    radius: f64,
    color: Rgb,
}

/// A rectangle with its paler inside, rounded to pixels.
#[derive(Clone, Copy, Debug)]
struct Filled {
    outer: [[f64; 2]; 4],
    inner: [[f64; 2]; 4],
    color: Rgb,
}

impl Background for Look {
    fn render_background(&self, painter: &mut dyn Painter) {
        painter.fill(self.background);
    }
}

impl Look {
    pub(super) fn new(fov: &Fov, plan: &FloorPlan) -> Self {
        let spot = |radius: f64, color| Spot { radius: radius.round_ties_even(), color: fov.rgb(color) };
        let (border, wall, door) =
            (fov.rgb("wall.border_color"), fov.rgb("wall.color"), fov.rgb("door.color"));
        let borders = plan.borders.iter().map(|area| Filled::new(area, border));
        let pieces =
            plan.pieces.iter().map(|piece| Filled::new(&piece.area, if piece.is_door { door } else { wall }));
        Self {
            background: fov.rgb("background.color"),
            agent: spot(agent_radius(fov), "agent.color"),
            goal: spot(goal_radius(fov), "goal.color"),
            rectangles: borders.chain(pieces).collect(),
        }
    }

    /// Everything else.
    pub(super) fn render(&self, agent: Vec2, goal: Vec2, painter: &mut dyn Painter) {
        self.goal.render(goal, painter);
        for rectangle in &self.rectangles {
            painter.polygon(&rectangle.outer, rectangle.color);
            painter.polygon(&rectangle.inner, light(rectangle.color));
        }
        self.agent.render(agent, painter);
    }
}

impl Spot {
    fn render(&self, center: Vec2, painter: &mut dyn Painter) {
        painter.disc(center.to_array(), self.radius, self.color);
        painter.disc(center.to_array(), self.radius - RIM_PX, light(self.color));
    }
}

impl Filled {
    fn new(area: &Aabb, color: Rgb) -> Self {
        let Aabb { min, max } = *area;
        let corners = [[min.x, min.y], [max.x, min.y], [max.x, max.y], [min.x, max.y]].map(Vec2::from);
        let middle = (corners[0] + corners[2]) * 0.5;
        let inner = corners.map(|corner| {
            let inwards = middle - corner;
            let distance = inwards.norm();
            if distance < RIM_PX { corner } else { corner + inwards * (RIM_PX / distance) }
        });
        let on_pixels = |corner: Vec2| corner.to_array().map(|x| f64::from(round_half_even(x)));
        Self { outer: corners.map(on_pixels), inner: inner.map(on_pixels), color }
    }
}
