// The demo, in place of the camera: a simulated walker goes out while the page records, and comes back by the page's words alone.

import { GRAY_HEAD } from './coding.js';

// The walk: its world, and how far out. The walker stands for the first images, and a moment before turning back.
const [SEED, METRES, STANDS_MS] = [1, 15, 1500];
const TICK_MS = 5;

export class Demo {
  // As of `Camera`; `command` takes a line, `picture` draws an image, `ended` takes the metres from the start.
  constructor({ image, motion, pace, lens, picture, command, language, ended }) {
    Object.assign(this, { image, motion, pace, lens, picture, command, language, ended, running: false, asked: false });
    this.phase = 'stands';
  }

  // Resolves once the walker stands at the start.
  start() {
    this.worker = new Worker('walker.js', { type: 'module' });
    return new Promise((done, failed) => {
      this.worker.onerror = failed;
      this.worker.onmessage = ({ data }) => {
        const [kind, value] = Object.entries(data)[0];
        if (kind === 'failed') failed(new Error(value));
        if (kind === 'ready') {
          this.lens(value.pinhole);
          Object.assign(this, { running: true, out_ms: 1000 * value.out_s, due: performance.now() + STANDS_MS });
          setInterval(() => this.ask(), TICK_MS);
          done();
        }
        if (kind === 'motion') this.motion(value);
        if (kind === 'image') this.took(value);
        if (kind === 'where') this.ended(value);
      };
      this.worker.postMessage({ begin: { seed: SEED, metres: METRES } });
    });
  }

  ask() {
    if (this.asked || !this.pace.mayShoot(performance.now())) return;
    this.asked = true;
    this.worker.postMessage({ take: true });
  }

  took({ ms, bytes }) {
    this.asked = false;
    const head = new DataView(bytes.buffer);
    this.picture(head.getUint32(8, true), head.getUint32(12, true), bytes.subarray(GRAY_HEAD));
    this.image(ms, bytes);
  }

  heard(text) {
    if (this.phase === 'home') this.worker.postMessage({ hear: text });
  }

  // What comes next, by the newest status.
  status({ frames, recording, guiding }) {
    const now = performance.now();
    if (!this.running || now < this.due) return;
    if (this.phase === 'stands' && frames > 0) {
      this.next('out', 'record', this.out_ms + STANDS_MS);
      this.worker.postMessage({ out: true });
    } else if (this.phase === 'out' && recording) this.next('turns', 'stop', STANDS_MS);
    else if (this.phase === 'turns' && !recording) {
      this.worker.postMessage({ home: this.language() });
      this.next('home', 'guide', STANDS_MS);
    } else if (this.phase === 'home' && !guiding) this.next('ends', null, 2 * STANDS_MS);
    else if (this.phase === 'ends') {
      this.phase = 'ended';
      this.worker.postMessage({ where: true });
    }
  }

  next(phase, line, wait_ms) {
    Object.assign(this, { phase, due: performance.now() + wait_ms });
    if (line) this.command(line);
  }
}
