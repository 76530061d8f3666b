//! The passes that make a frame, in order, and the memory of a thread in which they work. What each pass does stands in its
//! own file.

use std::cell::RefCell;

use multiversion::multiversion;

use super::Frame;
use super::blend::Veils;
use crate::scene::assets::Assets;
use crate::scene::description::{Instance, Scene, Shape};
use crate::scene::fragments::Fragments;
use crate::scene::grid::Raster;
use crate::scene::ground::Ground;
use crate::scene::lanes::{LANES, Lanes3};
use crate::scene::lighting::Lamp;
use crate::scene::samples::Samples;
use crate::scene::shading::{Memory, Painter, Shading};
use crate::scene::shadow::ShadowMap;
use crate::scene::sky::Sky;
use crate::scene::target::Target;
use crate::scene::triangles::{Projected, Sides};
use crate::scene::vector::{Vector, column, dot, sub};
use crate::scene::view::View;
use crate::scene::visibility::Drawing;

thread_local! {
    /// One for all renderers of a thread: it stays in the CPU's caches, where one for each would not.
    pub(super) static PASSES: RefCell<Passes> = RefCell::default();
}

/// What a renderer keeps from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Kept {
    pub(super) sky: Sky,
    pub(super) ground: Ground,
}

/// The memory in which frames are made.
#[derive(Debug, Default)]
pub(super) struct Passes {
    pub(super) frame: Frame,
    /// The renderer whose turn it is, and the one whose scene the raster shows.
    renderer: u64,
    seen_by: Option<u64>,
    /// Pixels of the largest frame so far.
    room: usize,
    pub(super) raster: Raster,
    /// Whether the raster has what one sees through.
    pub(super) knows_veils: bool,
    edges: Vec<u32>,
    /// Of the pixels of one row: 1 where it is an edge.
    flags: Vec<u8>,
    fine: Samples,
    pub(super) fragments: Fragments,
    pub(super) mirror: Samples,
    pub(super) window: Raster,
    pub(super) mirrored: Fragments,
    maps: Vec<ShadowMap>,
    pub(super) lamps: Vec<Lamp>,
    pub(super) mirrored_lamps: Vec<Lamp>,
    pub(super) projected: Projected,
    pub(super) memory: Memory,
    pub(super) veils: Veils,
    pub(super) colors: Vec<[f32; 3]>,
}

/// From this opacity on a surface hides what is behind it.
const OPAQUE: f32 = 0.995;

impl Passes {
    /// Makes ready for a frame of the renderer `id`.
    pub(super) fn begin(&mut self, frame: Frame, id: u64) {
        let pixels = frame.height * frame.width;
        if pixels > self.room {
            *self = Self::default();
            self.frame = frame;
            self.reserve(pixels);
        }
        (self.frame, self.renderer) = (frame, id);
    }

    /// Makes room for frames of so many pixels of which a quarter are edges, so that no later frame needs more than the
    /// first.
    fn reserve(&mut self, pixels: usize) {
        let (points, entries) = (pixels + LANES, pixels + self.frame.height);
        self.room = pixels;
        self.edges.reserve(pixels / 4);
        self.fine.reserve(points, entries);
        self.mirror.reserve(2 * points, entries);
        self.window.reserve(pixels);
        self.fragments.reserve(2 * points);
        self.mirrored.reserve(2 * points);
        self.veils.reserve(points);
    }

    /// See [`SceneRenderer::render`](super::SceneRenderer::render); what is named exists.
    pub(super) fn render(&mut self, kept: &mut Kept, scene: &Scene, assets: &Assets, frame: &mut [u8]) {
        let view = View::of_camera(&scene.camera, self.frame.width, self.frame.height);
        self.see(scene, assets, &view);
        self.find_edges(scene, assets, &view);
        let surfaces = scene.instances.len();
        self.fragments.of_raster(&self.raster, &self.edges, &self.fine, surfaces);
        self.cast_shadows(scene, assets, &view);
        self.lamps.clear();
        self.lamps.extend(scene.lights.iter().map(|light| Lamp::new(light, view.origin)));
        self.shade(kept, scene, assets, &view);
        if self.frame.quality.reflections {
            self.reflect(scene, assets, &view);
        }
        self.blend(scene, assets, &view);
        to_bytes(self.colors.as_flattened(), frame);
    }

