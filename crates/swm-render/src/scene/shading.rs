//! The colors of fragments of one surface, eight at a time.

use wide::f32x4;

use super::assets::Assets;
use super::description::{Instance, Mapping, Shape};
use super::fragments::Fragments;
use super::ground::Ground;
use super::lanes::{LANES, Lanes, Lanes3, both, load, splat};
use super::lighting::{Lamp, Surface, base, limited};
use super::mesh::{Facet, Level};
use super::plane::{Corners, on_plane};
use super::shadow::ShadowMap;
use super::shape;
use super::vector::{Matrix, column, sub};
use super::view::{Rays, View};

/// What all surfaces of an image share.
#[derive(Clone, Copy)]
pub(super) struct Shading<'a> {
    pub(super) view: &'a View,
    pub(super) assets: &'a Assets,
    pub(super) lamps: &'a [Lamp],
    /// One per lamp; `None`: nothing is in shadow.
    pub(super) maps: Option<&'a [ShadowMap]>,
}

/// Memory that the shader reuses.
#[derive(Debug, Default)]
pub(super) struct Memory {
    corners: Corners,
    /// Light of all lamps without shadows, then of each with, at eight points.
    layers: Vec<Lanes3>,
}

/// Where colors go.
pub(super) trait Painter {
    /// Of up to eight fragments from number `at` on.
    fn put(&mut self, at: usize, color: Lanes3);

    /// Of eight whole pixels side by side, the first of which is `pixel`. Only a [`Ground`] knows colors of pixels.
    fn put_pixels(&mut self, pixel: usize, colors: &[[f32; 3]; LANES]);
}

/// Without a ground.
impl<F: FnMut(usize, Lanes3)> Painter for F {
    #[inline]
    fn put(&mut self, at: usize, color: Lanes3) {
        self(at, color);
    }

    fn put_pixels(&mut self, _pixel: usize, _colors: &[[f32; 3]; LANES]) {}
}

/// One surface, as the shader needs it.
struct Target<'a> {
    surface: Surface,
    rays: Rays,
    rotation: [[f32; 3]; 3],
    /// From the eye to its center.
    center: Lanes3,
    level: Option<&'a Level>,
}

