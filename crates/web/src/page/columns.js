// Columns as the server sends them (crates/web/src/columns.rs): what is free and what is occupied above each cell of the ground.
// Occupied spans become boxes, gathered by tiles, each of which is drawn at once as a cube of the surface is.

const TILE = 16;
// A box is so much of its cell wide, so that boxes are told apart.
const FILLED = 0.92;
const [FREE, OCCUPIED] = [1, 2];
const FACES = [0, 1, 2].flatMap((axis) => [[axis, 1], [axis, -1]]);
const CORNERS = [[-1, -1], [1, -1], [1, 1], [-1, 1]];

export class Columns {
  constructor() {
    const pose = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    const cubes = new Map();
    Object.assign(this, { parts: new Map([[0, { pose, cubes }]]), cubes, latest: 0 });
  }

  get isEmpty() { return this.cubes.size === 0; }

  // Takes a message.
  take(buffer) {
    const data = new DataView(buffer);
    let at = 4;
    const float = () => { at += 4; return data.getFloat32(at - 4, true); };
    const signed = () => { at += 4; return data.getInt32(at - 4, true); };
    const number = () => { at += 4; return data.getUint32(at - 4, true); };
    const byte = () => { at += 1; return data.getUint8(at - 1); };
    if (data.getUint8(1) === 1) Object.assign(this, new Columns());
    this.axes = [0, 1, 2].map(() => [float(), float(), float()]);
    [this.cell, this.step] = [float(), float()];
    for (let n = number(); n > 0; n -= 1) this.cubes.delete([signed(), signed()].join());
    for (let n = number(); n > 0; n -= 1) {
      const place = [signed(), signed()];
      const base = signed();
      const born = number() / 10;
      const spans = [];
      for (let k = 0; k < TILE * TILE; k += 1) {
        const middle = [k % TILE, Math.floor(k / TILE)].map((c, i) => (TILE * place[i] + c + 0.5) * this.cell);
        let until = base;
        for (let runs = byte(); runs > 0; runs -= 1) {
          const run = byte();
          const from = until;
          until += (run & 63) + 1;
          if (run >> 6) spans.push({ middle, ends: [from * this.step, until * this.step], kind: run >> 6 });
        }
      }
      const block = { born, ...this.boxes(spans.filter((s) => s.kind === OCCUPIED)) };
      const free = spans.filter((s) => s.kind === FREE).map(({ middle, ends }) => ends.map((z) => this.inMap([...middle, z])));
      this.cubes.set(place.join(), { blocks: new Map([[0, block]]), mesh: null, free });
      this.latest = Math.max(this.latest, born);
    }
  }

  inMap(p) { return [0, 1, 2].map((i) => p.reduce((sum, v, k) => sum + v * this.axes[k][i], 0)); }

  // A line in each free span.
  free() { return [...this.cubes.values()].flatMap((cube) => cube.free); }

  // A box for each span: places, normals and corners, counter-clockwise as seen from outside.
  boxes(spans) {
    const places = new Float32Array(72 * spans.length);
    const normals = new Float32Array(72 * spans.length);
    const corners = new Uint32Array(36 * spans.length);
    const half = (FILLED * this.cell) / 2;
    let [vertex, corner] = [0, 0];
    for (const { middle, ends: [low, high] } of spans) {
      const centre = [...middle, (low + high) / 2];
      const halves = [half, half, (high - low) / 2];
      for (const [axis, side] of FACES) {
        const [next, last] = [(axis + 1) % 3, (axis + 2) % 3];
        corners.set([0, 1, 2, 0, 2, 3].map((c) => vertex + c), corner);
        corner += 6;
        for (const [a, b] of CORNERS) {
          const p = [...centre];
          p[axis] += side * halves[axis];
          p[next] += side * a * halves[next];
          p[last] += b * halves[last];
          places.set(this.inMap(p), 3 * vertex);
          normals.set(this.axes[axis].map((v) => side * v), 3 * vertex);
          vertex += 1;
        }
      }
    }
    return { places, normals, corners };
  }
}
