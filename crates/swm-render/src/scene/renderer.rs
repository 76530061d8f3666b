//! The passes that make a frame, in order. What each pass does stands in its own file.

mod blend;
mod layers;
mod mirror;

use super::assets::Assets;
use super::description::{Instance, Mapping, Scene, Shape};
use super::fragments::Fragments;
use super::grid::Raster;
use super::ground::Ground;
use super::lanes::{LANES, Lanes3};
use super::lighting::Lamp;
use super::samples::Samples;
use super::shading::{Memory, Shading};
use super::shadow::ShadowMap;
use super::sky::Sky;
use super::target::{NOTHING, Target};
use super::triangles::{Projected, Sides};
use super::vector::{Vector, column, dot, sub};
use super::view::View;
use super::visibility::Drawing;
use crate::error::{RenderError, check_len, check_size};
use crate::geometry::Geometry;
use blend::Veils;

/// What an image is worth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quality {
    /// Whether edges are drawn from four points per pixel.
    pub antialias: bool,
    /// Whether lights cast shadows.
    pub shadows: bool,
    /// Whether the first mirror mirrors.
    pub reflections: bool,
}

impl Default for Quality {
    fn default() -> Self {
        Self { antialias: true, shadows: true, reflections: true }
    }
}

/// Makes frames of one size. Holds memory, not state: a frame depends on its scene alone.
/// ```
/// use swm_render::Geometry;
/// use swm_render::scene::{Assets, Instance, Light, LightKind, Material, Quality, Scene, SceneRenderer, Shape};
///
/// // A ball of half a meter, three meters in front of the eye, which looks along y.
/// let ball = Instance {
///     shape: Shape::Ellipsoid { radii: [0.5; 3] },
///     position: [0.0, 3.0, 0.0],
///     rotation: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
///     material: Material { color: [0.8, 0.2, 0.1, 1.0], ..Material::default() },
///     segment: 7,
///     casts_shadow: true,
/// };
/// let sun = Light {
///     kind: LightKind::Sun,
///     direction: [0.0, 0.6, -0.8],
///     position: [0.0, 3.0, 5.0],
///     ambient: [0.2; 3],
///     diffuse: [0.8; 3],
///     specular: [0.3; 3],
///     shadow: None,
/// };
/// let scene = Scene { instances: vec![ball], lights: vec![sun], ..Scene::default() };
/// let mut renderer = SceneRenderer::new(Geometry::new(32, 32), Quality::default())?;
/// let (mut frame, mut depth, mut segments) = ([0; 32 * 32 * 3], [0.0; 32 * 32], [0; 32 * 32]);
/// renderer.render(&scene, &Assets::default(), &mut frame)?; // [32, 32, 3]
/// renderer.depth_of_last(&scene, &Assets::default(), &mut depth)?; // meters
/// renderer.segmentation_of_last(&scene, &Assets::default(), &mut segments)?;
/// let middle = 16 * 32 + 16;
/// assert!(segments[middle] == 7 && (depth[middle] - 2.5).abs() < 0.01);
/// assert!(frame[3 * middle] > frame[3 * middle + 2]); // red rather than blue
/// # Ok::<(), swm_render::RenderError>(())
/// ```
#[derive(Debug)]
pub struct SceneRenderer {
    height: usize,
    width: usize,
    quality: Quality,
    raster: Raster,
    /// Whether the raster has what one sees through.
    knows_veils: bool,
    edges: Vec<u32>,
    /// Of the pixels of one row: 1 where it is an edge.
    flags: Vec<u8>,
    fine: Samples,
    fragments: Fragments,
    mirror: Samples,
    window: Raster,
    mirrored: Fragments,
    maps: Vec<ShadowMap>,
    lamps: Vec<Lamp>,
    mirrored_lamps: Vec<Lamp>,
    projected: Projected,
    memory: Memory,
    sky: Sky,
    ground: Ground,
    veils: Veils,
    colors: Vec<[f32; 3]>,
}

/// From this opacity on a surface hides what is behind it.
const OPAQUE: f32 = 0.995;

