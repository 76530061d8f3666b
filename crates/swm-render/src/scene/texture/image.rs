//! One image of a texture: texels in one number each, the image of half the size, and reading between texels. Which image is
//! read is not decided here.

use crate::scene::lanes::{LANES, Lanes, splat};

/// Texels, row after row.
#[derive(Clone, Debug)]
pub(super) struct Image {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) texels: Vec<Texel>,
}

/// Red, green and blue in 16 bits each, so that all three are mixed by one multiplication; and [`CALM`].
pub(super) type Texel = u64;

/// The bit of texels around which all is of their color, in their image and the next smaller one: whatever is read
/// between texels there is this color. Checkers are calm nearly everywhere.
pub(super) const CALM: Texel = 1 << 63;

/// A texel of this color.
pub(super) fn texel([r, g, b]: [u8; 3]) -> Texel {
    u64::from(r) | u64::from(g) << 16 | u64::from(b) << 32
}

/// The lowest byte of each of the three values.
const BYTES: Texel = 0x00ff_00ff_00ff;

/// Between `a` and `b`: `share` of 256 parts of `b`.
#[inline]
pub(super) fn mix(a: Texel, b: Texel, share: u32) -> Texel {
    let (a, b, share) = (a & BYTES, b & BYTES, u64::from(share));
    ((a * (256 - share) + b * share + 0x0080_0080_0080) >> 8) & BYTES
}

impl Image {
    /// Half the size; `None` for a single texel.
    pub(super) fn halved(&self) -> Option<Image> {
        if self.width == 1 && self.height == 1 {
            return None;
        }
        let (width, height) = ((self.width / 2).max(1), (self.height / 2).max(1));
        let taps = |at: usize, small: usize, large: usize| {
            let place = (at as f32 + 0.5) * (large as f32 / small as f32) - 0.5;
            let low = place.max(0.0) as usize;
            (low, (low + 1).min(large - 1), ((place - low as f32) * 256.0 + 0.5) as u32)
        };
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            let rows = taps(y, height, self.height);
            for x in 0..width {
                texels.push(self.mixed(taps(x, width, self.width), rows));
            }
        }
        Some(Image { width, height, texels })
    }

    /// Where the eight texels around are of the same color, across the edges where it repeats.
    pub(super) fn flat(&self) -> Vec<bool> {
        let (width, height) = (self.width, self.height);
        let around = |at: usize, size: usize| [(at + size - 1) % size, at, (at + 1) % size];
        (0..width * height)
            .map(|index| {
                let (x, y) = (index % width, index / width);
                let color = self.texels[index];
                around(y, height)
                    .iter()
                    .all(|y| around(x, width).iter().all(|x| self.texels[y * width + x] & BYTES == color))
            })
            .collect()
    }

    /// The texel that (u, v) is in.
    #[inline]
    pub(super) fn nearest(&self, u: f32, v: f32) -> Texel {
        let place = |coordinate: f32, size: usize| {
            ((coordinate * size as f32) as i32).clamp(0, size as i32 - 1) as usize
        };
        self.texels[place(v, self.height) * self.width + place(u, self.width)]
    }

    /// The color at (u, v), mixed of the four texels around.
    #[inline]
    pub(super) fn between(&self, u: f32, v: f32, repeats: bool) -> Texel {
        self.mixed(neighbors(u, self.width, repeats), neighbors(v, self.height, repeats))
    }

    /// The texels that points between 0 and 1 are in.
    #[inline]
    pub(super) fn nearest_to(&self, u: Lanes, v: Lanes) -> [u32; LANES] {
        let place = |coordinate: Lanes, size: usize| {
            let places = (coordinate * splat(size as f32)).fast_trunc_int().to_array();
            places.map(|place| place.clamp(0, size as i32 - 1) as u32)
        };
        let (x, y) = (place(u, self.width), place(v, self.height));
        std::array::from_fn(|lane| y[lane] * self.width as u32 + x[lane])
    }

    #[inline]
    pub(super) fn mixed(
        &self,
        (x0, x1, share_x): (usize, usize, u32),
        (y0, y1, share_y): (usize, usize, u32),
    ) -> Texel {
        let (upper, lower) = (&self.texels[y0 * self.width..], &self.texels[y1 * self.width..]);
        let color = upper[x0] & BYTES;
        if [upper[x1], lower[x0], lower[x1]].iter().all(|other| other & BYTES == color) {
            return color;
        }
        let upper = mix(upper[x0], upper[x1], share_x);
        let lower = mix(lower[x0], lower[x1], share_x);
        mix(upper, lower, share_y)
    }
}

/// The two texels around a coordinate from 0 to 1, and how many of 256 parts the second has.
#[inline]
fn neighbors(coordinate: f32, size: usize, repeats: bool) -> (usize, usize, u32) {
    let last = size as i32 - 1;
    // Shifted by one so that it is not negative: cheaper than rounding down.
    let place = coordinate * size as f32 + 0.5;
    let whole = place as i32;
    let share = ((place - whole as f32) * 256.0) as i32 as u32;
    let (low, high) = if repeats {
        (if whole == 0 { last } else { whole - 1 }, if whole > last { 0 } else { whole })
    } else {
        ((whole - 1).clamp(0, last), whole.clamp(0, last))
    };
    (low as usize, high as usize, share)
}

/// [`neighbors`] of eight coordinates of an image that repeats.
pub(super) struct Taps {
    low: [u32; LANES],
    high: [u32; LANES],
    share: [i32; LANES],
}

impl Taps {
    #[inline]
    pub(super) fn of(&self, lane: usize) -> (usize, usize, u32) {
        (self.low[lane] as usize, self.high[lane] as usize, self.share[lane] as u32)
    }
}

#[inline]
pub(super) fn neighbors_of(coordinate: Lanes, size: usize) -> Taps {
    let last = size as i32 - 1;
    let place = coordinate * splat(size as f32) + splat(0.5);
    let whole = place.fast_trunc_int();
    let share = ((place - Lanes::from_i32x8(whole)) * splat(256.0)).fast_trunc_int().to_array();
    let whole = whole.to_array();
    Taps {
        low: whole.map(|whole| if whole == 0 { last } else { whole - 1 } as u32),
        high: whole.map(|whole| if whole > last { 0 } else { whole } as u32),
        share,
    }
}

/// Red, green or blue.
#[inline]
pub(super) fn channel(color: Texel, k: usize) -> f32 {
    (color >> (16 * k) & 0xff) as i32 as f32
}
