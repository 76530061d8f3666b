//! Anti-aliased shapes of the exact raster, after the facts of pygame 2.6.1 and the SDL_gfx that it contains: polygons, discs and
//! lines as Gymnasium's classic control draws them.
//!
//! A pixel of weight w (0 to 255) is blended with alpha (255 w) >> 8, as `old + ((color - old) alpha >> 8)`. As in
//! `raster.rs`, a clip removes pixels and changes no other.

use super::raster::Raster;
use crate::canvas::{pack, unpack};
use crate::painter::Rgb;
use crate::rect::Rect;

impl Raster<'_> {
    /// A polygon: its edges by Wu's algorithm, then its inside in one color.
    pub(super) fn smooth_polygon(&mut self, points: &[[i32; 2]], color: Rgb) {
        for (from, to) in edges(points) {
            self.wu_line(from, to, color);
        }
        self.inside(points, color);
    }

    /// The inside of a polygon: on every scanline, between the crossings of edges in 16.16 fixed point, one unit after the
    /// first and one before the second, each rounded. An edge from (x1, y1) down to (x2, y2) is crossed if y1 <= y < y2, on
    /// the last scanline if y1 < y <= y2.
    fn inside(&mut self, points: &[[i32; 2]], color: Rgb) {
        let color = pack(color);
        let ys = points.iter().map(|point| point[1]);
        let (Some(top), Some(bottom)) = (ys.clone().min(), ys.max()) else { return };
        let mut crossings = self.take_crossings();
        let rows = top.max(self.clip().y0)..=bottom.min(self.clip().y1 - 1);
        for y in rows {
            crossings.clear();
            for (a, b) in edges(points) {
                let ([x1, y1], [x2, y2]) = if a[1] < b[1] { (a, b) } else { (b, a) };
                let is_crossed = if y == bottom { y1 < y && y <= y2 } else { y1 <= y && y < y2 };
                if is_crossed {
                    let along = (i64::from(y - y1) << 16) / i64::from(y2 - y1);
                    crossings.push(along * i64::from(x2 - x1) + (i64::from(x1) << 16));
                }
            }
            crossings.sort_unstable();
            for pair in crossings.chunks_exact(2) {
                let rounded = |x: i64| ((x >> 16) + ((x >> 15) & 1)) as i32;
                let (a, b) = (rounded(pair[0] + 1), rounded(pair[1] - 1));
                self.span(y, a.min(b), a.max(b), color);
            }
        }
        self.return_crossings(crossings);
    }

    /// An edge by Wu's algorithm, clipped to the canvas first: its first point in full, then pairs of pixels that share the
    /// weight; without its last point.
    fn wu_line(&mut self, from: [i32; 2], to: [i32; 2], color: Rgb) {
        let Some((from, to)) = clipped(from, to, &self.bounds()) else { return };
        let ([x0, y0], [x1, y1]) = if from[1] > to[1] { (to, from) } else { (from, to) };
        if x0 == x1 || y0 == y1 {
            return self.axis_line(from, to, color);
        }
        if let Some(pixel) = self.pixel(from[0], from[1]) {
            *pixel = pack(color);
        }
        let direction = (x1 - x0).signum();
        let [dx, dy] = [x1.abs_diff(x0), y1.abs_diff(y0)];
        let (major, minor) = (dx.max(dy), dx.min(dy));
        // A fraction of 2^32; a diagonal wraps at every step.
        let per_step = (((u64::from(minor) << 16) / u64::from(major)) << 16) as u32;
        let mut fraction = 0_u32;
        let [mut x, mut y] = [x0, y0];
        for _ in 1..major {
            let before = fraction;
            fraction = fraction.wrapping_add(per_step);
            let wrapped = i32::from(fraction <= before);
            let neighbor = if dy > dx {
                (x, y) = (x + wrapped * direction, y + 1);
                [x + direction, y]
            } else {
                (x, y) = (x + direction, y + wrapped);
                [x, y + 1]
            };
            let weight = fraction >> 24;
            self.weigh([x, y], color, 255 - weight);
            self.weigh(neighbor, color, weight);
        }
    }

    /// A horizontal or vertical line, both ends included.
    pub(super) fn axis_line(&mut self, from: [i32; 2], to: [i32; 2], color: Rgb) {
        let color = pack(color);
        if from[1] == to[1] {
            self.span(from[1], from[0].min(to[0]), from[0].max(to[0]), color);
        } else if from[0] == to[0] {
            self.column(from[0], from[1].min(to[1]), from[1].max(to[1]), color);
        }
    }

    /// A disc about the middle of a pixel: its anti-aliased circle, then its inside by the midpoint rule.
    pub(super) fn smooth_disc(&mut self, center: [i32; 2], radius: i32, color: Rgb) {
        if radius > 0 {
            self.smooth_circle(center, radius, color);
        }
        let [x, y] = center;
        let packed = pack(color);
        let (mut across, mut along) = (0, radius);
        let (mut decision, mut east, mut south_east) = (1 - radius, 3, 5 - 2 * radius);
        // A row at the top or bottom keeps its first, shortest span.
        let mut last_along = None;
        while across <= along {
            if last_along.replace(along) != Some(along) {
                self.span(y + along, x - across, x + across, packed);
                self.span(y - along, x - across, x + across, packed);
            }
            if across != along {
                self.span(y + across, x - along, x + along, packed);
                self.span(y - across, x - along, x + along, packed);
            }
            if decision < 0 {
                decision += east;
                south_east += 2;
            } else {
                decision += south_east;
                south_east += 4;
                along -= 1;
            }
            east += 2;
            across += 1;
        }
    }

    /// An anti-aliased circle, by the implicit function a (x² + y² - r²) and its differences: an octant from the top towards
    /// the left, then one from there downwards, each mirrored to all four quadrants.
    fn smooth_circle(&mut self, [cx, cy]: [i32; 2], radius: i32, color: Rgb) {
        let square = i64::from(radius) * i64::from(radius);
        let steps = (square as f64 / (2.0 * square as f64).sqrt()).round_ties_even() as i32;
        let (mut t, mut s, mut d) = (0, -2 * square * i64::from(radius), 0);
        let [mut x, mut y] = [cx, cy - radius];
        for v in [y, 2 * cy - y] {
            if let Some(pixel) = self.pixel(x, v) {
                *pixel = pack(color);
            }
        }
        for _ in 0..steps {
            x -= 1;
            d += t - square;
            let second;
            if d >= 0 {
                second = y - 1;
            } else if d - s - square > 0 {
                if 2 * d - s - square >= 0 {
                    second = y + 1;
                } else {
                    second = y;
                    y += 1;
                    d -= s + square;
                    s += 2 * square;
                }
            } else {
                y += 1;
                second = y + 1;
                d -= s + square;
                s += 2 * square;
            }
            t -= 2 * square;
            let weight = share(d, s);
            for flip in [false, true] {
                let mirrored = |v: i32| if flip { 2 * cy - v } else { v };
                for (v, weight) in [(y, 255 - weight), (second, weight)] {
                    self.weigh([x, mirrored(v)], color, weight);
                    self.weigh([2 * cx - x, mirrored(v)], color, weight);
                }
            }
        }
        for _ in 0..steps {
            y += 1;
            d -= s + square;
            let second;
            if d <= 0 {
                second = x + 1;
            } else if d + t - square < 0 {
                if 2 * d + t - square <= 0 {
                    second = x - 1;
                } else {
                    second = x;
                    x -= 1;
                    d += t - square;
                    t -= 2 * square;
                }
            } else {
                x -= 1;
                second = x - 1;
                d += t - square;
                t -= 2 * square;
            }
            s += 2 * square;
            let weight = share(d, t);
            for (u, weight) in [(x, 255 - weight), (second, weight)] {
                for v in [y, 2 * cy - y] {
                    self.weigh([u, v], color, weight);
                    self.weigh([2 * cx - u, v], color, weight);
                }
            }
        }
    }

    /// An anti-aliased line between real points, in f32. Heights are shifted by 1 px, so that truncation is floor down to
    /// the canvas's edge.
    pub(super) fn smooth_line(&mut self, from: [f32; 2], to: [f32; 2], color: Rgb) {
        let steep = (to[0] - from[0]).abs() < (to[1] - from[1]).abs();
        let turned = |[x, y]: [f32; 2]| if steep { [y, x] } else { [x, y] };
        let (from, to) = (turned(from), turned(to));
        let ([x_from, y_from], [x_to, y_to]) = if from[0] > to[0] { (to, from) } else { (from, to) };
        if x_from == x_to {
            return;
        }
        let slope = (y_to - y_from) / (x_to - x_from);
        let mut pair = |x: i32, height: f32, gap: f32| {
            let floor = height as i32;
            let share = height - floor as f32;
            for (y, weight) in [(floor, share * gap), (floor - 1, (1.0 - share) * gap)] {
                let (x, y) = if steep { (y, x) } else { (x, y) };
                if weight > 0.0
                    && let Some(pixel) = self.pixel(x, y)
                {
                    let old = unpack(*pixel);
                    *pixel = pack(std::array::from_fn(|c| {
                        (weight * f32::from(color[c]) + (1.0 - weight) * f32::from(old[c])) as u8
                    }));
                }
            }
        };
        let (first, last) = (x_from as i32, x_to.ceil() as i32);
        let start = (y_from + 1.0) + slope * (first as f32 - x_from);
        pair(first, start, 1.0 + first as f32 - x_from);
        let end = (y_to + 1.0) + slope * (last as f32 - x_to);
        pair(last, end, 1.0 - last as f32 + x_to);
        let mut height = start;
        for x in first + 1..last {
            height += slope;
            pair(x, height, 1.0);
        }
    }

    /// Blends a color into a pixel with a weight of 0 to 255.
    fn weigh(&mut self, [x, y]: [i32; 2], color: Rgb, weight: u32) {
        if let Some(pixel) = self.pixel(x, y) {
            *pixel = blend(*pixel, color, (255 * weight) >> 8);
        }
    }
}

