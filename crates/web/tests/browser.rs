//! The page in a real browser: headless Chromium, whose camera shows a simulated walk. Records, returns with the camera
//! facing back, reads the directions; axe-core reports nothing; screenshots are left in the target folder.
//!
//! Needs Chromium (`CHROMIUM`, else `chromium` on the path) and for the accessibility part axe-core (`AXE_JS`, its
//! `axe.min.js`); a missing part is reported as skipped. Run by `.ci/run` and by
//! `cargo test --release -p cairn-web --test browser -- --ignored --nocapture`.

mod cdp;
#[path = "network/pace.rs"]
mod pace;
mod paced;
mod seen;
mod walked;

use cairn_engine::{Config, Engine, Runner, SensorMode};
use cairn_sensor::{FramePacket, Rig, Source, Stamp};
use cairn_session::{Command, Event, Session, SessionConfig};
use cairn_sim::{SimConfig, SimSource};
use cairn_sources::Paced;
use cairn_web::{CameraSource, ServeConfig, Server};
use cdp::{Browser, Tab};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use walked::{RATE_HZ, camera};

/// Seconds of the walk before the camera starts, and of the way out, with a corner in its middle.
const START_S: f64 = 8.5;
const OUT_S: f64 = 16.0;

/// The images of the way out.
fn route_out() -> Vec<FramePacket> {
    walked::route_out(START_S, OUT_S)
}

/// The way out, then the same in reverse: the view of a camera facing back on the way home. The file is played in a
/// loop, and its end matches its beginning.
fn write_video(path: &Path, out: &[FramePacket]) {
    let (w, h) = (camera().width, camera().height);
    let mut file = BufWriter::new(std::fs::File::create(path).unwrap());
    writeln!(file, "YUV4MPEG2 W{w} H{h} F{RATE_HZ}:1 Ip A1:1 C420jpeg").unwrap();
    let colourless = vec![128; w * h / 2];
    for packet in out.iter().chain(out.iter().rev()) {
        file.write_all(b"FRAME\n").unwrap();
        file.write_all(packet.images[0].data()).unwrap();
        file.write_all(&colourless).unwrap();
    }
    file.flush().unwrap();
}

/// An empty folder of this name for what a test writes.
fn emptied(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A folder of this name, and a browser whose camera shows these frames; `None`, and "skipped" is said, without Chromium.
fn started(name: &str, frames: &[FramePacket]) -> Option<(PathBuf, Browser)> {
    let folder = emptied(name);
    let video = folder.join("walk.y4m");
    write_video(&video, frames);
    let browser = Browser::start(&folder, &video);
    if browser.is_none() {
        println!("skipped: Chromium is not installed (Debian: apt install chromium)");
    }
    Some((folder, browser?))
}

/// The program that stands for the page in other tests paces its images as the page does.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_paces_its_images_in_a_browser_as_in_the_other_tests() {
    let Some((folder, mut browser)) = started("browser-pace", &route_out()[..2]) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: None };
    let server = Server::start(ServeConfig { session, ..ServeConfig::new(camera) }).unwrap();
    let tab = browser.open(&server.invitation().urls[0], [390, 844]);
    let network = |trip, rate| paced::Network { lasts: 8000, trip, rate };
    let paced = paced::over(&[
        network(30, 500.0),
        network(200, 125.0),
        network(350, 60.0),
        network(100, 25.0),
        network(60, 250.0),
    ]);
    let script = r#"(async () => {
        const { Pace } = await import('/pace.js');
        const [pace, decided] = [new Pace(), []];
        const on = {
            trip: (trip) => { pace.trip = trip; },
            sent: (now, stamp, bytes) => pace.sent(now, stamp, bytes),
            got: (now, stamp) => pace.got(now, stamp),
            ask: (now) => decided.push([pace.mayShoot(now), pace.level]),
        };
        for (const [name, ...values] of TOLD) on[name](...values);
        return decided;
    })()"#;
    let decided =
        browser.eval(&tab, &script.replace("TOLD", &serde_json::Value::from(paced.told).to_string()));
    assert_eq!(decided, serde_json::json!(paced.decided));
    assert!(paced.decided.iter().any(|(_, level)| *level > 4), "the links were slow");
}

