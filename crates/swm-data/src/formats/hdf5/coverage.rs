//! Whether the index of episodes and the columns of a file of others fit: every row belongs to one episode. Our own files are
//! written so, and after a kill may have rows of an unfinished episode.

use std::ops::Range;

use crate::error::{Result, invalid};

/// Rows that two episodes share, or that none has. `first` and `lengths` are those of the episodes, `rows` what the shortest column has.
pub(super) fn check(first: &[usize], lengths: &[usize], rows: usize) -> Result<()> {
    let mut spans: Vec<(Range<usize>, usize)> =
        first.iter().zip(lengths).enumerate().map(|(episode, (&at, &len))| (at..at + len, episode)).collect();
    spans.retain(|(span, _)| !span.is_empty());
    spans.sort_by_key(|(span, _)| span.start);
    let nobodys = |gap: Range<usize>| -> Result<()> {
        match gap.is_empty() {
            true => Ok(()),
            false => {
                Err(invalid(format!("no episode of `ep_offset` and `ep_len` has {} of {rows}", named(&gap))))
            }
        }
    };
    let mut before = (0, None);
    for (span, episode) in spans {
        if let (end, Some(other)) = before
            && span.start < end
        {
            let shared = named(&(span.start..end.min(span.end)));
            return Err(invalid(format!("episodes {other} and {episode} both have {shared}")));
        }
        nobodys(before.0..span.start)?;
        before = (span.end, Some(episode));
    }
    nobodys(before.0..rows)
}

fn named(rows: &Range<usize>) -> String {
    match rows.len() {
        1 => format!("row {}", rows.start),
        _ => format!("rows {} to {}", rows.start, rows.end - 1),
    }
}

#[cfg(test)]
mod tests {
    use super::check;

    #[test]
    fn every_row_belongs_to_one_episode() {
        let said = |first: &[usize], lengths: &[usize]| match check(first, lengths, 10) {
            Ok(()) => "fits".to_owned(),
            Err(error) => error.to_string(),
        };
        assert_eq!(said(&[0, 5], &[5, 5]), "fits");
        // In any order, and with an empty one.
        assert_eq!(said(&[6, 0, 0], &[4, 0, 6]), "fits");
        assert_eq!(said(&[0, 3], &[5, 7]), "episodes 0 and 1 both have rows 3 to 4");
        assert_eq!(said(&[0, 4], &[5, 6]), "episodes 0 and 1 both have row 4");
        assert_eq!(said(&[0, 5], &[5, 3]), "no episode of `ep_offset` and `ep_len` has rows 8 to 9 of 10");
        assert_eq!(said(&[1, 5], &[4, 5]), "no episode of `ep_offset` and `ep_len` has row 0 of 10");
        assert_eq!(said(&[], &[]), "no episode of `ep_offset` and `ep_len` has rows 0 to 9 of 10");
    }
}