/// `old + ((color - old) alpha >> 8)` per channel.
pub(super) fn blend(old: u32, color: Rgb, alpha: u32) -> u32 {
    let old = unpack(old);
    pack(std::array::from_fn(|c| {
        let old = i32::from(old[c]);
        (old + (((i32::from(color[c]) - old) * alpha as i32) >> 8)) as u8
    }))
}

/// The weight that the second pixel of a pair gets: |d| / |s| in f32, at most 1, of 255.
fn share(d: i64, s: i64) -> u32 {
    if s == 0 { 255 } else { (255.0 * (d.abs() as f32 / s.abs() as f32).min(1.0)) as u32 }
}

fn edges(points: &[[i32; 2]]) -> impl Iterator<Item = ([i32; 2], [i32; 2])> {
    let next = points.iter().cycle().skip(1);
    points.iter().copied().zip(next.copied())
}

/// Cohen and Sutherland's clipping to `bounds`, with a slope in f32 and truncated crossings. The points may come back
/// swapped. `None`: nothing is left.
fn clipped(mut a: [i32; 2], mut b: [i32; 2], bounds: &Rect) -> Option<([i32; 2], [i32; 2])> {
    let (left, right, top, bottom) = (bounds.x0, bounds.x1 - 1, bounds.y0, bounds.y1 - 1);
    let sides = |[x, y]: [i32; 2]| [x < left, x > right, y < top, y > bottom];
    // A line past a corner may be moved to and fro by the truncation.
    for _ in 0..8 {
        let (at_a, at_b) = (sides(a), sides(b));
        if !at_a.iter().chain(&at_b).any(|&outside| outside) {
            return Some((a, b));
        }
        if at_a.iter().zip(&at_b).any(|(a, b)| *a && *b) {
            return None;
        }
        if !at_a.contains(&true) {
            std::mem::swap(&mut a, &mut b);
        }
        let [is_left, is_right, is_above, _] = sides(a);
        let slope = if a[0] == b[0] { 1.0 } else { (b[1] - a[1]) as f32 / (b[0] - a[0]) as f32 };
        if is_left || is_right {
            let side = if is_left { left } else { right };
            a[1] += ((side - a[0]) as f32 * slope) as i32;
            a[0] = side;
        } else {
            let side = if is_above { top } else { bottom };
            if a[0] != b[0] {
                a[0] += ((side - a[1]) as f32 / slope) as i32;
            }
            a[1] = side;
        }
    }
    None
}
