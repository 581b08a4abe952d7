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
      const cells = [];
      for (let k = 0; k < TILE * TILE; k += 1) {
        const spans = [];
        let until = base;
        for (let runs = byte(); runs > 0; runs -= 1) {
          const run = byte();
          const from = until;
          until += (run & 63) + 1;
          const last = spans.at(-1);
          // A run is at most 64 steps long.
          if (last && last.ends[1] === from && last.kind === run >> 6) last.ends[1] = until;
          else if (run >> 6) spans.push({ ends: [from, until], kind: run >> 6 });
        }
        cells.push(spans);
      }
      const block = { born, ...this.boxes(place, cells) };
      // More lines would hide what is occupied.
      const free = cells.flatMap((spans, k) => (k % 4 === 2 && Math.floor(k / TILE) % 4 === 2
        ? spans.filter((s) => s.kind === FREE).map(({ ends }) => ends.map((z) => this.inMap([...this.middle(place, k), z * this.step]))) : []));
      this.cubes.set(place.join(), { blocks: new Map([[0, block]]), mesh: null, free });
      this.latest = Math.max(this.latest, born);
    }
  }

  inMap(p) { return [0, 1, 2].map((i) => p.reduce((sum, v, k) => sum + v * this.axes[k][i], 0)); }

  // A line in each free span.
  free() { return [...this.cubes.values()].flatMap((cube) => cube.free); }

  middle(place, k) { return [k % TILE, Math.floor(k / TILE)].map((c, i) => (TILE * place[i] + c + 0.5) * this.cell); }

  // A box for each occupied span: the faces that are seen from free space, so that one looks through a ceiling into the room. What is
  // beside the tile counts as free. Corners are counter-clockwise as seen from outside.
  boxes(place, cells) {
    const [places, normals, corners] = [[], [], []];
    const half = (FILLED * this.cell) / 2;
    cells.forEach((spans, k) => {
      for (const { ends } of spans.filter((s) => s.kind === OCCUPIED)) {
        const [low, high] = ends.map((z) => z * this.step);
        const centre = [...this.middle(place, k), (low + high) / 2];
        const halves = [half, half, (high - low) / 2];
        for (const [axis, side] of FACES.filter(([a, s]) => isSeen(cells, k, ends, a, s))) {
          const [next, last] = [(axis + 1) % 3, (axis + 2) % 3];
          const first = places.length / 3;
          corners.push(...[0, 1, 2, 0, 2, 3].map((c) => first + c));
          for (const [a, b] of CORNERS) {
            const p = [...centre];
            p[axis] += side * halves[axis];
            p[next] += side * a * halves[next];
            p[last] += b * halves[last];
            places.push(...this.inMap(p));
            normals.push(...this.axes[axis].map((v) => side * v));
          }
        }
      }
    });
    return { places, normals, corners };
  }
}

// Whether a face of an occupied span borders on free space.
function isSeen(cells, k, [low, high], axis, side) {
  const isFree = (cell, from, to) => cells[cell].some((s) => s.kind === FREE && s.ends[0] < to && s.ends[1] > from);
  if (axis === 2) return side > 0 ? isFree(k, high, high + 1) : isFree(k, low - 1, low);
  const [along, step] = axis === 0 ? [k % TILE, 1] : [Math.floor(k / TILE), TILE];
  return along + side < 0 || along + side >= TILE || isFree(k + side * step, low, high);
}
