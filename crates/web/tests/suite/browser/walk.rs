//! A walk out and home again, over web sockets and without.

use crate::browser::cdp::{Browser, HEARD};
use crate::browser::session::{OUT_S, accessible, emptied, pictures, route_out, started, wait};
use crate::walked::{RATE_HZ, camera};
use cairn_engine::{Config, Engine, Host, Runner, SensorMode};
use cairn_sensor::{FramePacket, Rig, Stamp};
use cairn_session::{Command, Event, Session, SessionConfig};
use cairn_web::{CameraSource, ServeConfig, Server};
use std::time::{Duration, Instant};

/// The same walk without a browser: checks that the engine alone achieves what the browser test needs from it.
#[test]
fn mono_session_returns_along_its_own_pictures() {
    let out = route_out();
    let rig = Rig::mono(camera());
    let engine =
        Engine::new(&rig, SensorMode::Mono, RATE_HZ, Runner::Lockstep, &Config::default(), &Host::bare())
            .unwrap();
    let config = SessionConfig { folder: emptied("browser-plain"), ..SessionConfig::default() };
    let mut session = Session::new(engine, config);
    let mut said = Vec::new();
    for (k, picture) in out.iter().chain(out.iter().rev()).enumerate() {
        let stamp = Stamp::from_seconds(k as f64 / RATE_HZ);
        session.on_packet(&FramePacket { stamp, ..picture.clone() }).unwrap();
        if k == 1 {
            session.command(&Command::Record).unwrap();
        }
        if k == out.len() {
            session.command(&Command::Stop).unwrap();
            session.command(&Command::parse("guide back").unwrap()).unwrap();
        }
        said.extend(session.events().into_iter().filter_map(|e| match e {
            Event::Said(s) => Some(format!("{:5.1}  {}", s.t_s, s.text)),
            Event::Sound(_) => None,
        }));
    }
    let said = said.join("\n");
    assert!(session.has_arrived(), "{said}");
    assert!(said.contains("cannot measure distances") && !said.contains("metre"), "{said}");
    assert!(said.contains("Turn ") && !said.contains("lost"), "{said}");
    println!("{said}");
}

