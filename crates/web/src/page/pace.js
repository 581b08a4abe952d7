// Size, quality and rate of the images sent, and on which connection, chosen by the measured round trip.
//
// With one connection: never more than one image on its way to the server, each small enough for its time on the link. The next one
// is captured when the last one was received, or should have been by now; the server's word of it takes half a round trip more, and
// is waited for only when the word of the image before has not come. So the greatest age of an image before the pose of the next
// one is known is about one and a half round trips plus twice its time on the link, and half a second is too old: the longer the
// round trip, the smaller the images.
//
// With several connections: never more than one image on the link. The next one is captured when the last one should have left
// it, and goes on the connection after that of the last. One whose image is not confirmed in time waits for what was lost:
// images go on the others, so that a loss costs an image and not the time until it is repaired. While all wait none is sent.

// The longer side in pixels, the JPEG quality, and the approximate number of bytes as a share of the first level's.
export const LEVELS = [
  [640, 0.8, 1], [640, 0.65, 0.72], [640, 0.5, 0.56], [480, 0.6, 0.38],
  [480, 0.45, 0.3], [320, 0.6, 0.2], [320, 0.45, 0.16], [320, 0.3, 0.12], [320, 0.2, 0.09],
];
// Milliseconds on the link in addition to the round trip of a small message.
const transferMs = (trip) => Math.min(80, Math.max(20, 120 - 0.4 * trip));
const MOST_A_SECOND = 20;
// A better level is tried after this many images that left room for it.
const PATIENCE = 10;
// Starts at the middle level, so that the first image does not congest a slow link.
const FIRST = 2;
// An image that the server confirms later than this after it was expected to was lost on the way: milliseconds, and a share of
// the round trip.
const [OVERDUE_MS, OVERDUE_TRIPS] = [40, 0.25];

// From this rate on, bytes a millisecond, a link has room for several connections, and no longer below this: copies of what must
// not wait take 50 kbit/s, and an image is most of what a slow link carries in its time.
const ROOM_RATES = [32, 26];
// By how much the shortest round trip may grow from one image to the next. Round trips are long, too, while the page's own images
// wait, and a rate computed with them is far too large.
const LONGER = 1.02;

export class Pace {
  constructor() {
    Object.assign(this, { level: FIRST, trip: 0, rate: null, sample: null, least: null, leastSample: null, shortest: Infinity, heard: -Infinity, roomy: 0, free: -Infinity });
    Object.assign(this, { last: -Infinity, lastOn: 0, connections: 1, newest: -Infinity, unconfirmed: [] });
  }

  get side() { return LEVELS[this.level][0]; }

  get quality() { return LEVELS[this.level][1]; }

  // Whether the link is fast enough for several connections; one that has them keeps them a little longer.
  get hasRoom() { return this.least !== null && this.least >= ROOM_RATES[this.connections > 1 ? 1 : 0]; }

  // Whether an image may be captured at this time, milliseconds.
  mayShoot(now) {
    return now - this.last >= 900 / MOST_A_SECOND && this.connection(now) !== null;
  }

  // The connection on which an image may leave; none while the link is not free for it, and while all connections wait for one
  // that was lost.
  connection(now) {
    if (this.rate === null) return this.unconfirmed.length === 0 ? 0 : null;
    let free = this.free;
    const waits = new Set();
    for (const one of this.unconfirmed) {
      free = Math.max(free, one.now) + one.bytes / this.rate;
      if (now - free > this.trip * (1 + OVERDUE_TRIPS) + OVERDUE_MS) waits.add(one.on);
    }
    const count = this.unconfirmed.length;
    if (this.connections === 1) return count === 0 || (count === 1 && now - free >= this.trip / 2) ? 0 : null;
    if (count > 0 && now < free) return null;
    for (let k = 1; k <= this.connections; k += 1) {
      const on = (this.lastOn + k) % this.connections;
      if (!waits.has(on)) return on;
    }
    return null;
  }

  // An image with this time stamp is sent: the connection on which it has to leave.
  sent(now, stamp, bytes) {
    const on = this.connection(now) ?? (this.lastOn + 1) % this.connections;
    [this.last, this.lastOn] = [now, on];
    this.unconfirmed.push({ now, stamp, bytes, on });
    return on;
  }

  // The server has received the image with this time stamp. One before it on the same connection that it has not named was
  // overtaken.
  got(now, stamp) {
    const image = this.unconfirmed.find((one) => Math.abs(one.stamp - stamp) <= 1e-3);
    if (!image) return;
    this.unconfirmed = this.unconfirmed.filter((one) => one.stamp > image.stamp || one.on !== image.on);
    // One that comes after a later one was lost on the way, and tells nothing of the link.
    if (this.newest > stamp) return;
    this.newest = stamp;
    this.lookForRoom(now, image);
    // The link was this image's once the one before had left it.
    const took = now - this.trip - Math.max(image.now, this.free);
    this.free = now - this.trip;
    const rate = image.bytes / Math.max(took, 1);
    // Two that took much longer than the average: the link has become slow. One was held up.
    const best = Math.max(rate, this.sample ?? rate);
    this.sample = rate;
    if (this.rate === null) this.rate = rate;
    else this.rate = best < 0.5 * this.rate ? best : 0.7 * this.rate + 0.3 * rate;
    this.adapt(image.bytes);
  }

  // An image has been received: the rate of the link, as it is at least.
  lookForRoom(now, image) {
    if (this.trip > 0) {
      this.shortest = Math.min(LONGER * this.shortest, this.trip);
      const took = Math.min(now - this.heard, now - image.now - this.shortest);
      const sample = image.bytes / Math.max(took, 1);
      // What was held up comes together with what came after it.
      const least = Math.min(sample, this.leastSample ?? sample);
      this.leastSample = sample;
      this.least = this.least === null ? least : 0.7 * this.least + 0.3 * least;
    }
    this.heard = now;
  }

  // There are so many connections now, and what was on its way is lost.
  reset(connections) {
    Object.assign(this, { connections, lastOn: 0, newest: -Infinity, unconfirmed: [] });
  }

  adapt(bytes) {
    const budget = this.rate * transferMs(this.trip);
    const whole = bytes / LEVELS[this.level][2];
    if (bytes > 1.1 * budget) {
      this.roomy = 0;
      while (this.level < LEVELS.length - 1 && whole * LEVELS[this.level][2] > budget) this.level += 1;
    } else if (this.level > 0 && whole * LEVELS[this.level - 1][2] < 0.7 * budget) {
      this.roomy += 1;
      if (this.roomy >= PATIENCE) [this.roomy, this.level] = [0, this.level - 1];
    } else {
      this.roomy = 0;
    }
  }
}
