//! Pictures without OpenGL: what MuJoCo says there is to draw, drawn by `swm-render`. How a picture is made is not known
//! here.
#![expect(non_upper_case_globals, reason = "C's names of constants, in patterns")]

use std::sync::{Arc, Mutex, PoisonError, Weak};

use swm_render::Geometry;
use swm_render::scene::{
    Assets, Camera, CubeTexture, Haze, Instance, Light, LightKind, Mapping, Material, Mesh, Projection,
    Quality, Scene as Picture, SceneRenderer, Shape, Texture,
};

use crate::error::MujocoError;
use crate::ffi::drawn::*;
use crate::ffi::{Model, Scene, Simulation};

/// Draws simulations of one model as one of its cameras sees them.
///
/// Textures and meshes come from the model that it was made with, and are shared by all renderers of it; places, sizes and
/// colours come from the simulation that is drawn, whose model may be one for physics with the textures left out.
pub struct SoftwareRenderer {
    model: Arc<Model>,
    looks: Looks,
    /// What is drawn with.
    store: Arc<Store>,
    /// The model's own, kept for other renderers of the model to find.
    shared: Arc<Store>,
    scene: Scene,
    picture: Picture,
    renderer: SceneRenderer,
}

/// Meshes and textures of a model, and where its textures are among them.
#[derive(Clone)]
struct Store {
    assets: Assets,
    slots: Vec<Slot>,
    sky: Option<usize>,
}

/// Where a texture of the model is.
#[derive(Clone, Copy)]
enum Slot {
    Flat(usize),
    Cube(usize),
}

impl SoftwareRenderer {
    /// A renderer for pictures of `height` × `width` pixels from the camera of this index.
    ///
    /// # Errors
    ///
    /// No such camera, a size that is 0 or too large, or meshes and textures that cannot be drawn.
    pub fn new(model: &Arc<Model>, camera: usize, size: [usize; 2]) -> Result<Self, MujocoError> {
        Self::with_quality(model, camera, size, Quality::default())
    }

    /// A renderer of better or quicker pictures.
    ///
    /// # Errors
    ///
    /// As of [`SoftwareRenderer::new`].
    pub fn with_quality(
        model: &Arc<Model>,
        camera: usize,
        [height, width]: [usize; 2],
        quality: Quality,
    ) -> Result<Self, MujocoError> {
        let geometry = Geometry::new(height, width);
        let store = Store::of(model)?;
        Ok(Self {
            looks: model.looks(),
            shared: Arc::clone(&store),
            store,
            scene: Scene::new(Arc::clone(model), camera)?,
            picture: Picture::default(),
            renderer: SceneRenderer::new(geometry, quality)?,
            model: Arc::clone(model),
        })
    }

    /// Takes textures and meshes from another model with the same objects.
    ///
    /// # Errors
    ///
    /// Its meshes or textures cannot be drawn.
    pub fn set_model(&mut self, model: &Arc<Model>) -> Result<(), MujocoError> {
        self.shared = Store::of(model)?;
        self.store = Arc::clone(&self.shared);
        self.looks = model.looks();
        self.model = Arc::clone(model);
        Ok(())
    }

    /// Shows a flat texture of the model, which lends all others, in colours that depend on its own, row
    /// and column of a pixel and its colour.
    pub fn recolor(&mut self, index: usize, recolor: impl Fn([usize; 2], [u8; 3]) -> [u8; 3]) {
        if let Some(Slot::Flat(slot)) = self.shared.slots.get(index).copied() {
            // What others show stays as it is.
            let mut own = Store::clone(&self.shared);
            own.assets.textures[slot] = Arc::new(own.assets.textures[slot].recolored(recolor));
            self.store = Arc::new(own);
        }
    }

    /// Writes the picture of the simulation as it stands computed, `[height, width, 3]`.
    ///
    /// # Errors
    ///
    /// The simulation is of a model with other objects, or `pixels` has another length.
    pub fn draw(&mut self, sim: &mut Simulation, pixels: &mut [u8]) -> Result<(), MujocoError> {
        self.describe(sim)?;
        Ok(self.renderer.render(&self.picture, &self.store.assets, pixels)?)
    }

    /// Writes what each pixel shows, `[height, width]`: the index of a geom, -2 - index of a site,
    /// the smallest number for other things, -1 for nothing.
    ///
    /// # Errors
    ///
    /// The simulation is of a model with other objects, or `segments` has another length.
    pub fn draw_segmentation(
        &mut self,
        sim: &mut Simulation,
        segments: &mut [i32],
    ) -> Result<(), MujocoError> {
        self.describe(sim)?;
        Ok(self.renderer.render_segmentation(&self.picture, &self.store.assets, segments)?)
    }

