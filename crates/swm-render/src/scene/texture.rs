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
    /// Red, green, blue, nothing.
    texels: Vec<[u8; 4]>,
}

impl Texture {
    /// From `[H, W, 3]` bytes, the first row at v = 0.
    pub fn new(width: usize, height: usize, rgb: &[u8]) -> Result<Self, RenderError> {
        if width == 0 || height == 0 || rgb.len() != width * height * 3 {
            let what = format!("a texture of {width} x {height} texels with {} bytes", rgb.len());
            return Err(RenderError::Texture { what });
        }
        let texels = rgb.chunks_exact(3).map(|c| [c[0], c[1], c[2], 0]).collect();
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
        if detail <= 0.0 {
            return self.levels[0].between(u, v, repeats);
        }
        let detail = detail.min(last);
        let lower = detail as usize;
        let share = detail - lower as f32;
        let fine = self.levels[lower].between(u, v, repeats);
        if share == 0.0 {
            return fine;
        }
        let coarse = self.levels[lower + 1].between(u, v, repeats);
        [0, 1, 2].map(|i| fine[i] + share * (coarse[i] - fine[i]))
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
            let low = place.floor().max(0.0);
            (low as usize, (low as usize + 1).min(large - 1), place - low)
        };
        let mut texels = Vec::with_capacity(width * height);
        for y in 0..height {
            let (y0, y1, share_y) = taps(y, height, self.height);
            for x in 0..width {
                let (x0, x1, share_x) = taps(x, width, self.width);
                let color = self.mix([x0, x1], [y0, y1], share_x, share_y);
                let [r, g, b] = color.map(|value| (value + 0.5) as u8);
                texels.push([r, g, b, 0]);
            }
        }
        Some(Image { width, height, texels })
    }

    #[inline]
    fn between(&self, u: f32, v: f32, repeats: bool) -> [f32; 3] {
        let (x0, x1, share_x) = neighbours(u, self.width, repeats);
        let (y0, y1, share_y) = neighbours(v, self.height, repeats);
        self.mix([x0, x1], [y0, y1], share_x, share_y)
    }

    #[inline]
    fn mix(&self, x: [usize; 2], y: [usize; 2], share_x: f32, share_y: f32) -> [f32; 3] {
        let rows = y.map(|y| {
            let row = &self.texels[y * self.width..][..self.width];
            let (a, b) = (row[x[0]], row[x[1]]);
            [0, 1, 2].map(|i| {
                let (a, b) = (f32::from(a[i]), f32::from(b[i]));
                a + share_x * (b - a)
            })
        });
        [0, 1, 2].map(|i| rows[0][i] + share_y * (rows[1][i] - rows[0][i]))
    }
}

/// The two texels around a coordinate and the share of the second.
#[inline]
fn neighbours(coordinate: f32, size: usize, repeats: bool) -> (usize, usize, f32) {
    if !repeats {
        let place = (coordinate * size as f32 - 0.5).clamp(0.0, (size - 1) as f32);
        let low = place as usize;
        return (low, (low + 1).min(size - 1), place - low as f32);
    }
    let place = (coordinate - coordinate.floor()) * size as f32 - 0.5;
    if place < 0.0 {
        return (size - 1, 0, place + 1.0);
    }
    let low = (place as usize).min(size - 1);
    let high = if low + 1 == size { 0 } else { low + 1 };
    (low, high, place - low as f32)
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
