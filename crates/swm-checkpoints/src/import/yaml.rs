//! YAML that OmegaConf writes, as JSON: mappings, lists and scalars. Nothing of it is executed: aliases and tags are refused.

use saphyr_parser::{Event, Parser, ScalarStyle};
use serde_json::{Map, Value as Json};

/// The deepest nesting.
const DEEPEST: usize = 64;

/// A mapping or a list that is not at its end.
enum Open {
    /// With the key whose value comes next.
    Map(Map<String, Json>, Option<String>),
    List(Vec<Json>),
}

/// The deepest chain of interpolations.
const LONGEST: usize = 8;

/// A config that Hydra wrote, as JSON: `${wm.embed_dim}` is the value there, and what cannot be resolved stays as it is.
///
/// # Errors
///
/// It cannot be read: the line, and why. Aliases and tags are not read, as OmegaConf writes none.
pub fn read_yaml(text: &str) -> Result<Json, String> {
    let root = parse(text)?;
    let mut resolved = root.clone();
    resolve(&mut resolved, &root);
    Ok(resolved)
}

/// Puts the values of `root` into the place of interpolations.
fn resolve(value: &mut Json, root: &Json) {
    match value {
        Json::Object(fields) => fields.values_mut().for_each(|field| resolve(field, root)),
        Json::Array(items) => items.iter_mut().for_each(|item| resolve(item, root)),
        Json::String(text) => {
            let mut found = target(text, root);
            for _ in 1..LONGEST {
                match found {
                    Some(Json::String(text)) if text.contains("${") => found = target(text, root),
                    _ => break,
                }
            }
            // Mappings are left: they could name themselves.
            if let Some(found) = found.filter(|found| !found.is_object() && !found.is_array()) {
                *value = found.clone();
            }
        }
        _ => {}
    }
}

/// What a text names that is one interpolation, by its path from the root.
fn target<'a>(text: &str, root: &'a Json) -> Option<&'a Json> {
    let path = text.strip_prefix("${")?.strip_suffix('}')?;
    path.split('.').try_fold(root, |value, name| value.get(name))
}

/// The values of the first document of a text.
fn parse(text: &str) -> Result<Json, String> {
    let mut open: Vec<Open> = Vec::new();
    for read in Parser::new_from_str(text) {
        let (event, span) =
            read.map_err(|error| format!("line {}: {}", error.marker().line(), error.info()))?;
        let wrong = |reason: &str| Err(format!("line {}: {reason}", span.start.line()));
        let value = match event {
            Event::Alias(_) => return wrong("aliases are not read"),
            Event::Scalar(.., Some(_))
            | Event::SequenceStart(_, Some(_))
            | Event::MappingStart(_, Some(_)) => {
                return wrong("tags are not read");
            }
            Event::MappingStart(..) | Event::SequenceStart(..) if open.len() >= DEEPEST => {
                return wrong("it is nested too deeply");
            }
            Event::MappingStart(..) => {
                open.push(Open::Map(Map::new(), None));
                continue;
            }
            Event::SequenceStart(..) => {
                open.push(Open::List(Vec::new()));
                continue;
            }
            Event::MappingEnd | Event::SequenceEnd => match open.pop() {
                Some(Open::Map(map, _)) => Json::Object(map),
                Some(Open::List(items)) => Json::Array(items),
                None => continue,
            },
            Event::Scalar(text, ScalarStyle::Plain, ..) => plain(&text),
            Event::Scalar(text, ..) => text.into_owned().into(),
            _ => continue,
        };
        match (open.last_mut(), value) {
            (None, value) => return Ok(value),
            (Some(Open::List(items)), value) => items.push(value),
            (Some(Open::Map(map, key)), value) => match (key.take(), value) {
                (Some(key), value) => drop(map.insert(key, value)),
                (None, Json::String(text)) => *key = Some(text),
                (None, Json::Object(_) | Json::Array(_)) => return wrong("a key is no text"),
                (None, other) => *key = Some(other.to_string()),
            },
        }
    }
    Ok(Json::Object(Map::new()))
}

fn plain(text: &str) -> Json {
    match text {
        "" | "null" | "Null" | "NULL" | "~" => Json::Null,
        "true" | "True" | "TRUE" => true.into(),
        "false" | "False" | "FALSE" => false.into(),
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
        // Lists of mappings, empty ones, keys that are numbers, a text over two lines, one that looks like a number.
        let text = "on:\n- name: a\n  at: [1, {}]\n- []\n3: '4'\nabout: one\n  two\nlr: 1.0e-05\nscale: ${loss.scale}\n";
        let wanted = json!({
            "on": [{ "name": "a", "at": [1, {}] }, []], "3": "4", "about": "one two", "lr": 1e-5, "scale": "${loss.scale}"
        });
        assert_eq!(parse(text).unwrap(), wanted);
        assert_eq!(parse("").unwrap(), json!({}));
    }

    #[test]
    fn interpolations_are_the_values_that_they_name() {
        let text = "dim: 192\nwm:\n  dim: ${dim}\n  name: m_${dim}\nmodel:\n  a: ${wm.dim}\n  b: ${wm}\n  c: ${c}\n  d: ['${dim}']\nc: ${model.c}\nid: ${hydra:job.id}\n";
        let found = read_yaml(text).unwrap();
        assert_eq!(found["wm"], json!({ "dim": 192, "name": "m_${dim}" }));
        assert_eq!(found["model"]["a"], 192);
        assert_eq!(found["model"]["b"], "${wm}");
        assert_eq!(found["model"]["d"], json!([192]));
        // It names itself.
        assert!(found["c"].as_str().unwrap().starts_with("${"));
        assert_eq!(found["id"], "${hydra:job.id}");
    }

    #[test]
    fn what_is_refused_is_named_by_its_line() {
        for (text, line) in [
            ("a: 1\nb\n", "line 3"),
            ("a: 1\n    b: 2\n", "line 2"),
            ("a: &x 1\nb: *x\n", "line 2: aliases"),
            ("a: 1\nb: !!python/tuple [1, 2]\n", "line 2: tags"),
            ("a: 1\n? [1]\n: 2\n", "line 2: a key"),
            (&"[".repeat(DEEPEST + 1), "line 1: it is nested"),
        ] {
            let found = parse(text).unwrap_err();
            assert!(found.starts_with(line), "{text}: {found}");
        }
    }
}