/// The same walk without a browser: checks that the engine alone achieves what the browser test needs from it.
#[test]
fn mono_session_returns_along_its_own_pictures() {
    let out = route_out();
    let rig = Rig::mono(camera());
    let engine = Engine::new(&rig, SensorMode::Mono, RATE_HZ, Runner::Lockstep, &Config::default()).unwrap();
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

/// Pictures of a page in both schemes: `NAME-light.png` and `NAME-dark.png`.
fn pictures(browser: &mut Browser, tab: &Tab, name: &Path) {
    for scheme in ["dark", "light"] {
        browser.scheme(tab, scheme);
        browser.picture(tab, Path::new(&format!("{}-{scheme}.png", name.display())));
    }
}

#[test]
#[ignore = "needs Chromium, and a minute: see .ci/run"]
fn page_records_and_guides_home_in_a_browser() {
    let Some((folder, mut browser)) = started("browser", &route_out()) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: Some(Box::new(Rig::mono(camera()))) };
    let server = Server::start(ServeConfig { session, ..ServeConfig::new(camera) });
    let server = server.unwrap();
    let url = server.invitation().urls[0].clone();

    // A desktop watches, a phone walks.
    let desk = browser.open(&url, [1400, 900]);
    wait(&mut browser, &desk, "Nobody controls this walk", "#control", 20.0);
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "Nobody controls this walk", "#control", 20.0);
    accessible(&mut browser, &phone, "before the walk");
    pictures(&mut browser, &phone, &folder.join("phone-before"));
    browser.front(&phone);
    browser.click(&phone, "#camera");
    let began = Instant::now();
    wait(&mut browser, &phone, "You control this walk", "#control", 20.0);
    // The desktop connected first, and gains nothing by that.
    wait(&mut browser, &desk, "you watch", "#control", 20.0);
    wait(&mut browser, &phone, "This camera", "#own figcaption", 20.0);
    wait(&mut browser, &phone, "frames", "#s-tracking", 10.0);
    browser.key(&phone, "r");
    wait(&mut browser, &phone, "Recording", "#log", 10.0);
    wait(&mut browser, &phone, "I know where we are.", "#s-tracking", 12.0);
    wait(&mut browser, &phone, "Recording.", "#state-now", 5.0);
    wait(&mut browser, &phone, " s old", "#age-now", 5.0);
    pictures(&mut browser, &phone, &folder.join("phone-recording"));
    while began.elapsed().as_secs_f64() < OUT_S {
        std::thread::sleep(Duration::from_millis(50));
    }
    browser.key(&phone, "s");
    wait(&mut browser, &phone, "Recording has ended", "#log", 5.0);
    browser.click(&phone, "[data-command='guide back']");
    wait(&mut browser, &phone, "back,", "#s-guiding", 8.0);
    wait(&mut browser, &phone, "Guiding", "#state-now", 8.0);
    std::thread::sleep(Duration::from_secs(3));
    pictures(&mut browser, &phone, &folder.join("phone-guiding"));
    pictures(&mut browser, &desk, &folder.join("desk-guiding"));
    accessible(&mut browser, &phone, "under guidance");
    accessible(&mut browser, &desk, "watching");
    // On a machine too busy to process every image, the walker is told to stop and passes a second time.
    wait(&mut browser, &phone, "You have arrived", "#log", 3.0 * OUT_S + 15.0);
    let heard = browser.text(&phone, "#log");
    println!("what the phone said:\n{heard}");
    assert!(!heard.contains("metre"), "the scale is unknown, so no distance may be said:\n{heard}");
    assert!(heard.contains("Turn ") && heard.contains("now."), "no direction was given:\n{heard}");
    // The desktop got the same messages.
    wait(&mut browser, &desk, "You have arrived", "#log", 5.0);
    assert!(browser.drawn(&desk, "#map") && browser.drawn(&desk, "#picture"), "map or picture is empty");

    // The phone's page closes while it records: the desktop is informed, and the route is on disk.
    browser.key(&phone, "r");
    wait(&mut browser, &phone, "0 units", "#s-recording", 5.0);
    std::thread::sleep(Duration::from_secs(3));
    browser.close(&phone);
    wait(&mut browser, &desk, "No picture from the camera. Stand still.", "#log", 5.0);
    wait(&mut browser, &desk, "is away; the walk waits", "#control", 5.0);
    let route = cairn_guide::Route::load(&folder.join("routes/route-0002.route")).unwrap();
    assert!(route.points.len() > 3, "{} points", route.points.len());
    // Another tab does not get the walk by connecting; it asks first, takes over, and the recording continues.
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "the walk waits", "#control", 10.0);
    browser.click(&phone, "#take");
    wait(&mut browser, &phone, "Take over this walk?", "#ask", 5.0);
    accessible(&mut browser, &phone, "asking");
    pictures(&mut browser, &phone, &folder.join("phone-asking"));
    browser.click(&phone, "#over");
    wait(&mut browser, &phone, "You control this walk", "#control", 5.0);
    browser.click(&phone, "#camera");
    wait(&mut browser, &phone, "The picture is back.", "#log", 15.0);
    // The page is reloaded and gets its walk back by itself.
    browser.reload(&phone);
    wait(&mut browser, &phone, "You control this walk", "#control", 10.0);
    browser.click(&phone, "#camera");
    wait(&mut browser, &phone, "frames", "#s-tracking", 10.0);
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