#[test]
#[ignore = "needs Chromium, and a minute: see .ci/run"]
fn page_records_and_guides_home_in_a_browser() {
    let Some((folder, mut browser)) = started("browser", &route_out()) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: Some(Box::new(Rig::mono(camera()))) };
    let keep = Some(folder.join("data"));
    let server = Server::start(ServeConfig { session, keep, ..ServeConfig::new(camera) });
    let server = server.unwrap();
    let url = server.invitation().urls[0].clone();

    // A desktop watches, a phone walks.
    let desk = browser.open(&url, [1400, 900]);
    wait(&mut browser, &desk, "Ready. ", "#control", 20.0);
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
    accessible(&mut browser, &phone, "before the walk");
    pictures(&mut browser, &phone, &folder.join("phone-before"));
    browser.front(&phone);
    browser.click(&phone, "#camera");
    let began = Instant::now();
    wait(&mut browser, &phone, "You are in control", "#control", 20.0);
    // The desktop connected first, and gains nothing by that.
    wait(&mut browser, &desk, "You watch", "#control", 20.0);
    wait(&mut browser, &phone, "This camera", "#own figcaption", 20.0);
    wait(&mut browser, &phone, ".", "#s-tracking", 10.0);
    browser.key(&phone, "r");
    wait(&mut browser, &phone, "Recording", "#log", 10.0);
    wait(&mut browser, &phone, "I can see well.", "#s-tracking", 12.0);
    wait(&mut browser, &phone, "Recording.", "#state-now", 5.0);
    wait(&mut browser, &phone, " s old", "#age-now", 5.0);
    pictures(&mut browser, &phone, &folder.join("phone-recording"));
    while began.elapsed().as_secs_f64() < OUT_S {
        std::thread::sleep(Duration::from_millis(50));
    }
    browser.key(&phone, "s");
    wait(&mut browser, &phone, "Recording has ended", "#log", 5.0);
    // From now on the phone is known by its token and this route.
    wait(&mut browser, &phone, "1 route", "#routes-count", 5.0);
    let known = std::fs::read_to_string(folder.join("data/phones.json")).unwrap();
    let token = browser.eval(&phone, "JSON.parse(localStorage.getItem('cairn-settings')).phone");
    assert!(known.contains(token.as_str().unwrap()) && known.contains("\"route\":[1,null]"), "{known}");
    browser.click(&phone, "[data-command='guide back']");
    wait(&mut browser, &phone, "back,", "#s-guiding", 8.0);
    wait(&mut browser, &phone, "Guiding", "#state-now", 8.0);
    // On a machine too busy to process every image, the walker is told to stop and passes a second time. Screenshots and axe-core
    // keep it busy: the first turn comes before them.
    wait(&mut browser, &phone, "Turn ", "#log", 3.0 * OUT_S);
    pictures(&mut browser, &phone, &folder.join("phone-guiding"));
    pictures(&mut browser, &desk, &folder.join("desk-guiding"));
    accessible(&mut browser, &phone, "under guidance");
    accessible(&mut browser, &desk, "watching");
    wait(&mut browser, &phone, "You have arrived", "#log", 3.0 * OUT_S + 15.0);
    let heard = browser.text(&phone, "#log");
    println!("what the phone said:\n{heard}");
    assert!(!heard.contains("metre"), "the scale is unknown, so no distance may be said:\n{heard}");
    // Who was told to stop may have passed the turn meanwhile; then they are turned to where the route goes on.
    let was_stopped = heard.contains("The pictures come too late");
    assert!(was_stopped || heard.contains("now."), "the turn was not announced in time:\n{heard}");
    // The desktop got the same messages.
    wait(&mut browser, &desk, "You have arrived", "#log", 5.0);
    assert!(browser.drawn(&desk, "#map") && browser.drawn(&desk, "#picture"), "map or picture is empty");

    // The phone's page closes while it records: the desktop is informed, and the route is on disk.
    browser.key(&phone, "r");
    wait(&mut browser, &phone, "length not known", "#s-recording", 5.0);
    std::thread::sleep(Duration::from_secs(3));
    browser.close(&phone);
    wait(&mut browser, &desk, "No picture from the camera. Stand still.", "#log", 5.0);
    wait(&mut browser, &desk, "is away. I wait", "#control", 5.0);
    let route = cairn_guide::Route::load(&folder.join("routes/route-0002.route")).unwrap();
    assert!(route.points.len() > 3, "{} points", route.points.len());
    // Another tab does not get the walk by connecting; it asks first, takes over, and the recording continues.
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "I wait", "#control", 10.0);
    browser.click(&phone, "#take");
    wait(&mut browser, &phone, "Take control?", "#ask", 5.0);
    accessible(&mut browser, &phone, "asking");
    pictures(&mut browser, &phone, &folder.join("phone-asking"));
    browser.click(&phone, "#over");
    wait(&mut browser, &phone, "You are in control", "#control", 5.0);
    browser.click(&phone, "#camera");
    wait(&mut browser, &phone, "The picture is back.", "#log", 15.0);
    // The page is reloaded and gets its walk back by itself.
    browser.reload(&phone);
    wait(&mut browser, &phone, "You are in control", "#control", 10.0);
    browser.click(&phone, "#camera");
    wait(&mut browser, &phone, ".", "#s-tracking", 10.0);
    browser.key(&phone, "s");
    wait(&mut browser, &phone, "Recording has ended", "#log", 5.0);
    wait(&mut browser, &phone, "2 routes", "#routes-count", 5.0);
    // The server stops: the page itself says so.
    drop(server);
    wait(&mut browser, &phone, "Stop. The connection is lost.", "#log", 5.0);
    wait(&mut browser, &phone, "Stop. The connection is lost.", "#state-now", 1.0);
    wait(&mut browser, &phone, "not known without a connection", "#s-tracking", 1.0);
    let enabled = "[...document.querySelectorAll('[data-route], [data-command]')]
        .filter((button) => button.getAttribute('aria-disabled') !== 'true').length";
    assert_eq!(browser.eval(&phone, enabled), 0, "buttons that do nothing without a connection look enabled");
    pictures(&mut browser, &phone, &folder.join("phone-lost"));
    accessible(&mut browser, &phone, "without a connection");
    std::thread::sleep(Duration::from_secs(4));
    let heard = browser.text(&phone, "#log");
    assert!(heard.matches("Stop. The connection is lost.").count() >= 2, "stop is not repeated:\n{heard}");
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}

