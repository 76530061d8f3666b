//! Stores that speak S3: addresses of objects, lists of them, and signatures.

use super::client::{Auth, Link};
use super::settings::{Credentials, S3};
use super::sign::{Request, headers};

/// A text in an address. Slashes stay if so told.
pub(super) fn encoded(text: &str, keeps_slashes: bool) -> String {
    let mut out = String::with_capacity(text.len());
    for byte in text.bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => out.push(char::from(byte)),
            b'/' if keeps_slashes => out.push('/'),
            byte => out.push_str(&format!("%{byte:02X}")),
        }
    }
    out
}

/// The address of a bucket, without a slash at the end, and what stands before keys.
fn bucket_url(store: &S3, bucket: &str) -> String {
    match &store.endpoint {
        Some(endpoint) => format!("{endpoint}/{bucket}"),
        // Certificates are for names without dots.
        None if bucket.contains('.') => format!("https://s3.{}.amazonaws.com/{bucket}", store.region),
        None => format!("https://{bucket}.s3.{}.amazonaws.com", store.region),
    }
}

pub(super) fn object(store: &S3, bucket: &str, key: &str) -> Link {
    let url = format!("{}/{}", bucket_url(store, bucket), encoded(key, true));
    Link { name: format!("s3://{bucket}/{key}"), url, auth: Auth::S3 }
}

/// A page of the list of the objects whose keys begin so.
pub(super) fn list(store: &S3, bucket: &str, prefix: &str, next: Option<&str>) -> Link {
    let next = next.map(|next| format!("continuation-token={}&", encoded(next, false))).unwrap_or_default();
    let query = format!("{next}list-type=2&prefix={}", encoded(prefix, false));
    let url = format!("{}/?{query}", bucket_url(store, bucket));
    Link { name: format!("s3://{bucket}/{prefix}"), url, auth: Auth::S3 }
}

/// The headers that sign a request.
pub(super) fn signed(url: &str, region: &str, credentials: &Credentials) -> Vec<(&'static str, String)> {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    let (host, rest) = rest.split_once('/').unwrap_or((rest, ""));
    let (path, query) = rest.split_once('?').unwrap_or((rest, ""));
    headers(Request { host, path: &format!("/{path}"), query }, region, credentials)
}

/// An object of a list.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Listed {
    pub(super) key: String,
    pub(super) size: u64,
    pub(super) tag: Option<String>,
}

/// The objects of a page, and how the next page is asked for. `None`: it is no list.
pub(super) fn page(text: &str) -> Option<(Vec<Listed>, Option<String>)> {
    if !text.contains("<ListBucketResult") {
        return None;
    }
    let mut found = Vec::new();
    let mut rest = text;
    while let Some((_, behind)) = rest.split_once("<Contents>") {
        let (one, behind) = behind.split_once("</Contents>")?;
        rest = behind;
        let size = value(one, "Size")?.trim().parse().ok()?;
        found.push(Listed { key: value(one, "Key")?, size, tag: value(one, "ETag") });
    }
    let is_cut = value(text, "IsTruncated").is_some_and(|text| text.trim() == "true");
    let next = is_cut.then(|| value(text, "NextContinuationToken"));
    Some((found, next.flatten()))
}

/// The code of a refusal, such as `AccessDenied`.
pub(super) fn code(body: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(&body[..body.len().min(4096)]).into_owned();
    let code = value(&text, "Code")?;
    (!code.is_empty() && code.len() < 64 && code.bytes().all(|byte| byte.is_ascii_alphanumeric()))
        .then_some(code)
}

/// The text of the first element of a name.
fn value(xml: &str, name: &str) -> Option<String> {
    let (_, behind) = xml.split_once(&format!("<{name}>"))?;
    let (text, _) = behind.split_once(&format!("</{name}>"))?;
    unescaped(text)
}

fn unescaped(text: &str) -> Option<String> {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some((before, behind)) = rest.split_once('&') {
        let (name, behind) = behind.split_once(';')?;
        out.push_str(before);
        out.push(match name {
            "amp" => '&',
            "lt" => '<',
            "gt" => '>',
            "quot" => '"',
            "apos" => '\'',
            name => {
                let number = name.strip_prefix('#')?;
                let hex = number.strip_prefix('x').map(|hex| u32::from_str_radix(hex, 16));
                char::from_u32(hex.unwrap_or_else(|| number.parse()).ok()?)?
            }
        });
        rest = behind;
    }
    out.push_str(rest);
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses() {
        let mut store = S3 { region: "eu-west-1".to_owned(), ..S3::default() };
        assert_eq!(
            object(&store, "b", "a b/c+d.npz").url,
            "https://b.s3.eu-west-1.amazonaws.com/a%20b/c%2Bd.npz"
        );
        assert_eq!(object(&store, "b.c", "x").url, "https://s3.eu-west-1.amazonaws.com/b.c/x");
        store.endpoint = Some("http://127.0.0.1:9000".to_owned());
        assert_eq!(object(&store, "b", "x").url, "http://127.0.0.1:9000/b/x");
        assert_eq!(
            list(&store, "b", "a/", Some("t=")).url,
            "http://127.0.0.1:9000/b/?continuation-token=t%3D&list-type=2&prefix=a%2F"
        );
    }

    #[test]
    fn pages() {
        let text = "<?xml?><ListBucketResult xmlns=\"x\"><IsTruncated>true</IsTruncated><Contents><Key>a&amp;b/&#x41;</Key>\
                    <Size>5</Size><ETag>&quot;ab&quot;</ETag></Contents><NextContinuationToken>n</NextContinuationToken></ListBucketResult>";
        let one = Listed { key: "a&b/A".to_owned(), size: 5, tag: Some("\"ab\"".to_owned()) };
        assert_eq!(page(text), Some((vec![one], Some("n".to_owned()))));
        assert_eq!(page("<html>"), None);
        assert_eq!(page("<ListBucketResult><Contents><Key>a</Key></Contents>"), None);
        assert_eq!(page("<ListBucketResult><Contents><Key>&bad;</Key><Size>1</Size></Contents>"), None);
        assert_eq!(
            code(b"<Error><Code>AccessDenied</Code><Message>m</Message></Error>").as_deref(),
            Some("AccessDenied")
        );
        assert_eq!(code(b"<Code>a <b></Code>"), None);
    }
}
