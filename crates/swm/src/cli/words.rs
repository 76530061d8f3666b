//! Requests in the syntax of the command line: settings as options.

use serde_json::Value as Json;
use swm_tasks::request::{List, Message, Report, Words, value_text};

use super::Output;

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

/// Notes of a request go to the error output.
impl Report for &Output {
    fn note(&mut self, note: &Message) {
        Output::note(self, format!("note: {}", note.in_words(&Options)));
    }
}
