//! TD-MPC2 in the reference's words.

use serde_json::{Map, Value as Json, json};
use swm_baselines::online::OnlineConfig;
use swm_baselines::online::tdmpc2::Tdmpc2Config;

use super::layout::{Layout, Unfit};

/// Channels of the reference's convolutions.
const CHANNELS: usize = 32;

/// A TD-MPC2.
pub(super) fn layout(run: &OnlineConfig) -> Result<Layout, Unfit> {
    let settings: Tdmpc2Config = serde_json::from_value(run.agent.settings.clone())
        .map_err(|error| format!("its settings cannot be read: {error}"))?;
    let interface = &run.interface;
    if interface.image.is_some() && settings.image.channels != CHANNELS {
        return Err(format!(
            "its convolutions have {} channels (`image.channels`), and the reference's have {CHANNELS}",
            settings.image.channels
        )
        .into());
    }
    let column = match &interface.columns[..] {
        [] => None,
        [one] => Some(one.clone()),
        several => {
            return Err(format!(
                "it observes {} as one vector, and the reference has an encoder of each",
                several.join(" and ")
            )
            .into());
        }
    };
    let (mut encoding, mut extra) = (Map::new(), Map::new());
    let actions = run.agent.action_dim;
    extra.insert("action".to_owned(), actions.into());
    if interface.image.is_some() {
        let latent = settings.image.latent_dim.unwrap_or(settings.latent_dim);
        encoding.insert("pixels".to_owned(), latent.into());
    }
    if let Some(column) = &column {
        encoding.insert(column.clone(), settings.latent_dim.into());
        extra.insert(column.clone(), interface.observation_dim.into());
    }
    let config = json!({
        "_target_": "stable_worldmodel.wm.tdmpc2.TDMPC2",
        "_recursive_": false,
        "cfg": {
            "image_size": interface.image.unwrap_or(settings.image.size),
            "wm": {
                "name": "tdmpc2", "horizon": settings.horizon, "mlp_dim": settings.mlp_dim, "enc_dim": settings.encoder_dim,
                "simnorm_dim": settings.simnorm_dim, "num_q": settings.num_q, "num_bins": settings.num_bins,
                "vmin": number(settings.vmin), "vmax": number(settings.vmax), "discount": settings.discount.unwrap_or(1.0),
                "rho": settings.rho, "tau": settings.tau, "consistency_coef": settings.consistency_coef,
                "reward_coef": settings.reward_coef, "value_coef": settings.value_coef,
                "entropy_coef": settings.entropy_coef, "uncertainty_penalty": settings.plan.uncertainty_penalty,
                "encoding": encoding,
            },
            "action_dim": actions,
            "extra_dims": extra,
        },
    });
    let mut renamed = Vec::new();
    if let Some(column) = &column {
        renamed.push(("extra_encoders.observation.".to_owned(), format!("extra_encoders.{column}.")));
    }
    let scaled = "actions are in [-1, 1], from the lower to the upper bounds of the environment's".to_owned();
    let observes = interface.observed().join(", ");
    Ok(Layout {
        config,
        renamed,
        facts: vec![("observes", observes), ("action", format!("{actions} values")), ("actions", scaled)],
        ..Layout::default()
    })
}

/// A whole number as an integer, as the reference's configs have them.
fn number(value: f64) -> Json {
    let whole = value as i64;
    if whole as f64 == value { whole.into() } else { value.into() }
}
