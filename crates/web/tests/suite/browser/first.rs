//! The first minutes with a phone: pairing by six digits, and the main button whichever way the phone is held.

use crate::browser::cdp::HEARD;
use crate::browser::session::{accessible, keeping, pictures, route_out, settle, started, wait};
use cairn_session::SessionConfig;
use cairn_web::{CameraSource, ServeConfig, Server};
use std::sync::{Arc, Mutex};

/// Opened without the key: the digits that are said let the phone in, and the address and the browser keep the key.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_is_paired_by_six_digits_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-pairing", &route_out()[..2]) else { return };
    let said = Arc::new(Mutex::new(String::new()));
    let heard = said.clone();
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let server = Server::start(ServeConfig {
        aloud: Arc::new(move |_, text| text.clone_into(&mut heard.lock().unwrap())),
        session,
        ..ServeConfig::new(CameraSource::Page { rig: None })
    })
    .unwrap();
    let url = server.invitation().urls[0].split('#').next().unwrap().to_owned();
    let phone = browser.open_after(
        &url,
        [390, 844],
        &format!("{HEARD}speechSynthesis.speak = (u) => {{ window.spoken = u.text; }};"),
    );
    wait(&mut browser, &phone, "The computer says six digits now", "#pairing[open] #pair-words", 20.0);
    accessible(&mut browser, &phone, "pairing");
    pictures(&mut browser, &phone, &folder.join("phone-pairing"));
    let digits: String = said.lock().unwrap().chars().filter(char::is_ascii_digit).collect();
    assert_eq!(digits.len(), 6);
    let wrong = if digits == "111111" { "222222" } else { "111111" };
    // The focus is in the field.
    browser.write(&phone, wrong);
    browser.click(&phone, "#pairing [type=submit]");
    wait(&mut browser, &phone, "That is not the code.", "#pair-words", 5.0);
    assert!(browser.eval(&phone, "window.spoken").as_str().unwrap().starts_with("That is not the code."));
    browser.write(&phone, &digits);
    browser.click(&phone, "#pairing [type=submit]");
    wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
    assert_eq!(browser.eval(&phone, "location.hash"), format!("#k={}", server.invitation().token));
    assert_eq!(browser.eval(&phone, "document.querySelector('#pairing').open"), false);
    // The browser keeps the key too.
    let again = browser.open(&url, [390, 844]);
    wait(&mut browser, &again, "Ready. ", "#control", 20.0);
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}

#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_shows_its_main_button_however_the_phone_is_held_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-held", &route_out()[..2]) else { return };
    let server = keeping(&folder.join("routes"));
    let url = server.invitation().urls[0].clone();
    // How far a button reaches below what is seen.
    let below = |button: &str| {
        format!(
            "Math.max(0, document.querySelector('{button}').getBoundingClientRect().bottom - innerHeight)"
        )
    };
    let mut tabs = Vec::new();
    for size in [[390, 844], [844, 390], [740, 360]] {
        let phone = browser.open(&url, size);
        wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
        assert_eq!(browser.eval(&phone, &below("#take")), 0, "{size:?} before");
        tabs.push((size, phone));
    }
    browser.click(&tabs[0].1, "#take");
    wait(&mut browser, &tabs[0].1, "Record", "#main", 20.0);
    settle();
    browser.click(&tabs[0].1, "#main");
    for (size, phone) in &tabs {
        browser.front(phone);
        if browser.text(phone, "#control").contains("You watch") {
            browser.click(phone, "#take");
            browser.click(phone, "#over");
        }
        wait(&mut browser, phone, "Stop recording", "#main", 10.0);
        assert_eq!(browser.eval(phone, &below("#main")), 0, "{size:?} recording");
        // Nothing of it is cut off on the right, also at twice the size of the text.
        for zoom in [100, 200] {
            browser.eval(phone, &format!("document.documentElement.style.fontSize = '{zoom}%'"));
            let wide = "document.documentElement.scrollWidth - innerWidth";
            assert!(browser.eval(phone, wide).as_f64().unwrap() <= 0.0, "{size:?} at {zoom} %");
        }
        browser.eval(phone, "document.documentElement.style.fontSize = ''");
        accessible(&mut browser, phone, &format!("{size:?}"));
        if *size == [844, 390] {
            pictures(&mut browser, phone, &folder.join("phone-across"));
        }
    }
    // The map is not there for screen readers; keys move it once its help is asked for.
    let (_, phone) = &tabs[0];
    assert_eq!(browser.eval(phone, "document.querySelector('#map').ariaHidden"), "true");
    assert_eq!(browser.eval(phone, "document.querySelector('#map-help').hidden"), true);
    browser.click(phone, "#map-how");
    assert_eq!(
        browser.eval(phone, "[document.querySelector('#map-help').hidden, document.activeElement.id].join()"),
        "false,map"
    );
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}
