//! What a scene is made of. Plain data in world coordinates, meters; colors from 0 to 1.

/// The segment of what has none: the background, and instances that opt out.
pub const NO_SEGMENT: i32 = -1;

/// Everything that is visible in one frame, apart from [`super::Assets`].
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The eye.
    pub camera: Camera,
    /// Lights, the headlight among them.
    pub lights: Vec<Light>,
    /// What there is to see, in the order in which equal depths are decided: the first wins.
    pub instances: Vec<Instance>,
    /// Index of the cube texture at infinity; without one the background is black.
    pub sky: Option<usize>,
    /// Mist between ground and sky.
    pub haze: Option<Haze>,
}

/// Where the image is taken from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Position.
    pub position: [f64; 3],
    /// Viewing direction, of length 1.
    pub forward: [f64; 3],
    /// Up, of length 1, across `forward`.
    pub up: [f64; 3],
    /// How far it opens.
    pub projection: Projection,
    /// Nothing nearer is seen, meters.
    pub near: f64,
    /// Nothing farther is seen, meters.
    pub far: f64,
}

impl Default for Camera {
    fn default() -> Self {
        let projection = Projection { bottom: -0.5, top: 0.5, center: 0.0, half_width: None };
        Self {
            position: [0.0; 3],
            forward: [0.0, 1.0, 0.0],
            up: [0.0, 0.0, 1.0],
            projection,
            near: 0.01,
            far: 100.0,
        }
    }
}

/// A perspective window at distance 1 from the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Lower edge.
    pub bottom: f64,
    /// Upper edge.
    pub top: f64,
    /// Horizontal center.
    pub center: f64,
    /// Half the width; `None`: so that pixels are square.
    pub half_width: Option<f64>,
}

/// One light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// The shape of its beam.
    pub kind: LightKind,
    /// Direction of its light, of length 1.
    pub direction: [f64; 3],
    /// Where it is; for a sun, the center of where it casts shadows.
    pub position: [f64; 3],
    /// Light from everywhere.
    pub ambient: [f32; 3],
    /// Light that surfaces scatter.
    pub diffuse: [f32; 3],
    /// Light that surfaces mirror.
    pub specular: [f32; 3],
    /// Where it casts shadows: half the width of the region for a sun (meters), the tangent of half the opening for
    /// a spot. `None`: nowhere.
    pub shadow: Option<f64>,
}

/// The shape of the beam of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LightKind {
    /// Parallel, from infinitely far away.
    Sun,
    /// From a point, brightest along its direction.
    Spot {
        /// Angle from the direction beyond which it is dark, degrees; 180: nowhere.
        cutoff: f32,
        /// How fast it darkens from the middle: a power of the cosine.
        exponent: f32,
        /// Divides the light: constant, linear and quadratic in the distance.
        attenuation: [f32; 3],
    },
}

/// One thing to see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// What it is.
    pub shape: Shape,
    /// Its center.
    pub position: [f64; 3],
    /// Rows of the matrix whose columns are its axes.
    pub rotation: [[f64; 3]; 3],
    /// How it looks.
    pub material: Material,
    /// What segmentation images show for it.
    pub segment: i32,
    /// Whether it casts shadows.
    pub casts_shadow: bool,
}

/// What an instance is, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Shape {
    /// The plane z = 0, seen from above. `half`: half lengths along x and y, 0 for endless.
    Plane {
        /// Half lengths.
        half: [f32; 2],
        /// Lighting is computed at the corners of cells this long and interpolated between them, as the
        /// fixed-function pipeline does with a plane's facets; 0: everywhere.
        cell: [f32; 2],
    },
    /// A ball, or stretched along its axes.
    Ellipsoid {
        /// Half lengths.
        radii: [f32; 3],
    },
    /// A cylinder along z with a half ball at either end.
    Capsule {
        /// Of cylinder and balls.
        radius: f32,
        /// Half the length of the cylinder.
        half: f32,
    },
    /// A closed cylinder along z.
    Cylinder {
        /// Radius.
        radius: f32,
        /// Half its length.
        half: f32,
    },
    /// A box.
    Box {
        /// Half lengths.
        half: [f32; 3],
    },
    /// A mesh of [`super::Assets`], by index.
    Mesh(usize),
}

/// How a surface looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Red, green, blue, opacity.
    pub color: [f32; 4],
    /// Share of the color that it shines by itself.
    pub emission: f32,
    /// Strength of highlights.
    pub specular: f32,
    /// Power of highlights: larger is smaller and sharper.
    pub shininess: f32,
    /// Share of the light that a plane (or the top of a box) mirrors.
    pub reflectance: f32,
    /// What is painted on it.
    pub texture: Option<Mapping>,
}

impl Default for Material {
    fn default() -> Self {
        Self {
            color: [0.5, 0.5, 0.5, 1.0],
            emission: 0.0,
            specular: 0.5,
            shininess: 64.0,
            reflectance: 0.0,
            texture: None,
        }
    }
}

/// How a texture lies on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Mapping {
    /// A flat texture, by index: (u, v) = scale × (x, y) + offset in the instance's own frame.
    Flat {
        /// Index of the texture.
        texture: usize,
        /// Periods per meter.
        scale: [f32; 2],
        /// At the center.
        offset: [f32; 2],
    },
    /// A cube texture, by index, seen from the instance's center: looked up in the direction scale × (x, y, z).
    Cube {
        /// Index of the texture.
        texture: usize,
        /// Per axis.
        scale: [f32; 3],
    },
}

/// Mist where an endless ground meets the sky.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Haze {
    /// Its color.
    pub color: [f32; 3],
    /// How wide it is: 0 none, 1 up to the zenith.
    pub width: f32,
    /// Upward direction of the ground, of length 1.
    pub up: [f64; 3],
    /// The eye's height above the ground over the distance of the sky.
    pub elevation: f32,
}
