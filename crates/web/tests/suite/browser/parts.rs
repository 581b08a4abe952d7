//! Parts of the page: speech, buttons of a headset, settings.

use crate::browser::session::{accessible, route_out, started, wait};
use cairn_session::SessionConfig;
use cairn_web::{CameraSource, ServeConfig, Server};

/// What to mind is there at the first start, is spoken, and is there no more once it was heard; then only for those who ask.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_says_what_to_mind_once_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-before", &route_out()[..2]) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let server =
        Server::start(ServeConfig { session, ..ServeConfig::new(CameraSource::Page { rig: None }) }).unwrap();
    let url = server.invitation().urls[0].clone();
    let is_open = "document.querySelector('#before').open";
    // It is asked first whether a screen reader speaks.
    let phone = browser.open_after(&url, [390, 844], "sessionStorage.length || localStorage.clear()");
    wait(&mut browser, &phone, "Do you use a screen reader?", "#reader[open]", 20.0);
    accessible(&mut browser, &phone, "the first question");
    browser.click(&phone, "#reader-no");
    wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
    assert!(browser.text(&phone, "#before").contains("beside your cane or your dog, not instead"));
    assert_eq!(browser.eval(&phone, is_open), true);
    accessible(&mut browser, &phone, "what to mind");
    browser.picture(&phone, &folder.join("phone-mind.png"));
    browser.eval(&phone, "speechSynthesis.speak = (u) => { if (u.text) document.title = u.text; }");
    // A key is no command while it is open.
    browser.key(&phone, "g");
    browser.click(&phone, "#before-say");
    wait(&mut browser, &phone, "I am not for streets.", "title", 5.0);
    browser.click(&phone, "#before-heard");
    assert_eq!(browser.eval(&phone, is_open), false);
    assert_eq!(browser.text(&phone, "#answer"), "");
    let again = browser.open(&url, [390, 844]);
    wait(&mut browser, &again, "Ready. ", "#control", 20.0);
    assert_eq!(browser.eval(&again, is_open), false);
    browser.click(&again, "#before-again");
    assert_eq!(browser.eval(&again, is_open), true);
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}

/// The page's own parts: speech that never floods and is given once and by one voice, settings that are stored.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_speaks_once_and_keeps_its_settings_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-parts", &route_out()[..2]) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: None };
    let server = Server::start(ServeConfig { session, ..ServeConfig::new(camera) }).unwrap();
    let url = server.invitation().urls[0].clone();
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "Ready. ", "#control", 20.0);
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
    assert!(english.contains("Guide home G") && english.contains("Stop guidance H"), "{english}");
    browser.eval(&phone, &set("language", "de"));
    wait(&mut browser, &phone, "Bereit. ", "#control", 5.0);
    browser.picture(&phone, &folder.join("phone-german.png"));
    browser.reload(&phone);
    wait(&mut browser, &phone, "Bereit. ", "#control", 20.0);
    accessible(&mut browser, &phone, "in German");
    browser.eval(&phone, unfold);
    let german = browser.text(&phone, "#commands");
    assert!(german.contains("Nach Hause führen G") && german.contains("Führung beenden H"), "{german}");
    let formatted = browser.eval(
        &phone,
        r#"(async () => {
            const { Words } = await import('/words.js');
            const w = await Words.in('de');
            const routes = (count) => w.text('page-routes-count', { count });
            return [routes(1), routes(3), w.text('page-age', { seconds: w.number(2.5, 1) })].join(' | ');
        })()"#,
    );
    assert_eq!(formatted, "1 Route | 3 Routen | Bild 2,5 s alt");
    let kept = "[document.querySelector('[name=told]:checked').value, speed.value, unit.value, directions.value, sounds.checked, language.value, document.documentElement.lang].join()";
    assert_eq!(browser.eval(&phone, kept), "reader,240,steps,clock,false,de,de");
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}
