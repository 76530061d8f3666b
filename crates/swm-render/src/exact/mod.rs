//! The exact style: the reference's image pipeline to the byte, redrawn only where the drawing changed.
//!
//! canvas (512, raster rules) -> image (224, fixed-point bilinear) -> frame (asked size, antialiased bilinear; left
//! out when the asked size is the image's own, as the reference's library does). On a [`Geometry::surface`] the image is
//! the canvas, flipped, with its colors replaced.

mod arrow;
mod lines;
mod outline;
mod raster;
mod smooth;

use std::ops::Range;

use crate::canvas::{Canvas, unpack};
use crate::damage::Damage;
use crate::display_list::{DisplayList, Shape};
use crate::error::{RenderError, check_len};
use crate::geometry::Geometry;
use crate::painter::{Painter, Rgb, round_half_even, single, truncate};
use crate::palette::Palette;
use crate::rect::Rect;
use crate::region::Region;
use crate::resample::{AntialiasBilinear, FixedBilinear};
use outline::Bands;
use raster::{Raster, Scratch};

/// Draws frames as the reference does, to the byte. See [`Renderer`](crate::Renderer) for the calls.
#[derive(Debug, Clone)]
pub struct ExactRenderer {
    geometry: Geometry,
    drawn: DisplayList<i32>,
    next: DisplayList<i32>,
    background_list: DisplayList<i32>,
    /// The background, and the background with the drawing over it.
    background: Canvas,
    canvas: Canvas,
    palette: Palette,
    /// `None`: the image is the canvas.
    to_image: Option<FixedBilinear>,
    image: Vec<u8>,
    to_frame: Option<AntialiasBilinear>,
    /// Empty when the image is the frame.
    frame: Vec<u8>,
    damage: Damage,
    bands: Bands,
    all_damaged: bool,
    /// What is drawn again of the canvas, and what that changes in the image.
    region: Region,
    dirty: Region,
    scratch: Scratch,
}

impl ExactRenderer {
    /// Allocates everything that frames of this geometry need.
    ///
    /// # Errors
    /// If a side is zero or above 4096.
    pub fn new(geometry: Geometry) -> Result<Self, RenderError> {
        geometry.check()?;
        let Geometry { canvas, image, height, width, .. } = geometry;
        let resized = [height, width] != image;
        let to_frame = resized.then(|| AntialiasBilinear::new(image, [height, width])).transpose()?;
        let to_image = (canvas != image).then(|| FixedBilinear::new(canvas[0], image[0])).transpose()?;
        let [image_height, image_width] = image;
        Ok(Self {
            geometry,
            drawn: DisplayList::new(),
            next: DisplayList::new(),
            background_list: DisplayList::new(),
            background: Canvas::new(canvas[0], canvas[1]),
            canvas: Canvas::new(canvas[0], canvas[1]),
            palette: Palette::default(),
            to_image,
            image: vec![0; image_height * image_width * 3],
            to_frame,
            frame: vec![0; if resized { geometry.frame_len() } else { 0 }],
            damage: Damage::new(Rect::of_size(canvas[0], canvas[1])),
            bands: Bands::new(Rect::of_size(canvas[0], canvas[1])),
            all_damaged: true,
            region: Region::default(),
            dirty: Region::default(),
            scratch: Scratch::default(),
        })
    }

    /// The sizes.
    #[must_use]
    pub fn geometry(&self) -> Geometry {
        self.geometry
    }

    /// The canvas of the last frame, before any resize.
    #[must_use]
    pub fn canvas(&self) -> &Canvas {
        &self.canvas
    }

    /// The reference's image of the last frame, `[H image, W image, 3]`, before the resize to the asked size.
    #[must_use]
    pub fn image(&self) -> &[u8] {
        &self.image
    }

    /// See [`Renderer::set_palette`](crate::Renderer::set_palette).
    pub fn set_palette(&mut self, swaps: &[(Rgb, Rgb)]) {
        self.all_damaged |= self.palette.set(swaps);
    }

