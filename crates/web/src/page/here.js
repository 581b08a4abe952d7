// The link to an engine in this device: as `Link` to its user, but what it carries goes to a worker of this page.

// Images a second and the longer side in pixels: what phones of today track with mapping in the same thread.
const [RATE_HZ, SIDE] = [15, 480];

export class Here {
  // As of `Link`; `t` gives the page's sentences.
  constructor({ hello, opened, text, bytes, ended, t }) {
    Object.assign(this, { hello, opened, text, bytes, ended, t, worker: null, heard: 0, isStored: false });
    Object.assign(this, { count: 1, bySocket: true });
  }

  get isOpen() { return this.worker !== null; }

  get isClogged() { return !this.isOpen; }

  // Milliseconds since the last message.
  get silence() { return performance.now() - this.heard; }

  // What the page says of its link, as ids with their values.
  get lines() { return this.isStored ? [['page-here'], ['page-here-stored']] : [['page-here']]; }

  open() {
    this.heard = performance.now();
    const worker = new Worker('worker.js', { type: 'module' });
    worker.onmessage = ({ data }) => {
      if (worker !== this.worker) return;
      this.heard = performance.now();
      if (data instanceof ArrayBuffer) this.bytes(data);
      else this.text(JSON.stringify(data.id ? { [data.kind]: this.t(data.id, data.values) } : data));
    };
    worker.onerror = (error) => {
      console.error(error.message);
      if (worker === this.worker) this.end();
    };
    this.worker = worker;
    this.send(this.hello());
    this.opened();
    this.store();
  }

  // Asks the browser to keep the files of the page and what the walker records.
  async store() {
    await navigator.storage?.persist?.().catch(() => false);
    if (!navigator.serviceWorker) return;
    await navigator.serviceWorker.register('service.js').catch(() => null);
    await navigator.serviceWorker.ready;
    this.isStored = true;
    this.text(JSON.stringify({ stored: true }));
  }

  greet() {}

  widen() {}

  watch() {}

  send(data) {
    this.worker?.postMessage(data);
  }

  sendCopies(message) {
    this.send(JSON.stringify(message));
  }

  sendOn(_, bytes) {
    this.worker?.postMessage(bytes, [bytes.buffer]);
  }

  // A worker that has failed keeps nothing but its files: the walker is told, and begins anew with them.
  end() {
    this.worker.terminate();
    this.worker = null;
    this.ended();
    setTimeout(() => this.open(), 1000);
  }
}

// When the next image is due: the engine takes one at a time, so that none waits and grows old.
export class TurnPace {
  constructor() {
    Object.assign(this, { side: SIDE, quality: 1, trip: 0, hasRoom: false, waits: false, last: -Infinity });
  }

  mayShoot(now) { return !this.waits && now - this.last >= 900 / RATE_HZ; }

  sent(now) {
    [this.waits, this.last] = [true, now];
    return 0;
  }

  got() { this.waits = false; }

  reset() { this.waits = false; }
}
