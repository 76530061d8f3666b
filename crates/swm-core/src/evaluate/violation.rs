//! Pairs of episodes for violation of expectation, made by the simulator: both go the same way, until in one of them something
//! happens that cannot. How surprised a model is by each is `quality::surprise`.

use std::sync::Arc;

use crate::batch::{Batch, Field, Row, Schema, Value};
use crate::env::{Env, Episode, ResetOptions};
use crate::error::{BoxError, WorldError};
use crate::run::Cancel;
use crate::seed::{EpisodeSeed, keyed};

use super::state_model::{ActionColumn, defaults, rows_with_actions, start_at};

/// Something that cannot happen.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Violation {
    /// Everything is suddenly where it is in another episode.
    Teleport,
    /// Elements of one of the environment's start columns take other values at once: a place out of the image lets a thing
    /// vanish.
    Set {
        /// The column: `state`.
        column: String,
        /// Which elements of it.
        elements: Vec<usize>,
        /// Their values from then on.
        to: Vec<f64>,
    },
    /// A factor of variation takes another value at once: a color.
    Factor {
        /// Its name: `block.color`.
        name: String,
    },
}

/// How pairs are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViolationOptions {
    /// Pairs.
    pub pairs: usize,
    /// Rows of every episode.
    pub rows: usize,
    /// The first row that cannot be: at least 1.
    pub at: usize,
    /// Seed of starts, actions and changes.
    pub seed: u64,
}

impl Default for ViolationOptions {
    /// 20 pairs of 30 rows, the violation in the middle, seed 42.
    fn default() -> Self {
        Self { pairs: 20, rows: 30, at: 15, seed: 42 }
    }
}

/// `[possible, impossible]`, of random actions and with the factors' defaults; each a table of the environment's fields and
/// `action`. Before row `at` the two are equal. There both are reset to the state of `at`, so that what a reset forgets is
/// forgotten in both, and no trace of the making tells them apart.
///
/// # Errors
///
/// The violation comes before the second row or after the last, the environment has no such column or factor or
/// cannot be reset to a recorded state, or a step fails.
pub fn violation_pairs(
    env: &mut dyn Env,
    violation: &Violation,
    options: &ViolationOptions,
) -> Result<Vec<[Batch; 2]>, BoxError> {
    let ViolationOptions { pairs, rows, at, .. } = *options;
    if !(1..rows).contains(&at) {
        return Err(format!("the violation at row {at} of {rows}: it must come after the first").into());
    }
    check(env, violation)?;
    let schema = rows_with_actions(env.spec())?;
    let mut maker = Maker { action: ActionColumn::new(&env.spec().action), env, schema, options };
    (0..pairs as u64).map(|pair| maker.pair(violation, pair)).collect()
}

/// Episodes of random actions with the factors' defaults, `rows` rows each: tables of the environment's fields and `action`.
///
/// # Errors
///
/// The environment has a field called `action`, a reset or step fails, or `cancel` is set meanwhile.
pub fn random_episodes(
    env: &mut dyn Env,
    episodes: usize,
    rows: usize,
    seed: u64,
    cancel: &Cancel,
) -> Result<Vec<Batch>, BoxError> {
    let options = ViolationOptions { pairs: episodes, rows, at: rows, seed };
    let schema = rows_with_actions(env.spec())?;
    let mut maker = Maker { action: ActionColumn::new(&env.spec().action), env, schema, options: &options };
    (0..episodes as u64)
        .map(|episode| {
            if cancel.is_cancelled() {
                return Err(WorldError::Cancelled.into());
            }
            let mut batch = Batch::new(maker.schema.clone(), rows);
            maker.begin(episode, &defaults())?;
            maker.fill(&mut batch, episode, 0, rows)?;
            Ok(batch)
        })
        .collect()
}

/// Whether the environment can do it at all.
fn check(env: &dyn Env, violation: &Violation) -> Result<(), BoxError> {
    let spec = env.spec();
    if spec.start_columns.is_empty() {
        return Err(
            format!("{} cannot be reset to a recorded state: it names no start columns", spec.id).into()
        );
    }
    match violation {
        Violation::Teleport => Ok(()),
        Violation::Set { column, elements, to } => {
            let dim = spec.fields.iter().find(|field| field.name == *column).map(Field::dim);
            let starts = spec.start_columns.contains(&column.as_str());
            let fits = elements.len() == to.len() && elements.iter().all(|&e| Some(e) < dim);
            match starts && fits {
                true => Ok(()),
                false => Err(format!(
                    "elements {elements:?} of `{column}` cannot be set to {to:?} in {}; its start columns are `{}`",
                    spec.id,
                    spec.start_columns.join("`, `")
                )
                .into()),
            }
        }
        Violation::Factor { name } => match spec.factors.iter().any(|factor| factor.name == *name) {
            true => Ok(()),
            false => {
                Err(format!("{} has no factor `{name}`; `swm envs {}` lists them", spec.id, spec.id).into())
            }
        },
    }
}

