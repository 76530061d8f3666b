//! What the images of the environments have in common: materials, textures, cameras, the renderer's quality.

use nalgebra::{Matrix3, Vector3};
use swm_core::ImageSize;
use swm_render::Geometry;
use swm_render::scene::{
    Camera, CubeTexture, Instance, Material, NO_SEGMENT, Projection, Quality, SceneRenderer, Shape, Texture,
};

use crate::attitude::world_from_body;

/// A surface without highlights.
pub(crate) fn matte() -> Material {
    Material { color: [1.0; 4], specular: 0.0, ..Material::default() }
}

/// An opaque color.
pub(crate) fn opaque(color: [u8; 3]) -> [f32; 4] {
    let [r, g, b] = color.map(|channel| f32::from(channel) / 255.0);
    [r, g, b, 1.0]
}

/// A thing that stands upright at a place.
pub(crate) fn upright(shape: Shape, position: [f64; 3], material: Material) -> Instance {
    Instance {
        shape,
        position,
        rotation: rows(&Matrix3::identity()),
        material,
        segment: NO_SEGMENT,
        casts_shadow: false,
    }
}

/// Puts a part of a body that is at `origin` with the axes `world`: at `offset` in the body's frame, turned about its z axis.
pub(crate) fn place(
    instance: &mut Instance,
    world: &Matrix3<f64>,
    origin: Vector3<f64>,
    offset: [f64; 3],
    turn_rad: f64,
) {
    let turn = world_from_body(crate::attitude::from_euler([0.0, 0.0, turn_rad]));
    instance.position = (origin + world * Vector3::from(offset)).into();
    instance.rotation = rows(&(world * turn));
}

fn rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}

/// A camera at `eye` that looks along `forward`, with the image's up near `up`; it opens to `opening` on either side of the
/// middle, at distance 1.
pub(crate) fn camera(
    eye: Vector3<f64>,
    forward: Vector3<f64>,
    up: Vector3<f64>,
    opening: f64,
    [near, far]: [f64; 2],
) -> Camera {
    let right = forward.cross(&up).normalize();
    Camera {
        position: eye.into(),
        forward: forward.into(),
        up: right.cross(&forward).into(),
        projection: Projection { bottom: -opening, top: opening, center: 0.0, half_width: None },
        near,
        far,
    }
}

/// A sky of one color.
pub(crate) fn sky(color: [u8; 3]) -> CubeTexture {
    CubeTexture::new(1, &color.repeat(6)).expect("six texels of three bytes")
}

/// Two by two squares of `texels` texels a side.
pub(crate) fn squares(colors: [[u8; 3]; 2], texels: usize) -> Result<Texture, String> {
    let side = 2 * texels;
    let bytes = (0..side * side).flat_map(|at| {
        let (row, column) = (at / side / texels, at % side / texels);
        colors[(row + column) % 2]
    });
    Texture::new(side, side, &bytes.collect::<Vec<u8>>()).map_err(|error| error.to_string())
}

/// A renderer of images of this size, without shadows and reflections.
pub(crate) fn renderer(size: ImageSize) -> Result<SceneRenderer, String> {
    let quality = Quality { antialias: true, shadows: false, reflections: false };
    SceneRenderer::new(Geometry::new(size.height, size.width), quality).map_err(|error| error.to_string())
}
