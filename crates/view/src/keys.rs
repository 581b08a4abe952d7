//! The keys of the view: one table for the window, the page and the help.

/// What a key does to the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Act {
    /// Turns it: to the right and up, radians. With Shift it is moved, by shares of what is seen.
    Turn([f32; 2]),
    /// Walks: steps to the right, up, ahead.
    Walk([f32; 3]),
    /// Changes its size by a factor.
    Grow(f32),
    /// Shows all.
    All,
}

/// A key of the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Its name as browsers have it; letters in lower case.
    pub key: &'static str,
    /// What it does.
    pub act: Act,
}

const TURN: f32 = 0.1;
const GROW: f32 = 1.2;

const fn key(key: &'static str, act: Act) -> Key {
    Key { key, act }
}

/// All keys of the view. The sentence `page-map-help` tells them to people, which a test checks.
pub const KEYS: [Key; 14] = [
    key("ArrowLeft", Act::Turn([-TURN, 0.0])),
    key("ArrowRight", Act::Turn([TURN, 0.0])),
    key("ArrowUp", Act::Turn([0.0, TURN])),
    key("ArrowDown", Act::Turn([0.0, -TURN])),
    key("w", Act::Walk([0.0, 0.0, 1.0])),
    key("s", Act::Walk([0.0, 0.0, -1.0])),
    key("a", Act::Walk([-1.0, 0.0, 0.0])),
    key("d", Act::Walk([1.0, 0.0, 0.0])),
    key("q", Act::Walk([0.0, -1.0, 0.0])),
    key("e", Act::Walk([0.0, 1.0, 0.0])),
    key("+", Act::Grow(GROW)),
    // Plus without Shift on many keyboards.
    key("=", Act::Grow(GROW)),
    key("-", Act::Grow(1.0 / GROW)),
    key("0", Act::All),
];

/// The key of this name, in either case.
pub fn key_of(name: &str) -> Option<&'static Key> {
    KEYS.iter().find(|k| k.key.eq_ignore_ascii_case(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_phrases::Language;

    #[test]
    fn help_names_every_key_in_every_language() {
        for language in Language::ALL {
            let help = language.text("page-map-help");
            let named = |word: &str| help.split(|c: char| !c.is_alphanumeric()).any(|w| w == word);
            for k in KEYS.iter().filter(|k| k.key.len() == 1 && k.key.as_bytes()[0].is_ascii_alphanumeric()) {
                assert!(named(&k.key.to_uppercase()), "{language}: {} in {help}", k.key);
            }
        }
    }

    #[test]
    fn no_key_is_there_twice_and_opposite_keys_undo_each_other() {
        for (i, k) in KEYS.iter().enumerate() {
            assert!(KEYS[..i].iter().all(|before| before.key != k.key));
            assert_eq!(key_of(&k.key.to_uppercase()), Some(k));
        }
        let act = |name| key_of(name).map(|k| k.act);
        for (one, other) in [("w", "s"), ("d", "a"), ("e", "q")] {
            let (Some(Act::Walk(a)), Some(Act::Walk(b))) = (act(one), act(other)) else { panic!("{one}") };
            assert_eq!(a, b.map(|v| -v));
        }
        assert_eq!(key_of("z"), None);
    }
}
