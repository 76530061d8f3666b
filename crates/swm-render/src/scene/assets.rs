//! What many scenes share: made once, read by any number of renderers.

use super::mesh::Mesh;
use super::texture::{CubeTexture, Texture};

/// Meshes and textures, by index.
#[derive(Clone, Debug, Default)]
pub struct Assets {
    /// For [`super::Shape::Mesh`].
    pub meshes: Vec<Mesh>,
    /// For [`super::Mapping::Flat`].
    pub textures: Vec<Texture>,
    /// For [`super::Mapping::Cube`] and [`super::Scene::sky`].
    pub cubes: Vec<CubeTexture>,
}
