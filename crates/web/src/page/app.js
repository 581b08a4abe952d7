// The page: its web socket, the status on the screen, and the commands.
import { MediaButtons } from './buttons.js';
import { Camera } from './camera.js';
import { Pace } from './pace.js';
import { MainButton, Noting, RouteList } from './routes.js';
import { Senses } from './senses.js';
import { Picture, MapView } from './view.js';

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.hash.slice(1)).get('k') || '';
const watchOnly = new URLSearchParams(location.search).has('watch');
// After this time without a message under guidance, the page says stop; after this time in any case, the connection
// counts as lost, even if the browser has not noticed: the server sends several pings a second.
const SILENT_MS = 1500;
const GONE_MS = 3000;
// A slow link may need this long to open a connection.
const OPEN_MS = 10000;
// No directions are given from older images; guidance is trusted again when images have been younger for a second.
const STALE_MS = 500;
const BACK_MS = 1000;
// "Stop" is repeated while its reason lasts.
const AGAIN_MS = 3000;

const senses = new Senses({ polite: $('polite'), urgent: $('urgent') });
const picture = new Picture($('picture'));
const map = new MapView($('map'), $('map-words'));
const pace = new Pace();
const routes = new RouteList(command);
const noting = new Noting(command);
const main = new MainButton();
const media = new MediaButtons(command);
// The newest status; null before the first picture, and while there is no connection.
let latest = null;
let socket = null;
let me = null;
let controls = false;
let held = false;
let ownCamera = false;
let guiding = false;
let heard = 0;
// Why the link is down, and when that was last said.
let down = null;
let downSaid = -Infinity;
// The page's time of the newest image whose pose is known; whether it is too old, and since when it no longer is.
let frameMs = null;
let late = false;
let freshSince = null;
let rest = 300;

// The page's clock: images are stamped with it, and pings answered.
const clockMs = () => performance.timeOrigin + performance.now();

// Known only to this page, so that it regains its walk after a network failure or a reload.
function secretOfThisPage() {
  const fresh = [...crypto.getRandomValues(new Uint8Array(16))].map((b) => b.toString(16).padStart(2, '0')).join('');
  try {
    const kept = sessionStorage.getItem('cairn-secret') ?? fresh;
    sessionStorage.setItem('cairn-secret', kept);
    return kept;
  } catch {
    return fresh;
  }
}
const secret = secretOfThisPage();

const camera = new Camera($('video'), {
  pace,
  picture: (bytes) => {
    if (!controls || socket?.readyState !== WebSocket.OPEN) return;
    pace.sent(performance.now(), bytes.length);
    send(bytes);
  },
  motion: (samples) => controls && send(JSON.stringify({ motion: samples })),
  clogged: () => !socket || socket.readyState !== WebSocket.OPEN || socket.bufferedAmount > 8000,
});

function connect() {
  if (down === null) $('link').textContent = 'Connecting.';
  const mine = new WebSocket(`wss://${location.host}/ws`);
  socket = mine;
  heard = performance.now();
  mine.binaryType = 'arraybuffer';
  mine.onopen = () => {
    send(JSON.stringify({ hello: { token, walk: !watchOnly, secret, origin: performance.timeOrigin, zone_min: -new Date().getTimezoneOffset() } }));
    want();
  };
  mine.onmessage = (event) => {
    if (mine !== socket) return;
    heard = performance.now();
    if (typeof event.data === 'string') take(JSON.parse(event.data));
    else picture.draw(event.data);
  };
  mine.onclose = () => mine === socket && ended();
}

// The connection has closed or fallen silent: another is tried at once, then at growing intervals.
function ended() {
  socket.onclose = null;
  socket.close();
  socket = null;
  if (me !== null || down !== null) lost('The connection is lost.');
  $('link').textContent = 'Not connected. Trying again.';
  me = null;
  latest = null;
  control(null, held);
  setTimeout(connect, rest);
  rest = Math.min(2 * rest, 5000);
}

function send(data) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(data);
}

// A hidden page needs neither images nor the map; a phone that sends its own camera images needs no copy of them.
function want() {
  const shown = document.visibilityState === 'visible';
  send(JSON.stringify({ want: { picture: shown && !camera.running, map: shown } }));
}

