//! Factors of variation: their description, and how a reset selects them.

use serde::Serialize;

use crate::error::nearest;
use crate::space::Space;

/// What stands before a factor's name in tables.
pub const VARIATION_PREFIX: &str = "variation.";

/// One factor of variation, as data.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct FactorSpec {
    /// Dotted name: `block.color`.
    pub name: String,
    /// What it does, in a few words.
    pub doc: String,
    /// What it may be.
    pub space: Space,
    /// The default, as JSON.
    pub default: serde_json::Value,
    /// Whether it is sampled when a reset names no factors.
    pub sampled_by_default: bool,
    /// Its constraint in words, if it has one.
    pub constraint: Option<String>,
    /// Values of other factors without which it changes nothing: a disc has no angle.
    pub shows_with: Vec<(String, serde_json::Value)>,
    /// Names of its values, from the smallest on, where it is a choice: `["box", "cylinder", "cross"]`. Else empty.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub choices: Vec<String>,
    /// Whether it changes images and nothing else, so that [`Env::dress`](super::Env::dress) takes it.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub visual: bool,
}

impl FactorSpec {
    /// A factor that is set only where a reset names it, without a constraint.
    pub fn new(name: impl Into<String>, space: Space, default: impl Into<serde_json::Value>) -> Self {
        Self {
            name: name.into(),
            doc: String::new(),
            space,
            default: default.into(),
            sampled_by_default: false,
            constraint: None,
            shows_with: Vec::new(),
            choices: Vec::new(),
            visual: false,
        }
    }

    /// What it does, in a few words.
    #[must_use]
    pub fn doc(mut self, doc: &str) -> Self {
        doc.clone_into(&mut self.doc);
        self
    }

    /// The value of the choice `name`, in any case, with a blank, `-` or `_` between words; `None` if it has no such choice.
    ///
    /// ```
    /// use swm_core::{FactorSpec, Space};
    ///
    /// let mut shape = FactorSpec::new("shape", Space::Discrete { n: 2, start: 1 }, 1);
    /// shape.choices = vec!["L".into(), "small T".into()];
    /// assert_eq!((shape.choice("Small-T"), shape.choice("Z")), (Some(2), None));
    /// assert_eq!(shape.choice_name(1), Some("L"));
    /// ```
    pub fn choice(&self, name: &str) -> Option<i64> {
        let plain = |text: &str| text.trim().to_lowercase().replace(['-', '_'], " ");
        let at = self.choices.iter().position(|choice| plain(choice) == plain(name))?;
        Some(self.first_choice()? + i64::try_from(at).ok()?)
    }

    /// The name of the value `value`, if it is a choice.
    pub fn choice_name(&self, value: i64) -> Option<&str> {
        let at = usize::try_from(value - self.first_choice()?).ok()?;
        self.choices.get(at).map(String::as_str)
    }

    fn first_choice(&self) -> Option<i64> {
        match self.space {
            Space::Discrete { start, .. } => Some(start),
            _ => None,
        }
    }

    /// Whether `asked` selects it: its name, its group, `*.` and the end of its name, `default` (all that are sampled when a
    /// reset names no factors), or `all`.
    pub fn is_selected_by(&self, asked: &str) -> bool {
        (asked == "default" && self.sampled_by_default) || selects(asked, &self.name)
    }

    /// Whether a reset samples it that asks for `variation`; without one, those are sampled that are by default.
    pub fn is_sampled(&self, variation: Option<&[String]>) -> bool {
        match variation {
            None => self.sampled_by_default,
            Some(asked) => asked.iter().any(|asked| self.is_selected_by(asked)),
        }
    }

    /// Whether it changes images and nothing else.
    #[must_use]
    pub fn visual(mut self, visual: bool) -> Self {
        self.visual = visual;
        self
    }

    /// Whether it is sampled when a reset names no factors.
    #[must_use]
    pub fn sampled_by_default(mut self, sampled: bool) -> Self {
        self.sampled_by_default = sampled;
        self
    }
}

/// Words that a reset reads otherwise than as the name of a factor or group.
const RESERVED: [&str; 3] = ["all", "default", "none"];

/// Refuses the name of a factor that [`ResetOptions::vary`](super::ResetOptions::vary) and the command would read otherwise.
///
/// ```
/// use swm_core::env::check_factor_name;
///
/// assert!(check_factor_name("block.color").is_ok());
/// for name in ["", "none", "all.color", "block..color", "+block", "*.color", "a=b", "a,b", "the block"] {
///     assert!(check_factor_name(name).is_err(), "{name}");
/// }
/// ```
///
/// # Errors
///
/// The name, what it would be read as, and a fix, as a sentence.
pub fn check_factor_name(name: &str) -> Result<(), String> {
    let reason = if name.split('.').any(str::is_empty) {
        "has an empty part; write words with dots between them".to_owned()
    } else if let Some(word) = RESERVED.iter().find(|word| name.split('.').next() == Some(**word)) {
        format!("begins with `{word}`, which says what a reset samples; use another word")
    } else if name.starts_with('+') || name.contains('*') {
        "has a `+` in front or a `*`, by which resets name several factors; leave it out".to_owned()
    } else if let Some(found) = name.chars().find(|found| ['=', ','].contains(found) || found.is_whitespace())
    {
        format!("has {found:?}, which separates names and values on the command line; use `_` or `.`")
    } else {
        return Ok(());
    };
    Err(format!("the factor name `{name}` {reason}"))
}

/// The nearest of what selects some of the factors `names`, if `asked`, which selects none, may be a typing error: a factor, a
/// group, `*.` and the end of a name, `all` or `default`.
///
/// ```
/// let near = |asked| swm_core::env::nearest_factor(asked, ["agent.color", "block.scale"]);
/// assert_eq!(near("agent.colr").as_deref(), Some("agent.color"));
/// assert_eq!(near("*.colors").as_deref(), Some("*.color"));
/// ```
pub fn nearest_factor<'a>(asked: &str, names: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let names: Vec<&str> = names.into_iter().collect();
    let halves = || names.iter().filter_map(|name| name.rsplit_once('.'));
    let ends: Vec<String> = halves().map(|(_, end)| format!("*.{end}")).collect();
    let groups = halves().map(|(group, _)| group);
    let known = names.iter().copied().chain(groups).chain(["all", "default"]);
    nearest(asked, known.chain(ends.iter().map(String::as_str)))
}

/// Whether `asked` selects the factor `name`: a factor's name, a group's name, `*.color` (every factor or group of that
/// name, in any group), or `all`. See [`FactorSpec::is_selected_by`] for `default`.
///
/// ```
/// use swm_core::env::selects;
///
/// assert!(selects("agent", "agent.color") && selects("*.color", "agent.color"));
/// assert!(!selects("agent", "agents.color") && !selects("*.col", "agent.color"));
/// ```
pub fn selects(asked: &str, name: &str) -> bool {
    let is_whole = |asked: &str, name: &str| {
        name.strip_prefix(asked).is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
    };
    match asked.strip_prefix("*.") {
        Some(end) => name.match_indices('.').any(|(dot, _)| is_whole(end, &name[dot + 1..])),
        None => asked == "all" || is_whole(asked, name),
    }
}
