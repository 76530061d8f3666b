//! Textures: smaller copies of themselves for what is far away, and reading between texels.

use crate::error::RenderError;

/// A flat picture that repeats without end.
#[derive(Clone, Debug)]
pub struct Texture {
    levels: Vec<Image>,
}

/// Six square pictures around a point, in the order +x, -x, +y, -y, +z, -z.
#[derive(Clone, Debug)]
pub struct CubeTexture {
    faces: Vec<Texture>,
    size: usize,
}

#[derive(Clone, Debug)]
struct Image {
    width: usize,
    height: usize,
    texels: Vec<Texel>,
}

/// Red, green and blue in 16 bits each, so that all three are mixed by one multiplication.
type Texel = u64;

fn texel([r, g, b]: [u8; 3]) -> Texel {
    u64::from(r) | u64::from(g) << 16 | u64::from(b) << 32
}

/// The lowest byte of each of the three numbers.
const BYTES: Texel = 0x00ff_00ff_00ff;

/// Between `a` and `b`: `share` of 256 parts of `b`.
#[inline]
fn mix(a: Texel, b: Texel, share: u32) -> Texel {
    let share = u64::from(share);
    ((a * (256 - share) + b * share + 0x0080_0080_0080) >> 8) & BYTES
}

impl Texture {
    /// From `[H, W, 3]` bytes, the first row at v = 0.
    pub fn new(width: usize, height: usize, rgb: &[u8]) -> Result<Self, RenderError> {
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

    /// Texels along u and v.
    pub(super) fn size(&self) -> [f32; 2] {
        [self.levels[0].width as f32, self.levels[0].height as f32]
    }

    /// The colour, 0 to 255, at (u, v), where one period is 1; `detail` is the logarithm to base 2 of the texels per
    /// pixel.
    #[inline]
    pub(super) fn at(&self, u: f32, v: f32, detail: f32, repeats: bool) -> [f32; 3] {
        let last = (self.levels.len() - 1) as f32;
        let detail = detail.max(0.0).min(last);
        let lower = detail as usize;
        let share = ((detail - lower as f32) * 256.0) as u32;
        let mut color = self.levels[lower].between(u, v, repeats);
        if share > 0 {
            color = mix(color, self.levels[lower + 1].between(u, v, repeats), share);
        }
        [(color & 0xff) as f32, (color >> 16 & 0xff) as f32, (color >> 32 & 0xff) as f32]
    }
}

impl CubeTexture {
    /// From six faces of `[size, size, 3]` bytes, one after the other; or one face, six times the same.
    pub fn new(size: usize, rgb: &[u8]) -> Result<Self, RenderError> {
        let face = size * size * 3;
        let faces = match rgb.len() {
            len if len == face => (0..6).map(|_| Texture::new(size, size, rgb)).collect(),
            len if len == 6 * face && face > 0 => {
                rgb.chunks_exact(face).map(|rgb| Texture::new(size, size, rgb)).collect()
            }
            len => Err(RenderError::Texture { what: format!("a cube of {size} texels with {len} bytes") }),
        };
        Ok(Self { faces: faces?, size })
    }

