//! What success is, as data: conditions on the columns of a step, outside of any environment, so that every policy is
//! judged by the same test from the first step on.

use serde::{Deserialize, Serialize};

use crate::batch::{Row, Schema};
use crate::env::VARIATION_PREFIX;
use crate::error::WorldError;

/// When an episode is a success. Without conditions the environment says so itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SuccessRule {
    /// In how many rows on end the conditions must hold; 1: at any step.
    #[serde(default = "one")]
    pub hold: u64,
    /// All of them must hold.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub all: Vec<Condition>,
}

fn one() -> u64 {
    1
}

impl Default for SuccessRule {
    fn default() -> Self {
        Self { hold: 1, all: Vec::new() }
    }
}

/// Some elements of a column are near those of another.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Condition {
    /// The column that changes: `state`.
    pub column: String,
    /// What it is compared with: `goal_state`.
    pub goal: String,
    /// Which elements of both; empty: all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub elements: Vec<usize>,
    /// How the difference is measured.
    pub measure: Measure,
    /// For [`Measure::Angle`]: what a full turn is, in the column's unit. 2π unless given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub turn: Option<f64>,
    /// For [`Measure::Angle`]: a factor by which the turn is divided, as of a shape that looks the same from several sides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub symmetry: Option<Symmetry>,
    /// The measure must be smaller than this.
    pub below: f64,
}

/// Into how many equal parts a full turn is divided, by the value of a factor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Symmetry {
    /// The column of the factor, a whole number: `variation.block.shape`.
    pub column: String,
    /// Pairs of a value and the number of parts; values that are not listed have one part: `[[4, 4]]` for a square of number 4.
    pub folds: Vec<[u32; 2]>,
}

impl Symmetry {
    fn parts(&self, value: f64) -> f64 {
        let found = self.folds.iter().find(|[known, _]| f64::from(*known) == value);
        found.map_or(1.0, |&[_, parts]| parts.into())
    }
}

/// How a difference of several numbers becomes one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Measure {
    /// The Euclidean distance.
    Distance,
    /// The largest absolute difference.
    Largest,
    /// The largest absolute difference up to full turns.
    Angle,
    /// The angle between two quaternions (w x y z), rad: the smallest over the 24 rotations that map a cube onto itself.
    CubeRotation,
}

impl SuccessRule {
    /// Whether the environment's own test decides.
    pub fn is_environment(&self) -> bool {
        self.all.is_empty()
    }

    /// The rule for tables of `schema`; `None` if the environment decides.
    ///
    /// # Errors
    ///
    /// [`WorldError::Option`]: `hold` is 0, or more than 1 without a condition; a condition does not fit the columns
    /// of `schema`.
    pub fn judge(&self, schema: &Schema) -> Result<Option<Judge>, WorldError> {
        let wrong = |reason: String| Err(WorldError::Option { option: "success", reason });
        if self.hold == 0 {
            return wrong("hold is 0 rows; use 1 or more".to_owned());
        }
        if self.is_environment() {
            return match self.hold {
                1 => Ok(None),
                hold => wrong(format!("hold is {hold} rows of no condition; the environment's own has 1")),
            };
        }
        let tests = self.all.iter().map(|condition| Test::new(condition, schema));
        Ok(Some(Judge { hold: self.hold, tests: tests.collect::<Result<_, _>>()? }))
    }

    /// The rule in words.
    pub fn describe(&self) -> String {
        if self.is_environment() {
            return "the environment's own, at any step".to_owned();
        }
        let conditions: Vec<String> = self.all.iter().map(Condition::describe).collect();
        let held = match self.hold {
            1 => "at any step".to_owned(),
            hold => format!("in {hold} steps in a row"),
        };
        format!("{}, {held}", conditions.join(" and "))
    }
}

impl Condition {
    fn describe(&self) -> String {
        let Self { column, goal, elements, measure, symmetry, below, .. } = self;
        let elements = if elements.is_empty() { String::new() } else { format!("{elements:?}") };
        let measure = match measure {
            Measure::Distance => "distance",
            Measure::Largest => "largest difference",
            Measure::Angle => {
                let degrees = (below.to_degrees() * 10.0).round() / 10.0;
                let by = symmetry.as_ref().map_or(String::new(), |symmetry| {
                    format!(
                        ", modulo the symmetry by {}",
                        symmetry.column.trim_start_matches(VARIATION_PREFIX)
                    )
                });
                return format!("angle of {column}{elements} within {degrees}° of {goal}{elements}{by}");
            }
            Measure::CubeRotation => "rotation, as of a cube,",
        };
        format!(
            "{measure} between {column}{elements} and {goal}{elements} below {}",
            (below * 1e4).round() / 1e4
        )
    }
}

