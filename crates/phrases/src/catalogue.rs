//! From an id and its values to a sentence. A language's file is parsed when it is first used.

use crate::Language;
use fluent_bundle::concurrent::FluentBundle;
use fluent_bundle::types::{FluentNumber, FluentNumberOptions, FluentValue};
use fluent_bundle::{FluentArgs, FluentResource};
use std::borrow::Cow;
use std::sync::OnceLock;
use unic_langid::LanguageIdentifier;

/// A value in a sentence.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Arg<'a> {
    /// Words that are in the sentence's language already, a name, or the name of a variant to select.
    Text(&'a str),
    /// A number, written with this many decimals in the language's way.
    Number(f64, usize),
}

impl<'a> From<&'a str> for Arg<'a> {
    fn from(text: &'a str) -> Self {
        Self::Text(text)
    }
}

impl<'a> From<&'a String> for Arg<'a> {
    fn from(text: &'a String) -> Self {
        Self::Text(text)
    }
}

impl From<usize> for Arg<'_> {
    fn from(count: usize) -> Self {
        Self::Number(count as f64, 0)
    }
}

impl<'a> Arg<'a> {
    fn value(self) -> FluentValue<'a> {
        match self {
            Self::Text(text) => FluentValue::from(text),
            Self::Number(value, decimals) => {
                let grain = 10_f64.powi(decimals as i32);
                let minimum_fraction_digits = Some(decimals).filter(|n| *n > 0);
                let options = FluentNumberOptions { minimum_fraction_digits, ..Default::default() };
                // Adding zero turns -0 into 0.
                FluentValue::Number(FluentNumber::new((value * grain).round() / grain + 0.0, options))
            }
        }
    }
}

type Bundle = FluentBundle<&'static FluentResource>;

impl Language {
    /// The sentence of an id without values.
    pub fn text(self, id: &str) -> String {
        self.say(id, &[])
    }

    /// The sentence of an id with its values. An id that the language lacks is looked up in English, and is returned
    /// itself where that lacks it too; the tests of this crate check that neither happens.
    pub fn say(self, id: &str, args: &[(&str, Arg)]) -> String {
        let values: FluentArgs = args.iter().map(|(name, arg)| (*name, arg.value())).collect();
        (self.format(id, &values).or_else(|| Self::English.format(id, &values)))
            .unwrap_or_else(|| id.to_owned())
    }

    fn format(self, id: &str, values: &FluentArgs) -> Option<String> {
        let bundle = self.bundle();
        let pattern = bundle.get_message(id)?.value()?;
        // A missing value appears by its name in the text; the tests check that there is none.
        let text = bundle.format_pattern(pattern, Some(values), &mut Vec::new());
        Some(text.into_owned())
    }

    fn bundle(self) -> &'static Bundle {
        static BUNDLES: [OnceLock<Bundle>; Language::ALL.len()] = [const { OnceLock::new() }; 3];
        BUNDLES[self as usize].get_or_init(|| self.load())
    }

    /// Its parsed file. Lines that are not Fluent are left out; the tests check that there are none.
    pub(crate) fn resource(self) -> &'static FluentResource {
        static FILES: [OnceLock<FluentResource>; Language::ALL.len()] = [const { OnceLock::new() }; 3];
        FILES[self as usize].get_or_init(|| {
            FluentResource::try_new(self.source().to_owned()).unwrap_or_else(|(read, _)| read)
        })
    }

    fn load(self) -> Bundle {
        let tag: LanguageIdentifier = self.code().parse().unwrap_or_default();
        let mut bundle = FluentBundle::new_concurrent(vec![tag]);
        // The marks that isolate values of another writing direction would be read aloud by some voices.
        bundle.set_use_isolating(false);
        if self.decimal_sign() == ',' {
            bundle.set_formatter(Some(|value, _| match value {
                FluentValue::Number(number) => Some(number.as_string().replace('.', ",")),
                _ => None,
            }));
        }
        // The name is free: nothing else was added yet.
        let _ = bundle.add_function("CAPITAL", |values, _| match values.first() {
            Some(FluentValue::String(text)) => FluentValue::String(Cow::Owned(capital(text))),
            _ => FluentValue::Error,
        });
        let _ = bundle.add_resource(self.resource());
        bundle
    }
}

/// The text with a capital letter at its beginning.
fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |c| c.to_uppercase().collect::<String>() + chars.as_str())
}
