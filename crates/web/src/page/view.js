// Drawing on plain canvases: the image with its features, and, where WebGL is missing, the map with the route.

import { ground } from './orbit.js';

const LITTLE = true;

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
  }

  gray(w, h, gray) {
    const { canvas } = this;
    if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
    const ctx = canvas.getContext('2d', { alpha: false });
    const image = ctx.createImageData(w, h);
    const px = new Uint32Array(image.data.buffer);
    for (let i = 0; i < w * h; i += 1) px[i] = 0xff000000 | (gray[i] * 0x010101);
    ctx.putImageData(image, 0, 0);
    return ctx;
  }

  // Kind, width, height, count, a padding byte; pairs of coordinates; gray rows.
  draw(buffer) {
    const data = new DataView(buffer);
    if (data.byteLength < 8 || data.getUint8(0) !== 1) return;
    const [w, h, n] = [1, 3, 5].map((at) => data.getUint16(at, LITTLE));
    const gray = new Uint8Array(buffer, 8 + 4 * n);
    if (gray.length < w * h) return;
    const ctx = this.gray(w, h, gray);
    ctx.fillStyle = '#7be0a0';
    for (let i = 0; i < n; i += 1) {
      ctx.fillRect(data.getUint16(8 + 4 * i, LITTLE) - 1, data.getUint16(10 + 4 * i, LITTLE) - 1, 2, 2);
    }
  }
}

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

export class Flat {
  constructor(canvas) {
    this.canvas = canvas;
  }

  // Axes of the drawing: gravity points down, yaw rotates about it, pitch tilts from the side view to the view from
  // above.
  axes() {
    const [side, ahead, up] = ground(this.view.up);
    const [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    const right = side.map((v, i) => c * v - s * ahead[i]);
    const away = side.map((v, i) => c * ahead[i] + s * v);
    const [cp, sp] = [Math.cos(this.pitch), Math.sin(this.pitch)];
    return [right, away.map((v, i) => sp * v + cp * up[i])];
  }

  // `turned` has the angles of the view and its size.
  draw(view, turned) {
    const { canvas } = this;
    Object.assign(this, { view, yaw: turned.yaw, pitch: turned.pitch, zoom: turned.zoom });
    const ctx = canvas.getContext('2d', { alpha: false });
    const [w, h] = [canvas.width, canvas.height];
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    ctx.fillStyle = colour('canvas');
    ctx.fillRect(0, 0, w, h);
    if (!view || view.key_frames.length === 0) return;
    const [right, up] = this.axes();
    const flat = (p) => [dot(p, right), dot(p, up)];
    const places = [...view.key_frames, ...view.recorded].map(flat);
    const bounds = (i) => { const all = places.map((p) => p[i]); return [Math.min(...all), Math.max(...all)]; };
    const [[x0, x1], [y0, y1]] = [bounds(0), bounds(1)];
    const scale = this.zoom * 0.75 * Math.min(w / Math.max(x1 - x0, 0.5), h / Math.max(y1 - y0, 0.5));
    const at = (p) => { const [x, y] = flat(p); return [w / 2 + (x - (x0 + x1) / 2) * scale, h / 2 - (y - (y0 + y1) / 2) * scale]; };
    ctx.fillStyle = colour('point');
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
    line(view.recorded, colour('route'), 5);
    line(view.plan, colour('plan'), 3, [8, 5]);
    ctx.fillStyle = colour('go');
    for (const p of view.key_frames) {
      const [x, y] = at(p);
      ctx.fillRect(x - 1.5, y - 1.5, 3, 3);
    }
    if (view.camera) this.arrow(ctx, at, view.camera, 22 / scale, [colour('eye'), colour('text')]);
  }

  // The camera: a wedge that opens in its viewing direction.
  arrow(ctx, at, [place, side, , ahead], size, [fill, edge]) {
    const to = (s, a) => place.map((v, i) => v + size * (s * side[i] + a * ahead[i]));
    ctx.beginPath();
    [place, to(-0.5, 1), to(0.5, 1)].forEach((p, i) => ctx[i ? 'lineTo' : 'moveTo'](...at(p)));
    ctx.closePath();
    ctx.fillStyle = fill;
    ctx.fill();
    [ctx.strokeStyle, ctx.lineWidth] = [edge, 1.5];
    ctx.stroke();
  }
}
