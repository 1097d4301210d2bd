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

/// A percent-decoded, relative path that stays inside the model's folder on every system: no scheme, no root, no drive
/// letter, no `..`, no backslash, no colon, no NUL, no name of a device of Windows. Made only by [`RelativeUri::parse`].
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
        if let Some(colon) = decoded.find(':') {
            // A drive, or a stream of a file of Windows, may also stand behind the first folder.
            let (start, what) = match decoded[..colon].rfind('/') {
                Some(slash) => (slash + 1, "a colon in"),
                None => (0, "the scheme or drive"),
            };
            return Err(format!("it has {what} '{}'", &decoded[start..=colon]));
        }
        let mut parts = Vec::new();
        for part in decoded.split('/').filter(|part| !matches!(*part, "" | ".")) {
            check_part(part)?;
            parts.push(part);
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

/// Checks one name of a path by the rules of all systems.
fn check_part(part: &str) -> Result<(), String> {
    // Windows ignores dots and spaces at the end.
    let trimmed = part.trim_end_matches(['.', ' ']);
    if part == ".." || trimmed.is_empty() {
        return Err(format!("it leaves the model's folder through '{part}'"));
    }
    let stem = trimmed.split('.').next().unwrap_or_default().trim_end_matches(' ');
    if is_device(stem) { Err(format!("'{part}' is the name of a device on Windows")) } else { Ok(()) }
}

/// Tells whether Windows takes a name for that of a device, whatever its folder and its extension are.
fn is_device(stem: &str) -> bool {
    const NAMES: [&str; 6] = ["CON", "PRN", "AUX", "NUL", "CONIN$", "CONOUT$"];
    let is_number =
        |digit: &str| matches!(digit, "\u{b9}" | "\u{b2}" | "\u{b3}") || matches!(digit.as_bytes(), [b'0'..=b'9']);
    let port = |kind: &str| {
        let (start, digit) = stem.split_at_checked(kind.len())?;
        Some(start.eq_ignore_ascii_case(kind) && is_number(digit))
    };
    NAMES.iter().any(|name| stem.eq_ignore_ascii_case(name))
        || ["COM", "LPT"].iter().any(|kind| port(kind) == Some(true))
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
            ("console.png", "console.png"),
            ("con_1/auxiliary.bin", "con_1/auxiliary.bin"),
            ("COM.png", "COM.png"),
            ("COM10.png", "COM10.png"),
            ("...png", "...png"),
        ] {
            assert_eq!(RelativeUri::parse(uri).expect(uri).as_str(), path);
        }
    }

    #[test]
    fn names_that_windows_reads_otherwise_are_refused() {
        for uri in [
            "./C:/Users/x",
            ".%2fC%3a/..",
            "a/C:/x",
            "a/b:stream",
            "a.png::$DATA",
            "CON",
            "nul.png",
            "a/Aux.tar.gz",
            "prn ",
            "NUL .png",
            "NUL.",
            "com1",
            "LPT9.bin",
            "COM\u{b9}.bin",
            "conin$",
            ".. /x",
            "a/.../x",
            " ",
            "./\\\\server/share",
        ] {
            assert!(RelativeUri::parse(uri).is_err(), "{uri} was accepted");
        }
        assert_eq!(RelativeUri::parse("a/Nul.png"), Err("'Nul.png' is the name of a device on Windows".into()));
        assert_eq!(RelativeUri::parse("./C:/x"), Err("it has a colon in 'C:'".into()));
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
