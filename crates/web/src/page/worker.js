// The engine in this device, in a worker of the page: takes what a page sends to a server, and answers as that does
// (crates/web/src/wire.rs). A text of the page's own goes as { kind, id, values }, for the page knows the language.

import { GRAY_HEAD } from './coding.js';
import { Engine } from './engine.mjs';
import { Store } from './store.js';
import { pack, unpack } from './tar.js';

const FOLDER = 'routes';
const RATE_HZ = 15;
// Motion that has not come by then, after the first image, does not come; and what is waited for while there are no images.
const [NO_MOTION_MS, SILENT_MS] = [1000, 200];
const [STATUS_MS, VIEW_MS, MAP_MS] = [100, 250, 1000];
// The next image is asked for once mapping has caught up, or after so long: a slow device sees fewer images instead of tracking in a map
// that does not grow.
const CATCH_UP_MS = 150;
// The kind of a message with files.
const FILES = 5;
const LENSES = 'lenses.json';
const TURNED = 'page-here-turned';

const clockMs = () => performance.timeOrigin + performance.now();
const base = clockMs();
const seconds = (ms) => (ms - base) / 1000;
const say = (kind, id, values) => postMessage({ kind, id, values });

// The walk, from the hello on: what the page wants, what it set before the first image, and when things were last done.
const walk = {
  engine: null, store: null, changed: new Map(), language: 'en', zone_min: 0, pinhole: null, lines: [], want: {}, held: false,
  size: null, first: null, moved: -Infinity, motion: [], imaged: -Infinity, told: '', step_ms: 0, maps: false, owed: [], until: 0, viewed: 0, mapped: 0, hasMap: false, replaces: false,
};

function apply(kind, ...parts) {
  const answer = walk.engine.send(kind, ...parts);
  keep();
  for (const report of answer.reports) take(report);
  return answer;
}

// Everything that one message has changed, as it is now.
function keep() {
  if (walk.changed.size === 0) return;
  const files = [...walk.changed.keys()].map((path) => [path, walk.engine.wasi.files.get(path)?.data().slice() ?? null]);
  walk.changed.clear();
  walk.store.keep(files);
}

function take({ t_s, state, refused, said, sounds }) {
  for (const { pose_s, ...words } of said) postMessage({ said: { ...words, pose_ms: pose_s === null ? null : base + 1000 * pose_s } });
  for (const [name, bearing_rad] of sounds) postMessage({ sound: { name, bearing_rad } });
  if (state !== null) postMessage({ frame: { ms: base + 1000 * t_s } });
  if (refused) trouble(refused);
}

// Each trouble once, until there is another or none.
function trouble(text) {
  if (text !== walk.told) postMessage({ trouble: text });
  walk.told = text;
}

function control(held) {
  walk.held = held;
  postMessage({ control: { id: held ? 1 : null, held } });
}

// One page of this origin has the files.
async function locked() {
  if (!navigator.locks) return true;
  return new Promise((done) => {
    navigator.locks.request('cairn', { ifAvailable: true }, (lock) => {
      done(lock !== null);
      return lock && new Promise(() => {});
    });
  });
}

async function hello({ language, zone_min, phone, demo }) {
  Object.assign(walk, { language, zone_min, phone });
  if (!demo && !(await locked())) return say('trouble', 'page-here-twice');
  try {
    // What a demo records is not kept.
    const [store, files] = demo ? [{ keep: async () => true }, []] : await Store.open((error) => {
      console.error(error);
      say('trouble', 'page-here-not-kept');
    });
    walk.store = store;
    const module = await WebAssembly.compile(await (await fetch('cairn.wasm')).arrayBuffer());
    walk.engine = await Engine.start(module, { print: (text) => console.warn(text), changed: (path) => walk.changed.set(path, true) });
    for (const [path, bytes] of files) walk.engine.wasi.put(path, bytes);
  } catch (error) {
    console.error(error);
    return say('trouble', 'page-here-too-old');
  }
  setInterval(step, STATUS_MS);
  showRoutes();
  postMessage({ hello: { id: 1, version: '', camera: '' } });
  return control(false);
}

// Mapping goes on, a slice at a time, while no message waits.
const rest = new MessageChannel();
rest.port1.onmessage = () => {
  const busy = walk.size !== null && walk.engine.send('W').busy;
  if (!busy || performance.now() > walk.until) ask();
  if (busy) rest.port2.postMessage(null);
  walk.maps = busy;
};

function map() {
  walk.until = performance.now() + CATCH_UP_MS;
  if (!walk.maps) rest.port2.postMessage(null);
  walk.maps = true;
}

// The page may send the next image.
function ask() {
  for (const ms of walk.owed.splice(0)) postMessage({ got: { ms } });
}

// The first image says how large they are. Whether there is motion is known a moment later.
function begin(ms, width, height) {
  // No walk begins while the files that it would read are replaced.
  if (walk.replaces) return;
  walk.first ??= ms;
  const moves = clockMs() - walk.moved < NO_MOTION_MS;
  if (!moves && ms - walk.first < NO_MOTION_MS) return;
  const { language, zone_min } = walk;
  const setup = { width, height, rate_hz: RATE_HZ, motion: moves, phone: walk.phone, pinhole: walk.pinhole, library: { folder: FOLDER, language, zone_min } };
  const { error } = walk.engine.setup(setup);
  keep();
  if (error) return trouble(error);
  [walk.size, walk.hasMap, walk.motion] = [[width, height], false, []];
  for (const line of walk.lines) walk.engine.command(line);
}

