//! Settings declared once: name, type, default and help of a setting stand together in [`settings!`](crate::settings!),
//! which makes the struct, its `Default`, its reader and the table for help and docs.

mod reading;

use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value as Json};

pub use reading::{WrongSetting, plain, read, read_of};

/// One setting of an environment, a policy or a solver, for help and docs.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    /// Its name.
    pub name: &'static str,
    /// What it does.
    pub doc: &'static str,
    /// The default, in words.
    pub default: &'static str,
}

impl Setting {
    /// A setting: its name, what it does, its default in words.
    pub const fn new(name: &'static str, doc: &'static str, default: &'static str) -> Self {
        Self { name, doc, default }
    }
}

/// A flat struct of settings, declared by [`settings!`](crate::settings!).
pub trait Settings: Default + Serialize + DeserializeOwned {
    /// Name, help and default of every setting, in the order of the fields.
    const SETTINGS: &'static [Setting];

    /// Former names of settings, which are still read: `(old, new)`.
    const RENAMED: &'static [(&'static str, &'static str)] = &[];

    /// The settings that differ from their defaults.
    fn changed(&self) -> Map<String, Json> {
        match (serde_json::to_value(self), serde_json::to_value(Self::default())) {
            (Ok(Json::Object(own)), Ok(Json::Object(defaults))) => {
                own.into_iter().filter(|(name, value)| defaults.get(name) != Some(value)).collect()
            }
            _ => Map::new(),
        }
    }

    /// `name`, followed by the settings that differ from their defaults, as on a command line.
    fn describe_as(&self, name: &str) -> String {
        describe(name, &self.changed())
    }
}

/// A name and settings as they are written on a command line: `cem:samples=100,clip=true`.
pub fn describe(name: &str, settings: &Map<String, Json>) -> String {
    let settings: Vec<String> = assignments(settings).collect();
    if settings.is_empty() { name.to_owned() } else { format!("{name}:{}", settings.join(",")) }
}

/// Settings as they are written on a command line, one by one: `clip=true`.
pub fn assignments(settings: &Map<String, Json>) -> impl Iterator<Item = String> {
    settings.iter().map(|(name, value)| format!("{name}={}", text(value)))
}

