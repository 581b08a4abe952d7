//! The surface and the map on the page in a real browser.

mod map;

use crate::browser::cdp::Browser;
use crate::browser::session::{accessible, building, started, wait};
use crate::walked;
use cairn_session::SessionConfig;
use cairn_web::{ServeConfig, Server};
use std::time::Duration;

/// The surface of what a depth camera sees, as it grows: drawn, in each of its colours, walked through by keys.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn surface_grows_on_the_page_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-surface", &walked::route_out(0.0, 0.1)) else {
        return;
    };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let server = Server::start(ServeConfig { session, dense: true, ..ServeConfig::new(building()) }).unwrap();
    let url = server.invitation().urls[0].clone();
    let desk = browser.open(&url, [1400, 900]);
    browser.still(&desk);
    wait(&mut browser, &desk, "Ready. ", "#control", 20.0);
    browser.eval(&desk, "document.getElementById('map').scrollIntoView()");
    wait(&mut browser, &desk, "The surface is about", "#map-words", 40.0);
    let area = |browser: &mut Browser| {
        let words = browser.text(&desk, "#map-words");
        let after = words.split("The surface is about ").nth(1).unwrap_or_default();
        after.split(' ').next().unwrap_or_default().parse::<f64>().unwrap_or_default()
    };
    let first = area(&mut browser);
    std::thread::sleep(Duration::from_secs(11));
    let grown = area(&mut browser);
    assert!(grown > first + 2.0, "{first} then {grown} square metres");
    // Triangles change what is drawn: with the surface and without; grid and ground have no colour.
    browser.eval(&desk, "document.getElementById('map').focus()");
    (0..5).for_each(|_| browser.key(&desk, "+"));
    let image = "document.getElementById('map').toDataURL()";
    let filled = "(() => { const c = document.createElement('canvas'); [c.width, c.height] = [64, 48]; const x = c.getContext('2d'); \
        x.drawImage(document.getElementById('map'), 0, 0, 64, 48); const d = x.getImageData(0, 0, 64, 48).data; let n = 0; \
        for (let i = 0; i < d.length; i += 4) n += Math.max(d[i], d[i + 1], d[i + 2]) - Math.min(d[i], d[i + 1], d[i + 2]) > 40 ? 1 : 0; \
        return n / (64 * 48); })()";
    let share = |browser: &mut Browser| {
        std::thread::sleep(Duration::from_millis(400));
        browser.eval(&desk, filled).as_f64().unwrap()
    };
    let with = share(&mut browser);
    browser.picture(&desk, &folder.join("desk.png"));
    browser.eval(&desk, "document.getElementById('map-surface').focus()");
    browser.key(&desk, " ");
    let without = share(&mut browser);
    browser.key(&desk, " ");
    println!("{with} of the map is filled with the surface, {without} without");
    assert!(with > without + 0.05, "{with} of the map is filled with the surface, {without} without");
    // The columns in place of the surface, of which the page had nothing before: boxes have colours too.
    for id in ["map-surface", "map-columns"] {
        browser.eval(&desk, &format!("document.getElementById('{id}').focus()"));
        browser.key(&desk, " ");
    }
    std::thread::sleep(Duration::from_secs(8));
    let columns = share(&mut browser);
    browser.picture(&desk, &folder.join("desk-columns.png"));
    println!("{columns} of the map is filled with columns");
    assert!(columns > without + 0.03, "{columns} of the map is filled with columns, {without} without");
    for id in ["map-columns", "map-surface"] {
        browser.eval(&desk, &format!("document.getElementById('{id}').focus()"));
        browser.key(&desk, " ");
    }
    // The colours, each of which is another picture and has its words.
    let mut seen = Vec::new();
    for (by, end) in [("height", "high"), ("age", "new"), ("normal", "faces up")] {
        browser.eval(
            &desk,
            &format!("document.getElementById('map-colour').value = '{by}'; document.getElementById('map-colour').dispatchEvent(new Event('change'))"),
        );
        wait(&mut browser, &desk, end, "#map-ramp-to", 2.0);
        std::thread::sleep(Duration::from_millis(300));
        browser.picture(&desk, &folder.join(format!("desk-{by}.png")));
        seen.push(browser.eval(&desk, image));
        accessible(&mut browser, &desk, &format!("surface by {by}"));
    }
    assert!(seen[0] != seen[1] && seen[1] != seen[2] && seen[0] != seen[2], "two colours are the same");
    // Walked through: each key moves the view, and none of them is a command meanwhile.
    browser.eval(&desk, "document.getElementById('map').focus()");
    let answer = browser.text(&desk, "#answer");
    let place = |browser: &mut Browser| browser.eval(&desk, image);
    let mut last = place(&mut browser);
    for key in ["w", "w", "a", "s", "d", "q", "e", "-"] {
        browser.key(&desk, key);
        std::thread::sleep(Duration::from_millis(200));
        let now = place(&mut browser);
        assert_ne!(now, last, "{key} changes nothing");
        last = now;
    }
    assert_eq!(browser.text(&desk, "#answer"), answer, "a key of walking was a command");
    for _ in 0..5 {
        ["w", "+"].iter().for_each(|key| browser.key(&desk, key));
    }
    std::thread::sleep(Duration::from_millis(300));
    browser.picture(&desk, &folder.join("desk-walked.png"));
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}
