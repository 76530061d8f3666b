//! Requests in the syntax of the command line: settings as options.

use serde_json::Value as Json;
use swm_tasks::request::{List, Message, Report, TaskError, Words, value_text};

use super::{Failure, Output, usage};

/// Settings of a request as options: `--image-size 64x64`.
pub(super) struct Options;

impl Words for Options {
    fn setting(&self, name: &str, value: Option<&Json>) -> String {
        let option = format!("--{}", name.replace('_', "-"));
        match (name, value) {
            // It has no option: its place is the first.
            ("env", None) => "environment".to_owned(),
            ("target", None) => "target".to_owned(),
            ("env", Some(env)) => format!("{} as the environment", value_text(env)),
            (_, None | Some(Json::Bool(true))) => option,
            ("distractor", Some(Json::Array(items))) => {
                let each = items.iter().map(|item| format!("{option} {}", value_text(item)));
                each.collect::<Vec<_>>().join(" ")
            }
            ("env_option" | "set", Some(Json::Object(items))) => {
                let each = items.iter().map(|(name, item)| format!("{option} {name}={}", value_text(item)));
                each.collect::<Vec<_>>().join(" ")
            }
            (_, Some(value)) => format!("{option} {}", value_text(value)),
        }
    }

    fn list(&self, list: &List) -> String {
        match list {
            List::Factors(env) => format!("`swm fovs {env}`"),
            List::Solvers => "`swm solvers`".to_owned(),
            _ => "`swm --help`".to_owned(),
        }
    }
}

/// As [`Options`], of a command some of whose settings have options of other names, or none: then words for the place of the value.
pub(super) struct Renamed(pub(super) &'static [(&'static str, &'static str)]);

impl Words for Renamed {
    fn setting(&self, name: &str, value: Option<&Json>) -> String {
        let renamed = self.0.iter().find(|(setting, _)| *setting == name).map(|(_, option)| *option);
        match (renamed, value) {
            (None, _) => Options.setting(name, value),
            (Some(option), None | Some(Json::Bool(_))) => option.to_owned(),
            (Some(option), Some(value)) if option.starts_with("--") => {
                format!("{option} {}", value_text(value))
            }
            (Some(_), Some(value)) => value_text(value),
        }
    }

    fn list(&self, list: &List) -> String {
        Options.list(list)
    }
}

impl Renamed {
    /// An error in the words of the command.
    pub(super) fn failure(&self, error: TaskError) -> Failure {
        match error {
            TaskError::Request(message) => usage(message.in_words(self)),
            error => error.into(),
        }
    }
}

/// Notes of a request go to the error output.
impl Report for &Output {
    fn note(&mut self, note: &Message) {
        Output::note(self, format!("note: {}", note.in_words(&Options)));
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn settings_have_the_options_of_their_command() {
        let words = Renamed(&[("kind", "--as"), ("from", "its folder"), ("check_only", "--check")]);
        let option = |name: &str, value: Option<Json>| words.setting(name, value.as_ref());
        assert_eq!([option("kind", None), option("kind", Some(json!("lewm")))], ["--as", "--as lewm"]);
        assert_eq!([option("from", None), option("from", Some(json!("a.pt")))], ["its folder", "a.pt"]);
        assert_eq!(option("check_only", Some(json!(true))), "--check");
        assert_eq!(
            option("image_size", Some(json!([64, 64]))),
            Options.setting("image_size", Some(&json!([64, 64])))
        );
    }
}
