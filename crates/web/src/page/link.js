// The connection to the server, opened again whenever it ends: a web socket, or plain requests where the browser refuses
// that, as an iPhone does before it trusts the server's certificate.
import { Beside } from './beside.js';
import { Requests } from './requests.js';

// After this time without a message the connection counts as lost, even if the browser has not noticed: the server sends
// several pings a second.
const GONE_MS = 3000;
// A slow link may need this long to open a connection.
const OPEN_MS = 10000;
// A web socket that has not opened by then is given up for plain requests.
const REFUSED_MS = 3000;
// More than this still waits on this side: the link is congested.
const CLOGGED = 8000;
const [FIRST_REST_MS, LONGEST_REST_MS] = [300, 5000];
const OPEN = 1;

export class Link {
  // `hello` gives the first message; `opened`, `text`, `bytes`, `counted` (the connections) and `ended` are called with what
  // happens.
  constructor({ hello, opened, text, bytes, counted, ended }) {
    Object.assign(this, { hello, opened, text, bytes, counted, ended });
    this.beside = new Beside({ came: (data) => this.text(data), changed: () => this.counted(this.count) });
    Object.assign(this, { socket: null, heard: 0, rest: FIRST_REST_MS, greeted: false, bySocket: true, copies: 0, besideHello: null });
  }

  get isOpen() { return this.socket?.readyState === OPEN; }

  get isClogged() { return !this.isOpen || this.socket.bufferedAmount > CLOGGED; }

  // Milliseconds since the last message.
  get silence() { return performance.now() - this.heard; }

  // How many connections there are.
  get count() { return 1 + this.beside.sockets.length; }

  // The server has answered: the next connection is tried soon again. `beside` is the first message of those beside this one.
  greet(beside) {
    [this.greeted, this.rest, this.copies, this.besideHello] = [true, FIRST_REST_MS, 0, beside];
    this.counted(this.count);
  }

  // Opens further connections where the link has room for them, and closes them where it no longer has.
  widen(hasRoom) {
    if (hasRoom === this.beside.isOpen || !this.greeted || !this.bySocket) return;
    if (hasRoom) this.beside.open(this.besideHello);
    else {
      this.beside.close();
      this.counted(this.count);
    }
  }

  open() {
    [this.heard, this.greeted] = [performance.now(), false];
    let socket = null;
    try {
      socket = new WebSocket(`wss://${location.host}/ws`);
      socket.binaryType = 'arraybuffer';
    } catch {
      this.request();
      return;
    }
    const refused = () => {
      clearTimeout(late);
      socket.onclose = null;
      socket.close();
      if (socket === this.socket) this.request();
    };
    const late = setTimeout(refused, REFUSED_MS);
    this.use(socket, true, refused, () => {
      clearTimeout(late);
      socket.send(this.hello());
    });
  }

  request() {
    this.heard = performance.now();
    this.use(new Requests(this.hello()), false, () => this.end(), () => {});
  }

  // What happens on this connection, as long as it is the one in use; `refused` is its end before it opened.
  use(socket, bySocket, refused, opened) {
    this.socket = socket;
    const isMine = () => socket === this.socket;
    let wasOpen = false;
    socket.onopen = () => {
      if (!isMine()) return;
      [wasOpen, this.bySocket] = [true, bySocket];
      opened();
      this.opened();
    };
    socket.onmessage = ({ data }) => {
      if (!isMine()) return;
      this.heard = performance.now();
      if (typeof data === 'string') this.text(data);
      else this.bytes(data);
    };
    socket.onclose = () => {
      if (isMine()) wasOpen ? this.end() : refused();
    };
  }

  send(data) {
    if (this.isOpen) this.socket.send(data);
  }

  // A message that a loss on one connection must not hold up: it is taken once, and in order.
  sendCopies(message) {
    if (!this.greeted) {
      this.send(JSON.stringify(message));
      return;
    }
    const text = JSON.stringify({ copy: [this.copies, message] });
    this.copies += 1;
    this.beside.copy(text);
    this.send(text);
  }

  // An image on the nth connection.
  sendOn(on, bytes) {
    const socket = on === 0 ? this.socket : this.beside.sockets[on - 1];
    if (socket?.readyState === OPEN) socket.send(bytes);
  }

  // The connection has closed or fallen silent: another is tried at once, then at growing intervals.
  end() {
    this.close();
    this.ended();
    this.again = setTimeout(() => this.open(), this.rest);
    this.rest = Math.min(2 * this.rest, LONGEST_REST_MS);
  }

  // No connection is there, nor tried again until the next `open`.
  close() {
    clearTimeout(this.again);
    if (this.socket) this.socket.onclose = null;
    this.socket?.close();
    this.socket = null;
    this.beside.close();
  }

  // To be called several times a second.
  watch() {
    if (this.socket && this.silence > (this.greeted ? GONE_MS : OPEN_MS)) this.end();
  }
}