function take(message) {
  const [kind, value] = Object.entries(message)[0];
  const known = {
    hello, said, sound, did, status, trouble, doubt, refused, ping,
    control: (v) => control(v.id, v.held),
    got: () => pace.got(performance.now()),
    view: (v) => map.take(v),
    routes: (v) => routes.take(v),
  };
  known[kind]?.(value);
}

function ping({ n, trip_ms }) {
  send(JSON.stringify({ pong: { n, ms: clockMs() } }));
  if (trip_ms !== null) pace.trip = trip_ms;
}

function hello({ id, camera: name }) {
  me = id;
  rest = 300;
  ownCamera = name === '';
  $('link').textContent = ownCamera ? 'Connected.' : `Connected; the camera is ${name}.`;
  pace.reset();
  // The server's new connection does not know which messages this page found late.
  late = false;
  if (down !== null) {
    down = null;
    senses.drop('link');
    senses.say({ text: 'Connected again.', priority: 2 });
  }
}

function control(id, isHeld) {
  const had = controls;
  controls = me !== null && id === me;
  held = isHeld;
  if (controls !== had) pace.reset();
  if (had && !controls && me !== null) {
    const text = 'Stop. Another device has taken over this walk.';
    senses.say({ text, priority: 0 });
    write({ text, priority: 0 });
  } else if (controls && !had && !isQuiet) {
    senses.say({ text: 'You hold this walk now.', priority: 1 });
  }
  if (controls) isQuiet = false;
  const free = me !== null && !held;
  const other = me !== null && held && !controls;
  set('control', controls ? 'You control this walk.'
    : me === null ? '' : free ? `Nobody controls this walk. ${ownCamera ? 'Start the camera to begin.' : 'The first command takes it.'}`
      : id === null ? 'The device that controls this walk is away; the walk waits for it.' : 'Another device controls this walk; you watch.');
  $('take').hidden = !(other || (free && (watchOnly || !ownCamera)));
  $('take').textContent = other ? 'Take over this walk' : 'Take control';
  $('camera').hidden = !((controls || (free && !watchOnly)) && ownCamera) || camera.running;
  for (const button of document.querySelectorAll('[data-command]')) {
    button.setAttribute('aria-disabled', controls || (free && !watchOnly) ? 'false' : 'true');
  }
  showMain();
}

// The main button is there where neither the walk has to be taken nor the camera to be started first.
function showMain() {
  main.show(latest, $('take').hidden && $('camera').hidden && me !== null);
}
// Control that this page asked for itself needs no announcement the first time.
let isQuiet = true;

function said(words) {
  const old = typeof words.pose_ms === 'number' && camera.running && clockMs() - words.pose_ms > STALE_MS;
  if (old || (late && typeof words.pose_ms === 'number')) {
    // The server is informed that the direction came too late; it then stops and directs anew.
    if (old) becameLate();
    return;
  }
  senses.say(words);
  write(words);
}

function write({ text, priority, t_s }) {
  $('words').textContent = text;
  $('words').classList.toggle('urgent', priority === 0);
  const line = document.createElement('li');
  line.textContent = t_s === undefined ? text : `${clock(t_s)} ${text}`;
  $('log').append(line);
  while ($('log').children.length > 200) $('log').firstChild.remove();
  $('log').scrollTop = $('log').scrollHeight;
}

function clock(s) {
  return `${Math.floor(s / 60)}:${String(Math.floor(s % 60)).padStart(2, '0')}`;
}

function sound({ name, bearing_rad }) {
  senses.sound(name, bearing_rad);
}

function did({ ok, text }) {
  $('answer').textContent = ok ? `Done: ${text}` : `Not done: ${text}`;
}

function refused(text) {
  did({ ok: false, text });
  senses.say({ text, priority: 1 });
}

function trouble(text) {
  $('answer').textContent = text;
  senses.say({ text, priority: 1, kind: 'trouble' });
}

function doubt(text) {
  $('answer').textContent = `Warning: ${text}`;
}

