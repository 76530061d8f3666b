//! Sampling an assignment: selection, explicit values, rejection under constraints.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use swm_core::env::Episode;
use swm_core::env::{nearest_factor, selects};
use swm_core::error::{did_you_mean, nearest};
use swm_core::{BatchError, Column, EnvError, RowsMut, Slice, Value};
use thiserror::Error;

use crate::factor::{Constraint, FovSpace};

/// How often a constrained factor is sampled before giving up (as the reference).
const MAX_TRIES: usize = 1000;

/// A factor cannot be sampled or set.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FovError {
    /// No factor or group has this name.
    #[error("unknown factor `{name}`{}; `swm fovs ENV` lists them", did_you_mean(.nearest.as_deref()))]
    Unknown {
        /// The name asked for.
        name: String,
        /// The nearest factor or group.
        nearest: Option<String>,
    },
    /// A name as the option `--vary` of the command has it.
    #[error("unknown factor `{name}`; to sample it beside the factors that are sampled by default, name `default` and `{}`", .name.trim_start_matches('+'))]
    Added {
        /// The name asked for, from `+` on.
        name: String,
    },
    /// A group was given where one factor is meant.
    #[error("`{name}` is a group of factors; name one of them: {factors}")]
    Group {
        /// The group.
        name: String,
        /// Its factors.
        factors: String,
    },
    /// A value has a wrong type or shape, or lies outside the bounds.
    #[error("factor {0}")]
    Value(#[from] BatchError),
    /// A saved assignment belongs to another space.
    #[error("the saved factors hold {found} numbers, these factors {expected}")]
    Foreign {
        /// Numbers saved.
        found: usize,
        /// Numbers of this space.
        expected: usize,
    },
    /// A factor of a look that does more than change images.
    #[error("factor `{name}` is not visual: {}", visual_factors(.visual))]
    NotVisual {
        /// The factor.
        name: String,
        /// Those that are.
        visual: Vec<String>,
    },
    /// A constraint cannot be met.
    #[error("factor `{owner}` must be {words}, which {tries}; factors involved: {involved}")]
    Unsatisfied {
        /// The constrained factor.
        owner: String,
        /// The rule in words.
        words: &'static str,
        /// `none of 1000 samples met`, `its value does not meet`, or the same of its default.
        tries: String,
        /// Names and values of the factors that the rule reads.
        involved: String,
    },
}

fn visual_factors(names: &[String]) -> String {
    match names {
        [] => "this environment has no factors that change images alone".to_owned(),
        names => format!("those that change images alone are {}", names.join(", ")),
    }
}

impl From<FovError> for EnvError {
    fn from(error: FovError) -> Self {
        Self::other(error)
    }
}

/// One assignment of values to all factors: the scenario of an episode.
#[derive(Clone, Debug, PartialEq)]
pub struct Fov {
    names: Vec<String>,
    values: Vec<Value>,
    /// Sampled or set in this reset, rather than left at its default.
    touched: Vec<bool>,
}

impl FovSpace {
    /// Samples the assignment of one episode: factors that `episode.options` sets get these values, those that it varies are sampled from the
    /// episode's seed, each from a stream of its own, all others keep their defaults. `env` is for messages.
    ///
    /// # Errors
    ///
    /// An unknown factor, a value out of bounds, or a constraint that 1,000 samples did not meet.
    pub fn sample(&self, env: &str, episode: &Episode<'_>) -> Result<Fov, EnvError> {
        episode.options.check_none(env)?;
        self.try_sample(episode).map_err(|error| {
            let (env, reason) = (env.to_owned(), error.to_string());
            match error {
                FovError::Unsatisfied { .. } => EnvError::Constraint { env, reason },
                _ => EnvError::Reset { env, reason },
            }
        })
    }

    /// As [`FovSpace::sample`], for a reset to recorded positions: constraints are checked on the values `in_use`, which a
    /// recorded start or goal puts in place of factors. Rules between two of these are not checked: they are about what
    /// is sampled, and here the recording says where things stand.
    ///
    /// # Errors
    ///
    /// As of [`FovSpace::sample`].
    pub fn sample_in_use(
        &self,
        env: &str,
        episode: &Episode<'_>,
        in_use: &[(&str, Value)],
    ) -> Result<Fov, EnvError> {
        let is_in_use = |name: &str| in_use.iter().any(|(factor, _)| *factor == name);
        let mut space = self.clone();
        space
            .constraints
            .retain(|rule| !(is_in_use(rule.owner) && rule.reads.iter().any(|read| is_in_use(read))));
        let mut options = episode.options.clone();
        let values = in_use.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
        options.variation_values.extend(values);
        space.sample(env, &Episode::new(episode.seed, &options))
    }

