//! The colors of a floor, kept while neither the eye nor the floor nor a light changes: most of an image from a camera that
//! stands still. Shadows move, so that colors are kept with and without the light that casts them.

use std::sync::Arc;

use super::assets::Assets;
use super::description::{Instance, Light, Mapping, Scene, Shape};
use super::fragments::Fragments;
use super::lanes::{LANES, Lanes3, load};
use super::texture::Texture;
use super::view::View;

/// What the whole pixels of one floor look like.
#[derive(Debug, Default)]
pub(super) struct Ground {
    view: Option<View>,
    floor: Option<Floor>,
    lights: Vec<Light>,
    /// Whether the eye is where it was: if it moves, nothing is worth keeping.
    is_still: bool,
    /// Of each pixel of the image: how near the floor is whose colors are known; NaN: none.
    nearness: Vec<f32>,
    /// With the light that casts shadows, and without.
    colors: Vec<[[f32; 3]; 2]>,
}

/// All that the colors of a floor depend on, but for eye and lights.
#[derive(Debug)]
struct Floor {
    index: usize,
    instance: Instance,
    /// Held, so that no other can have its place.
    texture: Option<Arc<Texture>>,
    shadows: bool,
}

impl Floor {
    /// The first plane of a scene, if it has one and no more than one light casts shadows.
    fn of(scene: &Scene, assets: &Assets, shadows: bool) -> Option<Self> {
        if scene.lights.iter().filter(|light| light.shadow.is_some()).count() > 1 {
            return None;
        }
        let is_plane = |instance: &Instance| matches!(instance.shape, Shape::Plane { .. });
        let index = scene.instances.iter().position(is_plane)?;
        let instance = scene.instances[index];
        let texture = match instance.material.texture {
            Some(Mapping::Flat { texture, .. }) => Some(Arc::clone(&assets.textures[texture])),
            Some(Mapping::Cube { .. }) => return None,
            None => None,
        };
        Some(Self { index, instance, texture, shadows })
    }

    fn is_same(&self, other: &Self) -> bool {
        let same_texture = match (&self.texture, &other.texture) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (a, b) => a.is_none() && b.is_none(),
        };
        same_texture
            && (self.index, self.shadows) == (other.index, other.shadows)
            && self.instance == other.instance
    }
}

impl Ground {
    /// Makes room for so many pixels.
    pub(super) fn reserve(&mut self, pixels: usize) {
        self.nearness.reserve(pixels);
        self.colors.reserve(pixels);
    }

    /// Forgets what is no longer so.
    pub(super) fn begin(&mut self, view: &View, scene: &Scene, assets: &Assets, shadows: bool) {
        self.is_still = self.view.replace(*view) == Some(*view);
        let floor = Floor::of(scene, assets, shadows);
        let is_same = match (&self.floor, &floor) {
            (Some(old), Some(new)) => old.is_same(new) && self.lights == scene.lights,
            _ => false,
        };
        if self.is_still && is_same {
            return;
        }
        let pixels = view.width * view.height;
        self.floor = floor;
        self.lights.clear();
        self.lights.extend_from_slice(&scene.lights);
        self.nearness.clear();
        self.nearness.resize(pixels, f32::NAN);
        self.colors.resize(pixels, [[0.0; 3]; 2]);
    }

    /// Itself, if this is the instance whose colors it keeps.
    pub(super) fn of(&mut self, instance: usize) -> Option<&mut Self> {
        let is_kept = self.is_still && self.floor.as_ref().is_some_and(|floor| floor.index == instance);
        is_kept.then_some(self)
    }

    /// The first of eight pixels side by side that eight fragments of the floor are; `None` unless the colors of all are known.
    #[inline]
    pub(super) fn known(&self, fragments: &Fragments, at: usize) -> Option<usize> {
        let first = fragments.whole_pixels(at)?;
        let found = load(&fragments.nearness[at..], 0.0);
        let kept = self.nearness.get(first..first + LANES)?;
        (load(kept, 0.0).simd_eq(found).to_bitmask() == 0xff).then_some(first)
    }

    /// The colors of eight pixels from this one on: with the light that casts shadows where the bit of `lit` is set.
    #[inline]
    pub(super) fn colors(&self, first: usize, lit: u32) -> [[f32; 3]; LANES] {
        let kept = &self.colors[first..first + LANES];
        std::array::from_fn(|lane| kept[lane][usize::from(lit >> lane & 1 == 0)])
    }

    /// Keeps the colors of up to eight fragments.
    #[inline]
    pub(super) fn keep(&mut self, fragments: &Fragments, at: usize, count: usize, colors: [Lanes3; 2]) {
        let colors = colors.map(Lanes3::to_arrays);
        for lane in 0..count {
            // The middle of a whole pixel is its own; parts of pixels have theirs elsewhere.
            if fragments.share[at + lane] == 1.0 {
                let pixel = fragments.pixel[at + lane] as usize;
                self.nearness[pixel] = fragments.nearness[at + lane];
                self.colors[pixel] = colors.map(|[x, y, z]| [x[lane], y[lane], z[lane]]);
            }
        }
    }
}
