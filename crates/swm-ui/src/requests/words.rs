//! The words of the command line for a request.

use serde_json::{Map, Value as Json};
use swm_tasks::request::{Divided, value_text};

/// The words after `swm` of the command that does the same.
pub(crate) fn command_line(request: &Divided) -> Vec<String> {
    let (command, place) = match request {
        Divided::Record(_) => ("collect", "env"),
        Divided::Evaluate(_) => ("eval", "env"),
        Divided::Sweep(_) => ("sweep", ""),
        Divided::Train(_) => ("train", "baseline"),
        _ => (request.name(), ""),
    };
    let settings = request.changed().into_iter().next().unwrap_or_default();
    std::iter::once(command.to_owned()).chain(option_words(settings, place)).collect()
}

/// The words of settings: the one called `first` by its place, all others as options, and last the one that is written.
pub(crate) fn option_words(mut settings: Map<String, Json>, first: &str) -> Vec<String> {
    let [first, out] = [first, "out"].map(|name| settings.shift_remove(name));
    let mut words: Vec<String> = first.iter().map(value_text).collect();
    for (name, value) in settings.into_iter().chain(out.map(|out| ("out".to_owned(), out))) {
        let option = format!("--{}", name.replace('_', "-"));
        match (name.as_str(), value) {
            // Options of opening are options of the command.
            ("opening", Json::Object(each)) => words.extend(option_words(each, "")),
            ("distractor" | "reference", Json::Array(each)) => {
                words.extend(each.iter().flat_map(|one| [option.clone(), value_text(one)]));
            }
            ("set" | "env_option" | "map" | "look" | "canonical", Json::Object(each)) => {
                let assignment = |(name, value): (&String, &Json)| format!("{name}={}", value_text(value));
                words.extend(each.iter().map(assignment).flat_map(|one| [option.clone(), one]));
            }
            ("image_size", Json::Null) => words.extend([option, "none".to_owned()]),
            (_, Json::Bool(true)) => words.push(option),
            (_, value) => words.extend([option, value_text(&value)]),
        }
    }
    words
}
