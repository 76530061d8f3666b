//! Sentences about a request, which every front end words in its own syntax.

use std::fmt;

use serde::{Serialize, Serializer};
use serde_json::Value as Json;

/// A setting of a request, with the value that was given or that helps.
#[derive(Clone, Debug, PartialEq)]
pub struct Assignment {
    /// The setting's name, as the request has it: `image_size`.
    pub name: String,
    /// The value; `None`: the setting as such.
    pub value: Option<Json>,
}

/// What helps.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Fix {
    /// Give a setting. `to`: what for, `to replace it`; may be empty.
    Set {
        /// The setting and an example of its value.
        setting: Assignment,
        /// What for.
        to: &'static str,
    },
    /// Give these settings together.
    SetAll {
        /// The settings and their values.
        settings: Vec<Assignment>,
        /// A setting that is left out then.
        instead_of: Option<&'static str>,
        /// What for, `to replace it`; may be empty.
        to: String,
    },
    /// Give one of these settings a smaller value.
    Reduce(&'static [&'static str]),
    /// Give a setting another value.
    Change(&'static str),
    /// Leave out a setting.
    Leave(&'static str),
    /// One of these values.
    Choose(Vec<String>),
    /// Ask for a list of what there is.
    List(List),
    /// Do something with these settings: `record a dataset with --frame-skip 4`. `to`: what for.
    With {
        /// What to do with them.
        how: &'static str,
        /// The settings with their values.
        settings: Vec<Assignment>,
        /// What for.
        to: &'static str,
    },
    /// Any of several.
    Any(Vec<Fix>),
}

/// A list that a front end can show.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum List {
    /// The factors of variation of this environment.
    Factors(String),
    /// The solvers.
    Solvers,
}

/// A note, or the reason why a request is refused: about a setting, what is the matter, what helps.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// The setting that it is about.
    pub setting: Option<Assignment>,
    /// What is the matter; names no setting by the syntax of a front end.
    pub text: String,
    /// What helps.
    pub fix: Option<Fix>,
}

/// The syntax of a front end.
pub trait Words {
    /// A setting, with its value where there is one: `--image-size 64x64`, `image_shape=(64, 64)`.
    fn setting(&self, name: &str, value: Option<&Json>) -> String;

    /// Where a list is found: `` `swm fovs swm/PushT-v1` ``.
    fn list(&self, list: &List) -> String;
}

/// Settings by the names that the request has: `image_size=64x64`.
#[derive(Clone, Copy, Debug)]
pub struct Plain;

impl Words for Plain {
    fn setting(&self, name: &str, value: Option<&Json>) -> String {
        value.map_or_else(|| name.to_owned(), |value| format!("{name}={}", value_text(value)))
    }

    fn list(&self, list: &List) -> String {
        match list {
            List::Factors(env) => format!("the description of {env}"),
            List::Solvers => "the table of solvers".to_owned(),
        }
    }
}

/// A value as people write it: texts without quotation marks, lists with commas, image sizes as `64x64`.
pub fn value_text(value: &Json) -> String {
    match value {
        Json::String(text) => text.clone(),
        Json::Array(items) => items.iter().map(value_text).collect::<Vec<_>>().join(","),
        Json::Object(map) => match (map.get("height"), map.get("width")) {
            (Some(height), Some(width)) => format!("{height}x{width}"),
            _ => map
                .iter()
                .map(|(name, value)| format!("{name}={}", value_text(value)))
                .collect::<Vec<_>>()
                .join(","),
        },
        other => other.to_string(),
    }
}

impl Assignment {
    /// A setting as such.
    pub fn name(name: impl Into<String>) -> Self {
        Self { name: name.into(), value: None }
    }

    /// A setting with a value.
    pub fn of(name: impl Into<String>, value: impl Into<Json>) -> Self {
        Self { name: name.into(), value: Some(value.into()) }
    }

    fn in_words(&self, words: &dyn Words) -> String {
        words.setting(&self.name, self.value.as_ref())
    }
}

impl Fix {
    /// Give a setting this value.
    pub fn set(name: &'static str, value: impl Into<Json>) -> Self {
        Self::Set { setting: Assignment::of(name, value), to: "" }
    }

    /// Give a setting this value, for this.
    pub fn set_to(name: &'static str, value: impl Into<Json>, to: &'static str) -> Self {
        Self::Set { setting: Assignment::of(name, value), to }
    }

    /// Give a setting.
    pub fn give(name: &'static str) -> Self {
        Self::Set { setting: Assignment::name(name), to: "" }
    }