    /// Writes the distance of each pixel along the camera's axis, m, `[height, width]`.
    ///
    /// # Errors
    ///
    /// The simulation is of a model with other objects, or `depth` has another length.
    pub fn draw_depth(&mut self, sim: &mut Simulation, depth: &mut [f32]) -> Result<(), MujocoError> {
        self.describe(sim)?;
        Ok(self.renderer.render_depth(&self.picture, &self.store.assets, depth)?)
    }

    /// As [`SoftwareRenderer::draw_segmentation`], of the picture that was drawn last.
    ///
    /// # Errors
    ///
    /// `segments` has another length.
    pub fn segmentation_of_last(&mut self, segments: &mut [i32]) -> Result<(), MujocoError> {
        Ok(self.renderer.segmentation_of_last(&self.picture, &self.store.assets, segments)?)
    }

    /// As [`SoftwareRenderer::draw_depth`], of the picture that was drawn last.
    ///
    /// # Errors
    ///
    /// `depth` has another length.
    pub fn depth_of_last(&mut self, depth: &mut [f32]) -> Result<(), MujocoError> {
        Ok(self.renderer.depth_of_last(&self.picture, &self.store.assets, depth)?)
    }

    fn describe(&mut self, sim: &mut Simulation) -> Result<(), MujocoError> {
        self.scene.update(sim)?;
        let Self { model, looks, store, scene, picture, .. } = self;
        let [left, right] = scene.eyes();
        picture.camera = camera(left, right);
        picture.sky = store.sky;
        picture.lights.clear();
        picture.lights.extend(scene.lights().iter().filter_map(|light| lamp(light, looks)));
        picture.instances.clear();
        picture.instances.extend(scene.geoms().iter().filter_map(|geom| instance(geom, model, store)));
        picture.haze = scene.geoms().iter().find_map(|geom| haze(geom, looks, &picture.camera));
        Ok(())
    }
}

impl Store {
    /// The store of a model; one for all renderers of it.
    fn of(model: &Arc<Model>) -> Result<Arc<Self>, MujocoError> {
        static KNOWN: Mutex<Vec<(Weak<Model>, Weak<Store>)>> = Mutex::new(Vec::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(model, store)| model.strong_count() > 0 && store.strong_count() > 0);
        let found = known.iter().find(|(other, _)| std::ptr::eq(other.as_ptr(), Arc::as_ptr(model)));
        if let Some(store) = found.and_then(|(_, store)| store.upgrade()) {
            return Ok(store);
        }
        // Most textures of an edited model are those of another: a sky box takes longer to read than a picture to draw.
        let others: Vec<(Arc<Model>, Arc<Store>)> =
            known.iter().filter_map(|(model, store)| Some((model.upgrade()?, store.upgrade()?))).collect();
        let store = Arc::new(Self::new(model, &others)?);
        known.push((Arc::downgrade(model), Arc::downgrade(&store)));
        Ok(store)
    }

    fn new(model: &Model, others: &[(Arc<Model>, Arc<Store>)]) -> Result<Self, MujocoError> {
        let mut store = Self { assets: Assets::default(), slots: Vec::new(), sky: None };
        for index in 0..model.texture_count() {
            let [width, _, channels] = model.texture_size(index);
            let same = others.iter().find(|(other, _)| has_same_texture(model, other, index));
            let kind = model.texture_type(index);
            if kind == mjTEXTURE_2D as i32 {
                let texture = match same.map(|(_, store)| (store, store.slots[index])) {
                    Some((store, Slot::Flat(slot))) => Arc::clone(&store.assets.textures[slot]),
                    _ => Arc::new(Texture::new(
                        width,
                        model.texture_size(index)[1],
                        &rgb(model.pixels(index), channels),
                    )?),
                };
                store.slots.push(Slot::Flat(store.assets.textures.len()));
                store.assets.textures.push(texture);
            } else {
                let cube = match same.map(|(_, store)| (store, store.slots[index])) {
                    Some((store, Slot::Cube(slot))) => Arc::clone(&store.assets.cubes[slot]),
                    _ => Arc::new(CubeTexture::new(width, &rgb(model.pixels(index), channels))?),
                };
                if kind == mjTEXTURE_SKYBOX as i32 && store.sky.is_none() {
                    store.sky = Some(store.assets.cubes.len());
                }
                store.slots.push(Slot::Cube(store.assets.cubes.len()));
                store.assets.cubes.push(cube);
            }
        }
        store.assets.meshes = match others.iter().find(|(other, _)| model.has_shapes_of(other)) {
            Some((_, other)) => other.assets.meshes.clone(),
            None => {
                let meshes = (0..model.mesh_count()).map(|index| mesh(model.mesh(index)));
                // Height fields stand behind the meshes.
                let grounds = (0..model.ground_count()).map(|index| ground(model.ground(index)));
                meshes.chain(grounds).collect::<Result<_, _>>()?
            }
        };
        Ok(store)
    }
}

