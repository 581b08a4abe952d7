//! A simulated blind walker who reacts only to the spoken words.
//!
//! It understands what is said in its language, clause by clause, and knows nothing of the route, the map or the cues.
//! It reacts late, turns too far (17 degrees on average: Ahmetovic et al. 2018), veers, and keeps going
//! until told otherwise.

use crate::listener::{Meaning, is_future, understand};
use cairn_guide::{Side, speaking_time};
use cairn_phrases::Language;
use cairn_random::Random;
use cairn_sensor::Stamp;

/// What the walker will do.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Action {
    Stop,
    StopTurning,
    /// Turn on the spot by this, radians, positive left.
    Turn(f64),
    /// Change direction a little without stopping.
    Bear(f64),
    Forward,
    ForwardSlowly,
    Back,
    /// One step back and to a side: plus one for left.
    Step(f64),
    /// One small step to a side: metres, to the left.
    SmallStep(f64),
    Slow,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Activity {
    Standing,
    /// Going at plus (forward) or minus one (backwards) times the speed.
    Going(f64),
    /// Turning on the spot by the remaining angle (not wrapped); then going again with this sign, or standing (0).
    Turning {
        left: f64,
        then: f64,
    },
    /// Stepping in a straight line: metres left, and the direction relative to the heading.
    Stepping {
        left: f64,
        direction: f64,
    },
}

/// A direction that was heard and is not carried out yet.
#[derive(Clone, Copy, Debug, PartialEq)]
struct PendingAction {
    /// When the clause had been spoken to its end.
    at: Stamp,
    /// When the walker will act on it, after the reaction time.
    due: Stamp,
    action: Action,
    utterance: u64,
}

/// The simulated walker.
#[derive(Clone, Debug)]
pub struct Walker {
    random: Random,
    x: f64,
    y: f64,
    heading: f64,
    now: Option<Stamp>,
    activity: Activity,
    /// Directions that were heard and are not carried out yet.
    pending: Vec<PendingAction>,
    /// How many utterances were heard.
    utterances: u64,
    /// Remaining angle of a small course change in progress, radians.
    bearing: f64,
    speed: f64,
    step_scale: f64,
    turn_rate: f64,
    /// Veer in radians a metre.
    veer: f64,
    speech_rate: f64,
    language: Language,
}

impl Walker {
    /// A walker at x, y in metres with a heading in radians (counter-clockwise from x). The seed decides
    /// speed (0.4 to 1.2 m/s), step length (off by up to 10 %), turn rate (25 to 45 degrees a second), veer.
    pub fn new(seed: u64, start: (f64, f64, f64)) -> Self {
        let mut random = Random::new(seed);
        let speed = random.uniform(0.4, 1.2);
        let step_scale = random.uniform(0.9, 1.1);
        let turn_rate = random.uniform(25.0, 45.0_f64).to_radians();
        let (x, y, heading) = start;
        let mut walker = Self {
            random,
            x,
            y,
            heading,
            now: None,
            activity: Activity::Standing,
            pending: Vec::new(),
            utterances: 0,
            bearing: 0.0,
            speed,
            step_scale,
            turn_rate,
            veer: 0.0,
            speech_rate: 1.0,
            language: Language::default(),
        };
        walker.draw_veer();
        walker
    }

    /// Sets the speech rate of the voice, which decides when a clause has been heard to its end.
    pub fn with_speech_rate(mut self, rate: f64) -> Self {
        self.speech_rate = rate;
        self
    }

    /// Sets the language that the walker understands.
    pub fn with_language(mut self, language: Language) -> Self {
        self.language = language;
        self
    }

    /// True position and heading: x, y in metres, radians.
    pub fn pose(&self) -> (f64, f64, f64) {
        (self.x, self.y, self.heading)
    }

    /// Moves the walker to a place that is not where its own steps led, such as along a wall it walked into. Metres.
    pub fn held_at(&mut self, x: f64, y: f64) {
        (self.x, self.y) = (x, y);
    }