    /// The colour, 0 to 255, in a direction; `across` says how the direction changes from pixel to pixel.
    pub(super) fn at(&self, direction: [f32; 3], across: [[f32; 3]; 2]) -> [f32; 3] {
        let (face, [u, v, major]) = project(direction);
        let half = 0.5 * self.size as f32;
        let mut texels = 0.0_f32;
        for step in across {
            // Derivatives of u / major and v / major on this face.
            let [du, dv, dm] = on_face(face, step);
            for slope in [(du * major - u * dm), (dv * major - v * dm)] {
                texels = texels.max((slope / (major * major)).abs() * half);
            }
        }
        self.faces[face].at(0.5 * (u / major + 1.0), 0.5 * (v / major + 1.0), detail(texels), false)
    }
}

/// The face that a direction meets, and the direction on it: u, v, and the distance to the face.
fn project(d: [f32; 3]) -> (usize, [f32; 3]) {
    let [x, y, z] = d.map(f32::abs);
    let axis = if x >= y && x >= z { 0 } else { 2 - usize::from(y >= z) };
    let face = 2 * axis + usize::from(d[axis] < 0.0);
    (face, on_face(face, d))
}

/// A vector in the axes of a face (OpenGL 1.5, table 3.21).
fn on_face(face: usize, [x, y, z]: [f32; 3]) -> [f32; 3] {
    match face {
        0 => [-z, -y, x],
        1 => [z, -y, -x],
        2 => [x, z, y],
        3 => [x, -z, -y],
        4 => [x, -y, z],
        _ => [-x, -y, -z],
    }
}

/// The logarithm to base 2, linear between powers of two: exact enough to choose a level, and the same everywhere.
pub(super) fn detail(texels: f32) -> f32 {
    if texels <= 1.0 || !texels.is_finite() {
        return 0.0;
    }
    let bits = texels.to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    exponent as f32 + (mantissa - 1.0)
}

impl Image {
    /// Half the size; `None` for a single texel.
    fn halved(&self) -> Option<Image> {
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

    #[inline]
    fn between(&self, u: f32, v: f32, repeats: bool) -> Texel {
        self.mixed(neighbours(u, self.width, repeats), neighbours(v, self.height, repeats))
    }

    #[inline]
    fn mixed(&self, (x0, x1, share_x): (usize, usize, u32), (y0, y1, share_y): (usize, usize, u32)) -> Texel {
        let (upper, lower) = (&self.texels[y0 * self.width..], &self.texels[y1 * self.width..]);
        let upper = mix(upper[x0], upper[x1], share_x);
        let lower = mix(lower[x0], lower[x1], share_x);
        mix(upper, lower, share_y)
    }
}

/// The two texels around a coordinate and how many of 256 parts the second has.
#[inline]
fn neighbours(coordinate: f32, size: usize, repeats: bool) -> (usize, usize, u32) {
    let last = size - 1;
    if !repeats {
        let place = (coordinate * size as f32 - 0.5).max(0.0).min(last as f32);
        let low = place as usize;
        return (low, (low + 1).min(last), ((place - low as f32) * 256.0) as u32);
    }
    // Shifted by one so that it is not negative: cheaper than rounding down.
    let place = fraction(coordinate) * size as f32 + 0.5;
    let whole = place as usize;
    let share = ((place - whole as f32) * 256.0) as u32;
    let high = if whole >= size { 0 } else { whole };
    (if whole == 0 { last } else { (whole - 1).min(last) }, high, share)
}

/// What is left of a number when its whole part is gone, from 0 to 1. Numbers beyond two thousand million have lost it.
#[inline]
fn fraction(value: f32) -> f32 {
    let part = value - value as i32 as f32;
    if part < 0.0 { part + 1.0 } else { part }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_repeat_and_blur_with_distance() {
        let texture = Texture::new(2, 1, &[0, 0, 0, 200, 100, 50]).expect("sound");
        assert_eq!(texture.at(0.25, 0.5, 0.0, true), [0.0; 3]);
        assert_eq!(texture.at(-1.25, 0.5, 0.0, true), [200.0, 100.0, 50.0]);
        assert_eq!(texture.at(0.5, 0.3, 0.0, true), [100.0, 50.0, 25.0]);
        assert_eq!(texture.at(0.25, 0.5, 9.0, true), [100.0, 50.0, 25.0]);
        assert_eq!(texture.at(0.25, 0.5, 0.5, true), [50.0, 25.0, 13.0]);
        assert!(Texture::new(2, 1, &[0; 5]).is_err() && Texture::new(0, 1, &[]).is_err());
    }

    #[test]
    fn a_cube_shows_the_face_that_is_looked_at() {
        let faces: Vec<u8> = (0..6u8).flat_map(|face| [face * 40; 12]).collect();
        let cube = CubeTexture::new(2, &faces).expect("sound");
        let still = [[0.0; 3]; 2];
        for (face, direction) in [
            [1.0, 0.2, -0.3],
            [-1.0, 0.2, 0.3],
            [0.1, 1.0, 0.3],
            [0.1, -1.0, 0.3],
            [0.1, 0.2, 1.0],
            [0.1, 0.2, -1.0],
        ]
        .into_iter()
        .enumerate()
        {
            assert_eq!(cube.at(direction, still), [face as f32 * 40.0; 3]);
        }
    }
}
