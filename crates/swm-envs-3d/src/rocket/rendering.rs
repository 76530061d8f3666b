//! Images: the rocket from behind and above, over floor and pad.
//!
//! Camera, colors and sizes are the reference's; lights are those of `swm-render`'s scenes.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use swm_core::ImageSize;
use swm_fov::Fov;
use swm_render::scene::{
    Assets, Camera, Instance, Light, LightKind, Mapping, Material, Scene, SceneRenderer, Shape,
};

use super::body::{PARTS, Solid};
use super::contact::{FLOOR_HALF, PAD};
use super::factors::color;
use super::flight::PHYSICS_STEP_S;
use super::state::State;
use crate::attitude::{euler, from_euler, world_from_body};
use crate::scene;

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
    pub(super) fn new(size: ImageSize) -> Result<Self, String> {
        let renderer = scene::renderer(size)?;
        let floor = scene::squares(SQUARES, SQUARE_TEXELS)?;
        let assets = Assets { textures: vec![Arc::new(floor)], ..Assets::default() };
        let (scene, ground) = parts();
        Ok(Self { renderer, scene, ground, assets })
    }

    /// Takes the colors of an assignment.
    pub(super) fn dress(&mut self, fov: &Fov) {
        let sky = fov.rgb("environment.sky_color");
        self.assets.cubes = vec![Arc::new(scene::sky(sky))];
        self.ground[1].material.color = scene::opaque(fov.rgb("pad.color"));
        for (part, instance) in PARTS.iter().zip(&mut self.scene.instances) {
            instance.material.color = scene::opaque(color(fov, part.kind));
        }
    }

    /// Writes the image of a state, `[H, W, 3]`.
    pub(super) fn render(&mut self, state: &State, pixels: &mut [u8]) {
        let world = world_from_body(state.attitude);
        let origin = Vector3::from(state.position);
        for (part, instance) in PARTS.iter().zip(&mut self.scene.instances) {
            scene::place(instance, &world, origin, part.place, part.turn_rad);
        }
        let flame = &mut self.scene.instances[FLAME_INSTANCE];
        scene::place(flame, &world, origin, FLAME.2, 0.0);
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

fn camera(state: &State, world: &Matrix3<f64>, origin: Vector3<f64>) -> Camera {
    let [roll, pitch, yaw] = euler(state.attitude);
    let up = world_from_body(from_euler([roll, pitch + UP_PITCH_DEG.to_radians(), yaw])) * Vector3::z();
    let eye = world * Vector3::from(EYE);
    scene::camera(origin + eye, -eye.normalize(), up, 1.0, [0.1, 255.0])
}

/// Parts and flame, with the light of PyBullet's renderer: mostly ambient, the rest from above; then floor and pad.
fn parts() -> (Scene, [Instance; 2]) {
    let matte = scene::matte();
    let floor =
        Material { texture: Some(Mapping::Flat { texture: 0, scale: [0.5; 2], offset: [0.0; 2] }), ..matte };
    let half = FLOOR_HALF as f32;
    let [radius, pad_half, height] = PAD;
    let ground = [
        scene::upright(Shape::Plane { half: [half; 2], cell: [half; 2] }, [0.0; 3], floor),
        scene::upright(
            Shape::Cylinder { radius: radius as f32, half: pad_half as f32 },
            [0.0, 0.0, height],
            matte,
        ),
    ];
    let parts = PARTS.iter().map(|part| {
        let shape = match part.solid {
            Solid::Cylinder { radius, half } => Shape::Cylinder { radius: radius as f32, half: half as f32 },
            Solid::Box { half } => Shape::Box { half: half.map(|half| half as f32) },
        };
        scene::upright(shape, part.place, matte)
    });
    // Room for the ground, too.
    let mut instances = Vec::with_capacity(GROUND + ground.len());
    instances.extend(parts);
    let (radius, half, offset) = FLAME;
    let flame = Shape::Cylinder { radius: radius as f32, half: half as f32 };
    instances.push(scene::upright(flame, offset, Material { emission: 0.4, ..matte }));
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
