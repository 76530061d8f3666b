//! Registries: explicit tables of environments and policies. A downstream crate adds its own with one line.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json};

use crate::env::{Env, EnvConfig};
use crate::error::{EnvError, PolicyError, UnknownName, nearest};
use crate::policies::BASIC_POLICIES;
use crate::policy::Policy;

/// One environment of a table.
#[derive(Clone, Copy, Debug)]
pub struct EnvEntry {
    /// The registered name: `swm/PushT-v1`.
    pub id: &'static str,
    /// What it is, in one line.
    pub summary: &'static str,
    /// What [`EnvConfig::settings`] may hold.
    pub settings: &'static [Setting],
    /// Policies that know this environment.
    pub policies: &'static [PolicyEntry],
    /// A planner that solves its task, as on a command line (`icem:horizon=20`): the policy `expert` of an environment
    /// that has no expert of its own.
    pub planner: Option<&'static str>,
    /// Makes one.
    pub make: fn(&EnvConfig) -> Result<Box<dyn Env>, EnvError>,
}

/// One setting of an environment or argument of a policy, for help and docs.
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
    /// A setting with its help and the text of its default.
    pub const fn new(name: &'static str, doc: &'static str, default: &'static str) -> Self {
        Self { name, doc, default }
    }
}

/// One policy of a table.
#[derive(Clone, Copy, Debug)]
pub struct PolicyEntry {
    /// Its name on the command line.
    pub name: &'static str,
    /// What it does, in one line.
    pub summary: &'static str,
    /// Its arguments.
    pub settings: &'static [Setting],
    /// Makes one.
    pub make: MakePolicy,
}

/// Makes a policy for an environment from its arguments.
pub type MakePolicy = fn(&PolicyContext<'_>, &PolicyArgs) -> Result<Box<dyn Policy>, PolicyError>;

/// What a policy is made for.
#[derive(Clone, Copy, Debug)]
pub struct PolicyContext<'a> {
    /// The environment.
    pub env: &'a EnvEntry,
    /// How its environments are made.
    pub config: &'a EnvConfig,
    /// How often the world applies each action.
    pub frame_skip: u32,
}

/// Arguments of a policy: `name:key=value,key=value` or `name:value`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PolicyArgs {
    /// The policy's name.
    pub name: String,
    /// Values without a key, in order.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub positional: Vec<Json>,
    /// Values with a key.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub named: Map<String, Json>,
}

impl PolicyArgs {
    /// Reads `name`, `name:v1,v2` or `name:key=value,…`. Values are numbers, `true`, `false`, or text.
    ///
    /// ```
    /// let args = swm_core::PolicyArgs::parse("cem:samples=100,clip=true")?;
    /// assert_eq!((args.name.as_str(), args.named.len()), ("cem", 2));
    /// # Ok::<(), swm_core::PolicyError>(())
    /// ```
    ///
    /// # Errors
    ///
    /// A key is given twice. Whether the policy knows the keys shows when it is made.
    pub fn parse(text: &str) -> Result<Self, PolicyError> {
        let (name, rest) = text.split_once(':').unwrap_or((text, ""));
        let mut args = Self { name: name.trim().to_owned(), ..Self::default() };
        for part in rest.split(',').map(str::trim).filter(|part| !part.is_empty()) {
            match part.split_once('=') {
                Some((key, value)) => {
                    if args.named.insert(key.trim().to_owned(), literal(value.trim())).is_some() {
                        return Err(args.wrong(format!("`{}` is given twice", key.trim())));
                    }
                }
                None => args.positional.push(literal(part)),
            }
        }
        Ok(args)
    }

    /// The named arguments as the policy's own type, for policies without positional ones.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: an unknown or misfit one, with the known ones.
    pub fn parse_as<T: DeserializeOwned>(&self) -> Result<T, PolicyError> {
        if let Some(value) = self.positional.first() {
            return Err(self.wrong(format!("unexpected value `{value}`; write key=value")));
        }
        self.named_as()
    }

    /// As [`PolicyArgs::parse_as`], where the single positional value stands for `key`.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Argument`]: an unknown or misfit one, with the known ones.
    pub fn parse_with<T: DeserializeOwned>(&self, key: &str) -> Result<T, PolicyError> {
        let mut args = self.clone();
        match args.positional.as_slice() {
            [] => {}
            [value] => {
                args.named.insert(key.to_owned(), value.clone());
            }
            [_, extra, ..] => return Err(self.wrong(format!("unexpected second value `{extra}`"))),
        }
        args.named_as()
    }

    fn named_as<T: DeserializeOwned>(&self) -> Result<T, PolicyError> {
        serde_json::from_value(Json::Object(self.named.clone()))
            .map_err(|error| self.wrong(error.to_string()))
    }

    /// An error about these arguments.
    pub fn wrong(&self, reason: impl Into<String>) -> PolicyError {
        PolicyError::Argument { policy: self.name.clone(), reason: reason.into() }
    }
}