/// A value as it is written on a command line: a text without quotation marks, all else as JSON.
pub fn text(value: &Json) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Declares a struct of settings. The first paragraph of a field's doc comment is its help.
///
/// The struct has serde's `default` and `deny_unknown_fields`; its fields have its visibility. The text of a default in
/// help is the expression itself; where that is no literal, it follows as `=> "text"`. A former name of a setting is read as
/// before with `#[serde(alias = "…")]`. A field `..name: Type,` before or after all others holds further settings, which
/// join the same flat list. A crate that uses this macro depends on `serde`.
///
/// ```
/// use swm_core::settings::Settings;
///
/// swm_core::settings! {
///     /// Settings of gradient descent.
///     pub struct Descent {
///         /// Gradient steps.
///         ///
///         /// 0 returns the start.
///         iterations: usize = 30,
///         /// Learning rate.
///         #[serde(alias = "step_size")]
///         lr: f64 = 0.1,
///         /// When it stops.
///         budget: Option<u64> = None => "never",
///     }
/// }
///
/// assert_eq!(Descent::default(), Descent { iterations: 30, lr: 0.1, budget: None });
/// let [iterations, .., budget] = Descent::SETTINGS else { panic!("it has three settings") };
/// assert_eq!((iterations.name, iterations.default, iterations.doc), ("iterations", "30", "Gradient steps"));
/// assert_eq!(budget.default, "never");
/// assert_eq!(Descent { lr: 0.5, ..Descent::default() }.describe_as("descent"), "descent:lr=0.5");
/// ```
#[macro_export]
macro_rules! settings {
    (@text $default:expr) => {
        $crate::settings::default_text(stringify!($default))
    };
    (@text $default:expr => $text:expr) => {
        $text
    };
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $Name:ident {
            $(..$first:ident: $First:ty,)?
            $(
                $(#[doc = $doc:literal])*
                $(#[serde(alias = $alias:literal)])*
                $name:ident: $Type:ty = $default:expr $(=> $text:expr)?,
            )+
            $(..$last:ident: $Last:ty,)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        $visibility struct $Name {
            $(
                #[doc = concat!("The settings of `", stringify!($First), "`, in the same flat list.")]
                #[serde(flatten)]
                $visibility $first: $First,
            )?
            $(
                $(#[doc = $doc])*
                $(#[serde(alias = $alias)])*
                $visibility $name: $Type,
            )+
            $(
                #[doc = concat!("The settings of `", stringify!($Last), "`, in the same flat list.")]
                #[serde(flatten)]
                $visibility $last: $Last,
            )?
        }

        impl Default for $Name {
            fn default() -> Self {
                Self {
                    $($first: <$First>::default(),)?
                    $($name: $default,)+
                    $($last: <$Last>::default(),)?
                }
            }
        }

        impl $crate::settings::Settings for $Name {
            const SETTINGS: &'static [$crate::settings::Setting] = {
                const TABLE: &$crate::settings::Table = &$crate::settings::Table::of(&[
                    $(<$First as $crate::settings::Settings>::SETTINGS,)?
                    &[$($crate::settings::Setting::new(
                        stringify!($name),
                        $crate::settings::help(&[$($doc),*], concat!($($doc),*)),
                        $crate::settings!(@text $default $(=> $text)?),
                    )),+],
                    $(<$Last as $crate::settings::Settings>::SETTINGS,)?
                ]);
                TABLE.as_slice()
            };
            const RENAMED: &'static [(&'static str, &'static str)] =
                &[$($(($alias, stringify!($name)),)*)+];
        }
    };
}

/// The first paragraph of a doc comment, without its period: `lines` are its lines, `text` is all of them in one.
pub const fn help(lines: &[&'static str], text: &'static str) -> &'static str {
    let (mut length, mut line) = (0, 0);
    while line < lines.len() && !lines[line].is_empty() {
        length += lines[line].len();
        line += 1;
    }
    let text = text.split_at(length).0.trim_ascii();
    without_end(text, b".")
}

/// The text of a default from its expression: `2.0` is `2`.
pub const fn default_text(expression: &'static str) -> &'static str {
    without_end(expression, b".0")
}

const fn without_end(text: &'static str, end: &[u8]) -> &'static str {
    if text.len() < end.len() {
        return text;
    }
    let (head, tail) = text.split_at(text.len() - end.len());
    if equal(tail.as_bytes(), end) { head } else { text }
}

const fn equal(a: &[u8], b: &[u8]) -> bool {
    let mut index = 0;
    while index < a.len() && index < b.len() && a[index] == b[index] {
        index += 1;
    }
    index == a.len() && index == b.len()
}

/// Most settings that a table can hold.
const CAPACITY: usize = 64;

/// A table of settings that is put together at compile time.
///
/// ```
/// use swm_core::settings::Table;
/// use swm_core::Setting;
///
/// const SHARED: &[Setting] = &[Setting::new("std", "Standard deviation of the noise", "0")];
/// const NOISY: &Table = &Table::of(&[SHARED]).with_default("std", "0.1");
/// assert_eq!(NOISY.as_slice()[0].default, "0.1");
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Table {
    settings: [Setting; CAPACITY],
    len: usize,
}

impl Table {
    /// All settings of `tables`, in this order.
    ///
    /// # Panics
    ///
    /// There are more than 64; at compile time, in a constant.
    pub const fn of(tables: &[&[Setting]]) -> Self {
        let mut joined = Self { settings: [Setting::new("", "", ""); CAPACITY], len: 0 };
        let mut table = 0;
        while table < tables.len() {
            let mut index = 0;
            while index < tables[table].len() {
                joined.settings[joined.len] = tables[table][index];
                joined.len += 1;
                index += 1;
            }
            table += 1;
        }
        joined
    }

    /// Replaces the default's text of one setting.
    ///
    /// # Panics
    ///
    /// There is no such setting.
    #[must_use]
    pub const fn with_default(mut self, name: &str, default: &'static str) -> Self {
        let index = self.index(name);
        let Setting { name, doc, .. } = self.settings[index];
        self.settings[index] = Setting::new(name, doc, default);
        self
    }

    /// Leaves one setting out.
    ///
    /// # Panics
    ///
    /// There is no such setting.
    #[must_use]
    pub const fn without(mut self, name: &str) -> Self {
        let mut index = self.index(name);
        self.len -= 1;
        while index < self.len {
            self.settings[index] = self.settings[index + 1];
            index += 1;
        }
        self
    }

    /// The settings.
    pub const fn as_slice(&self) -> &[Setting] {
        self.settings.split_at(self.len).0
    }

    const fn index(&self, name: &str) -> usize {
        let mut index = 0;
        while index < self.len {
            if equal(self.settings[index].name.as_bytes(), name.as_bytes()) {
                return index;
            }
            index += 1;
        }
        panic!("the table has no such setting")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::assert_documented_defaults;

    crate::settings! {
        /// Settings that other structs have too.
        struct Group {
            /// Seed.
            seed: u32 = 7,
        }
    }

    crate::settings! {
        /// Settings with groups.
        #[derive(Copy)]
        struct Small {
            /// How many,
            /// in one line.
            ///
            /// And more about it.
            count: usize = 3,
        }
    }

    crate::settings! {
        /// Settings with groups.
        struct Outer {
            ..group: Group,
            /// How much.
            #[serde(alias = "amount")]
            share: f64 = 2.0,
            /// A name.
            name: String = "long".to_owned() => "long",
            ..small: Small,
        }
    }

    #[test]
    fn one_declaration_makes_struct_default_and_table() {
        let found: Vec<_> = Outer::SETTINGS.iter().map(|s| (s.name, s.doc, s.default)).collect();
        let expected = [
            ("seed", "Seed", "7"),
            ("share", "How much", "2"),
            ("name", "A name", "long"),
            ("count", "How many, in one line", "3"),
        ];
        assert_eq!(found, expected);
        assert_documented_defaults::<Outer>();
        let read = |text: &str| serde_json::from_str::<Outer>(text);
        let settings = read(r#"{"amount": 1.5, "count": 4, "seed": 1}"#).unwrap();
        assert_eq!(settings.describe_as("outer"), "outer:seed=1,share=1.5,count=4");
        assert_eq!(Outer::RENAMED, [("amount", "share")]);
        assert!(read(r#"{"shares": 1.5}"#).unwrap_err().to_string().contains("unknown field `shares`"));
    }

    #[test]
    fn tables_are_changed_at_compile_time() {
        const TABLE: &Table = &Table::of(&[Outer::SETTINGS]).without("share").with_default("name", "short");
        let found: Vec<_> = TABLE.as_slice().iter().map(|s| (s.name, s.default)).collect();
        assert_eq!(found, [("seed", "7"), ("name", "short"), ("count", "3")]);
    }
}
