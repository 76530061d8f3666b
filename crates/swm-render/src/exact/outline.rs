//! Which columns primitives touch, band by band: a closer bound than their rectangles, for less than drawing them costs.

use crate::display_list::{Primitive, Shape};
use crate::rect::Rect;
use crate::region::Region;

/// Rows of a band. Lower bands follow slanted edges more closely, and more of them take longer.
const ROWS: i64 = 8;

/// A half-open range of columns for each band of a canvas.
#[derive(Debug, Clone)]
pub(super) struct Bands {
    canvas: Rect,
    columns: Vec<[i64; 2]>,
}

const NONE: [i64; 2] = [i64::MAX, i64::MIN];

impl Bands {
    pub(super) fn new(canvas: Rect) -> Self {
        Self { canvas, columns: vec![NONE; canvas.rows().len().div_ceil(ROWS as usize)] }
    }

    pub(super) fn clear(&mut self) {
        self.columns.fill(NONE);
    }

    /// Adds the whole canvas.
    pub(super) fn add_all(&mut self) {
        self.add_rect(self.canvas);
    }

    /// Adds every pixel that a primitive touches.
    pub(super) fn add(&mut self, primitive: &Primitive<'_, i32>) {
        // Products of coordinates that are farther off would overflow.
        let is_near = primitive.points.iter().flatten().all(|v| v.unsigned_abs() < 1 << 15);
        match (primitive.shape, primitive.points) {
            _ if !is_near => self.add_rect(primitive.bounds),
            // A scanline's spans begin and end at crossings of its edges, which are floored.
            (Shape::Polygon, points) => {
                let next = points.iter().cycle().skip(1);
                points.iter().zip(next).for_each(|(from, to)| self.add_edge(*from, *to, 1));
            }
            // Half its width is 2; the line's pixels are rounded, and reach one farther to one side.
            (Shape::FatSegment, [from, to]) => self.add_edge(*from, *to, 4),
            _ => self.add_rect(primitive.bounds),
        }
    }

    /// The added pixels within a rectangle of the canvas.
    pub(super) fn within(&self, rect: Rect, region: &mut Region) {
        let (first, last) = (i64::from(rect.x0), i64::from(rect.x1));
        region.set_rows(rect.rows(), |y| {
            let [left, right] = self.columns[y / ROWS as usize];
            let (left, right) = (left.max(first), right.min(last));
            if left < right { left as usize..right as usize } else { 0..0 }
        });
    }

    fn add_rect(&mut self, rect: Rect) {
        let rect = rect.intersect(&self.canvas);
        let [x0, y0, x1, y1] = [rect.x0, rect.y0, rect.x1, rect.y1].map(i64::from);
        self.bands(y0, y1 - 1).for_each(|(_, band)| widen(band, [x0, x1]));
    }

    /// Adds the pixels at most `margin` rows and `margin` columns from an edge.
    fn add_edge(&mut self, from: [i32; 2], to: [i32; 2], margin: i64) {
        let [[x0, y0], [x1, y1]] =
            if from[1] <= to[1] { [from, to] } else { [to, from] }.map(|point| point.map(i64::from));
        let slope = ((x1 - x0) << 16) / (y1 - y0).max(1);
        for (first, band) in self.bands(y0 - margin, y1 + margin) {
            let at = |y: i64| x0 + ((slope * (y.clamp(y0, y1) - y0)) >> 16);
            // A flat edge is in one or two bands, as a whole.
            let (a, b) =
                if y0 == y1 { (x0, x1) } else { (at(first - margin), at(first + ROWS - 1 + margin)) };
            widen(band, [a.min(b) - margin, a.max(b) + margin + 2]);
        }
    }

    /// The bands of rows `top..=bottom`, and the first row of each.
    fn bands(&mut self, top: i64, bottom: i64) -> impl Iterator<Item = (i64, &mut [i64; 2])> {
        let top = top.max(0) / ROWS;
        let end = (bottom.div_euclid(ROWS) + 1).max(top);
        let bands = self.columns.iter_mut().skip(top as usize).take((end - top) as usize);
        (top * ROWS..).step_by(ROWS as usize).zip(bands)
    }
}

fn widen(band: &mut [i64; 2], [left, right]: [i64; 2]) {
    *band = [band[0].min(left), band[1].max(right)];
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::canvas::Canvas;
    use crate::exact::raster::{Raster, Scratch};

    /// Draws a primitive on an empty canvas; none of its pixels may lie outside of the bands.
    fn check(shape: Shape, points: &[[i32; 2]]) {
        let mut canvas = Canvas::new(96, 96);
        let mut region = Region::of(canvas.bounds());
        let mut scratch = Scratch::default();
        let mut raster = Raster::new(&mut canvas, &region, &mut scratch);
        match (shape, points) {
            (Shape::FatSegment, &[from, to]) => raster.fat_segment(from, to, [1; 3]),
            _ => raster.polygon(points, [1; 3]),
        }
        let mut bands = Bands::new(canvas.bounds());
        bands.add(&Primitive { shape, color: [1; 3], radius: 0, points, bounds: canvas.bounds() });
        bands.within(canvas.bounds(), &mut region);
        for (y, x) in (0..96).flat_map(|y| (0..96).map(move |x| (y, x))) {
            let inked = canvas.get(x, y) != Some([0; 3]);
            assert!(!inked || region.columns(y).contains(&x), "({x}, {y}) of {points:?}");
        }
    }

    #[test]
    fn every_pixel_of_a_primitive_lies_in_its_bands() {
        let mut state = 1_u32;
        let mut coordinate = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 16) as i32 % 136 - 20
        };
        let mut point = || [coordinate(), coordinate()];
        for round in 0..3000 {
            let points = [point(), point(), point(), point()];
            check(Shape::FatSegment, &points[..2]);
            check(Shape::Polygon, &points[..2 + round % 3]);
        }
        for far in [1 << 14, 1 << 20, 1 << 29] {
            check(Shape::Polygon, &[[10, 10], [far, 40], [10, 90]]);
            check(Shape::FatSegment, &[[10, -far], [80, 90]]);
        }
    }

    #[test]
    fn a_slanted_edge_needs_less_than_its_rectangle() {
        let canvas = Rect::of_size(512, 512);
        let (mut bands, mut region) = (Bands::new(canvas), Region::default());
        let points = [[100, 100], [300, 300]];
        bands.add(&Primitive {
            shape: Shape::FatSegment,
            color: [1; 3],
            radius: 0,
            points: &points,
            bounds: canvas,
        });
        bands.within(canvas, &mut region);
        let pixels: usize = region.rows().map(|y| region.columns(y).len()).sum();
        assert!((208 * 5..208 * 32).contains(&pixels), "{pixels}");
        bands.clear();
        bands.within(canvas, &mut region);
        assert!(region.bounds().is_empty());
    }
}
