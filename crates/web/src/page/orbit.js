// The view of the map: turned around a point by finger, mouse, wheel and keys, and walked through by keys. It eases to where
// it is to be, and is there at once for people who prefer reduced motion.

const EASE_MS = 120;
const FIELD = 0.9;
// A step, as a share of what is seen.
const STEP = 0.05;
const STILL = matchMedia('(prefers-reduced-motion: reduce)');

const sub = (a, b) => a.map((v, i) => v - b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };

// Two directions in the ground, the second to the left of the first as seen from above, and up.
export function ground(up) {
  const high = unit(up);
  const side = unit(cross(Math.abs(high[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], high));
  return [side, cross(high, side), high];
}

export class Orbit {
  // `changed` is called when the view is to be drawn again; `keys` gives what each key does, by its name.
  constructor(canvas, changed, keys) {
    Object.assign(this, { canvas, changed, keys, yaw: 0.6, pitch: 0.9, zoom: 1, aside: [0, 0], walked: [0, 0, 0], size: 1, shown: null, fingers: new Map() });
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('pointerdown', (event) => this.down(event));
    canvas.addEventListener('pointermove', (event) => this.drag(event));
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, (event) => this.fingers.delete(event.pointerId));
    canvas.addEventListener('wheel', (event) => { event.preventDefault(); this.grow(Math.exp(-0.0015 * event.deltaY)); }, { passive: false });
  }

  key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const act = this.keys()[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (act?.turn) this[event.shiftKey ? 'move' : 'turn'](...act.turn);
    else if (act?.grow) this.grow(act.grow);
    else if (act?.walk) this.walk(...act.walk);
    else if (act?.all) this.reset();
    else return;
    event.preventDefault();
    // Some of these keys are commands elsewhere on the page.
    event.stopPropagation();
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.fingers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  // One finger turns; two move, and change the size.
  drag(event) {
    const before = this.fingers.get(event.pointerId);
    if (!before) return;
    const now = [event.clientX, event.clientY];
    const [dx, dy] = sub(now, before);
    const others = [...this.fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
    this.fingers.set(event.pointerId, now);
    if (others.length === 0 && !event.shiftKey) {
      this.turn(0.01 * dx, 0.01 * dy);
      return;
    }
    const height = this.canvas.clientHeight || 1;
    this.move(-dx / height / (others.length + 1), dy / height / (others.length + 1));
    if (others.length) this.grow(Math.hypot(...sub(now, others[0])) / (Math.hypot(...sub(before, others[0])) || 1));
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(0, Math.min(Math.PI / 2, this.pitch + pitch));
    this.changed();
  }

  // By a share of what is seen, to the right and up on the screen.
  move(right, up) {
    this.aside = [this.aside[0] + right / this.zoom, this.aside[1] + up / this.zoom];
    this.changed();
  }

  // Steps along the ground as the view is turned, and up.
  walk(right, up, ahead) {
    const step = (STEP * this.size) / this.zoom;
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const by = [c * right + s * ahead, c * ahead - s * right, up];
    this.walked = this.walked.map((v, i) => v + step * by[i]);
    this.changed();
  }

  grow(by) {
    this.zoom = Math.max(0.2, Math.min(40, this.zoom * by));
    this.changed();
  }

  reset() {
    Object.assign(this, { yaw: 0.6, pitch: 0.9, zoom: 1, aside: [0, 0], walked: [0, 0, 0] });
    this.changed();
  }

  // Where the view is to be: around `target`, so that `size` is seen whole at zoom one. Returns whether it still moves.
  aim(target, size, up) {
    const now = performance.now();
    this.size = size;
    const walked = ground(up).reduce((at, axis, k) => at.map((v, i) => v + this.walked[k] * axis[i]), target);
    const wish = [...walked, Math.log(size / this.zoom), this.yaw, this.pitch, ...this.aside.map((v) => v * size)];
    const share = !this.shown || STILL.matches ? 1 : 1 - Math.exp(-Math.min(now - this.at, 50) / EASE_MS);
    this.at = now;
    this.shown = this.shown ? this.shown.map((v, i) => v + share * (wish[i] - v)) : wish;
    const left = Math.max(...sub(wish, this.shown).map(Math.abs));
    const moves = left > 1e-3;
    if (!moves) this.shown = wish;
    this.look(up);
    return moves;
  }

  look(up) {
    const [x, y, z, logSize, yaw, pitch, right, high] = this.shown;
    const [side, ahead, top] = ground(up);
    const [c, s, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    const across = side.map((v, i) => c * v - s * ahead[i]);
    const away = side.map((v, i) => c * ahead[i] + s * v);
    // The eye looks down by `pitch`.
    const into = away.map((v, i) => cp * v - sp * top[i]);
    this.into = into;
    const upward = away.map((v, i) => sp * v + cp * top[i]);
    const middle = [x, y, z].map((v, i) => v + right * across[i] + high * upward[i]);
    this.distance = Math.exp(logSize) / FIELD;
    const eye = middle.map((v, i) => v - this.distance * into[i]);
    const aspect = (this.canvas.clientWidth || 4) / (this.canvas.clientHeight || 3);
    const focal = 1 / Math.tan(FIELD / 2);
    const [near, far] = [0.02 * this.distance, 20 * this.distance];
    const [a, b] = [(far + near) / (far - near), (-2 * far * near) / (far - near)];
    const rows = [
      [...across.map((v) => (v * focal) / aspect), (-dot(across, eye) * focal) / aspect],
      [...upward.map((v) => v * focal), -dot(upward, eye) * focal],
      [...into.map((v) => a * v), -a * dot(into, eye) + b],
      [...into, -dot(into, eye)],
    ];
    this.matrix = new Float32Array([0, 1, 2, 3].flatMap((k) => rows.map((row) => row[k])));
    // Pixels of the screen for one unit of the map at the middle.
    this.pixels = (focal * (this.canvas.clientHeight || 1)) / 2 / this.distance;
  }
}
