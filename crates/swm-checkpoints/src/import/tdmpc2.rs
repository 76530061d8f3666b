//! TD-MPC2 of the reference as settings of ours.

use serde_json::json;
use swm_baselines::weights::vector_keys;
use swm_tasks::request::{Message, TaskError};

use super::config::Node;
use super::recipe::{Given, Recipe, of};

/// A TD-MPC2; `raw` are the names of its tensors in the file.
pub(super) fn recipe<'a>(
    given: &Given<'_>,
    raw: impl Iterator<Item = &'a String>,
) -> Result<Recipe, TaskError> {
    let Given { shapes, config, .. } = given;
    let cfg = config.as_ref().map(|config| config.get("cfg").unwrap_or_else(|| config.clone()));
    let wm = cfg.as_ref().map(|cfg| cfg.need("wm")).transpose()?;
    let (cfg, wm) = (cfg.as_ref(), wm.as_ref());
    let encoding = wm.and_then(|wm| wm.get("encoding"));
    let mut keys: Vec<String> = match encoding.as_ref().and_then(Node::fields) {
        Some(fields) => fields.keys().filter(|key| *key != "pixels").cloned().collect(),
        None => vector_keys(raw),
    };
    if keys.len() > 1 {
        let keys = keys.join(", ");
        return Err(Message::new(format!(
            "it observes several vectors, {keys}; this program's TD-MPC2 observes one; `load_pretrained` in Python \
             has all"
        ))
        .into());
    }
    let column = keys.pop().unwrap_or_default();
    let encoded = |key: &str| of(encoding.as_ref(), key);
    let pixels = encoded("pixels")?.or_else(|| shapes.dim("pixel_encoder.weight", 0));
    let place = "extra_encoders.observation.";
    let vector = match column.is_empty() {
        true => None,
        false => encoded(&column)?.or_else(|| shapes.dim(&format!("{place}1.weight"), 0)),
    };
    let image = given.image.or(of(cfg, "image_size")?).filter(|_| pixels.is_some());
    if pixels.is_some() && image.is_none() {
        return Err(Message::new("no file says how large its images are")
            .fix(swm_tasks::request::Fix::set("image", 64))
            .into());
    }
    let actions =
        of(cfg, "action_dim")?.or_else(|| shapes.dim("pi.2.bias", 0).map(|both| both / 2)).unwrap_or(2);
    let said = cfg.and_then(|cfg| cfg.get("extra_dims")).map_or(Ok(None), |dims| dims.number(&column))?;
    let observation =
        said.or_else(|| shapes.dim(&format!("{place}0.weight"), 1)).filter(|_| vector.is_some());
    let mut settings = json!({});
    for (ours, theirs, shape) in [
        ("mlp_dim", "mlp_dim", shapes.dim("dynamics.0.weight", 0)),
        ("encoder_dim", "enc_dim", shapes.dim(&format!("{place}0.weight"), 0)),
        ("simnorm_dim", "simnorm_dim", None),
        ("num_q", "num_q", Some(shapes.count("qs.")).filter(|count| *count > 0)),
        ("num_bins", "num_bins", shapes.dim("reward.2.bias", 0)),
        ("horizon", "horizon", None),
    ] {
        if let Some(number) = of(wm, theirs)?.or(shape) {
            settings[ours] = number.into();
        }
    }
    for name in ["vmin", "vmax", "discount", "rho", "tau", "consistency_coef", "reward_coef", "value_coef"] {
        if let Some(value) = wm.map_or(Ok(None), |wm| wm.real(name))? {
            settings[name] = value.into();
        }
    }
    if let Some(value) = wm.map_or(Ok(None), |wm| wm.real("uncertainty_penalty"))? {
        settings["plan"]["uncertainty_penalty"] = value.into();
    }
    if let Some(latent) = vector.or(pixels) {
        settings["latent_dim"] = latent.into();
    }
    if let (Some(pixels), Some(side)) = (pixels, image) {
        let channels = shapes.dim("cnn.0.weight", 0).unwrap_or(32);
        settings["image"] = json!({ "size": side, "channels": channels, "latent_dim": pixels });
    }
    Ok(Recipe {
        name: "tdmpc2",
        settings,
        frameskip_at: None,
        block: actions,
        frameskip: Some(1),
        vector: observation.unwrap_or(0),
        column,
        image: image.unwrap_or(0),
        history: 1,
        without_encoder: false,
        action_scale: None,
    })
}
