// Drawing: the image with its features, and the map with the route in three dimensions, on plain canvases.

const LITTLE = true;

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
  }

  // Kind, width, height, count, a padding byte; pairs of coordinates; gray rows.
  draw(buffer) {
    const data = new DataView(buffer);
    if (data.byteLength < 8 || data.getUint8(0) !== 1) return;
    const [w, h, n] = [1, 3, 5].map((at) => data.getUint16(at, LITTLE));
    const gray = new Uint8Array(buffer, 8 + 4 * n);
    if (gray.length < w * h) return;
    const { canvas } = this;
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const ctx = canvas.getContext('2d', { alpha: false });
    const image = ctx.createImageData(w, h);
    const px = new Uint32Array(image.data.buffer);
    for (let i = 0; i < w * h; i += 1) px[i] = 0xff000000 | (gray[i] * 0x010101);
    ctx.putImageData(image, 0, 0);
    ctx.fillStyle = '#7be0a0';
    for (let i = 0; i < n; i += 1) {
      ctx.fillRect(data.getUint16(8 + 4 * i, LITTLE) - 1, data.getUint16(10 + 4 * i, LITTLE) - 1, 2, 2);
    }
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const n = Math.hypot(...a) || 1; return a.map((v) => v / n); };

export class MapView {
  // `t` gives a sentence of the page by its id and values.
  constructor(canvas, words, t) {
    Object.assign(this, { canvas, words, t, yaw: 0.6, pitch: 1.0, zoom: 1, view: null });
    canvas.addEventListener('keydown', (event) => this.key(event));
    canvas.addEventListener('pointerdown', (event) => { this.from = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener('pointerup', () => { this.from = null; });
    canvas.addEventListener('pointermove', (event) => this.drag(event));
    canvas.addEventListener('wheel', (event) => { event.preventDefault(); this.grow(event.deltaY < 0 ? 1.1 : 1 / 1.1); }, { passive: false });
  }

  key(event) {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
    if (turns[event.key]) this.turn(...turns[event.key]);
    else if (event.key === '+' || event.key === '=') this.grow(1.2);
    else if (event.key === '-') this.grow(1 / 1.2);
    else return;
    event.preventDefault();
  }

  drag(event) {
    if (!this.from) return;
    this.turn((event.clientX - this.from[0]) * 0.01, (event.clientY - this.from[1]) * 0.01);
    this.from = [event.clientX, event.clientY];
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(0, Math.min(Math.PI / 2, this.pitch + pitch));
    this.draw();
  }

  grow(by) {
    this.zoom = Math.max(0.1, Math.min(20, this.zoom * by));
    this.draw();
  }

  take(view) {
    this.view = view;
    this.draw();
  }

  // The same in words, for people who cannot see it.
  camera({ key_frames, landmarks, recording, guiding, metric }) {
    const { t } = this;
    const parts = [key_frames ? t('page-map-words', { places: key_frames, points: landmarks }) : t('page-no-map')];
    if (recording && metric) parts.push(t('page-map-route', { metres: Math.round(recording.length) }));
    if (guiding) parts.push(t('page-map-walker', { percent: Math.round((100 * guiding.along_m) / (guiding.length_m || 1)) }));
    const text = parts.join(' ');
    // Not with every status: text that changes constantly cannot be read.
    const now = performance.now();
    if (text !== this.words.textContent && now - (this.told ?? -1e9) > 5000) {
      this.told = now;
      delete this.words.dataset.text;
      this.words.textContent = text;
    }
  }

  // Axes of the drawing: gravity points down, yaw rotates about it, pitch tilts from the side view to the view from
  // above.
  axes() {
    const up = unit(this.view.up);
    const side = unit(cross(up, Math.abs(up[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]));
    const ahead = cross(side, up);
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const right = side.map((v, i) => c * v + s * ahead[i]);
    const away = side.map((v, i) => c * ahead[i] - s * v);
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    return [right, away.map((v, i) => sp * v + cp * up[i])];
  }

  draw() {
    const { view, canvas } = this;
    const ctx = canvas.getContext('2d', { alpha: false });
    const [w, h] = [canvas.width, canvas.height];
    ctx.fillStyle = '#0a0e13';
    ctx.fillRect(0, 0, w, h);
    if (!view || view.key_frames.length === 0) return;
    const [right, up] = this.axes();
    const flat = (p) => [dot(p, right), dot(p, up)];
    const places = [...view.key_frames, ...view.recorded].map(flat);
    const bounds = (i) => { const all = places.map((p) => p[i]); return [Math.min(...all), Math.max(...all)]; };
    const [[x0, x1], [y0, y1]] = [bounds(0), bounds(1)];
    const scale = this.zoom * 0.75 * Math.min(w / Math.max(x1 - x0, 0.5), h / Math.max(y1 - y0, 0.5));
    const at = (p) => { const [x, y] = flat(p); return [w / 2 + (x - (x0 + x1) / 2) * scale, h / 2 - (y - (y0 + y1) / 2) * scale]; };
    ctx.fillStyle = '#6f8296';
    for (const p of view.points) {
      const [x, y] = at(p);
      if (x > 0 && x < w && y > 0 && y < h) ctx.fillRect(x, y, 1.5, 1.5);
    }
    const line = (points, colour, width, dash = []) => {
      if (points.length < 2) return;
      ctx.beginPath();
      points.forEach((p, i) => ctx[i ? 'lineTo' : 'moveTo'](...at(p)));
      [ctx.strokeStyle, ctx.lineWidth] = [colour, width];
      ctx.setLineDash(dash);
      ctx.stroke();
      ctx.setLineDash([]);
    };
    line(view.recorded, '#8fb4ff', 5);
    line(view.plan, '#ffd479', 3, [8, 5]);
    ctx.fillStyle = '#7be0a0';
    for (const p of view.key_frames) {
      const [x, y] = at(p);
      ctx.fillRect(x - 1.5, y - 1.5, 3, 3);
    }
    if (view.camera) this.arrow(ctx, at, view.camera, 22 / scale);
  }

  // The camera: a wedge that opens in its viewing direction.
  arrow(ctx, at, [place, side, , ahead], size) {
    const to = (s, a) => place.map((v, i) => v + size * (s * side[i] + a * ahead[i]));
    ctx.beginPath();
    [place, to(-0.5, 1), to(0.5, 1)].forEach((p, i) => ctx[i ? 'lineTo' : 'moveTo'](...at(p)));
    ctx.closePath();
    ctx.fillStyle = '#ff9d8a';
    ctx.fill();
    [ctx.strokeStyle, ctx.lineWidth] = ['#fff', 1.5];
    ctx.stroke();
  }
}
