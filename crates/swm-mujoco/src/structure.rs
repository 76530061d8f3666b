//! How a compiled model is put together: what lies in which body, and where the values of what is named are found.

use super::JointKind;
use super::bindings::mjGEOM_MESH;
use super::model::{Model, slice, slice_mut};

impl Model {
    /// Where a joint's values begin in `qpos` and in `qvel`.
    pub fn joint_addresses(&self, joint: usize) -> (usize, usize) {
        let header = self.header();
        // SAFETY: both arrays hold `njnt` values; the slice checks the index.
        let (qpos, dof) = unsafe {
            (
                slice(header.jnt_qposadr, header.njnt, 1)[joint],
                slice(header.jnt_dofadr, header.njnt, 1)[joint],
            )
        };
        (qpos as usize, dof as usize)
    }

    /// The kind of a joint.
    pub fn joint_kind(&self, joint: usize) -> JointKind {
        let header = self.header();
        // SAFETY: the array holds `njnt` values; the slice checks the index.
        let code = unsafe { slice(header.jnt_type, header.njnt, 1)[joint] };
        JointKind::of(code)
    }

    /// The limits of a joint, if it has any.
    pub fn joint_limits(&self, joint: usize) -> Option<[f64; 2]> {
        let header = self.header();
        // SAFETY: the array holds `njnt` booleans; the slice checks the index.
        let limited = unsafe { slice(header.jnt_limited, header.njnt, 1)[joint] };
        limited.then(|| [self.jnt_range()[2 * joint], self.jnt_range()[2 * joint + 1]])
    }

    /// The body of each joint, `[njnt]`.
    pub fn joint_body(&self) -> &[i32] {
        let header = self.header();
        // SAFETY: the array holds `njnt` values as long as the model lives.
        unsafe { slice(header.jnt_bodyid, header.njnt, 1) }
    }

    /// The body in which each body lies, `[nbody]`.
    pub fn body_parent(&self) -> &[i32] {
        let header = self.header();
        // SAFETY: the array holds `nbody` values as long as the model lives.
        unsafe { slice(header.body_parentid, header.nbody, 1) }
    }

    /// The body of each geom, `[ngeom]`; 0 is the world.
    pub fn geom_body(&self) -> &[i32] {
        let header = self.header();
        // SAFETY: the array holds `ngeom` values as long as the model lives.
        unsafe { slice(header.geom_bodyid, header.ngeom, 1) }
    }

    /// The shape of each geom, as MuJoCo numbers them.
    pub(super) fn geom_types(&self) -> &[i32] {
        let header = self.header();
        // SAFETY: the array holds `ngeom` values as long as the model lives.
        unsafe { slice(header.geom_type, header.ngeom, 1) }
    }

    /// The body of each site, `[nsite]`.
    pub fn site_body(&self) -> &[i32] {
        let header = self.header();
        // SAFETY: the array holds `nsite` values as long as the model lives.
        unsafe { slice(header.site_bodyid, header.nsite, 1) }
    }

    /// Where the pose of a body that is moved by hand lies among those of all such bodies.
    pub fn mocap_index(&self, body: usize) -> Option<usize> {
        let header = self.header();
        // SAFETY: the array holds `nbody` values; the slice checks the index.
        let index = unsafe { slice(header.body_mocapid, header.nbody, 1)[body] };
        usize::try_from(index).ok()
    }

    /// Lets MuJoCo test all geoms of two bodies against each other, instead of searching the trees of their bounding boxes,
    /// where one of the bodies has no mesh that touches. Contacts are the same, in the same order: trees only sort out geoms
    /// that are apart. They pay for bodies of many geoms that touch; here most geoms of a body are only looked at, and a test
    /// of bits sorts those out where there is no tree.
    pub fn search_trees_for_meshes_only(&mut self) {
        let header = self.header();
        // SAFETY: these arrays hold `nbody` and `ngeom` values as long as the model lives.
        let (first, count, kinds, of, to) = unsafe {
            (
                slice(header.body_geomadr, header.nbody, 1),
                slice(header.body_geomnum, header.nbody, 1),
                slice(header.geom_type, header.ngeom, 1),
                slice(header.geom_contype, header.ngeom, 1),
                slice(header.geom_conaffinity, header.ngeom, 1),
            )
        };
        let is_touching_mesh =
            |geom: usize| kinds[geom] == mjGEOM_MESH as i32 && (of[geom], to[geom]) != (0, 0);
        let bodies = first.iter().zip(count).enumerate();
        let simple: Vec<usize> = bodies
            .filter(|(_, (first, count))| {
                let first = usize::try_from(**first).unwrap_or_default();
                !(first..first + **count as usize).any(is_touching_mesh)
            })
            .map(|(body, _)| body)
            .collect();
        // SAFETY: the array holds `nbody` values, and `&mut self` is the only access. -1 stands for no tree.
        let trees = unsafe { slice_mut(header.body_bvhadr, header.nbody, 1) };
        for body in simple {
            trees[body] = -1;
        }
    }

    /// Where a sensor's values lie in `sensordata`.
    pub fn sensor_range(&self, sensor: usize) -> std::ops::Range<usize> {
        let header = self.header();
        // SAFETY: both arrays hold `nsensor` values; the slices check the index.
        let (start, len) = unsafe {
            (
                slice(header.sensor_adr, header.nsensor, 1)[sensor],
                slice(header.sensor_dim, header.nsensor, 1)[sensor],
            )
        };
        start as usize..(start + len) as usize
    }
}
