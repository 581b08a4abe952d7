//! The map on the page in a real browser.

use crate::browser::cdp::Browser;
use crate::browser::session::{accessible, keeping, route_out, settle, started, wait};
use std::time::Duration;

/// The map in three dimensions: by keys alone, in both schemes, on a phone and a desk; flat where WebGL is missing.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn map_is_drawn_in_three_dimensions_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-map", &route_out()[..2]) else { return };
    let server = keeping(&folder.join("routes"));
    let url = server.invitation().urls[0].clone();
    let desk = browser.open(&url, [1400, 900]);
    let without = "const own = HTMLCanvasElement.prototype.getContext; HTMLCanvasElement.prototype.getContext = \
        function (kind, ...rest) { return kind === 'webgl' ? null : own.call(this, kind, ...rest); };";
    let flat = browser.open_after(&url, [390, 844], without);
    let phone = browser.open(&url, [390, 844]);
    browser.still(&phone);
    wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
    browser.click(&phone, "#take");
    wait(&mut browser, &phone, "Record", "#main", 20.0);
    settle();
    browser.click(&phone, "#main");
    wait(&mut browser, &phone, "Stop recording", "#main", 10.0);
    std::thread::sleep(Duration::from_secs(14));
    settle();
    browser.click(&phone, "#main");
    wait(&mut browser, &phone, "Recording has ended", "#log", 5.0);
    let is_solid = "document.getElementById('map').getContext('2d') === null";
    assert_eq!(browser.eval(&phone, is_solid), true, "WebGL is not used");
    assert_eq!(browser.eval(&flat, is_solid), false);
    for tab in [&phone, &flat, &desk] {
        browser.eval(tab, "document.getElementById('maps').scrollIntoView()");
    }
    wait(&mut browser, &phone, "path of the camera", "#map-legend", 5.0);
    wait(&mut browser, &phone, "A square of the grid is", "#map-grid", 5.0);
    wait(&mut browser, &phone, " m", "#map-scale", 5.0);
    for tab in [&phone, &desk, &flat] {
        assert!(browser.drawn(tab, "#map"), "the map is empty");
    }
    assert_eq!(browser.eval(&flat, "document.getElementById('map-controls').hidden"), true);
    for scheme in ["light", "dark"] {
        for (tab, name) in [(&phone, "phone"), (&desk, "desk"), (&flat, "flat")] {
            browser.scheme(tab, scheme);
            browser.eval(tab, "document.getElementById('maps').scrollIntoView()");
            std::thread::sleep(Duration::from_millis(1200));
            browser.picture(tab, &folder.join(format!("{name}-{scheme}.png")));
            accessible(&mut browser, tab, &format!("map, {name}, {scheme}"));
        }
    }
    // By keys alone: turned, moved, larger, and all of it again.
    browser.still(&phone);
    let shown = |browser: &mut Browser| {
        std::thread::sleep(Duration::from_millis(200));
        browser.eval(&phone, "document.getElementById('map-scale').textContent + document.getElementById('map').toDataURL().length")
    };
    browser.eval(&phone, "document.getElementById('map').focus()");
    let bar = |browser: &mut Browser| browser.text(&phone, "#map-scale");
    let whole = bar(&mut browser);
    let mut last = shown(&mut browser);
    for key in ["ArrowLeft", "ArrowUp", "+", "+", "+", "+", "+"] {
        browser.key(&phone, key);
        let now = shown(&mut browser);
        assert_ne!(now, last, "{key} changes nothing");
        last = now;
    }
    assert_ne!(bar(&mut browser), whole, "the scale bar follows the size");
    browser.picture(&phone, &folder.join("phone-near.png"));
    // The map has grown meanwhile: a page opened now, of the same size, shows all of it.
    let watching = browser.open(&url, [390, 844]);
    browser.still(&watching);
    browser.eval(&watching, "document.getElementById('maps').scrollIntoView()");
    browser.key(&phone, "0");
    let is_whole = (0..25).any(|_| {
        std::thread::sleep(Duration::from_millis(200));
        let [all, again] = [&watching, &phone].map(|tab| browser.text(tab, "#map-scale"));
        !all.is_empty() && all == again
    });
    assert!(is_whole, "{} is not the whole map", browser.text(&phone, "#map-scale"));
    browser.click(&phone, "#map-follow");
    browser.eval(
        &phone,
        "document.getElementById('map-colour').value = 'age'; document.getElementById('map-colour').dispatchEvent(new Event('change'))",
    );
    wait(&mut browser, &phone, "new", "#map-ramp-to", 2.0);
    std::thread::sleep(Duration::from_millis(300));
    browser.picture(&phone, &folder.join("phone-follow.png"));
    // Under guidance the cleaned route is drawn.
    settle();
    browser.click(&phone, "#main");
    std::thread::sleep(Duration::from_secs(3));
    browser.eval(&desk, "document.getElementById('maps').scrollIntoView()");
    browser.picture(&desk, &folder.join("desk-guiding.png"));
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}
