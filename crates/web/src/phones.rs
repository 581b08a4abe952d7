//! The phones that have recorded routes here, by the token that each page keeps. A page that another address or port has made a
//! stranger is offered to be one of them again: with its lens, its routes and its settings.

use crate::certificate::write_private;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The file in the data folder, and the most phones in it.
const FILE: &str = "phones.json";
const MOST: usize = 32;
/// Largest such file that is read, bytes.
const MOST_BYTES: u64 = 1 << 20;
/// The longest token and the largest settings, bytes.
const TOKEN: usize = 64;
const SETTINGS: usize = 4096;

/// A phone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct KnownPhone {
    /// Its token.
    pub phone: String,
    /// The number and the name of the newest route that it can be guided along; none before the first.
    route: Option<(u32, Option<String>)>,
    /// What its page keeps.
    settings: Value,
}

/// All phones, newest last, and the one whose images are taken.
pub(crate) struct Phones {
    file: Option<PathBuf>,
    known: Mutex<(Vec<KnownPhone>, String)>,
}

impl Phones {
    /// Those of a data folder; without one they are forgotten at the end.
    pub fn of(folder: Option<&std::path::Path>) -> Self {
        let file = folder.map(|folder| folder.join(FILE));
        let text = file.as_ref().and_then(|file| cairn_files::read_text(file, MOST_BYTES).ok());
        // A file that cannot be read is the same as none: the phones are asked again.
        let known = serde_json::from_str(&text.unwrap_or_default()).unwrap_or_default();
        Self { file, known: Mutex::new((known, String::new())) }
    }

    /// The phone whose images are taken from now on.
    pub fn set_current(&self, phone: &str) {
        // What a page calls itself is kept in a file: no more of it than a token needs.
        self.lock().1 = phone.chars().take(TOKEN).collect();
    }

    /// The phone whose images are taken; empty where it is not known.
    pub fn current(&self) -> String {
        self.lock().1.clone()
    }

    /// What a page asks its walker: whether it is one of these phones, the newest first. None for a phone that is known; never the
    /// one that holds the walk.
    pub fn offered(&self, phone: &str, is_held: bool) -> Vec<KnownPhone> {
        let (known, current) = &*self.lock();
        let routed = || known.iter().rev().filter(|k| k.route.is_some());
        if phone.is_empty() || routed().any(|k| k.phone == phone) {
            return Vec::new();
        }
        routed().filter(|k| !is_held || k.phone != *current).cloned().collect()
    }

    /// What a page keeps, for when it comes from another address.
    pub fn keep_settings(&self, phone: &str, settings: Value) {
        if settings.to_string().len() <= SETTINGS {
            self.change(phone, |k| k.settings = settings);
        }
    }

    /// The newest route that the present phone can be guided along.
    pub fn keep_route(&self, route: (u32, Option<String>)) {
        self.change(&self.current(), |k| k.route = Some(route));
    }

    fn change(&self, phone: &str, change: impl FnOnce(&mut KnownPhone)) {
        let known = &mut self.lock().0;
        if phone.is_empty() || phone.len() > TOKEN {
            return;
        }
        let at = known.iter().position(|k| k.phone == phone);
        let before = at.map(|at| known.remove(at));
        let unknown = || KnownPhone { phone: phone.to_owned(), route: None, settings: Value::Null };
        let mut now = before.clone().unwrap_or_else(unknown);
        change(&mut now);
        known.push(now);
        // Those without a route go first.
        if known.len() > MOST {
            let without = known.iter().position(|k| k.route.is_none());
            known.remove(without.unwrap_or(0));
        }
        let Some(file) = self.file.as_ref().filter(|_| before.as_ref() != known.last()) else { return };
        let routed: Vec<&KnownPhone> = known.iter().filter(|k| k.route.is_some()).collect();
        if let (false, Ok(text)) = (routed.is_empty(), serde_json::to_string(&routed)) {
            // What cannot be written is asked again another day.
            let _ = file
                .parent()
                .map_or(Ok(()), std::fs::create_dir_all)
                .and_then(|()| write_private(file, &text));
        }
    }

    fn lock(&self) -> MutexGuard<'_, (Vec<KnownPhone>, String)> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_stranger_is_offered_the_phones_with_routes_and_a_known_one_nothing() {
        let folder = std::env::temp_dir().join(format!("cairn-phones-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&folder);
        let phones = Phones::of(Some(&folder));
        phones.keep_settings("one", json!({ "speed": 240 }));
        assert!(phones.offered("two", false).is_empty(), "it has no route yet");
        phones.set_current("one");
        phones.keep_route((1, Some("to the library".into())));
        assert!(phones.offered("one", false).is_empty() && phones.offered("", false).is_empty());
        assert!(phones.offered("two", true).is_empty(), "the one that holds the walk is no other");
        // Another day.
        let phones = Phones::of(Some(&folder));
        let [known] = &phones.offered("two", false)[..] else { panic!("one is known") };
        assert_eq!((&known.phone[..], &known.route), ("one", &Some((1, Some("to the library".into())))));
        assert_eq!(known.settings["speed"], 240);
        // The newest is asked for first; who comes without a route pushes nobody out.
        phones.set_current("two");
        phones.keep_route((2, None));
        (0..100).for_each(|k| phones.keep_settings(&format!("other {k}"), Value::Null));
        phones.keep_settings(&"x".repeat(TOKEN + 1), Value::Null);
        phones.keep_settings("two", json!("x".repeat(SETTINGS)));
        let offered = phones.offered("three", false);
        assert_eq!(offered.iter().map(|k| &k.phone[..]).collect::<Vec<_>>(), ["two", "one"]);
        assert_eq!(offered[0].settings, Value::Null);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
