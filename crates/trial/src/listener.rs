//! How a listener understands the clauses of a language.
//!
//! Written by hand and without the catalogue, so that a sentence whose translation sends the walker to the wrong side, or
//! that a speaker of the language would not act on, shows in the trials.

use cairn_phrases::Language;

/// What a clause asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Meaning {
    Stop,
    StopTurning,
    /// Turn on the spot by about this many degrees, positive left.
    Turn(f64),
    /// Turn round, to either side.
    TurnAround,
    /// Change direction a little without stopping: plus one for left.
    Bear(f64),
    Forward,
    ForwardSlowly,
    Back,
    /// One step back and to a side: plus one for left.
    Step(f64),
    /// A small step to a side: plus one for left.
    SmallStep(f64),
    Slow,
}

/// True for clauses about what comes later: "in 6 metres", "soon", "then turn left" after "continue". `clause` is in
/// lower case, without the full stop or comma at its end.
pub(crate) fn is_future(language: Language, clause: &str) -> bool {
    let mut words = clause.split_whitespace();
    match (language, words.next()) {
        (Language::English, Some("in" | "soon")) => true,
        (Language::English, Some("then")) => !matches!(words.next(), Some("continue" | "move")),
        (Language::Spanish, Some("en" | "pronto" | "luego")) => true,
        (Language::Spanish, Some("y")) => words.next() == Some("enseguida"),
        (Language::German, Some("in" | "bald" | "dann")) => true,
        _ => false,
    }
}

/// What a clause asks for now; `None` for information.
pub(crate) fn understand(language: Language, clause: &str) -> Option<Meaning> {
    let words: Vec<&str> = clause.split_whitespace().collect();
    match language {
        Language::English => english(&words),
        Language::Spanish => spanish(&words),
        Language::German => german(&words),
    }
}

/// Plus one for a word for left, minus one for right, zero for neither or both.
fn side(words: &[&str], left: &str, right: &str) -> f64 {
    match (words.contains(&left), words.contains(&right)) {
        (true, false) => 1.0,
        (false, true) => -1.0,
        _ => 0.0,
    }
}

/// The hour of a clock face as an angle in degrees, positive left.
fn hour(word: &str) -> Option<Meaning> {
    let hour: f64 = word.parse().ok()?;
    Some(Meaning::Turn(cairn_guide::wrap(-(30.0 * hour).to_radians()).to_degrees()))
}

/// The number before a word such as "degrees".
fn number_before(words: &[&str], unit: &str) -> Option<f64> {
    let at = words.iter().position(|w| *w == unit)?;
    words.get(at.checked_sub(1)?)?.parse().ok()
}

fn english(words: &[&str]) -> Option<Meaning> {
    let words = if words.first() == Some(&"then") { &words[1..] } else { words };
    let side = side(words, "left", "right");
    Some(match words {
        ["stop", "turning", ..] => Meaning::StopTurning,
        ["stop", ..] => Meaning::Stop,
        ["continue", ..] => Meaning::Forward,
        ["move", "back", ..] => Meaning::Back,
        ["move", "slowly", ..] => Meaning::ForwardSlowly,
        ["move", ..] => Meaning::Forward,
        ["step", "back", ..] => Meaning::Step(side),
        ["take", "a", "small", "step", ..] => Meaning::SmallStep(side),
        ["slow", "down", ..] => Meaning::Slow,
        ["bear", ..] | ["rotate", _, "a", "little", ..] => Meaning::Bear(side),
        ["turn" | "rotate", "to", at, ..] => return hour(at),
        ["turn" | "rotate", rest @ ..] => match (number_before(rest, "degrees"), rest) {
            (Some(degrees), _) => Meaning::Turn(side * degrees),
            (None, ["slightly", ..]) => Meaning::Turn(side * 40.0),
            (None, ["sharp", ..]) => Meaning::Turn(side * 135.0),
            (None, ["around", ..]) => Meaning::TurnAround,
            (None, ["left" | "right", ..]) => Meaning::Turn(side * 90.0),
            _ => return None,
        },
        _ => return None,
    })
}

