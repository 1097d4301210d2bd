//! The input of a bake: the bytes of a file, and a reader for the files it refers to.

use bytes::Bytes;

/// A model file and the files around it.
#[derive(Clone, Copy)]
pub struct Source<'a> {
    /// Its name in messages: usually the path as the user typed it. Never part of a cache key.
    pub name: &'a str,
    /// The whole `.glb` or `.gltf` file.
    pub bytes: &'a [u8],
    /// Reads external buffers and images.
    pub resources: &'a dyn Resources,
}

/// Reads the external files of a glTF.
pub trait Resources: Sync {
    /// Reads the whole file at `uri`, relative to the model's folder.
    ///
    /// # Errors
    /// The reason, without the path.
    fn read(&self, uri: &RelativeUri) -> Result<Bytes, String>;
}

/// A reader for files that refer to no others: every read fails.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoResources;

impl Resources for NoResources {
    fn read(&self, _: &RelativeUri) -> Result<Bytes, String> {
        Err("no external files are available here".to_owned())
    }
}

/// A percent-decoded, relative path that stays inside the model's folder: no scheme, no root, no drive letter, no
/// `..`, no backslash, no NUL. Made only by [`RelativeUri::parse`].
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RelativeUri(String);

impl RelativeUri {
    /// Checks and percent-decodes a URI of a glTF.
    ///
    /// # Errors
    /// The rule that the URI breaks.
    pub fn parse(uri: &str) -> Result<Self, String> {
        let decoded = String::from_utf8(percent_decode(uri)?).map_err(|_| "it does not decode to UTF-8")?;
        if decoded.is_empty() {
            return Err("it is empty".into());
        }
        if decoded.contains('\0') {
            return Err("it holds a NUL character".into());
        }
        if decoded.contains('\\') {
            return Err("it holds a backslash; glTF separates folders by '/'".into());
        }
        if decoded.starts_with('/') {
            return Err("it is an absolute path".into());
        }
        if let Some(colon) = decoded.find(':')
            && !decoded[..colon].contains('/')
        {
            return Err(format!("it has the scheme or drive '{}'", &decoded[..=colon]));
        }
        let mut parts = Vec::new();
        for part in decoded.split('/') {
            match part {
                "" | "." => {}
                ".." => return Err("it leaves the model's folder through '..'".into()),
                part => parts.push(part),
            }
        }
        if parts.is_empty() {
            return Err("it names no file".into());
        }
        Ok(Self(parts.join("/")))
    }

    /// The decoded path; folders are separated by `/`.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// Replaces each `%xx` by its byte. `Err` names the position of a malformed escape.
pub(crate) fn percent_decode(uri: &str) -> Result<Vec<u8>, String> {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        if bytes[i] == b'%' {
            let hex = uri.get(i + 1..i + 3).and_then(|h| u8::from_str_radix(h, 16).ok());
            out.push(hex.ok_or_else(|| format!("the percent escape at byte {i} is malformed"))?);
            i += 3;
        } else {
            out.push(bytes[i]);
            i += 1;
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::RelativeUri;

    #[test]
    fn plain_and_escaped_names_decode() {
        for (uri, path) in [
            ("a.bin", "a.bin"),
            ("tex/a%20b.png", "tex/a b.png"),
            ("./a//b.png", "a/b.png"),
            ("a:b/c:d.png".trim_start_matches("a:b/"), "c:d.png"),
        ] {
            if path == "c:d.png" {
                assert!(RelativeUri::parse(uri).is_err(), "{uri}");
            } else {
                assert_eq!(RelativeUri::parse(uri).expect(uri).as_str(), path);
            }
        }
    }

    #[test]
    fn uris_that_leave_the_folder_are_refused() {
        for uri in [
            "",
            "/etc/passwd",
            "../a",
            "a/../../b",
            "%2e%2e/a",
            "..%2Fa",
            "C:/a",
            "c:a",
            "file:///a",
            "http://x/y",
            "a\\b",
            "a%5Cb",
            "a%00b",
            "%zz",
            "%",
            "%ff",
            ".",
            "./",
        ] {
            assert!(RelativeUri::parse(uri).is_err(), "{uri} was accepted");
        }
    }
}