function status(s) {
  guiding = s.guiding !== null;
  latest = s;
  showMain();
  routes.ask(s.question, controls);
  frameMs = s.frame_ms;
  showState(s);
  set('s-tracking', `${s.words} ${s.tracked} of ${s.frames} frames; ${s.inliers} matches.`);
  const { waits, imu, initialised } = s.engine;
  set('s-phase', waits.length ? `${s.phase}, waits for ${waits.join(', ')}` : s.phase);
  set('s-imu', imu
    ? `${initialised ? '' : 'scale and gravity not known, '}${imu.batch} readings a picture, ${imu.synthesised} interpolated, ${imu.gaps} gaps`
    : 'not used');
  set('s-recording', s.recording
    ? `${s.recording.points} points, ${s.recording.length.toFixed(1)} ${s.metric ? 'metres' : 'units'}, ${s.recording.notes} notes, ${s.recording.file}`
      + (s.recording.trouble ? `; not on disk: ${s.recording.trouble}` : '')
    : 'no');
  set('s-route', s.route ? `${s.route.name}, ${s.route.points} points${s.route.here ? '' : ', of another map'}` : 'none');
  set('s-guiding', s.guiding
    ? `${s.guiding.facing}, ${s.guiding.state}, ${s.guiding.along_m.toFixed(1)} of ${s.guiding.length_m.toFixed(1)}${s.metric ? ' metres' : ''}`
    : 'none');
  set('s-scale', s.metric ? 'metres' : 'not known, so no distances are said');
  set('s-map', `${s.key_frames} keyframes, ${s.landmarks} landmarks${s.map_trouble ? `; not saved: ${s.map_trouble}` : ''}`);
  set('s-time', `${clock(s.t_s)}, ${s.step_ms.toFixed(1)} ms a picture, ${s.dropped} dropped`);
  map.camera(s);
}

