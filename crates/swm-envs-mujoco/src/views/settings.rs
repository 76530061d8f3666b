//! Settings of images, the same for all environments.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use swm_core::settings::WrongSetting;
use swm_core::{EnvConfig, EnvError, Setting};
use swm_render::scene::Quality;

swm_core::settings! {
    /// The part of an environment's settings that is about images.
    pub(crate) struct ImageSettings {
        /// Renderer of images: `software` needs nothing; `gl` is MuJoCo's own, with OpenGL through EGL or OSMesa.
        renderer: Renderer = Renderer::Software => "software",
        /// The model's camera that `pixels` is rendered from, by index or name.
        camera: Option<CameraName> = None => "the environment's",
        /// More cameras, each with a column `pixels.<camera>`: a list of indices or names, or names with commas.
        cameras: CameraNames = CameraNames::List(Vec::new()) => "none",
        /// Whether there is a column `pixels_depth`, f32 in meters along the camera's axis, for each camera.
        depth: bool = false,
        /// Whether there is a column `pixels_segmentation`, i32 indices of geoms, -2 - index for sites, -1 for nothing, for
        /// each camera.
        segmentation: bool = false,
        /// Whether edges are antialiased; of the renderer `software`.
        antialias: bool = true,
        /// Whether lights cast shadows; of the renderer `software`.
        shadows: bool = true,
        /// Whether floors reflect; of the renderer `software`.
        reflections: bool = true,
    }
}

impl ImageSettings {
    pub(super) fn quality(&self) -> Quality {
        let Self { antialias, shadows, reflections, .. } = *self;
        Quality { antialias, shadows, reflections }
    }
}

/// Reads the settings of an environment that has these.
pub(crate) fn read<T: DeserializeOwned>(
    config: &EnvConfig,
    env: &str,
    known: &[Setting],
) -> Result<T, EnvError> {
    let is_known = |name: &str| known.iter().any(|setting| setting.name == name);
    if let Some(name) = config.settings.keys().find(|name| !is_known(name)) {
        let wrong = WrongSetting::unknown(name, known.iter().map(|setting| setting.name));
        return Err(EnvError::Setting { env: env.to_owned(), reason: wrong.to_string() });
    }
    config.parse_settings(env)
}

/// Renderer of images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Renderer {
    /// swm-render's.
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
            Self::Gl => format!("MuJoCo {} (OpenGL)", swm_mujoco::assets::MUJOCO_VERSION),
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
    use swm_core::testing::assert_documented_defaults;

    use super::*;

    #[test]
    fn images_have_the_default_quality() {
        assert_documented_defaults::<ImageSettings>();
        assert_eq!(ImageSettings::default().quality(), Quality::default());
    }

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
