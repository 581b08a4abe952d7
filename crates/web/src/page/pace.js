// Size, quality and rate of the images sent, chosen by the measured round trip: never more than one on its way to the
// server, each small enough for its time on the link. The next one is captured when the last one was received, or should
// have been by now; the server's word of it takes half a round trip more, and is waited for only when the word of the
// image before has not come. So the greatest age of an image before the pose of the next one is known is about one and a
// half round trips plus twice its time on the link, and half a second is too old: the longer the round trip, the smaller
// the images.

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

export class Pace {
  constructor() {
    Object.assign(this, { level: FIRST, trip: 0, rate: null, roomy: 0, last: -Infinity, free: -Infinity, unconfirmed: [] });
  }

  get side() { return LEVELS[this.level][0]; }

  get quality() { return LEVELS[this.level][1]; }

  // Whether an image may be captured at this time, milliseconds.
  mayShoot(now) {
    return now - this.last >= 900 / MOST_A_SECOND && this.hasArrived(now);
  }

  // Whether the image sent last is at the server by now.
  hasArrived(now) {
    if (this.unconfirmed.length === 0) return true;
    if (this.unconfirmed.length > 1 || this.rate === null) return false;
    const [{ now: sent, bytes }] = this.unconfirmed;
    return now >= Math.max(sent, this.free) + bytes / this.rate + this.trip / 2;
  }

  // An image with this time stamp has been sent.
  sent(now, stamp, bytes) {
    this.last = now;
    this.unconfirmed.push({ now, stamp, bytes });
  }

  // The server has received the image with this time stamp. One before it that it has not named was overtaken.
  got(now, stamp) {
    const image = this.unconfirmed.filter((one) => one.stamp <= stamp).pop();
    if (!image) return;
    this.unconfirmed = this.unconfirmed.filter((one) => one.stamp > stamp);
    // The link was this image's once the one before had left it.
    const took = now - this.trip - Math.max(image.now, this.free);
    this.free = now - this.trip;
    const rate = image.bytes / Math.max(took, 1);
    this.rate = this.rate === null ? rate : 0.7 * this.rate + 0.3 * rate;
    this.adapt(image.bytes);
  }

  // The connection is new: images in flight are lost.
  reset() {
    this.unconfirmed = [];
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
