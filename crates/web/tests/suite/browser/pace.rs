//! The pace at which the page sends its images.

use crate::browser::session::{route_out, started};
use crate::paced;
use cairn_session::SessionConfig;
use cairn_web::{CameraSource, ServeConfig, Server};

/// The program that stands for the page in other tests paces its images as the page does.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_paces_its_images_in_a_browser_as_in_the_other_tests() {
    let Some((folder, mut browser)) = started("browser-pace", &route_out()[..2]) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: None };
    let server = Server::start(ServeConfig { session, ..ServeConfig::new(camera) }).unwrap();
    let tab = browser.open(&server.invitation().urls[0], [390, 844]);
    let network =
        |trip, rate| paced::Network { lasts: 8000, trip, rate, connections: 1, lost: 0, repair: 250.0 };
    let several = |trip, rate, lost| paced::Network { connections: 3, lost, ..network(trip, rate) };
    let paced = paced::over(&[
        network(30, 500.0),
        network(200, 125.0),
        network(350, 60.0),
        network(100, 25.0),
        network(60, 250.0),
        several(100, 125.0, 0),
        several(200, 125.0, 7),
        several(50, 25.0, 3),
        several(350, 500.0, 5),
    ]);
    let script = r#"(async () => {
        const { Pace } = await import('/pace.js');
        const [pace, decided, on] = [new Pace(), [], []];
        const told = {
            trip: (trip) => { pace.trip = trip; },
            sent: (now, stamp, bytes) => on.push(pace.sent(now, stamp, bytes)),
            reset: (connections) => pace.reset(connections),
            got: (now, stamp) => pace.got(now, stamp),
            ask: (now) => decided.push([pace.mayShoot(now), pace.level, pace.hasRoom]),
        };
        for (const [name, ...values] of TOLD) told[name](...values);
        return [decided, on];
    })()"#;
    let decided =
        browser.eval(&tab, &script.replace("TOLD", &serde_json::Value::from(paced.told).to_string()));
    assert_eq!(decided, serde_json::json!([paced.decided, paced.on]));
    assert!(paced.decided.iter().any(|(_, _, room)| *room), "some links have room for several connections");
    assert!(paced.on.contains(&2), "all connections were used");
    assert!(paced.decided.iter().any(|(_, level, _)| *level > 4), "the links were slow");
}

/// Images shrink on a slow link, and none is sent while it is not heard of two before it.
#[test]
#[ignore = "needs Chromium: see .ci/run"]
fn page_sends_smaller_images_over_a_slow_link_in_a_browser() {
    let Some((folder, mut browser)) = started("browser-link", &route_out()[..2]) else { return };
    let session = SessionConfig { folder: folder.join("routes"), ..SessionConfig::default() };
    let camera = CameraSource::Page { rig: None };
    let server = Server::start(ServeConfig { session, ..ServeConfig::new(camera) }).unwrap();
    let tab = browser.open(&server.invitation().urls[0], [390, 844]);
    let paced = browser.eval(
        &tab,
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
}
