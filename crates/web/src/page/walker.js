// A simulated walker with a phone, in a worker: images and readings out as a phone gives them, words in.

import { GRAY_HEAD } from './coding.js';
import { Engine } from './engine.mjs';

const TICK_MS = 8;
const clockMs = () => performance.timeOrigin + performance.now();

// The module, when the walk began, and whether the page takes an image.
const walk = { module: null, began: 0, size: [0, 0], takes: false };

const seconds = () => (clockMs() - walk.began) / 1000;
const memory = () => walk.module.exports.memory.buffer;
const numbers = (count) => [...new Float64Array(memory(), walk.module.exports.walk_numbers(), count)];

function write(text) {
  const bytes = new TextEncoder().encode(text);
  new Uint8Array(memory(), walk.module.exports.walk_text(bytes.length), bytes.length).set(bytes);
}

async function begin({ seed, metres }) {
  walk.module = await Engine.start(await WebAssembly.compile(await (await fetch('walker.wasm')).arrayBuffer()));
  const [width, height, focal, cx, cy, out_s] = numbers(walk.module.exports.walk_begin(seed, metres));
  [walk.size, walk.began] = [[width, height], clockMs()];
  setInterval(step, TICK_MS);
  postMessage({ ready: { pinhole: [focal, focal, cx, cy], out_s } });
}

function step() {
  const { exports } = walk.module;
  const values = numbers(exports.walk_readings(seconds()));
  const readings = [];
  while (values.length > 0) {
    const [t, ...reading] = values.splice(0, 7);
    readings.push([walk.began + 1000 * t, ...reading]);
  }
  if (readings.length > 0) postMessage({ motion: readings });
  if (!walk.takes) return;
  const at = exports.walk_draw(seconds());
  if (at < 0) return;
  walk.takes = false;
  const [width, height] = walk.size;
  const bytes = new Uint8Array(GRAY_HEAD + width * height);
  const [head, ms] = [new DataView(bytes.buffer), walk.began + 1000 * at];
  head.setFloat64(0, ms, true);
  head.setUint32(8, width, true);
  head.setUint32(12, height, true);
  bytes.set(new Uint8Array(memory(), exports.walk_image(), width * height), GRAY_HEAD);
  postMessage({ image: { ms, bytes } }, [bytes.buffer]);
}

const known = {
  begin: (value) => begin(value).catch((error) => postMessage({ failed: error.message })),
  take: () => { walk.takes = true; },
  out: () => walk.module.exports.walk_set_out(seconds()),
  home: (language) => {
    write(language);
    walk.module.exports.walk_follow_words();
  },
  hear: (text) => {
    write(text);
    walk.module.exports.walk_hear();
  },
  where: () => postMessage({ where: walk.module.exports.walk_from_start_m() }),
};

onmessage = ({ data }) => {
  const [kind, value] = Object.entries(data)[0];
  known[kind](value);
};