/// A browser that refuses web sockets, as Safari on a phone that does not trust the certificate.
const REFUSES: &str = "window.WebSocket = class {
    constructor() { this.readyState = 0; setTimeout(() => { this.readyState = 3; this.onerror?.(); this.onclose?.(); }, 5); }
    close() {}
    send() { throw new Error('not open'); }
};";

/// The phone's page goes on with plain requests: pictures up, status, words and map down, the same rules.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_without_web_sockets_walks_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-requests", &route_out()) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: Some(Box::new(Rig::mono(camera()))) };
    let server = Server::start(ServeConfig {
        authority: true,
        keep: Some(folder.join("data")),
        session,
        ..ServeConfig::new(camera)
    })
    .unwrap();
    let url = server.invitation().urls[0].clone();
    let phone = browser.open_after(&url, [390, 844], &format!("{HEARD}{REFUSES}"));
    wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
    wait(&mut browser, &phone, "Connected by the slower way", "#link", 5.0);
    let fingerprint = server.authority().unwrap().fingerprint();
    wait(&mut browser, &phone, &fingerprint, "#trust-compare", 1.0);
    assert_eq!(browser.eval(&phone, "document.getElementById('trust').open"), true);
    let steps = browser.eval(
        &phone,
        "(() => { const said = []; speechSynthesis.speak = (u) => said.push(u.text); document.getElementById('trust-say').click(); \
         return said.join(' '); })()",
    );
    assert!(steps.as_str().unwrap().contains("1. Get the certificate. 2. Open Settings"), "{steps}");
    for scheme in ["light", "dark"] {
        browser.scheme(&phone, scheme);
        browser.eval(&phone, "scrollTo(0, 0)");
        browser.picture(&phone, &folder.join(format!("phone-before-{scheme}.png")));
        browser.eval(&phone, "document.getElementById('trust').scrollIntoView()");
        browser.picture(&phone, &folder.join(format!("phone-trust-{scheme}.png")));
        accessible(&mut browser, &phone, &format!("steps to trust, {scheme}"));
    }
    browser.eval(&phone, "scrollTo(0, 0)");
    browser.click(&phone, "#camera");
    wait(&mut browser, &phone, "You are in control", "#control", 20.0);
    wait(&mut browser, &phone, ".", "#s-tracking", 10.0);
    browser.key(&phone, "r");
    wait(&mut browser, &phone, "Recording", "#log", 10.0);
    wait(&mut browser, &phone, "I can see well.", "#s-tracking", 20.0);
    wait(&mut browser, &phone, "A map of", "#map-words", 10.0);
    wait(&mut browser, &phone, " s old", "#age-now", 5.0);
    let frames = |browser: &mut Browser| {
        browser.eval(&phone, "Number(document.querySelector('#s-tracking').dataset.frames)").as_f64().unwrap()
    };
    let (before, began) = (frames(&mut browser), Instant::now());
    std::thread::sleep(Duration::from_secs(4));
    let rate = (frames(&mut browser) - before) / began.elapsed().as_secs_f64();
    println!("{rate:.1} pictures a second by requests");
    assert!(rate > 2.0, "{rate} pictures a second");
    browser.key(&phone, "s");
    wait(&mut browser, &phone, "Recording has ended", "#log", 5.0);
    // Another screen, with a web socket, watches; this page takes over, and the phone stops.
    let desk = browser.open(&url, [1400, 900]);
    wait(&mut browser, &desk, "You watch", "#control", 20.0);
    assert!(!browser.text(&desk, "#link").contains("slower"));
    browser.eval(&desk, "document.getElementById('trust').open = true");
    for scheme in ["light", "dark"] {
        browser.scheme(&desk, scheme);
        std::thread::sleep(Duration::from_millis(1500));
        browser.picture(&desk, &folder.join(format!("desk-{scheme}.png")));
        accessible(&mut browser, &desk, &format!("desk with the steps, {scheme}"));
    }
    drop(server);
    wait(&mut browser, &phone, "Stop. The connection is lost.", "#log", 6.0);
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}
