// The page: its messages, the status on the screen, and the commands.
import { MediaButtons } from './buttons.js';
import { InOrder } from './beside.js';
import { Before } from './before.js';
import { Camera } from './camera.js';
import { gray, jpeg } from './coding.js';
import { Demo } from './demo.js';
import { Files } from './files.js';
import { Here, TurnPace } from './here.js';
import { keep, kept, phone, secret, settings, whenKept } from './kept.js';
import { Link } from './link.js';
import { MapView } from './map.js';
import { Model } from './model.js';
import { Pace } from './pace.js';
import { Pairing } from './pairing.js';
import { KnownPhones } from './phones.js';
import { Practice } from './practice.js';
import { Reader } from './reader.js';
import { MainButton, Noting, RouteList } from './routes.js';
import { Senses } from './senses.js';
import { clock, table } from './state.js';
import { Trust } from './trust.js';
import { Picture } from './view.js';
import { Voices } from './voices.js';
import { Light, watchBattery } from './watch.js';
import { Words } from './words.js';

const $ = (id) => document.getElementById(id);
// The key: in the address, as a bookmark has it, else as this browser keeps it.
let token = new URLSearchParams(location.hash.slice(1)).get('k') || kept.key || '';
// The engine runs in this device where the document says so, else on the server.
const here = document.documentElement.dataset.engine === 'here';
// A simulated walker in place of the camera.
const isDemo = here && new URLSearchParams(location.search).has('demo');
const watchOnly = new URLSearchParams(location.search).has('watch');
// After this time without a message under guidance, the page says stop.
const SILENT_MS = 1500;
// No directions are given from older images; guidance is trusted again when images have been younger for a second.
const STALE_MS = 500;
const BACK_MS = 1000;
// "Stop" is repeated while its reason lasts.
const AGAIN_MS = 3000;
// What helps where the camera does not start, by the browser's name of the reason.
const NO_CAMERA = {
  NotAllowedError: 'page-camera-refused', NotFoundError: 'page-camera-missing', OverconstrainedError: 'page-camera-missing',
  NotReadableError: 'page-camera-busy', AbortError: 'page-camera-busy',
};
// The first byte of a map, of surface, of columns and of files; other bytes are images.
const [MAP, SURFACE, COLUMNS, FILES] = [2, 3, 4, 5];

// The page is in the language that was chosen here, else in the one that the server found best, or that the browser has.
let words = await Words.in(kept.language ?? (here ? navigator.language.slice(0, 2) : document.documentElement.lang)).catch(() => Words.in('en'));
const t = (id, values) => words.text(id, values);

const senses = new Senses({ polite: $('polite'), urgent: $('urgent') });
const picture = new Picture($('picture'));
const map = new MapView($('map'), $('map-words'), {
  t,
  number: (value, decimals) => words.number(value, decimals),
  keys: () => words.viewKeys,
  chosen: () => want(),
});
const model = new Model();
const pace = here ? new TurnPace() : new Pace();
const routes = new RouteList(command, t);
const voices = new Voices();
const noting = new Noting(command, voices, t, refused);
const main = new MainButton(t);
const trust = new Trust((text) => senses.say({ text, priority: 1 }), t);
const media = new MediaButtons(command, t);
const before = new Before(senses, t);
// Something that the page itself has to say: as an answer at once, as news once the voice is free.
const speak = (text, interrupts) => {
  senses.wake();
  senses.say({ text, priority: 1, interrupts });
  write({ text, priority: 1 });
};
const aloud = { say: (text) => speak(text, true), t };
const reader = new Reader(aloud);
const phones = new KnownPhones(aloud);
const practice = new Practice(aloud);
const light = new Light(speak, t);
const pairing = new Pairing({
  ...aloud,
  language: () => words.language,
  paired: (key) => {
    token = key;
    keep('key', key);
    history.replaceState(null, '', `#k=${key}`);
    showLink(['page-connecting']);
    link.open();
  },
});
whenKept(tellKept);
// The newest status; null before the first picture, and while there is no connection.
let latest = null;
let me = null;
let controls = false;
let held = false;
let ownCamera = false;
let guiding = false;
let lastStatus = null;
// Why the link is down, and when that was last said.
let down = null;
let downSaid = -Infinity;
// The page's time of the newest image whose pose is known; whether it is too old, and since when it no longer is.
let frameMs = null;
let late = false;
// What the server says on all connections.
let ordered = new InOrder();
let freshSince = null;

