//! Images of 3D scenes without OpenGL. Knows shapes, lights and cameras; not where they come from.
//!
//! A [`Scene`] describes one frame, [`Assets`] hold what many frames share (meshes and textures), and a
//! [`SceneRenderer`] turns both into frames. Lighting follows the fixed-function pipeline that MuJoCo's own renderer
//! drives (Segal & Akeley, *The OpenGL Graphics System*, version 1.5, section 2.14), so that images look alike: the
//! rules are in [`lighting`](self), the passes in the renderer.
//!
//! How a frame is made:
//!
//! 1. **Visibility.** Solids are intersected with the rays of the pixels that their bounds cover, meshes are
//!    rasterized; the nearest surface of each pixel wins. Where neighbors differ, four points per pixel are tested.
//! 2. **Shadows.** The same visibility, seen from each light that casts them, fitted to what casts.
//! 3. **Shading.** Fragments are sorted by surface and shaded in lanes of eight; mirrors see the scene once more.
//! 4. **Transparency.** Surfaces that let light through are blended over the result.
//!
//! Everything is IEEE addition, multiplication, division and square root, in an order that does not depend on the
//! CPU: the same scene gives the same bytes everywhere.

mod assets;
mod description;
mod fragments;
mod grid;
mod ground;
mod height_field;
mod lanes;
mod lighting;
mod mesh;
mod plane;
mod renderer;
mod samples;
mod shading;
mod shadow;
mod shape;
mod simplify;
mod sky;
mod small;
mod target;
mod texture;
mod triangles;
mod vector;
mod view;
mod visibility;

pub use assets::Assets;
pub use description::{
    Camera, Haze, Instance, Light, LightKind, Mapping, Material, NO_SEGMENT, Projection, Scene, Shape,
};
pub use mesh::Mesh;
pub use renderer::{Quality, SceneRenderer};
pub use texture::{CubeTexture, Texture};
