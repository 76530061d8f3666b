//! Meshes and textures of models, read once and shared.

use std::sync::{Arc, Mutex, PoisonError, Weak};

use swm_render::scene::{Assets, CubeTexture, Mesh, Texture};

use swm_mujoco::Model;
use swm_mujoco::MujocoError;
use swm_mujoco::visuals::{GroundData, MeshData, mjTEXTURE_2D, mjTEXTURE_SKYBOX};

/// Meshes and textures of a model, and where its textures are among them.
#[derive(Clone)]
pub(super) struct Store {
    pub(super) assets: Assets,
    pub(super) slots: Vec<Slot>,
    pub(super) sky: Option<usize>,
}

/// Where a texture of the model is.
#[derive(Clone, Copy)]
pub(super) enum Slot {
    Flat(usize),
    Cube(usize),
}

impl Store {
    /// The store of a model; one for all renderers of it.
    pub(super) fn of(model: &Arc<Model>) -> Result<Arc<Self>, MujocoError> {
        static KNOWN: Mutex<Vec<(Weak<Model>, Weak<Store>)>> = Mutex::new(Vec::new());
        let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(model, store)| model.strong_count() > 0 && store.strong_count() > 0);
        let found = known.iter().find(|(other, _)| std::ptr::eq(other.as_ptr(), Arc::as_ptr(model)));
        if let Some(store) = found.and_then(|(_, store)| store.upgrade()) {
            return Ok(store);
        }
        // Most textures of an edited model are those of another: a sky box takes longer to read than an image to render.
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

/// A mesh as MuJoCo renders it: where a corner's normal is far from that of its face, the face is flat.
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