/// A value as it is written on a command line.
pub(crate) fn literal(text: &str) -> Json {
    if let Ok(number) = text.parse::<i64>() {
        return number.into();
    }
    match (text, text.parse::<f64>()) {
        ("true", _) => true.into(),
        ("false", _) => false.into(),
        (_, Ok(number)) if number.is_finite() => number.into(),
        _ => text.into(),
    }
}

/// Environments and policies of several crates, merged.
/// ```
/// use swm_core::testing::TOY;
/// use swm_core::{EnvConfig, EnvEntry, PolicyArgs, PolicyContext, Registry};
///
/// static ENVS: [EnvEntry; 1] = [TOY]; // a crate of environments has such a table
/// let registry = Registry::new().with_envs(&ENVS);
/// let env = registry.env("swm/Toy-v0")?;
/// assert!(registry.env("swm/Toi-v0").unwrap_err().to_string().contains("did you mean `swm/Toy-v0`?"));
///
/// let context = PolicyContext { env, config: &EnvConfig::default(), frame_skip: 1 };
/// let policy = registry.policy(&context, &PolicyArgs::parse("ou:sigma=0.3")?)?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Registry {
    envs: Vec<&'static EnvEntry>,
    policies: Vec<&'static PolicyEntry>,
    expert: Option<&'static PolicyEntry>,
}

impl Registry {
    /// Knows the policies that fit every environment, and no environment yet.
    pub fn new() -> Self {
        Self { envs: Vec::new(), policies: BASIC_POLICIES.iter().collect(), expert: None }
    }

    /// Adds a table of environments.
    #[must_use]
    pub fn with_envs(mut self, table: &'static [EnvEntry]) -> Self {
        self.envs.extend(table);
        self
    }

    /// Adds a table of policies for every environment.
    #[must_use]
    pub fn with_policies(mut self, table: &'static [PolicyEntry]) -> Self {
        self.policies.extend(table);
        self
    }

    /// Adds what makes policies from [`EnvEntry::planner`], for environments that have one.
    #[must_use]
    pub fn with_expert(mut self, entry: &'static PolicyEntry) -> Self {
        self.expert = Some(entry);
        self
    }

    /// All environments, in the order of their tables.
    pub fn envs(&self) -> &[&'static EnvEntry] {
        &self.envs
    }

    /// The policies of an environment: its own, its planner as `expert`, then the general ones.
    pub fn policies<'a>(&'a self, env: &'a EnvEntry) -> impl Iterator<Item = &'a PolicyEntry> {
        let expert = self.expert.filter(|_| env.planner.is_some());
        env.policies.iter().chain(expert).chain(self.policies.iter().copied())
    }

    /// The environment with this id.
    ///
    /// ```
    /// use swm_core::Registry;
    /// use swm_core::testing::TOY;
    ///
    /// const ENVS: &[swm_core::EnvEntry] = &[TOY];
    /// let registry = Registry::new().with_envs(ENVS);
    /// assert_eq!(registry.env(TOY.id)?.id, TOY.id);
    /// assert!(registry.env("swm/Toi-v0").is_err_and(|error| error.to_string().contains("did you mean")));
    /// # Ok::<(), swm_core::UnknownName>(())
    /// ```
    ///
    /// # Errors
    ///
    /// No table has it; the error names the nearest that one has.
    pub fn env(&self, id: &str) -> Result<&'static EnvEntry, UnknownName> {
        self.envs.iter().copied().find(|entry| entry.id == id).ok_or_else(|| UnknownName {
            kind: "environment",
            name: id.to_owned(),
            nearest: nearest(id, self.envs.iter().map(|entry| entry.id)),
            command: "envs",
        })
    }

    /// Makes a policy for an environment: `PolicyArgs::parse("cem:samples=100")`, say.
    ///
    /// # Errors
    ///
    /// No policy has this name, a setting is unknown or out of its bounds, or the policy does not fit the environment.
    pub fn policy(
        &self,
        context: &PolicyContext<'_>,
        args: &PolicyArgs,
    ) -> Result<Box<dyn Policy>, PolicyError> {
        let entry = self.policies(context.env).find(|entry| entry.name == args.name).ok_or_else(|| {
            PolicyError::Other(Box::new(UnknownName {
                kind: "policy",
                name: args.name.clone(),
                nearest: nearest(&args.name, self.policies(context.env).map(|entry| entry.name)),
                command: "envs",
            }))
        })?;
        (entry.make)(context, args)
    }
}

/// For policies without arguments.
#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NoArgs {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policy_arguments_are_positional_or_named() {
        let args = PolicyArgs::parse("cem:samples=300,fast=true,name=x").unwrap();
        assert_eq!(args.named["samples"], 300);
        assert_eq!(args.named["fast"], true);
        assert_eq!(args.named["name"], "x");
        assert_eq!(
            PolicyArgs::parse("constant:0.5,-1").unwrap().positional,
            vec![0.5.into(), Json::from(-1)]
        );
        assert!(PolicyArgs::parse("cem:a=1,a=2").unwrap_err().to_string().contains("twice"));
        assert!(PolicyArgs::parse("random:x=1").unwrap().parse_as::<NoArgs>().is_err());
    }
}
