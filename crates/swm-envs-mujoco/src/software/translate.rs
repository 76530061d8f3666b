//! What MuJoCo says there is to render, in the renderer's words.
#![expect(non_upper_case_globals, reason = "C's names of constants, in patterns")]

use swm_render::scene::{Camera, Haze, Instance, Light, LightKind, Mapping, Material, Projection, Shape};

use super::store::{Slot, Store};
use swm_mujoco::Model;
use swm_mujoco::visuals::*;

fn wide(v: [f32; 3]) -> [f64; 3] {
    v.map(f64::from)
}

pub(super) fn camera(left: &mjvGLCamera, right: &mjvGLCamera) -> Camera {
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
pub(super) fn lamp(light: &mjvLight, looks: &Looks) -> Option<Light> {
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

/// Shapes that MuJoCo renders as lines, arrows or text for people to look at are left out.
pub(super) fn instance(geom: &mjvGeom, model: &Model, store: &Store) -> Option<Instance> {
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

/// What images of segments show for things that are neither geoms nor sites.
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
        Slot::Cube(texture) => {
            // Meshes are drawn in meters; other shapes of size 1, which is then scaled.
            let is_mesh = geom.type_ == mjGEOM_MESH as i32 || geom.type_ == mjGEOM_HFIELD as i32;
            let scale = match (uniform, is_mesh) {
                (true, _) => geom.size,
                (false, true) => [1.0; 3],
                (false, false) => geom.size.map(|size| if size > 0.0 { 1.0 / size } else { 1.0 }),
            };
            Mapping::Cube { texture, scale }
        }
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
pub(super) fn haze(geom: &mjvGeom, looks: &Looks, camera: &Camera) -> Option<Haze> {
    if geom.type_ != mjGEOM_PLANE as i32 || geom.size[0] != 0.0 || geom.size[1] != 0.0 {
        return None;
    }
    let up = [2, 5, 8].map(|k| f64::from(geom.mat[k]));
    let height: f64 = (0..3).map(|k| (camera.position[k] - f64::from(geom.pos[k])) * up[k]).sum();
    // MuJoCo renders the sky at seven tenths of the farthest distance.
    let elevation = (height / (0.7 * camera.far)) as f32;
    (elevation >= 0.0).then_some(Haze { color: looks.haze_color, width: looks.haze, up, elevation })
}
