//! The fast style: frames rendered at the asked size with analytic coverage, redrawn only where the drawing changed.
//!
//! Coverage is that of the pixel's filter, not of its square: see `coverage.rs`. So a frame looks as if the exact one
//! had been made at infinite resolution.

mod coverage;
mod shapes;

use multiversion::multiversion;

use crate::canvas::{pack, unpack};
use crate::damage::Damage;
use crate::display_list::{DisplayList, Shape};
use crate::error::{RenderError, check_len};
use crate::geometry::Geometry;
use crate::painter::{Painter, Rgb};
use crate::palette::Palette;
use crate::rect::Rect;
use crate::turn_arrow;
use coverage::{Lens, Target};
use shapes::{Capsule, ConvexPolygon, Disc, Polygon};

/// Renders frames at the asked size. See [`Renderer`](crate::Renderer) for the calls.
#[derive(Debug, Clone)]
pub struct FastRenderer {
    geometry: Geometry,
    lens: Lens,
    palette: Palette,
    drawn: DisplayList<f32>,
    next: DisplayList<f32>,
    background_list: DisplayList<f32>,
    /// `[H, W, 3]`: the background, and the background with the drawing over it.
    background: Vec<u8>,
    frame: Vec<u8>,
    damage: Damage,
    all_damaged: bool,
}

impl FastRenderer {
    /// Allocates everything that frames of this geometry need.
    ///
    /// # Errors
    /// If a side is zero or above 4096.
    pub fn new(geometry: Geometry) -> Result<Self, RenderError> {
        geometry.check()?;
        Ok(Self {
            geometry,
            lens: Lens::new(geometry),
            palette: Palette::default(),
            drawn: DisplayList::new(),
            next: DisplayList::new(),
            background_list: DisplayList::new(),
            background: vec![0; geometry.frame_len()],
            frame: vec![0; geometry.frame_len()],
            damage: Damage::new(Rect::of_size(geometry.height, geometry.width)),
            all_damaged: true,
        })
    }

    /// The sizes.
    #[must_use]
    pub fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// See [`Renderer::set_palette`](crate::Renderer::set_palette).
    pub fn set_palette(&mut self, swaps: &[(Rgb, Rgb)]) {
        // Colors are replaced as they are recorded: lists with other colors differ.
        self.palette.set(swaps);
    }

    /// See [`Renderer::set_background`](crate::Renderer::set_background).
    pub fn set_background(&mut self, draw: impl FnOnce(&mut dyn Painter)) {
        // The list of the frame to come is free until then.
        let new = &mut self.next;
        new.clear();
        draw(&mut FastPainter::new(new, &self.lens, &self.palette, self.geometry));
        if *new == self.background_list {
            return;
        }
        std::mem::swap(new, &mut self.background_list);
        self.background.fill(0);
        let all = self.lens.frame();
        replay(&self.background_list, &self.lens, &mut Target::new(&mut self.background, &self.lens, all));
        self.all_damaged = true;
    }

    /// See [`Renderer::render`](crate::Renderer::render).
    ///
    /// # Errors
    /// If `out` has the wrong length; nothing is rendered then.
    pub fn render(&mut self, out: &mut [u8], draw: impl FnOnce(&mut dyn Painter)) -> Result<(), RenderError> {
        let Geometry { height, width, .. } = self.geometry;
        check_len("the frame to write", out.len(), height, width)?;
        self.next.clear();
        draw(&mut FastPainter::new(&mut self.next, &self.lens, &self.palette, self.geometry));
        self.update();
        out.copy_from_slice(&self.frame);
        Ok(())
    }

    fn update(&mut self) {
        self.damage.clear();
        if self.all_damaged {
            self.damage.add_all();
        } else {
            self.next.changes_since(&self.drawn, |primitive| self.damage.add(primitive.bounds));
        }
        for rect in self.damage.rects() {
            for y in rect.rows() {
                let start = y * self.geometry.width * 3;
                let bytes = start + rect.x0 as usize * 3..start + rect.x1 as usize * 3;
                self.frame[bytes.clone()].copy_from_slice(&self.background[bytes]);
            }
            replay(&self.next, &self.lens, &mut Target::new(&mut self.frame, &self.lens, *rect));
        }
        self.all_damaged = false;
        std::mem::swap(&mut self.drawn, &mut self.next);
    }
}

/// Half-widths in canvas pixels of what the exact raster makes of a fat segment (5 px) and an anti-aliased line (1 px).
const FAT_RADIUS: f32 = 2.5;
const LINE_RADIUS: f32 = 0.5;

#[multiversion(targets("x86_64+avx2"))]
fn replay(list: &DisplayList<f32>, lens: &Lens, target: &mut Target<'_>) {
    for primitive in list.iter() {
        let visible = primitive.bounds.intersect(&target.clip());
        if visible.is_empty() {
            continue;
        }
        let color = primitive.color;
        match (primitive.shape, primitive.points) {
            (Shape::Fill, _) => target.fill(color),
            (Shape::Polygon, points) => match ConvexPolygon::new(points, lens) {
                Some(polygon) => target.paint(&polygon, visible, color),
                None => target.paint(&Polygon::new(points, lens), visible, color),
            },
            (Shape::Disc, [center, ..]) => {
                target.paint(&Disc::new(*center, primitive.radius, lens), visible, color);
            }
            (Shape::FatSegment | Shape::AaLine | Shape::TurnArrow, [from, to, ..]) => {
                let radius = match primitive.shape {
                    Shape::FatSegment => FAT_RADIUS,
                    Shape::AaLine => LINE_RADIUS,
                    _ => primitive.radius,
                };
                target.paint(&Capsule::new(*from, *to, radius, lens), visible, color);
            }
            _ => {}
        }
    }
}

