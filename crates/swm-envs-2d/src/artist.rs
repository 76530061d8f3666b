//! Images of rooms from above: what does not move is rendered once per episode, the agent in every frame, over as little as
//! possible, on a square canvas of which frames of the requested size are made.

use swm_core::ImageSize;
use swm_render::{AntialiasBilinear, Rect, RenderError, Rgb};

use crate::settings::Render;

/// What does not move in an episode: it is rendered anew only where it differs.
pub(crate) trait Scenery: PartialEq {
    /// The side of the canvas, px.
    const SIDE: usize;

    /// Renders everything but the agent into a `[SIDE, SIDE, 3]` image.
    fn render(&self, image: &mut [u8]);
}

/// What moves.
pub(crate) trait Sprite: Copy {
    /// The same elsewhere, at a position of the environment.
    fn at(self, center: [f32; 2]) -> Self;

    /// Blends it over the canvas and returns the pixels that may have changed.
    fn blend_exactly(&self, image: &mut [u8]) -> Rect;

    /// Blends it over an image of the whole canvas at `[height, width, 3]` and returns the pixels that may have changed.
    fn blend_quickly(&self, image: &mut [u8], size: [usize; 2]) -> Rect;
}

/// Renders frames of one size.
pub(crate) struct Artist<L> {
    style: Render,
    size: [usize; 2],
    look: Option<L>,
    /// Everything but the agent, and with it: `[SIDE, SIDE, 3]`; in the fast style the second has the size of the frame.
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
        let [size, image] = [[size.height, size.width], [L::SIDE; 2]];
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
    pub(crate) fn render(&mut self, agent: &impl Sprite, out: &mut [u8]) -> Result<(), RenderError> {
        let old = self.dotted;
        match self.style {
            Render::Fast => {
                copy(&self.small_scene, &mut self.canvas, self.size[1], old);
                self.dotted = agent.blend_quickly(&mut self.canvas, self.size);
                out.copy_from_slice(&self.canvas);
            }
            Render::Exact => {
                copy(&self.scene, &mut self.canvas, L::SIDE, old);
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

/// Fills the part of a rectangle that lies in a `[side, side, 3]` image.
pub(crate) fn fill(image: &mut [u8], side: usize, rect: Rect, color: Rgb) {
    let rect = rect.intersect(&Rect::new(0, 0, side as i32, side as i32));
    if rect.is_empty() {
        return;
    }
    for y in rect.y0..rect.y1 {
        let row = &mut image.as_chunks_mut::<3>().0[y as usize * side..][..side];
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
