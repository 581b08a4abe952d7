// The map on the page: what of it is drawn and in which colours, in three dimensions or, where WebGL is missing, flat;
// and the same in words, for people who cannot see it.
import { Columns } from './columns.js';
import { Flat } from './view.js';
import { Orbit, ground } from './orbit.js';
import { Scene } from './scene.js';
import { Shaded } from './shaded.js';
import { Surface } from './surface.js';

const $ = (id) => document.getElementById(id);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const rgb = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255);
const mix = (a, b, t) => a.map((v, i) => v + t * (b[i] - v));
const pairs = (line) => line.slice(1).map((p, i) => [line[i], p]);
// A round number near a length: 1, 2 or 5 times a power of ten.
const round = (length) => {
  const power = 10 ** Math.floor(Math.log10(length));
  return power * [1, 2, 5, 10].find((n) => n * power >= 0.999 * length);
};
// Text about the map changes at most this often: what changes constantly cannot be read.
const WORDS_MS = 5000;
// Squares of the grid across what is seen, and the longest scale bar in pixels.
const SQUARES = 12;
const BAR = 110;

export class MapView {
  // `t` gives a sentence of the page by its id and values, `number` a number in its language, `keys` what the keys of the view do;
  // `chosen` is called when another part of the map is wanted.
  constructor(canvas, words, { t, number, keys, chosen }) {
    Object.assign(this, { canvas, words, t, number, view: null, place: null, metric: false, waits: false, isSeen: false });
    this.orbit = new Orbit(canvas, () => this.draw(), keys);
    this.scene = Scene.on(canvas);
    this.flat = this.scene ? null : new Flat(canvas);
    this.surface = new Surface();
    this.columns = new Columns();
    this.shaded = this.scene && new Shaded(this.scene);
    this.boxes = this.scene && new Shaded(this.scene);
    $('map-controls').hidden = !this.scene;
    for (const id of ['map-colour', 'map-follow']) $(id).addEventListener('change', () => { this.tint = null; this.draw(); });
    for (const id of ['map-surface', 'map-columns']) $(id).addEventListener('change', () => { this.tint = null; this.draw(); chosen(); });
    // Screen readers have the words; who moves the map by keys is led to it.
    $('map-how').addEventListener('click', () => {
      $('map-help').hidden = !$('map-help').hidden;
      $('map-how').ariaExpanded = String(!$('map-help').hidden);
      if (!$('map-help').hidden) canvas.focus();
    });
    canvas.addEventListener('webglcontextrestored', () => this.draw());
    matchMedia('(prefers-color-scheme: light)').addEventListener('change', () => { this.tint = null; this.draw(); });
    new ResizeObserver(() => this.draw()).observe(canvas);
    // A phone on the chest shows the top of the page: what nobody sees costs nothing.
    new IntersectionObserver(([entry]) => { this.isSeen = entry.isIntersecting; this.draw(); }).observe(canvas);
  }

  take(view) {
    this.view = view;
    this.tint = null;
    this.draw();
  }

  // Whether the surface is to be sent.
  get wantsSurface() { return Boolean(this.shaded?.isPossible) && $('map-surface').checked; }

  // Whether the columns are to be sent.
  get wantsColumns() { return Boolean(this.boxes?.isPossible) && $('map-columns').checked; }

  // A message with some of the columns.
  takeColumns(buffer) {
    this.columns.take(buffer);
    this.tint = null;
    this.draw();
  }

  // A message with some of the surface.
  takeSurface(buffer) {
    this.surface.take(buffer);
    // Where there is a surface, there are columns too.
    for (const id of ['map-surface-line', 'map-columns-line']) $(id).hidden = this.surface.isEmpty && this.columns.isEmpty;
    this.tint = null;
    this.draw();
  }

  // Position and axes of the camera; null where it is not known.
  walker(camera) {
    this.place = camera;
    this.draw();
  }

