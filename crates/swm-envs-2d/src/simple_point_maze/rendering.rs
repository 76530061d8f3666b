//! Images of the room: floor, walls, goal and border once per episode, the disc in every frame.

use swm_fov::Fov;
use swm_render::{Rect, Rgb};

use super::circle::{Circle, blend, product};
use super::walls::{Room, SIDE, Wall};
use crate::artist::{Scenery, Sprite, fill};

/// The side of the reference's image, px, and pixels per unit of length.
const SIDE_PX: usize = 500;
const SCALE: f64 = SIDE_PX as f64 / SIDE as f64;
/// The opacity of the goal, of 255.
const GOAL_ALPHA: u8 = 128;
/// The frame around the room is black and covers the first row and column; of the next ones and the last it covers this much
/// of 255: it is 10/9 px wide, and its far lines are cut off.
const FRAME_ALPHA: u8 = 14;
const FRAME: Rgb = [0; 3];

/// Colors and things of an episode.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Look {
    background: Rgb,
    wall: Rgb,
    walls: Vec<Wall>,
    goal: Option<Disc>,
}

/// A disc in the room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Disc {
    pub(super) center: [f32; 2],
    pub(super) radius: f32,
    pub(super) color: Rgb,
}

impl Disc {
    fn circle(&self, [height, width]: [usize; 2]) -> Circle {
        let side = f64::from(SIDE);
        let [x, y] = self.center.map(f64::from);
        Circle::new([x, side - y], f64::from(self.radius), [width as f64 / side, height as f64 / side])
    }
}

impl Look {
    /// The look of an episode with its goal at `goal`, if that is rendered.
    pub(super) fn new(fov: &Fov, room: &Room, goal: Option<[f32; 2]>) -> Self {
        Self {
            background: fov.rgb("background.color"),
            wall: fov.rgb("walls.color"),
            walls: room.walls.clone(),
            goal: goal.map(|center| Disc {
                center,
                radius: fov.f32("goal.radius"),
                color: fov.rgb("goal.color"),
            }),
        }
    }
}

impl Scenery for Look {
    const SIDE: usize = SIDE_PX;

    fn render(&self, image: &mut [u8]) {
        fill(image, SIDE_PX, Rect::new(0, 0, SIDE_PX as i32, SIDE_PX as i32), self.background);
        for wall in &self.walls {
            let edge = |c: f32| (f64::from(c) * SCALE + 0.5).floor() as i32;
            let from_top = |y: f32| SIDE_PX as i32 - edge(y);
            let rect =
                Rect::new(edge(wall.min[0]), from_top(wall.max[1]), edge(wall.max[0]), from_top(wall.min[1]));
            fill(image, SIDE_PX, rect, self.wall);
        }
        let pixels = image.as_chunks_mut::<3>().0;
        if let Some(goal) = &self.goal {
            goal.circle([SIDE_PX; 2]).cover([SIDE_PX; 2], |x, y, level| {
                blend(&mut pixels[y * SIDE_PX + x], goal.color, product(GOAL_ALPHA, level));
            });
        }
        for y in 0..SIDE_PX {
            for x in 0..SIDE_PX {
                let pixel = &mut pixels[y * SIDE_PX + x];
                *pixel = under_frame(x, y, *pixel);
            }
        }
    }
}

/// What the frame makes of a pixel's color.
fn under_frame(x: usize, y: usize, color: Rgb) -> Rgb {
    let mut shown = color;
    for at in [x, y] {
        let alpha = match at {
            0 => 255,
            1 => FRAME_ALPHA,
            at if at == SIDE_PX - 1 => FRAME_ALPHA,
            _ => continue,
        };
        blend(&mut shown, FRAME, alpha);
    }
    shown
}

impl Sprite for Disc {
    fn at(self, center: [f32; 2]) -> Self {
        Self { center, ..self }
    }

    fn blend_exactly(&self, image: &mut [u8]) -> Rect {
        let pixels = image.as_chunks_mut::<3>().0;
        self.circle([SIDE_PX; 2]).cover([SIDE_PX; 2], |x, y, level| {
            blend(&mut pixels[y * SIDE_PX + x], under_frame(x, y, self.color), level);
        })
    }

    fn blend_quickly(&self, image: &mut [u8], size: [usize; 2]) -> Rect {
        let pixels = image.as_chunks_mut::<3>().0;
        self.circle(size).cover(size, |x, y, level| blend(&mut pixels[y * size[1] + x], self.color, level))
    }
}
