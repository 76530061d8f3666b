//! What the environment says about stores elsewhere.

use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use crate::cache_folder::cache_folder;

/// Everything that is set.
#[derive(Clone, Debug)]
pub(super) struct Settings {
    pub(super) s3: S3,
    pub(super) hub: Hub,
    /// The folder of fetched data; `None`: nothing says where it is.
    pub(super) cache: Option<PathBuf>,
    /// The most bytes of blocks in it.
    pub(super) cache_bytes: u64,
    /// A file of certificates to trust.
    pub(super) certificates: Option<PathBuf>,
    /// How long an answer, or more of it, is waited for.
    pub(super) timeout: Duration,
    /// How long is waited before it is tried again: at first; then twice as long, each time.
    pub(super) pause: Duration,
}

/// A store that speaks S3.
#[derive(Clone, Debug, Default)]
pub(super) struct S3 {
    /// Of another store than Amazon's, without a slash at the end.
    pub(super) endpoint: Option<String>,
    pub(super) region: String,
    pub(super) credentials: Option<Credentials>,
}

/// Who asks.
#[derive(Clone)]
pub(super) struct Credentials {
    pub(super) key: String,
    pub(super) secret: String,
    pub(super) session: Option<String>,
}

impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Credentials(…)")
    }
}

/// The Hugging Face Hub, or a mirror of it.
#[derive(Clone)]
pub(super) struct Hub {
    pub(super) endpoint: String,
    pub(super) token: Option<String>,
}

impl fmt::Debug for Hub {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Hub").field("endpoint", &self.endpoint).finish_non_exhaustive()
    }
}

impl Settings {
    /// Those of the variables of this process.
    pub(super) fn from_environment() -> Self {
        Self::from(|name| std::env::var(name).ok(), std::env::consts::OS)
    }

    fn from(variable: impl Fn(&str) -> Option<String>, os: &str) -> Self {
        let set = |name: &str| {
            variable(name).map(|value| value.trim().to_owned()).filter(|value| !value.is_empty())
        };
        let first = |names: &[&str]| names.iter().find_map(|name| set(name));
        let address = |text: String| text.trim_end_matches('/').to_owned();
        let credentials = match (set("AWS_ACCESS_KEY_ID"), set("AWS_SECRET_ACCESS_KEY")) {
            (Some(key), Some(secret)) => Some(Credentials { key, secret, session: set("AWS_SESSION_TOKEN") }),
            _ => None,
        };
        let gigabytes =
            set("SWM_CACHE_GB").and_then(|text| text.parse::<f64>().ok()).filter(|size| *size >= 0.0);
        Self {
            s3: S3 {
                endpoint: first(&["AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL"]).map(address),
                region: first(&["AWS_REGION", "AWS_DEFAULT_REGION"])
                    .unwrap_or_else(|| "us-east-1".to_owned()),
                credentials,
            },
            hub: Hub {
                endpoint: set("HF_ENDPOINT").map_or_else(|| "https://huggingface.co".to_owned(), address),
                token: set("HF_TOKEN"),
            },
            cache: cache_folder(&variable, os),
            cache_bytes: (gigabytes.unwrap_or(20.0) * 1e9) as u64,
            certificates: set("SSL_CERT_FILE").map(PathBuf::from),
            timeout: Duration::from_secs(30),
            pause: Duration::from_millis(200),
        }
    }
}

#[cfg(any(test, feature = "testing"))]
impl Settings {
    /// For a server on this machine.
    pub(super) fn of_test(cache: &std::path::Path) -> Self {
        Self {
            cache: Some(cache.to_owned()),
            timeout: Duration::from_millis(1500),
            pause: Duration::from_millis(5),
            ..Self::from(|_| None, "linux")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variables() {
        let of = |given: &[(&str, &str)], os: &str| {
            Settings::from(
                |name| given.iter().find(|(known, _)| *known == name).map(|(_, value)| (*value).to_owned()),
                os,
            )
        };
        let none = of(&[], "linux");
        assert!(none.cache.is_none() && none.s3.credentials.is_none() && none.s3.endpoint.is_none());
        assert_eq!((none.s3.region.as_str(), none.cache_bytes), ("us-east-1", 20_000_000_000));
        let all = of(
            &[
                ("AWS_ENDPOINT_URL", "http://other"),
                ("AWS_ENDPOINT_URL_S3", "http://127.0.0.1:9000/"),
                ("AWS_ACCESS_KEY_ID", "KEY"),
                ("AWS_SECRET_ACCESS_KEY", "SECRET"),
                ("HF_TOKEN", "TOKEN"),
                ("SWM_HOME", "/data"),
                ("SWM_CACHE_GB", "0.5"),
            ],
            "linux",
        );
        assert_eq!(all.s3.endpoint.as_deref(), Some("http://127.0.0.1:9000"));
        assert_eq!(all.cache.as_deref(), Some(std::path::Path::new("/data/cache")));
        assert_eq!(all.cache_bytes, 500_000_000);
        let shown = format!("{all:?}");
        assert!(!["SECRET", "KEY", "TOKEN"].iter().any(|secret| shown.contains(secret)), "{shown}");
        assert!(of(&[("HOME", "/h")], "macos").cache.unwrap().starts_with("/h/Library/Caches"));
    }
}
