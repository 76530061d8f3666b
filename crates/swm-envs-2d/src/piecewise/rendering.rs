//! What does not move in an image: floor, zones, the arrows of their pushes, border, target.

use swm_fov::Fov;
use swm_render::{Rect, Rgb};

use super::factors::color_name;
use super::zones::Zones;
use crate::artist::{Scenery, Sprite as _};
use crate::tworoom_v2::dot::Dot;
use crate::tworoom_v2::rendering::{fill, render_border};
use crate::tworoom_v2::room::IMAGE_PX;

/// Colors and things of an episode.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Look {
    background: Rgb,
    border: Rgb,
    zones: Zones,
    /// The colors of the zones, where they are rendered.
    colors: Vec<Rgb>,
    has_arrows: bool,
    target: Option<Dot>,
}

impl Look {
    /// The look of an episode with its target at `target`.
    pub(super) fn new(fov: &Fov, zones: &Zones, target: [f32; 2]) -> Self {
        let is_set = |name: &str| fov.i64(name) == 1;
        let count = if is_set("rendering.render_zones") { zones.biases.len() } else { 0 };
        Self {
            background: fov.rgb("background.color"),
            border: fov.rgb("border.color"),
            zones: zones.clone(),
            colors: (0..count).map(|zone| fov.rgb(&color_name(zone))).collect(),
            has_arrows: is_set("rendering.render_bias_field"),
            target: is_set("rendering.render_target").then(|| Dot {
                center: target,
                radius: fov.f32("target.radius"),
                color: fov.rgb("target.color"),
            }),
        }
    }

    /// The pixels of a zone.
    fn cell(&self, zone: usize) -> Rect {
        let (row, column) = (zone / self.zones.grid_n, zone % self.zones.grid_n);
        let edge = |k: usize| self.zones.edge(k);
        Rect::new(edge(column), edge(row), edge(column + 1), edge(row + 1))
    }

    /// An arrow from the middle of a zone, along its push.
    fn render_arrow(&self, zone: usize, image: &mut [u8]) {
        /// Length of the arrow of a push of 1 px, half the width of its shaft, and that of its head, px.
        const LENGTH: f32 = 8.0;
        const SHAFT: f32 = 1.0;
        const HEAD: f32 = 4.0;
        const COLOR: Rgb = [64, 64, 64];
        let cell = self.cell(zone);
        let middle = [(cell.x0 + cell.x1) as f32 / 2.0, (cell.y0 + cell.y1) as f32 / 2.0];
        let [x, y] = self.zones.biases[zone];
        let push = x.hypot(y);
        let length = LENGTH * push;
        if length == 0.0 {
            return;
        }
        let [x, y] = [x / push, y / push];
        for py in cell.y0..cell.y1 {
            for px in cell.x0..cell.x1 {
                let [dx, dy] = [px as f32 + 0.5 - middle[0], py as f32 + 0.5 - middle[1]];
                let (along, across) = (dx * x + dy * y, (dy * x - dx * y).abs());
                let neck = (length - 2.0 * HEAD).max(0.0);
                let half = if along < neck { SHAFT } else { (length - along) / 2.0 };
                if (0.0..length).contains(&along) && across <= half {
                    fill(image, Rect::new(px, py, px + 1, py + 1), COLOR);
                }
            }
        }
    }
}

impl Scenery for Look {
    const SIDE: usize = IMAGE_PX;

    fn render(&self, image: &mut [u8]) {
        let size = IMAGE_PX as i32;
        fill(image, Rect::new(0, 0, size, size), self.background);
        for (zone, color) in self.colors.iter().enumerate() {
            fill(image, self.cell(zone), *color);
        }
        if self.has_arrows {
            (0..self.zones.biases.len()).for_each(|zone| self.render_arrow(zone, image));
        }
        render_border(image, self.border);
        if let Some(target) = &self.target {
            target.blend_exactly(image);
        }
    }
}
