//! Planes that are lit at the corners of their cells only, and in between by interpolation: what the fixed-function
//! pipeline does with large facets, and what gives the floors of MuJoCo's images their look.

use super::lanes::{LANES, Lanes3, load, splat};

/// The cells of one plane along one axis: `pad`, then as many of `length` as fit, then `pad`.
#[derive(Clone, Copy, Debug)]
struct Axis {
    half: f32,
    length: f32,
    inverse: f32,
    /// Where the first whole cell begins.
    first: f32,
    /// How many whole cells there are.
    count: i32,
}

/// The lit corners of one plane, kept for its memory.
#[derive(Debug, Default)]
pub(super) struct Corners {
    axes: Option<[Axis; 2]>,
    /// Layers of colors at each corner: of the lamps without shadows, then of each with.
    colors: Vec<[f32; 3]>,
    /// For which round a corner's colors were computed.
    rounds: Vec<u32>,
    round: u32,
    layers: usize,
}

/// Cells of endless planes: MuJoCo draws as many, centered.
const ENDLESS: i32 = 200;

impl Axis {
    fn new(half: f32, length: f32) -> Self {
        if half <= 0.0 {
            let first = -length * (ENDLESS / 2) as f32;
            return Self { half: -first, length, inverse: 1.0 / length, first, count: ENDLESS };
        }
        // An even number, so that two meet in the middle.
        let count = ((2.0 * half / length) * (1.0 + 1e-6)) as i32 / 2 * 2;
        Self { half, length, inverse: 1.0 / length, first: -0.5 * length * count as f32, count }
    }

    /// The cell that a coordinate is in, from 0 to count + 1, and where in it, from 0 to 1.
    #[inline]
    fn cell(&self, at: f32) -> (i32, f32) {
        let place = (at - self.first) * self.inverse;
        if place < 0.0 {
            let pad = self.first + self.half;
            return (0, if pad > 0.0 { ((at + self.half) / pad).max(0.0) } else { 0.0 });
        }
        let whole = place as i32;
        if whole < self.count {
            return (whole + 1, place - whole as f32);
        }
        let (last, pad) = (self.first + self.length * self.count as f32, self.first + self.half);
        (self.count + 1, if pad > 0.0 { ((at - last) / pad).min(1.0) } else { 0.0 })
    }

    /// Corner `index` of 0 to count + 2.
    #[inline]
    fn corner(&self, index: i32) -> f32 {
        let inner = self.first + self.length * (index - 1) as f32;
        inner.clamp(-self.half, self.half)
    }
}

impl Corners {
    /// Whether cells of this size are large enough in the image to be seen; `pixel`: meters per pixel where the plane
    /// is nearest.
    pub(super) fn matter(cell: [f32; 2], pixel: f32) -> bool {
        cell[0].min(cell[1]) > 3.0 * pixel
    }

    /// A new plane: nothing is lit yet.
    pub(super) fn begin(&mut self, half: [f32; 2], cell: [f32; 2], layers: usize) {
        let axes = [Axis::new(half[0], cell[0]), Axis::new(half[1], cell[1])];
        let count = (axes[0].count + 3) as usize * (axes[1].count + 3) as usize;
        self.axes = Some(axes);
        self.layers = layers;
        self.round = self.round.wrapping_add(1);
        if self.rounds.len() < count || self.round == 0 {
            self.rounds.clear();
            self.rounds.resize(count, 0);
            self.round = 1;
        }
        self.colors.resize(self.colors.len().max(count * layers), [0.0; 3]);
    }

    /// Where all points lie in one triangle of one whole cell whose corners are lit, as most do: writes their colors, or
    /// returns false.
    #[inline]
    fn colors_in_one_cell(&self, axes: [Axis; 2], at: [[f32; LANES]; 2], out: &mut [Lanes3]) -> bool {
        let mut cell = [0; 2];
        let mut shares = [splat(0.0); 2];
        for k in 0..2 {
            let place = (load(&at[k], 0.0) - splat(axes[k].first)) * splat(axes[k].inverse);
            let whole = place.to_array()[0] as i32;
            let (low, high) = (splat(whole as f32), splat((whole + 1) as f32));
            let inside = place.simd_ge(low.max(splat(0.0))) & place.simd_lt(high);
            if whole >= axes[k].count || inside.to_bitmask() != 0xff {
                return false;
            }
            (cell[k], shares[k]) = (whole + 1, place - low);
        }
        let stride = axes[1].count + 3;
        let first = cell[0] * stride + cell[1];
        let corners = [first, first + 1, first + stride, first + stride + 1];
        let is_lower = (shares[0] + shares[1]).simd_le(splat(1.0)).to_bitmask();
        if !matches!(is_lower, 0 | 0xff) || corners.iter().any(|&c| self.rounds[c as usize] != self.round) {
            return false;
        }
        let one = splat(1.0);
        let (from, [first, second], [u, v]) = if is_lower == 0xff {
            (corners[0], [corners[2], corners[1]], shares)
        } else {
            (corners[3], [corners[1], corners[2]], [one - shares[0], one - shares[1]])
        };
        for (layer, color) in out.iter_mut().enumerate() {
            let at = |corner: i32| self.colors[corner as usize * self.layers + layer];
            let (from, first, second) = (at(from), at(first), at(second));
            let part =
                |k: usize| splat(from[k]) + u * splat(first[k] - from[k]) + v * splat(second[k] - from[k]);
            *color = Lanes3 { x: part(0), y: part(1), z: part(2) };
        }
        true
    }