impl SceneRenderer {
    /// A renderer of frames of `geometry`.
    ///
    /// # Errors
    ///
    /// A side is 0 or above 4096.
    pub fn new(geometry: Geometry, quality: Quality) -> Result<Self, RenderError> {
        let Geometry { height, width, .. } = geometry;
        check_size("a frame", height, width)?;
        let mut renderer = Self {
            height,
            width,
            quality,
            raster: Raster::default(),
            knows_veils: false,
            edges: Vec::new(),
            flags: Vec::new(),
            fine: Samples::default(),
            fragments: Fragments::default(),
            mirror: Samples::default(),
            window: Raster::default(),
            mirrored: Fragments::default(),
            maps: Vec::new(),
            lamps: Vec::new(),
            mirrored_lamps: Vec::new(),
            projected: Projected::default(),
            memory: Memory::default(),
            sky: Sky::default(),
            ground: Ground::default(),
            veils: Veils::default(),
            colors: Vec::new(),
        };
        renderer.reserve(height * width);
        Ok(renderer)
    }

    /// Makes room for frames of so many pixels of which a quarter are edges, so that no later frame needs more than the
    /// first.
    fn reserve(&mut self, pixels: usize) {
        let points = pixels + LANES;
        self.edges.reserve(pixels / 4);
        self.fine.reserve(points, pixels + self.height);
        self.mirror.reserve(2 * points, pixels + self.height);
        self.window.reserve(pixels);
        self.fragments.reserve(2 * points);
        self.mirrored.reserve(2 * points);
        self.veils.reserve(points);
        self.ground.reserve(pixels);
    }

    /// Writes the image of `scene` to `frame`, `[H, W, 3]`.
    ///
    /// # Errors
    ///
    /// `frame` has another length, or the scene names assets that do not exist.
    pub fn render(&mut self, scene: &Scene, assets: &Assets, frame: &mut [u8]) -> Result<(), RenderError> {
        check_len("frame", frame.len(), self.height, self.width)?;
        check(scene, assets)?;
        let view = View::of_camera(&scene.camera, self.width, self.height);
        self.see(scene, assets, &view);
        self.find_edges(scene, assets, &view);
        let surfaces = scene.instances.len();
        self.fragments.of_raster(&self.raster, &self.edges, &self.fine, surfaces);
        self.cast_shadows(scene, assets, &view);
        self.lamps.clear();
        self.lamps.extend(scene.lights.iter().map(|light| Lamp::new(light, view.origin)));
        self.shade(scene, assets, &view);
        if self.quality.reflections {
            self.reflect(scene, assets, &view);
        }
        self.blend(scene, assets, &view);
        for (byte, value) in frame.iter_mut().zip(self.colors.as_flattened()) {
            *byte = to_byte(*value);
        }
        Ok(())
    }

    /// What is nearest at the middle of every pixel.
    fn see(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.knows_veils = false;
        self.raster.begin([self.width, self.height], view.nearest(), view.farthest());
        draw_opaque(scene, assets, view, Sides::Front, None, &mut self.projected, &mut self.raster);
    }

    /// Pixels whose neighbors show something else are looked at in four points.
    fn find_edges(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.edges.clear();
        if !self.quality.antialias {
            return;
        }
        let (width, height, owner) = (self.width, self.height, &self.raster.known.owner);
        self.fine.begin(width, 2.0);
        self.flags.resize(width, 0);
        let nearest = view.nearest();
        for y in 0..height {
            let row = &owner[y * width..][..width];
            let above = &owner[y.saturating_sub(1) * width..][..width];
            let below = &owner[(y + 1).min(height - 1) * width..][..width];
            flag_edges(row, above, below, &mut self.flags);
            for (chunk, flags) in self.flags.chunks(8).enumerate() {
                if flags.iter().all(|&flag| flag == 0) {
                    continue;
                }
                for (offset, _) in flags.iter().enumerate().filter(|(_, flag)| **flag != 0) {
                    let (x, pixel) = (8 * chunk + offset, y * width + 8 * chunk + offset);
                    self.edges.push(pixel as u32);
                    self.fine.reach(pixel);
                    let (x, y) = (x as f32, y as f32);
                    for (dx, dy) in POINTS {
                        self.fine.push(x + dx, y + dy, nearest);
                    }
                }
            }
        }
        self.fine.end(height, view.farthest());
        draw_opaque(scene, assets, view, Sides::Front, None, &mut self.projected, &mut self.fine);
    }

