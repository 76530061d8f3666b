//! Fills of the exact raster: spans, polygons, discs, within a region. Lines are in `lines.rs`.
//!
//! The rules are those of the drawing library behind the reference, stated as facts about its results; each function
//! says its own. "Span [a, b]" includes both ends. A clip removes pixels and changes no other: drawing a scene in
//! pieces gives the bytes of drawing it whole.

use crate::canvas::{Canvas, pack};
use crate::painter::Rgb;
use crate::rect::Rect;
use crate::region::Region;

/// Working memory of polygons, kept so that drawing does not allocate.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scratch {
    edges: Vec<Edge>,
    crossings: Vec<i32>,
    /// Crossings in 16.16 fixed point, of smooth polygons.
    fixed: Vec<i64>,
    /// Rows and columns of the arrow that is being shrunk.
    pub(super) arrow: Vec<u8>,
}

/// A canvas being drawn on, within a region of it. Coordinates are whole pixels.
#[derive(Debug)]
pub(crate) struct Raster<'a> {
    canvas: &'a mut Canvas,
    region: &'a Region,
    clip: Rect,
    scratch: &'a mut Scratch,
}

impl<'a> Raster<'a> {
    /// To draw on the pixels `region` of the canvas.
    pub(super) fn new(canvas: &'a mut Canvas, region: &'a Region, scratch: &'a mut Scratch) -> Self {
        Self { canvas, region, clip: region.bounds(), scratch }
    }

    /// The rectangle in which the pixels lie that may be written.
    pub(super) fn clip(&self) -> Rect {
        self.clip
    }

    /// The whole canvas.
    pub(super) fn bounds(&self) -> Rect {
        self.canvas.bounds()
    }

    /// Working memory for crossings of smooth polygons, to be returned.
    pub(super) fn take_crossings(&mut self) -> Vec<i64> {
        std::mem::take(&mut self.scratch.fixed)
    }

    /// Returns what [`Self::take_crossings`] lent.
    pub(super) fn return_crossings(&mut self, crossings: Vec<i64>) {
        self.scratch.fixed = crossings;
    }

    /// Working memory for arrows.
    pub(super) fn scratch(&mut self) -> &mut Scratch {
        self.scratch
    }

    /// The whole region in one color.
    pub(super) fn fill(&mut self, color: Rgb) {
        for y in self.clip.y0..self.clip.y1 {
            self.span(y, self.clip.x0, self.clip.x1 - 1, pack(color));
        }
    }

    /// A filled polygon.
    ///
    /// On every scanline from the smallest to the largest vertex y, an edge whose upper end is (x1, y1) is crossed if
    /// y1 <= y < y2, or y = y2 on the last scanline, at x1 + floor((y - y1)(x2 - x1)/(y2 - y1)). Spans go from the 1st
    /// to the 2nd crossing, the 3rd to the 4th, ... Horizontal edges strictly inside are filled from end to end, and a
    /// polygon of height 0 is one span.
    pub(super) fn polygon(&mut self, points: &[[i32; 2]], color: Rgb) {
        let color = pack(color);
        let ys = points.iter().map(|point| point[1]);
        let (Some(top), Some(bottom)) = (ys.clone().min(), ys.max()) else { return };
        if top == bottom {
            let xs = points.iter().map(|point| point[0]);
            if let (Some(left), Some(right)) = (xs.clone().min(), xs.max()) {
                self.span(top, left, right, color);
            }
            return;
        }
        let rows = top.max(self.clip.y0)..(bottom + 1).min(self.clip.y1);
        let (mut edges, mut crossings) =
            (std::mem::take(&mut self.scratch.edges), std::mem::take(&mut self.scratch.crossings));
        edges.clear();
        for (index, &a) in points.iter().enumerate() {
            let b = points[if index + 1 < points.len() { index + 1 } else { 0 }];
            if a[1] != b[1] {
                edges.extend(Edge::new(a, b, bottom, rows.start));
            } else if top < a[1] && a[1] < bottom {
                self.span(a[1], a[0].min(b[0]), a[0].max(b[0]), color);
            }
        }
        let mut y = rows.start;
        while y < rows.end {
            // Until an edge begins or ends, the same edges are crossed: by most scanlines two.
            let mut same_until = rows.end;
            let (mut crossed, mut count) = ([0; 2], 0);
            for (index, edge) in edges.iter().enumerate() {
                if y < edge.first {
                    same_until = same_until.min(edge.first);
                } else if y <= edge.last {
                    same_until = same_until.min(edge.last + 1);
                    crossed[count.min(1)] = index;
                    count += 1;
                }
            }
            if let (2, Ok([a, b])) = (count, edges.get_disjoint_mut(crossed)) {
                for y in y..same_until {
                    let (a, b) = (a.crossing(), b.crossing());
                    self.span(y, a.min(b), a.max(b), color);
                }
            } else {
                for y in y..same_until {
                    crossings.clear();
                    let crossed = edges.iter_mut().filter(|edge| (edge.first..=edge.last).contains(&y));
                    crossings.extend(crossed.map(Edge::crossing));
                    crossings.sort_unstable();
                    for pair in crossings.chunks_exact(2) {
                        self.span(y, pair[0], pair[1], color);
                    }
                }
            }
            y = same_until;
        }
        (self.scratch.edges, self.scratch.crossings) = (edges, crossings);
    }

