//! Flat textures that repeat, with smaller copies of themselves for what is far away. How texels are stored and what lies
//! between them is in `image`, six textures around a point are in `cube`.

mod cube;
mod image;

pub use self::cube::CubeTexture;
use self::image::{CALM, Image, Taps, Texel, channel, mix, neighbors_of, texel};
use super::lanes::{LANES, Lanes, Lanes3, splat};
use crate::error::RenderError;

/// A flat image that repeats without end.
#[derive(Clone, Debug)]
pub struct Texture {
    levels: Vec<Image>,
}

/// Which image is read, and how many of 256 parts the next one has.
type Step = (usize, u32);

/// So many colors are told apart when a texture is recolored.
const FEW_COLORS: usize = 8;

impl Texture {
    /// From `[H, W, 3]` bytes, the first row at v = 0.
    ///
    /// # Errors
    ///
    /// [`RenderError::Texture`]: a side is 0, or the bytes are not as many as the sides ask for.
    pub fn new(width: usize, height: usize, rgb: &[u8]) -> Result<Self, RenderError> {
        let mut texture = Self::plain(width, height, rgb)?;
        texture.mark_calm();
        Ok(texture)
    }

    fn plain(width: usize, height: usize, rgb: &[u8]) -> Result<Self, RenderError> {
        if width == 0 || height == 0 || rgb.len() != width * height * 3 {
            let what = format!("a texture of {width} x {height} texels with {} bytes", rgb.len());
            return Err(RenderError::Texture { what });
        }
        let texels = rgb.chunks_exact(3).map(|c| texel([c[0], c[1], c[2]])).collect();
        let mut levels = vec![Image { width, height, texels }];
        while let Some(smaller) = levels.last().and_then(Image::halved) {
            levels.push(smaller);
        }
        Ok(Self { levels })
    }

    /// The same image in other colors: in place of every color of the largest image what `recolor` makes of it, given its
    /// row and column too. A fraction of the work of a new one.
    #[must_use]
    pub fn recolored(&self, recolor: impl Fn([usize; 2], [u8; 3]) -> [u8; 3]) -> Self {
        let Image { width, height, ref texels } = self.levels[0];
        // What became of the colors so far, as long as they are few and each becomes one other.
        let (mut known, mut is_by_color): (Vec<[Texel; 2]>, bool) = (Vec::new(), true);
        let mut changed = Vec::with_capacity(texels.len());
        for (row, texels) in texels.chunks(width).enumerate() {
            let mut last = 0;
            for (column, &old) in texels.iter().enumerate() {
                let old = old & !CALM;
                let color = [0, 16, 32].map(|shift| (old >> shift & 0xff) as u8);
                let new = texel(recolor([row, column], color));
                // Neighbors mostly have the same color.
                if known.get(last).is_none_or(|[from, _]| *from != old) {
                    last = known.iter().position(|[from, _]| *from == old).unwrap_or(known.len());
                }
                match known.get(last) {
                    Some([_, to]) => is_by_color &= *to == new,
                    None if known.len() < FEW_COLORS => known.push([old, new]),
                    None => is_by_color = false,
                }
                changed.push(new);
            }
        }
        let mut levels = vec![Image { width, height, texels: changed }];
        while let Some(smaller) = levels.last().and_then(Image::halved) {
            levels.push(smaller);
        }
        let mut recolored = Self { levels };
        if is_by_color {
            // What is of one color around stays so.
            for (new, old) in recolored.levels.iter_mut().zip(&self.levels) {
                new.texels.iter_mut().zip(&old.texels).for_each(|(new, old)| *new |= old & CALM);
            }
        } else {
            recolored.mark_calm();
        }
        recolored
    }