// Text is set only when it changes, so that a screen reader keeps its position.
function set(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

// In large print the last instruction about moving, and the age of the image behind it.
function showState({ headline, age }) {
  set('state-now', late ? 'Stop. The pictures come too late.' : headline);
  $('state-now').classList.toggle('urgent', late || /^(Stop|No |The pictures come|I do not know)/.test(headline));
  const own = ownAge();
  const seconds = own !== null ? own / 1000 : age?.age_s;
  set('age-now', age === 'unknown' && own === null ? 'Nobody knows how old the picture is.'
    : seconds === undefined ? '' : `Picture ${Math.max(seconds, 0).toFixed(1)} s old`
      + (age?.bound_s >= 0.05 && own === null ? `, give or take ${age.bound_s.toFixed(2)} s` : ''));
}

// Age of the newest image with a pose, milliseconds; null where this page did not capture it.
function ownAge() {
  return camera.running && controls && frameMs !== null ? clockMs() - frameMs : null;
}

function becameLate() {
  freshSince = null;
  if (late) return;
  late = true;
  send(JSON.stringify({ late: true }));
  const text = 'Stop. The pictures come too late.';
  set('state-now', text);
  $('state-now').classList.add('urgent');
  // The server may have said it already, or something equally urgent.
  if (performance.now() - senses.urgentAt < AGAIN_MS) return;
  senses.say({ text, priority: 0, kind: 'late' });
  write({ text, priority: 0 });
}

function becameFresh() {
  if (!late) return;
  freshSince ??= performance.now();
  if (performance.now() - freshSince < BACK_MS) return;
  late = false;
  senses.drop('late');
  send(JSON.stringify({ late: false }));
}

// When the server can no longer say something, the page says it itself, repeatedly while the reason lasts.
function lost(why) {
  down = why;
  if (performance.now() - downSaid < AGAIN_MS) return;
  downSaid = performance.now();
  const text = guiding || camera.running ? `Stop. ${why}` : why;
  set('state-now', text);
  $('state-now').classList.add('urgent');
  set('age-now', '');
  for (const id of ['s-tracking', 's-phase', 's-imu', 's-recording', 's-guiding', 's-time']) set(id, 'not known without a connection');
  senses.say({ text, priority: 0, interrupts: true, kind: 'link' });
  write({ text, priority: 0 });
}

setInterval(() => {
  const silence = performance.now() - heard;
  if (socket && silence > (me === null ? OPEN_MS : GONE_MS)) ended();
  else if (me !== null && guiding && silence > SILENT_MS && ownAge() === null) lost('The computer does not answer.');
  else if (me !== null && silence < SILENT_MS && down !== null) {
    down = null;
    senses.drop('link');
  }
  if (down !== null && (guiding || camera.running)) lost(down);
  const age = ownAge();
  if (me !== null && guiding && age !== null && age > STALE_MS) becameLate();
  else if (age !== null) becameFresh();
}, 100);

let touched = false;
function command(line) {
  senses.wake();
  // A page may play sound only once it has been touched.
  if (!touched && $('media').checked) media.set(true);
  touched = true;
  if (me === null) {
    refused('The connection is lost. Trying again.');
    return;
  }
  if (held && !controls) {
    refused('Another device holds this walk.');
    return;
  }
  send(JSON.stringify({ command: line }));
}

document.addEventListener('click', (event) => {
  const button = event.target.closest('[data-command]');
  if (button?.dataset.command) command(button.dataset.command);
});

const KEYS = { r: 'record', s: 'stop', o: 'routes', l: 'load', g: 'guide home', b: 'guide backwards', h: 'halt', p: 'repeat', i: 'status' };
document.addEventListener('keydown', (event) => {
  const typing = event.target.closest?.('input:not([type=checkbox]):not([type=radio]), textarea, select');
  if (!$('keys').checked || typing || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
  // A dialog has its own keys.
  if (document.querySelector('dialog.small[open]')) return;
  const key = event.key.toLowerCase();
  const line = /^[1-9]$/.test(key) ? `load ${key}` : KEYS[key];
  if (key === 'n' && !$('note').hidden) {
    event.preventDefault();
    noting.open();
  } else if (line) {
    event.preventDefault();
    command(line);
  }
});

$('take').addEventListener('click', () => {
  senses.wake();
  if (held) $('ask').showModal();
  else send(JSON.stringify({ take: true }));
});
$('over').addEventListener('click', () => {
  $('ask').close();
  send(JSON.stringify({ takeover: true }));
});
$('leave').addEventListener('click', () => $('ask').close());

$('camera').addEventListener('click', async () => {
  senses.wake();
  try {
    await camera.start();
  } catch (error) {
    did({ ok: false, text: `the camera is not available (${error.name}). Allow it in the browser and try again.` });
    return;
  }
  send(JSON.stringify({ take: true }));
  $('own').hidden = false;
  $('seen').hidden = true;
  $('camera').hidden = true;
  showMain();
  $('commands').focus();
  want();
});

// Settings are stored in this browser.
const kept = (() => {
  try {
    return JSON.parse(localStorage.getItem('cairn-settings')) ?? {};
  } catch {
    return {};
  }
})();

function keep(name, value) {
  kept[name] = value;
  try {
    localStorage.setItem('cairn-settings', JSON.stringify(kept));
  } catch {
    // A private window stores nothing.
  }
}

for (const name of ['rate', 'volume', 'sounds', 'vibrate', 'keys', 'media']) {
  const input = $(name);
  const value = () => (input.type === 'checkbox' ? input.checked : Number(input.value));
  if (name in kept) input[input.type === 'checkbox' ? 'checked' : 'value'] = kept[name];
  senses.set(name, value());
  input.addEventListener('change', () => {
    senses.set(name, value());
    keep(name, value());
    if (name === 'media') media.set(value());
  });
}
for (const radio of document.querySelectorAll('[name=told]')) {
  if (kept.told === radio.value) {
    radio.checked = true;
    senses.set('told', radio.value);
  }
  radio.addEventListener('change', () => {
    if (!radio.checked) return;
    senses.set('told', radio.value);
    keep('told', radio.value);
  });
}

$('dark').addEventListener('click', () => $('darkness').showModal());
$('light').addEventListener('click', () => $('darkness').close());
document.addEventListener('visibilitychange', want);

if (token) connect();
else $('link').textContent = 'The key is missing: open the page with the code or the address shown on the terminal.';
