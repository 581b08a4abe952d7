// The page: its web socket, the status on the screen, and the commands.
import { Camera } from './camera.js';
import { Senses } from './senses.js';
import { Picture, MapView } from './view.js';

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.hash.slice(1)).get('k') || '';
const watchOnly = new URLSearchParams(location.search).has('watch');
// Without a message for this long under guidance, the page says stop: the server sends a status ten times a second.
const SILENT_MS = 1500;

const senses = new Senses({ polite: $('polite'), urgent: $('urgent') });
const picture = new Picture($('picture'));
const map = new MapView($('map'), $('map-words'));
let socket = null;
let me = null;
let controls = false;
let ownCamera = false;
let guiding = false;
let heard = 0;
let told = false;
let rest = 300;

const camera = new Camera($('video'), {
  picture: (bytes) => controls && send(bytes),
  motion: (samples) => controls && send(JSON.stringify({ motion: samples })),
  busy: () => !socket || socket.readyState !== WebSocket.OPEN || socket.bufferedAmount > 200000,
});

function connect() {
  $('link').textContent = 'Connecting.';
  socket = new WebSocket(`wss://${location.host}/ws`);
  socket.binaryType = 'arraybuffer';
  socket.onopen = () => {
    send(JSON.stringify({ hello: { token, walk: !watchOnly } }));
    want();
  };
  socket.onmessage = (event) => {
    heard = performance.now();
    if (typeof event.data === 'string') take(JSON.parse(event.data));
    else picture.draw(event.data);
  };
  socket.onclose = () => {
    lost('The connection is lost.');
    $('link').textContent = 'Not connected. Trying again.';
    me = null;
    control(null);
    setTimeout(connect, rest);
    rest = Math.min(2 * rest, 5000);
  };
}

function send(data) {
  if (socket && socket.readyState === WebSocket.OPEN) socket.send(data);
}

// A hidden page needs neither pictures nor the map; a phone with its own camera needs no copy of it.
function want() {
  const shown = document.visibilityState === 'visible';
  send(JSON.stringify({ want: { picture: shown && !camera.running, map: shown } }));
}

function take(message) {
  const [kind, value] = Object.entries(message)[0];
  const known = { hello, control: (v) => control(v.id), said, sound, did, status, view: (v) => map.take(v), trouble, doubt };
  known[kind]?.(value);
}

function hello({ id, camera }) {
  me = id;
  rest = 300;
  ownCamera = camera === '';
  $('link').textContent = ownCamera ? 'Connected.' : `Connected; the camera is ${camera}.`;
  if (told) senses.say({ text: 'Connected again.', priority: 2 });
  told = false;
}

function control(id) {
  controls = me !== null && id === me;
  const free = me !== null && id === null;
  $('control').textContent = controls ? 'You control this walk.'
    : me === null ? '' : free ? 'Nobody controls this walk.' : 'Someone else controls this walk; you watch.';
  $('take').hidden = !free;
  $('camera').hidden = !(controls && ownCamera) || camera.running;
  for (const button of document.querySelectorAll('[data-command]')) {
    button.setAttribute('aria-disabled', controls ? 'false' : 'true');
  }
}

