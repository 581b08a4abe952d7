//! The page with the engine in it: from a plain server of files, then without any.

use crate::browser::cdp::{Browser, Tab, from_base64};
use crate::browser::session::{OUT_S, accessible, pictures, route_out, started, wait};
use crate::walked::camera;
use cairn_atlas::store::MapFile;
use cairn_guide::Route;
use std::io::{BufRead, BufReader, Write};
use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Files behind HTTP, as any host has them; ends when dropped.
struct Files {
    url: String,
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Files {
    fn serve(files: Vec<(String, Vec<u8>)>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}/", listener.local_addr().unwrap());
        let ends = Arc::new(AtomicBool::new(false));
        let ended = ends.clone();
        let thread = std::thread::spawn(move || {
            for stream in listener.incoming().take_while(|_| !ended.load(Ordering::Relaxed)) {
                // A browser opens connections that it does not use.
                let _ = stream.and_then(|stream| answer(stream, &files));
            }
        });
        Self { url, ends, thread: Some(thread) }
    }
}

impl Drop for Files {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        let place = self.url.trim_start_matches("http://").trim_end_matches('/');
        drop(TcpStream::connect(place));
        self.thread.take().unwrap().join().unwrap();
    }
}

fn answer(mut stream: TcpStream, files: &[(String, Vec<u8>)]) -> std::io::Result<()> {
    stream.set_read_timeout(Some(Duration::from_millis(500)))?;
    let mut line = String::new();
    let mut lines = BufReader::new(&stream);
    lines.read_line(&mut line)?;
    let path = line.split(' ').nth(1).unwrap_or_default().trim_start_matches('/').to_owned();
    while lines.read_line(&mut line)? > 2 {}
    let path = path.split('?').next().unwrap_or_default();
    let name = if path.is_empty() { "index.html" } else { path };
    let found = files.iter().find(|(n, _)| n == name);
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html",
        Some("css") => "text/css",
        Some("svg") => "image/svg+xml",
        Some("wasm") => "application/wasm",
        Some("json" | "webmanifest") => "application/json",
        _ => "text/javascript",
    };
    let (status, bytes) = found.map_or(("404 Not Found", &[][..]), |(_, bytes)| ("200 OK", &bytes[..]));
    write!(stream, "HTTP/1.0 {status}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\n\r\n", bytes.len())?;
    stream.write_all(bytes)
}

/// The modules of the engine and of the demo's walker, where they were built; "skipped" is said where they were not.
fn modules() -> Option<[Vec<u8>; 2]> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/wasm");
    let module = |name: &str| std::fs::read(folder.join(name)).ok();
    let modules = module("cairn.wasm").zip(module("walker.wasm"));
    if modules.is_none() {
        println!("skipped: the modules are not built (tools/build_wasm)");
    }
    modules.map(Into::into)
}

