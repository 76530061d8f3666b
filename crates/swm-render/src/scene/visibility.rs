//! What is seen where: draws instances into samples, nearest first wins.

use super::assets::Assets;
use super::description::{Instance, Shape};
use super::lanes::{LANES, Lanes, Lanes3, splat};
use super::shape;
use super::target::{Target, first};
use super::triangles::{self, Projected, Sides};
use super::vector::{dot, sub, wide};
use super::view::{Area, View};

/// Farther than any surface that matters, meters: how far endless planes reach.
const FAR: f32 = 1e4;

/// What drawing needs besides the samples.
pub(super) struct Drawing<'a> {
    pub(super) view: &'a View,
    pub(super) assets: &'a Assets,
    pub(super) sides: Sides,
    /// Detail of meshes that may be missing, in pixels.
    pub(super) coarseness: f32,
    /// How far surfaces of meshes may be from where they belong, in pixels, where that alone counts: 0 for those whose shading
    /// is seen.
    pub(super) roughness: f32,
}

/// Detail of meshes that is left out, in pixels.
const COARSENESS: f32 = 1.25;

impl<'a> Drawing<'a> {
    /// Of surfaces whose shading is seen.
    pub(super) fn new(view: &'a View, assets: &'a Assets, sides: Sides) -> Self {
        Self { view, assets, sides, coarseness: COARSENESS, roughness: 0.0 }
    }

    /// Draws `instance`, which is number `owner`.
    pub(super) fn draw<T: Target>(
        &self,
        instance: &Instance,
        owner: u16,
        projected: &mut Projected,
        target: &mut T,
    ) {
        if let Some(area) = self.area(instance) {
            self.draw_within(&area, instance, owner, projected, target);
        }
    }

    /// The same of an instance whose [`area`](Drawing::area) is known.
    pub(super) fn draw_within<T: Target>(
        &self,
        area: &Area,
        instance: &Instance,
        owner: u16,
        projected: &mut Projected,
        target: &mut T,
    ) {
        let Shape::Mesh(mesh) = instance.shape else {
            self.solid(instance, owner, area, target);
            return;
        };
        let mesh = &self.assets.meshes[mesh];
        let (center, radius) = triangles::ball(mesh.bounds(), instance);
        let level = mesh.at(self.level(instance));
        let depth = dot(sub(center, self.view.origin), self.view.forward);
        let in_front = !self.view.is_perspective() || depth - radius > self.view.near();
        let hides_back = self.sides == Sides::Both && in_front && level.is_closed;
        let sides = if hides_back { Sides::Front } else { self.sides };
        triangles::draw(self.view, instance, owner, level, sides, in_front, projected, target);
    }

    /// Which version of its mesh an instance is drawn with: by the size of a pixel where it is nearest.
    pub(super) fn level(&self, instance: &Instance) -> usize {
        let Shape::Mesh(mesh) = instance.shape else { return 0 };
        let mesh = &self.assets.meshes[mesh];
        let (center, radius) = triangles::ball(mesh.bounds(), instance);
        let pixel = self.view.pixel_at(center, radius) as f32;
        let level = mesh.level(self.coarseness * pixel);
        if self.roughness > 0.0 { level.max(mesh.rough_level(self.roughness * pixel)) } else { level }
    }

    /// The pixels that an instance may cover.
    pub(super) fn area(&self, instance: &Instance) -> Option<Area> {
        if let Shape::Mesh(mesh) = instance.shape {
            // A version of less detail reaches out by less than the pixel that an area has to spare.
            let bounds = self.assets.meshes[mesh].bounds();
            let (center, _) = triangles::ball(bounds, instance);
            let half = sub(wide(bounds.1), wide(bounds.0)).map(|side| 0.5 * side);
            return self.view.area(center, instance.rotation, half);
        }
        let half = wide(shape::half_lengths(&instance.shape, FAR));
        self.view.area(instance.position, instance.rotation, half)
    }

    fn solid<T: Target>(&self, instance: &Instance, owner: u16, area: &Area, target: &mut T) {
        match instance.shape {
            Shape::Plane { half, .. } => {
                self.trace(instance, owner, area, target, |place, way| shape::plane(half, place, way));
            }
            Shape::Ellipsoid { radii } => {
                let [x, y, z] = radii.map(|radius| splat(1.0 / radius));
                let inverse = Lanes3 { x, y, z };
                self.trace(instance, owner, area, target, |place, way| {
                    shape::ball(place * inverse, way * inverse)
                });
            }
            Shape::Capsule { radius, half } => {
                self.trace(instance, owner, area, target, |place, way| {
                    shape::capsule(radius, half, place, way)
                });
            }
            Shape::Cylinder { radius, half } => {
                self.trace(instance, owner, area, target, |place, way| {
                    shape::cylinder(radius, half, place, way)
                });
            }
            Shape::Box { half } => {
                self.trace(instance, owner, area, target, |place, way| shape::slabs(half, place, way));
            }
            Shape::Mesh(_) => {}
        }
    }

    /// Draws where the rays of an area enter a solid: at `enter(place, direction)`.
    #[inline]
    fn trace<T: Target>(
        &self,
        instance: &Instance,
        owner: u16,
        area: &Area,
        target: &mut T,
        enter: impl Fn(Lanes3, Lanes3) -> Lanes,
    ) {
        let rays = self.view.rays(instance);
        let depth = splat(rays.depth);
        for row in area.y0..area.y1 {
            let range = target.within(row, area.x0, area.x1);
            let mut at = range.start;
            while at < range.end {
                let (x, y) = target.points(row, at);
                let (place, direction) = rays.at(x, y);
                let nearness = self.view.nearness(depth + enter(place, direction));
                target.offer(at, first(range.end - at), nearness, owner, None);
                at += LANES;
            }
        }
    }
}