// The page's clock: images are stamped with it, and pings answered.
const clockMs = () => performance.timeOrigin + performance.now();

const toEngine = {
  pace,
  image: (stamp, bytes) => {
    if (!controls || !link.isOpen) return;
    link.sendOn(pace.sent(performance.now(), stamp, bytes.length), bytes);
  },
  motion: (samples) => controls && link.sendCopies({ motion: samples }),
};
const camera = isDemo ? new Demo({
  ...toEngine,
  lens: (pinhole) => link.sendCopies({ lens: pinhole }),
  picture: (width, height, pixels) => picture.gray(width, height, pixels),
  command,
  language: () => words.language,
  ended: (metres) => refused(t('page-demo-ended', { metres: words.number(metres, 1) })),
}) : new Camera($('video'), { ...toEngine, coding: here ? gray : jpeg, clogged: () => link.isClogged, ended: cameraEnded });

const link = new (here ? Here : Link)({
  t,
  hello: () => JSON.stringify({
    hello: {
      token, walk: !watchOnly, ...(isDemo && { demo: true }), secret, origin: performance.timeOrigin, language: words.language, phone,
      zone_min: -new Date().getTimezoneOffset(),
    },
  }),
  opened: want,
  text: (text) => {
    const message = JSON.parse(text);
    for (const due of message.no === undefined ? [message] : ordered.take(message.no, message)) take(due);
  },
  bytes: takeBytes,
  counted: (count) => pace.reset(count),
  ended,
});

const files = new Files({
  give: () => link.sendCopies({ give: true }),
  put: (given) => link.send({ put: given }),
  tell: (ok, text) => {
    did({ ok, text });
    senses.say({ text, priority: 1 });
  },
  t,
  hasRoutes: () => routes.routes.length > 0,
});
$('files').hidden = !here;

function takeBytes(bytes) {
  const [kind] = new Uint8Array(bytes, 0, 1);
  if (kind === MAP) map.take(model.take(bytes));
  else if (kind === SURFACE) map.takeSurface(bytes);
  else if (kind === COLUMNS) map.takeColumns(bytes);
  else if (kind === FILES) files.save(bytes.slice(1));
  else picture.draw(bytes);
}

function ended() {
  if (me !== null || down !== null) lost(here ? 'page-here-failed' : 'page-connection-lost');
  else if (linkNow[0][0] !== 'page-trying-again') senses.say({ text: t('page-trying-again'), priority: 1 });
  showLink(['page-trying-again']);
  me = null;
  ordered = new InOrder();
  latest = null;
  control(null, held);
}

// The line about the connection, kept as ids with their values so that it follows the language.
let linkNow = [['page-connecting']];
function showLink(...sentences) {
  linkNow = sentences;
  set('link', sentences.map(([id, values]) => t(id, values)).join(' '));
}

function send(data) {
  link.send(data);
}

// Without a key no connection is tried.
function pair() {
  link.close();
  showLink(['page-missing-key']);
  pairing.open();
}

function tellKept() {
  if (!here && me !== null) link.sendCopies({ kept: settings() });
}

// A hidden page needs neither images nor the map; a phone that sends its own camera images needs no copy of them.
function want() {
  const shown = document.visibilityState === 'visible';
  send(JSON.stringify({ want: { picture: shown && !camera.running, map: shown, surface: shown && map.wantsSurface, columns: shown && map.wantsColumns } }));
}

function take(message) {
  const [kind, value] = Object.entries(message)[0];
  const known = {
    hello, said, sound, did, status, trouble, doubt, refused, ping,
    ended: () => trouble(t('page-walk-ended')),
    failed: () => trouble(t('page-walk-failed')),
    control: (v) => control(v.id, v.held),
    // On another connection that of a newer image may have come before.
    frame: ({ ms }) => { if (ms === null || frameMs === null || ms > frameMs) frameMs = ms; },
    got: ({ ms }) => {
      pace.got(performance.now(), ms);
      link.widen(pace.hasRoom);
    },
    view: (v) => map.walker(v.camera),
    stored: () => showLink(...link.lines),
    imported: (v) => files.took(v),
    routes: (v) => routes.take(v),
    stranger: () => pair(),
    phones: (v) => phones.take(v),
  };
  known[kind]?.(value);
}

function ping({ n, trip_ms }) {
  send(JSON.stringify({ pong: { n, ms: clockMs() } }));
  if (trip_ms !== null) pace.trip = trip_ms;
}