function image(bytes) {
  const head = new DataView(bytes.buffer, bytes.byteOffset);
  const [ms, width, height] = [head.getFloat64(0, true), head.getUint32(8, true), head.getUint32(12, true)];
  if (walk.size === null) begin(ms, width, height);
  if (walk.size !== null) {
    if (walk.size[0] !== width || walk.size[1] !== height) {
      if (walk.told !== TURNED) say('trouble', TURNED);
      walk.told = TURNED;
    } else {
      const began = performance.now();
      const { error } = apply('I', Float64Array.of(seconds(ms)), bytes.subarray(GRAY_HEAD));
      walk.step_ms = performance.now() - began;
      trouble(error ?? '');
    }
  }
  // What took long is no silence of the camera.
  walk.imaged = clockMs();
  walk.owed.push(ms);
  map();
}

function motion(readings) {
  walk.moved = clockMs();
  if (walk.size === null) return;
  const { error } = apply('M', Float64Array.from(readings.flatMap(([ms, ...values]) => [seconds(ms), ...values])));
  if (error) console.warn(error);
}

function command(line) {
  if (!walk.held) control(true);
  if (walk.size === null) return say('refused', 'page-no-picture-yet');
  const { done, error } = walk.engine.command(line);
  keep();
  // What has been done is told once it is kept.
  return walk.store.keep([]).then(() => postMessage({ did: { ok: !error, text: error ?? done } }));
}

function settings({ language, lines }) {
  Object.assign(walk, { language, lines });
  if (walk.size !== null) for (const line of lines) walk.engine.command(line);
}

// Time goes on, and the page is told how things are.
function step() {
  if (walk.size === null) return;
  const now = clockMs();
  if (now - walk.imaged > SILENT_MS) apply('T', Float64Array.of(seconds(now)));
  const { status, routes, notes, camera } = walk.engine.send('Q').shown;
  postMessage({ status: { ...status, step_ms: walk.step_ms, dropped: 0 } });
  if (routes) postMessage({ routes });
  for (const note of notes) postMessage({ doubt: note });
  if (!walk.want.map) return;
  if (now - walk.viewed >= VIEW_MS) {
    walk.viewed = now;
    postMessage({ view: { camera } });
  }
  if (now - walk.mapped >= MAP_MS) {
    walk.mapped = now;
    const map = walk.engine.map(!walk.hasMap);
    walk.hasMap = true;
    postMessage(map, [map]);
  }
}

function end() {
  if (walk.size === null) return;
  const { error } = walk.engine.send('E');
  keep();
  if (error) trouble(error);
  [walk.size, walk.first] = [null, null];
}

// All routes and maps, as one archive behind the kind of the message.
function give() {
  const kept = [...walk.engine.wasi.files].map(([path, file]) => [path.split('/').pop(), file.data()]);
  const archive = pack(kept.filter(([name, bytes]) => isOurs(name, bytes)), 1);
  archive[0] = FILES;
  postMessage(archive.buffer, [archive.buffer]);
}

// Takes archives, routes and maps in place of all that was kept; nothing where one of them is something else.
async function put(given) {
  const inside = ({ name, bytes }) => (name.endsWith('.tar') ? unpack(bytes) : [[name, bytes]]);
  const wrong = given.find((one) => !inside(one)?.every(([name, bytes]) => isOurs(name, bytes)));
  if (wrong || given.length === 0) return wrong && postMessage({ imported: { wrong: wrong.name } });
  end();
  const files = given.flatMap(inside).map(([name, bytes]) => [`${FOLDER}/${name.split('/').pop()}`, bytes]);
  walk.replaces = true;
  const isKept = await walk.store.replace(files);
  walk.replaces = false;
  if (!isKept) return undefined;
  const { wasi } = walk.engine;
  wasi.files.clear();
  for (const [path, bytes] of files) wasi.put(path, bytes);
  showRoutes();
  return postMessage({ imported: { count: files.length } });
}

// By name and first bytes; what is damaged behind those, the engine says.
function isOurs(name, bytes) {
  if (name === LENSES) return true;
  const begin = { route: '{"format"', map: '\u008ccairn\r\n' }[name.split('.').pop()];
  return begin !== undefined && [...begin].every((letter, k) => bytes[k] === letter.charCodeAt(0));
}

// The routes before there is a picture.
function showRoutes() {
  const { language, zone_min } = walk;
  const { routes } = walk.engine.send('R', new TextEncoder().encode(JSON.stringify({ folder: FOLDER, language, zone_min })));
  if (routes) postMessage({ routes });
}

onmessage = ({ data }) => {
  if (data instanceof Uint8Array) return walk.engine && image(data);
  if (typeof data !== 'string') return walk.engine && put(data.put);
  const [kind, value] = Object.entries(JSON.parse(data))[0];
  if (kind === 'hello') return hello(value);
  if (kind === 'want') walk.hasMap &&= value.map && walk.want.map;
  if (kind === 'want') walk.want = value;
  if (!walk.engine) return undefined;
  const known = { motion, command, settings, give, lens: (pinhole) => { walk.pinhole = pinhole; }, take: () => control(true), takeover: () => control(true), late: (late) => walk.size && walk.engine.send('L', Uint8Array.of(late ? 1 : 0)) };
  return known[kind]?.(value);
};
