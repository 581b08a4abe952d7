//! A browser, driven by the Chrome DevTools Protocol (<https://chromedevtools.github.io/devtools-protocol/>).

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::runtime::Runtime;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

/// An answer that takes longer counts as a failure.
const ANSWER_WITHIN: Duration = Duration::from_secs(30);

/// A headless Chromium; it ends when dropped.
pub struct Browser {
    child: Child,
    runtime: Runtime,
    socket: WebSocketStream<TcpStream>,
    number: u64,
    troubles: Vec<String>,
}

/// One page.
pub struct Tab {
    target: String,
    session: String,
}

/// The walker of a page has heard what to mind.
pub const HEARD: &str = "try { localStorage.getItem('cairn-settings') \
                     ?? localStorage.setItem('cairn-settings', '{\"before\":true,\"told\":\"voice\"}'); } catch {}";

impl Browser {
    /// Starts the browser; its camera shows the video. `None` where it is not installed.
    pub fn start(folder: &Path, video: &Path) -> Option<Self> {
        let program = std::env::var("CHROMIUM").unwrap_or_else(|_| "chromium".into());
        let mut child = Command::new(program)
            .args([
                "--headless=new",
                "--no-sandbox",
                "--disable-gpu",
                "--enable-unsafe-swiftshader",
                "--hide-scrollbars",
                "--mute-audio",
                "--no-first-run",
            ])
            .args(["--remote-debugging-port=0", "--ignore-certificate-errors", "--disable-dev-shm-usage"])
            .args(["--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"])
            // Background pages run as if they were in front.
            .args(["--disable-renderer-backgrounding", "--disable-backgrounding-occluded-windows"])
            .args(["--disable-background-timer-throttling", "--disable-background-networking"])
            .arg(format!("--use-file-for-fake-video-capture={}", video.display()))
            .arg(format!("--user-data-dir={}", folder.join("profile").display()))
            .arg("about:blank")
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .ok()?;
        let mut lines = BufReader::new(child.stderr.take()?).lines().map_while(Result::ok);
        let url = lines.find_map(|l| l.strip_prefix("DevTools listening on ").map(str::to_owned))?;
        // Its later output must be read, or it would block.
        std::thread::spawn(move || lines.for_each(drop));
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let socket = runtime.block_on(async {
            let place = url.trim_start_matches("ws://").split('/').next().unwrap().to_owned();
            let stream = TcpStream::connect(place).await.unwrap();
            tokio_tungstenite::client_async(url, stream).await.unwrap().0
        });
        Some(Self { child, runtime, socket, number: 0, troubles: Vec::new() })
    }

    fn ask(&mut self, session: Option<&str>, method: &str, parameters: Value) -> Value {
        self.number += 1;
        let mut request = json!({ "id": self.number, "method": method, "params": parameters });
        if let Some(session) = session {
            request["sessionId"] = session.into();
        }
        let (socket, number, troubles) = (&mut self.socket, self.number, &mut self.troubles);
        let answer = async {
            socket.send(Message::text(request.to_string())).await.unwrap();
            while let Some(Ok(message)) = socket.next().await {
                let Message::Text(text) = message else { continue };
                let value: Value = serde_json::from_str(&text).unwrap();
                if value["id"] == number {
                    return value;
                }
                if value["method"] == "Runtime.exceptionThrown" {
                    troubles.push(value["params"]["exceptionDetails"].to_string());
                }
            }
            panic!("the browser has gone")
        };
        let limited = async { tokio::time::timeout(ANSWER_WITHIN, answer).await };
        let answer = self.runtime.block_on(limited).unwrap_or_else(|_| panic!("{method} is not answered"));
        assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
        answer["result"].clone()
    }

    /// Opens a page of the given size, and returns once its elements are there.
    pub fn open(&mut self, url: &str, size: [u32; 2]) -> Tab {
        self.open_after(url, size, HEARD)
    }

    /// Opens a page in which a script has run before its own.
    pub fn open_after(&mut self, url: &str, [width, height]: [u32; 2], script: &str) -> Tab {
        let target =
            self.ask(None, "Target.createTarget", json!({ "url": "about:blank", "newWindow": true }));
        let target = target["targetId"].as_str().unwrap().to_owned();
        let attached =
            self.ask(None, "Target.attachToTarget", json!({ "targetId": target, "flatten": true }));
        let tab = Tab { target, session: attached["sessionId"].as_str().unwrap().to_owned() };
        for domain in ["Page.enable", "Runtime.enable"] {
            self.ask(Some(&tab.session), domain, json!({}));
        }
        let size = json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": false });
        self.ask(Some(&tab.session), "Emulation.setDeviceMetricsOverride", size);
        let before = json!({ "source": script });
        self.ask(Some(&tab.session), "Page.addScriptToEvaluateOnNewDocument", before);
        self.ask(Some(&tab.session), "Page.navigate", json!({ "url": url }));
        let parsed = "new Promise(done => document.readyState === 'loading' ? \
            addEventListener('DOMContentLoaded', () => done()) : done())";
        self.eval(&tab, parsed);
        tab
    }

    /// Loads a page again, in the same tab.
    pub fn reload(&mut self, tab: &Tab) {
        self.ask(Some(&tab.session), "Page.reload", json!({}));
    }

