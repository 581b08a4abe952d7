// The surface as the server sends it (crates/web/src/surface/sent.rs): meshes of blocks in the frames of their submaps.
// Blocks are gathered in cubes, each of which is drawn at once.

// Blocks along the edge of a cube, and units of a voxel's edge.
const CUBE = 4;
const UNITS = 4096;
const SIDE = 8;

export class Surface {
  constructor() {
    Object.assign(this, { voxel: 0, parts: new Map(), latest: 0, area: 0 });
  }

  get isEmpty() { return this.area === 0; }

  // Takes a message.
  take(buffer) {
    const data = new DataView(buffer);
    if (data.getUint8(1) === 1) Object.assign(this, new Surface());
    this.voxel = data.getFloat32(4, true);
    let at = 8;
    const number = () => { at += 4; return data.getUint32(at - 4, true); };
    const signed = () => { at += 4; return data.getInt32(at - 4, true); };
    const float = () => { at += 4; return data.getFloat32(at - 4, true); };
    const short = () => { at += 2; return data.getUint16(at - 2, true); };
    const byte = () => { at += 1; return data.getUint8(at - 1); };
    for (let n = number(); n > 0; n -= 1) this.drop(number());
    for (let n = number(); n > 0; n -= 1) {
      const id = number();
      const rows = [0, 1, 2].map(() => [float(), float(), float(), float()]);
      const part = this.parts.get(id) ?? { cubes: new Map() };
      part.pose = new Float32Array([0, 1, 2, 3].flatMap((k) => [...rows.map((row) => row[k]), k === 3 ? 1 : 0]));
      this.parts.set(id, part);
    }
    for (let n = number(); n > 0; n -= 1) {
      const id = number();
      const key = [signed(), signed(), signed()];
      const born = number() / 10;
      const [vertices, triangles] = [short(), short()];
      const places = new Float32Array(3 * vertices);
      for (let i = 0; i < places.length; i += 1) places[i] = this.voxel * (SIDE * key[i % 3] + short() / UNITS);
      const corners = new Uint16Array(3 * triangles);
      const corner = vertices <= 256 ? byte : short;
      for (let i = 0; i < corners.length; i += 1) corners[i] = corner();
      this.put(id, key, triangles ? { born, places, corners, ...shape(places, corners) } : null);
    }
  }

  drop(id) {
    for (const cube of this.parts.get(id)?.cubes.values() ?? []) {
      for (const block of cube.blocks.values()) this.area -= block.area;
    }
    this.parts.delete(id);
    if (this.parts.size === 0) this.area = 0;
  }

  put(id, key, block) {
    const part = this.parts.get(id);
    if (!part) return;
    const name = key.map((k) => Math.floor(k / CUBE)).join();
    const cube = part.cubes.get(name) ?? { blocks: new Map(), mesh: null };
    part.cubes.set(name, cube);
    this.area += (block?.area ?? 0) - (cube.blocks.get(key.join())?.area ?? 0);
    if (block) cube.blocks.set(key.join(), block);
    else cube.blocks.delete(key.join());
    cube.mesh = null;
    this.latest = Math.max(this.latest, block?.born ?? 0);
  }

  // The middles of the cubes in the map's frame.
  middles() {
    const edge = CUBE * SIDE * this.voxel;
    return [...this.parts.values()].flatMap(({ pose, cubes }) => [...cubes].filter(([, cube]) => cube.blocks.size).map(([name]) => {
      const middle = name.split(',').map((k) => (Number(k) + 0.5) * edge);
      return [0, 1, 2].map((row) => pose[12 + row] + middle.reduce((sum, v, k) => sum + v * pose[4 * k + row], 0));
    }));
  }
}

// Normals, as means over the triangles around a vertex weighted by their area, and the area of all.
function shape(places, corners) {
  const normals = new Float32Array(places.length);
  let area = 0;
  for (let i = 0; i < corners.length; i += 3) {
    const [a, b, c] = [3 * corners[i], 3 * corners[i + 1], 3 * corners[i + 2]];
    const u = [0, 1, 2].map((k) => places[b + k] - places[a + k]);
    const v = [0, 1, 2].map((k) => places[c + k] - places[a + k]);
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    area += Math.hypot(...n) / 2;
    for (const at of [a, b, c]) for (let k = 0; k < 3; k += 1) normals[at + k] += n[k];
  }
  return { normals, area };
}

// Vertices (place, normal, time) and corners of all blocks of a cube.
export function joined(cube) {
  const blocks = [...cube.blocks.values()];
  const count = (list) => blocks.reduce((sum, block) => sum + block[list].length, 0);
  const vertices = new Float32Array((7 * count('places')) / 3);
  const corners = new Uint32Array(count('corners'));
  let [vertex, corner] = [0, 0];
  for (const block of blocks) {
    for (let i = 0; i < block.corners.length; i += 1) corners[corner + i] = vertex + block.corners[i];
    corner += block.corners.length;
    for (let i = 0; i < block.places.length; i += 3) {
      for (let k = 0; k < 3; k += 1) [vertices[7 * vertex + k], vertices[7 * vertex + 3 + k]] = [block.places[i + k], block.normals[i + k]];
      vertices[7 * vertex + 6] = block.born;
      vertex += 1;
    }
  }
  return { vertices, corners };
}