    /// Whether the raster shows the last scene of the renderer whose turn it is.
    pub(super) fn has_seen(&self) -> bool {
        self.seen_by == Some(self.renderer)
    }

    /// What is nearest at the middle of every pixel.
    pub(super) fn see(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.knows_veils = false;
        self.seen_by = Some(self.renderer);
        self.raster.begin([self.frame.width, self.frame.height], view.nearest(), view.farthest());
        draw_opaque(scene, assets, view, Sides::Front, None, &mut self.projected, &mut self.raster);
    }

    /// Pixels whose neighbors show something else are looked at in four points.
    fn find_edges(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.edges.clear();
        if !self.frame.quality.antialias {
            return;
        }
        let (width, height, owner) = (self.frame.width, self.frame.height, &self.raster.known.owner);
        self.fine.begin(width, 2.0);
        self.flags.resize(width, 0);
        let nearest = view.nearest();
        for y in 0..height {
            let row = &owner[y * width..][..width];
            let above = &owner[y.saturating_sub(1) * width..][..width];
            let below = &owner[(y + 1).min(height - 1) * width..][..width];
            flag_edges(row, above, below, &mut self.flags);
            self.fine.push_row(&self.flags, y, &mut self.edges);
        }
        self.fine.end_with(height, view.farthest(), nearest);
        draw_opaque(scene, assets, view, Sides::Front, None, &mut self.projected, &mut self.fine);
    }

    fn cast_shadows(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.maps.resize_with(scene.lights.len(), ShadowMap::default);
        if !self.frame.quality.shadows {
            return;
        }
        // Shadows are as sharp as the image: a few texels per pixel.
        let size = (self.frame.width.max(self.frame.height) * 5 / 4).clamp(96, 1024);
        for (map, light) in self.maps.iter_mut().zip(&scene.lights) {
            map.draw(light, view.origin, scene, assets, size, &mut self.projected);
        }
    }

    fn shade(&mut self, kept: &mut Kept, scene: &Scene, assets: &Assets, view: &View) {
        self.colors.clear();
        self.colors.resize(self.frame.width * self.frame.height, [0.0; 3]);
        kept.ground.begin(view, scene, assets, self.frame.quality.shadows);
        let maps = self.frame.quality.shadows.then_some(self.maps.as_slice());
        let shading = Shading { view, assets, lamps: &self.lamps, maps };
        let drawing = Drawing::new(view, assets, Sides::Front);
        let (fragments, colors) = (&self.fragments, self.colors.as_mut_slice());
        for (surface, instance) in scene.instances.iter().enumerate() {
            let range = fragments.of(surface);
            if range.is_empty() {
                continue;
            }
            let level = drawing.level(instance);
            let image = Image { fragments, end: range.end, colors };
            let ground = kept.ground.of(surface);
            shading.shade(instance, level, fragments, range, &mut self.memory, ground, image);
        }
        let sky = kept.sky.colors(scene, assets, view);
        let background = fragments.of(scene.instances.len());
        let mut at = background.start;
        while at < background.end {
            if at + LANES <= background.end
                && let Some(first) = fragments.whole_pixels(at)
            {
                let pixels = first..first + LANES;
                let (colors, sky) = (&mut colors[pixels.clone()], &sky[pixels]);
                for (value, part) in colors.as_flattened_mut().iter_mut().zip(sky.as_flattened()) {
                    *value += part;
                }
                at += LANES;
                continue;
            }
            let (pixel, share) = (fragments.pixel[at] as usize, fragments.share[at]);
            for (value, part) in colors[pixel].iter_mut().zip(sky[pixel]) {
                *value += share * part;
            }
            at += 1;
        }
    }
}

