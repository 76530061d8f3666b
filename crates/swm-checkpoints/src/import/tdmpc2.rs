//! TD-MPC2 of the reference as settings of ours.

use serde_json::json;
use swm_baselines::weights::vector_keys;
use swm_tasks::request::{Assignment, Fix, Message, TaskError};

use super::config::Node;
use super::recipe::{Given, Recipe, of, said};

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
    let pixels = said(encoding.as_ref(), "pixels", shapes.dim("pixel_encoder.weight", 0))?;
    let place = "extra_encoders.observation.";
    let first = |axis| shapes.dim(&format!("{place}0.weight"), axis);
    let vector = match column.is_empty() {
        true => None,
        false => said(encoding.as_ref(), &column, shapes.dim(&format!("{place}1.weight"), 0))?,
    };
    let dims = cfg.and_then(|cfg| cfg.get("extra_dims"));
    let observation = match vector {
        Some(_) => said(dims.as_ref(), &column, first(1))?,
        None => None,
    };
    if pixels.is_none() && observation.is_none() {
        let text =
            "it observes neither images nor a vector, by its config and its weights; no agent does that";
        return Err(Message::new(text).into());
    }
    let image = given.image.or(of(cfg, "image_size")?).filter(|_| pixels.is_some());
    if pixels.is_some() && image.is_none() {
        return Err(Message::new("no file says how large its images are").fix(Fix::set("image", 64)).into());
    }
    let actions = said(cfg, "action_dim", shapes.dim("pi.2.bias", 0).map(|both| both / 2))?.unwrap_or(2);
    let mut settings = json!({});
    for (ours, theirs, shape) in [
        ("mlp_dim", "mlp_dim", shapes.dim("dynamics.0.weight", 0)),
        ("encoder_dim", "enc_dim", first(0)),
        ("simnorm_dim", "simnorm_dim", None),
        ("num_q", "num_q", Some(shapes.count("qs.")).filter(|count| *count > 0)),
        ("num_bins", "num_bins", shapes.dim("reward.2.bias", 0)),
        ("horizon", "horizon", None),
    ] {
        if let Some(number) = said(wm, theirs, shape)? {
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
    // Costs depend on these, and no tensor shows them.
    let unsaid: Vec<&str> = ["simnorm_dim", "vmin", "vmax", "discount", "plan.uncertainty_penalty"]
        .into_iter()
        .filter(|place| {
            let pointer = format!("/{}", place.replace('.', "/"));
            settings.pointer(&pointer).is_none() && given.set.pointer(&pointer).is_none()
        })
        .collect();
    if !unsaid.is_empty() {
        let text = format!("no file says its {}, on which its costs depend", unsaid.join(", "));
        let all: Vec<String> = unsaid.iter().map(|place| format!("{place}=N")).collect();
        let settings = all.into_iter().map(|one| Assignment::of("set", one)).collect();
        return Err(Message::new(text)
            .fix(Fix::SetAll { settings, instead_of: None, to: String::new() })
            .into());
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
