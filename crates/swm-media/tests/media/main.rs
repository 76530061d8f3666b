//! What the files hold, read back by decoders.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails, in its helpers too")]

mod clips;
mod errors;
mod gifs;
#[cfg(feature = "mp4")]
mod mp4s;
mod pictures;
mod readers;
mod scene;