/// A walk through the building, played in real time: its lengths are metres.
fn building() -> CameraSource {
    let open = || {
        let config = SimConfig::parse("sim:demo?sensor=rgbd&rate=10&resolution=480x360")?;
        let source: Box<dyn Source> = Box::new(Paced::new(Box::new(SimSource::new(&config)?)));
        Ok((source, SensorMode::Rgbd, false))
    };
    CameraSource::Source { name: "sim:demo".into(), open: Box::new(open) }
}

fn keeping(folder: &Path) -> Server {
    Server::start(ServeConfig { routes: Some(folder.to_owned()), ..ServeConfig::new(building()) }).unwrap()
}

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
    wait(&mut browser, &phone, "Nobody controls this walk", "#control", 20.0);
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
    wait(&mut browser, &phone, "You control this walk", "#control", 5.0);
    wait(&mut browser, &phone, "Record", "#main", 10.0);
    browser.key(&phone, "1");
    wait(&mut browser, &phone, "with one note. Loaded.", "#log", 10.0);
    wait(&mut browser, &phone, "Guide from start to end", "#main", 5.0);
    settle();
    browser.click(&phone, "#main");
    wait(&mut browser, &phone, "Halt guidance", "#main", 5.0);
    wait(&mut browser, &phone, "Guiding", "#state-now", 8.0);
    browser.picture(&phone, &folder.join("phone-guiding-light.png"));
    let desk = browser.open(&url, [1400, 900]);
    wait(&mut browser, &desk, "you watch", "#control", 10.0);
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

/// The main button ignores a press within half a second after its meaning changed.
fn settle() {
    std::thread::sleep(Duration::from_millis(600));
}

