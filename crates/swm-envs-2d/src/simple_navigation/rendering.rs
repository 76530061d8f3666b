//! Images of the grid: tiles are copied where they changed, on a canvas of which frames of the requested size are made.

use swm_core::ImageSize;
use swm_render::{AntialiasBilinear, Rect, RenderError};

use super::maze::{Cell, Maze, SIDE};
use super::tiles::{TILE_PX, Thing, Tile, tile};
use super::view::seen;

/// The side of the reference's image, px.
const SIDE_PX: usize = SIDE * TILE_PX;

/// What an image shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shown {
    pub(super) maze: Maze,
    pub(super) goal: Cell,
    pub(super) agent: Cell,
    pub(super) direction: i64,
}

impl Shown {
    /// The tile of every cell, row by row.
    fn tiles(&self) -> [&'static Tile; SIDE * SIDE] {
        let seen = seen(&self.maze, self.agent, self.direction);
        std::array::from_fn(|index| {
            let cell = [(index % SIDE) as i64, (index / SIDE) as i64];
            let thing = match self.maze.is_free(cell) {
                false => Thing::Wall,
                true if cell == self.goal => Thing::Goal,
                true => Thing::Floor,
            };
            tile(thing, (cell == self.agent).then_some(self.direction), seen[index])
        })
    }
}

/// Renders frames of one size.
pub(super) struct Artist {
    /// `[288, 288, 3]`, and the tiles that it shows.
    canvas: Vec<u8>,
    shown: [Option<&'static Tile>; SIDE * SIDE],
    /// The frame, where it is a resized canvas.
    resized: Option<(AntialiasBilinear, Vec<u8>)>,
}

impl Artist {
    pub(super) fn new(size: ImageSize) -> Result<Self, RenderError> {
        let (canvas, frame) = ([SIDE_PX; 2], [size.height, size.width]);
        let bytes = frame[0] * frame[1] * 3;
        let resize = (frame != canvas).then(|| AntialiasBilinear::new(canvas, frame)).transpose()?;
        Ok(Self {
            canvas: vec![0; SIDE_PX * SIDE_PX * 3],
            shown: [None; SIDE * SIDE],
            resized: resize.map(|resize| (resize, vec![0; bytes])),
        })
    }

    /// Renders it and writes the frame, `[H, W, 3]`.
    pub(super) fn render(&mut self, shown: &Shown, out: &mut [u8]) -> Result<(), RenderError> {
        let mut changed = Rect::default();
        let is_first = self.shown[0].is_none();
        for (index, tile) in shown.tiles().into_iter().enumerate() {
            if self.shown[index].is_some_and(|shown| std::ptr::eq(shown, tile)) {
                continue;
            }
            self.shown[index] = Some(tile);
            let [x, y] = [index % SIDE, index / SIDE].map(|cell| cell * TILE_PX);
            for (row, pixels) in tile.iter().enumerate() {
                let start = ((y + row) * SIDE_PX + x) * 3;
                self.canvas[start..start + TILE_PX * 3].copy_from_slice(pixels.as_flattened());
            }
            let [x, y] = [x, y].map(|c| c as i32);
            let rect = Rect::new(x, y, x + TILE_PX as i32, y + TILE_PX as i32);
            changed = if changed.is_empty() { rect } else { changed.union(&rect) };
        }
        let Some((resize, frame)) = &mut self.resized else {
            out.copy_from_slice(&self.canvas);
            return Ok(());
        };
        if is_first {
            resize.resize(&self.canvas, frame)?;
        } else {
            resize.update(&self.canvas, changed, frame)?;
        }
        out.copy_from_slice(frame);
        Ok(())
    }
}