    /// A filled disc of integer radius: nothing below 1, one pixel for 1, else 2r x 2r pixels, symmetric about the
    /// center's upper left corner, with half-widths from the integer midpoint circle.
    pub(super) fn disc(&mut self, center: [i32; 2], radius: i32, color: Rgb) {
        let color = pack(color);
        let [cx, cy] = center;
        match radius {
            ..1 => {}
            1 => self.span(cy, cx, cx, color),
            _ => midpoint_circle(radius, |row, half_width| {
                self.span(cy + row, cx - half_width, cx + half_width - 1, color);
                self.span(cy - 1 - row, cx - half_width, cx + half_width - 1, color);
            }),
        }
    }

    /// The span [left, right] of row `y`, clipped.
    pub(super) fn span(&mut self, y: i32, left: i32, right: i32, color: u32) {
        let Ok(y) = usize::try_from(y) else { return };
        let columns = self.region.columns(y);
        let left = left.max(columns.start as i32);
        let end = (right + 1).min(columns.end as i32);
        if left < end {
            let start = y * self.canvas.width;
            self.canvas.pixels[start + left as usize..start + end as usize].fill(color);
        }
    }

    /// The column [top, bottom] of column `x`, clipped.
    pub(super) fn column(&mut self, x: i32, top: i32, bottom: i32, color: u32) {
        if x < self.clip.x0 || x >= self.clip.x1 {
            return;
        }
        for y in top.max(self.clip.y0)..(bottom + 1).min(self.clip.y1) {
            if self.region.columns(y as usize).contains(&(x as usize)) {
                self.canvas.pixels[y as usize * self.canvas.width + x as usize] = color;
            }
        }
    }

    /// The pixel at (x, y), if it may be written.
    pub(super) fn pixel(&mut self, x: i32, y: i32) -> Option<&mut u32> {
        let (x, y) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        let inside = self.region.columns(y).contains(&x);
        inside.then(|| &mut self.canvas.pixels[y * self.canvas.width + x])
    }
}

/// Calls `row(j, half_width)` for rows j = 0..radius of a disc. A row may come twice: the larger counts.
fn midpoint_circle(radius: i32, mut row: impl FnMut(i32, i32)) {
    let (mut x, mut y) = (0, radius);
    let mut decision = 1 - radius;
    let (mut horizontal, mut vertical) = (0, -2 * radius);
    while x < y {
        if decision >= 0 {
            y -= 1;
            vertical += 2;
            decision += vertical;
        }
        x += 1;
        horizontal += 2;
        decision += horizontal + 1;
        if decision >= 0 {
            row(y - 1, x);
        }
        row(x - 1, y);
    }
}

/// A polygon's edge, walked downwards one scanline at a time without dividing.
#[derive(Debug, Clone)]
struct Edge {
    first: i32,
    /// Last scanline that it crosses.
    last: i32,
    /// Crossing on the current scanline, and its remainder in units of 1/height, in 0..height.
    x: i32,
    remainder: i32,
    step: i32,
    step_remainder: i32,
    height: i32,
}

impl Edge {
    /// The edge between `a` and `b`, not horizontal, made ready for its first scanline from `start` on; `None` if
    /// it has none.
    fn new(a: [i32; 2], b: [i32; 2], bottom: i32, start: i32) -> Option<Self> {
        let ([x1, y1], [x2, y2]) = if a[1] < b[1] { (a, b) } else { (b, a) };
        let (first, last) = (y1.max(start), if y2 == bottom { y2 } else { y2 - 1 });
        if first > last {
            return None;
        }
        let (height, width) = (y2 - y1, x2 - x1);
        let distance = i64::from(first - y1) * i64::from(width);
        Some(Self {
            first,
            last,
            x: x1 + distance.div_euclid(i64::from(height)) as i32,
            remainder: distance.rem_euclid(i64::from(height)) as i32,
            step: width.div_euclid(height),
            step_remainder: width.rem_euclid(height),
            height,
        })
    }