  // The same in words.
  camera({ key_frames, landmarks, recording, guiding, metric }) {
    const { t } = this;
    this.metric = metric;
    const parts = [key_frames ? t('page-map-words', { places: key_frames, points: landmarks }) : t('page-no-map')];
    if (this.surface.area >= 1) parts.push(t('page-map-surface', { area: Math.round(this.surface.area) }));
    if (recording && metric) parts.push(t('page-map-route', { metres: Math.round(recording.length) }));
    if (guiding) parts.push(t('page-map-walker', { percent: Math.round((100 * guiding.along_m) / (guiding.length_m || 1)) }));
    const text = parts.join(' ');
    const now = performance.now();
    if (text !== this.words.textContent && now - (this.told ?? -1e9) > WORDS_MS) {
      this.told = now;
      delete this.words.dataset.text;
      this.words.textContent = text;
    }
  }

  // Drawn with the next frame of the screen, once for all that changed until then.
  draw() {
    if (this.waits || !this.isSeen) return;
    this.waits = true;
    requestAnimationFrame(() => {
      this.waits = false;
      if (this.scene) this.solid();
      else this.flat.draw(this.view && { ...this.view, camera: this.place }, this.orbit);
    });
  }

  colours() {
    const style = getComputedStyle(document.documentElement);
    const names = ['canvas', 'faint', 'point', 'route', 'plan', 'eye', 'go', 'loop', 'low', 'middle', 'high'];
    return Object.fromEntries(names.map((name) => [name, rgb(style.getPropertyValue(`--${name}`).trim())]));
  }

  solid() {
    const { view, scene, orbit } = this;
    const colour = this.colours();
    const is = view && view.key_frames.length > 0;
    $('map-legend').hidden = $('map-scale').hidden = !is;
    if (!is) {
      scene.clear(colour.canvas, new Float32Array(16));
      return;
    }
    this.tint ??= this.tinted(colour);
    const { places, colours, floor, bounds, heights } = this.tint;
    const axes = ground(view.up);
    const follows = $('map-follow').checked && this.place;
    const size = Math.max(Math.hypot(bounds[1][0] - bounds[0][0], bounds[1][1] - bounds[0][1]), 1e-3);
    const at = (x, y, z) => [0, 1, 2].map((i) => x * axes[0][i] + y * axes[1][i] + z * axes[2][i]);
    const middle = at((bounds[0][0] + bounds[1][0]) / 2, (bounds[0][1] + bounds[1][1]) / 2, (bounds[0][2] + bounds[1][2]) / 2);
    const moves = orbit.aim(follows ? this.place[0] : middle, size, view.up);
    scene.clear(colour.canvas, orbit.matrix);
    this.grid(colour.faint, axes, floor, size, at, follows ? this.place[0] : middle);
    if (this.wantsSurface && !this.surface.isEmpty) {
      this.shaded.draw(this.surface, this.shades(colour, this.surface.latest, heights, axes[2]));
    }
    if (this.wantsColumns && !this.columns.isEmpty) {
      this.boxes.draw(this.columns, this.shades(colour, this.columns.latest, heights, axes[2]));
      scene.lines(this.tint.free, colour.faint, 1);
    }
    scene.discs(places, colours, 3);
    const path = view.key_frames.slice(1).flatMap((p, i) => (view.maps[i] === view.maps[i + 1] ? [[view.key_frames[i], p]] : []));
    scene.lines(path, colour.go, 1.5);
    scene.discs(view.key_frames.flat(), view.key_frames.flatMap(() => colour.go), 5);
    scene.lines(view.loops.map(([a, b]) => [view.key_frames[a], view.key_frames[b]]).filter(([a, b]) => a && b), colour.loop, 2);
    scene.lines(pairs(view.recorded), colour.route, 4);
    scene.lines(pairs(view.plan), colour.plan, 3, 24);
    if (this.place) this.wedge(colour.eye, this.place);
    if (moves) this.draw();
  }

  // How surfaces and boxes are coloured.
  shades(colour, latest, heights, up) {
    const by = $('map-colour').value;
    const range = { height: heights, age: [0, latest], normal: [-1, 1] }[by];
    return { by, range, up, into: this.orbit.into, colours: [colour.low, colour.middle, colour.high] };
  }

