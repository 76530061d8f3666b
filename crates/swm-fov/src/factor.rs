//! The declaration of factors and constraints.

use serde_json::{Map, Value as Json};
use swm_core::env::{FactorSpec, VARIATION_PREFIX, check_factor_name};
use swm_core::{Dtype, EnvError, Field, Space, Value};

use crate::assignment::{Fov, FovError};

/// One factor: a dotted name, a space, a default.
#[derive(Clone, Debug)]
pub struct Factor {
    pub(crate) spec: FactorSpec,
    pub(crate) default: Value,
}

impl Factor {
    /// A factor with any space; `default` must lie in it (checked by [`FovSpace::new`]).
    pub fn new(name: &str, space: Space, default: Value) -> Self {
        let spec = FactorSpec::new(name, space, default.to_json());
        Self { spec, default }
    }

    /// A color.
    pub fn rgb(name: &str, default: [u8; 3]) -> Self {
        Self::new(name, Space::Rgb, Value::vector(&default))
    }

    /// A real number (`f64`) in `low..=high`.
    pub fn scalar(name: &str, low: f64, high: f64, default: f64) -> Self {
        Self::new(name, Space::uniform_box(Dtype::F64, &[], low, high), Value::scalar(default))
    }

    /// A real number stored as `f32`, as the reference does for lengths that enter its geometry.
    pub fn scalar_f32(name: &str, low: f64, high: f64, default: f32) -> Self {
        Self::new(name, Space::uniform_box(Dtype::F32, &[], low, high), Value::scalar(default))
    }

    /// A vector of real numbers (`f64`), each in `low..=high`.
    pub fn vector(name: &str, low: f64, high: f64, default: &[f64]) -> Self {
        let space = Space::uniform_box(Dtype::F64, &[default.len()], low, high);
        Self::new(name, space, Value::vector(default))
    }

    /// A vector of real numbers stored as `f32`, each in `low..=high`.
    pub fn vector_f32(name: &str, low: f64, high: f64, default: &[f32]) -> Self {
        let space = Space::uniform_box(Dtype::F32, &[default.len()], low, high);
        Self::new(name, space, Value::vector(default))
    }

    /// Integers, each in `low..=high`.
    ///
    /// # Panics
    /// If the bounds are reversed or beyond 2⁵³: the table is source code, and the mistake is a bug in it.
    pub fn integers(name: &str, low: i64, high: i64, default: &[i64]) -> Self {
        let (n, count) = (values_within(name, low, high), default.len());
        let space = Space::MultiDiscrete { n: vec![n; count], start: vec![low; count] };
        Self::new(name, space, Value::vector(default))
    }

    /// An integer in `low..=high`.
    ///
    /// # Panics
    /// As of [`Factor::integers`].
    pub fn integer(name: &str, low: i64, high: i64, default: i64) -> Self {
        let n = values_within(name, low, high);
        Self::new(name, Space::Discrete { n, start: low }, Value::scalar(default))
    }

    /// Its dotted name.
    pub fn name(&self) -> &str {
        &self.spec.name
    }

    /// What it does, in a few words.
    #[must_use]
    pub fn doc(mut self, doc: &str) -> Self {
        self.spec.doc = doc.to_owned();
        self
    }

    /// It is sampled when a reset names no factors.
    #[must_use]
    pub fn sampled_by_default(mut self) -> Self {
        self.spec.sampled_by_default = true;
        self
    }

    /// It changes images and nothing else: a look of any recorded state.
    #[must_use]
    pub fn visual(mut self) -> Self {
        self.spec.visual = true;
        self
    }

    /// It changes nothing unless `factor` has `value`.
    #[must_use]
    pub fn shows_with(mut self, factor: &str, value: impl Into<Json>) -> Self {
        self.spec.shows_with.push((factor.to_owned(), value.into()));
        self
    }

    /// Names of its values, from the smallest on.
    #[must_use]
    pub fn choices(mut self, names: &[&str]) -> Self {
        self.spec.choices = names.iter().map(|&name| name.to_owned()).collect();
        self
    }
}

/// Integers are saved as `f64`, which holds them up to here.
const LARGEST_INTEGER: i64 = 1 << 53;

/// How many integers there are in `low..=high`.
fn values_within(name: &str, low: i64, high: i64) -> i64 {
    let most = i128::from(high) - i128::from(low) + 1;
    check_integers(name, low, most);
    high - low + 1
}

/// Panics unless the `n` integers from `low` on are one or more that a factor can hold.
fn check_integers(name: &str, low: i64, n: i128) {
    let high = i128::from(low) + n - 1;
    assert!(n > 0, "factor `{name}` has the bounds low {low} and high {high}: low must not be above high");
    assert!(
        low >= -LARGEST_INTEGER && high <= LARGEST_INTEGER.into(),
        "factor `{name}` has the bounds low {low} and high {high}: integers of a factor lie within ±{LARGEST_INTEGER}"
    );
}

