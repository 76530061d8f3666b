//! What does not move in an image of the rooms. How a dot is blended is `dot.rs`.

use swm_fov::Fov;
use swm_render::{Rect, Rgb};

use super::dot::Dot;
use super::room::{IMAGE_PX, Room, WALL_CENTER_PX};
use super::settings::Settings;
use crate::artist::{self, Scenery, Sprite as _};

/// Where border lines begin, on either axis, and their width: inside of the borders that stop the agent.
const BORDER_LINES: [i32; 2] = [10, 210];
const BORDER_LINE_PX: i32 = 4;

/// Colors and things of an episode.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Look {
    background: Rgb,
    wall: Rgb,
    border: Rgb,
    door: Rgb,
    room: Room,
    target: Option<Dot>,
}

impl Look {
    /// The look of an episode with its target at `target`.
    pub(super) fn new(fov: &Fov, target: [f32; 2], settings: &Settings) -> Self {
        let own_border =
            fov.touched("wall.border_color") || settings.init_value.contains_key("wall.border_color");
        let with_target = settings.render_target || fov.i64("rendering.render_target") == 1;
        Self {
            background: fov.rgb("background.color"),
            wall: fov.rgb("wall.color"),
            border: fov.rgb(if own_border { "wall.border_color" } else { "wall.color" }),
            door: fov.rgb("door.color"),
            room: Room::new(fov),
            target: with_target.then(|| Dot {
                center: target,
                radius: fov.f32("target.radius"),
                color: fov.rgb("target.color"),
            }),
        }
    }
}

impl Scenery for Look {
    const SIDE: usize = IMAGE_PX;

    fn render(&self, image: &mut [u8]) {
        let size = IMAGE_PX as i32;
        let (center, half) = (WALL_CENTER_PX as i32, self.room.wall_half as i32);
        let stripe = |from: i32, to: i32| {
            let ([x0, y0], [x1, y1]) =
                (self.room.position(center - half, from), self.room.position(center + half, to));
            Rect::new(x0, y0, x1 + 1, y1 + 1)
        };
        fill(image, Rect::new(0, 0, size, size), self.background);
        fill(image, stripe(0, size - 1), self.wall);
        for door in self.room.doors() {
            let (center, reach) = (door.center as i32, door.half_extent as i32);
            fill(image, stripe(center - reach, center + reach), self.door);
        }
        render_border(image, self.border);
        if let Some(target) = &self.target {
            target.blend_exactly(image);
        }
    }
}

/// Renders the lines around the rooms.
pub(crate) fn render_border(image: &mut [u8], color: Rgb) {
    let size = IMAGE_PX as i32;
    for start in BORDER_LINES {
        fill(image, Rect::new(start, 0, start + BORDER_LINE_PX, size), color);
        fill(image, Rect::new(0, start, size, start + BORDER_LINE_PX), color);
    }
}

/// Fills the part of a rectangle that lies in a `[224, 224, 3]` image.
pub(crate) fn fill(image: &mut [u8], rect: Rect, color: Rgb) {
    artist::fill(image, IMAGE_PX, rect, color);
}
