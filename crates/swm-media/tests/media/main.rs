//! What the files hold, read back by decoders.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails, in its helpers too")]

#[cfg(feature = "av1")]
mod av1;
mod clips;
mod errors;
#[cfg(feature = "mp4")]
mod foreign;
mod gifs;
mod images;
#[cfg(feature = "mp4")]
mod mp4s;
mod readers;
mod scene;
