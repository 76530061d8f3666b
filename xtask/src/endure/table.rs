//! The table of results.

use std::fmt;

/// A kind of work or of files, and what came of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Line {
    /// `kill` or `damage`.
    pub(crate) stage: &'static str,
    pub(crate) kind: String,
    /// Kills, or damaged files.
    pub(crate) tried: usize,
    /// Kills amid the work; damage that was noticed.
    pub(crate) hit: usize,
    /// Episodes that were committed before a kill.
    pub(crate) committed: usize,
    /// Committed episodes that were gone.
    pub(crate) lost: usize,
    /// Results that differ from those of an undisturbed run.
    pub(crate) different: usize,
    pub(crate) panics: usize,
    pub(crate) hangs: usize,
    pub(crate) memory: usize,
    /// Of the longest run, in seconds.
    pub(crate) longest_s: f64,
}

impl Line {
    pub(crate) fn new(stage: &'static str, kind: impl Into<String>) -> Self {
        Self { stage, kind: kind.into(), ..Self::default() }
    }

    pub(crate) fn failures(&self) -> usize {
        self.lost + self.different + self.panics + self.hangs + self.memory
    }

    /// Adds the counts of another part of the same kind.
    pub(crate) fn add(&mut self, other: &Self) {
        self.tried += other.tried;
        self.hit += other.hit;
        self.committed += other.committed;
        self.lost += other.lost;
        self.different += other.different;
        self.panics += other.panics;
        self.hangs += other.hangs;
        self.memory += other.memory;
        self.longest_s = self.longest_s.max(other.longest_s);
    }
}

/// All of them.
#[derive(Debug, Default)]
pub(crate) struct Table(Vec<Line>);

impl Table {
    pub(crate) fn push(&mut self, line: Line) {
        self.0.push(line);
    }

    pub(crate) fn failures(&self) -> usize {
        self.0.iter().map(Line::failures).sum()
    }

    /// The sums of a stage.
    fn total(&self, stage: &'static str) -> Line {
        let mut total = Line::new(stage, "all");
        self.0.iter().filter(|line| line.stage == stage).for_each(|line| total.add(line));
        total
    }
}

/// As Markdown.
impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "| stage | kind | runs | amid work, or noticed | committed episodes | lost | differ | panics | hangs | above 2 GiB | longest, s |"
        )?;
        writeln!(f, "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|")?;
        let totals = ["kill", "damage"].map(|stage| self.total(stage));
        for line in self.0.iter().chain(totals.iter().filter(|total| total.tried > 0)) {
            let Line {
                stage,
                kind,
                tried,
                hit,
                committed,
                lost,
                different,
                panics,
                hangs,
                memory,
                longest_s,
            } = line;
            writeln!(
                f,
                "| {stage} | {kind} | {tried} | {hit} | {committed} | {lost} | {different} | {panics} | {hangs} | {memory} | {longest_s:.2} |"
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_ends_with_the_sums_of_each_stage() {
        let mut table = Table::default();
        let line = |kind: &str| Line { tried: 3, hit: 1, longest_s: 0.5, ..Line::new("kill", kind) };
        table.push(line("hdf5"));
        table.push(Line { lost: 1, longest_s: 0.25, ..line("job") });
        assert_eq!(table.failures(), 1);
        let text = table.to_string();
        assert!(text.ends_with("| kill | all | 6 | 2 | 0 | 1 | 0 | 0 | 0 | 0 | 0.50 |\n"), "{text}");
        assert!(!text.contains("damage"), "{text}");
    }
}