struct Maker<'a> {
    env: &'a mut dyn Env,
    action: ActionColumn,
    schema: Arc<Schema>,
    options: &'a ViolationOptions,
}

impl Maker<'_> {
    fn pair(&mut self, violation: &Violation, pair: u64) -> Result<[Batch; 2], BoxError> {
        let ViolationOptions { rows, at, .. } = *self.options;
        let mut possible = Batch::new(self.schema.clone(), rows);
        self.begin(pair, &defaults())?;
        self.fill(&mut possible, pair, 0, at + 1)?;
        let mut impossible = possible.clone();
        let here = ResetOptions { start: Some(start_at(self.env.spec(), possible.row(at))?), ..defaults() };
        let there = self.changed(&here, violation, pair, possible.row(at))?;
        for (batch, options) in [(&mut possible, &here), (&mut impossible, &there)] {
            self.begin(pair, options)?;
            self.fill(batch, pair, at, rows)?;
        }
        Ok([possible, impossible])
    }

    fn begin(&mut self, pair: u64, options: &ResetOptions) -> Result<(), BoxError> {
        let seed = EpisodeSeed::of(self.options.seed, pair);
        self.env.reset(&Episode::new(seed, options))?;
        Ok(())
    }

    /// Writes rows `from..to`, of which the environment is at the first. The actions are those of the pair.
    fn fill(&mut self, batch: &mut Batch, pair: u64, from: usize, to: usize) -> Result<(), BoxError> {
        let action = self.schema.require("action")?;
        for row in from..to {
            let rows = &mut batch.rows_mut();
            rows.select(row);
            self.env.write_episode(rows);
            self.env.observe(rows);
            self.action.sample(self.options.seed, pair, row as u64);
            if !rows.slice_mut(action).copy_from(self.action.as_slice()) {
                return Err("the column `action` and the actions differ in type".into());
            }
            if row + 1 < to {
                self.env.step(self.action.as_slice())?;
            }
        }
        Ok(())
    }

    /// How the impossible episode goes on.
    fn changed(
        &mut self,
        here: &ResetOptions,
        violation: &Violation,
        pair: u64,
        row: Row<'_>,
    ) -> Result<ResetOptions, BoxError> {
        let mut there = here.clone();
        match violation {
            Violation::Teleport => {
                // A pair of its own, which no other begins with.
                let other = pair + self.options.pairs as u64;
                let at = self.options.at;
                let mut elsewhere = Batch::new(self.schema.clone(), at + 1);
                self.begin(other, &defaults())?;
                self.fill(&mut elsewhere, other, 0, at + 1)?;
                there.start = Some(start_at(self.env.spec(), elsewhere.row(at))?);
            }
            Violation::Set { column, elements, to } => {
                let index = row.schema().require(column)?;
                let field = &row.schema().fields()[index];
                let mut numbers: Vec<f64> =
                    (0..field.dim()).map(|i| row.at(index).as_f64(i).unwrap_or(f64::NAN)).collect();
                elements.iter().zip(to).for_each(|(&element, &value)| numbers[element] = value);
                let value = Value { shape: field.shape.clone(), ..Value::vector(&numbers) };
                there.start.get_or_insert_default().insert(column.clone(), value);
            }
            Violation::Factor { name } => {
                let value = self.other_value(name, pair)?;
                there.variation_values.insert(name.clone(), value);
            }
        }
        Ok(there)
    }

    /// A value of a factor that is not its default.
    fn other_value(&self, name: &str, pair: u64) -> Result<Value, BoxError> {
        const TRIES: u64 = 64;
        let factor = self.env.spec().factors.iter().find(|factor| factor.name == name);
        let factor = factor.ok_or_else(|| format!("no factor `{name}`"))?;
        (0..TRIES)
            .map(|attempt| {
                factor.space.sample(&mut keyed(self.options.seed, "violation factor", [pair, attempt]))
            })
            .find(|value| value.to_json() != factor.default)
            .ok_or_else(|| format!("the factor `{name}` has one value alone: it cannot change").into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::EnvConfig;
    use crate::evaluate::StateModel;
    use crate::evaluate::quality::{surprise, violation_accuracy};
    use crate::testing::TOY;

    const OPTIONS: ViolationOptions = ViolationOptions { pairs: 6, rows: 9, at: 4, seed: 1 };

    fn pairs(violation: &Violation) -> Result<Vec<[Batch; 2]>, BoxError> {
        let mut env = TOY.make(&EnvConfig::default())?;
        violation_pairs(env.as_mut(), violation, &OPTIONS)
    }

    fn states(batch: &Batch) -> &[f64] {
        batch.get::<f64>("state").unwrap()
    }

    #[test]
    fn pairs_part_at_the_row_that_cannot_be() {
        let vanish = Violation::Set { column: "state".to_owned(), elements: vec![0], to: vec![1000.0] };
        for violation in [Violation::Teleport, vanish] {
            for [possible, impossible] in pairs(&violation).unwrap() {
                let (a, b) = (states(&possible), states(&impossible));
                assert_eq!(a[..4], b[..4]);
                assert!((4..9).all(|row| a[row] != b[row]), "{violation:?}: {a:?} {b:?}");
                let actions = |batch: &Batch| batch.get::<f32>("action").unwrap().to_vec();
                assert_eq!(actions(&possible), actions(&impossible));
                // The rows of the possible one follow from each other, also where both were reset.
                let pushes = actions(&possible);
                assert!((1..9).all(|row| (a[row] - a[row - 1] - f64::from(pushes[row - 1])).abs() < 1e-12));
            }
        }
        assert_eq!(pairs(&Violation::Teleport).unwrap().len(), 6);
        let starts: Vec<f64> =
            pairs(&Violation::Teleport).unwrap().iter().map(|p| states(&p[0])[0]).collect();
        assert!(starts.windows(2).all(|two| two[0] != two[1]), "every pair starts elsewhere");
    }

    #[test]
    fn a_factor_changes_what_belongs_to_the_episode() {
        for [possible, impossible] in pairs(&Violation::Factor { name: "point.gain".to_owned() }).unwrap() {
            let gains = |batch: &Batch| batch.get::<f64>("variation.point.gain").unwrap().to_vec();
            assert_eq!(gains(&possible), [1.0; 9]);
            assert_eq!(gains(&impossible)[..4], [1.0; 4]);
            assert!(gains(&impossible)[4..].iter().all(|&gain| gain != 1.0));
            assert_eq!(states(&possible)[..5], states(&impossible)[..5], "it shows in what follows");
        }
    }

    #[test]
    fn a_model_that_knows_the_world_is_surprised_and_others_are_not() {
        let accuracy = |gain: Option<f64>| {
            let mut model = StateModel::new(&TOY, &EnvConfig::default(), gain).unwrap();
            let scores: Vec<[Vec<f64>; 2]> = pairs(&Violation::Teleport)
                .unwrap()
                .iter()
                .map(|pair| pair.each_ref().map(|rows| surprise(&mut model, rows).unwrap()))
                .collect();
            assert!(
                gain != Some(1.0) || scores.iter().all(|[possible, _]| possible.iter().all(|s| *s < 1e-20))
            );
            violation_accuracy(&scores).unwrap()
        };
        assert_eq!(accuracy(Some(1.0)), 1.0);
        assert!(accuracy(None) <= 1.0 && accuracy(Some(-20.0)) < 1.0, "its own errors hide the jump");
    }

    #[test]
    fn what_cannot_be_made_is_refused() {
        let message = |violation: &Violation| pairs(violation).unwrap_err().to_string();
        assert!(message(&Violation::Factor { name: "point.colour".to_owned() }).contains("no factor"));
        let set = |column: &str, element| Violation::Set {
            column: column.to_owned(),
            elements: vec![element],
            to: vec![0.0],
        };
        assert!(message(&set("state", 1)).contains("start columns are `state`"));
        assert!(message(&set("goal_state", 0)).contains("start columns are `state`"));
        let mut env = TOY.make(&EnvConfig::default()).unwrap();
        let late = ViolationOptions { at: 9, ..OPTIONS };
        assert!(violation_pairs(env.as_mut(), &Violation::Teleport, &late).is_err());
    }
}