/// Opened, stored, the network cut: records, guides, is closed and killed, goes on; what it gives out are files of Cairn.
#[test]
#[ignore = "needs Chromium and the module of tools/build_wasm, and two minutes: see .ci/run"]
fn page_walks_alone_without_a_network_in_a_browser() {
    let Some([module, _]) = modules() else { return };
    let Some((folder, mut browser)) = started("browser-alone", &route_out()) else { return };
    let server = Files::serve(cairn_web::site(module, None).unwrap());
    let url = server.url.clone();
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "no picture leaves it", "#link", 60.0);
    wait(&mut browser, &phone, "no network is needed any more", "#link", 60.0);
    // Nothing comes from there any more.
    drop(server);
    assert!(TcpStream::connect(url.trim_start_matches("http://").trim_end_matches('/')).is_err());
    browser.reload(&phone);
    wait(&mut browser, &phone, "Ready. ", "#control", 60.0);
    accessible(&mut browser, &phone, "alone, before the walk");
    know_the_lens(&mut browser, &phone);

    record(&mut browser, &phone);
    browser.click(&phone, "[data-command='guide back']");
    wait(&mut browser, &phone, "back,", "#s-guiding", 8.0);
    wait(&mut browser, &phone, "Turn ", "#log", 3.0 * OUT_S);
    pictures(&mut browser, &phone, &folder.join("alone-guiding"));
    accessible(&mut browser, &phone, "alone, under guidance");
    wait(&mut browser, &phone, "You have arrived", "#log", 3.0 * OUT_S + 15.0);
    println!("what the phone said:\n{}", browser.text(&phone, "#log"));
    println!("its state:\n{}", browser.text(&phone, "#state"));
    wait(&mut browser, &phone, "A map of", "#map-words", 10.0);
    wait(&mut browser, &phone, "Route 1", "#route-list", 5.0);

    // Another day: the route is there before the camera, and is walked in its map.
    browser.reload(&phone);
    wait(&mut browser, &phone, "Route 1", "#route-list", 60.0);
    browser.click(&phone, "#camera");
    wait(&mut browser, &phone, ".", "#s-tracking", 30.0);
    browser.key(&phone, "1");
    wait(&mut browser, &phone, "Loaded.", "#log", 10.0);
    wait(&mut browser, &phone, "Guide from start to end", "#main", 3.0 * OUT_S);

    // The tab is killed while it records: what was recorded until then is a route.
    browser.key(&phone, "r");
    wait(&mut browser, &phone, "length not known", "#s-recording", 10.0);
    std::thread::sleep(Duration::from_secs(4));
    browser.close(&phone);
    let phone = browser.open(&url, [390, 844]);
    wait(&mut browser, &phone, "Route 2", "#route-list", 60.0);

    // A file that was cut off while it was written is none: the one before counts.
    let rubbish = "(async () => { const root = await navigator.storage.getDirectory(); \
        const kept = await root.getDirectoryHandle('cairn'); \
        const to = await (await kept.getFileHandle('999999~routes%2Froute-0001.route', { create: true })).createWritable(); \
        await to.write('{\"format\"'); await to.close(); })()";
    browser.eval(&phone, rubbish);
    browser.reload(&phone);
    wait(&mut browser, &phone, "Route 1", "#route-list", 60.0);
    give_out_and_take_in(&mut browser, &phone, &folder);
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}

/// One press, and a simulated walker goes out and comes back by the words; nothing of it is kept, nor in the way of a walk.
#[test]
#[ignore = "needs Chromium and the modules of tools/build_wasm, and two minutes: see .ci/run"]
fn demo_is_walked_in_a_browser() {
    let Some([module, walker]) = modules() else { return };
    let Some((folder, mut browser)) = started("browser-demo", &route_out()) else { return };
    let server = Files::serve(cairn_web::site(module, Some(walker)).unwrap());
    let page = browser.open(&server.url, [390, 844]);
    wait(&mut browser, &page, "Watch a demo", "#demo", 60.0);
    let demo = browser.open(&format!("{}?demo", server.url), [390, 844]);
    wait(&mut browser, &demo, "Press Start the demo", "#control", 60.0);
    accessible(&mut browser, &demo, "demo, before it starts");
    browser.click(&demo, "#camera");
    wait(&mut browser, &demo, "Recording", "#log", 60.0);
    wait(&mut browser, &demo, "Recording has ended", "#log", 60.0);
    wait(&mut browser, &demo, "Turn ", "#log", 30.0);
    pictures(&mut browser, &demo, &folder.join("demo-guiding"));
    accessible(&mut browser, &demo, "demo, under guidance");
    wait(&mut browser, &demo, "The demo has ended", "#answer", 240.0);
    println!("what the demo said:\n{}", browser.text(&demo, "#log"));
    println!("its state:\n{}", browser.text(&demo, "#state"));
    let ended = browser.text(&demo, "#answer");
    let metres: f64 = ended.split(' ').find_map(|word| word.parse().ok()).unwrap();
    assert!(browser.text(&demo, "#log").contains("You have arrived") && metres < 1.0, "{ended}");
    browser.reload(&demo);
    wait(&mut browser, &demo, "Press Start the demo", "#control", 60.0);
    assert!(!browser.text(&demo, "#route-list").contains("Route 1"));
    assert_eq!(browser.troubles(), Vec::<String>::new(), "the page has errors");
}