    /// True while the walker makes a step to a side, or back and to a side.
    pub fn is_stepping(&self) -> bool {
        matches!(self.activity, Activity::Stepping { .. })
    }

    /// True when the walker neither moves nor turns.
    pub fn is_standing(&self) -> bool {
        self.activity == Activity::Standing && self.bearing == 0.0
    }

    /// The voice starts to say this now; what it was saying breaks off, and clauses that had not been heard to
    /// their end are not acted on.
    pub fn hear(&mut self, text: &str, stamp: Stamp) {
        self.pending.retain(|h| h.at <= stamp);
        self.utterances += 1;
        let reaction = self.random.uniform(0.3, 1.2);
        let mut said = String::new();
        for sentence in text.split_inclusive('.') {
            let mut future = false;
            for clause in sentence.split_inclusive(',') {
                let before = said.clone();
                said += clause;
                let plain = clause.trim().trim_end_matches(['.', ',']).to_lowercase();
                future |= is_future(self.language, &plain);
                if future {
                    continue;
                }
                if let Some(action) = self.parse_clause(&plain) {
                    // The word "stop" is acted on as soon as it is spoken, anything else when the clause has ended.
                    let at_once = matches!(action, Action::Stop | Action::StopTurning);
                    let until = if at_once { before + "stop" } else { said.clone() };
                    let at = stamp.plus_seconds(speaking_time(&until, self.speech_rate));
                    // After "continue" the rest of the sentence is for later.
                    future |= matches!(action, Action::Forward | Action::ForwardSlowly | Action::Back);
                    let (due, utterance) = (at.plus_seconds(reaction), self.utterances);
                    self.pending.push(PendingAction { at, due, action, utterance });
                }
            }
        }
    }

    /// What the walker will do at a clause, as inaccurately as people do it; `None` for information.
    fn parse_clause(&mut self, clause: &str) -> Option<Action> {
        Some(match understand(self.language, clause)? {
            Meaning::Stop => Action::Stop,
            Meaning::StopTurning => Action::StopTurning,
            Meaning::Forward => Action::Forward,
            Meaning::ForwardSlowly => Action::ForwardSlowly,
            Meaning::Back => Action::Back,
            Meaning::Step(side) => Action::Step(side),
            // People's small steps differ.
            Meaning::SmallStep(side) => Action::SmallStep(side * self.random.uniform(0.15, 0.3)),
            Meaning::Slow => Action::Slow,
            Meaning::Bear(side) => {
                // A small course change is overshot by a share of the overshoot of a full turn.
                let angle = 15.0 + 0.25 * self.random.normal(17.0, 8.0);
                Action::Bear(side * angle.to_radians())
            }
            Meaning::Turn(degrees) => self.turn(degrees.abs(), degrees.signum()),
            Meaning::TurnAround => {
                let side = [1.0, -1.0][self.random.below(2)];
                self.turn(180.0, side)
            }
        })
    }

    fn turn(&mut self, degrees: f64, side: f64) -> Action {
        let angle = (degrees + self.random.normal(17.0, 8.0)).max(5.0);
        Action::Turn(side * angle.to_radians())
    }

    /// Advances the simulation by `dt` seconds; returns the true pose after it.
    pub fn step(&mut self, dt: f64, now: Stamp) -> (f64, f64, f64) {
        self.now = Some(now);
        let due: Vec<PendingAction> = self.pending.iter().filter(|h| h.due <= now).copied().collect();
        // Acting on a newer direction discards older ones.
        let newest = due.iter().map(|h| h.utterance).max().unwrap_or(0);
        self.pending.retain(|h| h.due > now && h.utterance >= newest);
        for h in due.iter().filter(|h| h.utterance == newest) {
            self.act(h.action);
        }
        self.go(dt);
        self.pose()
    }