    /// The fix in the syntax of a front end.
    pub fn in_words(&self, words: &dyn Words) -> String {
        let name = |name: &str| words.setting(name, None);
        let all = |settings: &[Assignment]| {
            settings.iter().map(|one| one.in_words(words)).collect::<Vec<_>>().join(" and ")
        };
        match self {
            Self::Set { setting, to: "" } => format!("give {}", setting.in_words(words)),
            Self::Set { setting, to } => format!("give {} {to}", setting.in_words(words)),
            Self::SetAll { settings, instead_of, to } => {
                let left = instead_of.map_or(String::new(), |left| format!(" in place of {}", name(left)));
                let to = if to.is_empty() { String::new() } else { format!(" {to}") };
                format!("give {}{left}{to}", all(settings))
            }
            Self::Reduce(settings) => {
                let names: Vec<String> = settings.iter().map(|setting| name(setting)).collect();
                let text = match names.split_last() {
                    Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
                    _ => names.concat(),
                };
                format!("give a smaller {text}")
            }
            Self::Change(setting) => format!("give another {}", name(setting)),
            Self::Leave(setting) => format!("leave out {}", name(setting)),
            Self::Choose(values) => format!("use {}", values.join(" or ")),
            Self::With { how, settings, to } => format!("{how} {} {to}", all(settings)),
            Self::List(list) => format!("{} lists them", words.list(list)),
            Self::Any(fixes) => {
                let mut told = String::new();
                for fix in fixes {
                    let next = fix.in_words(words);
                    match told.is_empty() {
                        true => told = next,
                        false => told += &format!(", or {}", next.strip_prefix("give ").unwrap_or(&next)),
                    }
                }
                told
            }
        }
    }
}

impl Message {
    /// A message about no setting in particular.
    pub fn new(text: impl Into<String>) -> Self {
        Self { setting: None, text: text.into(), fix: None }
    }

    /// A message about a setting with this value.
    pub fn about(name: impl Into<String>, value: impl Into<Json>, text: impl Into<String>) -> Self {
        Self { setting: Some(Assignment::of(name, value)), text: text.into(), fix: None }
    }

    /// A message about a setting as such.
    pub fn about_setting(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self { setting: Some(Assignment::name(name)), text: text.into(), fix: None }
    }

    /// With what helps.
    #[must_use]
    pub fn fix(self, fix: Fix) -> Self {
        Self { fix: Some(fix), ..self }
    }

    /// The sentence in the syntax of a front end.
    pub fn in_words(&self, words: &dyn Words) -> String {
        let mut told = match &self.setting {
            Some(setting) => format!("{}: {}", setting.in_words(words), self.text),
            None => self.text.clone(),
        };
        if let Some(fix) = &self.fix {
            told += "; ";
            told += &fix.in_words(words);
        }
        told
    }
}

/// As its text, in which settings have their names.
impl Serialize for Message {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl fmt::Display for Message {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.in_words(&Plain))
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    struct Command;

    impl Words for Command {
        fn setting(&self, name: &str, value: Option<&Json>) -> String {
            let option = format!("--{}", name.replace('_', "-"));
            value.map_or(option.clone(), |value| format!("{option} {}", value_text(value)))
        }

        fn list(&self, list: &List) -> String {
            match list {
                List::Factors(env) => format!("`swm fovs {env}`"),
                List::Solvers => "`swm solvers`".to_owned(),
            }
        }
    }

    #[test]
    fn a_remedy_is_worded_by_every_front_end() {
        let size = json!({ "height": 64, "width": 48 });
        let message = Message::about("distractor", json!(["noise"]), "changes images, and there are none")
            .fix(Fix::set("image_size", size));
        assert_eq!(
            message.in_words(&Command),
            "--distractor noise: changes images, and there are none; give --image-size 64x48"
        );
        assert_eq!(
            message.to_string(),
            "distractor=noise: changes images, and there are none; give image_size=64x48"
        );
        let either = Fix::Any(vec![Fix::Change("out"), Fix::set("seed", 3), Fix::Leave("set")]);
        assert_eq!(either.in_words(&Command), "give another --out, or --seed 3, or leave out --set");
        let settings = vec![Assignment::of("mode", "append"), Assignment::of("total", 7)];
        let together =
            Fix::SetAll { settings, instead_of: Some("episodes"), to: "to complete it".to_owned() };
        assert_eq!(
            together.in_words(&Command),
            "give --mode append and --total 7 in place of --episodes to complete it"
        );
        let less = Fix::Reduce(&["max_steps", "num_envs", "image_size"]);
        assert_eq!(less.in_words(&Command), "give a smaller --max-steps, --num-envs or --image-size");
        let list = Fix::List(List::Factors("swm/Toy-v0".to_owned()));
        assert_eq!(
            Message::new("unknown").fix(list).in_words(&Command),
            "unknown; `swm fovs swm/Toy-v0` lists them"
        );
    }
}