    /// Sets [`CALM`].
    fn mark_calm(&mut self) {
        let flat: Vec<Vec<bool>> = self.levels.iter().map(Image::flat).collect();
        for level in 0..self.levels.len() {
            let (done, rest) = self.levels.split_at_mut(level + 1);
            let (image, smaller) = (&mut done[level], rest.first());
            for y in 0..image.height {
                for x in 0..image.width {
                    let at = y * image.width + x;
                    let color = image.texels[at];
                    let calm_below = |smaller: &Image| {
                        let around = |at: usize, large: usize, small: usize| {
                            at * small / large..=((at + 1) * small / large).min(small - 1)
                        };
                        around(y, image.height, smaller.height).all(|y| {
                            around(x, image.width, smaller.width).all(|x| {
                                let at = y * smaller.width + x;
                                flat[level + 1][at] && smaller.texels[at] == color
                            })
                        })
                    };
                    if flat[level][at] && smaller.is_none_or(calm_below) {
                        image.texels[at] |= CALM;
                    }
                }
            }
        }
    }

    /// Texels along u and v.
    pub(super) fn size(&self) -> [f32; 2] {
        [self.levels[0].width as f32, self.levels[0].height as f32]
    }

    /// The colors, 0 to 255, at up to eight points (u, v) of a texture that repeats, where one period is 1; `texels`:
    /// per pixel.
    #[inline]
    pub(super) fn tiled(&self, u: Lanes, v: Lanes, texels: Lanes, count: usize) -> Lanes3 {
        let (u, v) = (fractions(u), fractions(v));
        let mut steps = texels.to_array().map(|texels| self.step(texels));
        // Lanes without a point do as the last one does.
        let known = steps[count - 1];
        steps[count..].fill(known);
        let mut colors: [Texel; LANES] = [0; LANES];
        if steps.iter().all(|step| step.0 == steps[0].0) {
            self.read(u, v, &steps, &mut colors[..count]);
        } else {
            let (u, v) = (u.to_array(), v.to_array());
            for (lane, color) in colors[..count].iter_mut().enumerate() {
                *color = self.read_one(u[lane], v[lane], steps[lane], true);
            }
        }
        let part = |k: usize| Lanes::new(colors.map(|color| channel(color, k)));
        Lanes3 { x: part(0), y: part(1), z: part(2) }
    }

    /// The colors at points between 0 and 1 for which the same image is read.
    #[inline]
    fn read(&self, u: Lanes, v: Lanes, steps: &[Step; LANES], colors: &mut [Texel]) {
        let level = steps[0].0;
        let image = &self.levels[level];
        let nearest = image.nearest_to(u, v);
        let mut calm = CALM;
        for (color, at) in colors.iter_mut().zip(nearest) {
            *color = image.texels[at as usize];
            calm &= *color;
        }
        if calm != 0 {
            return;
        }
        let taps = [neighbors_of(u, image.width), neighbors_of(v, image.height)];
        // The next image is read where one color differs from those around.
        let mut smaller: Option<(&Image, [Taps; 2])> = None;
        for (lane, color) in colors.iter_mut().enumerate() {
            if *color & CALM != 0 {
                continue;
            }
            *color = image.mixed(taps[0].of(lane), taps[1].of(lane));
            let share = steps[lane].1;
            if share != 0 {
                let (next, taps) = smaller.get_or_insert_with(|| {
                    let next = &self.levels[level + 1];
                    (next, [neighbors_of(u, next.width), neighbors_of(v, next.height)])
                });
                *color = mix(*color, next.mixed(taps[0].of(lane), taps[1].of(lane)), share);
            }
        }
    }

    /// Which image is read where there are so many texels per pixel, and how many of 256 parts the next has.
    #[inline]
    fn step(&self, texels: f32) -> Step {
        // The logarithm to base 2: the exponent says which image, the first bits behind it how much of the next.
        let (last, bits) = (self.levels.len() - 1, texels.clamp(1.0, 1e9).to_bits());
        let level = ((bits >> 23) as usize - 127).min(last);
        (level, if level < last { bits >> 15 & 0xff } else { 0 })
    }

    /// The color at (u, v), both from 0 to 1.
    #[inline]
    fn at(&self, u: f32, v: f32, texels: f32, repeats: bool) -> Texel {
        self.read_one(u, v, self.step(texels), repeats)
    }