    fn act(&mut self, action: Action) {
        let going = match self.activity {
            Activity::Going(sign) => sign,
            Activity::Turning { then, .. } => then,
            _ => 0.0,
        };
        match action {
            Action::Stop => {
                self.activity = Activity::Standing;
                self.bearing = 0.0;
            }
            Action::StopTurning => {
                self.bearing = 0.0;
                self.finish_turn(going);
            }
            Action::Turn(left) => self.activity = Activity::Turning { left, then: going },
            Action::Bear(angle) => self.bearing = angle,
            Action::ForwardSlowly => {
                self.act(Action::Slow);
                self.act(Action::Forward);
            }
            Action::Forward | Action::Back => {
                let sign = if action == Action::Back { -1.0 } else { 1.0 };
                match &mut self.activity {
                    Activity::Turning { then, .. } => *then = sign,
                    _ => {
                        if self.activity == Activity::Standing {
                            self.draw_veer();
                        }
                        self.activity = Activity::Going(sign);
                    }
                }
            }
            Action::Step(side) => {
                // Back and to a side: halfway between the two.
                let direction = if side > 0.0 { 0.75 } else { -0.75 } * std::f64::consts::PI;
                self.activity = Activity::Stepping { left: 0.5 * self.step_scale, direction };
            }
            Action::SmallStep(left_m) => {
                let direction = left_m.signum() * std::f64::consts::FRAC_PI_2;
                self.activity = Activity::Stepping { left: left_m.abs() * self.step_scale, direction };
            }
            Action::Slow => self.speed = self.speed.min((0.75 * self.speed).max(0.4)),
        }
    }

    fn finish_turn(&mut self, then: f64) {
        self.activity = if then == 0.0 { Activity::Standing } else { Activity::Going(then) };
        self.draw_veer();
    }

    fn draw_veer(&mut self) {
        // Up to 5 degrees in 10 metres.
        self.veer = self.random.uniform(-5.0, 5.0_f64).to_radians() / 10.0;
    }

    fn go(&mut self, dt: f64) {
        let limit = self.turn_rate * dt;
        let change = self.bearing.clamp(-limit, limit);
        self.bearing -= change;
        self.heading += change;
        match self.activity {
            Activity::Standing => {}
            Activity::Going(sign) => {
                // People walk backwards at half the speed.
                let pace = if sign < 0.0 { 0.5 } else { 1.0 };
                let metres = self.speed * self.step_scale * pace * dt;
                self.heading += self.veer * metres;
                self.advance(metres, if sign < 0.0 { std::f64::consts::PI } else { 0.0 });
            }
            Activity::Turning { left, then } => {
                let turn = left.clamp(-limit, limit);
                self.heading += turn;
                self.activity = Activity::Turning { left: left - turn, then };
                if (left - turn).abs() < 1e-9 {
                    self.finish_turn(then);
                }
            }
            Activity::Stepping { left, direction } => {
                let metres = left.min(0.5 * dt);
                self.advance(metres, direction);
                let left = left - metres;
                self.activity =
                    if left > 1e-9 { Activity::Stepping { left, direction } } else { Activity::Standing };
            }
        }
        self.heading = cairn_guide::wrap(self.heading);
    }

    fn advance(&mut self, metres: f64, direction: f64) {
        self.x += metres * (self.heading + direction).cos();
        self.y += metres * (self.heading + direction).sin();
    }
}

/// The side of the first direction in a text, as a walker with this language understands it.
pub fn side_of(text: &str, language: Language) -> Option<Side> {
    direction_of(text, language).map(|(side, _)| side)
}

