//! Images: the table from a camera that factors place, with object, pusher and goal, under a lamp.

use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};
use swm_core::ImageSize;
use swm_fov::Fov;
use swm_render::scene::{Assets, Camera, Light, LightKind, Material, Scene, SceneRenderer, Shape};

use super::body::{Object, Solid};
use super::physics::{PUSHER_HALF, PUSHER_HEIGHT, TABLE_DEPTH, TABLE_HALF};
use super::state::State;
use crate::attitude::{sin_cos, world_from_body};
use crate::scene;

/// Thickness of the disc that shows the goal, m.
const GOAL_DEPTH: f64 = 0.001;
/// How far the camera opens to either side of the middle, at distance 1.
const OPENING: f64 = 0.5;
/// Nothing nearer or farther is seen, m.
const RANGE: [f64; 2] = [0.05, 10.0];
/// The lamp stands this high, as the sine and the cosine of its angle above the table.
const LAMP: [f64; 2] = [0.8, 0.6];
/// Light from everywhere, besides the lamp's.
const AMBIENT: f32 = 0.35;

/// Indices among the instances; after the pusher come the object's solids, last the goal, if it is rendered.
const PUSHER: usize = 1;
const OBJECT: usize = 2;

/// What draws.
pub(super) struct Image {
    renderer: SceneRenderer,
    scene: Scene,
    assets: Assets,
    has_goal: bool,
}

impl Image {
    /// For images of this size.
    pub(super) fn new(size: ImageSize, has_goal: bool) -> Result<Self, String> {
        let renderer = scene::renderer(size)?;
        Ok(Self { renderer, scene: Scene::default(), assets: Assets::default(), has_goal })
    }

    /// Takes the look of an episode.
    pub(super) fn dress(&mut self, fov: &Fov, goal: [f64; 2]) {
        let color = |name: &str| {
            let color = scene::opaque(fov.rgb(name));
            Material { color, ..scene::matte() }
        };
        let half = TABLE_HALF as f32;
        let table = Shape::Box { half: [half, half, TABLE_DEPTH as f32] };
        let pusher = Shape::Cylinder { radius: fov.f64("pusher.radius") as f32, half: PUSHER_HALF as f32 };
        let disc = Shape::Cylinder { radius: fov.f64("goal.radius") as f32, half: GOAL_DEPTH as f32 };
        let [x, y] = goal;
        let goal = self.has_goal.then_some((disc, [x, y, 0.0], "goal.color"));
        let instances = [
            (table, [0.0, 0.0, -TABLE_DEPTH], "table.color"),
            (pusher, [0.0, 0.0, PUSHER_HEIGHT], "pusher.color"),
        ];
        let solids = Object::new(fov).solids().map(|solid| {
            let shape = match solid {
                Solid::Box(half) => Shape::Box { half: half.map(|half| half as f32) },
                Solid::Cylinder(radius, half) => Shape::Cylinder { radius: radius as f32, half: half as f32 },
            };
            (shape, [0.0; 3], "object.color")
        });
        let upright =
            |(shape, place, name): (Shape, [f64; 3], &str)| scene::upright(shape, place, color(name));
        self.scene.instances.clear();
        self.scene.instances.extend(instances.into_iter().chain(solids).chain(goal).map(upright));
        self.scene.camera = camera(fov);
        self.scene.lights = vec![light(fov)];
        self.scene.sky = Some(0);
        self.assets.cubes = vec![Arc::new(scene::sky(fov.rgb("background.color")))];
    }

    /// Writes the image of a state, `[H, W, 3]`.
    pub(super) fn render(&mut self, state: &State, pixels: &mut [u8]) {
        let world = world_from_body(state.attitude);
        let [x, y] = state.pusher;
        let instances = &mut self.scene.instances;
        scene::place(
            &mut instances[PUSHER],
            &Matrix3::identity(),
            Vector3::zeros(),
            [x, y, PUSHER_HEIGHT],
            0.0,
        );
        let end = instances.len() - usize::from(self.has_goal);
        for solid in &mut instances[OBJECT..end] {
            scene::place(solid, &world, Vector3::from(state.position), [0.0; 3], 0.0);
        }
        let rendered = self.renderer.render(&self.scene, &self.assets, pixels);
        rendered.expect("the pixel field has the renderer's size, and the scene its assets");
    }
}

/// The direction at an angle about the vertical and one above the table, from the middle outwards; azimuth 0 is along -y.
fn direction(azimuth_deg: f64, [rise, run]: [f64; 2]) -> Vector3<f64> {
    let (sin, cos) = sin_cos(azimuth_deg.to_radians());
    Vector3::new(run * sin, -run * cos, rise)
}

fn camera(fov: &Fov) -> Camera {
    let (sin, cos) = sin_cos(fov.f64("camera.elevation").to_radians());
    let outward = direction(fov.f64("camera.azimuth"), [sin, cos]);
    let eye = outward * fov.f64("camera.distance");
    scene::camera(eye, -outward, Vector3::z(), OPENING, RANGE)
}

fn light(fov: &Fov) -> Light {
    let outward = direction(fov.f64("light.azimuth"), LAMP);
    Light {
        kind: LightKind::Sun,
        direction: (-outward).into(),
        position: outward.into(),
        ambient: [AMBIENT; 3],
        diffuse: [fov.f64("light.intensity") as f32; 3],
        specular: [0.0; 3],
        shadow: None,
    }
}
