//! The files of the page, built from `web/src` by `npm run build` and part of the program: nothing is fetched.

use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};

/// Name, media type, content.
const FILES: &[(&str, &str, &[u8])] = &[
    ("index.html", "text/html; charset=utf-8", include_bytes!("../web/dist/index.html")),
    ("app.js", "text/javascript; charset=utf-8", include_bytes!("../web/dist/app.js")),
    ("app.css", "text/css; charset=utf-8", include_bytes!("../web/dist/app.css")),
    ("icon.svg", "image/svg+xml", include_bytes!("../web/dist/icon.svg")),
];

/// The file of this name.
pub(crate) fn file(name: &str) -> Response {
    match FILES.iter().find(|(known, ..)| *known == name) {
        Some(&(_, media_type, content)) => ([(header::CONTENT_TYPE, media_type)], content).into_response(),
        None => (StatusCode::NOT_FOUND, "there is no such page").into_response(),
    }
}