impl Shading<'_> {
    /// Shades the fragments `range` of `instance`, whose colors `ground` may know.
    #[expect(clippy::too_many_arguments, reason = "the inner loop's inputs")]
    pub(super) fn shade(
        &self,
        instance: &Instance,
        level: usize,
        fragments: &Fragments,
        range: std::ops::Range<usize>,
        memory: &mut Memory,
        mut ground: Option<&mut Ground>,
        mut painter: impl Painter,
    ) {
        if range.is_empty() {
            return;
        }
        let Memory { corners, layers } = memory;
        let target = Target {
            surface: Surface::of(&instance.material),
            rays: self.view.rays(instance),
            rotation: narrowed(instance.rotation),
            center: Lanes3::splat(sub(instance.position, self.view.origin)),
            level: match instance.shape {
                Shape::Mesh(mesh) => Some(self.assets.meshes[mesh].at(level)),
                _ => None,
            },
        };
        let count = 1 + self.shadowing().count();
        layers.clear();
        layers.resize(count, Lanes3::splat([0.0; 3]));
        let faceted = self.faceted(instance);
        if let Some((half, cell)) = faceted {
            corners.begin(half, cell, count);
        }
        let is_plane = matches!(instance.shape, Shape::Plane { .. });
        let up = Lanes3 { x: splat(0.0), y: splat(0.0), z: splat(1.0) };
        let plane_normal = up.rotated(&target.rotation);
        let mut at = range.start;
        while at < range.end {
            let lanes = |column: &[f32]| load(&column[at..], 1.0);
            let (x, y) = (lanes(&fragments.x), lanes(&fragments.y));
            let depth = self.view.depth(lanes(&fragments.nearness));
            let (place, direction) = target.rays.at(x, y);
            let local = place + direction.scaled(depth - splat(target.rays.depth));
            let point = local.rotated(&target.rotation) + target.center;
            let known = ground.as_ref().and_then(|ground| Some((ground.known(fragments, at)?, ground)));
            if let Some((pixel, ground)) = known
                && at + LANES <= range.end
            {
                let lit = self.shadowing().next().map_or(0xff, |map| map.lit_bits(point, plane_normal));
                painter.put_pixels(pixel, &ground.colors(pixel, lit));
                at += LANES;
                continue;
            }
            let outward = match target.level {
                Some(level) => mesh_outward(level, &fragments.facet[at..], local),
                None => shape::outward(&instance.shape, local),
            };
            let normal = if is_plane { plane_normal } else { outward.rotated(&target.rotation) };
            let count = LANES.min(range.end - at);
            if faceted.is_some() {
                let lit = |x, y, out: &mut [Lanes3]| self.light(&target, on_plane(x, y), outward, out);
                corners.colors(local.x.to_array(), local.y.to_array(), layers, lit);
            } else {
                self.light(&target, local, outward, layers);
            }
            let paint = instance.material.texture.as_ref().map(|mapping| {
                let steps = target.rays.gradients((x, y), depth, outward);
                self.painted(mapping, local, steps, count)
            });
            let painted = |color: Lanes3| limited(paint.map_or(color, |paint| color * paint));
            if let Some(ground) = &mut ground {
                let all = layers[1..].iter().fold(layers[0], |sum, layer| sum + *layer);
                let colors = [all, layers[0]].map(painted);
                ground.keep(fragments, at, count, colors);
                let lit = self.shadowing().next().map_or(splat(1.0), |map| map.lit(point, normal));
                painter.put(at, chosen(lit, colors));
                at += count;
                continue;
            }
            let mut color = layers[0];
            for (map, layer) in self.shadowing().zip(&layers[1..]) {
                color = color + layer.scaled(map.lit(point, normal));
            }
            painter.put(at, painted(color));
            at += count;
        }
    }

    /// The maps of the lamps that cast shadows.
    fn shadowing(&self) -> impl Iterator<Item = &ShadowMap> {
        let maps = self.maps.unwrap_or_default();
        self.lamps.iter().zip(maps).filter(|(lamp, _)| lamp.casts_shadows()).map(|(_, map)| map)
    }

    /// Half lengths and cells of a plane whose cells are large enough to be seen.
    fn faceted(&self, instance: &Instance) -> Option<([f32; 2], [f32; 2])> {
        let Shape::Plane { half, cell } = instance.shape else { return None };
        let pixel = self.view.pixel_on(instance.position, column(instance.rotation, 2));
        Corners::matter(cell, pixel as f32).then_some((half, cell))
    }

    /// Light of all layers at points of the instance's frame.
    fn light(&self, target: &Target<'_>, local: Lanes3, outward: Lanes3, out: &mut [Lanes3]) {
        let point = local.rotated(&target.rotation) + target.center;
        let normal = outward.rotated(&target.rotation);
        let to_eye = (-point).normalized();
        let shadows = self.maps.is_some();
        out[0] = base(self.lamps, shadows, &target.surface, point, normal, to_eye);
        if shadows {
            let lamps = self.lamps.iter().filter(|lamp| lamp.casts_shadows());
            for (lamp, layer) in lamps.zip(&mut out[1..]) {
                *layer = limited(lamp.light(&target.surface, point, normal, to_eye));
            }
        }
    }

    /// The colors of the texture, 0 to 1, for the first `count` lanes.
    fn painted(&self, mapping: &Mapping, local: Lanes3, [dx, dy]: [Lanes3; 2], count: usize) -> Lanes3 {
        let mut parts = [[0.0; LANES]; 3];
        let mut set = |lane: usize, color: [f32; 3]| {
            for (part, value) in parts.iter_mut().zip(color) {
                part[lane] = value * (1.0 / 255.0);
            }
        };
        match *mapping {
            Mapping::Flat { texture, scale, offset } => {
                let texture = &self.assets.textures[texture];
                let size = texture.size();
                let coordinate = |value: Lanes, k: usize| value * splat(scale[k]) + splat(offset[k]);
                let (u, v) = (coordinate(local.x, 0), coordinate(local.y, 1));
                let [by_u, by_v] = [scale[0] * size[0], scale[1] * size[1]].map(f32::abs).map(splat);
                let steps = (dx.x.abs().max(dy.x.abs()) * by_u).max(dx.y.abs().max(dy.y.abs()) * by_v);
                return texture.tiled(u, v, steps, count).scaled(splat(1.0 / 255.0));
            }
            Mapping::Cube { texture, scale } => {
                let texture = &self.assets.cubes[texture];
                let stretch = Lanes3::splat(scale.map(f64::from));
                let scaled = |v: Lanes3| (v * stretch).to_arrays();
                let (at, dx, dy) = (scaled(local), scaled(dx), scaled(dy));
                for lane in 0..count {
                    let pick = |v: &[[f32; LANES]; 3]| [v[0][lane], v[1][lane], v[2][lane]];
                    set(lane, texture.at(pick(&at), [pick(&dx), pick(&dy)]));
                }
            }
        }
        let [x, y, z] = parts.map(|part| load(&part, 0.0));
        Lanes3 { x, y, z }
    }
}

