//! Pages with parts that commands write: between `<!-- NAME -->` and the next `<!-- end -->`.

use anyhow::{Context as _, Result};

/// The text of a page with `content` in the place `name`; `None` where it has no such place.
pub(crate) fn with_part(page: &str, name: &str, content: &str) -> Result<Option<String>> {
    const END: &str = "<!-- end -->";
    let begin = format!("<!-- {name} -->\n");
    let Some((head, rest)) = page.split_once(&begin) else { return Ok(None) };
    let (_, tail) = rest.split_once(END).with_context(|| format!("the part `{name}` has no {END}"))?;
    Ok(Some(format!("{head}{begin}{content}{END}{tail}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_is_replaced_where_the_page_has_it() {
        let page = "a\n<!-- t -->\nold\n<!-- end -->\nb\n";
        let current = with_part(page, "t", "new\n").unwrap();
        assert_eq!(current.as_deref(), Some("a\n<!-- t -->\nnew\n<!-- end -->\nb\n"));
        assert_eq!(with_part(page, "u", "new\n").unwrap(), None);
        with_part("<!-- t -->\nold\n", "t", "new\n").unwrap_err();
    }
}
