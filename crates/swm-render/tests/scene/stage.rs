//! A scene with everything that the renderer knows.

use std::sync::Arc;

use swm_render::scene::{
    Assets, Camera, CubeTexture, Haze, Instance, Light, LightKind, Mapping, Material, Mesh, Projection,
    Scene, Shape, Texture,
};

pub(crate) const FLOOR: i32 = 0;
pub(crate) const VEIL: i32 = 7;

pub(crate) struct Stage {
    pub(crate) scene: Scene,
    pub(crate) assets: Assets,
}

const UPRIGHT: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// An exact turn about x: 3-4-5.
const TILTED: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.8, -0.6], [0.0, 0.6, 0.8]];

impl Stage {
    pub(crate) fn new() -> Self {
        let floor = Material {
            color: [0.8, 0.8, 0.8, 1.0],
            reflectance: 0.3,
            texture: Some(Mapping::Flat { texture: 0, scale: [0.5, -0.5], offset: [0.1, 0.2] }),
            ..Material::default()
        };
        let plain = |color: [f32; 4]| Material { color, ..Material::default() };
        let painted =
            Material { texture: Some(Mapping::Cube { texture: 1, scale: [1.0; 3] }), ..plain([1.0; 4]) };
        let glowing = Material { emission: 0.4, specular: 0.0, ..plain([0.9, 0.5, 0.1, 1.0]) };
        let things = [
            (Shape::Plane { half: [6.0, 5.0], cell: [0.6, 0.7] }, [0.0; 3], UPRIGHT, floor),
            (Shape::Ellipsoid { radii: [0.5, 0.4, 0.3] }, [-1.2, 0.0, 0.6], TILTED, painted),
            (
                Shape::Capsule { radius: 0.2, half: 0.4 },
                [-0.3, 0.2, 0.8],
                TILTED,
                plain([0.9, 0.2, 0.2, 1.0]),
            ),
            (
                Shape::Cylinder { radius: 0.3, half: 0.4 },
                [0.6, 0.6, 0.5],
                TILTED,
                plain([0.2, 0.8, 0.3, 1.0]),
            ),
            (Shape::Box { half: [0.3, 0.2, 0.4] }, [1.3, -0.2, 0.5], TILTED, glowing),
            (Shape::Mesh(0), [0.2, -0.8, 0.5], TILTED, plain([0.3, 0.4, 0.9, 1.0])),
            (Shape::Ellipsoid { radii: [0.25; 3] }, [0.9, 1.8, 0.4], UPRIGHT, plain([0.7, 0.7, 0.2, 1.0])),
            (Shape::Box { half: [0.4, 0.05, 0.5] }, [-0.9, -1.0, 0.5], UPRIGHT, plain([0.2, 0.9, 0.9, 1.0])),
        ];
        let instances = (0..).zip(things).map(|(segment, (shape, position, rotation, mut material))| {
            if segment == VEIL {
                material.color[3] = 0.4;
            }
            Instance { shape, position, rotation, material, segment, casts_shadow: true }
        });
        let light = Light {
            kind: LightKind::Sun,
            direction: [0.0, 0.6, -0.8],
            position: [0.0, 0.0, 4.0],
            ambient: [0.1; 3],
            diffuse: [0.5; 3],
            specular: [0.3; 3],
            shadow: Some(4.0),
        };
        let kind = LightKind::Spot { cutoff: 45.0, exponent: 10.0, attenuation: [1.0, 0.1, 0.01] };
        let spot = Light { kind, direction: [0.0, 0.0, -1.0], shadow: Some(1.0), ..light };
        let scene = Scene {
            camera: Camera {
                position: [0.0, -4.0, 1.6],
                forward: [0.0, 24.0 / 25.0, -7.0 / 25.0],
                up: [0.0, 7.0 / 25.0, 24.0 / 25.0],
                projection: Projection { bottom: -0.4, top: 0.4, center: 0.0, half_width: None },
                near: 0.05,
                far: 50.0,
            },
            lights: vec![light, spot],
            instances: instances.collect(),
            sky: Some(0),
            haze: Some(Haze { color: [0.9; 3], width: 0.3, up: [0.0, 0.0, 1.0], elevation: 0.05 }),
        };
        Self { scene, assets: assets() }
    }

    /// Moves what can move: everything but the floor.
    pub(crate) fn turn(&mut self, time: f64) {
        for instance in self.scene.instances.iter_mut().filter(|instance| instance.segment != FLOOR) {
            let index = f64::from(instance.segment);
            instance.position[0] += 0.01 * (time - 3.0) * (index - 4.0) * 0.1;
            instance.position[2] = 0.5 + 0.1 * (time * index % 5.0) / 5.0;
        }
    }
}

fn assets() -> Assets {
    let checker: Vec<u8> = (0..20 * 20)
        .flat_map(|i: u32| if (i % 20 < 10) == (i / 20 < 10) { [40, 60, 90] } else { [90, 120, 160] })
        .collect();
    let faces: Vec<u8> =
        (0..6 * 8 * 8u32).flat_map(|i| [(i * 7 % 256) as u8, (i / 64 * 40) as u8, 120]).collect();
    let sky: Vec<u8> = (0..6 * 16 * 16u32).flat_map(|i| [90, 120, (100 + i % 16 * 8) as u8]).collect();
    let sound = "sound data";
    Assets {
        meshes: vec![Arc::new(ball())],
        textures: vec![Arc::new(Texture::new(20, 20, &checker).expect(sound))],
        cubes: vec![
            Arc::new(CubeTexture::new(16, &sky).expect(sound)),
            Arc::new(CubeTexture::new(8, &faces).expect(sound)),
        ],
    }
}

/// A cube of finely divided sides, blown up to a ball.
fn ball() -> Mesh {
    const SIDE: u32 = 12;
    let (mut points, mut triangles, mut normals) = (Vec::new(), Vec::new(), Vec::new());
    for axis in 0..3 {
        for sign in [-1.0_f32, 1.0] {
            let first = points.len() as u32;
            for i in 0..=SIDE {
                for j in 0..=SIDE {
                    let at = |k: u32| 2.0 * k as f32 / SIDE as f32 - 1.0;
                    let mut point = [0.0; 3];
                    point[axis] = sign;
                    point[(axis + 1) % 3] = at(i);
                    point[(axis + 2) % 3] = at(j);
                    let length = point.iter().map(|x| x * x).sum::<f32>().sqrt();
                    points.push(point.map(|x| 0.4 * x / length));
                }
            }
            for i in 0..SIDE {
                for j in 0..SIDE {
                    let a = first + i * (SIDE + 1) + j;
                    let (b, c, d) = (a + SIDE + 1, a + SIDE + 2, a + 1);
                    let quads = if sign > 0.0 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                    triangles.extend(quads);
                }
            }
        }
    }
    for triangle in &triangles {
        normals.push(triangle.map(|index: u32| points[index as usize].map(|x: f32| x / 0.4)));
    }
    Mesh::new(points, triangles, normals).expect("sound data")
}
