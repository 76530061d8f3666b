//! Lines of the exact raster: width 4, fat segments, and the anti-aliased line.

use std::ops::{Range, RangeInclusive};

use super::raster::Raster;
use crate::canvas::{pack, unpack};
use crate::painter::Rgb;

impl Raster<'_> {
    /// A segment of radius 2: a line of width 4, a quadrilateral about it, and a disc at each end.
    ///
    /// The quadrilateral's half-width (round(2u/L), round(2w/L)) comes from the **absolute** differences u = |dy| and
    /// w = |dx|, so for two of the four diagonal directions it is not perpendicular to the segment. That is how the
    /// reference's image looks. Coinciding ends leave the line of width 4 alone.
    pub(super) fn fat_segment(&mut self, from: [i32; 2], to: [i32; 2], color: Rgb) {
        self.wide_line(from, to, color);
        if from == to {
            return;
        }
        let u = f64::from((to[1] - from[1]).abs());
        let w = f64::from((to[0] - from[0]).abs());
        let length = (u * u + w * w).sqrt();
        let h = [(2.0 * u / length).round() as i32, (2.0 * w / length).round() as i32];
        let shifted = |p: [i32; 2], sign: i32| [p[0] + sign * h[0], p[1] + sign * h[1]];
        self.polygon(&[shifted(from, -1), shifted(from, 1), shifted(to, 1), shifted(to, -1)], color);
        self.disc(from, 2, color);
        self.disc(to, 2, color);
    }

    /// A line of width 4. Center pixels are i = 0..=M steps along the longer axis, displaced on the other towards the
    /// second point by ceil((i m - floor(M/2))/M), with M and m the larger and smaller absolute difference. A steep
    /// line (|dx| <= |dy|) widens each to the span [x - 1, x + 2], a flat one to the column [y - 1, y + 2].
    pub(super) fn wide_line(&mut self, from: [i32; 2], to: [i32; 2], color: Rgb) {
        let color = pack(color);
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let steep = dx.abs() <= dy.abs();
        let (along, across) = if steep { (1, 0) } else { (0, 1) };
        let major = (to[along] - from[along]).abs();
        let minor = (to[across] - from[across]).abs();
        let direction = (to[along] - from[along]).signum();
        let side = (to[across] - from[across]).signum();
        let clip = self.clip();
        let visible = if steep { [clip.y0, clip.y1] } else { [clip.x0, clip.x1] };
        let steps = steps_within(from[along], direction, major, visible);
        let mut walk = Walk::new(minor, major, *steps.start());
        if steep {
            for i in steps {
                let center = from[0] + side * walk.shift;
                self.span(from[1] + direction * i, center - 1, center + 2, color);
                walk.step();
            }
            return;
        }
        // Columns are slow to write. Each row is covered from the first column that reaches it to the last: `since` holds the
        // first ones of the four rows that the current column covers, in the order in which the rows end.
        let row =
            |shift: i32, ahead: i32| from[1] + side * shift + if side < 0 { 2 - ahead } else { ahead - 1 };
        let mut cover = |row: i32, steps: Range<i32>| {
            let (a, b) = (from[0] + direction * steps.start, from[0] + direction * (steps.end - 1));
            if !steps.is_empty() {
                self.span(row, a.min(b), a.max(b), color);
            }
        };
        let (first, end) = (*steps.start(), steps.end() + 1);
        let mut since = [first; 4];
        for next in first + 1..=end {
            let shift = walk.shift;
            if walk.step() {
                cover(row(shift, 0), since[0]..next);
                since = [since[1], since[2], since[3], next];
            }
        }
        for (ahead, since) in (0..).zip(since) {
            cover(row(walk.shift, ahead), since..end);
        }
    }

    /// An anti-aliased line, in f32: along the longer axis from the smaller to the larger coordinate, both ends
    /// included, the two pixels about the crossing are blended with its fraction. Coinciding ends are one pixel.
    pub(super) fn aa_line(&mut self, from: [i32; 2], to: [i32; 2], color: Rgb) {
        if from == to {
            if let Some(pixel) = self.pixel(from[0], from[1]) {
                *pixel = pack(color);
            }
            return;
        }
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let steep = dx.abs() < dy.abs();
        let (along, across) = if steep { (1, 0) } else { (0, 1) };
        let (start, end) = if from[along] <= to[along] { (from, to) } else { (to, from) };
        let slope = (end[across] - start[across]) as f32 / (end[along] - start[along]) as f32;
        let clip = self.clip();
        let visible = if steep { [clip.y0, clip.y1] } else { [clip.x0, clip.x1] };
        for i in steps_within(start[along], 1, end[along] - start[along], visible) {
            let position = start[along] + i;
            let crossing = start[across] as f32 + slope * i as f32;
            let floor = crossing.floor();
            let fraction = crossing - floor;
            for (offset, weight) in [(0, 1.0 - fraction), (1, fraction)] {
                let cross = floor as i32 + offset;
                let (x, y) = if steep { (cross, position) } else { (position, cross) };
                if weight > 0.0
                    && let Some(pixel) = self.pixel(x, y)
                {
                    *pixel = pack(blend(unpack(*pixel), color, weight));
                }
            }
        }
    }
}

/// ceil((i m - floor(M/2))/M) for i = first, first + 1, ..., walked without dividing.
struct Walk {
    shift: i32,
    /// shift * M - short = i m - floor(M/2), 0 <= short < M.
    short: i32,
    minor: i32,
    major: i32,
}

