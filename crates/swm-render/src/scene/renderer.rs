//! Makes frames of one size. The passes that make them are in `passes`.

mod blend;
mod layers;
mod mirror;
mod passes;

use std::sync::atomic::{AtomicU64, Ordering};

use super::assets::Assets;
use super::description::{Mapping, Scene, Shape};
use super::target::NOTHING;
use crate::error::{RenderError, check_len, check_size};
use crate::geometry::Geometry;
use passes::{Kept, PASSES};

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

/// Makes frames of one size. Holds memory, not state: a frame depends on its scene alone. All renderers of a thread share
/// the memory in which frames are made; each keeps the colors of its sky and its floor.
///
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
    frame: Frame,
    /// Tells the frames of this renderer from those of others on the same thread.
    id: u64,
    kept: Kept,
}

/// Size and quality of a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Frame {
    height: usize,
    width: usize,
    quality: Quality,
}

impl SceneRenderer {
    /// A renderer of frames of `geometry`.
    ///
    /// # Errors
    ///
    /// A side is 0 or above 4096.
    pub fn new(geometry: Geometry, quality: Quality) -> Result<Self, RenderError> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let Geometry { height, width, .. } = geometry;
        check_size("a frame", height, width)?;
        let mut kept = Kept::default();
        kept.ground.reserve(height * width);
        let frame = Frame { height, width, quality };
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        Ok(Self { frame, id, kept })
    }

    /// Writes the image of `scene` to `frame`, `[H, W, 3]`.
    ///
    /// # Errors
    ///
    /// `frame` has another length, or the scene names assets that do not exist.
    pub fn render(&mut self, scene: &Scene, assets: &Assets, frame: &mut [u8]) -> Result<(), RenderError> {
        check_len("frame", frame.len(), self.frame.height, self.frame.width)?;
        check(scene, assets)?;
        PASSES.with_borrow_mut(|passes| {
            passes.begin(self.frame, self.id);
            passes.render(&mut self.kept, scene, assets, frame);
        });
        Ok(())
    }
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
