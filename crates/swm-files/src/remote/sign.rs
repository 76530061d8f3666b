//! Signatures of requests to S3: Amazon's "Signature Version 4", by headers.

use std::time::UNIX_EPOCH;

use sha2::{Digest as _, Sha256};

use super::settings::Credentials;

/// The hash of a request's body, which is none.
const NO_BODY: &str = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

/// A request: `path` and `query` are encoded, and the query is in the order of its names.
#[derive(Clone, Copy, Debug)]
pub(super) struct Request<'a> {
    pub(super) host: &'a str,
    pub(super) path: &'a str,
    pub(super) query: &'a str,
}

/// The headers that sign a request that is made now.
pub(super) fn headers(
    request: Request<'_>,
    region: &str,
    credentials: &Credentials,
) -> Vec<(&'static str, String)> {
    let now = super::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_secs());
    headers_at(request, region, credentials, now)
}

fn headers_at(
    request: Request<'_>,
    region: &str,
    credentials: &Credentials,
    seconds: u64,
) -> Vec<(&'static str, String)> {
    let time = time(seconds);
    let day = &time[..8];
    let mut signed = vec![
        ("host", request.host.to_owned()),
        ("x-amz-content-sha256", NO_BODY.to_owned()),
        ("x-amz-date", time.clone()),
    ];
    signed.extend(credentials.session.clone().map(|session| ("x-amz-security-token", session)));
    let names = signed.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(";");
    let lines: String = signed.iter().map(|(name, value)| format!("{name}:{value}\n")).collect();
    let canonical = format!("GET\n{}\n{}\n{lines}\n{names}\n{NO_BODY}", request.path, request.query);
    let scope = format!("{day}/{region}/s3/aws4_request");
    let text = format!("AWS4-HMAC-SHA256\n{time}\n{scope}\n{}", hex(&Sha256::digest(&canonical)));
    let mut key = format!("AWS4{}", credentials.secret).into_bytes();
    for part in [day, region, "s3", "aws4_request"] {
        key = hmac(&key, part.as_bytes()).to_vec();
    }
    let signature = hex(&hmac(&key, text.as_bytes()));
    let value = format!(
        "AWS4-HMAC-SHA256 Credential={}/{scope}, SignedHeaders={names}, Signature={signature}",
        credentials.key
    );
    // The client adds the host.
    signed.remove(0);
    signed.push(("authorization", value));
    signed
}

/// HMAC with SHA-256 (RFC 2104).
fn hmac(key: &[u8], text: &[u8]) -> [u8; 32] {
    let mut block = [0; 64];
    if key.len() > block.len() {
        block[..32].copy_from_slice(&Sha256::digest(key));
    } else {
        block[..key.len()].copy_from_slice(key);
    }
    let padded = |pad: u8| block.map(|byte| byte ^ pad);
    let inner = Sha256::new().chain_update(padded(0x36)).chain_update(text).finalize();
    Sha256::new().chain_update(padded(0x5c)).chain_update(inner).finalize().into()
}

pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// `20150830T123600Z`.
fn time(seconds: u64) -> String {
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    // Years begin in March, and eras of 400 years have as many days: "chrono-Compatible Low-Level Date Algorithms" by H. Hinnant.
    let shifted = days + 719_468;
    let (era, day) = (shifted / 146_097, shifted % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let month = if month < 10 { month + 3 } else { month - 9 };
    let year = era * 400 + year + u64::from(month <= 2);
    format!("{year:04}{month:02}{day:02}T{:02}{:02}{:02}Z", rest / 3600, rest / 60 % 60, rest % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times() {
        for (seconds, text) in [
            (0, "19700101T000000Z"),
            (951_782_399, "20000228T235959Z"),
            (951_782_400, "20000229T000000Z"),
            (1_369_353_600, "20130524T000000Z"),
            (4_107_542_400, "21000301T000000Z"),
        ] {
            assert_eq!(time(seconds), text);
        }
    }

    /// The case 2 of RFC 4231.
    #[test]
    fn hmac_of_a_standard() {
        assert_eq!(
            hex(&hmac(b"Jefe", b"what do ya want for nothing?")),
            "5bdcc146bf60754e6a042426089575c75a003f089d2739839dec58b964ec3843"
        );
    }

    /// The example of listing a bucket in Amazon's documentation of S3.
    #[test]
    fn the_example_of_the_documentation() {
        let credentials = Credentials {
            key: "AKIAIOSFODNN7EXAMPLE".to_owned(),
            secret: "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY".to_owned(),
            session: None,
        };
        let request =
            Request { host: "examplebucket.s3.amazonaws.com", path: "/", query: "max-keys=2&prefix=J" };
        let headers = headers_at(request, "us-east-1", &credentials, 1_369_353_600);
        let (_, authorization) = headers.last().unwrap();
        assert!(
            authorization.ends_with("34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7"),
            "{authorization}"
        );
        assert!(!authorization.contains("EXAMPLEKEY"));
    }
}
