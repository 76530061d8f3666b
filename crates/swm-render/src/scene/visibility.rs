//! What is seen where: draws instances into samples, nearest first wins.

use super::assets::Assets;
use super::description::{Instance, Shape};
use super::lanes::{LANES, load, splat};
use super::samples::Samples;
use super::shape;
use super::triangles::{self, Projected, Sides};
use super::vector::wide;
use super::view::{Area, View, corners};

/// Farther than any surface that matters, metres: how far endless planes reach.
const FAR: f32 = 1e4;

/// What drawing needs besides the samples.
pub(super) struct Drawing<'a> {
    pub(super) view: &'a View,
    pub(super) assets: &'a Assets,
    pub(super) sides: Sides,
    /// Detail of meshes that may be missing, in pixels.
    pub(super) coarseness: f32,
}

impl Drawing<'_> {
    /// Draws `instance`, which is number `owner`.
    pub(super) fn draw(
        &self,
        instance: &Instance,
        owner: u16,
        projected: &mut Projected,
        samples: &mut Samples,
    ) {
        match instance.shape {
            Shape::Mesh(mesh) => {
                let mesh = &self.assets.meshes[mesh];
                if self.area_of_mesh(instance, mesh.bounds()).is_some() {
                    let level = mesh.at(self.level(instance));
                    triangles::draw(self.view, instance, owner, level, self.sides, projected, samples);
                }
            }
            _ => {
                if let Some(area) = self.area(instance) {
                    self.solid(instance, owner, &area, samples);
                }
            }
        }
    }

    /// Which version of its mesh an instance is drawn with: by the size of a pixel where it is nearest.
    pub(super) fn level(&self, instance: &Instance) -> usize {
        let Shape::Mesh(mesh) = instance.shape else { return 0 };
        let mesh = &self.assets.meshes[mesh];
        let (centre, radius) = triangles::ball(mesh.bounds(), instance);
        mesh.level(self.coarseness * self.view.pixel_at(centre, radius) as f32)
    }

    fn area_of_mesh(&self, instance: &Instance, (low, high): ([f32; 3], [f32; 3])) -> Option<Area> {
        let (centre, radius) = triangles::ball((low, high), instance);
        self.view.area(corners(centre, instance.rotation, [radius; 3]))
    }

    /// The pixels that an instance may cover.
    fn area(&self, instance: &Instance) -> Option<Area> {
        let half = wide(shape::half_lengths(&instance.shape, FAR));
        self.view.area(corners(instance.position, instance.rotation, half))
    }

    fn solid(&self, instance: &Instance, owner: u16, area: &Area, samples: &mut Samples) {
        let rays = self.view.rays(instance);
        let depth = splat(rays.depth);
        for row in area.y0..area.y1 {
            let range = samples.within(row, area);
            let mut at = range.start;
            while at < range.end {
                let (x, y) = (load(&samples.x[at..], 0.0), load(&samples.y[at..], 0.0));
                let (place, direction) = rays.at(x, y);
                let t = shape::enter(&instance.shape, place, direction);
                let nearness = self.view.nearness(depth + t);
                let seen = nearness.simd_gt(load(&samples.nearness[at..], 0.0))
                    & nearness.simd_lt(load(&samples.limit[at..], 0.0));
                let mask = seen.to_bitmask();
                if mask != 0 {
                    triangles::put(samples, at, mask, nearness.to_array(), owner, 0);
                }
                at += LANES;
            }
        }
    }
}