/// Panics unless `space` can be sampled.
fn check_bounds(name: &str, space: &Space) {
    match space {
        Space::Box { dtype, shape, low, high } => {
            let (dim, lengths) = (shape.iter().product::<usize>(), [low.len(), high.len()]);
            assert!(
                lengths == [dim; 2],
                "factor `{name}` has {dim} values and {} lower and {} upper bounds",
                lengths[0],
                lengths[1]
            );
            let stored = |bound: f64| if *dtype == Dtype::F32 { f64::from(bound as f32) } else { bound };
            for (&low, &high) in low.iter().zip(high) {
                assert!(
                    (stored(high) - stored(low)).is_finite(),
                    "factor `{name}` has the bounds low {low:e} and high {high:e}: they and their difference must be finite {dtype}"
                );
                assert!(
                    low <= high,
                    "factor `{name}` has the bounds low {low} and high {high}: low must not be above high"
                );
            }
        }
        Space::Discrete { n, start } => check_integers(name, *start, (*n).into()),
        Space::MultiDiscrete { n, start } => {
            let (counts, starts) = (n.len(), start.len());
            assert!(counts == starts, "factor `{name}` has {counts} counts and {starts} lower bounds");
            n.iter().zip(start).for_each(|(&n, &start)| check_integers(name, start, n.into()));
        }
        Space::Rgb => {}
        Space::Dict { spaces } => {
            spaces.iter().for_each(|(part, space)| check_bounds(&format!("{name}.{part}"), space));
        }
    }
}

/// A rule between factors. It belongs to one of them, its owner: where the owner is sampled, it is sampled until the rule holds, up to
/// 1,000 times. An owner that is set, or keeps its default, is never changed: a reset whose values break a rule is refused.
#[derive(Clone, Debug)]
pub struct Constraint {
    /// The factor that is sampled again.
    pub owner: &'static str,
    /// The other factors that the rule reads; they must stand before the owner in the table.
    pub reads: &'static [&'static str],
    /// The rule in words: "on the other side of the wall than agent.position".
    pub words: &'static str,
    /// The rule.
    pub holds: fn(&Fov) -> bool,
}

/// All factors of an environment, in the order in which they are sampled.
#[derive(Clone, Debug)]
pub struct FovSpace {
    pub(crate) factors: Vec<Factor>,
    pub(crate) constraints: Vec<Constraint>,
}

impl FovSpace {
    /// A space without constraints.
    ///
    /// # Panics
    /// If two factors share a name, a name is one that resets read otherwise ([`check_factor_name`]), bounds are reversed or not finite, or a default lies outside its space: the table is source
    /// code, and the mistake is a bug in it.
    pub fn new(factors: Vec<Factor>) -> Self {
        for (index, factor) in factors.iter().enumerate() {
            let name = &factor.spec.name;
            check_factor_name(name).unwrap_or_else(|reason| panic!("{reason}"));
            check_bounds(name, &factor.spec.space);
            assert!(
                factor.spec.space.contains(&factor.default),
                "the default of `{name}`, {}, lies outside its space, {:?}",
                factor.default,
                factor.spec.space
            );
            let choices = factor.spec.choices.len() as i64;
            let has_all = |space: &Space| matches!(space, Space::Discrete { n, .. } if *n == choices);
            assert!(
                choices == 0 || has_all(&factor.spec.space),
                "`{name}` has {choices} names for another number of values"
            );
            assert!(
                !factors[..index].iter().any(|other| other.spec.name == *name),
                "two factors are named `{name}`"
            );
        }
        Self { factors, constraints: Vec::new() }
    }

    /// Adds constraints to those that the space has.
    ///
    /// # Panics
    /// If a constraint names a factor that does not exist, or reads one that is sampled after its owner.
    #[must_use]
    pub fn with_constraints(mut self, constraints: Vec<Constraint>) -> Self {
        for constraint in &constraints {
            let owner = self.position(constraint.owner);
            for read in constraint.reads {
                assert!(
                    self.position(read) < owner,
                    "`{}` reads `{read}`, which is sampled later",
                    constraint.owner
                );
            }
            let words = &mut self.factors[owner].spec.constraint;
            *words = Some(match words.take() {
                None => constraint.words.to_owned(),
                Some(others) => format!("{others}, and {}", constraint.words),
            });
        }
        self.constraints.extend(constraints);
        self
    }

    fn position(&self, name: &str) -> usize {
        let found = self.factors.iter().position(|factor| factor.spec.name == name);
        found.unwrap_or_else(|| panic!("a constraint names `{name}`, which is no factor"))
    }

    /// The same space with other defaults, by name: the setting `init_value` of the environment `env`.
    ///
    /// # Errors
    ///
    /// [`EnvError::Setting`]: no such factor, or a value outside of its space.
    pub fn with_defaults(mut self, env: &str, defaults: &Map<String, Json>) -> Result<Self, EnvError> {
        for (name, json) in defaults {
            let value = Value::from_json(name, json).map_err(|error| error.to_string());
            let set =
                value.and_then(|value| self.set_default(name, &value).map_err(|error| error.to_string()));
            set.map_err(|reason| EnvError::Setting {
                env: env.to_owned(),
                reason: format!("init_value: {reason}"),
            })?;
        }
        Ok(self)
    }

    fn set_default(&mut self, name: &str, value: &Value) -> Result<(), FovError> {
        let index = self.index(name)?;
        let value = self.fit(index, value)?;
        let factor = &mut self.factors[index];
        factor.spec.default = value.to_json();
        factor.default = value;
        Ok(())
    }

    /// The factors as data.
    pub fn specs(&self) -> Vec<FactorSpec> {
        self.factors.iter().map(|factor| factor.spec.clone()).collect()
    }

    /// The episode fields `variation.<name>`, in order.
    pub fn fields(&self) -> Vec<Field> {
        let field = |factor: &Factor| {
            let Factor { spec, default } = factor;
            Field::episode(&format!("{VARIATION_PREFIX}{}", spec.name), default.data.dtype(), &default.shape)
        };
        self.factors.iter().map(field).collect()
    }
}