    /// See [`Renderer::set_background`](crate::Renderer::set_background).
    pub fn set_background(&mut self, draw: impl FnOnce(&mut dyn Painter)) {
        // The list of the frame to come is free until then.
        let new = &mut self.next;
        new.clear();
        draw(&mut ExactPainter { list: new, canvas: self.canvas.bounds() });
        if *new == self.background_list {
            return;
        }
        std::mem::swap(new, &mut self.background_list);
        self.background.pixels.fill(0);
        self.region.set(self.background.bounds());
        let mut raster = Raster::new(&mut self.background, &self.region, &mut self.scratch);
        replay(&self.background_list, &mut raster);
        self.all_damaged = true;
    }

    /// See [`Renderer::render`](crate::Renderer::render).
    ///
    /// # Errors
    /// If `out` has the wrong length; nothing is drawn then.
    pub fn render(&mut self, out: &mut [u8], draw: impl FnOnce(&mut dyn Painter)) -> Result<(), RenderError> {
        let Geometry { height, width, .. } = self.geometry;
        check_len("the frame to write", out.len(), height, width)?;
        self.next.clear();
        draw(&mut ExactPainter { list: &mut self.next, canvas: self.canvas.bounds() });
        self.update();
        out.copy_from_slice(if self.to_frame.is_some() { &self.frame } else { &self.image });
        Ok(())
    }

    /// Brings canvas, image and frame from the drawing of `drawn` to that of `next`.
    fn update(&mut self) {
        let Self { damage, bands, region, dirty, canvas, .. } = self;
        damage.clear();
        bands.clear();
        if self.all_damaged {
            damage.add_all();
            bands.add_all();
        } else {
            self.next.changes_since(&self.drawn, |primitive| {
                damage.add(primitive.bounds);
                bands.add(primitive);
            });
        }
        for rect in damage.rects() {
            bands.within(*rect, region);
            canvas.copy_region(&self.background, region);
            replay(&self.next, &mut Raster::new(canvas, region, &mut self.scratch));
            match &mut self.to_image {
                Some(to_image) => to_image.resize_region(canvas, region, &mut self.image, dirty),
                None => {
                    copy_region(canvas, region, self.geometry.y_up, &self.palette, &mut self.image, dirty);
                }
            }
            if let Some(to_frame) = &mut self.to_frame {
                to_frame.resize_region(&self.image, dirty, &mut self.frame);
            }
        }
        self.all_damaged = false;
        std::mem::swap(&mut self.drawn, &mut self.next);
    }
}

/// Copies the pixels `region` of a canvas, with their colors replaced, into an image of its size, flipped if `y_up`;
/// `dirty` becomes where they went.
fn copy_region(
    canvas: &Canvas,
    region: &Region,
    y_up: bool,
    palette: &Palette,
    image: &mut [u8],
    dirty: &mut Region,
) {
    let flipped = |y: usize| if y_up { canvas.height - 1 - y } else { y };
    for y in region.rows() {
        let columns = region.columns(y);
        let start = flipped(y) * canvas.width;
        let out = &mut image[(start + columns.start) * 3..(start + columns.end) * 3];
        for (out, &pixel) in out.as_chunks_mut::<3>().0.iter_mut().zip(&canvas.row(y)[columns]) {
            *out = unpack(palette.apply(pixel));
        }
    }
    let Range { start, end } = region.rows();
    let rows = if y_up { canvas.height - end..canvas.height - start } else { start..end };
    dirty.set_rows(rows, |y| region.columns(flipped(y)));
}

fn replay(list: &DisplayList<i32>, raster: &mut Raster<'_>) {
    let clip = raster.clip();
    for primitive in list.iter().filter(|primitive| primitive.bounds.meets(&clip)) {
        let color = primitive.color;
        match (primitive.shape, primitive.points) {
            (Shape::Fill, _) => raster.fill(color),
            (Shape::Polygon, points) => raster.polygon(points, color),
            (Shape::Disc, [center, ..]) => raster.disc(*center, primitive.radius, color),
            (Shape::FatSegment, [from, to, ..]) => raster.fat_segment(*from, *to, color),
            (Shape::AaLine, [from, to, ..]) => raster.aa_line(*from, *to, color),
            (Shape::SmoothPolygon, points) => raster.smooth_polygon(points, color),
            (Shape::SmoothDisc, [center, ..]) => raster.smooth_disc(*center, primitive.radius, color),
            (Shape::SmoothLine, [from, to, ..]) => {
                let [from, to] = [from, to].map(|point| point.map(|bits| f32::from_bits(bits as u32)));
                raster.smooth_line(from, to, color);
            }
            (Shape::AxisLine, [from, to, ..]) => raster.axis_line(*from, *to, color),
            (Shape::TurnArrow, [center, ..]) => raster.turn_arrow(*center, primitive.radius, color),
            _ => {}
        }
    }
}

