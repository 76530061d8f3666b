//! Shadow maps: what a light sees, in a window that fits what casts shadows.

use wide::i32x8;

use super::assets::Assets;
use super::description::{Light, LightKind, Scene, Shape};
use super::grid::Distances;
use super::lanes::{Lanes, Lanes3, splat};
use super::shape;
use super::triangles::{self, Projected, Sides};
use super::vector::{Vector, across, add, cross, dot, length, scale, sub, wide};
use super::view::{View, Window};
use super::visibility::Drawing;

/// Surfaces are looked up this many texels outside of themselves, so that they do not shade themselves.
const LIFT: f32 = 1.5;

/// Detail of meshes that is left out, in texels: surfaces move by half of it, less than points are lifted.
const COARSENESS: f32 = 3.0;

/// How far shadows of meshes may be from where they belong, in texels.
const ROUGHNESS: f32 = 0.5;

/// Light nearer than this to a spot is not blocked, meters.
const NEAR: f64 = 1e-3;

/// What one light sees.
#[derive(Debug, Default)]
pub(super) struct ShadowMap {
    distances: Distances,
    sight: Option<Sight>,
}

/// How points are looked up that are counted from the eye.
#[derive(Clone, Copy, Debug)]
struct Sight {
    view: View,
    /// From the light to the eye.
    offset: Lanes3,
    forward: Lanes3,
    /// Directions along which columns and rows grow, and where they begin.
    across: [Lanes3; 2],
    start: [Lanes; 2],
    /// How far points are moved out of their surface.
    lift: Lanes,
    size: [Lanes; 2],
}

impl Sight {
    fn new(view: View, eye: Vector) -> Self {
        let [by_x, by_y, _] = view.axes();
        let (_, start) = view.axes_origin();
        Self {
            view,
            offset: Lanes3::splat(sub(eye, view.origin)),
            forward: Lanes3::splat(view.forward),
            across: [by_x, by_y].map(Lanes3::splat),
            start: start.map(|start| splat(start as f32)),
            lift: splat(LIFT * view.pixel() as f32),
            size: [view.width, view.height].map(|size| splat(size as f32)),
        }
    }
}

impl ShadowMap {
    /// Draws everything that casts a shadow on what this eye sees; `size`: texels along either side.
    pub(super) fn draw(
        &mut self,
        light: &Light,
        eye: Vector,
        scene: &Scene,
        assets: &Assets,
        size: usize,
        projected: &mut Projected,
    ) {
        let view = light.shadow.and_then(|reach| fit(light, reach, scene, assets, size));
        self.sight = view.map(|view| Sight::new(view, eye));
        let Some(Sight { view, .. }) = &self.sight else { return };
        self.distances.begin([size; 2], view.nearest(), view.farthest());
        let drawing =
            Drawing { view, assets, sides: Sides::Both, coarseness: COARSENESS, roughness: ROUGHNESS };
        for (owner, instance) in (0..).zip(&scene.instances) {
            if instance.casts_shadow && !matches!(instance.shape, Shape::Plane { .. }) {
                drawing.draw(instance, owner, projected, &mut self.distances);
            }
        }
    }

    /// Which of the points (counted from the eye) are lit: 1 where they are, 0 in shadow.
    #[inline]
    pub(super) fn lit(&self, point: Lanes3, normal: Lanes3) -> Lanes {
        let bits = self.lit_bits(point, normal);
        let own = i32x8::new([1, 2, 4, 8, 16, 32, 64, 128]);
        let is_lit = (i32x8::splat(bits as i32) & own).simd_eq(own) & i32x8::splat(1.0_f32.to_bits() as i32);
        Lanes::new(is_lit.to_array().map(|bits| f32::from_bits(bits as u32)))
    }

    /// The same, as bits.
    #[inline]
    pub(super) fn lit_bits(&self, point: Lanes3, normal: Lanes3) -> u32 {
        let all = 0xff;
        let Some(Sight { view, offset, forward, across, start, lift, size }) = &self.sight else {
            return all;
        };
        let from = point + *offset;
        let lift = if view.is_perspective() { *lift * from.dot(*forward) } else { *lift };
        let from = from + normal.scaled(lift);
        let depth = from.dot(*forward);
        let w = if view.is_perspective() { splat(1.0) / depth } else { splat(1.0) };
        let [x, y] = [0, 1].map(|k| (from.dot(across[k]) + start[k]) * w);
        let inside = x.simd_ge(splat(0.0))
            & x.simd_lt(size[0])
            & y.simd_ge(splat(0.0))
            & y.simd_lt(size[1])
            & depth.simd_gt(splat(0.0));
        let mask = inside.to_bitmask();
        if mask == 0 {
            return all;
        }
        let nearness = view.nearness(depth).to_array();
        // Columns and rows that are outside may be any number.
        let texels = [x, y].map(|place| place.fast_trunc_int().to_array());
        let mut dark = 0;
        for lane in 0..8 {
            if mask >> lane & 1 == 1 {
                let texel = texels[1][lane] as usize * view.width + texels[0][lane] as usize;
                dark |= u32::from(self.distances.nearness[texel] > nearness[lane]) << lane;
            }
        }
        all & !dark
    }
}

/// The light's view of all that casts shadows, within the light's own reach; `None` if nothing does.
fn fit(light: &Light, reach: f64, scene: &Scene, assets: &Assets, size: usize) -> Option<View> {
    let up = across(light.direction);
    let right = cross(light.direction, up);
    let perspective = matches!(light.kind, LightKind::Spot { .. });
    let mut window = Window {
        left: f64::INFINITY,
        right: f64::NEG_INFINITY,
        bottom: f64::INFINITY,
        top: f64::NEG_INFINITY,
    };
    for instance in scene.instances.iter().filter(|instance| instance.casts_shadow) {
        let (center, radius) = match instance.shape {
            Shape::Plane { .. } => continue,
            Shape::Mesh(mesh) => triangles::ball(assets.meshes[mesh].bounds(), instance),
            shape => (instance.position, length(wide(shape::half_lengths(&shape, 0.0)))),
        };
        let from = sub(center, light.position);
        let depth = dot(from, light.direction);
        let (x, y) = (dot(from, right), dot(from, up));
        // A ball at depth d with radius r lies within (x ± r) / (d - r) from below and above; none behind a spot.
        let bounds = |value: f64| {
            if !perspective {
                return [value - radius, value + radius];
            }
            let nearest = (depth - radius).max(NEAR);
            let (low, high) = (value - radius, value + radius);
            let farthest = depth + radius;
            [
                low / if low < 0.0 { nearest } else { farthest },
                high / if high > 0.0 { nearest } else { farthest },
            ]
        };
        if perspective && depth + radius < NEAR {
            continue;
        }
        let ([left, far_right], [bottom, top]) = (bounds(x), bounds(y));
        window.left = window.left.min(left);
        window.right = window.right.max(far_right);
        window.bottom = window.bottom.min(bottom);
        window.top = window.top.max(top);
    }
    let clip = |value: f64| value.clamp(-reach, reach);
    let window = Window {
        left: clip(window.left),
        right: clip(window.right),
        bottom: clip(window.bottom),
        top: clip(window.top),
    };
    if !(window.left < window.right && window.bottom < window.top) {
        return None;
    }
    // A sun is moved back: what is behind its position casts shadows too.
    let origin = if perspective { light.position } else { add(light.position, scale(light.direction, -1e3)) };
    Some(View::new(origin, light.direction, up, window, perspective, NEAR, (size, size)))
}
