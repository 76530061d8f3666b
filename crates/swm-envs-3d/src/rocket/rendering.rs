//! Images: the rocket from behind and above, over floor and pad.
//!
//! Camera, colors and sizes are the reference's; lights are those of `swm-render`'s scenes.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use swm_core::ImageSize;
use swm_fov::Fov;
use swm_render::Geometry;
use swm_render::scene::{
    Assets, Camera, CubeTexture, Instance, Light, LightKind, Mapping, Material, NO_SEGMENT, Projection,
    Quality, Scene, SceneRenderer, Shape, Texture,
};

use super::attitude::{euler, from_euler, world_from_body};
use super::body::{PARTS, Solid};
use super::contact::{FLOOR_HALF, PAD};
use super::factors::color;
use super::flight::PHYSICS_STEP_S;
use super::state::State;

/// The eye, in the body frame.
const EYE: [f64; 3] = [-1.0, 0.0, 3.0];
/// The image's up is the z axis of an attitude that is pitched by this more, degrees.
const UP_PITCH_DEG: f64 = 30.0;
/// The flame: radius, half its length, place.
const FLAME: (f64, f64, [f64; 3]) = (0.15, 1.0, [0.0, 0.0, -3.4]);
/// Its color with the engine off and on.
const FLAME_COLORS: [[f32; 4]; 2] = [[1.0, 0.8, 0.0, 0.1], [1.0, 0.3, 0.3, 0.8]];
/// Colors of the floor's squares of 1 m.
const SQUARES: [[u8; 3]; 2] = [[255, 255, 255], [173, 199, 239]];
/// Texels of a side of a square.
const SQUARE_TEXELS: usize = 64;

/// Indices among the instances: the parts come first.
const FLAME_INSTANCE: usize = PARTS.len();
const GROUND: usize = FLAME_INSTANCE + 1;

/// What draws.
pub(super) struct Image {
    renderer: SceneRenderer,
    scene: Scene,
    /// Floor and pad, which are not always in the scene.
    ground: [Instance; 2],
    assets: Assets,
}

impl Image {
    /// For images of this size.
    pub(super) fn new(size: ImageSize, fov: &Fov) -> Result<Self, String> {
        let quality = Quality { antialias: true, shadows: false, reflections: false };
        let renderer = SceneRenderer::new(Geometry::new(size.height, size.width), quality);
        let renderer = renderer.map_err(|error| error.to_string())?;
        let assets = Assets { textures: vec![Arc::new(squares()?)], ..Assets::default() };
        let (scene, ground) = scene();
        let mut image = Self { renderer, scene, ground, assets };
        image.dress(fov);
        Ok(image)
    }

    /// Takes the colors of an assignment.
    pub(super) fn dress(&mut self, fov: &Fov) {
        let sky = fov.rgb("environment.sky_color");
        let sky = CubeTexture::new(1, &sky.repeat(6)).expect("six texels of three bytes");
        self.assets.cubes = vec![Arc::new(sky)];
        self.ground[1].material.color = opaque(fov.rgb("pad.color"));
        for (part, instance) in PARTS.iter().zip(&mut self.scene.instances) {
            instance.material.color = opaque(color(fov, part.kind));
        }
    }

    /// Writes the image of a state, `[H, W, 3]`.
    pub(super) fn render(&mut self, state: &State, pixels: &mut [u8]) {
        let world = world_from_body(state.attitude);
        let origin = Vector3::from(state.position);
        for (part, instance) in PARTS.iter().zip(&mut self.scene.instances) {
            place(instance, &world, origin, part.place, part.turn_rad);
        }
        let flame = &mut self.scene.instances[FLAME_INSTANCE];
        place(flame, &world, origin, FLAME.2, 0.0);
        flame.material.color = FLAME_COLORS[usize::from(state.throttle > 0.0 && state.action[3] > 0.5)];
        // The reference's camera lags a physics step behind.
        self.scene.camera = camera(state, &world, origin - Vector3::from(state.velocity) * PHYSICS_STEP_S);
        // The reference's camera sees this far: from higher up, there is no ground in the image.
        let Camera { position: [.., height], forward: [.., down], far, .. } = self.scene.camera;
        self.scene.instances.truncate(GROUND);
        if height <= -down * far {
            self.scene.instances.extend(self.ground);
        }
        let rendered = self.renderer.render(&self.scene, &self.assets, pixels);
        rendered.expect("the pixel field has the renderer's size, and the scene its assets");
    }
}

