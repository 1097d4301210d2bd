//! What the command line asks for.

use std::ffi::OsString;
use std::path::PathBuf;

/// What to do.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Request {
    /// Open the game; with a folder, write pictures there and end.
    Game { photos: Option<PathBuf> },
    /// Bake without the game, with further arguments of `simpliguard bake`.
    Bake(Vec<OsString>),
}

impl Request {
    /// Reads the arguments behind the program's name. `Err` is a message for the user.
    pub(crate) fn parse(args: impl IntoIterator<Item = OsString>) -> Result<Self, String> {
        let mut args = args.into_iter();
        let (mut photos, mut headless, mut rest) = (None, false, Vec::new());
        while let Some(arg) = args.next() {
            if arg == "--headless" {
                headless = true;
            } else if arg == "--screenshot" {
                photos = Some(args.next().ok_or("--screenshot: expected a folder")?.into());
            } else {
                rest.push(arg);
            }
        }
        match photos {
            None if headless || !rest.is_empty() => Ok(Self::Bake(rest)),
            Some(_) if headless || !rest.is_empty() => {
                Err("--screenshot needs the game: no other argument fits".into())
            }
            photos => Ok(Self::Game { photos }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(args: &[&str]) -> Result<Request, String> {
        Request::parse(args.iter().map(OsString::from))
    }

    #[test]
    fn no_argument_opens_the_game() {
        assert_eq!(parse(&[]), Ok(Request::Game { photos: None }));
        assert_eq!(parse(&["--screenshot", "out"]), Ok(Request::Game { photos: Some("out".into()) }));
    }

    #[test]
    fn arguments_of_bake_bake() {
        assert_eq!(parse(&["--headless"]), Ok(Request::Bake(Vec::new())));
        assert_eq!(parse(&["--quality", "draft"]), Ok(Request::Bake(vec!["--quality".into(), "draft".into()])));
        assert_eq!(parse(&["--json", "--headless"]), Ok(Request::Bake(vec!["--json".into()])));
    }

    #[test]
    fn screenshots_without_a_folder_or_a_game_are_refused() {
        assert!(parse(&["--screenshot"]).is_err());
        assert!(parse(&["--screenshot", "out", "--headless"]).is_err());
    }
}
