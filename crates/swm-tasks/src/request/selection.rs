//! Which episodes of a dataset a request is about.

use super::{Message, TaskError};

/// The numbers of episodes, below `count`, that the setting `episodes` names: `5`, `0..10`, `0,3,7`; `None`: all.
///
/// # Errors
///
/// [`TaskError::Request`]: it is no such text, or names an episode that there is not; [`TaskError::Unfit`]: there is none at all.
pub(super) fn selection(text: Option<&str>, count: usize) -> Result<Vec<usize>, TaskError> {
    if count == 0 {
        return Err("the dataset holds no episode".into());
    }
    let Some(text) = text else { return Ok((0..count).collect()) };
    let wrong = |why: String| TaskError::from(Message::about("episodes", text, why));
    let missing = |episode: usize| wrong(format!("there is no episode {episode}; the dataset holds {count}"));
    let number =
        |part: &str| part.trim().parse::<usize>().map_err(|_| wrong("write 5, 0..10 or 0,3,7".to_owned()));
    let chosen: Vec<usize> = match text.split_once("..") {
        Some((first, end)) => {
            let first = if first.is_empty() { 0 } else { number(first)? };
            let end = if end.is_empty() { count } else { number(end)? };
            if end > count {
                return Err(missing(first.max(count)));
            }
            (first..end).collect()
        }
        None => text.split(',').map(number).collect::<Result<_, _>>()?,
    };
    match chosen.iter().find(|&&episode| episode >= count) {
        Some(&episode) => Err(missing(episode)),
        None if chosen.is_empty() => Err(wrong("no episode is chosen".to_owned())),
        None => Ok(chosen),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn episodes_are_chosen_by_number_range_or_list() {
        assert_eq!(selection(None, 3).unwrap(), [0, 1, 2]);
        assert_eq!(selection(Some("1"), 3).unwrap(), [1]);
        assert_eq!(selection(Some("1.."), 3).unwrap(), [1, 2]);
        assert_eq!(selection(Some("0, 2"), 3).unwrap(), [0, 2]);
        for wrong in ["3", "a", "2..2", "0..4", "0..18446744073709551615", "2..0", "18446744073709551615.."] {
            let error = selection(Some(wrong), 3).unwrap_err();
            assert!(error.to_string().starts_with(&format!("episodes={wrong}: ")), "{error}");
        }
        assert!(matches!(selection(None, 0), Err(TaskError::Unfit(_))));
    }
}
