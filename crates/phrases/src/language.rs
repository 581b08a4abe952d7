//! The languages of the catalogue.

use serde::{Serialize, Serializer};
use std::fmt;
use std::str::FromStr;

/// A language in which Cairn speaks and shows its sentences.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Language {
    /// English.
    #[default]
    English,
    /// Spanish.
    Spanish,
    /// German.
    German,
}

/// A language that the catalogue does not have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownLanguage(String);

impl fmt::Display for UnknownLanguage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let codes: Vec<&str> = Language::ALL.iter().map(|l| l.code()).collect();
        write!(f, "there are no sentences in the language \"{}\"; write one of {}", self.0, codes.join(", "))
    }
}

impl std::error::Error for UnknownLanguage {}

impl Language {
    /// All languages.
    pub const ALL: [Self; 3] = [Self::English, Self::Spanish, Self::German];

    /// Its code (ISO 639-1), which names its file, the voice of espeak-ng and the `lang` of the page.
    pub fn code(self) -> &'static str {
        match self {
            Self::English => "en",
            Self::Spanish => "es",
            Self::German => "de",
        }
    }

    /// Its name in the language itself.
    pub fn name(self) -> &'static str {
        match self {
            Self::English => "English",
            Self::Spanish => "Español",
            Self::German => "Deutsch",
        }
    }

    /// The language of a header `Accept-Language` or of a locale such as `de_AT.UTF-8`: the first entry that the
    /// catalogue has, else English. Weights are taken to be in descending order, as browsers send them.
    pub fn preferred(list: &str) -> Self {
        let code = |entry: &str| {
            let tag: String = entry.trim().chars().take_while(char::is_ascii_alphabetic).collect();
            tag.parse().ok()
        };
        list.split(',').find_map(code).unwrap_or_default()
    }

    /// The text of its file.
    pub(crate) fn source(self) -> &'static str {
        match self {
            Self::English => include_str!("../languages/en.ftl"),
            Self::Spanish => include_str!("../languages/es.ftl"),
            Self::German => include_str!("../languages/de.ftl"),
        }
    }

    /// The sign before decimals.
    pub(crate) fn decimal_sign(self) -> char {
        match self {
            Self::English => '.',
            Self::Spanish | Self::German => ',',
        }
    }
}

impl FromStr for Language {
    type Err = UnknownLanguage;

    fn from_str(code: &str) -> Result<Self, Self::Err> {
        let wanted = code.to_ascii_lowercase();
        let found = Self::ALL.into_iter().find(|l| l.code() == wanted);
        found.ok_or_else(|| UnknownLanguage(code.to_owned()))
    }
}

impl fmt::Display for Language {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.code())
    }
}

impl Serialize for Language {
    fn serialize<S: Serializer>(&self, s: S) -> Result<S::Ok, S::Error> {
        s.serialize_str(self.code())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn languages_are_found_by_code_and_by_preference() {
        for language in Language::ALL {
            assert_eq!(language.code().parse(), Ok(language));
        }
        assert!("fr".parse::<Language>().unwrap_err().to_string().ends_with("write one of en, es, de"));
        assert_eq!(Language::preferred("fr-CH, de;q=0.8, en;q=0.7"), Language::German);
        assert_eq!(Language::preferred("es_MX.UTF-8"), Language::Spanish);
        assert_eq!(Language::preferred(""), Language::English);
    }
}