fn spanish(words: &[&str]) -> Option<Meaning> {
    let side = side(words, "izquierda", "derecha");
    Some(match words {
        ["alto", ..] => Meaning::Stop,
        ["deje", "de", "girar", ..] => Meaning::StopTurning,
        ["continúe", ..] => Meaning::Forward,
        ["avance", "despacio", ..] => Meaning::ForwardSlowly,
        ["retroceda", ..] => Meaning::Back,
        ["dé", "un", "paso", "atrás", ..] => Meaning::Step(side),
        ["dé", "un", "paso", "pequeño", ..] => Meaning::SmallStep(side),
        ["dé", "media", "vuelta", ..] => Meaning::TurnAround,
        ["más", "despacio", ..] => Meaning::Slow,
        ["más", "a", "la", ..] | ["gire", "un", "poco", ..] => Meaning::Bear(side),
        ["gire", "a", "la" | "las", at, ..] if side == 0.0 => return hour(at),
        ["gire", rest @ ..] => match (number_before(rest, "grados"), rest) {
            (Some(degrees), _) => Meaning::Turn(side * degrees),
            (None, ["ligeramente", ..]) => Meaning::Turn(side * 40.0),
            (None, ["mucho", ..]) => Meaning::Turn(side * 135.0),
            _ if side != 0.0 => Meaning::Turn(side * 90.0),
            _ => return None,
        },
        _ => return None,
    })
}

fn german(words: &[&str]) -> Option<Meaning> {
    let side = side(words, "links", "rechts");
    let has = |word: &str| words.contains(&word);
    Some(match words {
        ["halt", ..] => Meaning::Stop,
        ["nicht", "weiter", "drehen", ..] => Meaning::StopTurning,
        ["langsamer", ..] => Meaning::Slow,
        ["einen", "kleinen", "schritt", ..] => Meaning::SmallStep(side),
        ["einen", "schritt", "zurück", ..] => Meaning::Step(side),
        _ if has("rückwärtsgehen") => Meaning::Back,
        _ if has("weitergehen") && has("langsam") => Meaning::ForwardSlowly,
        _ if has("weitergehen") => Meaning::Forward,
        _ if has("halten") || (has("ein") && has("wenig")) => Meaning::Bear(side),
        _ if has("umdrehen") => Meaning::TurnAround,
        _ if !has("drehen") && !has("abbiegen") => return None,
        _ if has("uhr") => return hour(words[words.iter().position(|w| *w == "uhr")?.checked_sub(1)?]),
        _ => match number_before(words, "grad") {
            Some(degrees) => Meaning::Turn(side * degrees),
            None if has("leicht") || has("etwas") => Meaning::Turn(side * 40.0),
            None if has("scharf") || has("weit") => Meaning::Turn(side * 135.0),
            None if side != 0.0 => Meaning::Turn(side * 90.0),
            None => return None,
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_mean_the_same_in_every_language() {
        for (meaning, english, spanish, german) in [
            (Meaning::Stop, "stop", "alto", "halt"),
            (Meaning::StopTurning, "stop turning", "deje de girar", "nicht weiter drehen"),
            (Meaning::Turn(90.0), "turn left now", "gire a la izquierda ahora", "jetzt links abbiegen"),
            (Meaning::Turn(-90.0), "turn to 3 o'clock", "gire a las 3", "auf 3 uhr drehen"),
            (
                Meaning::Turn(-40.0),
                "turn slightly right",
                "gire ligeramente a la derecha",
                "etwas nach rechts drehen",
            ),
            (
                Meaning::Turn(110.0),
                "turn left 110 degrees",
                "gire 110 grados a la izquierda",
                "110 grad nach links drehen",
            ),
            (Meaning::TurnAround, "turn around", "dé media vuelta", "umdrehen"),
            (Meaning::Bear(-1.0), "bear right", "más a la derecha", "etwas rechts halten"),
            (
                Meaning::Bear(1.0),
                "rotate left a little",
                "gire un poco a la izquierda",
                "ein wenig nach links drehen",
            ),
            (Meaning::Forward, "continue 5 metres", "continúe 5 metros", "5 meter weitergehen"),
            (
                Meaning::ForwardSlowly,
                "move slowly 2 metres",
                "avance despacio 2 metros",
                "langsam 2 meter weitergehen",
            ),
            (Meaning::Back, "move back 9 metres", "retroceda 9 metros", "9 meter rückwärtsgehen"),
        ] {
            for (language, clause) in
                [(Language::English, english), (Language::Spanish, spanish), (Language::German, german)]
            {
                let understood = understand(language, clause).unwrap_or_else(|| panic!("{clause}"));
                let same = match (understood, meaning) {
                    (Meaning::Turn(a), Meaning::Turn(b)) => (a - b).abs() < 1e-9,
                    (a, b) => a == b,
                };
                assert!(same && !is_future(language, clause), "{clause}: {understood:?}");
            }
        }
    }
}
