//! Colors as people write them: `#ff0000`, `red`, `255,0,0` and `1.0,0,0`, for factors of either range.

use swm_core::Space;

/// Names of colors (those of CSS), and their values.
const NAMES: &[(&str, [u8; 3])] = &[
    ("black", [0, 0, 0]),
    ("blue", [0, 0, 255]),
    ("brown", [165, 42, 42]),
    ("cyan", [0, 255, 255]),
    ("gray", [128, 128, 128]),
    ("green", [0, 128, 0]),
    ("grey", [128, 128, 128]),
    ("lime", [0, 255, 0]),
    ("magenta", [255, 0, 255]),
    ("navy", [0, 0, 128]),
    ("orange", [255, 165, 0]),
    ("pink", [255, 192, 203]),
    ("purple", [128, 0, 128]),
    ("red", [255, 0, 0]),
    ("teal", [0, 128, 128]),
    ("white", [255, 255, 255]),
    ("yellow", [255, 255, 0]),
];

/// The values of a color factor.
#[derive(Debug, PartialEq)]
pub struct ColorValues {
    /// As the factor takes them, `[3 C]` for C colors: 0–255 or 0–1.
    pub values: Vec<f64>,
    /// How the text was read, where it could have been read otherwise.
    pub read_as: Option<String>,
}

/// Reads `text` for the factor `name`, if that is a color: one or several hexadecimal or named colors, or numbers of the
/// range 0–255 or 0–1. Numbers of the other range than the factor's are converted where they cannot be meant otherwise.
///
/// # Errors
///
/// A sentence: no such color.
pub fn color_values(space: &Space, name: &str, text: &str) -> Result<Option<ColorValues>, String> {
    let Some(is_bytes) = is_byte_color(space, name) else { return Ok(None) };
    let given: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let wanted = space.shape().iter().product::<usize>() / 3;
    let holds = || {
        let example = ["red", "blue"].iter().cycle().take(wanted).copied().collect::<Vec<_>>().join(",");
        let colors = if wanted == 1 { "color" } else { "colors" };
        format!("the factor holds {wanted} {colors}, such as {example}")
    };
    if given.as_ref().is_some_and(|given| given.len() % 3 == 0 && given.len() != 3 * wanted) {
        return Err(holds());
    }
    let Some(given) = given else {
        let colors: Vec<[u8; 3]> =
            text.split(',').map(|part| named(part.trim())).collect::<Result<_, _>>()?;
        if colors.len() != wanted {
            return Err(holds());
        }
        let scale = if is_bytes { 1.0 } else { 1.0 / 255.0 };
        let values = colors.iter().flatten().map(|&value| f64::from(value) * scale).collect();
        return Ok(Some(ColorValues { values, read_as: None }));
    };
    let has_point = text.contains('.');
    let within = |high: f64| given.iter().all(|value| (0.0..=high).contains(value));
    let (values, range): (Vec<f64>, _) = match is_bytes {
        // `1,0,0` is a very dark red; `1.0,0,0` is not meant so.
        true if has_point && within(1.0) => {
            (given.iter().map(|value| (value * 255.0).round()).collect(), "0–1")
        }
        false if !has_point && within(255.0) && !within(1.0) => {
            (given.iter().map(|value| value / 255.0).collect(), "0–255")
        }
        _ => return Ok(Some(ColorValues { values: given, read_as: None })),
    };
    let list = values.iter().map(|value| format!("{}", (value * 1e4).round() / 1e4)).collect::<Vec<_>>();
    let read_as = Some(format!("read as a color of the range {range}: {}", list.join(",")));
    Ok(Some(ColorValues { values, read_as }))
}

/// Whether a factor holds colors of 0–255 (`true`) or of 0–1 (`false`); `None` if it holds no colors.
fn is_byte_color(space: &Space, name: &str) -> Option<bool> {
    let is_color = name.rsplit('.').next().is_some_and(|leaf| leaf.contains("color"));
    let of_three = space.shape().last() == Some(&3);
    match space {
        Space::Rgb => Some(true),
        Space::Box { .. } if is_color && of_three => {
            let (low, high) = space.bounds();
            let is_unit = low.iter().all(|&low| low >= 0.0) && high.iter().all(|&high| high <= 1.0);
            Some(!is_unit)
        }
        _ => None,
    }
}

fn named(text: &str) -> Result<[u8; 3], String> {
    if let Some(hex) = text.strip_prefix('#') {
        // As in CSS, #rgb is #rrggbb.
        let hex =
            if hex.len() == 3 { hex.chars().flat_map(|digit| [digit; 2]).collect() } else { hex.to_owned() };
        let digits = u32::from_str_radix(&hex, 16).ok().filter(|_| hex.len() == 6);
        let [_, rgb @ ..] = digits
            .ok_or_else(|| format!("`{text}` is no color; write #rrggbb, such as #ff8000"))?
            .to_be_bytes();
        return Ok(rgb);
    }
    let known = NAMES.iter().find(|(name, _)| name.eq_ignore_ascii_case(text));
    known.map(|&(_, rgb)| rgb).ok_or_else(|| {
        let names: Vec<&str> = NAMES.iter().map(|(name, _)| *name).collect();
        format!("`{text}` is no color; write #rrggbb, three numbers, or one of {}", names.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use swm_core::Dtype;

    use super::*;

    #[test]
    fn colors_are_read_in_every_form_for_either_range() {
        let unit = Space::uniform_box(Dtype::F64, &[3], 0.0, 1.0);
        let read = |space: &Space, text: &str| color_values(space, "agent.color", text).unwrap().unwrap();
        let values = |space: &Space, text: &str| read(space, text).values;
        for text in ["#FF0000", "#f00", "red", "255,0,0", "1.0,0.0,0.0"] {
            assert_eq!(values(&Space::Rgb, text), [255.0, 0.0, 0.0], "{text}");
            assert_eq!(values(&unit, text), [1.0, 0.0, 0.0], "{text}");
        }
        assert_eq!(values(&Space::Rgb, "1,0,0"), [1.0, 0.0, 0.0], "a very dark red");
        assert_eq!(values(&unit, "1,0,0"), [1.0, 0.0, 0.0]);
        assert!(read(&Space::Rgb, "0.5,0,0").read_as.unwrap().contains("0–1: 128,0,0"));
        assert!(read(&unit, "51,0,0").read_as.unwrap().contains("0–255: 0.2,0,0"));
        assert_eq!(read(&unit, "0.2,0,0").read_as, None);
        let checker = Space::uniform_box(Dtype::F64, &[2, 3], 0.0, 1.0);
        assert_eq!(values(&checker, "red,#0000ff"), [1.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let message = color_values(&checker, "floor.color", "red").unwrap_err();
        assert_eq!(message, "the factor holds 2 colors, such as red,blue");
        assert_eq!(color_values(&unit, "agent.position", "51,0,0"), Ok(None), "not every triple is a color");
        assert!(color_values(&unit, "agent.color", "reddish").unwrap_err().contains("teal"));
        assert!(color_values(&unit, "agent.color", "#ff00").unwrap_err().contains("#rrggbb"));
    }
}
