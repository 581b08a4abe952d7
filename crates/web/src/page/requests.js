// The connection over plain requests, where the browser refuses a web socket: one whose answer streams what comes, and
// one after another for what goes. To its user it is like a WebSocket; what it sends, crates/web/src/requests.rs says.

// Requests of texts under way at a time, texts in one, and bytes that may wait: more, and the connection counts as broken.
const UNDER_WAY = 2;
const TOGETHER = 64;
const MOST_BYTES = 256000;
// Length, kind and number before each message of the stream.
const HEAD = 9;
const [TEXT, BINARY] = [1, 2];
// As of a WebSocket.
const [WAITS, OPEN, CLOSED] = [0, 1, 3];

export class Requests {
  // `hello` is the first message.
  constructor(hello) {
    Object.assign(this, { readyState: WAITS, onopen: null, onmessage: null, onclose: null });
    Object.assign(this, { texts: [], bufferedAmount: 0, underWay: 0, numbers: { texts: 0, picture: 0 }, received: 0 });
    this.ends = new AbortController();
    this.run(hello).catch(() => {}).finally(() => this.fail());
  }

  async run(hello) {
    const line = await this.ask('/requests', { method: 'POST', body: hello });
    const text = await line.text();
    if (line.status === 403) this.onmessage?.({ data: text });
    if (!line.ok) return;
    this.at = `/requests/${text}`;
    const stream = await this.ask(`${this.at}/down`);
    if (!stream.ok || !stream.body) return;
    this.readyState = OPEN;
    this.onopen?.();
    const reader = stream.body.getReader();
    let kept = new Uint8Array(0);
    for (let part = await reader.read(); !part.done && this.readyState === OPEN; part = await reader.read()) {
      kept = this.take(joined(kept, part.value));
    }
  }

  // The messages that are complete; returns the bytes behind them.
  take(bytes) {
    const data = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    let at = 0;
    while (at + HEAD <= bytes.length) {
      const [length, kind, number] = [data.getUint32(at, true), data.getUint8(at + 4), data.getUint32(at + 5, true)];
      if (at + HEAD + length > bytes.length) break;
      const payload = bytes.slice(at + HEAD, at + HEAD + length);
      at += HEAD + length;
      if (kind !== TEXT && kind !== BINARY) continue;
      if (number !== this.received) throw new Error('a message is missing');
      this.received += 1;
      this.onmessage?.({ data: kind === TEXT ? new TextDecoder().decode(payload) : payload.buffer });
    }
    return bytes.subarray(at);
  }

  send(data) {
    if (this.readyState !== OPEN) return;
    if (typeof data !== 'string') {
      this.post('picture', data);
      return;
    }
    this.texts.push(data);
    this.bufferedAmount += data.length;
    if (this.bufferedAmount > MOST_BYTES) this.fail();
    this.pump();
  }

  // Texts that came meanwhile go together.
  async pump() {
    if (this.underWay >= UNDER_WAY || this.texts.length === 0) return;
    const batch = this.texts.splice(0, TOGETHER).join('\n');
    this.underWay += 1;
    await this.post('texts', batch);
    this.underWay -= 1;
    this.bufferedAmount = this.texts.reduce((sum, text) => sum + text.length, 0);
    this.pump();
  }

  async post(kind, body) {
    const number = this.numbers[kind];
    this.numbers[kind] += 1;
    try {
      const answer = await this.ask(`${this.at}/${kind}/${number}`, { method: 'POST', body });
      if (!answer.ok) this.fail();
    } catch {
      this.fail();
    }
  }

  ask(path, options = {}) {
    return fetch(path, { cache: 'no-store', signal: this.ends.signal, ...options });
  }

  close() {
    this.readyState = CLOSED;
    this.texts = [];
    this.ends.abort();
  }

  fail() {
    if (this.readyState === CLOSED) return;
    this.close();
    this.onclose?.();
  }
}

function joined(a, b) {
  if (a.length === 0) return b;
  const both = new Uint8Array(a.length + b.length);
  both.set(a);
  both.set(b, a.length);
  return both;
}
