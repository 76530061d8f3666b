//! The templates of HTML pages, in the folder `templates`.

use minijinja::{Environment, Error, ErrorKind, UndefinedBehavior, Value};
use serde_json::Value as Json;

use crate::error::TaskError;
use crate::svg::number;

macro_rules! templates {
    ($($name:literal),* $(,)?) => { [$(($name, include_str!(concat!("../templates/", $name)))),*] };
}

const TEMPLATES: [(&str, &str); 13] = templates![
    "board.html",
    "page.html",
    "plan.html",
    "report.html",
    "report/episodes.html",
    "report/factors.html",
    "report/label.html",
    "report/overview.html",
    "report/plans.html",
    "report/receipts.html",
    "report/videos.html",
    "script.js",
    "style.css",
];

/// Renders a template. Values are escaped, except those that are marked as safe.
pub(crate) fn render(template: &str, context: Value) -> Result<String, TaskError> {
    let mut engine = Environment::new();
    engine.set_undefined_behavior(UndefinedBehavior::SemiStrict);
    for (name, text) in TEMPLATES {
        engine.add_template(name, text)?;
    }
    engine.add_filter("fixed", |value: Value, digits: usize| of(&value, |value| format!("{value:.digits$}")));
    engine.add_filter("signed", |value: Value| of(&value, |value| format!("{value:+.1}")));
    engine.add_filter("short", |value: Value| of(&value, number));
    engine.add_filter("range", |ends: Value| {
        let end = |index| ends.get_item_by_index(index).and_then(|end| of(&end, |end| format!("{end:.1}")));
        if ends.is_none() { Ok("–".to_owned()) } else { Ok(format!("{} to {}", end(0)?, end(1)?)) }
    });
    engine.add_filter("p_value", |value: Value| {
        of(&value, |p| if p < 0.0001 { "< 0.0001".to_owned() } else { format!("{p:.4}") })
    });
    Ok(engine.get_template(template)?.render(context)?)
}

/// A JSON value for a template.
pub(crate) fn of_json(json: &Json) -> Value {
    match json {
        Json::Null => Value::from(()),
        Json::Bool(value) => Value::from(*value),
        Json::Number(number) => match (number.as_i64(), number.as_f64()) {
            (Some(whole), _) => Value::from(whole),
            (None, real) => Value::from(real),
        },
        Json::String(text) => Value::from(text.as_str()),
        Json::Array(items) => items.iter().map(of_json).collect(),
        Json::Object(map) => {
            Value::from_pairs(map.iter().map(|(name, value)| (name.as_str(), of_json(value))))
        }
    }
}

/// A number as text; a dash for none.
fn of(value: &Value, text: impl Fn(f64) -> String) -> Result<String, Error> {
    if value.is_none() {
        return Ok("–".to_owned());
    }
    let number = f64::try_from(value.clone());
    number
        .map(text)
        .map_err(|error| Error::new(ErrorKind::InvalidOperation, "not a number").with_source(error))
}

#[cfg(test)]
mod tests {
    use minijinja::context;

    use super::*;

    #[test]
    fn text_is_escaped_and_figures_are_not() {
        let (title, policy) = ("<Two & \"Room\">", "cem:a<b");
        let costs = Value::from_safe_string("<svg></svg>".to_owned());
        let (videos, empty) = (Vec::<Value>::new(), Vec::<Value>::new());
        let page = context! { title, policy, costs, videos, outcome => "", seed => 1, table => &empty, plans => empty };
        let html = render("plan.html", page).unwrap();
        assert!(
            html.contains("<h1>&lt;Two &amp; &quot;Room&quot;&gt;</h1>") && html.contains("cem:a&lt;b"),
            "{html}"
        );
        assert!(html.contains("<figure><svg></svg></figure>"), "{html}");
        assert!(render("plan.html", context! { title }).is_err(), "a value is missing");
    }

    #[test]
    fn numbers_without_a_value_are_dashes() {
        assert_eq!(of(&Value::from(()), number).unwrap(), "–");
        assert_eq!(of(&Value::from(2.5), |value| format!("{value:+.1}")).unwrap(), "+2.5");
        assert!(of(&Value::from("text"), number).is_err());
    }
}