function hello({ id, camera: name }) {
  me = id;
  link.greet(JSON.stringify({ beside: { token, id, secret } }));
  if (!here) keep('key', token);
  ownCamera = name === '';
  if (here) showLink(...link.lines);
  else showLink([ownCamera ? 'page-connected' : 'page-connected-to', { camera: name }], ...(link.bySocket ? [] : [['page-trust-slow']]));
  const how = link.bySocket ? null : trust.refused();
  if (how !== null) senses.say({ text: t(how), priority: 2 });
  if (lastStatus === null) {
    const id = !ownCamera || camera.running ? 'page-no-picture-yet' : isDemo ? 'page-demo-off' : 'page-camera-off';
    $('state-now').dataset.text = id;
    $('state-now').textContent = t(id);
  }
  // The server's new connection does not know which messages this page found late.
  late = false;
  if (down !== null) {
    down = null;
    senses.drop('link');
    senses.say({ text: t('page-connected-again'), priority: 2 });
  }
}

function control(id, isHeld) {
  const had = controls;
  controls = me !== null && id === me;
  held = isHeld;
  if (controls !== had) pace.reset(link.count);
  if (had && !controls && me !== null) {
    const text = t('page-taken-over');
    senses.say({ text, priority: 0 });
    write({ text, priority: 0 });
  } else if (controls && !had && !isQuiet) {
    senses.say({ text: t('page-controls-now'), priority: 1 });
  }
  if (controls) isQuiet = false;
  if (controls && !had) speakLikeThis();
  showControl(id);
}

function showControl(id) {
  holder = id;
  const free = me !== null && !held;
  const other = me !== null && held && !controls;
  set('control', controls ? t('page-controls')
    : me === null ? '' : free ? t(isDemo ? 'page-demo-off' : ownCamera ? 'page-free-camera' : 'page-free')
      : t(id === null ? 'page-away' : 'page-watching'));
  $('take').hidden = !(other || (free && (watchOnly || !ownCamera)));
  $('take').textContent = t(other ? 'page-take-over' : 'page-take');
  $('camera').hidden = !((controls || (free && !watchOnly)) && ownCamera) || camera.running;
  const may = controls || (free && !watchOnly);
  for (const button of document.querySelectorAll('[data-command]')) {
    button.setAttribute('aria-disabled', may ? 'false' : 'true');
  }
  routes.allow(may);
  showMain();
}

// The main button is there where neither the walk has to be taken nor the camera to be started first.
function showMain() {
  main.show(latest, $('take').hidden && $('camera').hidden && me !== null);
}
let holder = null;
// Control that this page asked for itself needs no announcement the first time.
let isQuiet = true;

function said(words) {
  const isDirection = typeof words.pose_ms === 'number';
  // The server is informed that the direction came too late; it then stops and directs anew.
  const tooOld = () => {
    const old = isDirection && camera.running && clockMs() - words.pose_ms > STALE_MS;
    if (old) becameLate();
    return old;
  };
  if (tooOld() || (late && isDirection)) return;
  // A note in the walker's own voice is heard after its name and side, unless something more important is said.
  if (words.priority < 2) voices.hush();
  senses.say({ ...words, tooOld, after: voices.named(words.text) });
  write(words);
  camera.heard?.(words.text);
}

function write({ text, priority, t_s, language = words.language }) {
  delete $('words').dataset.text;
  $('words').textContent = text;
  $('words').lang = language;
  $('words').classList.toggle('urgent', priority === 0);
  const line = document.createElement('li');
  line.lang = language;
  line.textContent = t_s === undefined ? text : `${clock(t_s)} ${text}`;
  $('log').append(line);
  while ($('log').children.length > 200) $('log').firstChild.remove();
  $('log').scrollTop = $('log').scrollHeight;
}

function sound({ name, bearing_rad }) {
  senses.sound(name, bearing_rad);
}

function did({ text }) {
  $('answer').textContent = text;
}

function refused(text) {
  did({ text });
  senses.say({ text, priority: 1 });
}

function trouble(text) {
  $('answer').textContent = text;
  senses.say({ text, priority: 1, kind: 'trouble' });
}

// For whoever looks after the computer, where it is written too.
function doubt(text) {
  console.warn(text);
}