/// The image that is made: black where nothing is painted yet.
struct Image<'a> {
    fragments: &'a Fragments,
    /// Where the fragments of the surface end.
    end: usize,
    colors: &'a mut [[f32; 3]],
}

impl Painter for Image<'_> {
    #[inline]
    fn put(&mut self, at: usize, color: Lanes3) {
        if at + LANES <= self.end
            && let Some(first) = self.fragments.whole_pixels(at)
        {
            // Nothing is there yet: adding to it makes -0 a 0, as for others.
            let [r, g, b] = color.to_arrays();
            let colors: &mut [_] = &mut self.colors[first..first + LANES];
            for (lane, color) in colors.iter_mut().enumerate() {
                *color = [0.0 + r[lane], 0.0 + g[lane], 0.0 + b[lane]];
            }
            return;
        }
        accumulate(self.fragments, at, self.end, color, 1.0, self.colors);
    }

    #[inline]
    fn put_pixels(&mut self, pixel: usize, colors: &[[f32; 3]; LANES]) {
        self.colors[pixel..pixel + LANES].copy_from_slice(colors);
    }
}

/// Adds colors of up to eight fragments to their pixels.
pub(super) fn accumulate(
    fragments: &Fragments,
    at: usize,
    end: usize,
    color: Lanes3,
    share: f32,
    colors: &mut [[f32; 3]],
) {
    let [r, g, b] = color.to_arrays();
    for lane in 0..LANES.min(end - at) {
        let pixel = &mut colors[fragments.pixel[at + lane] as usize];
        let share = share * fragments.share[at + lane];
        pixel[0] += share * r[lane];
        pixel[1] += share * g[lane];
        pixel[2] += share * b[lane];
    }
}

/// Marks pixels of a row whose neighbors show something else.
#[multiversion(targets("x86_64+avx2"))]
fn flag_edges(row: &[u16], above: &[u16], below: &[u16], flags: &mut [u8]) {
    for (((flag, own), above), below) in flags.iter_mut().zip(row).zip(above).zip(below) {
        *flag = u8::from(own != above) | u8::from(own != below);
    }
    for ((flags, own), next) in flags.iter_mut().zip(row).zip(&row[1..]) {
        *flags |= u8::from(own != next);
    }
    for ((flags, own), last) in flags[1..].iter_mut().zip(&row[1..]).zip(row) {
        *flags |= u8::from(own != last);
    }
}

/// Colors from 0 to 1 as bytes.
#[multiversion(targets("x86_64+avx2"))]
fn to_bytes(colors: &[f32], bytes: &mut [u8]) {
    for (byte, value) in bytes.iter_mut().zip(colors) {
        *byte = to_byte(*value);
    }
}

/// A color from 0 to 1 as a byte. Above 2^23 values have no fraction: adding it rounds, and the byte is in the lowest
/// bits.
#[inline(always)]
fn to_byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 8_388_608.0).to_bits() as u8
}

pub(super) fn draw_opaque<T: Target>(
    scene: &Scene,
    assets: &Assets,
    view: &View,
    sides: Sides,
    except: Option<usize>,
    projected: &mut Projected,
    target: &mut T,
) {
    let drawing = Drawing::new(view, assets, sides);
    for (owner, instance) in scene.instances.iter().enumerate() {
        if Some(owner) != except && is_opaque(instance, view) {
            drawing.draw(instance, owner as u16, projected, target);
        }
    }
}

pub(super) fn is_opaque(instance: &Instance, view: &View) -> bool {
    let seen_from_behind = matches!(instance.shape, Shape::Plane { .. }) && is_behind(instance, view);
    instance.material.color[3] >= OPAQUE && !seen_from_behind
}

/// Whether the eye is below the instance's xy plane.
pub(super) fn is_behind(instance: &Instance, view: &View) -> bool {
    let eye: Vector = sub(view.origin, instance.position);
    dot(eye, column(instance.rotation, 2)) < 0.0
}
