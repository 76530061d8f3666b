//! The ways to build each crate that the table shows: without features, with each one alone, with the default ones.

use anyhow::Result;

use crate::cargo_tree::Build;
use crate::metadata::{Metadata, Package};

/// One row of the table.
#[derive(Clone, Debug)]
pub(super) struct Choice {
    /// `none`, `default`, or the feature that is on alone.
    pub called: String,
    pub build: Build,
}

impl Choice {
    /// `CRATE:CHOICE`.
    pub(super) fn name(&self) -> String {
        format!("{}:{}", self.build.package, self.called)
    }

    /// Whether somebody means this one, or all of its crate.
    pub(super) fn is_called(&self, wanted: &str) -> bool {
        wanted == self.build.package || wanted == self.name()
    }

    /// Whether one of `names` is in the build, or is what is built.
    pub(super) fn pulls_in(&self, names: &[&str]) -> Result<bool> {
        Ok(self.build.tree()?.edges.keys().any(|unit| names.contains(&&*unit.name)))
    }
}

/// Of every crate that is published.
pub(super) fn choices(metadata: &Metadata) -> Vec<Choice> {
    let mut members: Vec<&Package> = metadata.members().filter(|package| package.is_published()).collect();
    members.sort_by(|a, b| a.name.cmp(&b.name));
    members.into_iter().flat_map(of).collect()
}

fn of(package: &Package) -> Vec<Choice> {
    let choice = |called: &str, default_features, features: &[&str]| Choice {
        called: called.into(),
        build: Build {
            package: package.name.clone(),
            default_features,
            features: features.iter().map(ToString::to_string).collect(),
        },
    };
    let mut choices = vec![choice("none", false, &[])];
    let features = package.features.keys().filter(|name| *name != "default");
    choices.extend(features.map(|name| choice(name, false, &[name])));
    if package.features.get("default").is_some_and(|features| !features.is_empty()) {
        choices.push(choice("default", true, &[]));
    }
    choices
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::fixture;

    #[test]
    fn each_feature_is_built_alone() {
        let mut metadata = fixture("swm:\nswm-core:\nswm-tests:");
        let features = [("default", vec!["mp4".to_owned()]), ("mp4", vec![]), ("cli", vec![])];
        metadata.packages[0].features =
            features.into_iter().map(|(name, turns_on)| (name.to_owned(), turns_on)).collect();
        metadata.packages[2].publish = Some(Vec::new());
        let choices = choices(&metadata);
        let names: Vec<String> = choices.iter().map(Choice::name).collect();
        assert_eq!(names, ["swm:none", "swm:cli", "swm:mp4", "swm:default", "swm-core:none"]);
        assert_eq!(
            choices[1].build.selection(),
            ["--package", "swm", "--no-default-features", "--features", "cli"]
        );
        assert_eq!(choices[3].build.selection(), ["--package", "swm"]);
        assert!(
            choices[0].is_called("swm") && choices[1].is_called("swm:cli") && !choices[4].is_called("swm")
        );
    }
}
