//! What may be chosen of images, the same for all environments: read, described, with its defaults.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use swm_core::{EnvConfig, EnvError, Setting};
use swm_render::scene::Quality;

/// The part of an environment's settings that is about images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Imagesettings {
    pub(super) renderer: Renderer,
    /// Whose image is the column `pixels`; `None`: the environment's own.
    pub(super) camera: Option<CameraName>,
    /// Whose images are the columns `pixels.<camera>`.
    pub(super) cameras: CameraNames,
    pub(super) depth: bool,
    pub(super) segmentation: bool,
    antialias: bool,
    shadows: bool,
    reflections: bool,
}

impl Default for Imagesettings {
    fn default() -> Self {
        let Quality { antialias, shadows, reflections } = Quality::default();
        Self {
            renderer: Renderer::default(),
            camera: None,
            cameras: CameraNames::default(),
            depth: false,
            segmentation: false,
            antialias,
            shadows,
            reflections,
        }
    }
}

impl Imagesettings {
    pub(super) fn quality(&self) -> Quality {
        let Self { antialias, shadows, reflections, .. } = *self;
        Quality { antialias, shadows, reflections }
    }
}

/// How many settings [`image_settings`] describes: one per field of [`Imagesettings`].
pub(crate) const IMAGE_SETTINGS: usize = 8;

/// Describes the settings of images, behind `own` ones; `camera`: the default one, in words.
pub(crate) const fn with_image_settings<const OWN: usize, const ALL: usize>(
    own: [Setting; OWN],
    camera: &'static str,
) -> [Setting; ALL] {
    assert!(ALL == OWN + IMAGE_SETTINGS, "one place for each");
    let images = image_settings(camera);
    let mut all = [images[0]; ALL];
    let mut index = 0;
    while index < ALL {
        all[index] = if index < OWN { own[index] } else { images[index - OWN] };
        index += 1;
    }
    all
}

const fn image_settings(camera: &'static str) -> [Setting; IMAGE_SETTINGS] {
    [
        Setting {
            name: "renderer",
            doc: "what draws images: `software` needs nothing; `gl` is MuJoCo's own, with OpenGL through EGL or OSMesa",
            default: "software",
        },
        Setting {
            name: "camera",
            doc: "the model's camera that `pixels` is taken from, by index or name",
            default: camera,
        },
        Setting {
            name: "cameras",
            doc: "more cameras, each with a column `pixels.<camera>`: a list of indices or names, or names with commas",
            default: "none",
        },
        Setting {
            name: "depth",
            doc: "whether there is a column `pixels_depth`, f32 in meters along the camera's axis, for each camera",
            default: "false",
        },
        Setting {
            name: "segmentation",
            doc: "whether there is a column `pixels_segmentation`, i32 indices of geoms, -2 - index for sites, -1 for nothing, for each camera",
            default: "false",
        },
        Setting {
            name: "antialias",
            doc: "whether edges are smooth; of the renderer `software`",
            default: "true",
        },
        Setting {
            name: "shadows",
            doc: "whether lights cast shadows; of the renderer `software`",
            default: "true",
        },
        Setting {
            name: "reflections",
            doc: "whether floors mirror; of the renderer `software`",
            default: "true",
        },
    ]
}

/// Reads the settings of an environment that has these.
pub(crate) fn read<T: DeserializeOwned>(
    config: &EnvConfig,
    env: &str,
    known: &[Setting],
) -> Result<T, EnvError> {
    let is_known = |name: &str| known.iter().any(|setting| setting.name == name);
    if let Some(name) = config.settings.keys().find(|name| !is_known(name)) {
        let names: Vec<&str> = known.iter().map(|setting| setting.name).collect();
        let reason = format!("unknown setting `{name}`; there are {}", names.join(", "));
        return Err(EnvError::Setting { env: env.to_owned(), reason });
    }
    config.parse_settings(env)
}

/// What draws images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Renderer {
    /// Our own.
    #[default]
    Software,
    /// MuJoCo's.
    Gl,
}

impl Renderer {
    /// In words and with its version.
    pub(super) fn describe(self) -> String {
        match self {
            Self::Software => format!("swm-render {} (software)", env!("CARGO_PKG_VERSION")),
            Self::Gl => format!("MuJoCo {} (OpenGL)", crate::assets::MUJOCO_VERSION),
        }
    }
}

/// A camera of the model.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum CameraName {
    Index(usize),
    Name(String),
}

/// Cameras of the model: a list, or names with commas between them.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum CameraNames {
    List(Vec<CameraName>),
    Index(usize),
    Names(String),
}

impl Default for CameraNames {
    fn default() -> Self {
        Self::List(Vec::new())
    }
}

impl CameraNames {
    pub(super) fn list(&self) -> Vec<CameraName> {
        match self {
            Self::List(list) => list.clone(),
            Self::Index(index) => vec![CameraName::Index(*index)],
            Self::Names(names) => {
                let names = names.split(',').map(str::trim).filter(|name| !name.is_empty());
                names
                    .map(|name| {
                        name.parse().map_or_else(|_| CameraName::Name(name.to_owned()), CameraName::Index)
                    })
                    .collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_named_in_every_way() {
        let read = |text: &str| serde_json::from_str::<CameraNames>(text).map(|names| names.list());
        let name = |text: &str| CameraName::Name(text.to_owned());
        assert_eq!(read(r#"["back", 1]"#).unwrap(), [name("back"), CameraName::Index(1)]);
        assert_eq!(read(r#""back, 1""#).unwrap(), [name("back"), CameraName::Index(1)]);
        assert_eq!(read("2").unwrap(), [CameraName::Index(2)]);
        assert_eq!(read(r#""""#).unwrap(), []);
        assert!(read("1.5").is_err());
    }
}