    /// The crossing with the next scanline, from `first` to `last`.
    fn crossing(&mut self) -> i32 {
        let x = self.x;
        self.x += self.step;
        self.remainder += self.step_remainder;
        if self.remainder >= self.height {
            self.remainder -= self.height;
            self.x += 1;
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INK: Rgb = [200, 100, 50];

    fn draw(size: usize, clip: Rect, paint: impl Fn(&mut Raster<'_>)) -> Canvas {
        let mut canvas = Canvas::new(size, size);
        paint(&mut Raster::new(&mut canvas, &Region::of(clip), &mut Scratch::default()));
        canvas
    }

    /// The first and last inked pixel of a row, and how many there are.
    fn ink(canvas: &Canvas, y: usize) -> Option<(usize, usize, usize)> {
        let inked: Vec<_> = (0..canvas.width()).filter(|&x| canvas.get(x, y) == Some(INK)).collect();
        Some((*inked.first()?, *inked.last()?, inked.len()))
    }

    #[test]
    fn disc_half_widths_are_the_published_table() {
        let table: [(i32, &[usize]); 5] = [
            (2, &[2, 1]),
            (3, &[3, 2, 1]),
            (4, &[4, 3, 3, 1]),
            (11, &[11, 11, 11, 10, 10, 9, 8, 8, 6, 5, 3]),
            (15, &[15, 15, 15, 14, 14, 14, 13, 13, 12, 11, 10, 9, 8, 6, 3]),
        ];
        for (radius, half_widths) in table {
            let canvas = draw(64, Rect::of_size(64, 64), |r| r.disc([30, 31], radius, INK));
            for (row, &half) in half_widths.iter().enumerate() {
                let expected = Some((30 - half, 30 + half - 1, 2 * half));
                assert_eq!(ink(&canvas, 31 + row), expected, "radius {radius}, row {row}");
                assert_eq!(ink(&canvas, 30 - row), expected, "radius {radius}, row -1 - {row}");
            }
            assert_eq!(ink(&canvas, 31 + half_widths.len()), None, "radius {radius}");
        }
    }

    #[test]
    fn tiny_discs() {
        let all = Rect::of_size(8, 8);
        assert_eq!(ink(&draw(8, all, |r| r.disc([3, 3], 1, INK)), 3), Some((3, 3, 1)));
        assert_eq!(draw(8, all, |r| r.disc([3, 3], 0, INK)), Canvas::new(8, 8));
        assert_eq!(draw(8, all, |r| r.disc([3, 3], -5, INK)), Canvas::new(8, 8));
    }

    #[test]
    fn polygon_includes_its_boundary() {
        let square = [[2, 2], [6, 2], [6, 5], [2, 5]];
        let canvas = draw(8, Rect::of_size(8, 8), |r| r.polygon(&square, INK));
        let rows: Vec<_> = (0..8).map(|y| ink(&canvas, y)).collect();
        let inside = Some((2, 6, 5));
        assert_eq!(rows, [None, None, inside, inside, inside, inside, None, None]);
    }

    #[test]
    fn polygon_crossings_are_floored() {
        // Left edge from (5,0) to (0,3): 5, 5 - 5/3, 5 - 10/3, 0, floored.
        let canvas = draw(8, Rect::of_size(8, 8), |r| r.polygon(&[[5, 0], [7, 3], [0, 3]], INK));
        let rows: Vec<_> = (0..4).map(|y| ink(&canvas, y)).collect();
        assert_eq!(rows, [Some((5, 5, 1)), Some((3, 5, 3)), Some((1, 6, 6)), Some((0, 7, 8))]);
    }

    #[test]
    fn inner_horizontal_edges_and_flat_polygons_are_spans() {
        let all = Rect::of_size(10, 10);
        // A notch whose floor, at y = 4, is outside by the even-odd rule on that scanline alone.
        let notched = [[0, 0], [9, 0], [9, 8], [6, 8], [6, 4], [3, 4], [3, 8], [0, 8]];
        let canvas = draw(10, all, |r| r.polygon(&notched, INK));
        assert_eq!(ink(&canvas, 4), Some((0, 9, 10)));
        assert_eq!(ink(&canvas, 5), Some((0, 9, 8)));
        let flat = draw(10, all, |r| r.polygon(&[[7, 3], [2, 3], [4, 3]], INK));
        assert_eq!(ink(&flat, 3), Some((2, 7, 6)));
        assert_eq!(draw(10, all, |r| r.polygon(&[], INK)), Canvas::new(10, 10));
    }

    #[test]
    fn a_clip_removes_pixels_and_changes_no_other() {
        let paint = |r: &mut Raster<'_>| {
            r.polygon(&[[-20, 5], [50, -7], [70, 60], [10, 44], [35, 20]], INK);
            r.disc([40, 40], 13, [1, 2, 3]);
            r.fat_segment([-5, 50], [60, 3], [9, 8, 7]);
            r.fat_segment([60, 61], [1, 2], [90, 80, 70]);
            r.aa_line([3, 60], [62, -10], [255, 0, 0]);
            r.aa_line([50, 70], [45, -10], [255, 255, 0]);
        };
        let whole = draw(64, Rect::of_size(64, 64), paint);
        for clip in [Rect::new(0, 0, 31, 64), Rect::new(17, 23, 45, 46), Rect::new(40, 0, 41, 64)] {
            let part = draw(64, clip, paint);
            for y in 0..64 {
                for x in 0..64 {
                    let inside = clip.meets(&Rect::new(x, y, x + 1, y + 1));
                    let (x, y) = (x as usize, y as usize);
                    let expected = if inside { whole.get(x, y) } else { Some([0; 3]) };
                    assert_eq!(part.get(x, y), expected, "({x}, {y}) under {clip:?}");
                }
            }
        }
    }
}
