// Connections beside the first, so that a segment lost on one of them holds up nothing on the others. They belong to the page that
// the server has greeted on the first, and end with it; where one fails the page goes on without.

// How many, and the pause before one that has failed is opened again.
const COUNT = 2;
const AGAIN_MS = 2000;
// Messages that may wait for an earlier one.
const MOST_EARLY = 256;
const OPEN = 1;

export class Beside {
  // All sockets, and those that the server has let in. `came` is called with each message, `changed` when there are more connections or fewer.
  constructor({ came, changed }) {
    Object.assign(this, { came, changed, all: [], sockets: [], hello: null });
  }

  get isOpen() { return this.hello !== null; }

  // The server has greeted the page, and the link has room for them: `hello` is the first message of each.
  open(hello) {
    this.close();
    this.hello = hello;
    for (let k = 0; k < COUNT; k += 1) this.openOne(hello);
  }

  openOne(hello) {
    if (hello !== this.hello) return;
    const socket = new WebSocket(`wss://${location.host}/ws`);
    socket.onopen = () => socket.send(hello);
    socket.onmessage = ({ data }) => {
      if (hello !== this.hello) return;
      // The first answer says that it is this page's.
      if (this.sockets.includes(socket)) this.came(data);
      else {
        this.sockets.push(socket);
        this.changed();
      }
    };
    socket.onclose = () => {
      if (hello !== this.hello) return;
      if (this.sockets.includes(socket)) {
        this.sockets = this.sockets.filter((one) => one !== socket);
        this.changed();
      }
      setTimeout(() => this.openOne(hello), AGAIN_MS);
    };
    this.all = [...this.all.filter((one) => one.readyState <= OPEN), socket];
  }

  close() {
    this.hello = null;
    for (const socket of this.all) socket.close();
    [this.all, this.sockets] = [[], []];
  }

  // On all of them; the first connection carries it too.
  copy(text) {
    for (const socket of this.sockets) if (socket.readyState === OPEN) socket.send(text);
  }
}

// Messages that come on several connections: each is taken once, and in order.
export class InOrder {
  constructor() {
    Object.assign(this, { next: 0, early: new Map() });
  }

  // The messages that can be taken now that this one came.
  take(number, message) {
    if ((number >= this.next && this.early.size < MOST_EARLY) || number === this.next) this.early.set(number, message);
    const due = [];
    while (this.early.has(this.next)) {
      due.push(this.early.get(this.next));
      this.early.delete(this.next);
      this.next += 1;
    }
    return due;
  }
}
