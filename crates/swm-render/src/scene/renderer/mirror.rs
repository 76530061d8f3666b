//! The pass of mirrors.

use super::passes::{Passes, accumulate, draw_opaque, is_opaque};
use crate::scene::assets::Assets;
use crate::scene::description::{Scene, Shape};
use crate::scene::lanes::Lanes3;
use crate::scene::lighting::Lamp;
use crate::scene::shading::Shading;
use crate::scene::triangles::Sides;
use crate::scene::vector::{add, column, dot, scale, sub};
use crate::scene::view::View;
use crate::scene::visibility::Drawing;

/// The density of points that can be anywhere in a pixel.
const ANYWHERE: f32 = 4096.0;

impl Passes {
    /// The first mirror shows what is in front of it, without shadows: the scene seen from the mirrored eye.
    pub(super) fn reflect(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        let mirror = scene.instances.iter().position(|instance| {
            instance.material.reflectance > 0.0
                && is_opaque(instance, view)
                && matches!(instance.shape, Shape::Plane { .. } | Shape::Box { .. })
        });
        let Some(owner) = mirror else { return };
        let instance = &scene.instances[owner];
        let normal = column(instance.rotation, 2);
        let lift = if let Shape::Box { half } = instance.shape { f64::from(half[2]) } else { 0.0 };
        let point = add(instance.position, scale(normal, lift));
        if dot(sub(view.origin, point), normal) <= 0.0 {
            return;
        }
        let range = self.fragments.of(owner);
        let fragments = &self.fragments;
        let other = view.mirrored(point, normal);
        self.mirror.begin(self.frame.width, ANYWHERE);
        for at in range.clone() {
            self.mirror.reach(fragments.pixel[at] as usize);
            self.mirror.push(fragments.x[at], fragments.y[at], fragments.nearness[at]);
        }
        self.mirror.end(self.frame.height, other.farthest());
        let (projected, samples) = (&mut self.projected, &mut self.mirror);
        draw_opaque(scene, assets, &other, Sides::MirroredFront, Some(owner), projected, samples);
        let whole = |at: usize| (fragments.pixel[range.start + at], fragments.share[range.start + at]);
        self.mirrored.of_list(&self.mirror, scene.instances.len(), whole);
        self.mirrored_lamps.clear();
        self.mirrored_lamps.extend(scene.lights.iter().map(|light| Lamp::new(light, other.origin)));
        let shading = Shading { view: &other, assets, lamps: &self.mirrored_lamps, maps: None };
        let drawing = Drawing::new(&other, assets, Sides::Front);
        let (mirrored, colors) = (&self.mirrored, &mut self.colors);
        let share = instance.material.reflectance;
        for (surface, instance) in scene.instances.iter().enumerate() {
            let range = mirrored.of(surface);
            let level = drawing.level(instance);
            let put = |at: usize, color: Lanes3| accumulate(mirrored, at, range.end, color, share, colors);
            shading.shade(instance, level, mirrored, range.clone(), &mut self.memory, None, put);
        }
    }
}