/// Outward directions at points of a mesh: of the corners, mixed by the sizes of the opposite parts.
#[inline]
fn mesh_outward(level: &Level, facets: &[u32], local: Lanes3) -> Lanes3 {
    // Lanes beyond the last fragment hold the facets of another mesh.
    let last = level.facets.len() - 1;
    let facet = |lane: usize| &level.facets[(facets[lane] as usize).min(last)];
    let rows: [&Facet; LANES] = std::array::from_fn(facet);
    // Four times four values of a facet each make a square, whose columns are one value of four facets.
    let mut columns = [splat(0.0); 20];
    for (part, columns) in columns.chunks_exact_mut(4).enumerate() {
        let half = |first: usize| {
            f32x4::transpose([0, 1, 2, 3].map(|lane| f32x4::new(rows[first + lane][part])))
                .map(f32x4::to_array)
        };
        let (low, high) = (half(0), half(4));
        for (column, (low, high)) in columns.iter_mut().zip(low.into_iter().zip(high)) {
            *column = both(low, high);
        }
    }
    let vector = |first: usize| Lanes3 { x: columns[first], y: columns[first + 1], z: columns[first + 2] };
    let (u, v, w) = (vector(3), vector(6), local - vector(0));
    let (uu, uv, vv, wu, wv) = (u.dot(u), u.dot(v), v.dot(v), w.dot(u), w.dot(v));
    let whole = (uu * vv - uv * uv).max(splat(f32::MIN_POSITIVE));
    let limit = |share: Lanes| (share / whole).max(splat(0.0)).min(splat(1.0));
    let (b, c) = (limit(vv * wu - uv * wv), limit(uu * wv - uv * wu));
    let sum = (b + c).max(splat(1.0));
    (vector(9) + vector(12).scaled(b / sum) + vector(15).scaled(c / sum)).normalized()
}

/// The first color where there is light, the second where there is none.
#[inline]
fn chosen(lit: Lanes, [light, dark]: [Lanes3; 2]) -> Lanes3 {
    let is_lit = lit.simd_gt(splat(0.0));
    let choose = |light: Lanes, dark: Lanes| is_lit.select(light, dark);
    Lanes3 { x: choose(light.x, dark.x), y: choose(light.y, dark.y), z: choose(light.z, dark.z) }
}

fn narrowed(m: Matrix) -> [[f32; 3]; 3] {
    m.map(|row| row.map(|value| value as f32))
}