/// The same, and whether it is a step to that side.
pub fn direction_of(text: &str, language: Language) -> Option<(Side, bool)> {
    for sentence in text.to_lowercase().split('.') {
        for clause in sentence.split(',').map(str::trim) {
            if is_future(language, clause) {
                break;
            }
            match understand(language, clause) {
                Some(Meaning::Turn(side) | Meaning::Bear(side)) => return Some((Side::of(side), false)),
                Some(Meaning::Step(side) | Meaning::SmallStep(side)) => return Some((Side::of(side), true)),
                // What follows is for later.
                Some(Meaning::Forward | Meaning::ForwardSlowly | Meaning::Back) => break,
                _ => {}
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lets a walker without pending directions hear texts and walk for some seconds: distance and turn.
    fn after(texts: &[(&str, f64)], seconds: f64) -> (Walker, f64, f64) {
        let mut walker = Walker::new(11, (0.0, 0.0, 0.0));
        let (mut turned, mut last) = (0.0, 0.0);
        for tick in 0..(seconds / 0.05) as i64 {
            let now = Stamp::from_seconds(tick as f64 * 0.05);
            for (text, _) in texts.iter().filter(|(_, at)| (at / 0.05).round() as i64 == tick) {
                walker.hear(text, now);
            }
            let (_, _, heading) = walker.step(0.05, now);
            turned += cairn_guide::wrap(heading - last);
            last = heading;
        }
        let (x, y, _) = walker.pose();
        (walker, x.hypot(y), turned.to_degrees())
    }

    #[test]
    fn walks_until_told_and_stops_late() {
        let (walker, metres, _) = after(&[("Continue 3 metres to the end.", 0.0)], 30.0);
        assert!(metres > 10.0 && !walker.is_standing());
        let (walker, metres, _) =
            after(&[("Continue 3 metres to the end.", 0.0), ("Stop. You have arrived.", 10.0)], 30.0);
        assert!(walker.is_standing() && metres < 12.0);
    }

    #[test]
    fn overshoots_turns_unless_told_to_stop() {
        let (_, metres, turned) = after(&[("Turn left.", 0.0)], 15.0);
        assert!((100.0..125.0).contains(&turned) && metres == 0.0, "{turned}");
        let (_, _, turned) = after(&[("Turn right.", 0.0), ("Stop turning.", 1.7)], 15.0);
        assert!((-90.0..-5.0).contains(&turned), "{turned}");
    }

    #[test]
    fn later_directions_are_not_acted_on_now() {
        for text in [
            "In 6 metres, turn left.",
            "Soon, turn left.",
            "Another 10 metres, then turn left.",
            "Off the path. It is 2 metres to your left.",
            "The route is 10 metres long.",
        ] {
            let (walker, metres, turned) = after(&[(text, 0.0)], 15.0);
            assert!(walker.is_standing() && metres == 0.0 && turned == 0.0, "{text}");
        }
        let (_, metres, turned) =
            after(&[("Continue 5 metres, then turn left, then in 3 metres turn right.", 0.0)], 15.0);
        assert!(metres > 2.0 && turned.abs() < 10.0);
    }

    #[test]
    fn interrupted_sentences_are_not_followed() {
        let long = "I found my place. Continue 10 metres.";
        let (_, metres, _) = after(&[(long, 0.0), ("Stop. I lost my place.", 0.5)], 15.0);
        assert_eq!(metres, 0.0);
    }

    #[test]
    fn moves_backwards_slowly() {
        let (walker, ..) = after(&[("Feel behind you with the cane. Move back 10 metres.", 0.0)], 10.0);
        assert!(walker.pose().0 < -0.5, "{:?}", walker.pose());
        let (walker, metres, _) = after(&[("Stop. Step back and to your left.", 0.0)], 10.0);
        let (x, y, _) = walker.pose();
        assert!(x < -0.2 && y > 0.2 && metres < 0.6 && walker.is_standing());
    }

    #[test]
    fn side_of_reads_the_first_direction() {
        assert_eq!(
            side_of("Off the path. Bear left, it is 2 metres away.", Language::English),
            Some(Side::Left)
        );
        assert_eq!(side_of("Stop. Step back and to your right.", Language::English), Some(Side::Right));
        assert_eq!(side_of("Continue 5 metres, then turn left.", Language::English), None);
        assert_eq!(side_of("Turn around.", Language::English), None);
        assert_eq!(side_of("Turn to 9 o'clock now.", Language::English), Some(Side::Left));
    }
}
