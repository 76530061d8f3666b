//! The code blocks of a page, and what the comments above them ask of the test. Readers of the book do not see comments.
//!
//! | comment | |
//! |---|---|
//! | `<!-- test: skip: REASON -->` | the block is not run |
//! | `<!-- test: needs WHAT -->` | it is run where that is at hand: a feature of `swm`, `mujoco-data`, `torch`, … |
//! | `<!-- test: exit N -->` | its last command ends with this status |
//! | `<!-- test: given NAME … -->` | anywhere on the page: files (`input_files.rs`) that lie in its folder |
//! | `<!-- test: rust here: REASON -->` | anywhere on the page: its blocks of Rust and TOML are tested elsewhere |

use std::path::Path;

/// A page.
pub(super) struct Page {
    /// Its path from the root.
    pub(super) name: String,
    pub(super) text: String,
    pub(super) blocks: Vec<Block>,
    /// Names of files that its commands find.
    pub(super) given: Vec<String>,
}

/// A fenced block.
pub(super) struct Block {
    /// Line of its fence, from 1.
    pub(super) line: usize,
    /// The first word after the fence; empty for none.
    pub(super) language: String,
    pub(super) attributes: Vec<String>,
    pub(super) text: String,
    pub(super) wishes: Vec<Wish>,
}

/// What is asked of the test.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Wish {
    Skip(String),
    Needs(String),
    Exit(i32),
}

impl Page {
    pub(super) fn read(root: &Path, name: &str) -> Self {
        let text = std::fs::read_to_string(root.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        Self::parse(name, text)
    }

    /// Whether one of its blocks is run only where `what` is at hand.
    pub(super) fn needs(&self, what: &str) -> bool {
        let asks = |wish: &Wish| matches!(wish, Wish::Needs(needed) if needed == what);
        self.blocks.iter().any(|block| block.wishes.iter().any(asks))
    }

    fn parse(name: &str, text: String) -> Self {
        let (mut blocks, mut given, mut elsewhere) = (Vec::new(), Vec::new(), None);
        let mut wishes = Vec::new();
        let mut open: Option<Block> = None;
        for (index, line) in text.lines().enumerate() {
            if let Some(fence) = line.trim_start().strip_prefix("```") {
                if let Some(block) = open.take() {
                    blocks.push(block);
                } else {
                    let mut words = fence.split(',').map(|word| word.trim().to_owned());
                    open = Some(Block {
                        line: index + 1,
                        language: words.next().unwrap_or_default(),
                        attributes: words.collect(),
                        text: String::new(),
                        wishes: std::mem::take(&mut wishes),
                    });
                }
            } else if let Some(block) = &mut open {
                block.text += line;
                block.text.push('\n');
            } else if let Some(comment) = comment(line) {
                match comment.split_once(' ').unwrap_or((comment, "")) {
                    ("skip:", reason) => wishes.push(Wish::Skip(reason.to_owned())),
                    ("needs", what) => wishes.push(Wish::Needs(what.to_owned())),
                    ("exit", status) => {
                        wishes.push(Wish::Exit(status.parse().unwrap_or_else(|_| panic!("{name}: {line}"))));
                    }
                    ("given", names) => given.extend(names.split_whitespace().map(str::to_owned)),
                    ("rust", reason) => elsewhere = reason.strip_prefix("here: ").map(str::to_owned),
                    _ => panic!("{name}:{}: a comment for the test that it does not know: {line}", index + 1),
                }
            } else if !line.trim().is_empty() {
                assert!(wishes.is_empty(), "{name}:{index}: a comment for the test without a block");
            }
        }
        assert!(open.is_none(), "{name}: a block does not end");
        if let Some(reason) = elsewhere {
            for block in blocks.iter_mut().filter(|block| matches!(block.language.as_str(), "rust" | "toml"))
            {
                block.wishes.push(Wish::Skip(reason.clone()));
            }
        }
        Self { name: name.to_owned(), text, blocks, given }
    }
}

/// What stands in a comment for the test.
fn comment(line: &str) -> Option<&str> {
    line.trim().strip_prefix("<!-- test: ")?.strip_suffix(" -->")
}

#[test]
fn blocks_and_their_comments_are_found() {
    let text = "# A\n<!-- test: given a.h5 b.h5 -->\n\n<!-- test: exit 2 -->\n<!-- test: needs gas -->\n```sh\nswm x\n```\n\
                <!-- test: skip: why -->\n```rust,ignore\nx\n```\n";
    let page = Page::parse("a.md", text.to_owned());
    assert_eq!(page.given, ["a.h5", "b.h5"]);
    let [first, second] = page.blocks.as_slice() else { panic!("{}", page.blocks.len()) };
    assert_eq!((first.line, first.language.as_str(), first.text.as_str()), (6, "sh", "swm x\n"));
    assert_eq!(first.wishes, [Wish::Exit(2), Wish::Needs("gas".to_owned())]);
    assert!(page.needs("gas") && !page.needs("g"));
    assert_eq!(second.attributes, ["ignore"]);
    assert_eq!(second.wishes, [Wish::Skip("why".to_owned())]);
}
