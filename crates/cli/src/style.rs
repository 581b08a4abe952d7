//! Colours, on a terminal only, and never with `NO_COLOR` (<https://no-color.org>).

use std::io::IsTerminal;

/// What a colour says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Paint {
    /// Ordinary text.
    Plain,
    /// Names and less important text.
    Faint,
    /// A warning.
    Doubtful,
    /// A failure.
    Wrong,
}

impl Paint {
    fn code(self) -> &'static str {
        match self {
            Self::Plain => "",
            Self::Faint => "2",
            Self::Doubtful => "33",
            Self::Wrong => "1;31",
        }
    }

    fn apply(self, text: &str, coloured: bool) -> String {
        match coloured && self != Self::Plain {
            true => format!("\x1b[{}m{text}\x1b[0m", self.code()),
            false => text.to_owned(),
        }
    }
}

/// Text for stdout.
pub fn on_stdout(paint: Paint, text: &str) -> String {
    paint.apply(text, allowed() && std::io::stdout().is_terminal())
}

/// Text for stderr.
pub fn on_stderr(paint: Paint, text: &str) -> String {
    paint.apply(text, allowed() && std::io::stderr().is_terminal())
}

/// Whether the user and the terminal want colours.
fn allowed() -> bool {
    wanted(std::env::var_os("NO_COLOR").as_deref(), std::env::var_os("TERM").as_deref())
}

fn wanted(no_color: Option<&std::ffi::OsStr>, term: Option<&std::ffi::OsStr>) -> bool {
    no_color.is_none_or(|v| v.is_empty()) && term.is_none_or(|t| t != "dumb")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::OsStr;

    #[test]
    fn no_color_and_dumb_terminals_are_obeyed() {
        let os = |text: &'static str| Some(OsStr::new(text));
        assert!(wanted(None, os("xterm")) && wanted(os(""), None));
        assert!(!wanted(os("1"), os("xterm")) && !wanted(None, os("dumb")));
        assert_eq!(Paint::Wrong.apply("error:", false), "error:");
        assert_eq!(Paint::Doubtful.apply("yes", true), "\x1b[33myes\x1b[0m");
        assert_eq!(Paint::Plain.apply("yes", true), "yes");
    }
}