/// A rule, found in the columns of one kind of table.
#[derive(Clone, Debug, PartialEq)]
pub struct Judge {
    hold: u64,
    tests: Vec<Test>,
}

#[derive(Clone, Debug, PartialEq)]
struct Test {
    /// Positions of the two columns, and elements.
    columns: [usize; 2],
    elements: Vec<usize>,
    measure: Measure,
    turn: f64,
    /// Position of the factor's column.
    symmetry: Option<(usize, Symmetry)>,
    below: f64,
}

impl Test {
    fn new(condition: &Condition, schema: &Schema) -> Result<Self, WorldError> {
        let wrong = |reason: String| WorldError::Option { option: "success", reason };
        let Condition { column, goal, elements, measure, turn, symmetry, below } = condition;
        let columns = [schema.require(column)?, schema.require(goal)?];
        let dim = columns.map(|index| schema.dim(index));
        let elements: Vec<usize> =
            if elements.is_empty() { (0..dim[0].min(dim[1])).collect() } else { elements.clone() };
        if let Some(element) = elements.iter().find(|&&element| element >= dim[0].min(dim[1])) {
            let reason = format!("element {element} of `{column}` ({}) and `{goal}` ({})", dim[0], dim[1]);
            return Err(wrong(format!("{reason}: there are not so many")));
        }
        if *measure == Measure::CubeRotation && elements.len() != 4 {
            let reason =
                format!("a rotation has 4 elements, and `{column}` is compared in {}", elements.len());
            return Err(wrong(reason));
        }
        let turn = turn.unwrap_or(std::f64::consts::TAU);
        if !(*below > 0.0 && below.is_finite() && turn > 0.0 && turn.is_finite()) {
            return Err(wrong(format!("`{column}`: below {below} and turn {turn} must be positive numbers")));
        }
        let symmetry = match symmetry {
            Some(symmetry)
                if *measure != Measure::Angle || symmetry.folds.iter().any(|fold| fold[1] == 0) =>
            {
                let reason = "a symmetry divides an angle's turn into 1 part or more";
                return Err(wrong(format!("`{column}`, symmetry by `{}`: {reason}", symmetry.column)));
            }
            Some(symmetry) => Some((schema.require(&symmetry.column)?, symmetry.clone())),
            None => None,
        };
        Ok(Self { columns, elements, measure: *measure, turn, symmetry, below: *below })
    }

    /// The measure; infinite if it is no number, which is never near.
    fn measure(&self, mut number: impl FnMut(usize, usize) -> f64) -> f64 {
        let [column, goal] = self.columns;
        let parts =
            self.symmetry.as_ref().map_or(1.0, |(factor, symmetry)| symmetry.parts(number(*factor, 0)));
        let turn = self.turn / parts;
        let known = |value: f64| if value.is_nan() { f64::INFINITY } else { value };
        let pairs = self.elements.iter().map(|&element| (number(column, element), number(goal, element)));
        match self.measure {
            Measure::Distance => pairs.map(|(a, b)| known((a - b) * (a - b))).sum::<f64>().sqrt(),
            Measure::Largest => pairs.map(|(a, b)| known((a - b).abs())).fold(0.0, f64::max),
            Measure::Angle => pairs
                .map(|(a, b)| {
                    let rest = (a - b).abs().rem_euclid(turn);
                    known(rest.min(turn - rest))
                })
                .fold(0.0, f64::max),
            Measure::CubeRotation => {
                let mut rotations = [[0.0; 4]; 2];
                for (index, (a, b)) in pairs.enumerate() {
                    (rotations[0][index], rotations[1][index]) = (a, b);
                }
                known(cube_angle(rotations))
            }
        }
    }
}

