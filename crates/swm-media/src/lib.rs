//! Pictures and films: PNG, GIF, MP4, contact sheets.