function said(words) {
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

function trouble(text) {
  $('answer').textContent = text;
  senses.say({ text, priority: 1 });
}

function doubt(text) {
  $('answer').textContent = `Warning: ${text}`;
}

function status(s) {
  guiding = s.guiding !== null;
  told = false;
  set('s-tracking', `${s.words} ${s.tracked} of ${s.frames} frames; ${s.inliers} matches.`);
  const { waits, imu, initialised } = s.engine;
  set('s-phase', waits.length ? `${s.phase}, waits for ${waits.join(', ')}` : s.phase);
  set('s-imu', imu
    ? `${initialised ? '' : 'scale and gravity not known, '}${imu.batch} readings a picture, ${imu.synthesised} interpolated, ${imu.gaps} gaps`
    : 'not used');
  set('s-recording', s.recording
    ? `${s.recording.points} points, ${s.recording.length.toFixed(1)} ${s.metric ? 'metres' : 'units'}, ${s.recording.file}`
      + (s.recording.trouble ? `; not on disk: ${s.recording.trouble}` : '')
    : 'no');
  set('s-route', s.route ? `${s.route.file}, ${s.route.points} points${s.route.here ? '' : ', of another map'}` : 'none');
  set('s-guiding', s.guiding
    ? `${s.guiding.facing}, ${s.guiding.state}, ${s.guiding.along_m.toFixed(1)} of ${s.guiding.length_m.toFixed(1)}${s.metric ? ' metres' : ''}`
    : 'none');
  set('s-scale', s.metric ? 'metres' : 'not known, so no distances are said');
  set('s-map', `${s.key_frames} keyframes, ${s.landmarks} landmarks`);
  // The picture's time is in this page's clock only when the picture is its own.
  const age = camera.running ? performance.timeOrigin + performance.now() - s.frame_ms : NaN;
  const delay = age >= 0 && age < 10000 ? `; picture to state ${age.toFixed(0)} ms` : '';
  set('s-time', `${clock(s.t_s)}, ${s.step_ms.toFixed(1)} ms a picture${delay}, ${s.dropped} dropped`);
  map.camera(s);
}

// Text is only set when it changes, so that a screen reader keeps its place.
function set(id, text) {
  if ($(id).textContent !== text) $(id).textContent = text;
}

// What the server cannot say any more, the page says itself.
function lost(why) {
  if (told || me === null && heard === 0) return;
  told = true;
  const text = guiding || camera.running ? `Stop. ${why}` : why;
  senses.say({ text, priority: 0, interrupts: true });
  write({ text, priority: 0 });
}

setInterval(() => {
  if (me !== null && guiding && performance.now() - heard > SILENT_MS) lost('The computer does not answer.');
}, 300);

function command(line) {
  senses.wake();
  if (!controls) {
    did({ ok: false, text: 'you do not control this walk.' });
    return;
  }
  send(JSON.stringify({ command: line }));
}

document.addEventListener('click', (event) => {
  const button = event.target.closest('[data-command]');
  if (button) command(button.dataset.command);
});

const KEYS = { r: 'record', s: 'stop', l: 'load', g: 'guide home', b: 'guide backwards', h: 'halt', p: 'repeat', i: 'status' };
document.addEventListener('keydown', (event) => {
  const typing = event.target.closest?.('input:not([type=checkbox]):not([type=radio]), textarea, select');
  if (!$('keys').checked || typing || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
  const line = KEYS[event.key.toLowerCase()];
  if (line) {
    event.preventDefault();
    command(line);
  }
});

$('take').addEventListener('click', () => send(JSON.stringify({ take: true })));

$('camera').addEventListener('click', async () => {
  senses.wake();
  try {
    await camera.start();
  } catch (error) {
    did({ ok: false, text: `the camera is not available (${error.name}). Allow it in the browser and try again.` });
    return;
  }
  $('own').hidden = false;
  $('seen').hidden = true;
  $('camera').hidden = true;
  $('commands').focus();
  want();
});

for (const name of ['rate', 'volume', 'sounds', 'vibrate']) {
  const input = $(name);
  const apply = () => senses.set(name, input.type === 'checkbox' ? input.checked : Number(input.value));
  input.addEventListener('change', apply);
  apply();
}
for (const radio of document.querySelectorAll('[name=told]')) {
  radio.addEventListener('change', () => radio.checked && senses.set('told', radio.value));
}

$('dark').addEventListener('click', () => $('darkness').showModal());
$('light').addEventListener('click', () => $('darkness').close());
document.addEventListener('visibilitychange', want);

if (token) connect();
else $('link').textContent = 'The key is missing: open the page with the code or the address shown on the terminal.';
