//! The fast style: frames rendered at the asked size with analytic coverage, redrawn only where the drawing changed.
//!
//! Coverage is that of the pixel's filter, not of its square: see `coverage.rs`. So a frame looks as if the exact one
//! had been made at infinite resolution.

mod coverage;
mod shapes;

use crate::damage::Damage;
use crate::display_list::{DisplayList, Shape};
use crate::error::{RenderError, check_len};
use crate::geometry::Geometry;
use crate::painter::{Painter, Rgb};
use crate::rect::Rect;
use coverage::{Lens, Video};
use shapes::{Capsule, ConvexPolygon, Disc, Polygon};

/// Renders frames at the asked size. See [`Renderer`](crate::Renderer) for the calls.
#[derive(Debug, Clone)]
pub struct FastRenderer {
    geometry: Geometry,
    lens: Lens,
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

    /// See [`Renderer::set_background`](crate::Renderer::set_background).
    pub fn set_background(&mut self, draw: impl FnOnce(&mut dyn Painter)) {
        // The list of the frame to come is free until then.
        let new = &mut self.next;
        new.clear();
        draw(&mut FastPainter { list: new, lens: &self.lens });
        if *new == self.background_list {
            return;
        }
        std::mem::swap(new, &mut self.background_list);
        self.background.fill(0);
        let all = self.lens.frame();
        replay(&self.background_list, &self.lens, &mut Video::new(&mut self.background, &self.lens, all));
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
        draw(&mut FastPainter { list: &mut self.next, lens: &self.lens });
        self.update();
        out.copy_from_slice(&self.frame);
        Ok(())
    }

    fn update(&mut self) {
        self.damage.clear();
        if self.all_damaged {
            self.damage.add_all();
        } else {
            self.next.damage_since(&self.drawn, &mut self.damage);
        }
        for rect in self.damage.rects() {
            for y in rect.rows() {
                let start = y * self.geometry.width * 3;
                let bytes = start + rect.x0 as usize * 3..start + rect.x1 as usize * 3;
                self.frame[bytes.clone()].copy_from_slice(&self.background[bytes]);
            }
            replay(&self.next, &self.lens, &mut Video::new(&mut self.frame, &self.lens, *rect));
        }
        self.all_damaged = false;
        std::mem::swap(&mut self.drawn, &mut self.next);
    }
}

/// Half-widths in canvas pixels of what the exact raster makes of a fat segment (5 px) and an anti-aliased line (1 px).
const FAT_RADIUS: f32 = 2.5;
const LINE_RADIUS: f32 = 0.5;

fn replay(list: &DisplayList<f32>, lens: &Lens, video: &mut Video<'_>) {
    for primitive in list.iter() {
        let visible = primitive.bounds.intersect(&video.clip());
        if visible.is_empty() {
            continue;
        }
        let color = primitive.color;
        match (primitive.shape, primitive.points) {
            (Shape::Fill, _) => video.fill(color),
            (Shape::Polygon, points) => match ConvexPolygon::new(points, lens) {
                Some(polygon) => video.paint(&polygon, visible, color),
                None => video.paint(&Polygon::new(points, lens), visible, color),
            },
            (Shape::Disc, [center, ..]) => {
                video.paint(&Disc::new(*center, primitive.radius, lens), visible, color);
            }
            (Shape::FatSegment, [from, to, ..]) => {
                video.paint(&Capsule::new(*from, *to, FAT_RADIUS, lens), visible, color);
            }
            (Shape::AaLine, [from, to, ..]) => {
                video.paint(&Capsule::new(*from, *to, LINE_RADIUS, lens), visible, color);
            }
            _ => {}
        }
    }
}

/// Records primitives in continuous canvas coordinates, where pixel i is the interval from i to i + 1.
struct FastPainter<'a> {
    list: &'a mut DisplayList<f32>,
    lens: &'a Lens,
}

/// What the exact painter rounds to pixel i is, on average, the middle of that pixel.
const PIXEL_CENTER: f64 = 0.5;

fn shift(point: [f64; 2]) -> [f32; 2] {
    point.map(|coordinate| (coordinate + PIXEL_CENTER) as f32)
}

impl FastPainter<'_> {
    fn push_pair(&mut self, shape: Shape, ends: [[f64; 2]; 2], radius: f32, color: Rgb) {
        let points = ends.map(shift);
        self.list.push(shape, points.into_iter(), 0.0, color, self.lens.bounds(&points, radius));
    }
}

impl Painter for FastPainter<'_> {
    fn fill(&mut self, color: Rgb) {
        self.list.push(Shape::Fill, std::iter::empty(), 0.0, color, self.lens.frame());
    }

    fn polygon(&mut self, vertices: &[[f64; 2]], color: Rgb) {
        let bounds = vertices.iter().fold(Rect::default(), |bounds, vertex| {
            bounds.union(&self.lens.bounds(&[shift(*vertex)], shapes::POLYGON_GROWTH))
        });
        self.list.push(Shape::Polygon, vertices.iter().copied().map(shift), 0.0, color, bounds);
    }

    fn disc(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        // The exact raster's discs are symmetric about a pixel's corner, not its middle.
        let center = center.map(|coordinate| coordinate as f32);
        let radius = radius as f32;
        let bounds = if radius >= 0.5 { self.lens.bounds(&[center], radius) } else { Rect::default() };
        self.list.push(Shape::Disc, std::iter::once(center), radius, color, bounds);
    }

    fn fat_segment(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        self.push_pair(Shape::FatSegment, [from, to], FAT_RADIUS, color);
    }

    fn aa_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        self.push_pair(Shape::AaLine, [from, to], LINE_RADIUS, color);
    }
}