    /// The same where the image is known.
    #[inline]
    fn read_one(&self, u: f32, v: f32, (level, share): Step, repeats: bool) -> Texel {
        let image = &self.levels[level];
        let color = image.nearest(u, v);
        if color & CALM != 0 {
            return color;
        }
        let color = image.between(u, v, repeats);
        if share == 0 {
            return color;
        }
        mix(color, self.levels[level + 1].between(u, v, repeats), share)
    }
}

/// The fractional part of values, from 0 to 1. Values beyond 1e9 have none.
#[inline]
fn fractions(value: Lanes) -> Lanes {
    let value = value.max(splat(-1e9)).min(splat(1e9));
    let part = value - Lanes::from_i32x8(value.fast_trunc_int());
    part.simd_lt(splat(0.0)).select(part + splat(1.0), part)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_repeat_and_blur_with_distance() {
        let texture = Texture::new(2, 1, &[0, 0, 0, 200, 100, 50]).expect("sound");
        let at = |u: f32, v: f32, texels: f32| {
            let color = texture.tiled(splat(u), splat(v), splat(texels), 8);
            color.to_arrays().map(|part| part[7])
        };
        assert_eq!(at(0.25, 0.5, 1.0), [0.0; 3]);
        assert_eq!(at(-1.25, 0.5, 1.0), [200.0, 100.0, 50.0]);
        assert_eq!(at(0.5, 0.3, 1.0), [100.0, 50.0, 25.0]);
        assert_eq!(at(0.25, 0.5, 512.0), [100.0, 50.0, 25.0]);
        assert_eq!(at(0.25, 0.5, 1.5), [50.0, 25.0, 13.0]);
        assert!(Texture::new(2, 1, &[0; 5]).is_err() && Texture::new(0, 1, &[]).is_err());
    }

    #[test]
    fn calm_texels_are_what_is_read_around_them() {
        let checker: Vec<u8> = (0..30 * 30)
            .flat_map(|i| if (i % 30 < 15) == (i / 30 < 15) { [9, 8, 7] } else { [90, 80, 70] })
            .collect();
        let marked = Texture::new(30, 30, &checker).expect("sound");
        let plain = Texture::plain(30, 30, &checker).expect("sound");
        let calm = marked.levels[0].texels.iter().filter(|&&texel| texel & CALM != 0).count();
        assert!(calm > 300 && calm < 900, "{calm}");
        for step in 0..4000 {
            let (u, v) = (fractions(splat(step as f32 * 0.137)), fractions(splat(step as f32 * 0.0391)));
            let texels = splat(1.0 + (step % 97) as f32 * 0.3);
            assert_eq!(marked.tiled(u, v, texels, 8).to_arrays(), plain.tiled(u, v, texels, 8).to_arrays());
        }
    }

    #[test]
    fn a_recolored_texture_is_what_a_new_one_would_be() {
        let checker = |[first, second, mark]: [[u8; 3]; 3]| -> Vec<u8> {
            let color = |i: usize| match (i % 45, i / 45) {
                (0, _) => mark,
                (x, y) if (x < 20) == (y < 17) => first,
                _ => second,
            };
            (0..45 * 31).flat_map(color).collect()
        };
        let texture = |colors| Texture::new(45, 31, &checker(colors)).expect("sound");
        let (old, mark) = ([[9, 8, 7], [90, 80, 70]], [255; 3]);
        // A mark may have the color of a field, and stay where the field changes.
        let (odd, even) = ([[200, 0, 30], [1, 255, 2]], [[5; 3]; 2]);
        for (new, mark) in [(odd, mark), (even, mark), (odd, old[1]), (even, old[0])] {
            let recolor = |[_, column]: [usize; 2], color| match color {
                color if column == 0 => color,
                color if color == old[0] => new[0],
                color if color == old[1] => new[1],
                mark => mark,
            };
            let recolored = texture([old[0], old[1], mark]).recolored(recolor);
            let made = texture([new[0], new[1], mark]);
            for step in 0..4000 {
                let (u, v) = (splat(step as f32 * 0.137), splat(step as f32 * 0.0391));
                let texels = splat(1.0 + (step % 97) as f32 * 0.3);
                let read = |texture: &Texture| texture.tiled(u, v, texels, 8).to_arrays();
                assert_eq!(read(&recolored), read(&made));
            }
        }
    }
}