function status(s) {
  guiding = s.guiding !== null && s.guiding.state !== 'paused';
  latest = s;
  showMain();
  practice.status(s);
  routes.ask(s.question, controls);
  lastStatus = s;
  showState(s);
  $('s-tracking').dataset.frames = s.frames;
  for (const [id, text] of Object.entries(table(s, words))) set(id, text);
  map.camera(s);
  camera.status?.(s);
}

// Text is set only when it changes, so that a screen reader keeps its position.
function set(id, text) {
  delete $(id).dataset.text;
  if ($(id).textContent !== text) $(id).textContent = text;
}

// In large print the last instruction about moving, and the age of the image behind it.
function showState({ headline, alarm, age, language }) {
  set('state-now', late ? t('page-pictures-late') : headline);
  $('state-now').lang = late ? words.language : language;
  $('state-now').classList.toggle('urgent', late || alarm);
  const own = ownAge();
  const seconds = own !== null ? own / 1000 : age?.age_s;
  const shown = { seconds: words.number(Math.max(seconds ?? 0, 0), 1) };
  set('age-now', age === 'unknown' && own === null ? t('page-age-unknown')
    : seconds === undefined ? '' : t(age?.bound_s >= 0.05 && own === null ? 'page-age-about' : 'page-age', shown));
}

// Age of the newest image with a pose, milliseconds; null where this page did not capture it.
function ownAge() {
  return camera.running && controls && frameMs !== null ? clockMs() - frameMs : null;
}

function becameLate() {
  freshSince = null;
  // The server may have said it already, or something equally urgent, and repeats it unless nothing of it arrives.
  const rest = late ? AGAIN_MS + 500 : AGAIN_MS;
  const text = t('page-pictures-late');
  if (!late) {
    late = true;
    link.sendCopies({ late: true });
    set('state-now', text);
    $('state-now').classList.add('urgent');
  }
  if (performance.now() - senses.urgentAt < rest) return;
  senses.say({ text, priority: 0, kind: 'late' });
  write({ text, priority: 0 });
}

function becameFresh() {
  if (!late) return;
  freshSince ??= performance.now();
  if (performance.now() - freshSince < BACK_MS) return;
  late = false;
  senses.drop('late');
  link.sendCopies({ late: false });
}

// When the server can no longer say something, the page says it itself, repeatedly while the reason lasts.
function lost(why) {
  down = why;
  if (performance.now() - downSaid < AGAIN_MS) return;
  downSaid = performance.now();
  const stops = { 'page-connection-lost': 'page-connection-lost-stop', 'page-no-answer': 'page-no-answer-stop', 'page-here-failed': 'page-here-failed-stop' };
  const text = t(guiding || camera.running ? stops[why] : why);
  set('state-now', text);
  $('state-now').classList.add('urgent');
  set('age-now', '');
  for (const id of ['s-tracking', 's-phase', 's-imu', 's-recording', 's-guiding', 's-time']) set(id, t('page-unknown-offline'));
  senses.say({ text, priority: 0, interrupts: true, kind: 'link' });
  write({ text, priority: 0 });
}

setInterval(() => {
  link.watch();
  const { silence } = link;
  if (me !== null && guiding && silence > SILENT_MS && ownAge() === null) lost('page-no-answer');
  else if (me !== null && silence < SILENT_MS && down !== null) {
    down = null;
    senses.drop('link');
  }
  if (down !== null && (guiding || camera.running)) lost(down);
  const age = ownAge();
  if (me !== null && guiding && age !== null && age > STALE_MS) becameLate();
  else if (age !== null) becameFresh();
}, 100);

setInterval(() => {
  if (camera.running && controls && camera.meanGray) light.look(camera.meanGray());
}, 1000);

// A call or another program has taken the camera.
function cameraEnded() {
  refused(t('page-camera-ended'));
  showControl(holder);
}

let touched = false;
function command(line) {
  senses.wake();
  // A page may play sound only once it has been touched.
  if (!touched && $('media').checked) media.set(true);
  touched = true;
  if (me === null) {
    refused(t('page-connection-lost-retry'));
    return;
  }
  if (held && !controls) {
    refused(t('page-other-holds'));
    return;
  }
  if (ownCamera && !camera.running && !lastStatus?.frames) {
    refused(t(isDemo ? 'page-demo-off' : 'page-camera-off'));
    return;
  }
  main.commanded();
  link.sendCopies({ command: line });
}

document.addEventListener('click', (event) => {
  const button = event.target.closest('[data-command]');
  if (button?.dataset.command) command(button.dataset.command);
});

