//! Images of the rooms: what does not move is rendered once per episode, the agent's dot in every frame, over as little as
//! possible. How a dot is blended is `dot.rs`.

use swm_core::ImageSize;
use swm_fov::Fov;
use swm_render::{AntialiasBilinear, Rect, RenderError, Rgb};

use super::dot::Dot;
use super::room::{IMAGE_PX, Room, WALL_CENTER_PX};
use super::settings::Settings;
use crate::settings::Render;

/// Where border lines begin, on either axis, and their width: inside of the borders that stop the agent.
const BORDER_LINES: [i32; 2] = [10, 210];
const BORDER_LINE_PX: i32 = 4;

/// What does not move in an episode: it is rendered anew only where it differs.
pub(crate) trait Scenery: PartialEq {
    /// Renders everything but the agent into a `[224, 224, 3]` image.
    fn render(&self, image: &mut [u8]);
}

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

/// Renders frames of one size.
pub(crate) struct Artist<L> {
    style: Render,
    size: [usize; 2],
    look: Option<L>,
    /// Everything but the agent, and with it: `[224, 224, 3]`; in the fast style the second has the size of the frame.
    scene: Vec<u8>,
    canvas: Vec<u8>,
    /// The scene at the size of the frame: fast style only.
    small_scene: Vec<u8>,
    /// The frame, where it is a resized canvas.
    frame: Vec<u8>,
    resize: Option<AntialiasBilinear>,
    /// Where the canvas differs from the scene.
    dotted: Rect,
}

impl<L: Scenery> Artist<L> {
    pub(crate) fn new(size: ImageSize, style: Render) -> Result<Self, RenderError> {
        let [size, image] = [[size.height, size.width], [IMAGE_PX; 2]];
        let is_resized = size != image;
        let bytes = |[height, width]: [usize; 2]| vec![0; height * width * 3];
        let is_fast = style == Render::Fast;
        Ok(Self {
            style,
            size,
            look: None,
            scene: bytes(image),
            canvas: bytes(if is_fast { size } else { image }),
            small_scene: if is_fast { bytes(size) } else { Vec::new() },
            frame: if is_resized && !is_fast { bytes(size) } else { Vec::new() },
            resize: is_resized.then(|| AntialiasBilinear::new(image, size)).transpose()?,
            dotted: Rect::default(),
        })
    }

    /// Renders what does not move, unless it looks as before.
    pub(crate) fn set_look(&mut self, look: L) -> Result<(), RenderError> {
        if self.look.as_ref() == Some(&look) {
            return Ok(());
        }
        look.render(&mut self.scene);
        self.look = Some(look);
        self.dotted = Rect::default();
        match (self.style, &mut self.resize) {
            (Render::Exact, resize) => {
                self.canvas.copy_from_slice(&self.scene);
                resize.as_mut().map_or(Ok(()), |resize| resize.resize(&self.scene, &mut self.frame))
            }
            (Render::Fast, resize) => {
                match resize {
                    Some(resize) => resize.resize(&self.scene, &mut self.small_scene)?,
                    None => self.small_scene.copy_from_slice(&self.scene),
                }
                self.canvas.copy_from_slice(&self.small_scene);
                Ok(())
            }
        }
    }

    /// Renders the agent over the scene and writes the frame, `[H, W, 3]`.
    pub(crate) fn render(&mut self, agent: &Dot, out: &mut [u8]) -> Result<(), RenderError> {
        let old = self.dotted;
        match self.style {
            Render::Fast => {
                copy(&self.small_scene, &mut self.canvas, self.size[1], old);
                self.dotted = agent.blend_quickly(&mut self.canvas, self.size);
                out.copy_from_slice(&self.canvas);
            }
            Render::Exact => {
                copy(&self.scene, &mut self.canvas, IMAGE_PX, old);
                self.dotted = agent.blend_exactly(&mut self.canvas);
                let Some(resize) = &mut self.resize else {
                    out.copy_from_slice(&self.canvas);
                    return Ok(());
                };
                if old.meets(&self.dotted) {
                    resize.update(&self.canvas, old.union(&self.dotted), &mut self.frame)?;
                } else {
                    resize.update(&self.canvas, old, &mut self.frame)?;
                    resize.update(&self.canvas, self.dotted, &mut self.frame)?;
                }
                out.copy_from_slice(&self.frame);
            }
        }
        Ok(())
    }
}

/// Fills the part of a rectangle that lies in a `[224, 224, 3]` image.
pub(crate) fn fill(image: &mut [u8], rect: Rect, color: Rgb) {
    let size = IMAGE_PX as i32;
    let rect = rect.intersect(&Rect::new(0, 0, size, size));
    if rect.is_empty() {
        return;
    }
    for y in rect.y0..rect.y1 {
        let row = &mut image.as_chunks_mut::<3>().0[y as usize * IMAGE_PX..][..IMAGE_PX];
        row[rect.x0 as usize..rect.x1 as usize].fill(color);
    }
}

/// Copies a rectangle between two images of the same size.
fn copy(from: &[u8], to: &mut [u8], width: usize, rect: Rect) {
    for y in rect.y0..rect.y1 {
        let row = y as usize * width;
        let bytes = (row + rect.x0 as usize) * 3..(row + rect.x1 as usize) * 3;
        to[bytes.clone()].copy_from_slice(&from[bytes]);
    }
}