    /// Closes a page as if its phone had failed.
    pub fn close(&mut self, tab: &Tab) {
        self.ask(None, "Target.closeTarget", json!({ "targetId": tab.target }));
    }

    /// Brings a page to the front.
    pub fn front(&mut self, tab: &Tab) {
        self.ask(Some(&tab.session), "Page.bringToFront", json!({}));
    }

    /// The value of an expression, evaluated as if a person had touched the page.
    pub fn eval(&mut self, tab: &Tab, expression: &str) -> Value {
        let parameters = json!({
            "expression": expression, "awaitPromise": true, "returnByValue": true, "userGesture": true
        });
        let answer = self.ask(Some(&tab.session), "Runtime.evaluate", parameters);
        assert!(answer["exceptionDetails"].is_null(), "{expression}: {}", answer["exceptionDetails"]);
        answer["result"]["value"].clone()
    }

    /// The text of an element, line by line, also where it is folded away; empty where there is no such element.
    pub fn text(&mut self, tab: &Tab, element: &str) -> String {
        let find = format!(
            "(() => {{ const e = document.querySelector({}); return e?.innerText || e?.textContent || ''; }})()",
            json!(element)
        );
        self.eval(tab, &find).as_str().unwrap_or_default().to_owned()
    }

    /// Clicks an element; it must exist and be shown.
    pub fn click(&mut self, tab: &Tab, element: &str) {
        let click = format!(
            "(() => {{ const e = document.querySelector({0}); if (!e || e.hidden) throw new Error({0} + ' is not there'); \
             e.click(); }})()",
            json!(element)
        );
        self.eval(tab, &click);
    }

    /// Shows the page in the "light" or the "dark" scheme.
    pub fn scheme(&mut self, tab: &Tab, scheme: &str) {
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        self.ask(Some(&tab.session), "Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// As for a person who prefers reduced motion.
    pub fn still(&mut self, tab: &Tab) {
        let features = json!([{ "name": "prefers-reduced-motion", "value": "reduce" }]);
        self.ask(Some(&tab.session), "Emulation.setEmulatedMedia", json!({ "features": features }));
    }

    /// Types text where the focus is.
    pub fn write(&mut self, tab: &Tab, text: &str) {
        self.ask(Some(&tab.session), "Input.insertText", json!({ "text": text }));
    }

    /// Presses a key.
    pub fn key(&mut self, tab: &Tab, key: &str) {
        for kind in ["keyDown", "keyUp"] {
            let event = json!({ "type": kind, "key": key, "text": if kind == "keyDown" && key.len() == 1 { key } else { "" } });
            self.ask(Some(&tab.session), "Input.dispatchKeyEvent", event);
        }
    }

    /// Whether something is drawn on a canvas: more than one colour.
    pub fn drawn(&mut self, tab: &Tab, canvas: &str) -> bool {
        let look = format!(
            "(() => {{ const c = document.querySelector({}); const p = document.createElement('canvas'); \
             [p.width, p.height] = [c.width, c.height]; const x = p.getContext('2d'); x.drawImage(c, 0, 0); \
             const d = x.getImageData(0, 0, c.width, c.height).data; const seen = new Set(); \
             for (let i = 0; i < d.length; i += 4) seen.add(d[i] * 65536 + d[i + 1] * 256 + d[i + 2]); return seen.size > 3; }})()",
            json!(canvas)
        );
        self.eval(tab, &look).as_bool().unwrap_or(false)
    }

    /// Saves a screenshot.
    pub fn picture(&mut self, tab: &Tab, path: &Path) {
        let parameters = json!({ "format": "png", "captureBeyondViewport": false });
        let answer = self.ask(Some(&tab.session), "Page.captureScreenshot", parameters);
        std::fs::write(path, from_base64(answer["data"].as_str().unwrap())).unwrap();
    }

    /// The findings of axe-core, as JSON: the rule and the elements.
    pub fn axe(&mut self, tab: &Tab, axe: &str) -> String {
        self.eval(tab, &format!("{axe}; 0"));
        let run = "axe.run({ runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa', 'best-practice'] })\
                   .then((r) => JSON.stringify(r.violations.map((v) => [v.id, v.help, v.nodes.map((n) => n.html)])))";
        self.eval(tab, run).as_str().unwrap_or_default().to_owned()
    }

    /// Errors that pages threw.
    pub fn troubles(&self) -> Vec<String> {
        self.troubles.clone()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub fn from_base64(text: &str) -> Vec<u8> {
    let value = |c: u8| match c {
        b'A'..=b'Z' => u32::from(c - b'A'),
        b'a'..=b'z' => u32::from(c - b'a') + 26,
        b'0'..=b'9' => u32::from(c - b'0') + 52,
        b'+' => 62,
        _ => 63,
    };
    let mut out = Vec::new();
    let coded: Vec<u8> = text.bytes().filter(|c| *c != b'=').collect();
    for four in coded.chunks(4) {
        let bits = four.iter().fold(0, |b, c| (b << 6) | value(*c)) << (6 * (4 - four.len()));
        out.extend(&bits.to_be_bytes()[1..four.len()]);
    }
    out
}