/// Records primitives with rounded coordinates: motion below half a pixel compares equal.
struct ExactPainter<'a> {
    list: &'a mut DisplayList<i32>,
    canvas: Rect,
}

fn round_point(point: [f64; 2]) -> [i32; 2] {
    point.map(round_half_even)
}

/// The rectangle that holds all points and `before` pixels before and `after` pixels after them.
fn bounds_of(points: &[[i32; 2]], before: i32, after: i32) -> Rect {
    points.iter().fold(Rect::default(), |bounds, &[x, y]| {
        bounds.union(&Rect::new(x - before, y - before, x + after + 1, y + after + 1))
    })
}

impl ExactPainter<'_> {
    fn push_pair(&mut self, shape: Shape, ends: [[f64; 2]; 2], margin: [i32; 2], color: Rgb) {
        let points = ends.map(round_point);
        self.list.push(shape, points.into_iter(), 0, color, bounds_of(&points, margin[0], margin[1]));
    }
}

impl Painter for ExactPainter<'_> {
    fn fill(&mut self, color: Rgb) {
        self.list.push(Shape::Fill, std::iter::empty(), 0, color, self.canvas);
    }

    fn polygon(&mut self, vertices: &[[f64; 2]], color: Rgb) {
        let bounds = vertices
            .iter()
            .fold(Rect::default(), |bounds, vertex| bounds.union(&bounds_of(&[round_point(*vertex)], 0, 0)));
        self.list.push(Shape::Polygon, vertices.iter().copied().map(round_point), 0, color, bounds);
    }

    fn disc(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        let center = round_point(center);
        let radius = round_half_even(radius);
        let bounds = bounds_of(&[center], radius.max(0), radius.max(0));
        self.list.push(Shape::Disc, std::iter::once(center), radius, color, bounds);
    }

    fn fat_segment(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        self.push_pair(Shape::FatSegment, [from, to], [2, 2], color);
    }

    fn aa_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        // The slope is f32: the crossing may round to just before the smaller end.
        self.push_pair(Shape::AaLine, [from, to], [1, 1], color);
    }

    fn smooth_polygon(&mut self, vertices: &[[f64; 2]], color: Rgb) {
        // Clipped edges cross the canvas's border at truncated points: a pixel or two off.
        let bounds = vertices
            .iter()
            .fold(Rect::default(), |bounds, vertex| bounds.union(&bounds_of(&[vertex.map(truncate)], 2, 2)));
        let points = vertices.iter().map(|vertex| vertex.map(truncate));
        self.list.push(Shape::SmoothPolygon, points, 0, color, bounds);
    }

    fn smooth_disc(&mut self, center: [f64; 2], radius: f64, color: Rgb) {
        let (center, radius) = (center.map(truncate), truncate(radius));
        let bounds = if radius < 0 { Rect::default() } else { bounds_of(&[center], radius + 1, radius + 1) };
        self.list.push(Shape::SmoothDisc, std::iter::once(center), radius, color, bounds);
    }

    fn smooth_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        let ends = [from, to];
        let bounds = bounds_of(&ends.map(|end| end.map(truncate)), 2, 2);
        let bits = ends.map(|end| end.map(|coordinate| single(coordinate).to_bits() as i32));
        self.list.push(Shape::SmoothLine, bits.into_iter(), 0, color, bounds);
    }

    fn axis_line(&mut self, from: [f64; 2], to: [f64; 2], color: Rgb) {
        let points = [from, to].map(|end| end.map(truncate));
        self.list.push(Shape::AxisLine, points.into_iter(), 0, color, bounds_of(&points, 0, 0));
    }

    fn turn_arrow(&mut self, center: [f64; 2], side: f64, mirrored: bool, color: Rgb) {
        let (center, side) = (center.map(truncate), truncate(side));
        let bounds = if side < 1 { Rect::default() } else { bounds_of(&[center], side / 2, side / 2 + 1) };
        let radius = if mirrored { -side } else { side };
        self.list.push(Shape::TurnArrow, std::iter::once(center), radius, color, bounds);
    }
}
