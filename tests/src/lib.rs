//! What the workspace's end-to-end tests share, and the book's programs as documentation tests.

pub mod book;
pub mod golden;

/// Makes the programs of pages tests; `tests/integration/book` checks that no page is forgotten.
macro_rules! pages {
    ($($name:ident: $path:literal)*) => {$(
        #[doc = include_str!(concat!("../../", $path))]
        #[cfg(doctest)]
        pub struct $name;
    )*};
}

pages! {
    Readme: "README.md"
    Concepts: "docs/concepts.md"
    Collecting: "docs/collecting.md"
    Loading: "docs/data.md"
    Planning: "docs/solvers.md"
    Embedding: "docs/embedding.md"
}