    fn try_sample(&self, episode: &Episode<'_>) -> Result<Fov, FovError> {
        let sampled = self.selection(episode.options.variation.as_deref())?;
        let mut fov = self.defaults();
        let mut set = vec![false; self.factors.len()];
        for (name, value) in &episode.options.variation_values {
            let index = self.index(name)?;
            fov.values[index] = self.fit(index, value)?;
            set[index] = true;
        }
        for (index, factor) in self.factors.iter().enumerate() {
            fov.touched[index] = sampled[index] || set[index];
            if !sampled[index] || set[index] {
                continue;
            }
            let mut stream = episode.seed.stream(&factor.spec.name);
            let rules: Vec<&Constraint> =
                self.constraints.iter().filter(|rule| rule.owner == factor.spec.name).collect();
            let mut tries = 0;
            loop {
                fov.values[index] = factor.spec.space.sample(&mut stream);
                tries += 1;
                let Some(broken) = rules.iter().find(|rule| !(rule.holds)(&fov)) else { break };
                if tries == MAX_TRIES {
                    return Err(unsatisfied(broken, &fov, format!("none of {MAX_TRIES} samples met")));
                }
            }
        }
        // Values that were set or left at their defaults must agree with what was sampled.
        match self.constraints.iter().find(|rule| !(rule.holds)(&fov)) {
            Some(broken) if fov.touched(broken.owner) => {
                Err(unsatisfied(broken, &fov, "its value does not meet".to_owned()))
            }
            Some(broken) => {
                Err(unsatisfied(broken, &fov, "its default does not meet: sample or set it too".to_owned()))
            }
            None => Ok(fov),
        }
    }

    /// The assignment `fov` as `look` shows it: with these values of visual factors, as if they had been set. `env` is for messages.
    ///
    /// # Errors
    ///
    /// An unknown factor, one that is not visual, or a value out of bounds.
    pub fn dressed(&self, env: &str, fov: &Fov, look: &BTreeMap<String, Value>) -> Result<Fov, EnvError> {
        let dressed = self.try_dressed(fov, look);
        dressed.map_err(|error| EnvError::Reset { env: env.to_owned(), reason: error.to_string() })
    }

    fn try_dressed(&self, fov: &Fov, look: &BTreeMap<String, Value>) -> Result<Fov, FovError> {
        let mut dressed = fov.clone();
        for (name, value) in look {
            let index = self.index(name)?;
            if !self.factors[index].spec.visual {
                let visual = self.factors.iter().filter(|factor| factor.spec.visual);
                let visual = visual.map(|factor| factor.spec.name.clone()).collect();
                return Err(FovError::NotVisual { name: name.clone(), visual });
            }
            dressed.values[index] = self.fit(index, value)?;
            dressed.touched[index] = true;
        }
        Ok(dressed)
    }

    /// All factors at their defaults.
    pub fn defaults(&self) -> Fov {
        Fov {
            names: self.factors.iter().map(|factor| factor.spec.name.clone()).collect(),
            values: self.factors.iter().map(|factor| factor.default.clone()).collect(),
            touched: vec![false; self.factors.len()],
        }
    }

    /// Which factors a list of names, groups or `all` selects; without a list, those sampled by default.
    fn selection(&self, asked: Option<&[String]>) -> Result<Vec<bool>, FovError> {
        let Some(asked) = asked else {
            return Ok(self.factors.iter().map(|factor| factor.spec.sampled_by_default).collect());
        };
        let mut selected = vec![false; self.factors.len()];
        for name in asked {
            // An environment may sample nothing by default, and `none` is alone here.
            let mut any = ["default", "none"].contains(&name.as_str());
            for (index, factor) in self.factors.iter().enumerate() {
                let hit = factor.spec.is_selected_by(name);
                selected[index] |= hit;
                any |= hit;
            }
            if !any {
                return Err(self.unknown(name));
            }
        }
        Ok(selected)
    }

    pub(crate) fn index(&self, name: &str) -> Result<usize, FovError> {
        let found = self.factors.iter().position(|factor| factor.spec.name == name);
        found.ok_or_else(|| {
            let below: Vec<&str> = self.names().filter(|factor| selects(name, factor)).collect();
            match below.as_slice() {
                [] => FovError::Unknown { name: name.to_owned(), nearest: nearest(name, self.names()) },
                names => FovError::Group { name: name.to_owned(), factors: names.join(", ") },
            }
        })
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        self.factors.iter().map(|factor| factor.spec.name.as_str())
    }

    fn unknown(&self, name: &str) -> FovError {
        if name.starts_with('+') {
            return FovError::Added { name: name.to_owned() };
        }
        FovError::Unknown { name: name.to_owned(), nearest: nearest_factor(name, self.names()) }
    }

    /// A given value as this factor's type, if it fits and lies in the bounds.
    pub(crate) fn fit(&self, index: usize, value: &Value) -> Result<Value, FovError> {
        let factor = &self.factors[index];
        let (name, default) = (&factor.spec.name, &factor.default);
        let choice = match &value.data {
            Column::Str(texts) => Some(self.choice(index, &texts.join(","))?),
            _ => None,
        };
        let value = choice.as_ref().unwrap_or(value).cast(name, default.data.dtype(), &default.shape)?;
        factor.spec.space.check(name, value.data.as_slice())?;
        Ok(value)
    }

