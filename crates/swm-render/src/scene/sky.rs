//! The background: an image at infinity, which changes only when the eye turns.

use std::sync::Arc;

use super::assets::Assets;
use super::description::{Camera, Haze, Scene};
use super::texture::CubeTexture;
use super::vector::{Vector, cross, dot, length};
use super::view::View;

/// The background of one image size, kept while the eye does not turn.
#[derive(Debug, Default)]
pub(super) struct Sky {
    key: Option<Key>,
    /// What is seen at infinity; held, so that no other can have its place.
    texture: Option<Arc<CubeTexture>>,
    /// `[H, W, 3]`, 0 to 1.
    colors: Vec<[f32; 3]>,
}

/// All that the background depends on, but for its texture.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Key {
    camera: Camera,
    haze: Option<Haze>,
}

impl Sky {
    /// The colors of all pixels.
    pub(super) fn colors(&mut self, scene: &Scene, assets: &Assets, view: &View) -> &[[f32; 3]] {
        let camera = Camera { position: [0.0; 3], ..scene.camera };
        let key = Some(Key { camera, haze: scene.haze });
        let texture = scene.sky.map(|sky| &assets.cubes[sky]);
        let is_same = match (&self.texture, texture) {
            (Some(old), Some(new)) => Arc::ptr_eq(old, new),
            (old, new) => old.is_none() && new.is_none(),
        };
        if self.key != key || !is_same || self.colors.len() != view.width * view.height {
            self.draw(scene, texture, view);
            (self.key, self.texture) = (key, texture.cloned());
        }
        &self.colors
    }

    fn draw(&mut self, scene: &Scene, texture: Option<&Arc<CubeTexture>>, view: &View) {
        self.colors.clear();
        self.colors.resize(view.width * view.height, [0.0; 3]);
        let Some(texture) = texture else { return };
        // The texture's y is up, its z comes toward us.
        let turned = |[x, y, z]: Vector| [x as f32, z as f32, -y as f32];
        let (step_x, step_y) = view.steps();
        for (index, color) in self.colors.iter_mut().enumerate() {
            let (x, y) = (index % view.width, index / view.width);
            let direction = view.direction(x as f64 + 0.5, y as f64 + 0.5);
            let seen = texture.at(turned(direction), [turned(step_x), turned(step_y)]);
            *color = seen.map(|value| value * (1.0 / 255.0));
            if let Some(haze) = &scene.haze {
                let share = share(haze, direction);
                for (value, mist) in color.iter_mut().zip(haze.color) {
                    *value += share * (mist - *value);
                }
            }
        }
    }
}

/// How much of the sky the haze covers in a direction: all at the horizon, nothing above its upper rim.
///
/// The haze is a cone whose wall is opaque at the bottom and clear at the top; MuJoCo draws it around the eye, as wide
/// as the sky at the bottom and narrower by `width` at the top.
fn share(haze: &Haze, direction: Vector) -> f32 {
    let up = dot(direction, haze.up);
    let flat = length(cross(direction, haze.up));
    if flat == 0.0 {
        return 0.0;
    }
    let (width, elevation) = (f64::from(haze.width), f64::from(haze.elevation).max(1e-9));
    // On the wall at height h (0 to 1, from `elevation` below the eye up to it) the radius is 1 - width (1 - h):
    // the ray at slope s meets it where elevation (h - 1) = s × radius.
    let slope = up / flat;
    let height = (elevation + slope * (1.0 - width)) / (elevation - slope * width).max(1e-12);
    // Opaque where the wall's inner and outer halves meet, clear at either rim.
    let turn = transition(width);
    let part = if height < turn { height / turn } else { (1.0 - height) / (1.0 - turn) };
    part.clamp(0.0, 1.0) as f32
}

/// The height where the haze is opaque.
fn transition(width: f64) -> f64 {
    // sin(alpha) and sin(beta) of the cone's slant, alpha = atan(1 / width), beta = 135 degrees - alpha.
    let hypotenuse = (1.0 + width * width).sqrt();
    let (sine, cosine) = (1.0 / hypotenuse, width / hypotenuse);
    let beta = 0.5f64.sqrt() * (cosine + sine);
    0.5f64.sqrt() * width * sine / beta
}