  // Where points are and in which colour, for this view; the box around the way, along the axes of the ground.
  tinted(colour) {
    const { view } = this;
    const axes = ground(view.up);
    const along = (p) => axes.map((axis) => dot(p, axis));
    const seen = this.wantsSurface ? this.surface.middles() : [];
    const way = [...view.key_frames, ...view.recorded, ...seen].map(along);
    const bounds = [Math.min, Math.max].map((f) => [0, 1, 2].map((i) => way.reduce((v, p) => f(v, p[i]), way[0][i])));
    const heights = view.points.map((p) => dot(p, axes[2]));
    const sorted = Float64Array.from(heights).sort();
    const [low, high] = [0.05, 0.95].map((share) => sorted[Math.floor(share * (sorted.length - 1))] ?? 0);
    const by = $('map-colour').value;
    const byAge = by === 'age';
    // Points come in the order in which they were found.
    const share = (i) => (byAge ? i / Math.max(view.points.length - 1, 1) : (heights[i] - low) / Math.max(high - low, 1e-6));
    const ramp = (s) => (s < 0.5 ? mix(colour.low, colour.middle, 2 * Math.max(s, 0)) : mix(colour.middle, colour.high, 2 * Math.min(s, 1) - 1));
    // A point has no direction.
    const colours = view.points.flatMap((_, i) => (by === 'normal' ? colour.point : ramp(share(i))));
    const ends = {
      height: ['page-map-low', 'page-map-high'], age: ['page-map-old', 'page-map-new'], normal: ['page-map-down', 'page-map-up'],
    }[by];
    ['map-ramp-from', 'map-ramp-to'].forEach((id, k) => { $(id).textContent = this.t(ends[k]); });
    const free = this.wantsColumns ? this.columns.free() : [];
    return { places: view.points.flat(), colours, free, floor: Math.min(low, bounds[0][2]), bounds, heights: [low, high] };
  }

  // Squares on the floor, of one round length, and a bar of another on the screen.
  grid(colour, axes, floor, size, at, target) {
    const square = round((2 * size) / this.orbit.zoom / SQUARES);
    const [u, v] = [dot(target, axes[0]), dot(target, axes[1])].map((x) => square * Math.round(x / square));
    const half = SQUARES * square;
    const lines = [];
    for (let k = -SQUARES; k <= SQUARES; k += 1) {
      lines.push([at(u + k * square, v - half, floor), at(u + k * square, v + half, floor)]);
      lines.push([at(u - half, v + k * square, floor), at(u + half, v + k * square, floor)]);
    }
    this.scene.lines(lines, colour, 1);
    let bar = round(BAR / this.orbit.pixels);
    while (bar * this.orbit.pixels > BAR) bar = round(bar / 2.5);
    const decimals = Math.max(0, -Math.floor(Math.log10(bar)));
    $('map-scale').style.width = `${bar * this.orbit.pixels}px`;
    $('map-scale').textContent = this.t(this.metric ? 'page-map-bar' : 'page-map-bar-units', { length: this.number(bar, decimals) });
    const shown = this.number(square, Math.max(0, -Math.floor(Math.log10(square))));
    const text = this.t(this.metric ? 'page-map-grid' : 'page-map-grid-units', { length: shown });
    if ($('map-grid').textContent !== text) $('map-grid').textContent = text;
  }

  // A wedge that opens where the camera looks, as large on the screen at any size of the view.
  wedge(colour, [place, side, down, ahead]) {
    const size = 16 / this.orbit.pixels;
    const to = (s, d, a) => place.map((v, i) => v + size * (s * side[i] + d * down[i] + a * ahead[i]));
    const corners = [to(-0.6, -0.4, 1), to(0.6, -0.4, 1), to(0.6, 0.4, 1), to(-0.6, 0.4, 1)];
    const dark = colour.map((v) => 0.6 * v);
    const faces = [[0, 1, colour], [1, 2, dark], [2, 3, colour], [3, 0, dark]];
    this.scene.solid(faces.flatMap(([a, b]) => [...place, ...corners[a], ...corners[b]]), faces.flatMap(([, , c]) => [...c, ...c, ...c]));
  }
}