/// Records primitives in continuous canvas coordinates, where pixel i is the interval from i to i + 1.
struct FastPainter<'a> {
    list: &'a mut DisplayList<f32>,
    lens: &'a Lens,
    palette: &'a Palette,
    /// Height of a canvas with y up.
    flipped: Option<f64>,
}

/// What the exact painter rounds to pixel i is, on average, the middle of that pixel.
const PIXEL_CENTER: f64 = 0.5;

/// How far the exact painter's truncation moves a coordinate towards zero, on average.
const TRUNCATED: f64 = 0.5;

impl<'a> FastPainter<'a> {
    fn new(list: &'a mut DisplayList<f32>, lens: &'a Lens, palette: &'a Palette, geometry: Geometry) -> Self {
        let flipped = geometry.y_up.then_some(geometry.canvas[0] as f64);
        FastPainter { list, lens, palette, flipped }
    }

    /// A point in continuous coordinates of the image.
    fn place(&self, [x, y]: [f64; 2], offset: f64) -> [f32; 2] {
        let [x, y] = [x + offset, y + offset];
        [x as f32, self.flipped.map_or(y, |height| height - y) as f32]
    }

    fn shift(&self, point: [f64; 2]) -> [f32; 2] {
        self.place(point, PIXEL_CENTER)
    }

    fn color(&self, color: Rgb) -> Rgb {
        unpack(self.palette.apply(pack(color)))
    }

    fn push_pair(&mut self, shape: Shape, ends: [[f64; 2]; 2], radius: f32, color: Rgb) {
        let points = ends.map(|end| self.shift(end));
        let color = self.color(color);
        self.list.push(shape, points.into_iter(), 0.0, color, self.lens.bounds(&points, radius));
    }

    fn push_polygon(&mut self, vertices: &[[f64; 2]], offset: f64, color: Rgb) {
        let color = self.color(color);
        let bounds = vertices.iter().fold(Rect::default(), |bounds, vertex| {
            bounds.union(&self.lens.bounds(&[self.place(*vertex, offset)], shapes::POLYGON_GROWTH))
        });
        let flipped = self.flipped;
        let place = |[x, y]: [f64; 2]| {
            let [x, y] = [x + offset, y + offset];
            [x as f32, flipped.map_or(y, |height| height - y) as f32]
        };
        self.list.push(Shape::Polygon, vertices.iter().copied().map(place), 0.0, color, bounds);
    }

    fn push_disc(&mut self, center: [f32; 2], radius: f32, color: Rgb) {
        let color = self.color(color);
        let bounds = if radius >= 0.5 { self.lens.bounds(&[center], radius) } else { Rect::default() };
        self.list.push(Shape::Disc, std::iter::once(center), radius, color, bounds);
    }
}

impl Painter for FastPainter<'_> {
    fn fill(&mut self, color: Rgb) {
        let color = self.color(color);
        self.list.push(Shape::Fill, std::iter::empty(), 0.0, color, self.lens.frame());
    }

    fn polygon(&mut self, vertices: &[[f64; 2]], color: Rgb) {
        self.push_polygon(vertices, PIXEL_CENTER, color);
    }

    fn disc(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        // The exact raster's discs are symmetric about a pixel's corner, not its middle.
        self.push_disc(self.place(center, 0.0), radius as f32, color);
    }

    fn fat_segment(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        self.push_pair(Shape::FatSegment, [from, to], FAT_RADIUS, color);
    }

    fn aa_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        self.push_pair(Shape::AaLine, [from, to], LINE_RADIUS, color);
    }

    fn smooth_polygon(&mut self, vertices: &[[f64; 2]], color: Rgb) {
        self.push_polygon(vertices, PIXEL_CENTER - TRUNCATED, color);
    }

    fn smooth_disc(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        let reach = radius.trunc() as f32 + 0.5;
        self.push_disc(self.place(center, PIXEL_CENTER - TRUNCATED), reach, color);
    }

    fn smooth_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        self.push_pair(Shape::AaLine, [from, to], LINE_RADIUS, color);
    }

    fn axis_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        if from[0] == to[0] || from[1] == to[1] {
            self.push_pair(Shape::AaLine, [from, to].map(|end| end.map(f64::trunc)), LINE_RADIUS, color);
        }
    }

    fn turn_arrow(&mut self, center: [f64; 2], side: f64, mirrored: bool, color: Rgb) {
        if side.is_nan() || side < 1.0 {
            return;
        }
        let side = side.trunc();
        // The outline has y down.
        let down = if self.flipped.is_some() { -side } else { side };
        let across = if mirrored { -side } else { side };
        let place = |[x, y]: [f64; 2]| [center[0] + across * x, center[1] + down * y];
        let (pieces, half_width, head) = turn_arrow::outline();
        let radius = (side * half_width) as f32;
        for piece in pieces {
            let points = piece.map(|end| self.place(place(end), 0.0));
            let (color, bounds) = (self.color(color), self.lens.bounds(&points, radius));
            self.list.push(Shape::TurnArrow, points.into_iter(), radius, color, bounds);
        }
        self.push_polygon(&head.map(place), 0.0, color);
    }
}
