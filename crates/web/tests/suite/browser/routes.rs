//! Routes that are kept for another day.

use crate::browser::session::{accessible, keeping, settle, started, wait};
use crate::walked;
use std::time::Duration;

/// Records a route with a note, names it, ends the server; another one finds it, guides along it and tells the note.
#[test]
#[ignore = "needs Chromium, and a minute: see .ci/run"]
fn page_keeps_routes_for_another_day_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-routes", &walked::route_out(0.0, 0.1)) else { return };
    let kept = folder.join("routes");
    let server = keeping(&kept);
    let url = server.invitation().urls[0].clone();
    let phone = browser.open(&url, [390, 844]);
    browser.scheme(&phone, "light");
    wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
    wait(&mut browser, &phone, "No route has been recorded yet.", "#routes-none", 5.0);
    browser.click(&phone, "#take");
    wait(&mut browser, &phone, "Record", "#main", 20.0);
    accessible(&mut browser, &phone, "before a route, light");
    settle();
    browser.click(&phone, "#main");
    wait(&mut browser, &phone, "Stop recording", "#main", 10.0);
    wait(&mut browser, &phone, " m", "#main .more", 10.0);
    accessible(&mut browser, &phone, "recording, light");
    // Far enough that on the other day the first words are over when the note is passed.
    std::thread::sleep(Duration::from_secs(8));
    browser.picture(&phone, &folder.join("phone-recording-light.png"));
    browser.key(&phone, "n");
    wait(&mut browser, &phone, "What is here?", "#noting", 5.0);
    // The focus is in the field: letters are text there and no commands.
    browser.eval(&phone, "document.querySelector('#noting-text').focus()");
    browser.write(&phone, "glass door");
    browser.click(&phone, "[name=side][value=left]");
    accessible(&mut browser, &phone, "a note, light");
    browser.picture(&phone, &folder.join("phone-note-light.png"));
    browser.click(&phone, "#noting [type=submit]");
    wait(&mut browser, &phone, "Noted: glass door on the left.", "#log", 5.0);
    std::thread::sleep(Duration::from_secs(6));
    browser.click(&phone, "#main");
    wait(&mut browser, &phone, "Recording has ended", "#log", 5.0);
    wait(&mut browser, &phone, "Guide home", "#main", 5.0);
    wait(&mut browser, &phone, "Route 1", "#route-list", 5.0);
    browser.click(&phone, "[data-route='rename 1']");
    browser.write(&phone, "to the kitchen");
    accessible(&mut browser, &phone, "a name, light");
    browser.click(&phone, "#rename [type=submit]");
    wait(&mut browser, &phone, "Route 1, to the kitchen, ", "#route-list", 5.0);
    wait(&mut browser, &phone, " metres, today", "#route-list", 1.0);
    drop(server);

    // Another start of the program.
    let server = keeping(&kept);
    let url = server.invitation().urls[0].clone();
    let phone = browser.open(&url, [390, 844]);
    browser.scheme(&phone, "light");
    wait(&mut browser, &phone, "Route 1, to the kitchen, ", "#route-list", 10.0);
    browser.click(&phone, "#take");
    wait(&mut browser, &phone, "You are in control", "#control", 5.0);
    wait(&mut browser, &phone, "Record", "#main", 10.0);
    browser.key(&phone, "1");
    wait(&mut browser, &phone, "with one note. Loaded.", "#log", 10.0);
    wait(&mut browser, &phone, "Guide from start to end", "#main", 5.0);
    settle();
    browser.click(&phone, "#main");
    wait(&mut browser, &phone, "Stop guidance", "#main", 5.0);
    wait(&mut browser, &phone, "Guiding", "#state-now", 8.0);
    browser.picture(&phone, &folder.join("phone-guiding-light.png"));
    let desk = browser.open(&url, [1400, 900]);
    wait(&mut browser, &desk, "You watch", "#control", 10.0);
    wait(&mut browser, &phone, "Glass door on your left.", "#log", 40.0);
    std::thread::sleep(Duration::from_millis(500));
    for scheme in ["light", "dark"] {
        browser.scheme(&desk, scheme);
        // The map is drawn anew with the next one.
        std::thread::sleep(Duration::from_millis(1500));
        browser.picture(&desk, &folder.join(format!("desk-guiding-{scheme}.png")));
        accessible(&mut browser, &desk, &format!("watching, {scheme}"));
    }
    wait(&mut browser, &phone, "You have arrived", "#log", 40.0);
    println!("what the phone said:\n{}", browser.text(&phone, "#log"));
    // Deleting asks.
    for scheme in ["light", "dark"] {
        browser.scheme(&phone, scheme);
        browser.eval(&phone, "document.querySelector('#routes').scrollIntoView()");
        browser.picture(&phone, &folder.join(format!("phone-routes-{scheme}.png")));
        accessible(&mut browser, &phone, &format!("routes, {scheme}"));
    }
    browser.click(&phone, "[data-route='delete 1']");
    wait(&mut browser, &phone, "Route 1, to the kitchen", "#question-words", 5.0);
    accessible(&mut browser, &phone, "a question");
    browser.picture(&phone, &folder.join("phone-question-dark.png"));
    browser.click(&phone, "#question-no");
    wait(&mut browser, &phone, "Nothing was deleted.", "#log", 5.0);
    browser.click(&phone, "[data-route='delete 1']");
    wait(&mut browser, &phone, "Route 1", "#question-words", 5.0);
    browser.click(&phone, "#question-yes");
    wait(&mut browser, &phone, "is deleted.", "#log", 5.0);
    assert!(!kept.join("route-0001.route").exists());
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}