/// The page's own parts: speech that never floods and is given once and by one voice, settings that are stored,
/// images that shrink on a slow link.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_speaks_once_and_keeps_its_settings_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-parts", &route_out()[..2]) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: None };
    let server = Server::start(ServeConfig { session, ..ServeConfig::new(camera) }).unwrap();
    let url = server.invitation().urls[0].clone();
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "Nobody controls this walk", "#control", 20.0);
    let spoken = browser.eval(
        &phone,
        r#"(async () => {
            const { Senses } = await import('/senses.js');
            const heard = [];
            let live = null;
            speechSynthesis.speak = (u) => { if (u.text) { heard.push(u.text); live = u; } };
            speechSynthesis.cancel = () => {};
            const region = () => document.createElement('div');
            const [polite, urgent] = [region(), region()];
            const senses = new Senses({ polite, urgent });
            const pause = (ms) => new Promise((done) => setTimeout(done, ms));
            for (let k = 0; k < 74; k += 1) senses.say({ text: 'It is dark.', priority: 1, kind: 'dark' });
            const flood = heard.length;
            // A waiting line is dropped with its reason.
            senses.say({ text: 'The connection is lost.', priority: 1, kind: 'link' });
            senses.drop('link');
            live.onend();
            await pause(250);
            const dropped = heard.length;
            // One line waits, the newest.
            senses.say({ text: 'first', priority: 2 });
            senses.say({ text: 'second', priority: 2 });
            senses.say({ text: 'third', priority: 2 });
            live.onend();
            await pause(250);
            live.onend();
            await pause(250);
            // Stop is said at once, and silences waiting lines.
            senses.say({ text: 'fourth', priority: 2 });
            senses.say({ text: 'fifth', priority: 2 });
            senses.say({ text: 'Stop.', priority: 0 });
            live.onend();
            await pause(250);
            const byVoice = polite.textContent + urgent.textContent;
            senses.set('told', 'reader');
            const before = heard.length;
            senses.say({ text: 'Turn left now.', priority: 1 });
            return JSON.stringify({ heard, flood, dropped, byVoice, byReader: heard.length - before, urgent: urgent.textContent });
        })()"#,
    );
    let spoken: serde_json::Value = serde_json::from_str(spoken.as_str().unwrap()).unwrap();
    assert_eq!((&spoken["flood"], &spoken["dropped"]), (&1.into(), &1.into()), "{spoken}");
    assert_eq!(
        spoken["heard"],
        serde_json::json!(["It is dark.", "first", "third", "fourth", "Stop."]),
        "{spoken}"
    );
    assert_eq!((&spoken["byVoice"], &spoken["byReader"]), (&"".into(), &0.into()), "{spoken}");
    assert_eq!(spoken["urgent"], "Turn left now.", "{spoken}");
    // No other live region repeats the message.
    let live = "document.querySelectorAll('[aria-live], [role=status], [role=alert], output').length";
    assert_eq!(browser.eval(&phone, live), 2);

    let paced = browser.eval(
        &phone,
        r#"(async () => {
            const { Pace, LEVELS } = await import('/pace.js');
            const walk = (bytesPerMs, trip) => {
                const pace = new Pace();
                pace.trip = trip;
                let [now, most] = [0, 0];
                for (let k = 0; k < 60; k += 1) {
                    while (!pace.mayShoot(now)) now += 1;
                    const bytes = 60000 * LEVELS[pace.level][2];
                    pace.sent(now, now, bytes);
                    if (k === 0 && pace.mayShoot(now + 1000)) throw new Error('sent before the link is known');
                    const took = trip + bytes / bytesPerMs;
                    now += took;
                    pace.got(now, pace.last);
                    if (k > 10) most = Math.max(most, took - trip);
                }
                return [pace.side, Math.round(most), Math.round(now / 60)];
            };
            const behind = new Pace();
            behind.sent(0, 0, 1000);
            behind.got(50, 0);
            behind.sent(60, 60, 1000);
            if (!behind.mayShoot(200)) throw new Error('waits to hear of one that has arrived');
            behind.sent(200, 200, 1000);
            if (behind.mayShoot(9000)) throw new Error('sends on, though nothing is heard');
            return JSON.stringify([walk(5000, 20), walk(500, 50), walk(125, 50), walk(25, 50)]);
        })()"#,
    );
    println!("side, longest transfer ms, ms a picture at 40, 4, 1, 0.2 Mbit/s: {paced}");
    let paced: Vec<[f64; 3]> = serde_json::from_str(paced.as_str().unwrap()).unwrap();
    assert_eq!([paced[0][0], paced[3][0]], [640.0, 320.0]);
    assert!(paced[1][1] <= 90.0 && paced[2][1] <= 90.0, "{paced:?}");

    // Buttons of a headset are commands while they are turned on.
    let pressed = browser.eval(
        &phone,
        r#"(async () => {
            const { MediaButtons } = await import('/buttons.js');
            const [handlers, lines] = [{}, []];
            navigator.mediaSession.setActionHandler = (action, handler) => { handlers[action] = handler; };
            const media = new MediaButtons((line) => lines.push(line), (id) => id);
            media.set(true);
            await new Promise((done) => setTimeout(done, 300));
            const plays = !media.sound.paused && media.sound.duration;
            for (const action of ['pause', 'play', 'stop']) handlers[action]();
            media.set(false);
            return JSON.stringify([lines, plays, handlers.stop, media.sound.paused]);
        })()"#,
    );
    assert_eq!(pressed, r#"[["repeat","repeat","halt"],2,null,true]"#);

    // Settings are there again after a reload.
    browser.click(&phone, "[name=told][value=reader]");
    let set = |input: &str, value: &str| {
        format!(
            "document.getElementById('{input}').value = '{value}'; document.getElementById('{input}').dispatchEvent(new Event('change'));"
        )
    };
    browser.eval(
        &phone,
        &(set("speed", "240") + &set("unit", "steps") + &set("directions", "clock") + "sounds.click()"),
    );
    assert_eq!(browser.eval(&phone, "document.getElementById('step-line').hidden"), false);
    // Another language, at once and after a reload; plurals and decimals as the catalogue has them.
    let unfold = "document.querySelector('#commands details').open = true";
    browser.eval(&phone, unfold);
    let english = browser.text(&phone, "#commands");
    assert!(english.contains("Guide home G") && english.contains("Halt guidance H"), "{english}");
    browser.eval(&phone, &set("language", "de"));
    wait(&mut browser, &phone, "Niemand steuert diesen Gang", "#control", 5.0);
    browser.picture(&phone, &folder.join("phone-german.png"));
    browser.reload(&phone);
    wait(&mut browser, &phone, "Niemand steuert diesen Gang", "#control", 20.0);
    accessible(&mut browser, &phone, "in German");
    browser.eval(&phone, unfold);
    let german = browser.text(&phone, "#commands");
    assert!(german.contains("Heimführen G") && german.contains("Führung beenden H"), "{german}");
    let formatted = browser.eval(
        &phone,
        r#"(async () => {
            const { Words } = await import('/words.js');
            const w = await Words.in('de');
            const frames = (frames) => w.text('page-frames', { tracked: 1, frames, matches: 7 });
            return [frames(1), frames(3), w.text('page-age', { seconds: w.number(2.5, 1) })].join(' | ');
        })()"#,
    );
    assert_eq!(formatted, "1 von 1 Bild; 7 Treffer. | 1 von 3 Bildern; 7 Treffer. | Bild 2,5 s alt");
    let kept = "[document.querySelector('[name=told]:checked').value, speed.value, unit.value, directions.value, sounds.checked, language.value, document.documentElement.lang].join()";
    assert_eq!(browser.eval(&phone, kept), "reader,240,steps,clock,false,de,de");
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
    let phone = browser.open_after(&url, [390, 844], REFUSES);
    wait(&mut browser, &phone, "Nobody controls this walk", "#control", 20.0);
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
    wait(&mut browser, &phone, "You control this walk", "#control", 20.0);
    wait(&mut browser, &phone, "frames", "#s-tracking", 10.0);
    browser.key(&phone, "r");
    wait(&mut browser, &phone, "Recording", "#log", 10.0);
    wait(&mut browser, &phone, "I know where we are.", "#s-tracking", 20.0);
    wait(&mut browser, &phone, "A map of", "#map-words", 10.0);
    wait(&mut browser, &phone, " s old", "#age-now", 5.0);
    let frames = |browser: &mut Browser| {
        let text = browser.text(&phone, "#s-tracking");
        let words: Vec<&str> = text.split(' ').collect();
        let at = words.iter().position(|w| w.starts_with("frame")).unwrap();
        words[at - 1].parse::<f64>().unwrap()
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
    wait(&mut browser, &desk, "you watch", "#control", 20.0);
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

/// Waits until an element's text contains some words.
fn wait(browser: &mut Browser, tab: &Tab, words: &str, element: &str, seconds: f64) {
    let begin = Instant::now();
    loop {
        let text = browser.text(tab, element);
        if text.contains(words) {
            return;
        }
        let waited = begin.elapsed().as_secs_f64();
        assert!(
            waited < seconds,
            "{element} does not say \"{words}\" after {waited:.0} s but \"{text}\"; log:\n{}\n{}",
            browser.text(tab, "#log"),
            browser.text(tab, "#state")
        );
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Asserts that axe-core reports nothing.
fn accessible(browser: &mut Browser, tab: &Tab, when: &str) {
    let Some(axe) = std::env::var_os("AXE_JS").and_then(|p| std::fs::read_to_string(p).ok()) else {
        println!("skipped: axe-core is not there (AXE_JS), accessibility {when} is not checked");
        return;
    };
    let found = browser.axe(tab, &axe);
    assert_eq!(found, "[]", "axe-core {when}");
    println!("axe-core finds nothing {when}");
}
