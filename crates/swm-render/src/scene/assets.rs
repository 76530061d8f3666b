//! What many scenes share: made once, read by any number of renderers. Single ones can be shared by several sets.

use std::sync::Arc;

use super::mesh::Mesh;
use super::texture::{CubeTexture, Texture};

/// Meshes and textures, by index.
#[derive(Clone, Debug, Default)]
pub struct Assets {
    /// For [`super::Shape::Mesh`].
    pub meshes: Vec<Arc<Mesh>>,
    /// For [`super::Mapping::Flat`].
    pub textures: Vec<Arc<Texture>>,
    /// For [`super::Mapping::Cube`] and [`super::Scene::sky`].
    pub cubes: Vec<Arc<CubeTexture>>,
}
