//! The simple YAML that OmegaConf writes: nested mappings of scalars, and lists of them. Anchors, tags and texts of several lines
//! are not read.

use serde_json::{Map, Value as Json};

/// The values of a text; `Err` is the line that cannot be read.
pub(super) fn parse(text: &str) -> Result<Json, usize> {
    let lines: Vec<(usize, usize, &str)> = text
        .lines()
        .enumerate()
        .filter(|(_, line)| !line.trim().is_empty() && !line.trim_start().starts_with('#') && *line != "---")
        .map(|(number, line)| (number + 1, line.len() - line.trim_start().len(), line.trim()))
        .collect();
    let mut at = 0;
    let value = block(&lines, &mut at, 0)?;
    match lines.get(at) {
        Some((number, ..)) => Err(*number),
        None => Ok(value),
    }
}

/// The deepest nesting.
const DEEPEST: usize = 64;

/// The lines from `at` on that are indented as the first.
fn block(lines: &[(usize, usize, &str)], at: &mut usize, depth: usize) -> Result<Json, usize> {
    let Some(&(number, indent, first)) = lines.get(*at) else { return Ok(Json::Object(Map::new())) };
    if depth > DEEPEST {
        return Err(number);
    }
    if first.starts_with("- ") || first == "-" {
        let mut items = Vec::new();
        let is_item = |(_, here, line): &&(usize, usize, &str)| *here == indent && line.starts_with('-');
        while let Some((.., line)) = lines.get(*at).filter(is_item) {
            items.push(scalar(line[1..].trim()));
            *at += 1;
        }
        return Ok(Json::Array(items));
    }
    let mut map = Map::new();
    while let Some(&(number, _, line)) = lines.get(*at).filter(|(_, here, _)| *here == indent) {
        let (key, value) = match line.split_once(": ") {
            Some((key, value)) => (key, value.trim()),
            None => (line.strip_suffix(':').ok_or(number)?, ""),
        };
        *at += 1;
        let inner = lines
            .get(*at)
            .filter(|(_, here, line)| *here > indent || (*here == indent && line.starts_with("- ")));
        let value = match (value, inner) {
            ("", Some(_)) => block(lines, at, depth + 1)?,
            (value, _) => scalar(value),
        };
        map.insert(key.trim_matches(['"', '\'']).to_owned(), value);
    }
    Ok(Json::Object(map))
}

fn scalar(text: &str) -> Json {
    match text {
        "" | "null" | "~" => Json::Null,
        "true" => true.into(),
        "false" => false.into(),
        _ if text.starts_with(['"', '\'']) => text.trim_matches(['"', '\'']).into(),
        _ => match (text.parse::<i64>(), text.parse::<f64>()) {
            (Ok(number), _) => number.into(),
            (_, Ok(number)) if number.is_finite() => number.into(),
            _ => text.into(),
        },
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn mappings_scalars_and_lists_are_read() {
        let text = "img_size: 64\nmodel:\n  _target_: a.B\n  rates: \n  - 1\n  - 2.5\n  deep:\n    on: true\nname: null\n";
        let wanted = json!({ "img_size": 64, "model": { "_target_": "a.B", "rates": [1, 2.5], "deep": { "on": true } }, "name": null });
        assert_eq!(parse(text).unwrap(), wanted);
        assert_eq!(parse("a: 1\nb\n"), Err(2));
        assert_eq!(parse("a: 1\n    b: 2\n"), Err(2));
    }
}
