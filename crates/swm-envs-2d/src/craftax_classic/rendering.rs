//! Images: what is around the player, darkened at night, above the inventory. Their layout, darkness and noise are the
//! original's; the tiles are this crate's own.

use swm_core::ImageSize;
use swm_render::{AntialiasBilinear, RenderError};

use super::observation::{VIEW, in_view, view};
use super::rules::Cell;
use super::state::State;
use super::threefry::Key;
use super::tiles::{
    ARROW, Art, BLOCKS, COW, DIGIT_PX, DIGITS, GOODS, ICON_PX, MADE_OF, PICKAXE, PLAYER, SKELETON, SWORD,
    TILE_PX, ZOMBIE, color,
};

/// Columns and rows of an image at its original size, px.
const SIDE_PX: usize = VIEW[1] * TILE_PX;
/// Rows of the world in it, px.
const WORLD_PX: usize = VIEW[0] * TILE_PX;
/// Where the player is in the image, as fractions of width and height.
pub(super) const PLAYER_AT: [f64; 2] = [0.5, 3.5 / 9.0];
/// Where a digit is on its tile, px.
const DIGIT_AT: usize = TILE_PX - DIGIT_PX - 1;

/// Renders frames of one size.
pub(super) struct Artist {
    /// `[63, 63, 3]`.
    canvas: Vec<f32>,
    /// How far the world darkens at each of its pixels in the darkest night, 0 to 1.
    darkness: Vec<f32>,
    /// The canvas as bytes, each pixel a square of `zoom` pixels.
    zoomed: Vec<u8>,
    zoom: usize,
    /// Makes the frame of it, where it has another size.
    resize: Option<AntialiasBilinear>,
}

impl Artist {
    pub(super) fn new(size: ImageSize) -> Result<Self, RenderError> {
        let frame = [size.height, size.width];
        let zoom = size.height.max(size.width).div_ceil(SIDE_PX);
        let zoomed = [SIDE_PX * zoom; 2];
        let resize = (frame != zoomed).then(|| AntialiasBilinear::new(zoomed, frame)).transpose()?;
        let from_center = |at: usize, of: usize| at as f64 * 2.0 / (of - 1) as f64 - 1.0;
        let darkness = (0..WORLD_PX * SIDE_PX).map(|pixel| {
            let [y, x] = [from_center(pixel / SIDE_PX, WORLD_PX), from_center(pixel % SIDE_PX, SIDE_PX)];
            (1.0 - (-0.5 * (x * x + y * y) / 0.25).exp()) as f32
        });
        Ok(Self {
            canvas: vec![0.0; SIDE_PX * SIDE_PX * 3],
            darkness: darkness.collect(),
            zoomed: vec![0; SIDE_PX * zoom * SIDE_PX * zoom * 3],
            zoom,
            resize,
        })
    }