document.addEventListener('keydown', (event) => {
  const typing = event.target.closest?.('input:not([type=checkbox]):not([type=radio]), textarea, select');
  if (!$('keys').checked || typing || event.ctrlKey || event.altKey || event.metaKey || event.repeat) return;
  // A dialog has its own keys.
  if (document.querySelector('dialog.small[open]')) return;
  const key = event.key.toLowerCase();
  const line = /^[1-9]$/.test(key) ? `load ${key}` : words.keys[key];
  if (line === 'note') {
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
  else link.sendCopies({ take: true });
});
$('over').addEventListener('click', () => {
  $('ask').close();
  link.sendCopies({ takeover: true });
});
$('leave').addEventListener('click', () => $('ask').close());

$('camera').addEventListener('click', async () => {
  senses.wake();
  try {
    await camera.start();
  } catch (error) {
    refused(t(isDemo ? 'page-demo-failed' : NO_CAMERA[error.name] ?? 'page-camera-failed'));
    return;
  }
  link.sendCopies({ take: true });
  $('own').hidden = isDemo;
  $('seen').hidden = !isDemo;
  $('camera').hidden = true;
  showMain();
  $('commands').focus();
  want();
});

for (const name of ['volume', 'sounds', 'vibrate', 'keys', 'media']) {
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

// How the walker wants to be spoken to: applied to guidance by the page that holds the walk, each time it gets it.
function speakLikeThis() {
  const unit = $('unit').value === 'steps' ? `steps ${Number($('step').value) / 100}` : $('unit').value;
  const lines = [`language ${words.language}`, `unit ${unit}`, `directions ${$('directions').value}`, `speed ${$('speed').value}`];
  link.sendCopies({ settings: { language: words.language, lines: lines.map((line) => `set ${line}`) } });
}

function showSpeaking() {
  $('speed-shown').textContent = $('speed').value;
  $('step-line').hidden = $('unit').value !== 'steps';
  // A browser's voice says about 180 words a minute at rate 1.
  senses.set('rate', Number($('speed').value) / 180);
}

for (const name of ['speed', 'unit', 'step', 'directions']) {
  $(name).value = kept[name] ?? words.speaking[name];
  $(name).addEventListener('change', () => {
    if (!$(name).checkValidity()) return;
    keep(name, $(name).value);
    showSpeaking();
    speakLikeThis();
  });
}
showSpeaking();

// Everything on the page in the chosen language.
function showWords() {
  words.show(document);
  senses.set('language', words.language);
  showLink(...linkNow);
  showControl(holder);
  $('keys-shown').textContent = t('page-keys', { keys: Object.keys(words.keys).join(', ').toUpperCase() });
  for (const button of document.querySelectorAll('[data-command]')) {
    const key = Object.keys(words.keys).find((k) => words.keys[k] === button.dataset.command);
    button.querySelector('kbd')?.remove();
    // The commands of these two change.
    if (!key || button.id === 'main' || button.id === 'other') continue;
    const shown = document.createElement('kbd');
    shown.ariaHidden = 'true';
    shown.textContent = key.toUpperCase();
    button.append(' ', shown);
  }
  routes.show();
  trust.show(words.authority);
  map.take(map.view);
  showMain();
  practice.show();
  if (lastStatus !== null) status(lastStatus);
}

for (const [code, name] of words.languages) $('language').append(new Option(name, code, false, code === words.language));
for (const option of $('language').options) option.lang = option.value;
$('language').addEventListener('change', async () => {
  words = await Words.in($('language').value).catch(() => words);
  did({ text: '' });
  keep('language', words.language);
  showWords();
  speakLikeThis();
});
showWords();

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
document.addEventListener('visibilitychange', () => {
  want();
  // The camera of a hidden page stands still.
  if (here && guiding && document.visibilityState === 'hidden') becameLate();
});

$('demo').hidden = !('demo' in document.documentElement.dataset) || isDemo;
$('demo-leave').hidden = !isDemo;
if (isDemo) $('camera').dataset.text = 'page-demo-start';
words.show(document);
// What is asked at the first start comes before what is said then.
if (!watchOnly && !isDemo) {
  await reader.ask();
  before.first();
  // A browser speaks only once the page was touched.
  $('camera').addEventListener('click', () => watchBattery(speak, t), { once: true });
}
if (token || here) link.open();
else pair();
