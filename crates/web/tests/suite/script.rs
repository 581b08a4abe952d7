//! Parts of the page's script that need no browser, run by Node where it is installed.

use std::path::{Path, PathBuf};
use std::process::Command;

/// What a script prints that imports the page's files from `PAGE`; nothing, and "skipped" is said, without Node.
fn printed(name: &str, script: &str) -> Option<String> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/page");
    let folder: PathBuf = std::env::temp_dir().join(format!("cairn-script-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for file in page.read_dir().unwrap().map(|e| e.unwrap().path()) {
        std::fs::copy(&file, folder.join(file.file_name().unwrap())).unwrap();
    }
    std::fs::write(folder.join("package.json"), r#"{"type":"module"}"#).unwrap();
    std::fs::write(folder.join("test.js"), DOCUMENT.to_owned() + script).unwrap();
    let run = Command::new("node").arg(folder.join("test.js")).output();
    let _ = std::fs::remove_dir_all(&folder);
    let Ok(run) = run else {
        println!("skipped: node is not installed");
        return None;
    };
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    Some(String::from_utf8(run.stdout).unwrap())
}

/// As much of a document as the files ask for: any element by its id, and what is dispatched to it.
const DOCUMENT: &str = "
const elements = {};
const element = () => ({
  hidden: false, textContent: '', value: '', dataset: {}, open: false, acts: {},
  addEventListener(kind, act) { this.acts[kind] = act; },
  click() { this.acts.click?.(); },
  focus() {},
  querySelector() { return this; },
  showModal() { this.open = true; },
  close() { this.open = false; },
});
globalThis.document = {
  getElementById: (id) => (elements[id] ??= element()), addEventListener() {}, createElement: element, visibilityState: 'visible',
};
globalThis.localStorage = { getItem: () => null, setItem() {} };
globalThis.window = globalThis;
globalThis.addEventListener = () => {};
const said = [];
const t = (id, values) => [id, ...Object.values(values ?? {})].join(' ');
const say = (text) => said.push(text);
";

#[test]
fn practice_goes_on_with_what_the_walker_does() {
    let script = "
const { Practice } = await import('./practice.js');
const practice = new Practice({ say, t });
practice.status({ frames: 9 });
elements.practice.click();
const recording = (length) => ({ frames: 9, metric: true, recording: { length } });
for (const status of [null, { frames: 9 }, recording(0), recording(9.9), recording(10), { frames: 9 },
  { frames: 9, guiding: {} }, { frames: 9 }]) {
  practice.status(status);
  console.log(said.splice(0).join(), elements['practice-words'].textContent);
}
elements['practice-again'].click();
console.log(said.splice(0).join());
elements['practice-end'].click();
practice.status(recording(1));
console.log(said.length, elements['practice-part'].hidden);
// Who begins with a running recording is not told to begin one.
elements.practice.click();
practice.status(recording(1));
console.log(said.splice(0).join());";
    let Some(text) = printed("practice", script) else { return };
    let lines: Vec<&str> = text.lines().collect();
    let step = |name: &str| format!("page-practice-{name} page-practice-{name}");
    assert_eq!(
        lines,
        [
            &step("camera"),
            &step("record"),
            &step("out"),
            " page-practice-out",
            &step("stop"),
            &step("home"),
            " page-practice-home",
            &step("done"),
            "page-practice-done",
            "0 true",
            "page-practice-camera,page-practice-out",
        ]
    );
}

#[test]
fn battery_and_darkness_are_said_once_each() {
    let script = "
const { Light, watchBattery } = await import('./watch.js');
const power = { level: 0.5, charging: false, acts: [], addEventListener(_, act) { this.acts.push(act); } };
await watchBattery(say, t, power);
for (const [level, charging] of [[0.2, false], [0.19, false], [0.1, true], [0.1, false], [0.04, false], [0.5, true], [0.2, false]]) {
  Object.assign(power, { level, charging });
  power.acts.forEach((act) => act());
}
await watchBattery(say, t, null);
console.log(said.splice(0).join());
const light = new Light(say, t);
for (const gray of [90, 10, 10, 90, 10, 10, 10, 10, 25, 25, 25, 60, 60, 60, 60]) light.look(gray);
console.log(said.splice(0).join());";
    let Some(text) = printed("watch", script) else { return };
    assert_eq!(
        text,
        "page-battery 20,page-battery 10,page-battery 4,page-battery 20\npage-dark-now,page-light-now\n"
    );
}

/// The same reading as two makers' phones report it.
#[test]
fn an_ipad_that_calls_itself_a_macintosh_has_the_sign_of_apple() {
    let script = "
const { gravitySign } = await import('./camera.js');
const [phone, mac, android] = ['Mozilla/5.0 (iPhone; CPU iPhone OS 18_0)', 'Mozilla/5.0 (Macintosh; Intel Mac OS X 10_15_7)', 'Mozilla/5.0 (Linux; Android 14)'];
console.log([[phone, 5], [mac, 5], [mac, 0], [android, 5]].map(([userAgent, maxTouchPoints]) => gravitySign({ userAgent, maxTouchPoints })).join());";
    let Some(text) = printed("gravity", script) else { return };
    assert_eq!(text, "-1,-1,1,1\n");
}

/// Who is offered two phones and is the second goes on as that one, with its settings.
#[test]
fn a_phone_from_another_address_takes_its_token_and_settings() {
    let script = "
globalThis.sessionStorage = localStorage;
let loads = 0;
globalThis.location = { reload: () => { loads += 1; } };
const { KnownPhones } = await import('./phones.js');
const { kept, settings } = await import('./kept.js');
const own = kept.phone;
const phones = new KnownPhones({ say, t });
phones.take([{ phone: 'a', route: [3, null], settings: {} }, { phone: 'b', route: [1, 'to the library'], settings: { speed: 240, before: true } }]);
elements['known-no'].click();
elements['known-yes'].click();
console.log(said.splice(0).join('|'), own.length, kept.phone, kept.speed, loads, JSON.stringify(settings()));
elements.known.open = false;
phones.take([{ phone: 'a', route: [3, null], settings: {} }]);
elements['known-no'].click();
phones.take([{ phone: 'a', route: [3, null], settings: {} }]);
console.log(said.length, elements.known.open, kept.isNew);";
    let Some(text) = printed("phones", script) else { return };
    assert_eq!(
        text,
        "page-known 3 |page-known-named 1 to the library 16 b 240 1 {\"speed\":240,\"before\":true}\n1 false true\n"
    );
}

/// A wrong code is said with its cure, and the right one opens.
#[test]
fn a_code_is_typed_until_it_is_right() {
    let script = "
const answers = [{ said: true }, { wrong: 2 }, { wrong: 0 }, { wait: 20 }, null, { key: 'k' }];
const asked = [];
globalThis.fetch = async (_, { body }) => {
  asked.push(JSON.parse(body).digits);
  const answer = answers.shift();
  if (!answer) throw new Error('offline');
  return { json: async () => answer };
};
const { Pairing } = await import('./pairing.js');
let key = null;
const pairing = new Pairing({ say, t, language: () => 'de', paired: (given) => { key = given; } });
const turn = () => new Promise((done) => setTimeout(done));
const type = async (digits) => {
  elements['pair-digits'].value = digits;
  elements.pairing.acts.submit({ preventDefault() {} });
  await turn();
};
pairing.open();
await turn();
for (const digits of ['1 2 3 4 5 6', '222222', '3', '4', '555 555']) await type(digits);
console.log(said.map((text) => text.trim()).join('|'), asked.join(), key, elements.pairing.open);";
    let Some(text) = printed("pairing", script) else { return };
    assert_eq!(
        text,
        "page-pair-said true|page-pair-wrong 2|page-pair-over 0|page-pair-wait 20|page-pair-offline true ,123456,222222,3,4,555555 k false\n"
    );
}

/// The note's number counts whole, and its name and side are spoken before it.
#[test]
fn a_note_in_the_walkers_voice_is_found_by_its_name() {
    let script = "
globalThis.indexedDB = { open: () => ({}) };
globalThis.URL.createObjectURL = (clip) => clip;
const played = [];
globalThis.Audio = class { constructor(clip) { this.clip = clip; } async play() { played.push(this.clip); } pause() { played.push('hush'); } };
const { Voices } = await import('./voices.js');
const voices = new Voices();
console.log(voices.next());
voices.clips.set('Voice note 1', 'door');
voices.clips.set('Voice note 12', 'well');
console.log(voices.next(), voices.named('Turn left now.'), voices.named('Voice note 3.'));
voices.named('Voice note 12 on your left.')();
voices.named('VOICE NOTE 1.')();
console.log(played.join());";
    let Some(text) = printed("voices", script) else { return };
    assert_eq!(text, "1\n13 undefined undefined\nwell,hush,door\n");
}