fn place(
    instance: &mut Instance,
    world: &Matrix3<f64>,
    origin: Vector3<f64>,
    offset: [f64; 3],
    turn_rad: f64,
) {
    let turn = world_from_body(from_euler([0.0, 0.0, turn_rad]));
    instance.position = (origin + world * Vector3::from(offset)).into();
    instance.rotation = rows(&(world * turn));
}

fn rows(matrix: &Matrix3<f64>) -> [[f64; 3]; 3] {
    matrix.transpose().into()
}

fn opaque(color: [u8; 3]) -> [f32; 4] {
    let [r, g, b] = color.map(|channel| f32::from(channel) / 255.0);
    [r, g, b, 1.0]
}

fn camera(state: &State, world: &Matrix3<f64>, origin: Vector3<f64>) -> Camera {
    let [roll, pitch, yaw] = euler(state.attitude);
    let up = world_from_body(from_euler([roll, pitch + UP_PITCH_DEG.to_radians(), yaw])) * Vector3::z();
    let eye = world * Vector3::from(EYE);
    let forward = -eye.normalize();
    let right = forward.cross(&up).normalize();
    Camera {
        position: (origin + eye).into(),
        forward: forward.into(),
        up: right.cross(&forward).into(),
        projection: Projection { bottom: -1.0, top: 1.0, center: 0.0, half_width: None },
        near: 0.1,
        far: 255.0,
    }
}

/// Two by two squares.
fn squares() -> Result<Texture, String> {
    let side = 2 * SQUARE_TEXELS;
    let texels = (0..side * side).flat_map(|at| {
        let (row, column) = (at / side / SQUARE_TEXELS, at % side / SQUARE_TEXELS);
        SQUARES[(row + column) % 2]
    });
    Texture::new(side, side, &texels.collect::<Vec<u8>>()).map_err(|error| error.to_string())
}

/// Parts and flame, with the light of PyBullet's renderer: mostly ambient, the rest from above; then floor and pad.
fn scene() -> (Scene, [Instance; 2]) {
    let matte = Material { color: [1.0; 4], specular: 0.0, ..Material::default() };
    let still = |shape: Shape, position: [f64; 3], material: Material| Instance {
        shape,
        position,
        rotation: rows(&Matrix3::identity()),
        material,
        segment: NO_SEGMENT,
        casts_shadow: false,
    };
    let floor =
        Material { texture: Some(Mapping::Flat { texture: 0, scale: [0.5; 2], offset: [0.0; 2] }), ..matte };
    let half = FLOOR_HALF as f32;
    let [radius, pad_half, height] = PAD;
    let ground = [
        still(Shape::Plane { half: [half; 2], cell: [half; 2] }, [0.0; 3], floor),
        still(Shape::Cylinder { radius: radius as f32, half: pad_half as f32 }, [0.0, 0.0, height], matte),
    ];
    let parts = PARTS.iter().map(|part| {
        let shape = match part.solid {
            Solid::Cylinder { radius, half } => Shape::Cylinder { radius: radius as f32, half: half as f32 },
            Solid::Box { half } => Shape::Box { half: half.map(|half| half as f32) },
        };
        still(shape, part.place, matte)
    });
    // Room for the ground, too.
    let mut instances = Vec::with_capacity(GROUND + ground.len());
    instances.extend(parts);
    let (radius, half, offset) = FLAME;
    let flame = Shape::Cylinder { radius: radius as f32, half: half as f32 };
    instances.push(still(flame, offset, Material { emission: 0.4, ..matte }));
    let light = Light {
        kind: LightKind::Sun,
        direction: [0.8, -0.33166, -0.5],
        position: [0.0, 0.0, 100.0],
        ambient: [0.78; 3],
        diffuse: [0.32; 3],
        specular: [0.0; 3],
        shadow: None,
    };
    (Scene { instances, lights: vec![light], sky: Some(0), ..Scene::default() }, ground)
}
