//! How a model of the zoo was made: data, which `cargo xtask zoo` runs and the model's folder keeps.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{TaskError, cannot};
use crate::text_file::{read_text, toml_error};

/// The file of a recipe in the model's folder.
pub const RECIPE: &str = "recipe.toml";

/// What a model of the zoo is, and the commands that make it, in an empty folder.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// What it is, in one line.
    pub about: String,
    /// License of the weights, by its SPDX identifier.
    pub license: String,
    /// Arguments of the command `swm`, one after the other; the last evaluates.
    pub steps: Vec<String>,
    /// The folder of the evaluation that the last step makes.
    pub result: String,
}

impl Recipe {
    /// That of a file.
    ///
    /// # Errors
    ///
    /// The file cannot be read, or is no recipe.
    pub fn read(path: &Path) -> Result<Self, TaskError> {
        let shown = path.display();
        let text = read_text(path).map_err(cannot("read the recipe", path))?;
        Self::parse(&text).map_err(|reason| format!("recipe {shown}: {reason}").into())
    }

    /// That of a text.
    ///
    /// # Errors
    ///
    /// It is no recipe.
    pub fn parse(text: &str) -> Result<Self, TaskError> {
        let recipe: Self = toml::from_str(text).map_err(|error| toml_error(text, &error))?;
        match recipe {
            Self { ref about, ref license, .. } if about.trim().is_empty() || license.trim().is_empty() => {
                Err("about and license must not be empty".into())
            }
            Self { ref steps, .. } if steps.is_empty() => Err("it has no steps".into()),
            recipe => Ok(recipe),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recipes_are_checked() {
        let text = "about = 'a'\nlicense = 'MIT'\nsteps = ['eval']\nresult = 'r'\n";
        assert_eq!(Recipe::parse(text).unwrap().steps, ["eval"]);
        for (from, to, told) in [
            ("'MIT'", "' '", "license must not be empty"),
            ("['eval']", "[]", "no steps"),
            ("result", "results", "`results` is unknown (did you mean `result`?)"),
        ] {
            let said = Recipe::parse(&text.replace(from, to)).unwrap_err().to_string();
            assert!(said.contains(told), "{said}");
        }
    }
}
