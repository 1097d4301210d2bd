//! Globs from files of settings.

use globset::{GlobBuilder, GlobMatcher, GlobSetBuilder};

/// Longest glob in bytes. A path is shorter.
const LONGEST: usize = 1000;

/// Compiles a glob.
///
/// # Errors
/// If it is malformed, too long, or has braces nested too deep; the text says so.
pub fn compile_glob(pattern: &str, options: impl Fn(&mut GlobBuilder<'_>)) -> Result<GlobMatcher, String> {
    if pattern.len() > LONGEST {
        return Err(format!("it has {} bytes, over the limit of {LONGEST}", pattern.len()));
    }
    let mut builder = GlobBuilder::new(pattern);
    options(&mut builder);
    let glob = builder.build().map_err(|e| e.to_string())?;
    // A matcher panics where a set returns an error: `{{{..` makes a regular expression that is nested too deep.
    let too_complex = |_| "it is too complex: nest fewer braces".to_owned();
    GlobSetBuilder::new().add(glob.clone()).build().map_err(too_complex)?;
    Ok(glob.compile_matcher())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deep_and_long_globs_are_errors() {
        let nested = |depth: usize| compile_glob(&format!("{}a,b{}", "{".repeat(depth), "}".repeat(depth)), |_| {});
        assert!(nested(3).is_ok_and(|glob| glob.is_match("b")));
        for depth in [240, 250, 260, 300, 490] {
            if let Err(error) = nested(depth) {
                assert!(error.contains("too complex"), "{error}");
            }
        }
        assert!(nested(300).is_err());
        assert!(compile_glob(&"a".repeat(1001), |_| {}).is_err());
        assert!(compile_glob(&"?".repeat(1000), |_| {}).is_ok());
        assert!(compile_glob("[", |_| {}).is_err());
    }
}