    /// Renders a state and writes the frame, `[H, W, 3]`.
    pub(super) fn render(&mut self, state: &State, out: &mut [u8]) -> Result<(), RenderError> {
        self.render_world(state);
        self.render_time(state);
        self.render_inventory(state);
        let side = SIDE_PX * self.zoom;
        for (pixel, rgb) in self.zoomed.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let [y, x] = [pixel / side / self.zoom, pixel % side / self.zoom];
            let from = (y * SIDE_PX + x) * 3;
            *rgb = std::array::from_fn(|i| self.canvas[from + i].clamp(0.0, 255.0) as u8);
        }
        match &mut self.resize {
            Some(resize) => resize.resize(&self.zoomed, out),
            None => {
                out.copy_from_slice(&self.zoomed);
                Ok(())
            }
        }
    }

    fn render_world(&mut self, state: &State) {
        for (row, blocks) in view(state).into_iter().enumerate() {
            for (column, block) in blocks.into_iter().enumerate() {
                self.draw(&BLOCKS[usize::from(block)], [row * TILE_PX, column * TILE_PX], |art, y, x| {
                    art[y][x]
                });
            }
        }
        let looks = if state.vitals.is_sleeping { 4 } else { state.direction as usize - 1 };
        self.draw_at(state, state.player, &PLAYER[looks], |art, y, x| art[y][x]);
        let kinds = [(&state.zombies[..], &ZOMBIE), (&state.cows, &COW), (&state.skeletons, &SKELETON)];
        for (mobs, art) in kinds {
            for mob in mobs.iter().filter(|mob| mob.is_alive) {
                self.draw_at(state, mob.at, art, |art, y, x| art[y][x]);
            }
        }
        for arrow in state.arrows.iter().filter(|arrow| arrow.is_flying) {
            let [down, right] = arrow.direction;
            self.draw_at(state, arrow.at, &ARROW, |art, y, x| {
                let [y, x] = if right == 0 { [y, x] } else { [x, y] };
                art[if down > 0 || right > 0 { TILE_PX - 1 - y } else { y }][x]
            });
        }
    }

    /// Night, and sleep.
    fn render_time(&mut self, state: &State) {
        const NIGHT: [f32; 3] = [0.0, 16.0, 64.0];
        let light = state.light;
        let noise = (light < 0.5).then(|| Key::from_words(state.noise_key).next().side());
        let pixels = self.canvas.as_chunks_mut::<3>().0.iter_mut().zip(&self.darkness);
        for (index, (rgb, darkness)) in pixels.enumerate() {
            let mut night = *rgb;
            if let Some(key) = noise {
                let mask = 2.0 * (0.5 - light) * darkness;
                let gray = key.uniform_at(index as u32) * 95.0 + 32.0;
                night = night.map(|level| (1.0 - mask) * level + mask * gray);
            }
            let luminance = luminance(night);
            for i in 0..3 {
                let faded = night[i] * 0.4 + 0.6 * luminance;
                rgb[i] = light * rgb[i] + (1.0 - light) * (0.5 * faded + 0.5 * NIGHT[i]);
            }
            if state.vitals.is_sleeping {
                let gray = 0.5 * self::luminance(*rgb);
                *rgb = [gray, gray, gray + 8.0];
            }
        }
    }

    fn render_inventory(&mut self, state: &State) {
        self.canvas[WORLD_PX * SIDE_PX * 3..].fill(0.0);
        let vitals = &state.vitals;
        let counts = state.inventory.counts();
        let levels = [vitals.health, vitals.food, vitals.drink, vitals.energy].map(|level| level as u8);
        let [wood, stone, coal, iron, diamond, sapling, tools @ ..] = counts;
        let goods = [sapling, wood, stone, coal, iron, diamond];
        for (slot, count) in levels.into_iter().chain(goods).enumerate() {
            self.draw_slot(slot, &GOODS[slot], count, 0);
        }
        for (slot, count) in tools.into_iter().enumerate() {
            let art = if slot < 3 { &PICKAXE } else { &SWORD };
            self.draw_slot(GOODS.len() + slot, art, count, MADE_OF[slot % 3]);
        }
    }

    /// Draws an icon and how many there are of it.
    fn draw_slot(&mut self, slot: usize, art: &Art<ICON_PX>, count: u8, made_of: u8) {
        if count == 0 {
            return;
        }
        let corner = [WORLD_PX + slot / VIEW[1] * TILE_PX, slot % VIEW[1] * TILE_PX];
        self.draw(
            art,
            corner,
            |art, y, x| if art[y][x] == b'e' && made_of != 0 { made_of } else { art[y][x] },
        );
        let digit = DIGITS[usize::from(count - 1).min(DIGITS.len() - 1)];
        self.draw(&digit, corner.map(|c| c + DIGIT_AT), |art, y, x| art[y][x]);
    }

    /// Draws a tile on a cell, if that is in the view.
    fn draw_at(
        &mut self,
        state: &State,
        cell: Cell,
        art: &Art<TILE_PX>,
        at: impl Fn(&Art<TILE_PX>, usize, usize) -> u8,
    ) {
        if let Some([row, column]) = in_view(state, cell) {
            self.draw(art, [row * TILE_PX, column * TILE_PX], at);
        }
    }

    fn draw<const N: usize>(
        &mut self,
        art: &Art<N>,
        [top, left]: [usize; 2],
        at: impl Fn(&Art<N>, usize, usize) -> u8,
    ) {
        for y in 0..N {
            for x in 0..N {
                if let Some(rgb) = color(at(art, y, x)) {
                    let pixel = ((top + y) * SIDE_PX + left + x) * 3;
                    self.canvas[pixel..pixel + 3].copy_from_slice(&rgb.map(f32::from));
                }
            }
        }
    }
}

/// The brightness of a color.
fn luminance([red, green, blue]: [f32; 3]) -> f32 {
    0.299 * red + 0.587 * green + 0.114 * blue
}
