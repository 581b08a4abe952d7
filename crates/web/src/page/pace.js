// How large, how good and how often pictures are sent, by the measured round trip: never more than one under way, each small
// enough for its time on the link. The oldest that a picture gets before the next one's pose is known is about two round trips
// and twice that time, and half a second is too old: so the longer the round trip, the smaller the pictures.

// The longer side in pixels, the JPEG quality, and about how many bytes that makes of those of the first.
export const LEVELS = [
  [640, 0.8, 1], [640, 0.65, 0.72], [640, 0.5, 0.56], [480, 0.6, 0.38],
  [480, 0.45, 0.3], [320, 0.6, 0.2], [320, 0.45, 0.16], [320, 0.3, 0.12], [320, 0.2, 0.09],
];
// Milliseconds on the link beyond the round trip of a small message.
const transferMs = (trip) => Math.min(80, Math.max(20, 120 - 0.6 * trip));
const MOST_A_SECOND = 20;
// Better pictures are tried after this many that left room for them.
const PATIENCE = 10;
// It begins in the middle: a slow link is not clogged by the first picture.
const FIRST = 2;

export class Pace {
  constructor() {
    Object.assign(this, { level: FIRST, trip: 0, rate: null, roomy: 0, underWay: null, last: -Infinity });
  }

  get side() { return LEVELS[this.level][0]; }

  get quality() { return LEVELS[this.level][1]; }

  // Whether a picture may be taken at this time, milliseconds.
  mayShoot(now) {
    return this.underWay === null && now - this.last >= 900 / MOST_A_SECOND;
  }

  sent(now, bytes) {
    [this.last, this.underWay] = [now, { now, bytes }];
  }

  // The server has it.
  got(now) {
    if (this.underWay === null) return;
    const { now: sent, bytes } = this.underWay;
    this.underWay = null;
    const rate = bytes / Math.max(now - sent - this.trip, 1);
    this.rate = this.rate === null ? rate : 0.7 * this.rate + 0.3 * rate;
    this.adapt(bytes);
  }

  // The connection is new: what was under way is lost.
  reset() {
    this.underWay = null;
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