/// The smallest angle that turns a cube from one orientation into one that looks like the other, rad; quaternions w x y z of
/// any length; NaN if one is not finite.
///
/// Source: H. Grimmer, "Disorientations and coincidence rotations for cubic lattices", Acta Crystallographica A30 (1974): of the
/// 24 equivalent rotations the smallest has the cosine of half its angle as below, from the sizes of the quaternion's numbers.
fn cube_angle([a, b]: [[f64; 4]; 2]) -> f64 {
    if a.iter().chain(&b).any(|x| !x.is_finite()) {
        return f64::NAN;
    }
    let length = |q: [f64; 4]| q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let mut between = [
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3],
        a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2],
        a[0] * b[2] + a[1] * b[3] - a[2] * b[0] - a[3] * b[1],
        a[0] * b[3] - a[1] * b[2] + a[2] * b[1] - a[3] * b[0],
    ]
    .map(f64::abs);
    between.sort_by(|x, y| y.total_cmp(x));
    let [first, second, third, fourth] = between;
    let half_turn = first
        .max((first + second) * std::f64::consts::FRAC_1_SQRT_2)
        .max((first + second + third + fourth) / 2.0);
    2.0 * (half_turn / (length(a) * length(b))).min(1.0).acos()
}

impl Judge {
    /// In how many rows on end the conditions must hold.
    pub fn hold(&self) -> u64 {
        self.hold
    }

    /// How near the goal is, as a part of what is allowed: the largest of all conditions. Below 1 the goal is reached.
    /// `number(column, element)` reads the row.
    pub fn margin(&self, mut number: impl FnMut(usize, usize) -> f64) -> f64 {
        self.tests.iter().fold(0.0, |worst, test| worst.max(test.measure(&mut number) / test.below))
    }

