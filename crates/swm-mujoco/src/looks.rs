//! What images need to know of a model: its meshes, its ground, its haze. Textures, which can be edited, are in `model.rs`.

use super::model::{Model, slice};

/// A mesh, as it is drawn.
pub struct MeshData {
    /// Positions, m.
    pub points: Vec<[f32; 3]>,
    /// Indices of three points each.
    pub faces: Vec<[u32; 3]>,
    /// Outward directions at the corners of each face.
    pub normals: Vec<[[f32; 3]; 3]>,
}

/// What images need to know of a model as a whole.
pub struct Looks {
    /// Half the width of the region in which suns cast shadows, m.
    pub shadow_clip: f64,
    /// The part of a spot's opening in which it casts shadows.
    pub shadow_scale: f64,
    /// Width of the haze.
    pub haze: f32,
    /// Its color.
    pub haze_color: [f32; 3],
}

/// A height field: ground over a grid.
pub struct GroundData {
    /// Rows and columns.
    pub size: [usize; 2],
    /// `[rows, columns]`: height of the surface, m.
    pub heights: Vec<f32>,
    /// Half its length along x and y, m.
    pub half: [f32; 2],
    /// How far it reaches down below zero, m.
    pub base: f32,
}

impl Model {
    /// The points, faces and the normals of the faces' corners of a mesh.
    pub fn mesh(&self, mesh: usize) -> MeshData {
        let header = self.header();
        // SAFETY: the arrays hold `nmesh` rows each, and the rows that they name lie within those of points, faces and
        // normals, which the compiler made so; the slices check every index.
        unsafe {
            let of = |array: *mut i32| slice(array, header.nmesh, 1)[mesh] as usize;
            let triple = |values: &[f32], row: usize| [0, 1, 2].map(|k| values[3 * row + k]);
            let corners = |values: &[i32], row: usize| [0, 1, 2].map(|k| values[3 * row + k] as usize);
            let points = slice(header.mesh_vert, header.nmeshvert, 3);
            let normals = slice(header.mesh_normal, header.nmeshnormal, 3);
            let faces = slice(header.mesh_face, header.nmeshface, 3);
            let face_normals = slice(header.mesh_facenormal, header.nmeshface, 3);
            let (first, count) = (of(header.mesh_vertadr), of(header.mesh_vertnum));
            let (face, face_count) = (of(header.mesh_faceadr), of(header.mesh_facenum));
            let first_normal = of(header.mesh_normaladr);
            MeshData {
                points: (first..first + count).map(|row| triple(points, row)).collect(),
                faces: (face..face + face_count).map(|row| corners(faces, row).map(|c| c as u32)).collect(),
                normals: (face..face + face_count)
                    .map(|row| corners(face_normals, row).map(|c| triple(normals, first_normal + c)))
                    .collect(),
            }
        }
    }

    /// How many meshes there are.
    pub fn mesh_count(&self) -> usize {
        self.header().nmesh as usize
    }

    /// What images need to know of the model as a whole.
    pub fn looks(&self) -> Looks {
        let (visual, extent) = (&self.header().vis, self.header().stat.extent);
        Looks {
            shadow_clip: f64::from(visual.map.shadowclip) * extent,
            shadow_scale: f64::from(visual.map.shadowscale),
            haze: visual.map.haze,
            haze_color: [visual.rgba.haze[0], visual.rgba.haze[1], visual.rgba.haze[2]],
        }
    }

    /// How many height fields there are.
    pub fn ground_count(&self) -> usize {
        self.header().nhfield as usize
    }

    /// A height field.
    pub fn ground(&self, index: usize) -> GroundData {
        let header = self.header();
        // SAFETY: the arrays hold `nhfield` rows each, which the compiler made to lie within `hfield_data`; the slices check the
        // index and the range.
        unsafe {
            let of = |array: *mut i32| slice(array, header.nhfield, 1)[index] as usize;
            let (rows, columns, first) =
                (of(header.hfield_nrow), of(header.hfield_ncol), of(header.hfield_adr));
            let size = &slice(header.hfield_size, header.nhfield, 4)[4 * index..][..4];
            let shares = &slice(header.hfield_data, header.nhfielddata, 1)[first..][..rows * columns];
            GroundData {
                size: [rows, columns],
                heights: shares.iter().map(|&share| share * size[2] as f32).collect(),
                half: [size[0] as f32, size[1] as f32],
                base: size[3] as f32,
            }
        }
    }

    /// Whether its meshes and height fields are those of `other`.
    pub fn has_shapes_of(&self, other: &Model) -> bool {
        let (a, b) = (self.header(), other.header());
        // SAFETY: each array holds as many rows as its count says.
        unsafe {
            slice(a.mesh_vertnum, a.nmesh, 1) == slice(b.mesh_vertnum, b.nmesh, 1)
                && slice(a.mesh_vert, a.nmeshvert, 3) == slice(b.mesh_vert, b.nmeshvert, 3)
                && slice(a.mesh_face, a.nmeshface, 3) == slice(b.mesh_face, b.nmeshface, 3)
                && slice(a.hfield_nrow, a.nhfield, 1) == slice(b.hfield_nrow, b.nhfield, 1)
                && slice(a.hfield_size, a.nhfield, 4) == slice(b.hfield_size, b.nhfield, 4)
                && slice(a.hfield_data, a.nhfielddata, 1) == slice(b.hfield_data, b.nhfielddata, 1)
        }
    }
}
