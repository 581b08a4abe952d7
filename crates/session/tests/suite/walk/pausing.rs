//! Guidance that the walker pauses: silence, also where it would say stop, and then on from wherever they are.

use crate::walk::scripted::{Walk, out};

#[test]
fn paused_guidance_is_silent_and_goes_on_from_where_the_walker_is() {
    let mut walk = Walk::named("pause");
    walk.see(&out()[..1]);
    assert_eq!(walk.ask("pause"), Err("Guidance is not running.".into()));
    walk.ask("record").unwrap();
    walk.see(&out()[1..]);
    walk.ask("stop").unwrap();
    walk.ask("guide back").unwrap();
    let quarter = out().len() / 4;
    walk.see(out()[3 * quarter..].iter().rev());
    assert_eq!(walk.ask("resume"), Err("Guidance is not paused.".into()));
    assert_eq!(walk.ask("pause").as_deref(), Ok("Guidance is paused."));
    let (paused, along_m) = (walk.now, walk.session.status().guiding.unwrap().along_m);
    walk.see(out()[2 * quarter..3 * quarter].iter().rev());
    let status = walk.session.status();
    assert_eq!((status.guiding.unwrap().state, &status.headline[..]), ("paused", "Guidance is paused."));
    // A call: no pictures meanwhile.
    walk.wait(4.0);
    let said: Vec<_> =
        walk.said.iter().filter(|(t, _)| *t > paused + 0.1).map(|(_, text)| &text[..]).collect();
    assert_eq!(said, ["No picture from the camera. Stand still."], "{}", walk.transcript());
    // What is wrong counts for more than that it is silent.
    assert_eq!(walk.session.status().headline, "No image from the camera.");
    // A recording meanwhile is another route.
    walk.ask("record").unwrap();
    walk.see(out()[quarter..2 * quarter].iter().rev().take(15));
    walk.ask("stop").unwrap();
    assert_eq!(walk.ask("resume").as_deref(), Ok("Guidance goes on."));
    let resumed = walk.now;
    walk.see(out()[quarter..2 * quarter].iter().rev().skip(15));
    let joins = |(t, text): &(f64, String)| *t >= resumed && text.contains("You are on the route");
    assert!(walk.said.iter().any(joins), "{}", walk.transcript());
    assert!(walk.session.status().guiding.unwrap().along_m > along_m + 2.0);
    walk.see(out()[..quarter].iter().rev());
    assert!(walk.session.has_arrived(), "{}", walk.transcript());
    assert_eq!(walk.ask("resume"), Err("Guidance is not paused.".into()));
}