fn has_same_texture(a: &Model, b: &Model, index: usize) -> bool {
    index < b.texture_count()
        && a.texture_type(index) == b.texture_type(index)
        && a.texture_size(index) == b.texture_size(index)
        && a.pixels(index) == b.pixels(index)
}

fn rgb(pixels: &[u8], channels: usize) -> Vec<u8> {
    pixels
        .chunks_exact(channels)
        .flat_map(|pixel| [pixel[0], pixel[channels.min(2) - 1], pixel[channels.min(3) - 1]])
        .collect()
}

/// A mesh as MuJoCo draws it: where a corner's normal is far from that of its face, the face is flat.
fn mesh(data: MeshData) -> Result<Arc<Mesh>, MujocoError> {
    let MeshData { points, faces, mut normals } = data;
    for (face, normals) in faces.iter().zip(&mut normals) {
        let [a, b, c] = face.map(|index| points[index as usize]);
        let side = |to: [f32; 3]| [0, 1, 2].map(|k| to[k] - a[k]);
        let (u, v) = (side(b), side(c));
        let across = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        let length = across.iter().map(|x| x * x).sum::<f32>().sqrt();
        if length == 0.0 {
            continue;
        }
        let flat = across.map(|x| x / length);
        for normal in normals {
            let along: f32 = normal.iter().zip(flat).map(|(a, b)| a * b).sum();
            if along < SMOOTH {
                *normal = flat;
            }
        }
    }
    Ok(Arc::new(Mesh::new(points, faces, normals)?))
}

fn ground(data: GroundData) -> Result<Arc<Mesh>, MujocoError> {
    let GroundData { size, heights, half, base } = data;
    Ok(Arc::new(Mesh::height_field(&heights, size, half, base)?))
}

/// The cosine up to which a corner's normal counts as that of a smooth surface.
const SMOOTH: f32 = 0.8;

fn wide(v: [f32; 3]) -> [f64; 3] {
    v.map(f64::from)
}

fn camera(left: &mjvGLCamera, right: &mjvGLCamera) -> Camera {
    let middle = |a: [f32; 3], b: [f32; 3]| [0, 1, 2].map(|k| f64::midpoint(a[k].into(), b[k].into()));
    let near = f64::from(left.frustum_near);
    let at_one = |edge: f32| f64::from(edge) / near;
    let width = left.frustum_width;
    Camera {
        position: middle(left.pos, right.pos),
        forward: wide(left.forward),
        up: wide(left.up),
        projection: Projection {
            bottom: at_one(left.frustum_bottom),
            top: at_one(left.frustum_top),
            center: f64::midpoint(at_one(left.frustum_center), at_one(right.frustum_center)),
            half_width: (width > 0.0).then(|| at_one(width)),
        },
        near,
        far: left.frustum_far.into(),
    }
}

/// Only these two kinds give light in MuJoCo's renderer.
fn lamp(light: &mjvLight, looks: &Looks) -> Option<Light> {
    let (kind, reach) = match light.type_ as u32 {
        mjLIGHT_DIRECTIONAL => (LightKind::Sun, looks.shadow_clip),
        mjLIGHT_SPOT => {
            let (cutoff, exponent, attenuation) = (light.cutoff, light.exponent, light.attenuation);
            // The opening of its shadow map, in degrees, at most 160.
            let opening = (2.0 * f64::from(cutoff) * looks.shadow_scale).min(160.0);
            (LightKind::Spot { cutoff, exponent, attenuation }, (opening / 2.0).to_radians().tan())
        }
        _ => return None,
    };
    Some(Light {
        kind,
        direction: wide(light.dir),
        position: wide(light.pos),
        ambient: light.ambient,
        diffuse: light.diffuse,
        specular: light.specular,
        shadow: (light.castshadow != 0).then_some(reach),
    })
}