/// The lens as it was learned on an earlier day: without motion it cannot be learned here.
fn know_the_lens(browser: &mut Browser, phone: &Tab) {
    let focal = camera().fx / camera().width as f64;
    let lens = format!(
        "JSON.stringify({{ [JSON.parse(localStorage.getItem('cairn-settings')).phone + ' 4:3']: \
         {{ focal: {focal}, radial: 0, sigma: [0.003, 0.01] }} }})"
    );
    browser.eval(phone, &take_in("lenses.json", &lens));
    wait(browser, phone, "1 file was taken in", "#answer", 10.0);
}

/// Gives the page a file with this content, an expression.
fn take_in(name: &str, content: &str) -> String {
    format!(
        "(() => {{ const given = new DataTransfer(); given.items.add(new File([{content}], '{name}')); \
         const input = document.getElementById('files-given'); input.files = given.files; \
         input.dispatchEvent(new Event('change')); }})()"
    )
}

/// Starts the camera and records the way out.
fn record(browser: &mut Browser, phone: &Tab) {
    browser.click(phone, "#camera");
    let began = Instant::now();
    wait(browser, phone, "You are in control", "#control", 20.0);
    wait(browser, phone, ".", "#s-tracking", 30.0);
    browser.key(phone, "r");
    wait(browser, phone, "Recording", "#log", 10.0);
    wait(browser, phone, "I can see well.", "#s-tracking", 12.0);
    while began.elapsed().as_secs_f64() < OUT_S {
        std::thread::sleep(Duration::from_millis(50));
    }
    browser.key(phone, "s");
    wait(browser, phone, "Recording has ended", "#log", 10.0);
}

/// The archive holds what Cairn reads; another file is refused, and the archive is taken in again.
fn give_out_and_take_in(browser: &mut Browser, phone: &Tab, folder: &Path) {
    browser.eval(phone, "URL.createObjectURL = (blob) => { window.archive = blob; return '#'; }");
    browser.eval(phone, "document.querySelector('#files details').open = true");
    accessible(browser, phone, "alone, with its files");
    browser.click(phone, "#files-export");
    wait(browser, phone, "cairn-routes.tar", "#answer", 20.0);
    let read = "new Promise((done) => { const reader = new FileReader(); \
        reader.onload = () => done(reader.result.split(',')[1]); reader.readAsDataURL(window.archive); })";
    let archive = from_base64(browser.eval(phone, read).as_str().unwrap());
    std::fs::write(folder.join("cairn-routes.tar"), archive).unwrap();
    let given = folder.join("given");
    std::fs::create_dir_all(&given).unwrap();
    let tar =
        Command::new("tar").arg("-xf").arg(folder.join("cairn-routes.tar")).arg("-C").arg(&given).status();
    assert!(tar.unwrap().success());
    let names: Vec<_> = given.read_dir().unwrap().map(|e| e.unwrap().path()).collect();
    let route = Route::load(&given.join("route-0001.route")).unwrap();
    let map = names.iter().find(|n| n.extension().is_some_and(|e| e == "map")).unwrap();
    let map = MapFile::load(map).unwrap();
    println!("{names:?}: {} points, {} key frames", route.points.len(), map.snapshot.key_frame_count());
    assert!(route.points.len() > 10 && map.snapshot.key_frame_count() > 3);

    browser.eval(phone, &take_in("holiday.jpg", "'x'"));
    wait(browser, phone, "holiday.jpg is no file of Cairn", "#answer", 10.0);
    browser.eval(phone, &take_in("cairn-routes.tar", "window.archive"));
    wait(browser, phone, "files were taken in", "#answer", 20.0);
    browser.reload(phone);
    wait(browser, phone, "Route 1", "#route-list", 60.0);
}