    /// The colors of all layers at points of the plane, written to `out`, `[layers]`. `light` computes the layers at
    /// eight corners: `light(x, y, out)`.
    #[inline]
    pub(super) fn colors(
        &mut self,
        x: [f32; LANES],
        y: [f32; LANES],
        out: &mut [Lanes3],
        mut light: impl FnMut([f32; LANES], [f32; LANES], &mut [Lanes3]),
    ) {
        let Some(axes) = self.axes else { return };
        if self.colors_in_one_cell(axes, [x, y], out) {
            return;
        }
        let stride = axes[1].count + 3;
        let mut cells = [(0usize, 0.0, 0.0); LANES];
        let mut missing: [i32; 4 * LANES] = [0; 4 * LANES];
        let mut misses = 0;
        for lane in 0..LANES {
            let ((i, u), (j, v)) = (axes[0].cell(x[lane]), axes[1].cell(y[lane]));
            let first = i * stride + j;
            cells[lane] = (first as usize, u, v);
            // Neighboring points mostly share their cell.
            if lane > 0 && cells[lane - 1].0 == first as usize {
                continue;
            }
            for corner in [first, first + 1, first + stride, first + stride + 1] {
                if self.rounds[corner as usize] != self.round {
                    self.rounds[corner as usize] = self.round;
                    missing[misses] = corner;
                    misses += 1;
                }
            }
        }
        for chunk in missing[..misses].chunks(LANES) {
            let (mut xs, mut ys) = ([0.0; LANES], [0.0; LANES]);
            for (lane, corner) in chunk.iter().enumerate() {
                xs[lane] = axes[0].corner(corner / stride);
                ys[lane] = axes[1].corner(corner % stride);
            }
            light(xs, ys, out);
            for (layer, color) in out.iter().enumerate() {
                let [r, g, b] = color.to_arrays();
                for (lane, &corner) in chunk.iter().enumerate() {
                    self.colors[corner as usize * self.layers + layer] = [r[lane], g[lane], b[lane]];
                }
            }
        }
        for (layer, color) in out.iter_mut().enumerate() {
            let mut parts = [[0.0; LANES]; 3];
            let mut known = (usize::MAX, false);
            let (mut from, mut edges) = ([0.0; 3], [[0.0; 3]; 2]);
            for lane in 0..LANES {
                let (corner, u, v) = cells[lane];
                // A cell is two triangles, which meet in the diagonal from its x end to its y end.
                let is_lower = u + v <= 1.0;
                if known != (corner, is_lower) {
                    known = (corner, is_lower);
                    let at = |offset: usize| self.colors[(corner + offset) * self.layers + layer];
                    let (along, across) = (at(stride as usize), at(1));
                    let (opposite, ends) = if is_lower {
                        (at(0), [along, across])
                    } else {
                        (at(stride as usize + 1), [across, along])
                    };
                    from = opposite;
                    edges = ends.map(|end| [0, 1, 2].map(|k| end[k] - opposite[k]));
                }
                let [u, v] = if is_lower { [u, v] } else { [1.0 - u, 1.0 - v] };
                for k in 0..3 {
                    parts[k][lane] = from[k] + u * edges[0][k] + v * edges[1][k];
                }
            }
            let [x, y, z] = parts.map(|part| load(&part, 0.0));
            *color = Lanes3 { x, y, z };
        }
    }
}

/// Points of a plane in its own frame.
#[inline]
pub(super) fn on_plane(x: [f32; LANES], y: [f32; LANES]) -> Lanes3 {
    Lanes3 { x: load(&x, 0.0), y: load(&y, 0.0), z: splat(0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_light_is_kept_and_bends_are_cut_off() {
        let mut corners = Corners::default();
        corners.begin([2.3, 1.1], [0.5, 0.5], 1);
        let mut out = [Lanes3::splat([0.0; 3])];
        let (x, y) =
            ([-2.29, -1.0, -0.3, 0.0, 0.2, 0.77, 1.5, 2.2], [-1.0, -0.9, 0.0, 0.1, 0.3, 0.4, 0.9, 1.05]);
        corners.colors(x, y, &mut out, |x, y, out| {
            let point = on_plane(x, y);
            out[0] = Lanes3 { x: point.x + point.y, y: point.x * point.x, z: splat(1.0) };
        });
        for lane in 0..LANES {
            assert!((out[0].x.to_array()[lane] - (x[lane] + y[lane])).abs() < 1e-5);
            let exact = x[lane] * x[lane];
            let found = out[0].y.to_array()[lane];
            assert!(found >= exact - 1e-5 && found < exact + 0.07, "{found} {exact}");
            assert!((out[0].z.to_array()[lane] - 1.0).abs() < 1e-6);
        }
    }
}