/// Shapes that MuJoCo draws as lines, arrows or text for people to look at are left out.
fn instance(geom: &mjvGeom, model: &Model, store: &Store) -> Option<Instance> {
    let size = geom.size;
    let shape = match geom.type_ as u32 {
        mjGEOM_PLANE => Shape::Plane { half: [size[0], size[1]], cell: plane_cell(geom, model) },
        mjGEOM_SPHERE | mjGEOM_ELLIPSOID => Shape::Ellipsoid { radii: size },
        mjGEOM_CAPSULE => Shape::Capsule { radius: size[0], half: size[2] },
        mjGEOM_CYLINDER => Shape::Cylinder { radius: size[0], half: size[2] },
        mjGEOM_BOX => Shape::Box { half: size },
        // Each mesh has a convex hull beside it.
        mjGEOM_MESH => Shape::Mesh(usize::try_from(geom.dataid / 2).ok()?),
        mjGEOM_HFIELD => Shape::Mesh(model.mesh_count() + usize::try_from(geom.dataid).ok()?),
        _ => return None,
    };
    let texture = usize::try_from(geom.texid).ok().and_then(|texture| store.slots.get(texture));
    Some(Instance {
        shape,
        position: wide(geom.pos),
        rotation: [0, 1, 2].map(|row| [0, 1, 2].map(|column| geom.mat[3 * row + column].into())),
        material: Material {
            color: geom.rgba,
            emission: geom.emission,
            specular: geom.specular,
            shininess: geom.shininess * 128.0,
            reflectance: geom.reflectance,
            texture: texture.map(|slot| mapping(*slot, geom)),
        },
        segment: segment(geom),
        casts_shadow: geom.category != mjCAT_DECOR as i32,
    })
}

/// The index of a geom; -2, -3, … for sites 0, 1, …; [`OTHER`] for what is neither: tendons and the like.
fn segment(geom: &mjvGeom) -> i32 {
    match geom.objtype as u32 {
        mjOBJ_GEOM => geom.objid,
        mjOBJ_SITE => -2 - geom.objid,
        _ => OTHER,
    }
}

/// What pictures of segments show for things that are neither geoms nor sites.
const OTHER: i32 = i32::MIN;

/// Facets of a plane: as long as twice the geom's third size, and not more than MuJoCo has room for.
fn plane_cell(geom: &mjvGeom, model: &Model) -> [f32; 2] {
    let index = usize::try_from(geom.objid).unwrap_or(usize::MAX);
    if geom.objtype != mjOBJ_GEOM as i32 || index >= model.ngeom() {
        return [0.0; 2];
    }
    let size = &model.geom_size()[3 * index..][..3];
    [0, 1].map(|axis| (2.0 * size[2].max(size[axis] / MOST_FACETS)) as f32)
}

/// Facets from the middle of a plane to its edge.
const MOST_FACETS: f64 = 198.0;

/// How a texture lies on a geom, as MuJoCo 3.17's texture coordinates and transforms work out.
fn mapping(slot: Slot, geom: &mjvGeom) -> Mapping {
    let uniform = geom.texuniform != 0;
    match slot {
        Slot::Cube(texture) => Mapping::Cube { texture, scale: if uniform { geom.size } else { [1.0; 3] } },
        Slot::Flat(texture) => {
            let repeat = [0, 1].map(|k| {
                let repeat = if geom.texrepeat[k] > 0.0 { geom.texrepeat[k] } else { 1.0 };
                if uniform && geom.size[k] > 0.0 { repeat * geom.size[k] } else { repeat }
            });
            // The first row of the texture lies at the far side: v runs against y.
            if geom.size[0] > 0.0 && geom.size[1] > 0.0 {
                let scale = [repeat[0] / (2.0 * geom.size[0]), -repeat[1] / (2.0 * geom.size[1])];
                Mapping::Flat { texture, scale, offset: [0.5 * repeat[0], 0.5 * repeat[1]] }
            } else {
                let scale = [0.5 * repeat[0], -0.5 * repeat[1]];
                Mapping::Flat { texture, scale, offset: [-0.5; 2] }
            }
        }
    }
}

/// Haze over a plane without end, seen from above.
fn haze(geom: &mjvGeom, looks: &Looks, camera: &Camera) -> Option<Haze> {
    if geom.type_ != mjGEOM_PLANE as i32 || geom.size[0] != 0.0 || geom.size[1] != 0.0 {
        return None;
    }
    let up = [2, 5, 8].map(|k| f64::from(geom.mat[k]));
    let height: f64 = (0..3).map(|k| (camera.position[k] - f64::from(geom.pos[k])) * up[k]).sum();
    // MuJoCo draws the sky at seven tenths of the farthest distance.
    let elevation = (height / (0.7 * camera.far)) as f32;
    (elevation >= 0.0).then_some(Haze { color: looks.haze_color, width: looks.haze, up, elevation })
}