impl Walk {
    fn new(minor: i32, major: i32, first: i32) -> Self {
        let divisor = major.max(1);
        let negated = i64::from(major / 2) - i64::from(first) * i64::from(minor);
        let shift = -negated.div_euclid(i64::from(divisor)) as i32;
        Self { shift, short: negated.rem_euclid(i64::from(divisor)) as i32, minor, major: divisor }
    }

    /// Goes on by one; whether the value has grown, by one at most.
    fn step(&mut self) -> bool {
        self.short -= self.minor;
        let grows = self.short < 0;
        if grows {
            self.short += self.major;
            self.shift += 1;
        }
        grows
    }
}

/// trunc(weight * color + (1 - weight) * old) per channel, in f32.
fn blend(old: Rgb, color: Rgb, weight: f32) -> Rgb {
    std::array::from_fn(|c| (weight * f32::from(color[c]) + (1.0 - weight) * f32::from(old[c])) as u8)
}

/// The steps i in 0..=count for which start + direction * i lies in `visible` (half-open).
fn steps_within(start: i32, direction: i32, count: i32, visible: [i32; 2]) -> RangeInclusive<i32> {
    let [low, high] = [visible[0], visible[1] - 1];
    let (first, last) =
        if direction >= 0 { (low - start, high - start) } else { (start - high, start - low) };
    first.max(0)..=last.min(count)
}

#[cfg(test)]
mod tests {
    use crate::canvas::Canvas;
    use crate::exact::raster::{Raster, Scratch};
    use crate::region::Region;

    fn inked(paint: impl Fn(&mut Raster<'_>)) -> Vec<(usize, usize)> {
        let mut canvas = Canvas::new(16, 16);
        let region = Region::of(canvas.bounds());
        paint(&mut Raster::new(&mut canvas, &region, &mut Scratch::default()));
        let pixels = (0..16).flat_map(|y| (0..16).map(move |x| (x, y)));
        pixels.filter(|&(x, y)| canvas.get(x, y) != Some([0; 3])).collect()
    }

    #[test]
    fn wide_line_covers_one_before_and_two_after() {
        let vertical = inked(|r| r.wide_line([8, 3], [8, 5], [1; 3]));
        let expected: Vec<_> = (3..=5).flat_map(|y| (7..=10).map(move |x| (x, y))).collect();
        assert_eq!(vertical, expected);
        let horizontal = inked(|r| r.wide_line([3, 8], [5, 8], [1; 3]));
        let expected: Vec<_> = (7..=10).flat_map(|y| (3..=5).map(move |x| (x, y))).collect();
        assert_eq!(horizontal, expected);
        assert_eq!(inked(|r| r.wide_line([8, 8], [8, 8], [1; 3])), [(7, 8), (8, 8), (9, 8), (10, 8)]);
    }

    #[test]
    fn wide_line_displacement_follows_the_formula_in_all_directions() {
        for (dx, dy) in [(5_i32, 3_i32), (-5, 3), (3, -5), (-2, -6), (6, 1), (4, 4), (-4, 4)] {
            let (major, minor) = (dx.abs().max(dy.abs()), dx.abs().min(dy.abs()));
            let mut expected = Vec::new();
            for i in 0..=major {
                let shift = (f64::from(i * minor - major / 2) / f64::from(major)).ceil() as i32;
                for width in -1..=2 {
                    let (x, y) = if dx.abs() <= dy.abs() {
                        (8 + shift * dx.signum() + width, 8 + i * dy.signum())
                    } else {
                        (8 + i * dx.signum(), 8 + shift * dy.signum() + width)
                    };
                    expected.push((x as usize, y as usize));
                }
            }
            expected.sort_by_key(|&(x, y)| (y, x));
            expected.dedup();
            assert_eq!(inked(|r| r.wide_line([8, 8], [8 + dx, 8 + dy], [1; 3])), expected, "({dx}, {dy})");
        }
    }

    #[test]
    fn fat_segment_is_skewed_on_two_diagonals() {
        // h = (1, 1) whatever the direction: along (1, 1) the quadrilateral degenerates to the line itself.
        let along = inked(|r| r.fat_segment([4, 4], [10, 10], [1; 3]));
        let against = inked(|r| r.fat_segment([4, 10], [10, 4], [1; 3]));
        assert!(along.contains(&(3, 3)) && !along.contains(&(8, 5)));
        assert!(against.contains(&(8, 8)) && against.contains(&(6, 6)));
        assert_ne!(along.len(), against.len());
    }

    #[test]
    fn aa_line_blends_with_the_fraction_and_truncates() {
        let mut canvas = Canvas::from_rgb(16, 16, &[100; 16 * 16 * 3]).expect("the length fits");
        let region = Region::of(canvas.bounds());
        Raster::new(&mut canvas, &region, &mut Scratch::default()).aa_line([6, 3], [2, 2], [201, 0, 100]);
        assert_eq!(canvas.get(2, 2), Some([201, 0, 100]));
        assert_eq!(canvas.get(2, 3), Some([100; 3]));
        assert_eq!(canvas.get(3, 2), Some([175, 25, 100]));
        assert_eq!(canvas.get(3, 3), Some([125, 75, 100]));
        assert_eq!(canvas.get(6, 3), Some([201, 0, 100]));
        let point = inked(|r| r.aa_line([5, 5], [5, 5], [1; 3]));
        assert_eq!(point, [(5, 5)]);
    }
}
