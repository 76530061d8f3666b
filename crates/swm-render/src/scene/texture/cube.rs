//! Six textures around a point: skies, and boxes that show one image on all sides.

use super::Texture;
use super::image::channel;
use crate::error::RenderError;

/// Six square images around a point, in the order +x, -x, +y, -y, +z, -z.
#[derive(Clone, Debug)]
pub struct CubeTexture {
    faces: Vec<Texture>,
    size: usize,
}

/// Cube textures with faces up to this size are marked where they are calm; larger ones are skies, which are not.
const MARKED: usize = 256;

impl CubeTexture {
    /// From six faces of `[size, size, 3]` bytes, one after the other; or one face, six times the same.
    ///
    /// # Errors
    ///
    /// [`RenderError::Texture`]: the bytes are not as many as one face or six have.
    pub fn new(size: usize, rgb: &[u8]) -> Result<Self, RenderError> {
        let face = size * size * 3;
        let make = if size <= MARKED { Texture::new } else { Texture::plain };
        let faces = match rgb.len() {
            len if len == face => (0..6).map(|_| make(size, size, rgb)).collect(),
            len if len == 6 * face && face > 0 => {
                rgb.chunks_exact(face).map(|rgb| make(size, size, rgb)).collect()
            }
            len => Err(RenderError::Texture { what: format!("a cube of {size} texels with {len} bytes") }),
        };
        Ok(Self { faces: faces?, size })
    }

    /// The same images in other colors; as [`Texture::recolored`], of each face.
    #[must_use]
    pub fn recolored(&self, recolor: impl Fn([usize; 2], [u8; 3]) -> [u8; 3]) -> Self {
        Self { faces: self.faces.iter().map(|face| face.recolored(&recolor)).collect(), size: self.size }
    }

    /// The color, 0 to 255, in a direction; `across` says how the direction changes from pixel to pixel.
    pub(in crate::scene) fn at(&self, direction: [f32; 3], across: [[f32; 3]; 2]) -> [f32; 3] {
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
        let color = self.faces[face].at(0.5 * (u / major + 1.0), 0.5 * (v / major + 1.0), texels, false);
        [0, 1, 2].map(|k| channel(color, k))
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

#[cfg(test)]
mod tests {
    use super::*;

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