    fn cast_shadows(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.maps.resize_with(scene.lights.len(), ShadowMap::default);
        if !self.quality.shadows {
            return;
        }
        // Shadows are as sharp as the image: a few texels per pixel.
        let size = (self.width.max(self.height) * 5 / 4).clamp(96, 1024);
        for (map, light) in self.maps.iter_mut().zip(&scene.lights) {
            map.draw(light, view.origin, scene, assets, size, &mut self.projected);
        }
    }

    fn shade(&mut self, scene: &Scene, assets: &Assets, view: &View) {
        self.colors.clear();
        self.colors.resize(self.width * self.height, [0.0; 3]);
        self.ground.begin(view, scene, assets, self.quality.shadows);
        let maps = self.quality.shadows.then_some(self.maps.as_slice());
        let shading = Shading { view, assets, lamps: &self.lamps, maps };
        let drawing = Drawing { view, assets, sides: Sides::Front, coarseness: COARSENESS };
        let (fragments, colors) = (&self.fragments, &mut self.colors);
        for (surface, instance) in scene.instances.iter().enumerate() {
            let range = fragments.of(surface);
            let level = drawing.level(instance);
            let put = |at: usize, color: Lanes3| accumulate(fragments, at, range.end, color, 1.0, colors);
            let ground = self.ground.of(surface);
            shading.shade(instance, level, fragments, range.clone(), &mut self.memory, ground, put);
        }
        let sky = self.sky.colors(scene, assets, view);
        for at in fragments.of(scene.instances.len()) {
            let pixel = fragments.pixel[at] as usize;
            for (sum, value) in colors[pixel].iter_mut().zip(sky[pixel]) {
                *sum += fragments.share[at] * value;
            }
        }
    }
}

/// Detail of meshes that is left out, in pixels.
const COARSENESS: f32 = 1.25;

/// Adds colors of up to eight fragments to their pixels.
fn accumulate(
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

/// Where the four points of a pixel are.
const POINTS: [(f32, f32); 4] = [(0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)];

/// Marks pixels of a row whose neighbors show something else.
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

/// A color from 0 to 1 as a byte. Above 2^23 values have no fraction: adding it rounds, and the byte is in the lowest
/// bits.
#[inline]
fn to_byte(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 8_388_608.0).to_bits() as u8
}

fn draw_opaque<T: Target>(
    scene: &Scene,
    assets: &Assets,
    view: &View,
    sides: Sides,
    except: Option<usize>,
    projected: &mut Projected,
    target: &mut T,
) {
    let drawing = Drawing { view, assets, sides, coarseness: COARSENESS };
    for (owner, instance) in scene.instances.iter().enumerate() {
        if Some(owner) != except && is_opaque(instance, view) {
            drawing.draw(instance, owner as u16, projected, target);
        }
    }
}

fn is_opaque(instance: &Instance, view: &View) -> bool {
    let seen_from_behind = matches!(instance.shape, Shape::Plane { .. }) && is_behind(instance, view);
    instance.material.color[3] >= OPAQUE && !seen_from_behind
}

/// Whether the eye is below the instance's xy plane.
fn is_behind(instance: &Instance, view: &View) -> bool {
    let eye: Vector = sub(view.origin, instance.position);
    dot(eye, column(instance.rotation, 2)) < 0.0
}

/// What is named must exist.
fn check(scene: &Scene, assets: &Assets) -> Result<(), RenderError> {
    let refuse = |reason: String| Err(RenderError::Scene { reason });
    if scene.instances.len() >= usize::from(NOTHING) {
        return refuse(format!("{} instances are too many (at most {})", scene.instances.len(), NOTHING - 1));
    }
    if let Some(sky) = scene.sky.filter(|&sky| sky >= assets.cubes.len()) {
        return refuse(format!("its sky is cube texture {sky} of {}", assets.cubes.len()));
    }
    for (index, instance) in scene.instances.iter().enumerate() {
        let (what, named, known) = match (instance.shape, instance.material.texture) {
            (Shape::Mesh(mesh), _) if mesh >= assets.meshes.len() => ("mesh", mesh, assets.meshes.len()),
            (_, Some(Mapping::Flat { texture, .. })) if texture >= assets.textures.len() => {
                ("texture", texture, assets.textures.len())
            }
            (_, Some(Mapping::Cube { texture, .. })) if texture >= assets.cubes.len() => {
                ("cube texture", texture, assets.cubes.len())
            }
            _ => continue,
        };
        return refuse(format!("instance {index} names {what} {named} of {known}"));
    }
    Ok(())
}
