//! Layers and networks that the baselines share, on tensors. They know no data, no loss and no file.
//!
//! Each has the form of the reference's PyTorch module, to the names of its tensors, so that weights go both ways;
//! `src/parity` compares them value by value. Train and evaluation differ by the [`Pass`] alone.
//!
//! [`Pass`]: crate::pass::Pass

mod activation;
mod attention;
mod background;
mod cnn;
mod convolution;
mod countdown;
mod drawing;
mod embed;
mod feature_map;
mod film;
mod frames;
mod goal;
mod image_translator;
mod keypoints;
mod latent_change;
mod latent_moments;
mod layers;
mod metric;
mod norm;
mod predictor;
mod projector;
mod vit;

pub(crate) use activation::mish;
pub(crate) use background::Background;
pub(crate) use cnn::Cnn;
pub use cnn::CnnConfig;
pub(crate) use countdown::{CountdownPredictor, CountdownSizes, Looks};
pub(crate) use drawing::Drawing;
pub(crate) use embed::{ActionEmbedder, StateEmbedder};
pub(crate) use feature_map::FeatureMapEncoder;
pub(crate) use film::FilmPredictor;
pub use film::FilmPredictorConfig;
pub(crate) use frames::FramePredictor;
pub(crate) use goal::{Critic, GoalPredictor, QHead, TokenForm, ValueNetwork};
pub use goal::{GoalTransformerConfig, Pool};
pub(crate) use image_translator::{HALVINGS, ImageTranslator, coordinates};
pub use keypoints::KeypointConfig;
pub(crate) use keypoints::Keypoints;
pub(crate) use latent_change::{LatentChange, LatentChangeSizes};
pub(crate) use latent_moments::LatentMoments;
pub(crate) use layers::{Conv, Linear, parameter};
pub(crate) use metric::MetricValue;
pub(crate) use norm::LayerNorm;
pub use predictor::PredictorConfig;
pub(crate) use predictor::{Predictor, SeenStates};
pub(crate) use projector::{InverseDynamics, Mlp};
pub use vit::VitConfig;
pub(crate) use vit::{Vit, vit_epsilon};
