//! Bounds of the sizes in settings of models and agents: a file of settings must not make this program run out of memory, or count beyond
//! its numbers. What a single model allows besides is checked where it is made.

use serde_json::Value as Json;

/// The largest value of a whole number among settings, by the last part of its name. [`MOST`] holds for all others.
const BOUNDS: &[(&str, u64)] = &[
    ("batch", 1 << 20),
    ("capacity", 1 << 40),
    ("depth", 1 << 10),
    ("frameskip", 1 << 12),
    ("heads", 1 << 10),
    ("history", 1 << 12),
    ("horizon", 1 << 12),
    ("image", 1 << 12),
    ("positions_for", 1 << 12),
    ("random_steps", 1 << 40),
    ("size", 1 << 12),
    ("updates", 1 << 20),
];
/// A layer has no more inputs or outputs.
const MOST: u64 = 1 << 16;
/// More parameters take more than 16 GB.
const MOST_PARAMETERS: u128 = 1 << 32;

/// What is wrong with settings whose sizes are too large, if anything is. `dims`: sizes of the data, by name.
pub(crate) fn check_bounds(settings: &Json, dims: &[(&str, usize)]) -> Result<(), String> {
    for (name, size) in dims {
        check_size(name, name, *size as u64)?;
    }
    let mut parameters = 0_u128;
    check(settings, "", "", &mut parameters)?;
    if parameters > MOST_PARAMETERS {
        return Err(format!(
            "its layers have about {parameters} parameters, and up to {MOST_PARAMETERS} are made; use smaller sizes"
        ));
    }
    Ok(())
}

fn check_size(place: &str, name: &str, size: u64) -> Result<(), String> {
    let bound = BOUNDS.iter().find(|(bounded, _)| *bounded == name).map_or(MOST, |(_, bound)| *bound);
    if size > bound {
        return Err(format!("`{place}` is {size}; it must be at most {bound}"));
    }
    Ok(())
}

/// Checks the value of the setting `name` at `place`, and all within it.
fn check(value: &Json, place: &str, name: &str, parameters: &mut u128) -> Result<(), String> {
    match value {
        Json::Number(number) => match number.as_u64() {
            Some(size) => check_size(place, name, size),
            None if number.as_f64().is_some_and(f64::is_finite) => Ok(()),
            None => Err(format!("`{place}` is {number}; it must be a number")),
        },
        Json::Array(items) => {
            items.iter().try_for_each(|item| check(item, place, name, parameters))?;
            // Layers from each size to the next: convolutions have kernels of 3 × 3, or so.
            let sizes: Vec<u64> = items.iter().filter_map(Json::as_u64).collect();
            *parameters +=
                sizes.windows(2).map(|pair| 9 * u128::from(pair[0]) * u128::from(pair[1])).sum::<u128>();
            Ok(())
        }
        Json::Object(fields) => {
            for (name, value) in fields {
                let place = if place.is_empty() { name.clone() } else { format!("{place}.{name}") };
                check(value, &place, name, parameters)?;
            }
            let size = |name: &str| fields.get(name).and_then(Json::as_u64).unwrap_or(1);
            let mut sizes: Vec<u64> =
                ["dim", "hidden", "latent_dim", "mlp_dim", "encoder_dim", "projector", "inverse_hidden"]
                    .map(size)
                    .into_iter()
                    .chain([size("heads") * size("head_dim")])
                    .collect();
            sizes.sort_unstable();
            if let [.., second, first] = sizes[..] {
                *parameters += u128::from(first) * u128::from(second) * u128::from(size("depth"));
            }
            Ok(())
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn sizes_have_bounds() {
        for (settings, told) in [
            (
                json!({ "model": { "history": 1_000_000_000_000_u64 } }),
                "`model.history` is 1000000000000; it must be at most 4096",
            ),
            (
                json!({ "encoder": { "channels": [16, u64::MAX] } }),
                "`encoder.channels` is 18446744073709551615",
            ),
            (json!({ "predictor": { "depth": 1000, "dim": 60_000, "hidden": 60_000 } }), "parameters"),
            (json!({ "encoder": { "channels": [60_000, 60_000, 60_000] } }), "parameters"),
        ] {
            let message = check_bounds(&settings, &[]).unwrap_err();
            assert!(message.contains(told), "{message}");
        }
        let message = check_bounds(&Json::Null, &[("action_dim", 10_000_000_000)]).unwrap_err();
        assert_eq!(message, "`action_dim` is 10000000000; it must be at most 65536");
        check_bounds(&json!({ "model": { "history": 3 }, "optim": { "lr": 1e-3 } }), &[("action_dim", 2)])
            .unwrap();
    }
}
