//! How a maze is rendered: floor, goal and walls below, the disc on top, all of the maze in one square image.

use swm_fov::Fov;
use swm_render::{Painter, Rgb, light};

use super::factors::{disc, layout};
use super::layout::{CELL, Layout, center};
use crate::image::Background;
use crate::shortest_path::Rectangle;

/// Side of the canvas, pixels.
const CANVAS: f64 = 512.0;
/// The inner part of the disc, as a share of its radius.
const INNER: f64 = 0.7;

/// Colors and still parts of an episode, in pixels of the canvas.
#[derive(Clone, Debug)]
pub(super) struct Look {
    floor: Rgb,
    wall: Rgb,
    agent: Rgb,
    goal: Option<Goal>,
    walls: Vec<[[f64; 2]; 4]>,
    inside: [[f64; 2]; 4],
    scale: Scale,
    radius_px: f64,
}

#[derive(Clone, Debug)]
struct Goal {
    color: Rgb,
    center: [f64; 2],
    radius_px: f64,
}

/// From the maze to the canvas.
#[derive(Clone, Copy, Debug)]
struct Scale {
    px_per_unit: f64,
    /// Canvas pixels of the maze's origin.
    origin: [f64; 2],
}

impl Scale {
    fn new([rows, cols]: [usize; 2]) -> Scale {
        let px_per_unit = CANVAS / (CELL * rows.max(cols) as f64);
        let corner = center([0, 0]).map(|c| c - CELL / 2.0);
        let size = [cols, rows].map(|count| CELL * count as f64);
        let origin = [0, 1].map(|axis| CANVAS / 2.0 - px_per_unit * (corner[axis] + size[axis] / 2.0));
        Scale { px_per_unit, origin }
    }

    fn place(&self, place: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| self.origin[axis] + self.px_per_unit * place[axis])
    }

    fn rectangle(&self, Rectangle { min, max }: &Rectangle) -> [[f64; 2]; 4] {
        [*min, [max[0], min[1]], *max, [min[0], max[1]]].map(|corner| self.place(corner))
    }
}

/// Where a place of the maze is in the image, as fractions of its sides.
pub(super) fn in_image(layout: &Layout, place: [f64; 2]) -> [f64; 2] {
    Scale::new(layout.size()).place(place).map(|px| px / CANVAS)
}

impl Background for Look {
    fn render_background(&self, painter: &mut dyn Painter) {
        painter.fill(self.wall);
        painter.polygon(&self.inside, self.floor);
        if let Some(goal) = &self.goal {
            painter.disc(goal.center, goal.radius_px, goal.color);
        }
        for wall in &self.walls {
            painter.polygon(wall, self.wall);
        }
    }
}

impl Look {
    /// `goal`: where to render it, if it is to be rendered.
    pub(super) fn new(fov: &Fov, goal: Option<[f64; 2]>) -> Look {
        let layout = layout(fov);
        let [rows, cols] = layout.size();
        let scale = Scale::new([rows, cols]);
        let [min, max] = [[0, 0], [rows as i64 - 1, cols as i64 - 1]].map(center);
        Look {
            floor: fov.rgb("floor.color"),
            wall: fov.rgb("wall.color"),
            agent: fov.rgb("agent.color"),
            goal: goal.map(|goal| Goal {
                color: fov.rgb("goal.color"),
                center: scale.place(goal),
                radius_px: scale.px_per_unit * fov.f64("goal.radius"),
            }),
            walls: layout.walls().iter().map(|wall| scale.rectangle(wall)).collect(),
            inside: scale.rectangle(&Rectangle { min, max }),
            scale,
            radius_px: scale.px_per_unit * disc(fov).radius,
        }
    }

    /// The disc.
    pub(super) fn render(&self, position: [f64; 2], painter: &mut dyn Painter) {
        let center = self.scale.place(position);
        painter.disc(center, self.radius_px, self.agent);
        painter.disc(center, INNER * self.radius_px, light(self.agent));
    }
}