    /// [`Judge::margin`] of a row.
    pub fn margin_of(&self, row: Row<'_>) -> f64 {
        self.margin(|column, element| row.at(column).as_f64(element).unwrap_or(f64::NAN))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::{Batch, Dtype, Field};

    fn condition(elements: &[usize], measure: Measure, below: f64) -> Condition {
        let (column, goal) = ("state".to_owned(), "goal".to_owned());
        Condition { column, goal, elements: elements.to_vec(), measure, turn: None, symmetry: None, below }
    }

    fn margin(rule: &SuccessRule, state: [f64; 3], goal: [f64; 3]) -> f64 {
        let fields = ["state", "goal"].map(|name| Field::step(name, Dtype::F64, &[3]));
        let mut batch = Batch::new(Schema::new(fields.to_vec()).unwrap(), 1);
        batch.rows_mut().write(0, &state);
        batch.rows_mut().write(1, &goal);
        rule.judge(batch.schema()).unwrap().unwrap().margin_of(batch.row(0))
    }

    #[test]
    fn margins_are_the_largest_part_of_what_is_allowed() {
        let all = vec![condition(&[0, 1], Measure::Distance, 10.0), condition(&[2], Measure::Angle, 0.5)];
        let rule = SuccessRule { hold: 1, all };
        assert!((margin(&rule, [3.0, 4.0, 0.0], [0.0; 3]) - 0.5).abs() < 1e-12);
        let seam = margin(&rule, [0.0, 0.0, 6.2], [0.0, 0.0, 0.0]);
        assert!((seam - (std::f64::consts::TAU - 6.2) / 0.5).abs() < 1e-12, "{seam}");
        assert_eq!(margin(&rule, [f64::NAN, 0.0, 0.0], [0.0; 3]), f64::INFINITY);
        let largest = SuccessRule { hold: 1, all: vec![condition(&[], Measure::Largest, 2.0)] };
        assert!((margin(&largest, [1.0, -3.0, 0.5], [0.0; 3]) - 1.5).abs() < 1e-12);
    }

    #[test]
    fn a_turn_is_divided_by_the_symmetry_of_a_shape() {
        let fields = [
            Field::step("state", Dtype::F64, &[1]),
            Field::step("goal", Dtype::F64, &[1]),
            Field::episode("variation.shape", Dtype::I64, &[]),
        ];
        let mut batch = Batch::new(Schema::new(fields.to_vec()).unwrap(), 1);
        let symmetry = Symmetry { column: "variation.shape".to_owned(), folds: vec![[3, 2], [4, 4]] };
        let rule = |symmetry| SuccessRule {
            hold: 1,
            all: vec![Condition { symmetry: Some(symmetry), ..condition(&[0], Measure::Angle, 0.1) }],
        };
        let judge = rule(symmetry.clone()).judge(batch.schema()).unwrap().unwrap();
        for (shape, degrees, error) in
            [(2, 90.0, 90.0), (4, 90.0, 0.0), (4, 50.0, 40.0), (3, 170.0, 10.0), (3, 90.0, 90.0)]
        {
            batch.rows_mut().write(0, &[f64::to_radians(degrees)]);
            batch.rows_mut().write(1, &[0.0]);
            batch.rows_mut().write(2, &[i64::from(shape)]);
            let margin = judge.margin_of(batch.row(0)) * 0.1;
            assert!((margin.to_degrees() - error).abs() < 1e-9, "{shape}, {degrees}: {margin}");
        }
        assert!(rule(symmetry.clone()).describe().ends_with("modulo the symmetry by shape, at any step"));
        let none = Symmetry { folds: vec![[1, 0]], ..symmetry };
        assert!(rule(none).judge(batch.schema()).unwrap_err().to_string().contains("1 part or more"));
    }

    #[test]
    fn a_cube_looks_the_same_from_24_sides() {
        let about = |axis: [f64; 3], degrees: f64| {
            let (sin, cos) = (degrees.to_radians() / 2.0).sin_cos();
            [cos, axis[0] * sin, axis[1] * sin, axis[2] * sin]
        };
        let degrees = |a, b| cube_angle([a, b]).to_degrees();
        let level = [1.0, 0.0, 0.0, 0.0];
        for (turn, expected) in
            [(10.0, 10.0), (45.0, 45.0), (80.0, 10.0), (90.0, 0.0), (190.0, 10.0), (-95.0, 5.0)]
        {
            for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                assert!((degrees(about(axis, turn), level) - expected).abs() < 1e-5, "{axis:?} by {turn}");
                let shared = about([0.6, 0.0, 0.8], 33.0);
                let turned = degrees(about(axis, turn).map(|x| 2.0 * x), level);
                assert!((turned - expected).abs() < 1e-5, "of any length: {turned}");
                assert!(degrees(shared, shared) < 1e-5);
            }
        }
        let diagonal = [1.0, 1.0, 1.0].map(|x: f64| x / 3.0_f64.sqrt());
        assert!(degrees(about(diagonal, 120.0), level) < 1e-5);
        assert!((degrees(about(diagonal, 60.0), level) - 60.0).abs() < 1e-5);
        // No two orientations of a cube are farther apart.
        let worst = (0..2000).map(f64::from).fold(0.0_f64, |worst, k| {
            let q = [(0.7 * k).sin(), (1.3 * k).cos(), (2.1 * k).sin(), (0.4 * k).cos()];
            worst.max(degrees(q, level))
        });
        assert!((50.0..62.8).contains(&worst), "{worst}");
        assert!(cube_angle([[f64::NAN, 0.0, 0.0, 0.0], level]).is_nan());
    }

    #[test]
    fn rules_that_cannot_be_are_refused() {
        let fields = ["state", "goal"].map(|name| Field::step(name, Dtype::F64, &[3]));
        let schema = Schema::new(fields.to_vec()).unwrap();
        let message = |rule: &SuccessRule| rule.judge(&schema).unwrap_err().to_string();
        let of = |condition| SuccessRule { hold: 1, all: vec![condition] };
        assert!(message(&of(condition(&[3], Measure::Largest, 1.0))).contains("element 3"));
        assert!(message(&of(condition(&[], Measure::Largest, 0.0))).contains("positive"));
        let unknown = Condition { goal: "gaol".to_owned(), ..condition(&[], Measure::Largest, 1.0) };
        assert!(message(&of(unknown)).contains("did you mean `goal`?"));
        assert!(message(&of(condition(&[], Measure::CubeRotation, 1.0))).contains("4 elements"));
        assert!(message(&SuccessRule { hold: 0, all: Vec::new() }).contains("hold is 0"));
        assert!(message(&SuccessRule { hold: 3, all: Vec::new() }).contains("of no condition"));
        assert_eq!(SuccessRule::default().judge(&schema).unwrap(), None);
    }
}