    /// The value of a choice by its name.
    fn choice(&self, index: usize, text: &str) -> Result<Value, FovError> {
        let spec = &self.factors[index].spec;
        spec.choice(text).map(Value::scalar).ok_or_else(|| {
            let expected = match spec.choices.as_slice() {
                [] => "numbers".to_owned(),
                choices => format!("a number or one of {}", choices.join(", ")),
            };
            let (name, found) = (spec.name.clone(), format!("`{text}`"));
            BatchError::WrongValue { name, expected, found }.into()
        })
    }
}

fn unsatisfied(rule: &Constraint, fov: &Fov, tries: String) -> FovError {
    let involved = rule.reads.iter().chain([&rule.owner]).map(|name| format!("{name} = {}", fov.value(name)));
    FovError::Unsatisfied {
        owner: rule.owner.to_owned(),
        words: rule.words,
        tries,
        involved: involved.collect::<Vec<_>>().join(", "),
    }
}

/// Values by name. The names are the environment's own, so a wrong one is a programming error and panics; the
/// conformance suite runs every getter.
impl Fov {
    fn index(&self, name: &str) -> usize {
        let found = self.names.iter().position(|own| own == name);
        found.unwrap_or_else(|| panic!("no factor `{name}`"))
    }

    /// The value of a factor.
    pub fn value(&self, name: &str) -> &Value {
        &self.values[self.index(name)]
    }

    /// Whether a factor was sampled or set in this reset.
    pub fn touched(&self, name: &str) -> bool {
        self.touched[self.index(name)]
    }

    /// All names and values, in the order of the table.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.names.iter().map(String::as_str).zip(&self.values)
    }

    fn slice<T: swm_core::batch::Element>(&self, name: &str) -> &[T] {
        let value = self.value(name);
        let slice: Slice<'_> = value.data.as_slice();
        slice
            .get()
            .unwrap_or_else(|| panic!("factor `{name}` holds {}, not {}", value.data.dtype(), T::DTYPE))
    }

    /// A color.
    pub fn rgb(&self, name: &str) -> [u8; 3] {
        self.vector(name)
    }

    /// A real number.
    pub fn f64(&self, name: &str) -> f64 {
        self.slice(name)[0]
    }

    /// A real number declared by [`crate::Factor::scalar_f32`].
    pub fn f32(&self, name: &str) -> f32 {
        self.slice(name)[0]
    }

    /// An integer.
    pub fn i64(&self, name: &str) -> i64 {
        self.slice(name)[0]
    }

    /// A vector of `N` values.
    pub fn vector<T: swm_core::batch::Element + Copy, const N: usize>(&self, name: &str) -> [T; N] {
        let values = self.slice::<T>(name);
        values.try_into().unwrap_or_else(|_| panic!("factor `{name}` has {} values, not {N}", values.len()))
    }

    /// Writes the fields `variation.<name>`, which begin at field `first` of the row.
    pub fn write(&self, first: usize, out: &mut RowsMut<'_>) {
        for (offset, value) in self.values.iter().enumerate() {
            let copied = out.slice_mut(first + offset).copy_from(value.data.as_slice());
            assert!(copied, "field {} does not fit factor `{}`", first + offset, self.names[offset]);
        }
    }
}

/// An assignment as plain numbers, for an environment's saved state; turn it into a [`Fov`] with
/// [`FovSpace::recall`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SavedFov {
    values: Vec<f64>,
    touched: Vec<bool>,
}

impl Fov {
    /// The assignment as plain numbers.
    pub fn save(&self) -> SavedFov {
        let numbers = self.iter().flat_map(|(name, value)| value.to_f64s(name).expect("factors are numbers"));
        SavedFov { values: numbers.collect(), touched: self.touched.clone() }
    }
}

impl FovSpace {
    /// The assignment that was saved.
    ///
    /// # Errors
    ///
    /// [`FovError::Foreign`]: it was saved from another space; or one of its values lies outside of this one.
    pub fn recall(&self, saved: &SavedFov) -> Result<Fov, FovError> {
        let mut fov = self.defaults();
        let mut rest = saved.values.as_slice();
        let width: usize = fov.values.iter().map(|value| value.data.len()).sum();
        if rest.len() != width || saved.touched.len() != fov.touched.len() {
            return Err(FovError::Foreign { found: rest.len(), expected: width });
        }
        for index in 0..fov.values.len() {
            let (numbers, tail) = rest.split_at(fov.values[index].data.len());
            fov.values[index] = self.fit(index, &Value::vector(numbers))?;
            rest = tail;
        }
        fov.touched.clone_from(&saved.touched);
        Ok(fov)
    }
}
