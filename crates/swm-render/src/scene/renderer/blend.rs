//! The pass of what one sees through.

use super::passes::{Passes, is_behind, is_opaque};
use crate::scene::assets::Assets;
use crate::scene::description::{Instance, Scene, Shape};
use crate::scene::lanes::{LANES, Lanes3};
use crate::scene::shading::Shading;
use crate::scene::shape;
use crate::scene::triangles::Sides;
use crate::scene::vector::{length, sub, wide};
use crate::scene::view::View;
use crate::scene::visibility::Drawing;

/// Planes let this share of their opacity through from behind.
const BEHIND: f32 = 0.3;

/// Below this opacity meshes are drawn with half of their detail.
const FAINT: f32 = 0.25;

/// How far their surfaces may be from where they belong, in pixels.
const ROUGHNESS: f32 = 0.5;

/// The surfaces that let light through, as they look by themselves.
#[derive(Debug, Default)]
pub(super) struct Veils {
    /// Distances and numbers of the instances, nearest first.
    order: Vec<(f64, u16)>,
    /// Of each: its opacity, and where its pixels end.
    ends: Vec<(f32, usize)>,
    pixels: Vec<u32>,
    colors: Vec<[f32; 3]>,
}

impl Veils {
    /// Makes room for so many pixels.
    pub(super) fn reserve(&mut self, pixels: usize) {
        self.pixels.reserve(pixels);
        self.colors.reserve(pixels);
    }

    fn clear(&mut self) {
        self.order.clear();
        self.ends.clear();
        self.pixels.clear();
        self.colors.clear();
    }

    /// Lays surface number `index` of the order over an image.
    fn lay(&self, index: usize, image: &mut [[f32; 3]]) {
        let ((opacity, end), start) =
            (self.ends[index], index.checked_sub(1).map_or(0, |last| self.ends[last].1));
        for (pixel, color) in self.pixels[start..end].iter().zip(&self.colors[start..end]) {
            for (value, part) in image[*pixel as usize].iter_mut().zip(color) {
                *value = value.min(1.0) + opacity * (part - value.min(1.0));
            }
        }
    }
}

impl Passes {
    /// Surfaces that let light through, front to back and back again, as MuJoCo blends them.
    pub(super) fn blend(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.veils.clear();
        let distance = |instance: &Instance| {
            let radius = match instance.shape {
                Shape::Plane { .. } => return f64::INFINITY,
                Shape::Mesh(mesh) => {
                    let (low, high) = assets.meshes[mesh].bounds();
                    0.5 * length(sub(wide(high), wide(low)))
                }
                shape => length(wide(shape::half_lengths(&shape, 0.0))),
            };
            length(sub(instance.position, view.origin)) - radius
        };
        let all = scene.instances.iter().zip(0..);
        let veils =
            all.filter(|(instance, _)| instance.material.color[3] > 0.0 && !is_opaque(instance, view));
        self.veils.order.extend(veils.map(|(instance, owner)| (distance(instance), owner)));
        self.veils.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let count = self.veils.order.len();
        for index in 0..count {
            self.add_veil(self.veils.order[index].1, scene, assets, view);
        }
        for index in (0..count).chain((0..count).rev()) {
            self.veils.lay(index, &mut self.colors);
        }
    }

    /// Finds the pixels of a surface, and what it looks like there.
    fn add_veil(&mut self, owner: u16, scene: &Scene, assets: &Assets, view: &View) {
        let instance = &scene.instances[usize::from(owner)];
        let behind = is_behind(instance, view);
        let sides = if behind { Sides::Both } else { Sides::Front };
        let mut drawing = Drawing::new(view, assets, sides);
        if instance.material.color[3] < FAINT {
            // What is hardly seen shows no detail.
            drawing.coarseness *= 2.0;
            drawing.roughness = ROUGHNESS;
        }
        if let Some(area) = drawing.area(instance) {
            // What hides it is already there.
            self.window.begin_window(area, &self.raster);
            drawing.draw_within(&area, instance, owner, &mut self.projected, &mut self.window);
            self.mirrored.of_window(&self.window, self.frame.width);
            let shading = Shading { view, assets, lamps: &self.lamps, maps: None };
            let fragments = &self.mirrored;
            let range = fragments.of(0);
            let Veils { pixels, colors, .. } = &mut self.veils;
            let put = |at: usize, color: Lanes3| {
                let [r, g, b] = color.to_arrays();
                let count = LANES.min(range.end - at);
                pixels.extend_from_slice(&fragments.pixel[at..at + count]);
                colors.extend((0..count).map(|lane| [r[lane], g[lane], b[lane]]));
            };
            let level = drawing.level(instance);
            shading.shade(instance, level, fragments, range.clone(), &mut self.memory, None, put);
        }
        let is_plane = matches!(instance.shape, Shape::Plane { .. });
        let opacity = instance.material.color[3] * if is_plane && behind { BEHIND } else { 1.0 };
        self.veils.ends.push((opacity, self.veils.pixels.len()));
    }
}
