//! Tables of plain text.

/// A plain table: columns as wide as their widest cell, those of numbers to the right. On a terminal that is too narrow for it,
/// cells of several words are continued below.
pub(crate) fn table(header: &[&str], rows: impl IntoIterator<Item: Into<Vec<String>>>) -> String {
    let rows: Vec<Vec<String>> = rows.into_iter().map(Into::into).collect();
    table_within(terminal_columns(), header, &rows)
}

/// Characters in a line of the terminal that the results go to; `None` where they go elsewhere.
pub(crate) fn terminal_columns() -> Option<usize> {
    #[cfg(unix)]
    {
        let size = rustix::termios::tcgetwinsize(std::io::stdout()).ok()?;
        // Some terminals do not know their size.
        (size.ws_col > 0).then_some(size.ws_col.into())
    }
    #[cfg(not(unix))]
    None
}

/// Between columns.
const GAP: &str = "  ";

/// As [`table`], in lines of at most `most` characters where the words allow it.
fn table_within(most: Option<usize>, header: &[&str], rows: &[Vec<String>]) -> String {
    let cells = |column: usize| rows.iter().map(move |row| row[column].as_str()).chain([header[column]]);
    let longest = |column: usize| cells(column).map(length).max().unwrap_or(0);
    let mut widths: Vec<usize> = (0..header.len()).map(longest).collect();
    if let Some(most) = most {
        let least: Vec<usize> =
            (0..header.len()).map(|column| cells(column).map(longest_word).max().unwrap_or(0)).collect();
        narrow(&mut widths, &least, most);
    }
    let is_number = |cell: &str| cell.starts_with(|c: char| c.is_ascii_digit() || c == '-' || c == '+');
    let is_empty = |cell: &str| ["", "–", "-"].contains(&cell);
    let numeric: Vec<bool> = (0..header.len())
        .map(|column| rows.iter().all(|row| is_number(&row[column]) || is_empty(&row[column])))
        .collect();
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let padded = cells.zip(widths.iter().zip(&numeric)).map(|(cell, (&width, &numeric))| {
            let pad = " ".repeat(width.saturating_sub(length(cell)));
            if numeric && is_number(cell) { format!("{pad}{cell}") } else { format!("{cell}{pad}") }
        });
        padded.collect::<Vec<_>>().join(GAP).trim_end().to_owned() + "\n"
    };
    let lines = |row: &mut dyn Iterator<Item = &str>| -> String {
        let cells: Vec<Vec<String>> = row.zip(&widths).map(|(cell, &width)| wrapped(cell, width)).collect();
        let height = cells.iter().map(Vec::len).max().unwrap_or(0);
        let at = |index: usize| cells.iter().map(move |cell| cell.get(index).map_or("", String::as_str));
        (0..height).map(|index| line(&mut at(index))).collect()
    };
    let rule: Vec<String> = widths.iter().map(|&width| "─".repeat(width)).collect();
    let mut text = lines(&mut header.iter().copied());
    text += &line(&mut rule.iter().map(String::as_str));
    text.extend(rows.iter().map(|row| lines(&mut row.iter().map(String::as_str))));
    text
}

fn length(text: &str) -> usize {
    text.chars().count()
}

/// Places where a line may end: behind blanks and commas.
fn words(cell: &str) -> impl Iterator<Item = &str> {
    cell.split_inclusive([' ', ','])
}

/// The length of the longest word, which a cell is no narrower than; blanks in front of the first word belong to it.
fn longest_word(cell: &str) -> usize {
    let indent = length(cell) - length(cell.trim_start());
    words(cell.trim_start()).map(|word| length(word.trim_end())).max().unwrap_or(0) + indent
}

/// Takes from the widest columns until a line has at most `most` characters, or no column can be narrower.
fn narrow(widths: &mut [usize], least: &[usize], most: usize) {
    let gaps = GAP.len() * widths.len().saturating_sub(1);
    while widths.iter().sum::<usize>() + gaps > most {
        let spare = (0..widths.len()).filter(|&column| widths[column] > least[column]);
        let Some(widest) = spare.max_by_key(|&column| widths[column]) else { return };
        widths[widest] -= 1;
    }
}

/// A cell in lines of at most `width` characters, where its words allow it.
fn wrapped(cell: &str, width: usize) -> Vec<String> {
    if length(cell) <= width {
        return vec![cell.to_owned()];
    }
    let indent = &cell[..cell.len() - cell.trim_start().len()];
    let mut lines: Vec<String> = Vec::new();
    for word in words(cell.trim_start()) {
        match lines.last_mut() {
            Some(line) if length(line) + length(word.trim_end()) <= width => line.push_str(word),
            _ => lines.push(format!("{indent}{word}")),
        }
    }
    lines.iter_mut().for_each(|line| line.truncate(line.trim_end().len()));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<Vec<String>> {
        let row = |cells: [&str; 3]| cells.map(str::to_owned).to_vec();
        vec![
            row(["  short", "10", "a few words, and then some more of them"]),
            row(["longest", "7", "cem:samples=100,iterations=30"]),
        ]
    }

    #[test]
    fn tables_align() {
        let text = table_within(
            None,
            &["name", "n"],
            &[vec!["a".into(), "10".into()], vec!["long".into(), "7".into()]],
        );
        assert_eq!(text, "name  n\n────  ──\na     10\nlong   7\n");
    }

    #[test]
    fn wide_tables_are_continued_below() {
        let text = table_within(Some(32), &["name", "n", "what it does"], &rows());
        let expected = "\
name     n   what it does
───────  ──  ───────────────────
  short  10  a few words, and
             then some more of
             them
longest   7  cem:samples=100,
             iterations=30
";
        assert_eq!(text, expected);
        assert_eq!(
            table_within(Some(200), &["", "", ""], &rows()),
            table_within(None, &["", "", ""], &rows())
        );
    }

    #[test]
    fn words_stay_whole() {
        let text = table_within(Some(5), &["", "", ""], &rows());
        assert!(text.contains("samples=100,\n") && text.contains("longest"), "{text}");
    }
}
