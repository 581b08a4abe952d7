// The map as the server describes it by differences (crates/session/src/drawn.rs): what has been drawn, changed by each message.

export class Model {
  constructor() {
    Object.assign(this, { points: new Map(), keyFrames: new Map(), recorded: [], plan: [] });
  }

  // Takes a message; returns the map with lists of places.
  take(buffer) {
    const data = new DataView(buffer);
    let at = 4;
    const number = () => { at += 4; return data.getUint32(at - 4, true); };
    const float = () => { at += 4; return data.getFloat32(at - 4, true); };
    if (data.getUint8(1) === 1) Object.assign(this, new Model());
    const step = float();
    const up = [float(), float(), float()];
    const place = () => [0, 1, 2].map(() => { at += 2; return step * data.getInt16(at - 2, true); });
    const each = (act) => { for (let n = number(); n > 0; n -= 1) act(); };
    each(() => this.points.delete(number()));
    each(() => this.points.set(number(), place()));
    each(() => this.keyFrames.delete(number()));
    each(() => this.keyFrames.set(number(), { place: place(), map: number() }));
    const links = [];
    each(() => links.push([number(), number()]));
    for (const line of [this.recorded, this.plan]) {
      line.length = number();
      each(() => line.push(place()));
    }
    const inOrder = (map) => [...map].sort(([a], [b]) => a - b);
    const keyFrames = inOrder(this.keyFrames);
    const index = new Map(keyFrames.map(([id], k) => [id, k]));
    return {
      up,
      points: inOrder(this.points).map(([, p]) => p),
      key_frames: keyFrames.map(([, k]) => k.place),
      maps: keyFrames.map(([, k]) => k.map),
      loops: links.map((ids) => ids.map((id) => index.get(id))).filter(([a, b]) => a !== undefined && b !== undefined),
      recorded: this.recorded,
      plan: this.plan,
    };
  }
}
